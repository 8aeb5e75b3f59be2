r"""Multipliers that maximize D at the worst vertex of a box, for tasks with corners of reserves or walls.

If a reserve cannot be produced, multipliers at the middle of a box grow until D exceeds any cut there, and D
falls all the more steeply towards the vertices. So D is maximized at all vertices v of the box at once, smoothed:

.. math::

    F(y, \sigma) = -T \log \sum_v e^{-D_v(y, \sigma) / T} + m \sum_r \log \sigma_r
        - \frac{1}{2} \sum_{k,l} r_l y_{kl}^2

under the condition that p'_E cancels, by damped Newton steps while T, m and the kink width s decrease: psi of a
corner, u_min t + (u_max - u_min) max(t, 0), is smoothed to u_min t + (u_max - u_min) (t + sqrt(t^2 + s^2) - s) / 2.
That is less, and at the maximum sum_v w_v G_v is nearly zero, so hardly any multipliers raise the worst vertex
above sum_v w_v D_v + W m: if that is under the cut, the search ends. Corners whose products a_j . y_k are of the
size of s are idle: they cost nothing and are dropped from later stages. No proof depends on this search: any
multipliers will do.

D_v is a sum over the modules; each has one of its frames, at one of the vertices of the root.

| symbol | meaning | shape |
|---|---|---|
| w_v | share of vertex v in the gradient: e^(-D_v / T) over their sum | (roots C,) |
| G_v | gradient of D_v; a row is sqrt(w_v / T) (G_v - sum_v w_v G_v) | (K, 6), (W,) |
"""

import math
from typing import NamedTuple

from nlp.bounds.branch.arrays import ROTORS, BranchProblem
from nlp.bounds.branch.frames import BoxFrames
from nlp.bounds.branch.multipliers import MIN_WEIGHT, NewtonWorkspace, best_input, copy, product, residual
from nlp.bounds.branch.vertices import MAX_VERTICES, VertexWorkspace, fill_frames, smoothed_value
from nlp.numbers.cholesky import factor, solve_factored
from nlp.numbers.kinematics import cross, row
from topo_search.compiled_code import njit
from topo_search.model.arrays import Array


class VertexSearch(NamedTuple):
    """Settings of the search."""

    stages: int = 6
    """Number of stages, with T, m and s less in each."""
    steps: int = 3
    """Largest number of Newton steps per stage."""
    max_trials: int = 6
    """Largest number of step sizes in a line search: 1, backtracking, backtracking^2, ..."""
    backtracking: float = 0.3
    min_gain: float = 1e-3
    """Least gain of a Newton step in the first stage, over the cut; it decreases with T."""
    max_step: float = 2.0
    """Longest step of y, over its length: y grows without limit if a reserve cannot be produced."""
    boundary_share: float = 0.95
    """Largest share of the way to sigma = 0 in one step."""
    initial_temperature: float = 0.05
    """T in the first stage, over the cut."""
    temperature_decay: float = 0.6
    """Ratio of T between stages."""
    initial_kink_width: float = 0.15
    """s in the first stage, over the cut / (r n u_max)."""
    kink_decay: float = 0.35
    """Ratio of s and of m between stages."""
    initial_barrier: float = 2e-3
    """m and least sigma in the first stage, over the cut."""
    target: float = 1.1
    """D of the worst vertex at which a stage ends, over the cut."""
    min_share: float = 1e-3
    """Least w_v that enters a step, over the greatest."""
    ridge: float = 0.02
    """Ridge of multipliers of force, over n / 24 sum_a rho_a^2: the bound's remainders grow with them."""
    corner_ridge: float = 10.0
    """Ridge of corners, over `ridge` / sqrt(sum_a rho_a^2): their psi has a kink."""
    min_corner_ridge: float = 100.0
    """Least ridge of corners, over `ridge`."""
    torque_ridge: float = 10.0
    """Ridge of multipliers of torque over that of force: levers are longer than l_arm."""
    min_square: float = 1e-6
    """Least sum_a rho_a^2 in a ridge [rad^2]."""
    idle_limit: float = 1.0
    """Largest |a_j . y_k| of an idle corner during the search, over s."""
    final_idle_limit: float = 1e-3
    """Largest |a_j . y_k| of an idle corner at the end, over 2 u_max."""
    condition_tolerance: float = 1e-9
    """Largest residual of the condition that counts as rounding, over the sum of sigma."""


SEARCH = VertexSearch()


@njit(cache=True, inner=True, allocates=False)
def start(
    problem: BranchProblem,
    box: BoxFrames,
    cut: float,
    initial_y: Array,
    initial_sigma: Array,
    workspace: VertexWorkspace,
) -> None:
    """Set up the search for a box, with the multipliers that it starts from.

    Args:
        problem: task and tree.
        box: the box of angles.
        cut: effort [effort units].
        initial_y: multipliers of load cases, shape (K, 6).
        initial_sigma: multipliers of walls, shape (W,).
        workspace: output.
    """
    y, sigma, rho = workspace.y, workspace.sigma, box.rho
    fill_frames(problem, box, workspace)
    square = 0.0
    for a in range(len(rho)):
        square += rho[a] ** 2
    square = max(square, SEARCH.min_square)
    ridge = SEARCH.ridge * len(problem.tree.parent) / 24 * square
    for k in range(len(y)):
        workspace.active[k] = True
        case_ridge = ridge
        if problem.loads.weight[k] == 0.0:
            case_ridge *= max(SEARCH.corner_ridge / math.sqrt(square), SEARCH.min_corner_ridge)
        for l in range(3):
            workspace.ridge[k, l], workspace.ridge[k, 3 + l] = case_ridge, SEARCH.torque_ridge * case_ridge
    copy(initial_y, y)
    for r in range(len(sigma)):
        sigma[r] = max(initial_sigma[r], SEARCH.initial_barrier * cut)
    # the condition holds from the start: steps shortened by the barrier preserve it
    _correct_torques(problem, y, sigma, True, workspace.S, workspace.q)


@njit(cache=True, inner=True, allocates=False)
def maximize(
    problem: BranchProblem, newton: NewtonWorkspace, workspace: VertexWorkspace, cut: float, stage: int, steps: int
) -> tuple[float, float]:
    """Improve y and sigma of `workspace` in one stage; return the least D and an upper limit on it, if known.

    Args:
        problem: task and tree.
        newton: workspace with the wrenches at the middle of the box.
        workspace: arrays for the box.
        cut: effort [effort units].
        stage: number of the stage, from 0.
        steps: largest number of Newton steps.
    """
    y, sigma, scale = workspace.y, workspace.sigma, SEARCH.kink_decay**stage
    T, m = SEARCH.initial_temperature * SEARCH.temperature_decay**stage * cut, SEARCH.initial_barrier * scale * cut
    s = SEARCH.initial_kink_width * scale * cut / (ROTORS * len(problem.tree.parent) * problem.u_max)
    best, minimum, mean = smoothed_value(problem, workspace, y, sigma, T, m, s)
    limit, converged = math.inf, False
    for _ in range(steps):
        _fill_newton_step(problem, newton, workspace, T, m, s)
        step_size, improved = _max_step_size(workspace), False
        for r in range(len(sigma)):
            if workspace.wall_step[r] < 0.0:
                step_size = min(step_size, -SEARCH.boundary_share * sigma[r] / workspace.wall_step[r])
        trial_value, trial_minimum, trial_mean = best, minimum, mean
        trial_y, trial_sigma = workspace.trial_y, workspace.trial_sigma
        for _ in range(SEARCH.max_trials):
            for k in range(len(y)):
                for l in range(6):
                    trial_y[k, l] = y[k, l] + step_size * workspace.step[k, l]
            for r in range(len(sigma)):
                trial_sigma[r] = sigma[r] + step_size * workspace.wall_step[r]
            trial = smoothed_value(problem, workspace, trial_y, trial_sigma, T, m, s)
            trial_value, trial_minimum, trial_mean = trial
            improved = trial_value > best
            if improved:
                break
            step_size *= SEARCH.backtracking
        if not improved:
            converged = True
            break
        copy(trial_y, y)
        for r in range(len(sigma)):
            sigma[r] = trial_sigma[r]
        gain, best, minimum, mean = trial_value - best, trial_value, trial_minimum, trial_mean
        if gain < SEARCH.min_gain * SEARCH.temperature_decay**stage * cut:
            limit, converged = mean + gain + len(sigma) * m if step_size == 1.0 else math.inf, True
            break
        if minimum > SEARCH.target * cut:
            break
    if converged:
        _drop_idle_corners(problem, newton, workspace, SEARCH.idle_limit * s)
    return minimum, limit


@njit(cache=True, inner=True, allocates=False)
def _max_step_size(workspace: VertexWorkspace) -> float:
    y_square, step_square = 0.0, 0.0
    for k in range(len(workspace.y)):
        for l in range(6):
            y_square, step_square = y_square + workspace.y[k, l] ** 2, step_square + workspace.step[k, l] ** 2
    return min(1.0, SEARCH.max_step * math.sqrt(y_square / step_square)) if y_square * step_square > 0.0 else 1.0


@njit(cache=True, inner=True, allocates=False)
def _drop_idle_corners(
    problem: BranchProblem, newton: NewtonWorkspace, workspace: VertexWorkspace, limit: float
) -> None:
    """Drop corners that cost next to nothing."""
    any_dropped = False
    for k in range(len(workspace.y)):
        may_drop = workspace.active[k] and problem.loads.weight[k] == 0.0
        if may_drop and _largest_product(newton, workspace.y, k) < limit:
            workspace.active[k], any_dropped = False, True
            for l in range(6):
                workspace.y[k, l], workspace.step[k, l] = 0.0, 0.0
    if any_dropped:
        _correct_torques(problem, workspace.y, workspace.sigma, False, workspace.S, workspace.q)


@njit(cache=True, inner=True, allocates=False)
def _largest_product(newton: NewtonWorkspace, y: Array, k: int) -> float:
    """Return the largest |a_j . y_k| at the middle."""
    greatest = 0.0
    for j in range(len(newton.a)):
        greatest = max(greatest, abs(product(newton.a, j, y, k)))
    return greatest


@njit(cache=True, inner=True, allocates=False)
def _select_vertices(workspace: VertexWorkspace) -> int:
    """Fill the vertices that enter a step and, in `q`, their shares; return their number."""
    largest, share_sum, count = 0.0, 0.0, 0
    while count < MAX_VERTICES:
        greatest = 0
        for vertex in range(len(workspace.share)):
            if workspace.share[vertex] > workspace.share[greatest]:
                greatest = vertex
        largest = max(largest, workspace.share[greatest])
        if workspace.share[greatest] <= SEARCH.min_share * largest:
            break
        workspace.order[count], workspace.q[count] = greatest, workspace.share[greatest]
        share_sum, count = share_sum + workspace.share[greatest], count + 1
        workspace.share[greatest] = 0.0
    for position in range(count):
        workspace.q[position] /= share_sum
    return count


@njit(cache=True, inner=True, allocates=False)
def _fill_newton_step(
    problem: BranchProblem, newton: NewtonWorkspace, workspace: VertexWorkspace, T: float, m: float, s: float
) -> None:
    """Fill the step to the maximum of a quadratic model of F, after `smoothed_value` has filled D."""
    walls, y, sigma, frames = problem.walls, workspace.y, workspace.sigma, workspace.frame_of_module
    n, K, W, C, V = len(problem.tree.parent), len(y), len(sigma), len(frames), _select_vertices(workspace)
    rows, wall_rows = workspace.rows, workspace.wall_rows
    gradient, wall_gradient = workspace.gradient, workspace.wall_gradient
    workspace.frame_share[:] = 0.0
    for vertex in range(V):
        root, c = workspace.order[vertex] // C, workspace.order[vertex] % C
        for i in range(n):
            workspace.frame_share[root, frames[c, i]] += workspace.q[vertex]
    workspace.H[:] = 0.0
    for root in range(len(workspace.a)):
        for v in range(len(workspace.module_of_frame)):
            if workspace.frame_share[root, v] > 0.0:
                _add_frame(problem, root, v, workspace, s)
    gradient[:] = 0.0
    wall_gradient[:] = 0.0
    for vertex in range(V):
        root, c = workspace.order[vertex] // C, workspace.order[vertex] % C
        index, share = 3 + vertex, workspace.q[vertex]
        for k in range(K):
            if workspace.active[k]:
                for l in range(6):
                    total = 0.0
                    for i in range(n):
                        total += workspace.module_gradient[root, frames[c, i], k, l]
                    rows[index, k, l] = total
                    gradient[k, l] += share * total
        for r in range(W):
            total = 0.0
            for i in range(n):
                total += workspace.wall[root, frames[c, i], r]
            wall_rows[index, r] = total
            wall_gradient[r] += share * total
    for vertex in range(V):
        scale = math.sqrt(workspace.q[vertex] / T)
        for k in range(K):
            for l in range(6):
                rows[3 + vertex, k, l] = scale * (rows[3 + vertex, k, l] - gradient[k, l])
        for r in range(W):
            wall_rows[3 + vertex, r] = scale * (wall_rows[3 + vertex, r] - wall_gradient[r])
    for k in range(K):
        for index in range(3):
            for l in range(6):
                rows[index, k, l] = newton.rows[k, index, l]
        for l in range(3):
            gradient[k, l] += problem.loads.f[k, l] - workspace.ridge[k, l] * y[k, l]
            gradient[k, 3 + l] += problem.loads.t[k, l] - workspace.ridge[k, 3 + l] * y[k, 3 + l]
    for r in range(W):
        for index in range(3):
            wall_rows[index, r] = -walls.normal[r, index]
        wall_gradient[r] += walls.offset[r] + m / sigma[r]
    _solve_step(3 + V, m, workspace)


@njit(cache=True, inner=True, allocates=False)
def _add_frame(problem: BranchProblem, root: int, v: int, workspace: VertexWorkspace, s: float) -> None:
    """Fill the gradient of a module in one of its frames, and add its share to the negative Hessian."""
    u_min, u_max, dead_rotor = problem.u_min, problem.u_max, problem.loads.dead_rotor
    share, (cx, cy, cz) = workspace.frame_share[root, v], workspace.moment[root, v]
    for k in range(len(workspace.y)):
        if not workspace.active[k]:
            continue
        weight, module_gradient, H = problem.loads.weight[k], workspace.module_gradient[root, v, k], workspace.H[k]
        for l in range(6):
            module_gradient[l] = 0.0
        for q in range(ROTORS):
            a, t = workspace.a[root, v, q], workspace.t[root, v, k, q]
            if dead_rotor[k] == ROTORS * workspace.module_of_frame[v] + q:
                continue
            if weight == 0.0:
                length, half = math.sqrt(t * t + s * s), (u_max - u_min) / 2
                u, curvature = u_min + half * (1 + t / length), half * s * s / length**3
            else:
                smoothed_weight = max(weight, MIN_WEIGHT)
                u = best_input(t, smoothed_weight, u_min, u_max)
                curvature = 1 / (2 * smoothed_weight) if u_min < u < u_max else 0.0
            for l in range(6):
                module_gradient[l] -= u * a[l]
            if curvature > 0.0:
                for l in range(6):
                    for column in range(l + 1):
                        H[l, column] += share * curvature * a[l] * a[column]
        hx, hy, hz = problem.loads.h[k]
        module_gradient[3] += cy * hz - cz * hy
        module_gradient[4] += cz * hx - cx * hz
        module_gradient[5] += cx * hy - cy * hx


@njit(cache=True, inner=True, allocates=False)
def _solve_step(row_count: int, m: float, workspace: VertexWorkspace) -> None:
    """Fill the step: the first three rows are the condition, and the others each cost half their square."""
    y, sigma, step, wall_step = workspace.y, workspace.sigma, workspace.step, workspace.wall_step
    H, S, q, solved = workspace.H, workspace.S, workspace.q, workspace.solved
    rows, wall_rows = workspace.rows, workspace.wall_rows
    for index in range(row_count):
        q[index] = 0.0
        for column in range(index + 1):
            S[index, column] = 0.0
    for k in range(len(y)):
        if not workspace.active[k]:
            continue
        for l in range(6):
            H[k, l, l] += workspace.ridge[k, l]
            step[k, l] = workspace.gradient[k, l]
        factor(H[k], 6)
        solve_factored(H[k], step[k], 6)
        for index in range(row_count):
            for l in range(6):
                solved[index, k, l] = rows[index, k, l]
                q[index] += rows[index, k, l] * (step[k, l] + (y[k, l] if index < 3 else 0.0))
            solve_factored(H[k], solved[index, k], 6)
            for column in range(index + 1):
                total = 0.0
                for l in range(6):
                    total += rows[index, k, l] * solved[column, k, l]
                S[index, column] += total
    for r in range(len(sigma)):
        compliance = sigma[r] ** 2 / m
        wall_step[r] = workspace.wall_gradient[r] * compliance
        for index in range(row_count):
            q[index] += wall_rows[index, r] * (wall_step[r] + (sigma[r] if index < 3 else 0.0))
            for column in range(index + 1):
                S[index, column] += wall_rows[index, r] * wall_rows[column, r] * compliance
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    for index in range(row_count):  # with all g = 0 there is no condition
        S[index, index] += 1.0 if index > 2 or trace == 0.0 else 1e-9 * trace
    factor(S, row_count)
    solve_factored(S, q, row_count)
    for k in range(len(y)):
        if workspace.active[k]:
            for l in range(6):
                for index in range(row_count):
                    step[k, l] -= q[index] * solved[index, k, l]
    for r in range(len(sigma)):
        for index in range(row_count):
            wall_step[r] -= q[index] * wall_rows[index, r] * sigma[r] ** 2 / m


@njit(cache=True, inner=True, allocates=False)
def evenness(workspace: VertexWorkspace, axis: int) -> float:
    """Return the product of the shares at the two ends of an angle, at most 1/4 when they are even.

    While multipliers do not distinguish the ends, D allows thrusts that mix both; halving forbids that.
    """
    C, upper, share_sum = len(workspace.frame_of_module), 0.0, 0.0
    for vertex in range(len(workspace.D)):
        bit = vertex // C >> (2 - axis) if axis < 3 else vertex % C >> (axis - 3)
        share_sum += workspace.share[vertex]
        if bit & 1:
            upper += workspace.share[vertex]
    return upper / share_sum * (1 - upper / share_sum)


@njit(cache=True, allocates=False)
def enforce_condition(problem: BranchProblem, newton: NewtonWorkspace, y: Array, sigma: Array) -> None:
    """Enforce the condition by the least change of nonzero torque multipliers; if that fails, set sigma to zero."""
    _correct_torques(problem, y, sigma, False, newton.S, newton.q)
    a, b, c = residual(problem, y, sigma)
    sigma_sum = 0.0
    for r in range(len(sigma)):
        sigma_sum += sigma[r]
    if not math.sqrt(a * a + b * b + c * c) <= SEARCH.condition_tolerance * sigma_sum:
        sigma[:] = 0.0
        _correct_torques(problem, y, sigma, False, newton.S, newton.q)


@njit(cache=True, inner=True, allocates=False)
def _correct_torques(problem: BranchProblem, y: Array, sigma: Array, all_cases: bool, S: Array, q: Array) -> None:
    """Change mu_k by q x g_k, where S q, S = sum_k [g_k]x [g_k]x^T, is the residual of the condition."""
    for a in range(3):
        for b in range(3):
            S[a, b] = 0.0
    for k in range(len(y)):
        if all_cases or _is_nonzero(y[k]):
            gx, gy, gz = problem.loads.g[k]
            S[0, 0], S[1, 1] = S[0, 0] + gy * gy + gz * gz, S[1, 1] + gz * gz + gx * gx
            S[2, 2], S[1, 0] = S[2, 2] + gx * gx + gy * gy, S[1, 0] - gx * gy
            S[2, 0], S[2, 1] = S[2, 0] - gx * gz, S[2, 1] - gy * gz
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    if trace == 0.0:
        return
    for a in range(3):
        S[a, a] += 1e-9 * trace  # parallel g leave a direction open
    factor(S, 3)
    for _ in range(3):
        q[0], q[1], q[2] = residual(problem, y, sigma)
        solve_factored(S, q[:3], 3)
        for k in range(len(y)):  # mu_k -= [g_k]x^T q = q x g_k
            if all_cases or _is_nonzero(y[k]):
                change = cross((q[0], q[1], q[2]), row(problem.loads.g, k))
                for l in range(3):
                    y[k, 3 + l] -= change[l]


@njit(cache=True, inner=True, allocates=False)
def _is_nonzero(y: Array) -> bool:
    nonzero: bool = False
    for l in range(6):
        nonzero |= y[l] != 0.0
    return nonzero


@njit(cache=True, inner=True, allocates=False)
def finish(problem: BranchProblem, newton: NewtonWorkspace, y: Array, sigma: Array) -> None:
    """Drop idle corners, each of which would lose something to rounding, and enforce the condition."""
    for k in range(len(y)):
        is_corner, limit = problem.loads.weight[k] == 0.0, SEARCH.final_idle_limit * 2 * problem.u_max
        if is_corner and _largest_product(newton, y, k) < limit:
            for l in range(6):
                y[k, l] = 0.0
    enforce_condition(problem, newton, y, sigma)

r"""Good multipliers for a box with corners of reserves or walls: those whose D is greatest at its worst vertex.

Where a reserve cannot be produced, multipliers at the middle of a box grow until D exceeds any cut there, and D
falls the more steeply towards the vertices. So what is maximised is D at all vertices v of the box at once,

.. math::

    F(y, \sigma) = -T \log \sum_v e^{-D_v(y, \sigma) / T} + m \sum_r \log \sigma_r
        - \frac{1}{2} \sum_{k,l} r_l y_{kl}^2

under the condition that p'_E drops out, by damped Newton steps while T, m and the width s of a kink fall: psi of a
corner, u_min t + (u_max - u_min) max(t, 0), counts as u_min t + (u_max - u_min) (t + sqrt(t^2 + s^2) - s) / 2. That
is less, and at the maximum sum_v w_v G_v is next to nothing, so hardly any multipliers lift the worst vertex above
sum_v w_v D_v + W m: under the cut, the search ends. Corners whose thrusts are of the size of s cost nothing and are
left out of later stages. Nothing that is proven rests on any of this: any multipliers will do.

D_v is a sum over the modules, each in one of its frames at one of the 8 vertices of the root.

| symbol | meaning | shape |
|---|---|---|
| w_v | share of vertex v in the gradient, e^(-D_v / T) over the sum of all | (8 C,) |
| G_v | gradient of D_v; a row is sqrt(w_v / T) (G_v - sum_v w_v G_v) | (K, 6), (W,) |
"""

from __future__ import annotations

import math
from typing import NamedTuple

from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.frames import Frames
from nlp.bounds.branch.multipliers import LEAST_WEIGHT, Workspace, best_input, copy, imbalance
from nlp.bounds.branch.vertices import MOST_VERTICES, Vertices, fill_frames, value
from nlp.numbers.cholesky import factor, solve_factored
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class VertexSearch(NamedTuple):
    """Settings of the search."""

    stages: int = 6
    """Number of values of T, m and s, each less than the one before."""
    steps: int = 3
    """Largest number of Newton steps per stage."""
    halvings: int = 6
    """Number of shares of a step that are tried: 1, shorter, shorter^2, ..."""
    shorter: float = 0.3
    gain: float = 1e-3
    """Share of the cut that another step should gain in the first stage; it falls with T."""
    longest: float = 2.0
    """Longest step of y, in its own length: where a reserve cannot be produced it grows without end."""
    boundary: float = 0.95
    """Share of the way to sigma = 0 that a step goes."""
    soft: float = 0.05
    """T in the first stage, in the cut."""
    softer: float = 0.6
    """T in the next stage, in that of this one."""
    kink: float = 0.15
    """s in the first stage, in the cut over 4 n u_max."""
    kinked: float = 0.35
    """s and m in the next stage, in those of this one."""
    pressed: float = 2e-3
    """m and sigma in the first stage, in the cut."""
    enough: float = 1.1
    """Share of the cut above which the worst vertex ends a stage."""
    light: float = 1e-3
    """Least w_v that counts in a step, in the greatest."""
    ridge: float = 0.02
    """Ridge of multipliers of force, over n / 24 sum_a rho_a^2: the remainders of the bound grow with them."""
    kinked_ridge: float = 10.0
    """Ridge of corners over the root of sum_a rho_a^2, in `ridge`: their psi has a kink."""
    largest_ridge: float = 100.0
    """Least factor of the ridge of corners."""
    levered: float = 10.0
    """Ridge of multipliers of torque, in that of force: levers are longer than l_arm."""
    least_square: float = 1e-6
    """Least sum_a rho_a^2 in a ridge [rad^2]."""
    small: float = 1.0
    """Largest |a_j . y_k|, in s, of a corner that costs nothing and is left out of later stages."""
    idle: float = 1e-3
    """Largest |a_j . y_k| of a corner that costs nothing, over 2 u_max."""
    cannot: float = 1e-9
    """Share of the walls' multipliers that the condition may miss by rounding."""


SEARCH = VertexSearch()


@njit(cache=True, allocates=False)
def begin(
    problem: BranchProblem,
    roots: Array,
    vertices: Frames,
    rho: Array,
    cut: float,
    first: Array,
    pressed: Array,
    into: Vertices,
) -> None:
    """Fill `into` for a box, with multipliers that the search starts at.

    Args:
        problem: the task and the tree.
        roots: root orientations at the middle and at the 8 vertices, shape (9, 3, 3).
        vertices: frames at the vertices of the hinges.
        rho: half widths [rad].
        cut: in effort units.
        first: multipliers of load cases, shape (K, 6).
        pressed: those of walls, shape (W,).
        into: arrays.
    """
    y, sigma = into.y, into.sigma
    fill_frames(problem, roots, vertices, into)
    square = 0.0
    for a in range(len(rho)):
        square += rho[a] ** 2
    square = max(square, SEARCH.least_square)
    ridge = SEARCH.ridge * len(problem.tree.parent) / 24 * square
    for k in range(len(y)):
        into.on[k] = True
        at = ridge
        if problem.loads.weight[k] == 0.0:
            at *= max(SEARCH.kinked_ridge / math.sqrt(square), SEARCH.largest_ridge)
        for l in range(3):
            into.ridge[k, l], into.ridge[k, 3 + l] = at, SEARCH.levered * at
    copy(first, y)
    for r in range(len(sigma)):
        sigma[r] = max(pressed[r], SEARCH.pressed * cut)
    # The condition holds from the start: steps that a barrier shortens keep it.
    _correct(problem, y, sigma, True)


@njit(cache=True, allocates=False)
def climb(
    problem: BranchProblem, work: Workspace, into: Vertices, cut: float, stage: int, steps: int
) -> tuple[float, float]:
    """Improve `into.y` and `into.sigma`; return the least D, and the most that it can become, if known.

    Args:
        problem: the task and the tree.
        work: with the wrenches of the box's middle.
        into: arrays for the box.
        cut: in effort units.
        stage: one after the other, from 0.
        steps: largest number of Newton steps.
    """
    y, sigma, scale = into.y, into.sigma, SEARCH.kinked**stage
    T, m = SEARCH.soft * SEARCH.softer**stage * cut, SEARCH.pressed * scale * cut
    s = SEARCH.kink * scale * cut / (4 * len(problem.tree.parent) * problem.u_max)
    best, least, middle = value(problem, into, y, sigma, T, m, s)
    most, settled = math.inf, False
    for _ in range(steps):
        _newton(problem, work, into, T, m, s)
        share, better = _longest_share(into), False
        for r in range(len(sigma)):
            if into.wall_step[r] < 0.0:
                share = min(share, -SEARCH.boundary * sigma[r] / into.wall_step[r])
        reached, worst, ahead = best, least, middle
        for _ in range(SEARCH.halvings):
            for k in range(len(y)):
                for l in range(6):
                    into.ahead[k, l] = y[k, l] + share * into.step[k, l]
            for r in range(len(sigma)):
                into.wall_ahead[r] = sigma[r] + share * into.wall_step[r]
            reached, worst, ahead = value(problem, into, into.ahead, into.wall_ahead, T, m, s)
            better = reached > best
            if better:
                break
            share *= SEARCH.shorter
        if not better:
            settled = True
            break
        copy(into.ahead, y)
        for r in range(len(sigma)):
            sigma[r] = into.wall_ahead[r]
        gain, best, least, middle = reached - best, reached, worst, ahead
        if gain < SEARCH.gain * SEARCH.softer**stage * cut:
            most, settled = middle + gain + len(sigma) * m if share == 1.0 else math.inf, True
            break
        if least > SEARCH.enough * cut:
            break
    if settled:
        _shrink(problem, work, into, SEARCH.small * s)
    return least, most


@njit(cache=True, allocates=False)
def _longest_share(into: Vertices) -> float:
    size, length = 0.0, 0.0
    for k in range(len(into.y)):
        for l in range(6):
            size, length = size + into.y[k, l] ** 2, length + into.step[k, l] ** 2
    return min(1.0, SEARCH.longest * math.sqrt(size / length)) if size * length > 0.0 else 1.0


@njit(cache=True, allocates=False)
def _shrink(problem: BranchProblem, work: Workspace, into: Vertices, small: float) -> None:
    """Leave corners out that cost next to nothing."""
    left_out = False
    for k in range(len(into.y)):
        if into.on[k] and problem.loads.weight[k] == 0.0 and _greatest(work, into.y[k]) < small:
            into.on[k], left_out = False, True
            for l in range(6):
                into.y[k, l], into.step[k, l] = 0.0, 0.0
    if left_out:
        _correct(problem, into.y, into.sigma, False)


@njit(cache=True, allocates=False)
def _greatest(work: Workspace, y: Array) -> float:
    """Return the greatest |a_j . y| at the middle."""
    greatest = 0.0
    for j in range(len(work.a)):
        t = 0.0
        for l in range(6):
            t += work.a[j, l] * y[l]
        greatest = max(greatest, abs(t))
    return greatest


@njit(cache=True, allocates=False)
def _choose(into: Vertices) -> int:
    """Fill the vertices that count in a step and, in `q`, their shares; return how many there are."""
    most, chosen, count = 0.0, 0.0, 0
    while count < MOST_VERTICES:
        greatest = 0
        for vertex in range(len(into.share)):
            if into.share[vertex] > into.share[greatest]:
                greatest = vertex
        most = max(most, into.share[greatest])
        if into.share[greatest] <= SEARCH.light * most:
            break
        into.order[count], into.q[count] = greatest, into.share[greatest]
        chosen, count = chosen + into.share[greatest], count + 1
        into.share[greatest] = 0.0
    for place in range(count):
        into.q[place] /= chosen
    return count


@njit(cache=True, allocates=False)
def _newton(problem: BranchProblem, work: Workspace, into: Vertices, T: float, m: float, s: float) -> None:
    """Fill the step from y and sigma, of which `value` has filled D, to the maximum of a quadratic model of F."""
    walls, y, sigma, K, C = problem.walls, into.y, into.sigma, len(into.y), len(into.frame)
    n, W, V = len(problem.tree.parent), len(sigma), _choose(into)
    rows, wall_rows, mean, wall_mean = into.rows, into.wall_rows, into.mean, into.wall_mean
    into.of_frame[:] = 0.0
    for vertex in range(V):
        root, c = into.order[vertex] // C, into.order[vertex] % C
        for i in range(n):
            into.of_frame[root, into.frame[c, i]] += into.q[vertex]
    into.H[:] = 0.0
    for root in range(8):
        for v in range(len(into.module)):
            if into.of_frame[root, v] > 0.0:
                _add_frame(problem, root, v, into, s)
    mean[:] = 0.0
    wall_mean[:] = 0.0
    for vertex in range(V):
        row, root, c, share = 3 + vertex, into.order[vertex] // C, into.order[vertex] % C, into.q[vertex]
        for k in range(K):
            if into.on[k]:
                for l in range(6):
                    total = 0.0
                    for i in range(n):
                        total += into.part[root, into.frame[c, i], k, l]
                    rows[row, k, l] = total
                    mean[k, l] += share * total
        for r in range(W):
            total = 0.0
            for i in range(n):
                total += into.wall[root, into.frame[c, i], r]
            wall_rows[row, r] = total
            wall_mean[r] += share * total
    for vertex in range(V):
        scale = math.sqrt(into.q[vertex] / T)
        for k in range(K):
            for l in range(6):
                rows[3 + vertex, k, l] = scale * (rows[3 + vertex, k, l] - mean[k, l])
        for r in range(W):
            wall_rows[3 + vertex, r] = scale * (wall_rows[3 + vertex, r] - wall_mean[r])
    for k in range(K):
        for row in range(3):
            for l in range(6):
                rows[row, k, l] = work.rows[k, row, l]
        for l in range(3):
            mean[k, l] += problem.loads.f[k, l] - into.ridge[k, l] * y[k, l]
            mean[k, 3 + l] += problem.loads.t[k, l] - into.ridge[k, 3 + l] * y[k, 3 + l]
    for r in range(W):
        for row in range(3):
            wall_rows[row, r] = -walls.normal[r, row]
        wall_mean[r] += walls.beyond[r] + m / sigma[r]
    _solve(3 + V, m, into)


@njit(cache=True, allocates=False)
def _add_frame(problem: BranchProblem, root: int, v: int, into: Vertices, s: float) -> None:
    """Fill what a module in one of its frames adds to a gradient, and add its share to minus the Hessian."""
    u_min, u_max, dead = problem.u_min, problem.u_max, problem.loads.dead
    share, (cx, cy, cz) = into.of_frame[root, v], into.moment[root, v]
    for k in range(len(into.y)):
        if not into.on[k]:
            continue
        weight, part, H = problem.loads.weight[k], into.part[root, v, k], into.H[k]
        for l in range(6):
            part[l] = 0.0
        for q in range(4):
            a, t = into.a[root, v, q], into.t[root, v, k, q]
            if dead[k] == 4 * into.module[v] + q:
                continue
            if weight == 0.0:
                length, half = math.sqrt(t * t + s * s), (u_max - u_min) / 2
                u, stiff = u_min + half * (1 + t / length), half * s * s / length**3
            else:
                counted = max(weight, LEAST_WEIGHT)
                u = best_input(t, counted, u_min, u_max)
                stiff = 1 / (2 * counted) if u_min < u < u_max else 0.0
            for l in range(6):
                part[l] -= u * a[l]
            if stiff > 0.0:
                for l in range(6):
                    for column in range(l + 1):
                        H[l, column] += share * stiff * a[l] * a[column]
        hx, hy, hz = problem.loads.h[k]
        part[3] += cy * hz - cz * hy
        part[4] += cz * hx - cx * hz
        part[5] += cx * hy - cy * hx


@njit(cache=True, allocates=False)
def _solve(tied: int, m: float, into: Vertices) -> None:
    """Fill the step: the first three rows, the condition, are met, the others take half their square."""
    y, sigma, step, wall_step = into.y, into.sigma, into.step, into.wall_step
    H, rows, wall_rows, solved, S, q = into.H, into.rows, into.wall_rows, into.solved, into.S, into.q
    for row in range(tied):
        q[row] = 0.0
        for column in range(row + 1):
            S[row, column] = 0.0
    for k in range(len(y)):
        if not into.on[k]:
            continue
        for l in range(6):
            H[k, l, l] += into.ridge[k, l]
            step[k, l] = into.mean[k, l]
        factor(H[k], 6)
        solve_factored(H[k], step[k], 6)
        for row in range(tied):
            for l in range(6):
                solved[row, k, l] = rows[row, k, l]
                q[row] += rows[row, k, l] * (step[k, l] + (y[k, l] if row < 3 else 0.0))
            solve_factored(H[k], solved[row, k], 6)
            for column in range(row + 1):
                total = 0.0
                for l in range(6):
                    total += rows[row, k, l] * solved[column, k, l]
                S[row, column] += total
    for r in range(len(sigma)):
        soft = sigma[r] ** 2 / m
        wall_step[r] = into.wall_mean[r] * soft
        for row in range(tied):
            q[row] += wall_rows[row, r] * (wall_step[r] + (sigma[r] if row < 3 else 0.0))
            for column in range(row + 1):
                S[row, column] += wall_rows[row, r] * wall_rows[column, r] * soft
    size = S[0, 0] + S[1, 1] + S[2, 2]
    for row in range(tied):  # without g there is no condition
        S[row, row] += 1.0 if row > 2 or size == 0.0 else 1e-9 * size
    factor(S, tied)
    solve_factored(S, q, tied)
    for k in range(len(y)):
        if into.on[k]:
            for l in range(6):
                for row in range(tied):
                    step[k, l] -= q[row] * solved[row, k, l]
    for r in range(len(sigma)):
        for row in range(tied):
            wall_step[r] -= q[row] * wall_rows[row, r] * sigma[r] ** 2 / m


@njit(cache=True, allocates=False)
def evenness(into: Vertices, axis: int) -> float:
    """Return how evenly the shares are spread over the two ends of an angle, 1/4 at most.

    Where multipliers cannot tell the ends apart, thrusts at both stand for one design: halves forbid that.
    """
    C, upper, total = len(into.frame), 0.0, 0.0
    for vertex in range(8 * C):
        bit = vertex // C >> (2 - axis) if axis < 3 else vertex % C >> (axis - 3)
        total += into.share[vertex]
        if bit & 1:
            upper += into.share[vertex]
    return upper / total * (1 - upper / total)


@njit(cache=True, allocates=False)
def meet(problem: BranchProblem, y: Array, sigma: Array) -> None:
    """Meet the condition by the least change of torques' multipliers that are not zero, or else without walls."""
    _correct(problem, y, sigma, False)
    a, b, c = imbalance(problem, y, sigma)
    size = 0.0
    for r in range(len(sigma)):
        size += sigma[r]
    if not math.sqrt(a * a + b * b + c * c) <= SEARCH.cannot * size:
        for r in range(len(sigma)):
            sigma[r] = 0.0
        _correct(problem, y, sigma, False)


@njit(cache=True, allocates=False)
def _correct(problem: BranchProblem, y: Array, sigma: Array, every: bool) -> None:
    """Change mu_k by q x g_k, with (sum_k [g_k]x [g_k]x^T) q what the condition misses."""
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(y)):
        if every or _any(y[k]):
            gx, gy, gz = problem.loads.g[k]
            xx, yy, zz = xx + gy * gy + gz * gz, yy + gz * gz + gx * gx, zz + gx * gx + gy * gy
            xy, xz, yz = xy - gx * gy, xz - gx * gz, yz - gy * gz
    size = xx + yy + zz
    if size == 0.0:
        return
    more = 1e-9 * size  # parallel g leave a direction open
    a = math.sqrt(xx + more)
    b, c = xy / a, xz / a
    d = math.sqrt(yy + more - b * b)
    e = (yz - b * c) / d
    f = math.sqrt(zz + more - c * c - e * e)
    for _ in range(3):
        qx, qy, qz = imbalance(problem, y, sigma)
        qx = qx / a
        qy = (qy - b * qx) / d
        qz = (qz - c * qx - e * qy) / f
        qz = qz / f
        qy = (qy - e * qz) / d
        qx = (qx - b * qy - c * qz) / a
        for k in range(len(y)):  # mu_k -= [g_k]x^T q = q x g_k
            if every or _any(y[k]):
                gx, gy, gz = problem.loads.g[k]
                y[k, 3] -= qy * gz - qz * gy
                y[k, 4] -= qz * gx - qx * gz
                y[k, 5] -= qx * gy - qy * gx


@njit(cache=True, allocates=False)
def _any(y: Array) -> bool:
    some: bool = False
    for l in range(6):
        some |= y[l] != 0.0
    return some


@njit(cache=True, allocates=False)
def finish(problem: BranchProblem, work: Workspace, y: Array, sigma: Array) -> None:
    """Meet the condition, without multipliers of corners that cost nothing: each loses something to rounding."""
    for k in range(len(y)):
        if problem.loads.weight[k] == 0.0 and _greatest(work, y[k]) < SEARCH.idle * 2 * problem.u_max:
            for l in range(6):
                y[k, l] = 0.0
    meet(problem, y, sigma)

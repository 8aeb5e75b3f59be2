r"""Multipliers for a box: the bound holds with any, and the better they are, the higher it is.

Newton's method, restricted to multipliers with which p'_E cancels, maximizes the least dual function D over some
points of the box, smoothed with a temperature T,

.. math:: -T \log \sum_v e^{-D_v(y, \sigma) / T}

less small multiples of the squared multipliers. At a single point, the middle, T has no effect. Over the box t =
a_j . y changes by beta_aj . y times the change of angle a, and the bound loses a quarter to a half of the square of
that over lambda, in addition to the decrease of D towards a vertex by its slopes g_a. So at the middle, with the
half widths rho,

.. math:: \sum_a \rho_a \left(\sqrt{g_a^2 + m^2} - m\right)
    + \frac{1}{2} \sum_{k} \frac{1}{\lambda_k} \sum_{a, j} \rho_a^2 (\beta_{aj} \cdot y_k)^2

is subtracted as well. In a step the root is replaced by the parabola above it that touches it at g_a. The middle is
enough for most boxes. For the others the points are all vertices: if a reserve is out of reach, D at the middle
grows without limit with the multipliers, and falls all the more steeply towards the vertices.

psi of a load case without weight, u_min t + (1 - u_min) max(t, 0), has a kink, which Newton's method cannot handle.
Here max(t, 0) is smoothed to (t + root(t^2 + s^2) - s) / 2, for any weight under the kink width s. At the vertices
T and s decrease from stage to stage. Load cases that cost nothing are idle: `drop_idle_cases` sets their
multipliers to zero.
"""

import math
from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, Indices
from verify.proof.dual import residual
from verify.proof.platform import ROTORS, CheckProblem
from verify.proof.points import MAX_POINTS, Points, fill_condition_inverse


class Ascent(NamedTuple):
    """Settings of the search."""

    max_kink_width: float = 1e-2
    """Largest s at the middle."""
    kink_width_per_rho: float = 0.1
    """Largest s at the middle, over the root of sum_a rho_a^2 [1/rad]."""
    idle_limit: float = 6.0
    """Largest |a_j . y_k| of an idle load case, over s."""
    condition_tolerance: float = 1e-9
    """Largest residual of the condition that counts as rounding, over the sum of sigma."""
    max_wall_updates: int = 3
    """Largest number of updates of the active walls in a step."""
    max_step: float = 3.0
    """Longest step, over the length of the multipliers."""
    min_step_size: float = 1e-3
    """Step size under which a line search ends, over that of its first trial."""
    backtracking: float = 0.3
    """Ratio of step sizes in a line search."""
    min_gain: float = 1e-4
    """Least gain of a Newton step, over the maximized value."""
    vertex_target: float = 1.1
    """D at which the search at vertices ends, over the cut."""
    min_reach: float = 0.98
    """Limit on D, over the cut, under which the search at vertices is given up; under 1, as smoothing raises D."""
    stage_target: float = 2.0
    """D at which a stage ends, over the cut; well above 1, as smoothing raises D."""
    slope_smoothing: float = 0.01
    """m over the cut."""
    stages: int = 8
    steps: int = 6
    """Newton steps per stage."""
    initial_temperature: float = 0.05
    """T in the first stage, over the cut."""
    temperature_decay: float = 0.6
    """Ratio of T between stages."""
    initial_kink_width: float = 0.15
    """s in the first stage, over the cut / (r n)."""
    kink_decay: float = 0.35
    """Ratio of s and of the ridges between stages."""
    exact_kink_width: float = 1e-9
    """s that leaves D as good as unchanged."""
    min_share: float = 1e-3
    """Least share of a point that enters a step."""
    middle_ridge: float = 1e-3
    """Ridge of y at the middle of a box that is not narrow; it stands for the bound's loss to remainders."""
    narrow_square: float = 1e-4
    """Largest sum_a rho_a^2 of a narrow box, whose ridge and least gain are less in proportion [rad^2]."""
    min_narrow_factor: float = 1e-4
    """Least factor on the ridge and least gain of a narrow box."""
    initial_y_ridge: float = 1.0
    """Ridge of y in the first stage: it keeps multipliers short if the best ones are unbounded."""
    initial_sigma_ridge: float = 20.0
    """Ridge of sigma in the first stage."""
    cone_ridge: float = 1e-6
    """Factor on both if no load case counts: then only the direction of the multipliers matters, and they grow."""
    min_curvature: float = 1e-3
    """Largest curvature of a rotor's psi that a step neglects, over the ridge of y."""


ASCENT = Ascent()


@njit(cache=True)
def start(problem: CheckProblem, points: Points, rho: Array, cut: float) -> None:
    """Activate all load cases, and set ridges and kink width for a box of half widths rho."""
    rho_square = (rho * rho).sum()
    narrow_factor = min(1.0, max(ASCENT.min_narrow_factor, rho_square / ASCENT.narrow_square))
    lever = 2 * problem.l_c * problem.depth.max() + 1
    points.ridge[0] = ASCENT.middle_ridge * narrow_factor
    points.ridge[1] = max(rho_square, 1e-4) * lever * lever / cut
    points.slope_smoothing[0], points.min_gain[0] = ASCENT.slope_smoothing * cut, ASCENT.min_gain * narrow_factor
    s = min(ASCENT.max_kink_width, ASCENT.kink_width_per_rho * math.sqrt(rho_square))
    set_kink_width(problem, points, max(ASCENT.exact_kink_width, s))
    if not np.all(points.active):
        points.active[:] = True
        fill_condition_inverse(points)


@njit(cache=True)
def set_kink_width(problem: CheckProblem, points: Points, s: float) -> None:
    """Set the kink width."""
    points.weight[:] = np.maximum(problem.weight, s)


@njit(cache=True, inner=True)
def drop_idle_cases(problem: CheckProblem, points: Points, y: Array, sigma: Array) -> bool:
    """Drop idle load cases; return whether there are any."""
    any_dropped = False
    for k in range(len(y)):
        if problem.weight[k] == 0.0 and points.active[k]:
            largest_product = 0.0
            for v in range(len(points.a)):
                largest_product = max(largest_product, np.abs(points.a[v] @ y[k]).max())
            if largest_product <= ASCENT.idle_limit * points.weight[k]:
                y[k], points.active[k], any_dropped = 0.0, False, True
    if any_dropped:
        fill_condition_inverse(points)
        enforce_condition(problem, points, y, sigma)
    return any_dropped


@njit(cache=True)
def enforce_condition(problem: CheckProblem, points: Points, y: Array, sigma: Array) -> None:
    """Change the torque multipliers so that p'_E cancels; if that fails, set sigma to zero and repeat."""
    for _ in range(2):
        x, y_, z = residual(problem, y, sigma)
        q = points.condition_inverse @ np.array([x, y_, z])
        for k in range(len(y)):
            if points.active[k]:
                y[k, 3:] -= np.cross(q, problem.g[k])
        x, y_, z = residual(problem, y, sigma)
        if math.sqrt(x * x + y_ * y_ + z * z) <= ASCENT.condition_tolerance * sigma.sum():
            break
        sigma[:] = 0.0


@njit(cache=True, inner=True)
def maximize_at_vertices(problem: CheckProblem, points: Points, y: Array, sigma: Array, cut: float) -> None:
    """Improve y and sigma in place, for the greatest D at the worst point."""
    T, s = ASCENT.initial_temperature * cut, ASCENT.initial_kink_width * cut / points.a.shape[1]
    factor = 1.0 if problem.weight.max() > 0.0 else ASCENT.cone_ridge
    points.ridge[0], points.ridge[1] = factor * ASCENT.initial_y_ridge, factor * ASCENT.initial_sigma_ridge
    points.min_gain[0] = ASCENT.min_gain
    stage_target = ASCENT.stage_target * cut
    for _ in range(ASCENT.stages):
        set_kink_width(problem, points, s)
        maximize(problem, points, y, sigma, T, stage_target, stage_target, ASCENT.steps)
        ridge_loss = (points.ridge[0] * (y * y).sum() + points.ridge[1] * (sigma * sigma).sum()) / 2
        if points.D.min() + T * math.log(len(points.D)) + ridge_loss < ASCENT.min_reach * cut:
            break
        set_kink_width(problem, points, ASCENT.exact_kink_width)
        smoothed_value(problem, points, y, sigma, T)
        if points.D.min() > ASCENT.vertex_target * cut:
            break
        T, s = ASCENT.temperature_decay * T, ASCENT.kink_decay * s
        points.ridge[:] *= ASCENT.kink_decay
    if factor == 1.0:
        set_kink_width(problem, points, s)
        drop_idle_cases(problem, points, y, sigma)


@njit(cache=True, literals=False)
def maximize(
    problem: CheckProblem, points: Points, y: Array, sigma: Array, T: float, target: float, limit: float, steps: int
) -> float:
    """Improve y and sigma, which satisfy the condition, in place; return the maximized value.

    Args:
        problem: task and tree.
        points: points of a box.
        y: multipliers of the load cases, shape (K, 6).
        sigma: multipliers of the walls, shape (W,).
        T: temperature.
        target: value at which the search ends.
        limit: value beyond which a trial step is shortened further.
        steps: largest number of Newton steps.
    """
    best = smoothed_value(problem, points, y, sigma, T)
    for _ in range(steps):
        if best > target:
            break
        _fill_newton_step(problem, points, y, sigma, T)
        length = math.sqrt((y * y).sum() + (sigma * sigma).sum())
        step_length = math.sqrt((points.step * points.step).sum() + (points.wall_step * points.wall_step).sum())
        step_size = min(1.0, ASCENT.max_step * length / step_length) if step_length > 0.0 and length > 0.0 else 1.0
        min_step_size, trial_value = ASCENT.min_step_size * step_size, -math.inf
        while step_size > min_step_size:
            trial_y = y + step_size * points.step
            trial_sigma = np.maximum(sigma + step_size * points.wall_step, 0.0)
            trial_value = smoothed_value(problem, points, trial_y, trial_sigma, T)
            if best < trial_value < limit:
                break
            step_size *= ASCENT.backtracking
        if not trial_value > best:
            break
        y[:], sigma[:] = trial_y, trial_sigma
        gain, best = trial_value - best, trial_value
        if gain < points.min_gain[0] * abs(best):
            break
    enforce_condition(problem, points, y, sigma)
    return best


@njit(cache=True, allocates=False)
def smoothed_value(problem: CheckProblem, points: Points, y: Array, sigma: Array, T: float) -> float:
    """Return the maximized value, and fill D and its slopes."""
    penalty, minimum, u_min, m = 0.0, math.inf, problem.u_min, points.slope_smoothing[0]
    for k in range(len(y)):
        if not points.active[k]:
            continue
        for l in range(6):
            for column in range(6):
                penalty += y[k, l] * points.curvature[l, column] * y[k, column] / (2 * points.weight[k])
            penalty += points.ridge[0] / 2 * y[k, l] * y[k, l]
    for r in range(len(sigma)):
        penalty += points.ridge[1] / 2 * sigma[r] * sigma[r]
    for v in range(len(points.D)):
        total = 0.0
        for r in range(len(sigma)):
            total += sigma[r] * points.wall[v, r]
        for k in range(len(y)):
            if not points.active[k]:
                continue
            weight, is_smoothed = points.weight[k], problem.weight[k] < points.weight[k]
            b, (y0, y1, y2, y3, y4, y5) = points.b[v, k], y[k]
            total += b[0] * y0 + b[1] * y1 + b[2] * y2 + b[3] * y3 + b[4] * y4 + b[5] * y5
            for j in range(points.a.shape[1]):
                a = points.a[v, j]
                t = a[0] * y0 + a[1] * y1 + a[2] * y2 + a[3] * y3 + a[4] * y4 + a[5] * y5
                if j == problem.dead_rotor[k]:
                    continue
                if is_smoothed:
                    total -= u_min * t + (1 - u_min) / 2 * (t + math.sqrt(t * t + weight * weight) - weight)
                else:
                    u = min(max(t / (2 * weight), u_min), 1.0)
                    total -= u * (t - weight * u)
        points.D[v] = total
        minimum = min(minimum, total)
    if len(points.slopes.rho) > 0:
        _evaluate_slopes(problem, points, y, sigma)
        for angle in range(len(points.slopes.rho)):
            penalty += points.slopes.rho[angle] * (math.hypot(points.slopes.g[angle], m) - m)
    share_sum = 0.0
    for v in range(len(points.D)):
        share_sum += math.exp((minimum - points.D[v]) / T)
    return minimum - T * math.log(share_sum) - penalty


@njit(cache=True, inner=True, allocates=False)
def _evaluate_slopes(problem: CheckProblem, points: Points, y: Array, sigma: Array) -> None:
    """Fill the slopes g of D, and their derivatives by y."""
    slopes = points.slopes
    g = slopes.g
    for angle in range(len(g)):
        g[angle] = 0.0
        for r in range(len(sigma)):
            g[angle] += slopes.wall_slope[angle, r] * sigma[r]
    for k in range(len(y)):
        if not points.active[k]:
            continue
        (hx, hy, hz), (y0, y1, y2, y3, y4, y5) = problem.h[k], y[k]
        weight, is_smoothed = points.weight[k], problem.weight[k] < points.weight[k]
        for angle in range(len(g)):
            (x, y_, z), dg_dy = slopes.v[angle], slopes.dg_dy[angle, k]
            dg_dy[0], dg_dy[1], dg_dy[2] = 0.0, 0.0, 0.0
            dg_dy[3], dg_dy[4], dg_dy[5] = y_ * hz - z * hy, z * hx - x * hz, x * hy - y_ * hx
            g[angle] += dg_dy[3] * y3 + dg_dy[4] * y4 + dg_dy[5] * y5
        for j in range(points.a.shape[1]):
            a = points.a[0, j]
            t = a[0] * y0 + a[1] * y1 + a[2] * y2 + a[3] * y3 + a[4] * y4 + a[5] * y5
            u, curvature = _psi_derivatives(t, weight, is_smoothed, problem.u_min)
            if u <= 0.0 or j == problem.dead_rotor[k]:
                continue
            for angle in range(len(g)):
                if not slopes.is_turned[angle, j // ROTORS]:
                    continue
                c, dg_dy = slopes.beta[angle, j], slopes.dg_dy[angle, k]
                slope = c[0] * y0 + c[1] * y1 + c[2] * y2 + c[3] * y3 + c[4] * y4 + c[5] * y5
                g[angle] -= u * slope
                for l in range(6):
                    dg_dy[l] -= u * c[l] + curvature * slope * a[l]


@njit(cache=True, inner=True, allocates=False)
def _psi_derivatives(t: float, weight: float, is_smoothed: bool, u_min: float) -> tuple[float, float]:
    """Return the first and second derivatives of psi, smoothed or not."""
    if is_smoothed:
        length, half = math.sqrt(t * t + weight * weight), (1 - u_min) / 2
        return u_min + half * (1 + t / length), half * weight * weight / (length * length * length)
    u = t / (2 * weight)
    if u <= u_min:
        return u_min, 0.0
    return (u, 1 / (2 * weight)) if u < 1.0 else (1.0, 0.0)


@njit(cache=True, inner=True)
def _fill_newton_step(problem: CheckProblem, points: Points, y: Array, sigma: Array, T: float) -> None:
    """Fill the step to the maximum of the quadratic model with p'_E cancelled, after `smoothed_value`.

    A point with share w subtracts half the square of root(w / T) (its gradient - the mean gradient) . step from the
    model, an angle half of (g_a + dg_a/dy . step)^2 rho_a / root(g_a^2 + m^2). Each is a row.
    """
    K, A, share = len(y), len(points.slopes.rho), np.exp((points.D.min() - points.D) / T)
    order = np.argsort(-share)[:MAX_POINTS]
    order = order[share[order] > ASCENT.min_share * share.sum()]
    share = share[order] / share[order].sum()
    point_rows = len(order) if len(order) > 1 else 0
    row_count = 3 + point_rows + A
    S, q = np.zeros((row_count, row_count)), np.zeros(row_count)
    q[0], q[1], q[2] = residual(problem, y, sigma)
    wall_gradient = share @ points.wall[order]
    for row in range(3, 3 + point_rows):
        S[row, row] = 1.0
        points.wall_rows[row] = math.sqrt(share[row - 3] / T) * (points.wall[order[row - 3]] - wall_gradient)
    for angle in range(A):
        row, g = 3 + point_rows + angle, points.slopes.g[angle]
        S[row, row], q[row] = math.hypot(g, points.slope_smoothing[0]) / max(points.slopes.rho[angle], 1e-12), g
        points.wall_rows[row] = points.slopes.wall_slope[angle]
    H, gradient, mean = np.empty((6, 6)), np.empty((len(order), 6)), np.empty(6)
    for k in range(K):
        if points.active[k]:
            _fill_model(problem, points, y, k, order, share, math.sqrt(1 / T), H, gradient, mean)
            _solve_model(H, mean, points.rows[k], points.solved[k], row_count, S, q)
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    for row in range(3):
        S[row, row] += 1e-9 * trace if trace > 0.0 else 1.0
    q_solved = _solve_rows(points, sigma, wall_gradient, S, q)
    for k in range(K):
        for l in range(6):
            points.step[k, l] = 0.0
            if points.active[k]:
                points.step[k, l] = points.solved[k, l, 0]
                for row in range(row_count):
                    points.step[k, l] -= points.solved[k, l, 1 + row] * q_solved[row]


@njit(cache=True, inner=True, allocates=False)
def _fill_model(
    problem: CheckProblem,
    points: Points,
    y: Array,
    k: int,
    order: Indices,
    share: Array,
    inverse_root_T: float,
    H: Array,
    gradient: Array,
    mean: Array,
) -> None:
    """Fill the Hessian, the mean gradient and the rows of a load case."""
    weight, is_smoothed, rows = points.weight[k], problem.weight[k] < points.weight[k], points.rows[k]
    point_rows = len(order) if len(order) > 1 else 0
    for l in range(6):
        mean[l] = -points.ridge[0] * y[k, l]
        for m in range(6):
            H[l, m] = points.curvature[l, m] / weight
            mean[l] -= H[l, m] * y[k, m]
        H[l, l] += points.ridge[0]
    y0, y1, y2, y3, y4, y5 = y[k]
    for point in range(len(order)):
        v, g = order[point], gradient[point]
        for l in range(6):
            g[l] = points.b[v, k, l]
        for j in range(points.a.shape[1]):
            a = points.a[v, j]
            t = a[0] * y0 + a[1] * y1 + a[2] * y2 + a[3] * y3 + a[4] * y4 + a[5] * y5
            if j == problem.dead_rotor[k]:
                continue
            u, curvature = _psi_derivatives(t, weight, is_smoothed, problem.u_min)
            curvature *= share[point]
            if u > 0.0:
                for l in range(6):
                    g[l] -= u * a[l]
            if curvature > ASCENT.min_curvature * points.ridge[0]:
                for l in range(6):
                    for m in range(l + 1):
                        H[l, m] += curvature * a[l] * a[m]
        if point_rows == 0:
            for l in range(6):
                mean[l] += g[l]
    for l in range(6):
        if point_rows > 0:
            average = 0.0
            for point in range(point_rows):
                average += share[point] * gradient[point, l]
            mean[l] += average
            for point in range(point_rows):
                rows[3 + point, l] = math.sqrt(share[point]) * inverse_root_T * (gradient[point, l] - average)
        for angle in range(len(points.slopes.rho)):
            rows[3 + point_rows + angle, l] = points.slopes.dg_dy[angle, k, l]


@njit(cache=True, inner=True, allocates=False)
def _solve_model(H: Array, mean: Array, rows: Array, solved: Array, row_count: int, S: Array, q: Array) -> None:
    """Fill H^-1 times the gradient and the rows, by Cholesky, and add the rows times these to S and q."""
    for l in range(6):
        for m in range(l + 1):
            total = H[l, m]
            for i in range(m):
                total -= H[l, i] * H[m, i]
            H[l, m] = math.sqrt(total) if l == m else total / H[m, m]
    for l in range(6):
        solved[l, 0] = mean[l]
        for row in range(row_count):
            solved[l, 1 + row] = rows[row, l]
        for i in range(l):
            for column in range(1 + row_count):
                solved[l, column] -= H[l, i] * solved[i, column]
        for column in range(1 + row_count):
            solved[l, column] /= H[l, l]
    for l in range(5, -1, -1):
        for i in range(l + 1, 6):
            for column in range(1 + row_count):
                solved[l, column] -= H[i, l] * solved[i, column]
        for column in range(1 + row_count):
            solved[l, column] /= H[l, l]
    for row in range(row_count):
        for l in range(6):
            q[row] += rows[row, l] * solved[l, 0]
            for column in range(row_count):
                S[row, column] += rows[row, l] * solved[l, 1 + column]


@njit(cache=True, inner=True)
def _solve_rows(points: Points, sigma: Array, wall_gradient: Array, S: Array, q: Array) -> Array:
    """Return the multipliers of the rows, and fill the step of sigma, which keeps it nonnegative."""
    ridge, rows = points.ridge[1], points.wall_rows[: len(q)]
    is_positive = sigma > 0.0
    x = q
    for _ in range(ASCENT.max_wall_updates):
        M, rhs = S.copy(), q.copy()
        for r in range(len(sigma)):
            rhs += rows[:, r] * ((wall_gradient[r] / ridge if is_positive[r] else 0.0) - sigma[r])
            if is_positive[r]:
                M[:] += np.outer(rows[:, r], rows[:, r]) / ridge
        x = np.asarray(np.linalg.solve(M, rhs), np.float64)
        previous = is_positive.copy()
        for r in range(len(sigma)):
            trial_sigma = (wall_gradient[r] - (rows[:, r] * x).sum()) / ridge
            is_positive[r] = trial_sigma > 0.0
            points.wall_step[r] = max(trial_sigma, 0.0) - sigma[r]
        if np.all(previous == is_positive):
            break
    return x

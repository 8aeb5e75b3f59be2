r"""The reduced problem at a point, and descent on its augmented Lagrangian M.

.. math::

    V(x) = \sum_k \phi_k(x), \qquad
    M(x) = V(x) + \frac{1}{2 \sigma} \sum_r \max(0, \lambda_r + \sigma (m_r - g_r(x)))^2 - \lambda_r^2

| symbol | meaning | shape |
|---|---|---|
| x | unknowns | (N,) |
| V, dV | effort plus the priced residuals of the wrenches; its gradient | (N,) |
| g, J | clearances and their Jacobian; it is zero for rows that are not near | (m,), (m, N) |
| m_r, lambda_r, sigma | smallest allowed clearance of row r, its multiplier, the penalty parameter | |

A step d minimises a model of M, piecewise quadratic in d:

.. math::

    q(d) = dV \cdot d + \tfrac12 d^T B d
         + \frac{1}{2 \sigma} \sum_r \max(0, \lambda_r + \sigma (m_r - g_r - J_r d))^2,
    \qquad l \le d \le h

| symbol | meaning | shape |
|---|---|---|
| B | quasi-Newton Hessian of the Lagrangian V - sum of lambda g, by damped BFGS updates | (N, N) |
| l, h | bounds on the step, from the bounds on the unknowns and the trust region | (N,) each |

The penalty's curvature, sigma J^T J, is explicit in the model: BFGS would have to relearn it for every row that
becomes active or inactive.
"""

from typing import NamedTuple

import numpy as np

from nlp.numbers.cholesky import solve_in_place
from nlp.numbers.kinematics import dot, row
from nlp.reduced.arrays import ReducedProblem
from nlp.reduced.clearance import clearances
from nlp.reduced.inputs import effort
from nlp.reduced.platform import ReducedPlatform, add_reaction, platform
from nlp.reduced.speeds import add_speed_rows
from topo_search.compiled_code import njit
from topo_search.model import Array, Flags, Indices


class StepSettings(NamedTuple):
    """Settings of the steps of a descent."""

    near: float = 4.0
    """Clearance below which a row has a gradient [l_arm]: no step closes a larger gap."""
    largest_turn: float = 0.7
    """Largest change of an angle in a step [rad]."""
    largest_move: float = 4.0
    """Largest shift of the end-effector along an axis in a step [l_arm]."""
    newton_steps: int = 30
    """Largest number of Newton steps on a model."""
    armijo: float = 1e-4
    """Smallest decrease of M in a step, as a share of the model's prediction."""
    halvings: int = 12
    """Largest number of halvings of a step."""
    min_curvature: float = 0.1
    """Smallest initial curvature of the Lagrangian."""
    curvature: float = 0.2
    """Smallest curvature along a step in an update, as a share of the model's (Powell's damping)."""


DESCENT = StepSettings()


class Evaluation(NamedTuple):
    """The reduced problem at a point."""

    x: Array
    V: float
    dV: Array
    g: Array
    J: Array
    is_near: Flags
    """Rows that have a gradient, shape (m,)."""
    mu: Array
    """Dual unknowns of the load cases, shape (K, 6): the warm start of the next point."""
    u: Array
    """Inputs of the load cases, shape (K, 4n)."""
    active: Flags
    """The active load cases, shape (K,)."""


class DescentPhase(NamedTuple):
    """Prices and limits of one phase of the descents."""

    rho: float
    """Price of the wrenches' squared residuals."""
    sigma: float
    """Price of missing clearance."""
    rounds: int
    """Number of rounds; the multipliers are updated between them."""
    steps: int
    """Largest number of steps per round."""
    tolerance: float
    """Decrease of the merit M in a step, relative to 1 + M, at which a round ends."""


class StepModel(NamedTuple):
    """The model q of a step."""

    dV: Array
    J: Array
    B: Array
    sigma: float
    s: Array
    """lambda_r + sigma (m_r - g_r) of each relevant row."""
    relevant: Indices
    """Rows that may be active within the bounds on the step."""


@njit(cache=True)
def evaluate(problem: ReducedProblem, x: Array, mu: Array, active: Flags, rho: float) -> Evaluation:
    """Return the reduced problem at x with its active load cases; mu warm-starts the search for the inputs."""
    N, m, K = len(x), len(problem.rows.lower), len(problem.cases.weight)
    pose, dV, duals, u = platform(problem, x), np.zeros(N), mu.copy(), np.empty((K, len(problem.rotors.forces)))
    V = effort(problem, pose, active, rho, duals, u, dV)
    g, J, is_near, gradients = np.empty(m), np.zeros((m, N)), np.zeros(m, np.bool_), np.empty((m, 9))
    clearances(problem, pose, g, gradients, np.zeros((problem.rows.rods, 2)))
    _slopes(problem, pose, g, gradients, J, is_near)
    add_speed_rows(problem.speeds, problem, pose, rho, duals, u, g, J, is_near)
    return Evaluation(x, V, dV, g, J, is_near, duals, u, active)


@njit(cache=True, inner=True, allocates=False)
def _slopes(
    problem: ReducedProblem, pose: ReducedPlatform, g: Array, gradients: Array, J: Array, is_near: Flags
) -> None:
    """Find which rows are near, and their derivatives by the unknowns.

    A clearance between two modules depends only on the hinges between them.
    """
    module_i, module_j, moves, omega, v = problem.rows.i, problem.rows.j, problem.tree.moves, pose.omega, pose.v
    for r in range(len(module_i)):
        if g[r] >= DESCENT.near:
            continue
        is_near[r] = True
        i, j, is_pair = module_i[r], module_j[r], module_j[r] >= 0
        F, T = row(gradients, r), row(gradients, r, 3)
        for l in range(3 if is_pair else 0, len(omega)):
            if moves[l, i] != (is_pair and moves[l, j]):
                slope = dot(row(omega, l), T) + dot(row(v, l), F)
                J[r, l] = slope if moves[l, i] else -slope
        if not is_pair:
            add_reaction(problem, pose, F, row(gradients, r, 6), J[r])


@njit(cache=True, allocates=False)
def merit(V: float, g: Array, lower: Array, multipliers: Array, sigma: float) -> float:
    """Return M."""
    total = V
    for r in range(len(g)):
        s = multipliers[r] + sigma * (lower[r] - g[r])
        if s > 0.0:
            total += s * s / (2 * sigma)
        total -= multipliers[r] ** 2 / (2 * sigma)
    return total


@njit(cache=True)
def estimates(g: Array, lower: Array, multipliers: Array, sigma: float) -> Array:
    """Return the first-order multiplier estimates max(0, lambda + sigma (m - g))."""
    estimate = np.empty(len(g))
    for r in range(len(g)):
        estimate[r] = max(0.0, multipliers[r] + sigma * (lower[r] - g[r]))
    return estimate


@njit(cache=True)
def descend(
    problem: ReducedProblem, x: Array, mu: Array, active: Flags, multipliers: Array, B: Array, phase: DescentPhase
) -> Evaluation:
    """Return the last point of a phase of descents on M.

    Args:
        problem: the task and topology.
        x: initial point, shape (N,).
        mu: dual unknowns of the load cases there, or any, shape (K, 6).
        active: the active load cases, shape (K,).
        multipliers: multipliers of the rows, shape (m,); updated in place between rounds.
        B: curvature, shape (N, N), or zeros; updated in place.
        phase: prices and limits.
    """
    point = evaluate(problem, x, mu, active, phase.rho)
    if B[0, 0] == 0.0:  # larger where the first slope is steep, for steps of about a radian
        B[:] = max(DESCENT.min_curvature, np.max(np.abs(point.dV))) * np.eye(len(x))
    for k in range(phase.rounds):
        if k:
            multipliers[:] = estimates(point.g, problem.rows.lower, multipliers, phase.sigma)
        point = _descend(problem, point, multipliers, B, phase)
    return point


@njit(cache=True, inner=True)
def _descend(
    problem: ReducedProblem, start: Evaluation, multipliers: Array, B: Array, phase: DescentPhase
) -> Evaluation:
    """Return the last point of a descent on M; B is updated in place."""
    point, N, lower, sigma = start, len(start.x), problem.rows.lower, phase.sigma
    value = merit(point.V, point.g, lower, multipliers, sigma)
    n = len(problem.tree.parent)
    low, high = np.empty(N), np.empty(N)
    for _ in range(phase.steps):
        for l in range(N):
            limit = DESCENT.largest_turn if l < n + 2 else DESCENT.largest_move
            low[l] = max(-limit, problem.lower[l] - point.x[l])
            high[l] = min(limit, problem.upper[l] - point.x[l])
        d, predicted = _model_step(point, lower, multipliers, B, sigma, low, high)
        if predicted <= 1e-2 * phase.tolerance * (1.0 + abs(value)):
            return point
        t, decreased = 1.0, False
        for _ in range(DESCENT.halvings):
            x = np.minimum(np.maximum(point.x + t * d, problem.lower), problem.upper)
            trial = evaluate(problem, x, point.mu, point.active, phase.rho)
            trial_value = merit(trial.V, trial.g, lower, multipliers, sigma)
            if trial_value <= value - DESCENT.armijo * t * predicted:
                decreased = True
                break
            t *= 0.5 if t > 0.3 else 0.25
        if not decreased:
            return point
        _update_curvature(B, point, trial, estimates(trial.g, lower, multipliers, sigma))
        gain, point, value = value - trial_value, trial, trial_value
        if gain <= phase.tolerance * (1.0 + abs(value)):
            return point
    return point


@njit(cache=True, inner=True)
def _model_step(
    point: Evaluation, lower: Array, multipliers: Array, B: Array, sigma: float, low: Array, high: Array
) -> tuple[Array, float]:
    """Return the step that minimises q, and the decrease of q."""
    N, m = len(point.x), len(point.g)
    s = np.empty(m)
    relevant = np.empty(m, np.int64)
    rows, J, is_near, g = 0, point.J, point.is_near, point.g
    for r in range(m):
        if is_near[r]:
            s[rows] = multipliers[r] + sigma * (lower[r] - g[r])
            reach = 0.0
            for l in range(N):
                reach += abs(J[r, l]) * (high[l] - low[l])
            if s[rows] + sigma * reach > 0.0:
                relevant[rows] = r
                rows += 1
    d, trial = np.zeros(N), np.empty(N)
    gradient, H = np.empty(N), np.empty((N, N))
    free, index = np.empty(N, np.bool_), np.empty(N, np.int64)
    model = StepModel(point.dV, J, B, sigma, s, relevant[:rows])
    first = _model(model, d, gradient, H)
    value = first
    y = np.empty(N)
    for _ in range(DESCENT.newton_steps):
        for l in range(N):
            free[l] = not ((d[l] <= low[l] and gradient[l] >= 0.0) or (d[l] >= high[l] and gradient[l] <= 0.0))
        _newton(gradient, H, d, low, high, free, index, y)
        t, slope = 1.0, 0.0  # step to the first bound at most
        for l in range(N):
            slope -= y[l] * gradient[l]
            if y[l] > 0.0:
                t = min(t, (high[l] - d[l]) / y[l])
            elif y[l] < 0.0:
                t = min(t, (low[l] - d[l]) / y[l])
        if slope <= 1e-12 * (1.0 + abs(first)):
            break
        decreased = False
        for _ in range(20):
            for l in range(N):
                trial[l] = min(max(d[l] + t * y[l], low[l]), high[l])
            trial_value = _model(model, trial, gradient, H)
            if trial_value < value:
                decreased = True
                break
            t /= 2
        if not decreased:
            break
        d, trial, value = trial, d, trial_value
    return d, first - value


@njit(cache=True, inner=True)
def _newton(
    gradient: Array, H: Array, d: Array, low: Array, high: Array, free: Flags, index: Indices, y: Array
) -> None:
    """Find the Newton step y over the free unknowns; an unknown at a bound is fixed if y points outside."""
    N = len(d)
    repeat = True
    while repeat:
        size, repeat = 0, False
        y[:] = 0.0
        for l in range(N):
            if free[l]:
                index[size] = l
                size += 1
        K, z = np.empty((size, size)), np.empty(size)
        for a in range(size):
            z[a] = -gradient[index[a]]
            for b in range(a + 1):
                K[a, b] = H[index[a], index[b]]
        solve_in_place(K, z)
        for a in range(size):
            l = index[a]
            y[l] = z[a]
            if (y[l] < 0.0 and d[l] <= low[l]) or (y[l] > 0.0 and d[l] >= high[l]):
                free[l], repeat = False, True


@njit(cache=True, inner=True, literals=False, allocates=False)
def _model(model: StepModel, d: Array, gradient: Array, H: Array) -> float:
    """Return q(d), with its gradient and the lower half of its Hessian."""
    N, value, (dV, J, B, sigma, s, relevant) = len(d), 0.0, model
    for a in range(N):
        Bd = 0.0
        for b in range(N):
            Bd += B[a, b] * d[b]
        gradient[a] = dV[a] + Bd
        value += d[a] * (dV[a] + Bd / 2)
        for b in range(a + 1):
            H[a, b] = B[a, b]
    for k in range(len(relevant)):
        r = relevant[k]
        multiplier = s[k]
        for a in range(N):
            multiplier -= sigma * J[r, a] * d[a]
        if multiplier <= 0.0:
            continue
        value += multiplier * multiplier / (2 * sigma)
        for a in range(N):
            if J[r, a] != 0.0:
                gradient[a] -= multiplier * J[r, a]
                for b in range(a + 1):
                    H[a, b] += sigma * J[r, a] * J[r, b]
    return value


@njit(cache=True, inner=True)
def _update_curvature(B: Array, before: Evaluation, after: Evaluation, multipliers: Array) -> None:
    """Update B with the gradients of the Lagrangian before and after a step (Powell's damped BFGS)."""
    N = len(after.x)
    s, y, Bs = np.empty(N), np.empty(N), np.zeros(N)
    for l in range(N):
        s[l] = after.x[l] - before.x[l]
        y[l] = after.dV[l] - before.dV[l]
    for r in range(len(multipliers)):
        if multipliers[r] > 0.0 and before.is_near[r] and after.is_near[r]:
            for l in range(N):
                y[l] -= multipliers[r] * (after.J[r, l] - before.J[r, l])
    sBs = sy = 0.0
    for a in range(N):
        for b in range(N):
            Bs[a] += B[a, b] * s[b]
        sBs += s[a] * Bs[a]
        sy += s[a] * y[a]
    if sBs <= 1e-16:
        return
    if sy < DESCENT.curvature * sBs:
        share = (1 - DESCENT.curvature) * sBs / (sBs - sy)
        sy = 0.0
        for a in range(N):
            y[a] = share * y[a] + (1 - share) * Bs[a]
            sy += s[a] * y[a]
    for a in range(N):
        for b in range(N):
            B[a, b] += y[a] * y[b] / sy - Bs[a] * Bs[b] / sBs

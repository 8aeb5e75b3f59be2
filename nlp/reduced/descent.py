r"""Descent on the augmented Lagrangian.

A step d minimises a model of M, piecewise quadratic in d:

.. math::

    q(d) = dV \cdot d + \tfrac12 d^T B d
         + \frac{1}{2 \sigma} \sum_r \max(0, \lambda_r + \sigma (m_r - g_r - J_r d))^2,
    \qquad l \le d \le h

| symbol | meaning | shape |
|---|---|---|
| B | curvature of the Lagrangian V - sum of lambda g alone, learnt by damped BFGS updates | (N, N) |
| l, h | bounds on the step: those on the unknowns, and what a step may turn and move | (N,) each |

The penalty's own curvature, sigma J^T J, is explicit in it: learning would have to follow every row that begins or
ends to count.

The reduced problem at a point: value, rows and derivatives, and the augmented Lagrangian made of them.

.. math::

    V(x) = \sum_k \phi_k(x), \qquad
    M(x) = V(x) + \frac{1}{2 \sigma} \sum_r \max(0, \lambda_r + \sigma (m_r - g_r(x)))^2 - \lambda_r^2

| symbol | meaning | shape |
|---|---|---|
| x | unknowns | (N,) |
| V, dV | effort and price of the wrenches' residuals; its gradient | (N,) |
| g, J | clearances and their Jacobian; rows that are not near have none | (m,), (m, N) |
| m_r, lambda_r, sigma | least clearance of row r, its multiplier, the penalty | |
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlp.numbers.cholesky import solve_in_place
from nlp.reduced.arrays import Indices, Mask, ReducedProblem
from nlp.reduced.clearance import clearances
from nlp.reduced.inputs import effort
from nlp.reduced.platform import Platform, add_reaction, dot, platform, row
from nlp.reduced.speeds import speed_rows
from nlp.requirements.statement import AIR, APART, PARTS
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class Descent(NamedTuple):
    """The steps of a descent."""

    near: float = 4.0
    """Rows with less clearance have a gradient [l_arm]: a step moves no module that far into another's way."""
    largest_turn: float = 0.7
    """Largest change of an angle in a step [rad]."""
    largest_move: float = 4.0
    """Largest shift of the end-effector along an axis [l_arm]."""
    newton_steps: int = 30
    """Largest number of Newton steps on a model."""
    armijo: float = 1e-4
    """Share of the model's slope that a step must bring."""
    halvings: int = 12
    """Largest number of halvings of a step."""
    curvature: float = 0.2
    """Least share of the model's curvature that an update may learn (Powell's damping)."""


DESCENT = Descent()


class Evaluated(NamedTuple):
    """The reduced problem at a point."""

    x: Array
    V: float
    dV: Array
    g: Array
    J: Array
    near: Mask
    mu: Array
    """Dual unknowns of the load cases, shape (K, 6): where the next search begins."""
    counting: Mask
    """The load cases that count, shape (K,)."""


@njit(cache=True)
def evaluate(problem: ReducedProblem, x: Array, mu: Array, counting: Mask, rho: float) -> Evaluated:
    """Return the reduced problem at x with the load cases that count; the search for the inputs begins at mu."""
    N, m, K, n = len(x), len(problem.rows.least), len(problem.cases.effort), len(problem.tree.parent)
    at, dV, duals, u = platform(problem, x), np.zeros(N), mu.copy(), np.empty((K, 4 * n))
    V = effort(problem, at, counting, rho, duals, u, dV)
    g, J, near, by = np.empty(m), np.zeros((m, N)), np.zeros(m, np.bool_), np.empty((m, 9))
    clearances(problem, at, g, by)
    _slopes(problem, at, g, by, J, near)
    if len(problem.speeds.case):
        speed_rows(problem, at, rho, duals, u, g, J, near)
    return Evaluated(x, V, dV, g, J, near, duals, counting)


@njit(cache=True)
def _slopes(problem: ReducedProblem, at: Platform, g: Array, by: Array, J: Array, near: Mask) -> None:
    """Find which rows are near, and their derivatives by the unknowns.

    What lies between two modules depends on the hinges between them alone.
    """
    rows, moves, omega, v = problem.rows, problem.tree.moves, at.omega, at.v
    kinds, one, other = rows.kind, rows.i, rows.j
    for r in range(len(kinds)):
        if g[r] >= DESCENT.near:
            continue
        near[r] = True
        i, j, F, T, between = one[r], other[r], row(by, r), row(by, r, 3), kinds[r] in (AIR, APART, PARTS)
        for l in range(3 if between else 0, len(omega)):
            if moves[l, i] != (between and moves[l, j]):
                slope = dot(row(omega, l), T) + dot(row(v, l), F)
                J[r, l] = slope if moves[l, i] else -slope
        if not between:
            add_reaction(problem, at, F, row(by, r, 6), J[r])


@njit(cache=True)
def merit(problem: ReducedProblem, at: Evaluated, multipliers: Array, sigma: float) -> float:
    """Return M."""
    total = at.V
    for r in range(len(at.g)):
        s = multipliers[r] + sigma * (problem.rows.least[r] - at.g[r])
        if s > 0.0:
            total += s * s / (2 * sigma)
        total -= multipliers[r] ** 2 / (2 * sigma)
    return total


@njit(cache=True)
def estimates(problem: ReducedProblem, at: Evaluated, multipliers: Array, sigma: float) -> Array:
    """Return max(0, lambda + sigma (m - g)): the multipliers that M's gradient stands for."""
    estimate = np.zeros(len(at.g))
    for r in range(len(estimate)):
        estimate[r] = max(0.0, multipliers[r] + sigma * (problem.rows.least[r] - at.g[r]))
    return estimate


@njit(cache=True)
def descend(
    problem: ReducedProblem,
    start: Evaluated,
    multipliers: Array,
    B: Array,
    rho: float,
    sigma: float,
    steps: int,
    enough: float,
) -> Evaluated:
    """Return where M is small.

    Args:
        problem: the task and topology.
        start: where it begins.
        multipliers: of the rows, shape (m,).
        B: curvature, shape (N, N), which is brought up to date.
        rho: price of residuals.
        sigma: price of missing clearance.
        steps: most steps.
        enough: decrease of M, over 1 + M, of a step that is the last one.
    """
    at, N = start, len(start.x)
    value = merit(problem, at, multipliers, sigma)
    n = len(problem.tree.parent)
    low, high = np.empty(N), np.empty(N)
    for _ in range(steps):
        for l in range(N):
            most = DESCENT.largest_turn if l < n + 2 else DESCENT.largest_move
            low[l] = max(-most, problem.lower[l] - at.x[l])
            high[l] = min(most, problem.upper[l] - at.x[l])
        d, predicted = _model_step(problem, at, multipliers, B, sigma, low, high)
        if predicted <= 1e-2 * enough * (1.0 + abs(value)):
            return at
        t, decreased = 1.0, False
        for _ in range(DESCENT.halvings):
            x = np.minimum(np.maximum(at.x + t * d, problem.lower), problem.upper)
            there = evaluate(problem, x, at.mu, at.counting, rho)
            reached = merit(problem, there, multipliers, sigma)
            if reached <= value - DESCENT.armijo * t * predicted:
                decreased = True
                break
            t *= 0.5 if t > 0.3 else 0.25
        if not decreased:
            return at
        _learn(B, at, there, estimates(problem, there, multipliers, sigma))
        gain, at, value = value - reached, there, reached
        if gain <= enough * (1.0 + abs(value)):
            return at
    return at


@njit(cache=True)
def _model_step(
    problem: ReducedProblem, at: Evaluated, multipliers: Array, B: Array, sigma: float, low: Array, high: Array
) -> tuple[Array, float]:
    """Return the step that minimises q, and by how much that falls."""
    N, m = len(at.x), len(at.g)
    s = np.empty(m)
    listed = np.empty(m, np.int64)
    rows, J, near, g, least = 0, at.J, at.near, at.g, problem.rows.least
    for r in range(m):
        if near[r]:
            s[rows] = multipliers[r] + sigma * (least[r] - g[r])
            reach = 0.0
            for l in range(N):
                reach += abs(J[r, l]) * (high[l] - low[l])
            if s[rows] + sigma * reach > 0.0:
                listed[rows] = r
                rows += 1
    d, trial = np.zeros(N), np.empty(N)
    gradient, H = np.empty(N), np.empty((N, N))
    free, index = np.empty(N, np.bool_), np.empty(N, np.int64)
    first = _model(at, B, sigma, s, listed, rows, d, gradient, H)
    value = first
    y = np.empty(N)
    for _ in range(DESCENT.newton_steps):
        for l in range(N):
            free[l] = not ((d[l] <= low[l] and gradient[l] >= 0.0) or (d[l] >= high[l] and gradient[l] <= 0.0))
        _newton(gradient, H, d, low, high, free, index, y)
        t, falls = 1.0, 0.0  # no farther than to the first bound
        for l in range(N):
            falls -= y[l] * gradient[l]
            if y[l] > 0.0:
                t = min(t, (high[l] - d[l]) / y[l])
            elif y[l] < 0.0:
                t = min(t, (low[l] - d[l]) / y[l])
        if falls <= 1e-12 * (1.0 + abs(first)):
            break
        better = False
        for _ in range(20):
            for l in range(N):
                trial[l] = min(max(d[l] + t * y[l], low[l]), high[l])
            reached = _model(at, B, sigma, s, listed, rows, trial, gradient, H)
            if reached < value:
                better = True
                break
            t /= 2
        if not better:
            break
        d[:] = trial
        value = reached
    return d, first - value


@njit(cache=True)
def _newton(
    gradient: Array, H: Array, d: Array, low: Array, high: Array, free: Mask, index: Indices, y: Array
) -> None:
    """Find the Newton step y over the unknowns that are free; one that it leads out of a bound at once is not."""
    N = len(d)
    again = True
    while again:
        size, again = 0, False
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
                free[l], again = False, True


@njit(cache=True)
def _model(
    at: Evaluated, B: Array, sigma: float, s: Array, listed: Indices, rows: int, d: Array, gradient: Array, H: Array
) -> float:
    """Return q(d), with its gradient and the lower half of its Hessian."""
    N, J, dV = len(d), at.J, at.dV
    value = 0.0
    for a in range(N):
        Bd = 0.0
        for b in range(N):
            Bd += B[a, b] * d[b]
        gradient[a] = dV[a] + Bd
        value += d[a] * (dV[a] + Bd / 2)
        for b in range(a + 1):
            H[a, b] = B[a, b]
    for k in range(rows):
        r = listed[k]
        left = s[k]
        for a in range(N):
            left -= sigma * J[r, a] * d[a]
        if left <= 0.0:
            continue
        value += left * left / (2 * sigma)
        for a in range(N):
            if J[r, a] != 0.0:
                gradient[a] -= left * J[r, a]
                for b in range(a + 1):
                    H[a, b] += sigma * J[r, a] * J[r, b]
    return value


@njit(cache=True)
def _learn(B: Array, before: Evaluated, after: Evaluated, multipliers: Array) -> None:
    """Bring B up to date with the gradients of the Lagrangian before and after a step (Powell's damped BFGS)."""
    N = len(after.x)
    s, y, Bs = np.empty(N), np.empty(N), np.zeros(N)
    for l in range(N):
        s[l] = after.x[l] - before.x[l]
        y[l] = after.dV[l] - before.dV[l]
    for r in range(len(multipliers)):
        if multipliers[r] > 0.0 and before.near[r] and after.near[r]:
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

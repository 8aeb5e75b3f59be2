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
"""

from __future__ import annotations

import numpy as np

from nlp.numbers.cholesky import solve_in_place
from nlp.reduced.arrays import Indices, Mask, ReducedProblem
from nlp.reduced.merit import Evaluated, estimates, evaluate, merit
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

LARGEST_TURN = 0.7
"""Largest change of an angle in a step [rad]."""
LARGEST_MOVE = 4.0
"""Largest shift of the end-effector along an axis [l_arm]."""
NEWTON_STEPS = 30
"""Largest number of Newton steps on a model."""
ARMIJO = 1e-4
"""Share of the model's slope that a step must bring."""
HALVINGS = 12
"""Largest number of halvings of a step."""
CURVATURE = 0.2
"""Least share of the model's curvature that an update may learn (Powell's damping)."""


@njit(cache=True)
def descend(
    stated: ReducedProblem,
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
        stated: the task and topology.
        start: where it begins.
        multipliers: of the rows, shape (m,).
        B: curvature, shape (N, N), which is brought up to date.
        rho: price of residuals.
        sigma: price of missing clearance.
        steps: most steps.
        enough: decrease of M, over 1 + M, of a step that is the last one.
    """
    at, N = start, len(start.x)
    value = merit(stated, at, multipliers, sigma)
    n = len(stated.tree.parent)
    low, high = np.empty(N), np.empty(N)
    for _ in range(steps):
        for l in range(N):
            most = LARGEST_TURN if l < n + 2 else LARGEST_MOVE
            low[l] = max(-most, stated.lower[l] - at.x[l])
            high[l] = min(most, stated.upper[l] - at.x[l])
        d, predicted = _model_step(stated, at, multipliers, B, sigma, low, high)
        if predicted <= 1e-2 * enough * (1.0 + abs(value)):
            return at
        t, found = 1.0, False
        for _ in range(HALVINGS):
            x = np.minimum(np.maximum(at.x + t * d, stated.lower), stated.upper)
            there = evaluate(stated, x, at.mu, at.counting, rho)
            reached = merit(stated, there, multipliers, sigma)
            if reached <= value - ARMIJO * t * predicted:
                found = True
                break
            t *= 0.5 if t > 0.3 else 0.25
        if not found:
            return at
        _learn(B, at, there, estimates(stated, there, multipliers, sigma))
        gain, at, value = value - reached, there, reached
        if gain <= enough * (1.0 + abs(value)):
            return at
    return at


@njit(cache=True)
def _model_step(
    stated: ReducedProblem, at: Evaluated, multipliers: Array, B: Array, sigma: float, low: Array, high: Array
) -> tuple[Array, float]:
    """Return the step that minimises q, and by how much that falls."""
    N, m = len(at.x), len(at.g)
    s = np.empty(m)
    listed = np.empty(m, np.int64)
    rows, J, near, g, least = 0, at.J, at.near, at.g, stated.rows.least
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
    for _ in range(NEWTON_STEPS):
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
    if sy < CURVATURE * sBs:
        share = (1 - CURVATURE) * sBs / (sBs - sy)
        sy = 0.0
        for a in range(N):
            y[a] = share * y[a] + (1 - share) * Bs[a]
            sy += s[a] * y[a]
    for a in range(N):
        for b in range(N):
            B[a, b] += y[a] * y[b] / sy - Bs[a] * Bs[b] / sBs

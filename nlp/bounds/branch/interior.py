r"""Good multipliers for fixed angles from the start: Mehrotra's interior-point method.

Newton's method (`nlp.bounds.branch.multipliers`) is quick from a parent's multipliers but stalls on the kinks that
corners of reserves give psi. This one does not stall, and where a wrench cannot be produced its multipliers soon
exceed any cut. Nothing that is proven rests on it: any multipliers will do.

.. math::

    \min_{u, p, s} \sum_{k,j} \lambda_k u_{kj}^2 \quad \text{with} \quad 0 \le u \le U, \quad
    \sum_j u_{kj} a_j + G_k p = b_k, \quad n_r \cdot p + s_r = -c_r, \quad s \ge 0

Its multipliers are y of the balances, sigma of the walls, and those of the limits of u. The ridges r and w of D let
balances and walls be missed at a cost, and stand for what D loses over the box. p is the tip's position, -p'_E.

Source: S. Mehrotra, On the implementation of a primal-dual interior point method, SIAM J. Optimization 2 (1992).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.frames import Frames
from nlp.bounds.branch.multipliers import Workspace, imbalance
from nlp.numbers.cholesky import factor, solve_factored
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

STEPS = 25
"""Largest number of steps."""
BOUNDARY = 0.95
"""Share of the way to the boundary that a step goes."""
CONVERGED = 1e-3
"""Duality gap at which it ends, as a share of D."""
WEIGHTLESS = 1e-5
"""Least weight of a load case, in the largest: psi of less has a kink."""
RIDGE = 2.0
"""Ridge of multipliers of force, over n / 24 sum_a rho_a^2: how much D curves over the box."""
LEVERED = 10.0
"""Ridge of multipliers of torque, in that of those of force: levers are longer than l_arm."""
KINKED = 0.1
"""Divisor of a corner's ridge, over the root of sum_a rho_a^2: its psi has a kink."""
MOST_KINKED = 1e-2
"""Largest divisor."""
LEAST_SQUARE = 1e-6
"""That sum_a rho_a^2 counts as [rad^2]."""
IDLE = 1e-3
"""Largest |a_j . y_k| of a corner that costs nothing, over 2 U."""
CANNOT = 1e-9
"""Share of the walls' multipliers that the condition may miss by rounding."""


class Iterate(NamedTuple):
    """A point within all limits, or a step from it."""

    u: Array
    """Inputs, shape (K, 4 n)."""
    low: Array
    """Multipliers of u >= 0, shape (K, 4 n)."""
    high: Array
    """Multipliers of u <= U, shape (K, 4 n)."""
    y: Array
    """Shape (K, 6)."""
    p: Array
    """Shape (3,)."""
    sigma: Array
    """Shape (W,)."""
    s: Array
    """Slacks of walls, shape (W,)."""


class Interior(NamedTuple):
    """Arrays for one search."""

    at: Iterate
    step: Iterate
    stiff: Array
    """How much the multiplier of an input changes with it, shape (K, 4 n)."""
    factors: Array
    """Cholesky factors of the Hessians in y_k, shape (K, 6, 6)."""
    rows: Array
    """Their inverses times the condition's rows, shape (K, 3, 6)."""
    S: Array
    """Schur complement of p, factored, shape (3, 3)."""
    c: Array
    """How far beyond its wall an end of an envelope is, but for p, shape (W,)."""
    weight: Array
    """Weights of the load cases, not less than WEIGHTLESS, shape (K,)."""
    ridge: Array
    """r, shape (K, 6)."""
    y: Array
    """Multipliers that meet the condition, shape (K, 6)."""
    sigma: Array


@njit(cache=True)
def _blank_iterate(K: int, J: int, W: int) -> Iterate:
    return Iterate(
        np.zeros((K, J)),
        np.zeros((K, J)),
        np.zeros((K, J)),
        np.zeros((K, 6)),
        np.zeros(3),
        np.zeros(W),
        np.zeros(W),
    )


@njit(cache=True)
def blank(stated: BranchProblem) -> Interior:
    """Return arrays for one box at a time."""
    K, J, W = len(stated.loads.f), 4 * len(stated.tree.parent), len(stated.walls.normal)
    return Interior(
        _blank_iterate(K, J, W),
        _blank_iterate(K, J, W),
        np.zeros((K, J)),
        np.zeros((K, 6, 6)),
        np.zeros((K, 3, 6)),
        np.zeros((3, 3)),
        np.zeros(W),
        np.maximum(stated.loads.weight, WEIGHTLESS),
        np.zeros((K, 6)),
        np.zeros((K, 6)),
        np.zeros(W),
    )


@njit(cache=True)
def look(stated: BranchProblem, R: Array, at: Frames, rho: Array, cut: float, inner: Interior) -> float:
    """Fill what is known of walls at the middle of a box, and the ridges; return w.

    Args:
        stated: the task and the tree.
        R: root orientation at the middle.
        at: frames there.
        rho: half widths [rad].
        cut: in effort units.
        inner: arrays.
    """
    walls, square = stated.walls, max((rho**2).sum(), LEAST_SQUARE)
    for r in range(len(inner.c)):
        i = walls.module[r]
        inner.c[r] = (
            walls.beyond[r] + (walls.normal[r] * (R @ (at.p[i] - walls.end[r] * walls.length * at.z[i]))).sum()
        )
    ridge = RIDGE * len(stated.tree.parent) / 24 * square
    for k in range(len(inner.ridge)):
        inner.ridge[k, :3] = ridge
        if stated.loads.weight[k] == 0.0:
            inner.ridge[k, :3] = ridge / min(MOST_KINKED, KINKED * math.sqrt(square))
        inner.ridge[k, 3:] = LEVERED * inner.ridge[k, 0]
    return float(square * stated.levers.centre.max() ** 2 / cut)


@njit(cache=True)
def search_from_start(
    stated: BranchProblem, work: Workspace, inner: Interior, wall_ridge: float, first: Array, enough: float
) -> None:
    """Fill `inner.y` and `inner.sigma` with good multipliers that meet the condition.

    Args:
        stated: the task and the tree.
        work: with the wrenches of the box's middle.
        inner: as `look` fills it.
        wall_ridge: w.
        first: multipliers that the search starts at, shape (K, 6).
        enough: D at which the search ends.
    """
    at, step, U = inner.at, inner.step, stated.u_max
    at.u[:], at.low[:], at.high[:] = U / 2, 1.0, 1.0
    at.y[:], at.p[:], at.sigma[:], at.s[:] = first, 0.0, 1.0, 1.0
    inner.y[:], inner.sigma[:] = first, 0.0
    pairs, best = 2 * at.u.size + len(at.s), -math.inf
    y, sigma = first.copy(), inner.sigma.copy()
    for _ in range(STEPS):
        gap = _gap(at, step, 0.0, U)
        if gap < CONVERGED * best:
            break
        _factor(stated, work, inner, wall_ridge)
        _direct(stated, work, inner, wall_ridge, 0.0, 0.0)
        left = _gap(at, step, min(1.0, _longest(at, step, U)), U)
        _direct(stated, work, inner, wall_ridge, left**3 / (gap * gap * pairs), 1.0)
        _add(at, step, min(1.0, BOUNDARY * _longest(at, step, U)))
        y[:], sigma[:] = at.y, at.sigma
        _meet(stated, stated.loads.project, y, sigma)
        found = _value(stated, work, inner, wall_ridge, y, sigma)
        if found > best:
            best = found
            inner.y[:], inner.sigma[:] = y, sigma
        if not found < enough:
            break
    _drop_idle(stated, work, inner)


@njit(cache=True)
def _value(
    stated: BranchProblem, work: Workspace, inner: Interior, wall_ridge: float, y: Array, sigma: Array
) -> float:
    """Return D(y, sigma)."""
    total, U = 0.0, stated.u_max
    for r in range(len(sigma)):
        total += (inner.c[r] - wall_ridge / 2 * sigma[r]) * sigma[r]
    for k in range(len(y)):
        weight = inner.weight[k]
        for l in range(6):
            total += (work.b[k, l] - inner.ridge[k, l] / 2 * y[k, l]) * y[k, l]
        for j in range(len(work.a)):
            t = 0.0
            for l in range(6):
                t += work.a[j, l] * y[k, l]
            if t > 0.0:
                u = min(U, t / (2 * weight))
                total -= u * (t - weight * u)
    return total


@njit(cache=True)
def _meet(stated: BranchProblem, project: Array, y: Array, sigma: Array) -> None:
    """Meet the condition by the least change of torques' multipliers that are not zero, or else without walls."""
    _correct(stated, project, y, sigma)
    a, b, c = imbalance(stated, y, sigma)
    if not math.sqrt(a * a + b * b + c * c) <= CANNOT * sigma.sum():
        sigma[:] = 0.0
        _correct(stated, project, y, sigma)


@njit(cache=True)
def _correct(stated: BranchProblem, project: Array, y: Array, sigma: Array) -> None:
    q = project @ np.array(imbalance(stated, y, sigma))
    for k in range(len(y)):  # mu_k -= [g_k]x^T q = q x g_k
        if np.any(y[k] != 0.0):
            y[k, 3:] -= np.cross(q, stated.loads.g[k])


@njit(cache=True)
def _drop_idle(stated: BranchProblem, work: Workspace, inner: Interior) -> None:
    """Set the multipliers of corners that cost nothing to zero: each would lose something to rounding."""
    y, crosses = inner.y, np.zeros((3, 3))
    for k in range(len(y)):
        if stated.loads.weight[k] == 0.0 and np.abs(work.a @ y[k]).max() < IDLE * 2 * stated.u_max:
            y[k] = 0.0
        else:
            rows = work.rows[k, :3, 3:].copy()
            crosses += rows @ rows.T
    _meet(stated, np.asarray(np.linalg.pinv(crosses, 1e-9), np.float64), y, inner.sigma)


@njit(cache=True)
def _add(at: Iterate, step: Iterate, share: float) -> None:
    at.u[:] += share * step.u
    at.low[:] += share * step.low
    at.high[:] += share * step.high
    at.y[:] += share * step.y
    at.p[:] += share * step.p
    at.sigma[:] += share * step.sigma
    at.s[:] += share * step.s


@njit(cache=True)
def _gap(at: Iterate, step: Iterate, share: float, U: float) -> float:
    """Return the duality gap after a share of a step."""
    total = 0.0
    for r in range(len(at.s)):
        total += (at.s[r] + share * step.s[r]) * (at.sigma[r] + share * step.sigma[r])
    for k in range(len(at.u)):
        for j in range(at.u.shape[1]):
            u = at.u[k, j] + share * step.u[k, j]
            total += (at.low[k, j] + share * step.low[k, j]) * u
            total += (at.high[k, j] + share * step.high[k, j]) * (U - u)
    return total


@njit(cache=True)
def _longest(at: Iterate, step: Iterate, U: float) -> float:
    """Return the share of a step that ends at the first limit."""
    most = 1e10
    for r in range(len(at.s)):
        if step.s[r] < 0.0:
            most = min(most, -at.s[r] / step.s[r])
        if step.sigma[r] < 0.0:
            most = min(most, -at.sigma[r] / step.sigma[r])
    for k in range(len(at.u)):
        for j in range(at.u.shape[1]):
            if step.u[k, j] < 0.0:
                most = min(most, -at.u[k, j] / step.u[k, j])
            if step.u[k, j] > 0.0:
                most = min(most, (U - at.u[k, j]) / step.u[k, j])
            if step.low[k, j] < 0.0:
                most = min(most, -at.low[k, j] / step.low[k, j])
            if step.high[k, j] < 0.0:
                most = min(most, -at.high[k, j] / step.high[k, j])
    return most


@njit(cache=True)
def _factor(stated: BranchProblem, work: Workspace, inner: Interior, wall_ridge: float) -> None:
    """Fill what both directions of a step share."""
    at, U, S = inner.at, stated.u_max, inner.S
    S[:] = 0.0
    for r in range(len(at.s)):
        give = wall_ridge + at.s[r] / at.sigma[r]
        for l in range(3):
            for m in range(3):
                S[l, m] += stated.walls.normal[r, l] * stated.walls.normal[r, m] / give
    for k in range(len(at.y)):
        H = inner.factors[k]
        H[:] = 0.0
        for l in range(6):
            H[l, l] = inner.ridge[k, l]
        for j in range(len(work.a)):
            u = at.u[k, j]
            stiff = 2 * inner.weight[k] + at.low[k, j] / u + at.high[k, j] / (U - u)
            inner.stiff[k, j] = stiff
            for l in range(6):
                for m in range(l + 1):
                    H[l, m] += work.a[j, l] * work.a[j, m] / stiff
        factor(H, 6)
        for row in range(3):
            inner.rows[k, row] = work.rows[k, row]
            solve_factored(H, inner.rows[k, row], 6)
            for column in range(3):
                S[column, row] += (work.rows[k, column] * inner.rows[k, row]).sum()
    size = S[0, 0] + S[1, 1] + S[2, 2]
    for l in range(3):  # without g there is no condition
        S[l, l] += 1e-9 * size if size > 0.0 else 1.0
    factor(S, 3)


@njit(cache=True)
def _direct(
    stated: BranchProblem, work: Workspace, inner: Interior, wall_ridge: float, target: float, second: float
) -> None:
    """Fill the step towards products `target` of limits and multipliers.

    `second` is the share of the last step's second order: 0 in a predictor, 1 in a corrector.
    """
    at, step, U, normal = inner.at, inner.step, stated.u_max, stated.walls.normal
    q = np.zeros(3)
    for r in range(len(at.s)):
        step.s[r] = (target - second * step.s[r] * step.sigma[r]) / at.sigma[r]
        step.sigma[r] = inner.c[r] - wall_ridge * at.sigma[r] + step.s[r]
        for l in range(3):
            step.sigma[r] += normal[r, l] * at.p[l]
        step.sigma[r] /= wall_ridge + at.s[r] / at.sigma[r]
        for l in range(3):
            q[l] -= normal[r, l] * (at.sigma[r] + step.sigma[r])
    for k in range(len(at.y)):
        dy = step.y[k]
        for l in range(6):
            dy[l] = work.b[k, l] - inner.ridge[k, l] * at.y[k, l]
            for row in range(3):
                dy[l] -= work.rows[k, row, l] * at.p[row]
        for j in range(len(work.a)):
            u, product = at.u[k, j], second * step.u[k, j]
            step.low[k, j] = (target - product * step.low[k, j]) / u
            step.high[k, j] = (target + product * step.high[k, j]) / (U - u)
            t = step.low[k, j] - step.high[k, j] - 2 * inner.weight[k] * u
            for l in range(6):
                t += work.a[j, l] * at.y[k, l]
            step.u[k, j] = t / inner.stiff[k, j]
            for l in range(6):
                dy[l] -= (u + step.u[k, j]) * work.a[j, l]
        solve_factored(inner.factors[k], dy, 6)
        for row in range(3):
            for l in range(6):
                q[row] += work.rows[k, row, l] * (at.y[k, l] + dy[l])
    solve_factored(inner.S, q, 3)
    step.p[:] = q
    for r in range(len(at.s)):
        by = 0.0
        for l in range(3):
            by += normal[r, l] * q[l]
        step.sigma[r] += by / (wall_ridge + at.s[r] / at.sigma[r])
        step.s[r] -= at.s[r] * (1 + step.sigma[r] / at.sigma[r])
    for k in range(len(at.y)):
        for l in range(6):
            for row in range(3):
                step.y[k, l] -= q[row] * inner.rows[k, row, l]
        for j in range(len(work.a)):
            t = 0.0
            for l in range(6):
                t += work.a[j, l] * step.y[k, l]
            u = at.u[k, j]
            step.u[k, j] += t / inner.stiff[k, j]
            step.low[k, j] -= at.low[k, j] * (1 + step.u[k, j] / u)
            step.high[k, j] -= at.high[k, j] * (1 - step.u[k, j] / (U - u))

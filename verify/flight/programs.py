"""Linear and quadratic programs whose solutions are proven: a primal and a dual point in hand for each.

    maximise c . v  such that  M v = m,  low <= v <= high

| symbol | meaning | shape |
|---|---|---|
| v | a primal point: within its bounds, and M v = m to RESIDUAL | (N,) |
| y | a dual point, any at all | (k,) |
| w | c - y M | (N,) |
| h(c) | the greatest value: c . v <= h(c) <= sum_j max(low_j w_j, high_j w_j) + y . m | |

So values are bracketed whoever found the points. Equations have no solution within TOLERANCE, the audit's own, if
some y with sum |y| = 1 has y . m - sum_j max(low_j w_j, high_j w_j) > TOLERANCE with w = y M. `solve` takes all
programs of one kind at once; what its points do not decide HiGHS solves again, one by one.

The least inputs that produce a wrench are a quadratic program:

    minimise |v|^2 / 2  such that  A v = b,  low <= v <= high

| symbol | meaning | shape |
|---|---|---|
| A, b | wrench map and wrench | (6, N), (6,) |
| y | multipliers; the best v for them is A^T y, clipped to the bounds | (6,) |
| L(y) | |v|^2 / 2 - y . (A v - b) at that v: never more than the least |v|^2 / 2 | |

L is concave, and its gradient b - A v. Newton's method finds where it vanishes: v is then the answer, proven.

`solve` finds the points of many small linear programs at once, by the dual simplex method for variables with
bounds:

| symbol | meaning | shape |
|---|---|---|
| B, N, k | programs, variables, equations | |
| M | equations of all programs, and k unit vectors, whose variables are zero | (k, N + k) |
| y | multipliers of the equations | (B, k) |
| r | reduced costs, c - y M: outside the basis v is at `high` where r > 0, at `low` where r < 0 | (B, N + k) |
| rho | row of the inverse basis that belongs to the leaving variable: the direction in which y moves | (B, k) |

Every variable has two bounds, so that every basis is dual feasible and the unit vectors are one to start from: no
first phase. A step goes past all breakpoints at which the dual objective still falls (the long step rule), so that
the number of steps hardly grows with N. Nothing that this finds has to be believed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topo_search.model.proven import TOLERANCE
from verify.bodies import Array
from verify.meshes import Indices

Ends = tuple[Array, Array, Array, Indices]

LARGEST = 1e6
"""Forces in m_t g and torques in l_arm m_t g beyond it have lost the digits that programs need."""
RESIDUAL = 1e-9
"""Tolerance of a primal point's equations: a thousandth of TOLERANCE."""
GAP = 1e-8
"""Distance of both bounds up to which a value counts as found."""
SUM_ROUNDING = 1e-15
"""Rounding error of a sum, for each of its terms, in units of the sum of their sizes."""


@dataclass(frozen=True, eq=False)
class Box:
    """Bounds of the variables."""

    low: Array
    """Shape (N,), or a row a program."""
    high: Array

    def rows(self, programs: int) -> Box:
        """Return the bounds with a row for each of so many programs."""
        shape = programs, self.low.shape[-1]
        return Box(np.broadcast_to(self.low, shape), np.broadcast_to(self.high, shape))

    def greatest(self, w: Array) -> Array:
        """Return upper bounds of the greatest w . v within the box, rounding included, shape (B,)."""
        size = np.sum(np.abs(w) * np.maximum(np.abs(self.low), np.abs(self.high)), axis=-1)
        greatest = np.sum(np.maximum(self.low * w, self.high * w), axis=-1)
        return np.asarray(greatest + SUM_ROUNDING * w.shape[-1] * size)


@dataclass(frozen=True, eq=False)
class Greatest:
    """Greatest values of some programs, proven from both sides."""

    v: Array
    """Primal points, shape (B, N)."""
    attained: Array
    """c . v; minus infinity where v does not meet the equations, shape (B,)."""
    upper: Array
    """No v that meets the equations has more, shape (B,)."""
    bases: Indices
    """Starting bases for slightly different costs, shape (B, k)."""


def greatest(c: Array, M: Array, m: Array, box: Box, bases: Indices | None = None) -> Greatest:
    """Return the greatest c . v of each program.

    Args:
        c: shape (B, N).
        M: shape (k, N).
        m: shape (B, k).
        box: bounds of all programs.
        bases: to start from.
    """
    bounds = box.rows(len(c))
    v, y, _, bases = solve(c, M, m, bounds.low, bounds.high, bases)
    judged = _bracket(c, M, m, bounds, v, y, bases)
    loose = np.flatnonzero(~(judged.upper - judged.attained <= GAP))
    if not len(loose):
        return judged
    from scipy.optimize import linprog  # slow to load, and few programs need it

    v, y = v.copy(), y.copy()
    for row in loose:
        solution = linprog(
            -c[row], A_eq=M, b_eq=m[row], bounds=np.stack([bounds.low[row], bounds.high[row]], axis=1)
        )
        if solution.status == 0:
            v[row] = np.clip(solution.x, bounds.low[row], bounds.high[row])
            y[row] = -solution.eqlin.marginals
    again = _bracket(c, M, m, bounds, v, y, bases)
    better = again.attained > judged.attained
    return Greatest(
        np.where(better[:, None], again.v, judged.v),
        np.maximum(judged.attained, again.attained),
        np.minimum(judged.upper, again.upper),
        bases,
    )


def _bracket(c: Array, M: Array, m: Array, box: Box, v: Array, y: Array, bases: Indices) -> Greatest:
    met = np.abs(v @ M.T - m).max(axis=1, initial=0.0) <= RESIDUAL
    beside = np.sum(y * m, axis=1) + SUM_ROUNDING * M.shape[0] * np.sum(np.abs(y * m), axis=1)
    upper = box.greatest(c - y @ M) + beside
    attained = np.where(met, np.sum(c * v, axis=1), -np.inf)
    return Greatest(v, attained, np.where(np.isnan(upper), np.inf, upper), bases)


@dataclass(frozen=True, eq=False)
class Solvable:
    """Solvability of equations within bounds, to the audit's tolerance."""

    yes: NDArray[np.bool_]
    """Proven: v is one, shape (B,)."""
    no: NDArray[np.bool_]
    """Proven that there is none, shape (B,). Neither: undecided."""
    v: Array
    """Shape (B, N)."""
    bases: Indices
    """Starting bases for slightly different bounds, shape (B, k)."""


def find_solutions(M: Array, m: Array, box: Box, bases: Indices | None = None) -> Solvable:
    """Return for each m, shape (B, k), whether M v = m has a solution within bounds, each equation to TOLERANCE."""
    bounds = box.rows(len(m))
    # any costs would do; different ones make the solution one vertex
    c = np.broadcast_to(-1.0 - np.arange(M.shape[1]) / M.shape[1], (len(m), M.shape[1]))
    v, _, rays, bases = solve(c, M, m, bounds.low, bounds.high, bases)
    yes, no = _meets(M, m, v), _excludes(M, m, bounds, rays)
    for row in np.flatnonzero(~yes & ~no):
        v[row], y = nearest(M, m[row], bounds.low[row], bounds.high[row])
        one = slice(row, row + 1)
        yes[one] = _meets(M, m[one], v[one])
        no[one] = _excludes(M, m[one], Box(bounds.low[one], bounds.high[one]), y[None])
    return Solvable(yes, no, v, bases)


def _meets(M: Array, m: Array, v: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(v @ M.T - m).max(axis=1) <= TOLERANCE)


def _excludes(M: Array, m: Array, box: Box, y: Array) -> NDArray[np.bool_]:
    """Return whether each y shows that nothing within the bounds meets the equations to TOLERANCE."""
    size = np.sum(np.abs(y), axis=1, keepdims=True)
    y = y / np.where(size > 0, size, 1.0)
    beside = np.sum(y * m, axis=1) - SUM_ROUNDING * M.shape[0] * np.sum(np.abs(y * m), axis=1)
    return np.asarray(beside - box.greatest(y @ M) > TOLERANCE)


def nearest(M: Array, m: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return by HiGHS the v that misses no equation by more than it must, and the multipliers that show it."""
    from scipy.optimize import linprog  # slow to load, and few programs need it

    k, N = M.shape
    A = np.block([[M, -np.ones((k, 1))], [-M, -np.ones((k, 1))]])
    bounds = [*zip(low.tolist(), high.tolist(), strict=True), (0.0, None)]
    solution = linprog(np.append(np.zeros(N), 1.0), A_ub=A, b_ub=np.concatenate([m, -m]), bounds=bounds)
    if solution.status != 0:
        return low, np.zeros(k)
    over, under = solution.ineqlin.marginals[:k], solution.ineqlin.marginals[k:]
    return np.clip(solution.x[:N], low, high), np.asarray(over - under)


def least_inputs(A: Array, b: Array, box: Box) -> Array | None:
    """Return the least inputs, shape (N,), each equation met to RESIDUAL; None if they are not found."""

    def at(y: Array) -> tuple[Array, Array, float]:
        v = np.clip(y @ A, box.low, box.high)
        missing = b - A @ v
        return v, missing, float(v @ v / 2 + y @ missing)

    y = np.zeros(len(A))
    v, missing, value = at(y)
    # in units of the largest entry: some wrenches may have no free rotors
    damping = least = max(1e-12 * float(np.abs(A @ A.T).max()), 1e-300)
    for _ in range(100):
        if np.abs(missing).max() <= RESIDUAL:
            return np.asarray(v)
        free = A[:, (y @ A >= box.low) & (y @ A <= box.high)]
        ahead = np.linalg.solve(free @ free.T + damping * np.eye(len(A)), missing)
        share = 1.0
        while share > 1e-3:  # shorter steps are none: the matrix is damped instead
            nearer = at(y + share * ahead)
            # share of the promised gain that a step must bring
            if nearer[2] >= value + 1e-4 * share * float(ahead @ missing):
                break
            share /= 2
        else:
            damping *= 100
            continue
        damping = max(damping / 10, least)
        y = y + share * ahead
        v, missing, value = nearer
    return None


def solve(c: Array, M: Array, m: Array, low: Array, high: Array, bases: Indices | None = None) -> Ends:
    """Return where the method ends for each program.

    Args:
        c: shape (B, N).
        M: shape (k, N).
        m: shape (B, k).
        low: finite, shape (B, N).
        high: finite, at least `low`, shape (B, N).
        bases: to start from, shape (B, k); default: the unit vectors.

    Returns:
        Variables within their bounds, (B, N); multipliers, (B, k); directions of y that show that no variables meet
        the equations, zero where none was found, (B, k); the variables of each basis, to start from for costs that
        differ a little, (B, k).
    """
    (programs, N), k, box = c.shape, len(M), (low, high)
    M, unit = np.concatenate([M, np.eye(k)], axis=1), np.zeros((programs, k))
    c, low, high = (np.concatenate([x, unit], axis=1) for x in (c, low, high))
    basis = np.tile(np.arange(N, N + k), (programs, 1)) if bases is None else bases.copy()
    bases, left = basis.copy(), np.arange(programs)
    v, y, rays, at_high = np.zeros_like(c), unit.copy(), unit.copy(), np.zeros(c.shape, dtype=bool)
    for step in range(100 + k + N // 10):  # 100 more than one per equation and per ten variables
        rows = np.arange(len(left))
        at = rows[:, None], basis
        try:
            inverse = np.linalg.inv(M.T[basis].transpose(0, 2, 1))
        except np.linalg.LinAlgError:  # a singular basis
            break
        y[left] = (c[at][:, None] @ inverse)[:, 0]
        r = c - y[left] @ M
        r[at] = 0.0
        if step == 0:
            at_high = r > 0
        outside = np.where(at_high, high, low)
        outside[at] = 0.0
        inside = (inverse @ (m - outside @ M.T)[:, :, None])[:, :, 0]
        v[left] = outside
        v[left[:, None], basis] = inside
        below = low[at] - inside
        beyond = np.maximum(below, inside - high[at])
        scale = (high - low).max(axis=1)
        slot = np.argmax(beyond / np.linalg.norm(inverse, axis=2), axis=1)
        # largest final violation of bounds, in units of the largest range of any
        optimal = beyond.max(axis=1) <= 1e-11 * scale
        rho = inverse[rows, slot]
        sign = np.where(below[rows, slot] > 0, 1.0, -1.0)
        alpha = sign[:, None] * (rho @ M)
        free = high > low
        free[at] = False
        entering, passed, enters = _breakpoints(r, alpha, beyond[rows, slot], at_high, free, high - low)
        move = ~optimal & enters
        rays[left] = np.where((~optimal & ~enters)[:, None], -sign[:, None] * rho, 0.0)
        at_high ^= passed & move[:, None]
        at_high[rows[move], basis[rows, slot][move]] = sign[move] < 0
        basis[rows[move], slot[move]] = entering[move]
        bases[left] = basis
        left = left[move]
        if not len(left):
            break
        if not move.all():
            c, m, low, high, basis, at_high = (x[move] for x in (c, m, low, high, basis, at_high))
    return np.clip(v[:, :N], *box), y, rays, bases


def _breakpoints(
    r: Array, alpha: Array, missing: Array, at_high: NDArray[np.bool_], free: NDArray[np.bool_], width: Array
) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which variable enters, which ones are passed and change their bound, and whether any enters."""
    towards = np.where(at_high, alpha, -alpha)
    # smallest pivot, in units of the largest of its row
    blocks = free & (towards > 1e-9 * np.abs(alpha).max(axis=1, keepdims=True))
    at = np.where(blocks, np.abs(r) / np.where(blocks, towards, 1.0), np.inf)
    order = np.argsort(at, axis=1, kind="stable")
    rows = np.arange(len(order))[:, None]
    gained = np.cumsum(np.where(blocks, towards * width, 0.0)[rows, order], axis=1)
    turns = gained >= (1 - 1e-10) * missing[:, None]  # the others need not make up for rounding
    first = np.argmax(turns, axis=1)
    rank = np.empty_like(order)
    rank[rows, order] = np.arange(order.shape[1])
    return order[rows[:, 0], first], blocks & (rank < first[:, None]), turns[:, -1]

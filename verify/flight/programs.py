"""Linear and quadratic programs whose solutions are proven: a primal and a dual point in hand for each.

    maximise c . v  such that  M v = m,  low <= v <= high

| symbol | meaning | shape |
|---|---|---|
| v | a primal point: within its bounds, and M v = m to RESIDUAL | (N,) |
| y | a dual point, any at all | (k,) |
| w | c - y M | (N,) |
| h(c) | the greatest value: c . v <= h(c) <= sum_j max(low_j w_j, high_j w_j) + y . m | |

So values are bracketed whoever found the points. Equations have no solution within TOLERANCE, the audit's own, if
some y with sum |y| = 1 has y . m - sum_j max(low_j w_j, high_j w_j) > TOLERANCE with w = y M. `simplex` solves all
programs of one kind at once; what its points do not decide HiGHS solves again, one by one.

The least inputs that produce a wrench are a quadratic program:

    minimise |v|^2 / 2  such that  A v = b,  low <= v <= high

| symbol | meaning | shape |
|---|---|---|
| A, b | wrench map and wrench | (6, N), (6,) |
| y | multipliers; the best v for them is A^T y, clipped to the bounds | (6,) |
| L(y) | |v|^2 / 2 - y . (A v - b) at that v: never more than the least |v|^2 / 2 | |

L is concave, and its gradient b - A v. Newton's method finds where it vanishes: v is then the answer, proven.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from topo_search.model.tolerances import TOLERANCE
from verify.bodies import Array
from verify.flight.simplex import solve
from verify.meshes import Indices

LARGEST = 1e6
"""Forces in m_t g and torques in l_arm m_t g beyond it have lost the digits that programs need."""
RESIDUAL = 1e-9
"""Tolerance of a primal point's equations: a thousandth of TOLERANCE."""
GAP = 1e-8
"""Distance of both bounds up to which a value counts as found."""
ROUNDING = 1e-15
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
        return np.asarray(greatest + ROUNDING * w.shape[-1] * size)


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
    result = solve(c, M, m, bounds.low, bounds.high, bases)
    judged = _bracket(c, M, m, bounds, result.v, result.y, result.bases)
    loose = np.flatnonzero(~(judged.upper - judged.attained <= GAP))
    if not len(loose):
        return judged
    v, y = result.v.copy(), result.y.copy()
    for row in loose:
        solution = linprog(
            -c[row], A_eq=M, b_eq=m[row], bounds=np.stack([bounds.low[row], bounds.high[row]], axis=1)
        )
        if solution.status == 0:
            v[row] = np.clip(solution.x, bounds.low[row], bounds.high[row])
            y[row] = -solution.eqlin.marginals
    again = _bracket(c, M, m, bounds, v, y, result.bases)
    better = again.attained > judged.attained
    return Greatest(
        np.where(better[:, None], again.v, judged.v),
        np.maximum(judged.attained, again.attained),
        np.minimum(judged.upper, again.upper),
        result.bases,
    )


def _bracket(c: Array, M: Array, m: Array, box: Box, v: Array, y: Array, bases: Indices) -> Greatest:
    met = np.abs(v @ M.T - m).max(axis=1, initial=0.0) <= RESIDUAL
    beside = np.sum(y * m, axis=1) + ROUNDING * M.shape[0] * np.sum(np.abs(y * m), axis=1)
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
    result = solve(c, M, m, bounds.low, bounds.high, bases)
    v = result.v
    yes, no = _meets(M, m, v), _excludes(M, m, bounds, result.rays)
    for row in np.flatnonzero(~yes & ~no):
        v[row], y = nearest(M, m[row], bounds.low[row], bounds.high[row])
        one = slice(row, row + 1)
        yes[one] = _meets(M, m[one], v[one])
        no[one] = _excludes(M, m[one], Box(bounds.low[one], bounds.high[one]), y[None])
    return Solvable(yes, no, v, result.bases)


def _meets(M: Array, m: Array, v: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(v @ M.T - m).max(axis=1) <= TOLERANCE)


def _excludes(M: Array, m: Array, box: Box, y: Array) -> NDArray[np.bool_]:
    """Return whether each y shows that nothing within the bounds meets the equations to TOLERANCE."""
    size = np.sum(np.abs(y), axis=1, keepdims=True)
    y = y / np.where(size > 0, size, 1.0)
    beside = np.sum(y * m, axis=1) - ROUNDING * M.shape[0] * np.sum(np.abs(y * m), axis=1)
    return np.asarray(beside - box.greatest(y @ M) > TOLERANCE)


def nearest(M: Array, m: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return by HiGHS the v that misses no equation by more than it must, and the multipliers that show it."""
    k, N = M.shape
    A = np.block([[M, -np.ones((k, 1))], [-M, -np.ones((k, 1))]])
    bounds = [*zip(low.tolist(), high.tolist(), strict=True), (0.0, None)]
    solution = linprog(np.append(np.zeros(N), 1.0), A_ub=A, b_ub=np.concatenate([m, -m]), bounds=bounds)
    if solution.status != 0:
        return low, np.zeros(k)
    over, under = solution.ineqlin.marginals[:k], solution.ineqlin.marginals[k:]
    return np.clip(solution.x[:N], low, high), np.asarray(over - under)


STEPS = 100
"""Largest number of steps."""
DAMPING = 1e-12
"""Added to the matrix of a step, in units of its largest entry: some wrenches may have no free rotors."""
SHORTEST = 1e-3
"""Shortest share of a step; where none is short enough, the matrix is damped a hundred times as much."""
ARMIJO = 1e-4
"""Share of the promised gain that a step must bring."""


def least_inputs(A: Array, b: Array, box: Box) -> Array | None:
    """Return the least inputs, shape (N,), each equation met to RESIDUAL; None if they are not found."""

    def at(y: Array) -> tuple[Array, Array, float]:
        v = np.clip(y @ A, box.low, box.high)
        missing = b - A @ v
        return v, missing, float(v @ v / 2 + y @ missing)

    y = np.zeros(len(A))
    v, missing, value = at(y)
    damping = least = max(DAMPING * float(np.abs(A @ A.T).max()), 1e-300)
    for _ in range(STEPS):
        if np.abs(missing).max() <= RESIDUAL:
            return np.asarray(v)
        free = A[:, (y @ A >= box.low) & (y @ A <= box.high)]
        ahead = np.linalg.solve(free @ free.T + damping * np.eye(len(A)), missing)
        share = 1.0
        while share > SHORTEST:
            nearer = at(y + share * ahead)
            if nearer[2] >= value + ARMIJO * share * float(ahead @ missing):
                break
            share /= 2
        else:
            damping *= 100
            continue
        damping = max(damping / 10, least)
        y = y + share * ahead
        v, missing, value = nearer
    return None

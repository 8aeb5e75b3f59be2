"""Linear and quadratic programs with proven solutions: each has a primal and a dual point.

    maximise c . v  such that  M v = m,  low <= v <= high

| symbol | meaning | shape |
|---|---|---|
| v | primal point, within its bounds and with M v = m to RESIDUAL | (N,) |
| y | dual point, arbitrary | (k,) |
| w | reduced costs, c - y M | (N,) |
| h(c) | maximum: c . v <= h(c) <= sum_j max(low_j w_j, high_j w_j) + y . m | |

So the bracket is valid whatever solver found the points. The equations have no solution within TOLERANCE, the
audit's own, if some y with sum |y| = 1 has y . m - sum_j max(low_j w_j, high_j w_j) > TOLERANCE with w = y M.
`solve` takes all programs of one kind in a batch; HiGHS solves again, one by one, those that its points do not
decide.

The least inputs that produce a wrench are a convex program:

    minimise sum_j |v_j|^p / p  such that  A v = b,  low <= v <= high

| symbol | meaning | shape |
|---|---|---|
| A, b | wrench map and wrench | (6, N), (6,) |
| p, q | 2 for effort, 1.5 for power; 1 / (p - 1) | |
| y | multipliers; the minimising v_j is w |w|^(q - 1) with w = (A^T y)_j, clipped to the bounds | (6,) |
| L(y) | dual function, sum_j |v_j|^p / p - y . (A v - b) at that v; a lower bound on the minimum | |

L is concave with gradient b - A v. Newton's method finds its zero, where v is proven optimal.

`solve` solves many small linear programs at once, by the dual simplex method for bounded variables:

| symbol | meaning | shape |
|---|---|---|
| B, N, k | programs, variables, equations | |
| M | equations common to all programs, and k unit columns for slack variables fixed at zero | (k, N + k) |
| y | multipliers of the equations | (B, k) |
| r | reduced costs, c - y M: a nonbasic v is at `high` if r > 0, at `low` if r < 0 | (B, N + k) |
| rho | row of the inverse basis for the leaving variable: the direction in which y moves | (B, k) |

Every variable has two bounds, so every basis is dual feasible, the slack basis is a valid start, and no first phase
is needed. A step passes all breakpoints at which the dual objective still decreases (long-step rule), so the number
of steps hardly grows with N. The result need not be trusted, because it is checked.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from topo_search.model import Array, Flags, Indices
from topo_search.model.proven import TOLERANCE
from verify.bodies import norms

Splits = Sequence[int]
SimplexResult = tuple[Array, Array, Array, Indices]

LARGEST = 1e6
"""Larger forces [m_t g] and torques [l_arm m_t g] are too imprecise for the programs."""
RESIDUAL = 1e-9
"""Tolerance of a primal point's equations, a thousandth of TOLERANCE."""
GAP = 1e-8
"""Largest gap between the bounds of a solved program."""
SUM_ROUNDING = 1e-15
"""Rounding error of a sum per term, relative to the sum of absolute values."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds on the variables."""

    low: Array
    """Shape (N,), or one row per program."""
    high: Array

    def rows(self, programs: int) -> Bounds:
        """Return the bounds with one row per program."""
        shape = programs, self.low.shape[-1]
        return Bounds(np.broadcast_to(self.low, shape), np.broadcast_to(self.high, shape))

    def greatest(self, w: Array) -> Array:
        """Return upper bounds on w . v within the box, rounding included, shape (B,)."""
        size = np.sum(np.abs(w) * np.maximum(np.abs(self.low), np.abs(self.high)), axis=-1)
        greatest = np.sum(np.maximum(self.low * w, self.high * w), axis=-1)
        return np.asarray(greatest + SUM_ROUNDING * w.shape[-1] * size)


@dataclass(frozen=True, eq=False)
class Maxima:
    """Maxima of B programs, with proven bounds."""

    v: Array
    """Primal points, shape (B, N)."""
    attained: Array
    """Lower bounds c . v; minus infinity if v violates the equations, shape (B,)."""
    upper: Array
    """Upper bounds, shape (B,)."""
    bases: Indices
    """Final bases, warm starts for slightly different costs, shape (B, k)."""


def greatest(
    c: Array, M: Array | list[Array], m: Array, box: Bounds, bases: Indices | None = None, splits: Splits = ()
) -> Maxima:
    """Return the greatest c . v of each program.

    Args:
        c: shape (B, N).
        M: shape (k, N), or one for each of G groups of consecutive programs.
        m: shape (B, k).
        box: bounds on the variables of all programs.
        bases: initial bases, shape (B, k).
        splits: number of the first program of every group, then B; needed if there are groups.
    """
    bounds = box.rows(len(c))
    if isinstance(M, np.ndarray):
        M, splits = [M], (0, len(c))
    v, y, _, bases = solve(c, M, m, bounds.low, bounds.high, bases, splits)
    maxima = _bracket(c, M, m, bounds, v, y, bases, splits)
    loose = np.flatnonzero(~(maxima.upper - maxima.attained <= GAP))
    if not len(loose):
        return maxima
    from scipy.optimize import linprog  # slow to load, and few programs need it

    v, y = v.copy(), y.copy()
    for row in loose:
        group, limits = bisect_right(splits, row) - 1, np.stack([bounds.low[row], bounds.high[row]], axis=1)
        solution = linprog(-c[row], A_eq=M[group], b_eq=m[row], bounds=limits)
        if solution.status == 0:
            v[row] = np.clip(solution.x, bounds.low[row], bounds.high[row])
            y[row] = -solution.eqlin.marginals
    by_highs = _bracket(c, M, m, bounds, v, y, bases, splits)
    better = by_highs.attained > maxima.attained
    return Maxima(
        np.where(better[:, None], by_highs.v, maxima.v),
        np.maximum(maxima.attained, by_highs.attained),
        np.minimum(maxima.upper, by_highs.upper),
        bases,
    )


def _bracket(
    c: Array, M: list[Array], m: Array, box: Bounds, v: Array, y: Array, bases: Indices, splits: Splits
) -> Maxima:
    """Return the proven bounds that primal and dual points give."""
    is_feasible = np.abs(times(v, [matrix.T for matrix in M], splits) - m).max(axis=1, initial=0.0) <= RESIDUAL
    y_m = np.sum(y * m, axis=1) + SUM_ROUNDING * m.shape[1] * np.sum(np.abs(y * m), axis=1)
    upper = box.greatest(c - times(y, M, splits)) + y_m
    attained = np.where(is_feasible, np.sum(c * v, axis=1), -np.inf)
    return Maxima(v, attained, np.where(np.isnan(upper), np.inf, upper), bases)


@dataclass(frozen=True, eq=False)
class Solvable:
    """Solvability of equations within bounds, to the audit's tolerance."""

    yes: Flags
    """True if v is proven to be a solution, shape (B,)."""
    no: Flags
    """True if it is proven that there is no solution, shape (B,); undecided if neither."""
    v: Array
    """Shape (B, N)."""


def find_solutions(M: Array, m: Array, box: Bounds) -> Solvable:
    """Return for each m, shape (B, k), whether M v = m has a solution within bounds, each equation to TOLERANCE."""
    bounds = box.rows(len(m))
    # any costs would do; distinct ones make the solution a unique vertex
    c = np.broadcast_to(-1.0 - np.arange(M.shape[1]) / M.shape[1], (len(m), M.shape[1]))
    v, _, rays, _ = solve(c, [M], m, bounds.low, bounds.high, None, (0, len(c)))
    yes, no = _is_solution(M, m, v), _is_infeasible(M, m, bounds, rays)
    for row in np.flatnonzero(~yes & ~no):
        v[row], y = nearest(M, m[row], bounds.low[row], bounds.high[row])
        single = slice(row, row + 1)
        yes[single] = _is_solution(M, m[single], v[single])
        no[single] = _is_infeasible(M, m[single], Bounds(bounds.low[single], bounds.high[single]), y[None])
    return Solvable(yes, no, v)


def _is_solution(M: Array, m: Array, v: Array) -> Flags:
    return np.asarray(np.abs(v @ M.T - m).max(axis=1) <= TOLERANCE)


def _is_infeasible(M: Array, m: Array, box: Bounds, y: Array) -> Flags:
    """Return whether each y proves that no v within the bounds solves the equations to TOLERANCE."""
    norm = np.sum(np.abs(y), axis=1, keepdims=True)
    y = y / np.where(norm > 0, norm, 1.0)
    y_m = np.sum(y * m, axis=1) - SUM_ROUNDING * M.shape[0] * np.sum(np.abs(y * m), axis=1)
    return np.asarray(y_m - box.greatest(y @ M) > TOLERANCE)


def nearest(M: Array, m: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the v with the smallest maximum error of the equations, by HiGHS, and the optimal multipliers."""
    from scipy.optimize import linprog  # slow to load, and few programs need it

    k, N = M.shape
    A = np.block([[M, -np.ones((k, 1))], [-M, -np.ones((k, 1))]])
    bounds = [*zip(low.tolist(), high.tolist(), strict=True), (0.0, None)]
    solution = linprog(np.append(np.zeros(N), 1.0), A_ub=A, b_ub=np.concatenate([m, -m]), bounds=bounds)
    if solution.status != 0:
        return low, np.zeros(k)
    over, under = solution.ineqlin.marginals[:k], solution.ineqlin.marginals[k:]
    return np.clip(solution.x[:N], low, high), np.asarray(over - under)


def least_inputs(A: Array, b: Array, box: Bounds, p: float = 2.0) -> tuple[Array | None, float]:
    """Return the inputs with the least sum of |v|^p, and a lower bound on that sum.

    Args:
        A: wrench map, shape (6, N).
        b: wrench, shape (6,).
        box: bounds on the inputs.
        p: 2 for effort, 1.5 for power.

    Returns:
        Inputs, shape (N,), with each equation met to RESIDUAL, or None if not found; p L(y) for the last y.
    """
    q = 1 / (p - 1)

    def evaluate(y: Array) -> tuple[Array, Array, Array, float]:
        w = y @ A
        free = np.sign(w) * np.abs(w) ** q
        v = np.clip(free, box.low, box.high)
        slopes, gradient = np.where(v == free, q * np.abs(w) ** (q - 1), 0.0), b - A @ v
        return v, slopes, gradient, float(np.sum(np.abs(v) ** p) / p + y @ gradient)

    y, found = np.zeros(len(A)), None
    v, slopes, gradient, value = evaluate(y)
    # relative to the largest entry; the Hessian is singular if all rotors of a wrench are at a bound
    damping = least_damping = max(1e-12 * float(np.abs(A @ A.T).max()), 1e-300)
    for _ in range(100):
        if np.abs(gradient).max() <= RESIDUAL:
            found = v
            break
        step = np.linalg.solve((A * slopes) @ A.T + damping * np.eye(len(A)), gradient)
        step_size = 1.0
        while step_size > 1e-3:  # rather than shorten the step further, increase the damping
            trial = evaluate(y + step_size * step)
            # sufficient increase, as a share of the predicted one
            if trial[-1] >= value + 1e-4 * step_size * float(step @ gradient):
                break
            step_size /= 2
        else:
            damping *= 100
            continue
        damping = max(damping / 10, least_damping)
        y = y + step_size * step
        v, slopes, gradient, value = trial
    size = p * (np.sum(np.abs(v) ** p) + np.abs(y) @ (np.abs(b) + np.abs(A) @ np.abs(v)))
    return found, p * value - SUM_ROUNDING * len(v) * float(size)


def times(x: Array, M: Sequence[Array] | Array, splits: Splits) -> Array:
    """Return the products x_i M of the rows (B, a) with the G matrices (a, b) of their groups, shape (B, b)."""
    return np.concatenate([x[i:j] @ matrix for i, j, matrix in zip(splits, splits[1:], M, strict=False)])


def solve(
    c: Array, M: list[Array], m: Array, low: Array, high: Array, bases: Indices | None, splits: Splits
) -> SimplexResult:
    """Run the dual simplex method on a batch of programs.

    Args:
        c: shape (B, N).
        M: one for each of G groups of programs, shape (k, N).
        m: shape (B, k).
        low: finite, shape (B, N).
        high: finite, at least `low`, shape (B, N).
        bases: initial bases, shape (B, k); None: the slack basis.
        splits: number of the first program of every group, then B.

    Returns:
        Variables within their bounds, (B, N); multipliers, (B, k); dual rays that prove infeasibility, zero if none
        was found, (B, k); final bases, warm starts for slightly different costs, (B, k).
    """
    (programs, N), k, box, firsts = c.shape, m.shape[1], (low, high), splits
    matrices, zeros = np.array([np.hstack([matrix, np.eye(k)]) for matrix in M]), np.zeros((programs, k))
    columns, group = matrices.swapaxes(1, 2), np.repeat(np.arange(len(M)), np.diff(splits))
    data = np.array([np.hstack([x, zeros]) for x in (c, low, high, high - low)])
    basis = np.tile(np.arange(N, N + k), (programs, 1)) if bases is None else bases.copy()
    bases, active = basis.copy(), np.arange(programs)
    v, y, rays = np.zeros((programs, N + k)), zeros, zeros.copy()
    for step in range(100 + k + N // 10):  # 100 more than one per equation and per ten variables
        (c, low, high, width), rows = data, np.arange(len(active))
        basic = rows[:, None], basis
        try:
            inverse = np.linalg.inv(columns[group[active, None], basis].transpose(0, 2, 1))
        except np.linalg.LinAlgError:  # a singular basis
            break
        y[active] = multipliers = (c[basic][:, None] @ inverse)[:, 0]
        r = c - times(multipliers, matrices, splits)
        r[basic] = 0.0
        if step == 0:
            at_high = r > 0
        x = np.where(at_high, high, low)
        x[basic] = 0.0
        x[basic] = basics = (inverse @ (m - times(x, columns, splits))[:, :, None])[:, :, 0]
        v[active] = x
        below = low[basic] - basics
        violation = np.maximum(below, basics - high[basic])
        slot = np.argmax(violation / norms(inverse), axis=1)
        # tolerance on the bounds, relative to the largest range
        optimal = violation.max(axis=1) <= 1e-11 * width.max(axis=1)
        rho, leaving = inverse[rows, slot], basis[rows, slot]
        sign = np.where(below[rows, slot] > 0, 1.0, -1.0)[:, None]
        alpha = sign * times(rho, matrices, splits)
        free = width > 0
        free[basic] = False
        entering, passed, enters = _breakpoints(r, alpha, violation[rows, slot], at_high, free, width)
        move = ~optimal & enters
        at_high ^= passed
        at_high[rows, leaving] = sign[:, 0] < 0
        basis[rows, slot] = np.where(move, entering, leaving)
        bases[active] = basis
        if not move.all():
            stuck, rows = ~(optimal | enters), np.flatnonzero(move)
            rays[active[stuck]] = (-sign * rho)[stuck]
            active, m, basis, at_high, data = active[rows], m[rows], basis[rows], at_high[rows], data[:, rows]
            splits = np.searchsorted(active, firsts).tolist()
            if not len(active):
                break
    return np.clip(v[:, :N], *box), y, rays, bases


def _breakpoints(
    r: Array, alpha: Array, violation: Array, at_high: Flags, free: Flags, width: Array
) -> tuple[Indices, Flags, Flags]:
    """Return the entering variable, the variables that are passed and flip their bound, and whether any enters."""
    rate = np.where(at_high, alpha, -alpha)
    # smallest pivot relative to the largest of its row
    blocks = free & (rate > 1e-9 * np.abs(alpha).max(axis=1, keepdims=True))
    ratio = np.where(blocks, np.abs(r) / np.where(blocks, rate, 1.0), np.inf)
    order = np.argsort(ratio, axis=1, kind="stable")
    rows = np.arange(len(order))[:, None]
    reduction = np.cumsum(np.where(blocks, rate * width, 0.0)[rows, order], axis=1)
    is_enough = reduction >= (1 - 1e-10) * violation[:, None]  # no further flips for mere rounding
    first = np.argmax(is_enough, axis=1)
    passed = np.empty_like(blocks)
    passed[rows, order] = np.arange(order.shape[1]) < first[:, None]
    return order[rows[:, 0], first], blocks & passed, is_enough[:, -1]

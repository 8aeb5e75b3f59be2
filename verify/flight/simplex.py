"""Many small linear programs at once, by the dual simplex method for variables with bounds.

    maximise c . v  such that  M v = m,  low <= v <= high

| symbol | meaning | shape |
|---|---|---|
| B, N, k | programs, variables, equations | |
| M | equations of all programs, and k unit vectors, whose variables are zero | (k, N + k) |
| y | multipliers of the equations | (B, k) |
| r | reduced costs, c - y M: outside the basis v is at `high` where r > 0, at `low` where r < 0 | (B, N + k) |
| rho | row of the inverse basis that belongs to the leaving variable: the direction in which y moves | (B, k) |

Every variable has two bounds, so that every basis is dual feasible and the unit vectors are one to start from: no
first phase. A step goes past all breakpoints at which the dual objective still falls (the long step rule), so that
the number of steps hardly grows with N. Nothing that this finds has to be believed: `verify.flight.programs` proves
each answer, and asks HiGHS where it cannot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verify.bodies import Array
from verify.meshes import Indices

FEASIBLE = 1e-11
"""Largest final violation of a variable's bounds, in units of the largest range of any."""
PIVOT = 1e-9
"""Smallest pivot, in units of the largest of its row."""
ROUNDING = 1e-10
"""Share of what a variable misses its bound by that the others need not make up for."""
STEPS = 100
"""Largest number of steps, beside one per equation and one per ten variables."""


@dataclass(frozen=True, eq=False)
class Ends:
    """Final state of the method, one row per program."""

    v: Array
    """Variables, within their bounds, shape (B, N)."""
    y: Array
    """Multipliers, shape (B, k)."""
    rays: Array
    """Directions of y that show that no variables meet the equations; zero where none was found, shape (B, k)."""
    bases: Indices
    """The variables of each basis: where to start from for costs that differ a little, shape (B, k)."""


def solve(c: Array, M: Array, m: Array, low: Array, high: Array, bases: Indices | None = None) -> Ends:
    """Return where the method ends for each program.

    Args:
        c: shape (B, N).
        M: shape (k, N).
        m: shape (B, k).
        low: finite, shape (B, N).
        high: finite, at least `low`, shape (B, N).
        bases: to start from, shape (B, k); default: the unit vectors.
    """
    programs, (k, N) = len(c), M.shape
    unit = np.zeros((programs, k))
    if bases is None:
        bases = np.tile(np.arange(N, N + k), (programs, 1))
    state = _State(
        np.concatenate([c, unit], axis=1),
        np.concatenate([M, np.eye(k)], axis=1),
        m,
        np.concatenate([low, unit], axis=1),
        np.concatenate([high, unit], axis=1),
        bases,
    )
    bases = bases.copy()
    v, y, rays = np.zeros((programs, N + k)), np.zeros((programs, k)), np.zeros((programs, k))
    numbers = np.arange(programs)
    for _ in range(STEPS + k + N // 10):
        if not len(numbers):
            break
        try:
            ended, ray = state.step()
        except np.linalg.LinAlgError:  # a singular basis
            break
        v[numbers], y[numbers], rays[numbers], bases[numbers] = state.v, state.y, ray, state.basis
        numbers = numbers[~ended]
        state.keep(~ended)
    return Ends(np.clip(v[:, :N], low, high), y, rays, bases)


class _State:
    """The programs that have not ended."""

    def __init__(self, c: Array, M: Array, m: Array, low: Array, high: Array, basis: Indices) -> None:
        self.c, self.M, self.m, self.low, self.high = c, M, m, low, high
        self.basis, self.in_basis = basis.copy(), np.zeros(c.shape, dtype=bool)
        self.in_basis[np.arange(len(c))[:, None], basis] = True
        self.at_high: NDArray[np.bool_] | None = None
        self.v, self.y = np.zeros_like(c), np.zeros_like(m)

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Go on with some programs only."""
        if not rows.all():
            for name in ("c", "m", "low", "high", "basis", "in_basis", "at_high"):
                setattr(self, name, getattr(self, name)[rows])

    def step(self) -> tuple[NDArray[np.bool_], Array]:
        """Make a step; return which programs have ended, and the rays of those without feasible variables."""
        rows = np.arange(len(self.c))
        at = rows[:, None], self.basis
        inverse = np.linalg.inv(self.M.T[self.basis].transpose(0, 2, 1))
        self.y = (self.c[at][:, None] @ inverse)[:, 0]
        r = self.c - self.y @ self.M
        r[at] = 0.0
        if self.at_high is None:
            self.at_high = r > 0
        self.v = np.where(self.at_high, self.high, self.low)
        self.v[at] = 0.0
        inside = (inverse @ (self.m - self.v @ self.M.T)[:, :, None])[:, :, 0]
        self.v[at] = inside
        below = self.low[at] - inside
        beyond = np.maximum(below, inside - self.high[at])
        scale = (self.high - self.low).max(axis=1)
        slot = np.argmax(beyond / np.linalg.norm(inverse, axis=2), axis=1)
        missing = beyond[rows, slot]
        optimal = beyond.max(axis=1) <= FEASIBLE * scale
        rho = inverse[rows, slot]
        sign = np.where(below[rows, slot] > 0, 1.0, -1.0)
        alpha = sign[:, None] * (rho @ self.M)
        entering, passed, enters = self._breakpoints(r, alpha, missing, self.at_high)
        ended = optimal | ~enters
        move = ~ended
        leaving = self.basis[rows, slot]
        self.at_high ^= passed & move[:, None]
        self.in_basis[rows[move], leaving[move]] = False
        self.at_high[rows[move], leaving[move]] = sign[move] < 0
        self.basis[rows[move], slot[move]] = entering[move]
        self.in_basis[rows[move], entering[move]] = True
        return ended, np.where((~optimal & ~enters)[:, None], -sign[:, None] * rho, 0.0)

    def _breakpoints(
        self, r: Array, alpha: Array, missing: Array, at_high: NDArray[np.bool_]
    ) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which variable enters, which ones are passed and change their bound, and whether any enters."""
        width = self.high - self.low
        towards = np.where(at_high, alpha, -alpha)
        blocks = ~self.in_basis & (width > 0) & (towards > PIVOT * np.abs(alpha).max(axis=1, keepdims=True))
        at = np.where(blocks, np.abs(r) / np.where(blocks, towards, 1.0), np.inf)
        order = np.argsort(at, axis=1, kind="stable")
        rows = np.arange(len(order))[:, None]
        gained = np.cumsum(np.where(blocks, towards * width, 0.0)[rows, order], axis=1)
        turns = gained >= (1 - ROUNDING) * missing[:, None]
        enters = turns[:, -1]
        first = np.argmax(turns, axis=1)
        rank = np.empty_like(order)
        rank[rows, order] = np.arange(order.shape[1])
        passed = blocks & (rank < first[:, None])
        return order[rows[:, 0], first], passed, enters

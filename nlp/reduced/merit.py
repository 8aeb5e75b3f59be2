r"""The reduced problem at a point: value, rows and derivatives, and the augmented Lagrangian made of them.

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

from nlp.reduced.arrays import Mask, ReducedProblem
from nlp.reduced.clearance import OFFSET_B, P_I, P_J, TIP, TURN_I, Z_I, Z_J, clearances
from nlp.reduced.inputs import effort
from nlp.reduced.platform import Moved, Platform, motion, platform
from nlp.reduced.speeds import speed_rows
from nlp.requirements.kinds import AIR, APART, OFFSET, PARTS
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

NEAR = 4.0
"""Rows with less clearance have a gradient [l_arm]: a step moves no module that far into another's way."""


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
def evaluate(stated: ReducedProblem, x: Array, mu: Array, counting: Mask, rho: float) -> Evaluated:
    """Return the reduced problem at x with the load cases that count; the search for the inputs begins at mu."""
    N, m, K, n = len(x), len(stated.rows.least), len(stated.cases.effort), len(stated.tree.parent)
    at = platform(stated, x)
    by = motion(stated, at)
    dV, found, u = np.zeros(N), mu.copy(), np.empty((K, 4 * n))
    V = effort(stated, at, by, counting, rho, found, u, dV)
    g, J, near, local = np.empty(m), np.zeros((m, N)), np.zeros(m, np.bool_), np.empty((m, 7, 3))
    clearances(stated, at, g, local)
    _slopes(stated, at, by, g, local, J, near)
    if len(stated.speeds.case):
        speed_rows(stated, at, by, counting, rho, found, u, g, J, near)
    return Evaluated(x, V, dV, g, J, near, found, counting)


@njit(cache=True)
def _slopes(stated: ReducedProblem, at: Platform, moved: Moved, g: Array, by: Array, J: Array, near: Mask) -> None:
    """Find which rows are near, and their derivatives by the unknowns from those by vectors.

    What lies between two modules depends on the hinges between them alone.
    """
    kinds, one, other, moves, n = stated.rows.kind, stated.rows.i, stated.rows.j, stated.tree.moves, len(at.p)
    dp, dz, dE, dB, omega = moved.dp, moved.dz, moved.dE, moved.dB, at.omega
    for r in range(len(kinds)):
        if g[r] >= NEAR:
            continue
        near[r] = True
        kind, i, j = kinds[r], one[r], other[r]
        between = kind in (AIR, APART, PARTS)
        for l in range(3 if between else 0, n + 2 if between else J.shape[1]):
            slope, mine = 0.0, l < n + 2 and moves[l, i]
            if between and mine == moves[l, j]:
                continue
            for k in range(3):
                if not between:
                    slope += by[r, TIP, k] * dE[l, k] + by[r, OFFSET_B, k] * dB[l, k]
                    if mine:
                        slope += by[r, TURN_I, k] * omega[l, k]
                elif not mine:
                    slope += by[r, P_J, k] * dp[l, j, k] + by[r, Z_J, k] * dz[l, j, k]
                else:
                    slope += by[r, TURN_I, k] * omega[l, k]
                if mine and kind != OFFSET:
                    slope += by[r, P_I, k] * dp[l, i, k] + by[r, Z_I, k] * dz[l, i, k]
            J[r, l] = slope


@njit(cache=True)
def merit(stated: ReducedProblem, at: Evaluated, multipliers: Array, sigma: float) -> float:
    """Return M."""
    total = at.V
    for r in range(len(at.g)):
        s = multipliers[r] + sigma * (stated.rows.least[r] - at.g[r])
        if s > 0.0:
            total += s * s / (2 * sigma)
        total -= multipliers[r] ** 2 / (2 * sigma)
    return total


@njit(cache=True)
def estimates(stated: ReducedProblem, at: Evaluated, multipliers: Array, sigma: float) -> Array:
    """Return max(0, lambda + sigma (m - g)): the multipliers that M's gradient stands for."""
    found = np.zeros(len(at.g))
    for r in range(len(found)):
        found[r] = max(0.0, multipliers[r] + sigma * (stated.rows.least[r] - at.g[r]))
    return found

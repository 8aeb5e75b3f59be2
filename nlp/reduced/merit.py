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
from numba import njit
from numpy.typing import NDArray

from nlp.reduced.clearance import OFFSET_B, P_I, P_J, TIP, TURN_I, Z_I, Z_J, row
from nlp.reduced.inputs import effort
from nlp.reduced.platform import moved, platform
from nlp.reduced.stated import AIR, APART, OFFSET, PARTS, Stated
from topo_search.model.arrays import Array

NEAR = 4.0
"""Rows with less clearance have a gradient [l_arm]: a step moves no module that far into another's way."""


class Evaluated(NamedTuple):
    """The reduced problem at a point."""

    x: Array
    V: float
    dV: Array
    g: Array
    J: Array
    near: NDArray[np.bool_]
    mu: Array
    """Dual unknowns of the load cases, shape (K, 6): where the next search begins."""


@njit(cache=True)
def evaluate(stated: Stated, x: Array, mu: Array, rho: float) -> Evaluated:
    """Return the reduced problem at x; the search for the inputs begins at mu."""
    N, m, K, n = len(x), len(stated.rows.kind), len(stated.cases.effort), len(stated.tree.parent)
    at = platform(stated, x)
    by = moved(stated, at)
    dV, found, u = np.zeros(N), mu.copy(), np.empty((K, 4 * n))
    V = effort(stated, at, by, rho, found, u, dV)
    g, J, near, local = np.empty(m), np.zeros((m, N)), np.zeros(m, np.bool_), np.empty((7, 3))
    for r in range(m):
        g[r] = row(stated, at, r, local)
        if g[r] >= NEAR:
            continue
        near[r] = True
        i, j, kind = stated.rows.i[r], stated.rows.j[r], stated.rows.kind[r]
        for l in range(N):
            slope = 0.0
            if kind != OFFSET:
                for k in range(3):
                    slope += local[P_I, k] * by.dp[l, i, k] + local[Z_I, k] * by.dz[l, i, k]
            if kind in (AIR, APART, PARTS):
                for k in range(3):
                    slope += local[P_J, k] * by.dp[l, j, k] + local[Z_J, k] * by.dz[l, j, k]
            else:
                for k in range(3):
                    slope += local[TIP, k] * by.dE[l, k] + local[OFFSET_B, k] * by.dB[l, k]
            if kind == PARTS and l < n + 2 and stated.tree.moves[l, i]:
                for k in range(3):
                    slope += local[TURN_I, k] * at.omega[l, k]
            J[r, l] = slope
    return Evaluated(x, V, dV, g, J, near, found)


@njit(cache=True)
def merit(stated: Stated, at: Evaluated, multipliers: Array, sigma: float) -> float:
    """Return M."""
    total = at.V
    for r in range(len(at.g)):
        s = multipliers[r] + sigma * (stated.rows.least[r] - at.g[r])
        if s > 0.0:
            total += s * s / (2 * sigma)
        total -= multipliers[r] ** 2 / (2 * sigma)
    return total


@njit(cache=True)
def estimates(stated: Stated, at: Evaluated, multipliers: Array, sigma: float) -> Array:
    """Return max(0, lambda + sigma (m - g)): the multipliers that M's gradient stands for."""
    found = np.zeros(len(at.g))
    for r in range(len(found)):
        found[r] = max(0.0, multipliers[r] + sigma * (stated.rows.least[r] - at.g[r]))
    return found

r"""Air speeds over regions as rows of the reduced problem.

For each module, region and load case a row has the sum of all speeds at the region's point that is near the
module's axis and, of those, near the module:

.. math::

    g = 1 - \frac{1}{U_{max}} \sum_i U_i(x, u(x))

The inputs are those of the least effort, u = clip(A^T mu). With the free ones j, whose inputs are within bounds,

.. math::

    dg_u \cdot du = \nu \cdot (dw - dA\,u) + \sum_j (\partial_j g_u - a_j \cdot \nu)\, da_j \cdot \mu, \qquad
    (I / \rho' + \sum_j a_j a_j^T)\, \nu = \sum_j a_j\, \partial_j g_u

| symbol | meaning | shape |
|---|---|---|
| U_max | the limit | |
| g_u | derivatives of a sum of speeds by the inputs of its load case | (4n,) |
| A, mu, rho' | see `nlp.reduced.inputs` | |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.numbers.cholesky import solve_in_place
from nlp.numbers.jets import ROUNDED, by_inputs, find_parts, join_parts, point_of_ball
from nlp.reduced.arrays import Mask, ReducedProblem
from nlp.reduced.clearance import GAPS, swept_gap
from nlp.reduced.inputs import add_gradient, add_wrench_gradient, columns, to_unknowns
from nlp.reduced.platform import Moved, Platform
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class RowLimits(NamedTuple):
    """Rows of air speeds."""

    far_down: float = 60.0
    """Length of a module's axis along which its nearest point to a path is sought [l_arm]."""
    slow: float = 0.2
    """Rows farther from their limit, as a share of it, have no gradient."""


ROWS = RowLimits()


@njit(cache=True)
def speed_rows(
    stated: ReducedProblem,
    at: Platform,
    moved: Moved,
    counting: Mask,
    rho: float,
    mu: Array,
    u: Array,
    g: Array,
    J: Array,
    near: Mask,
) -> None:
    """Find the rows of air speeds, the last ones of g, with their Jacobian.

    Args:
        stated: the task and topology.
        at: the platform.
        moved: its derivatives.
        counting: which load cases count, shape (K,).
        rho: price of a squared residual.
        mu: dual unknowns of the load cases, shape (K, 6).
        u: their inputs, shape (K, 4n).
        g: is written to, shape (m,).
        J: is added to, shape (m, N).
        near: which rows have a gradient, shape (m,).
    """
    air, n, first = stated.speeds, len(at.p), len(g) - len(stated.speeds.case)
    jet, A, x, path, p, z = air.jet, columns(stated, at), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    d, q, v, g_u = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 4)), np.empty(4 * n)
    C, dC, no_dC, by_ball = np.empty((n, 9)), np.empty((n, 9, 3)), np.empty((0, 3)), np.empty((3, 6))
    F, T, X, E, by_axis = np.empty((n, 3)), np.empty((n, 3)), np.empty(3), np.empty(3), np.empty(6)
    slopes, no_slopes, no_direction = np.empty(7), np.empty(0), np.zeros(3)
    points = len(air.case) // (air.case[-1] + 1)
    p_E = at.p_E - at.p_COM
    offset = max(GAPS.least_distance, math.sqrt(p_E @ p_E))
    for point in range(points):  # of a region and module, the same in all load cases
        i = air.module[point]
        path[:] = air.path[point] + air.along[point] / offset * p_E
        p[:] = at.p[i] - at.p_E
        z[:] = at.z[i]
        share = 0.0
        if path.any():
            w, zero = p - air.start[point], 0.0
            axis = (-ROWS.far_down * z[0], -ROWS.far_down * z[1], -ROWS.far_down * z[2])
            _, _, share, _, _, _ = swept_gap(
                (w[0], w[1], w[2]), axis, zero, zero, (path[0], path[1], path[2]), zero, zero
            )
        point_of_ball(air.start[point] + share * path, air.radius[point], no_direction, p, z, x, by_ball)
        for j in range(n):
            for a in range(3):
                d[j, a] = x[a] + at.p_E[a] - at.p[j, a]
            for a in range(3):
                q[j, a] = at.R[j, 0, a] * d[j, 0] + at.R[j, 1, a] * d[j, 1] + at.R[j, 2, a] * d[j, 2]
            find_parts(jet, q[j], ROUNDED, C[j], no_dC)
        derived = False
        for r in range(point, len(air.case), points):
            row, k, over, total = first + r, air.case[r], air.over[r], 0.0
            for j in range(n):
                by_inputs(jet, u[k, 4 * j : 4 * j + 4], v[j])
                total += over * join_parts(C[j], no_dC, v[j], ROUNDED, no_slopes)
            g[row] = 1.0 - total
            near[row] = counting[k] and g[row] < ROWS.slow
            if not near[row]:
                continue
            for j in range(0 if derived else n):
                find_parts(jet, q[j], ROUNDED, C[j], dC[j])
            derived, X[:] = True, 0.0
            for j in range(n):
                join_parts(C[j], dC[j], v[j], ROUNDED, slopes)
                for a in range(3):
                    pull = 0.0
                    for b in range(3):
                        pull += at.R[j, a, b] * slopes[b]
                    F[j, a] = over * pull
                    X[a] -= F[j, a]
                for a in range(3):
                    b, c = (a + 1) % 3, (a + 2) % 3
                    T[j, a] = d[j, b] * F[j, c] - d[j, c] * F[j, b]
                for c in range(4):
                    g_u[4 * j + c] = -over * slopes[3 + c] * jet.induced**2 / (2 * v[j, c])
            for b in range(6):
                by_axis[b] = X[0] * by_ball[0, b] + X[1] * by_ball[1, b] + X[2] * by_ball[2, b]
            by_p, by_z = by_axis[:3], by_axis[3:]
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                F[i, a] += by_p[a]
                T[i, a] += z[b] * by_z[c] - z[c] * by_z[b]
                E[a] = X[a] - by_p[a]
            if air.along[r] != 0.0:
                by_path = share * air.along[r] / offset * (X - by_p)
                E += by_path - (by_path @ p_E) / offset**2 * p_E
            _add_inputs(stated, at, A, k, rho, mu[k], u[k], g_u, F, T, E)
            to_unknowns(stated, at, moved, F, T, E, J[row])


@njit(cache=True)
def _add_inputs(
    stated: ReducedProblem,
    at: Platform,
    A: Array,
    k: int,
    rho: float,
    mu: Array,
    u: Array,
    g_u: Array,
    F: Array,
    T: Array,
    E: Array,
) -> None:
    """Add dg_u . du, with du as the platform moves; see the module."""
    rotors, m = stated.rotors, stated.rotors.bodies + stated.rotors.m_E
    H, nu, free = np.zeros((6, 6)), np.zeros(6), np.zeros(len(u))
    for a in range(6):
        H[a, a] = stated.cases.effort[k] / (2 * rho)
    for j in range(len(u)):
        if rotors.u_min < u[j] < rotors.u_max and j != stated.cases.dead[k]:
            for a in range(6):
                nu[a] += A[j, a] * g_u[j]
                for b in range(a + 1):
                    H[a, b] += A[j, a] * A[j, b]
    solve_in_place(H, nu)
    for j in range(len(u)):
        if rotors.u_min < u[j] < rotors.u_max and j != stated.cases.dead[k]:
            free[j] = nu @ A[j] - g_u[j]
    add_wrench_gradient(stated, at, k, 1 / m, nu, u, F, T, E)
    add_gradient(stated, at, 1 / m, mu, free, F, T)

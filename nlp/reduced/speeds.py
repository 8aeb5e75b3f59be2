r"""Air speeds over regions as rows of the reduced problem.

For each module, region and load case a row has the sum of all speeds at the region's point that is near the
module's axis and, of those, near the module:

.. math::

    g = 1 - \frac{1}{U_{max}} \sum_i U_i(x, u(x))

The inputs are those of the least effort, u = clip(A^T mu). Those in U_i have their bend at u_min rounded, with the
slopes b_j, for the speed of a disc is steepest where its input begins; mu follows the free inputs f within bounds:

.. math::

    dg &= \nu \cdot (dw - dA\,u - \sum_f a_f\, da_f \cdot \mu) + \sum_j b_j\, \partial_j g\, da_j \cdot \mu \\
    &\Big(I / \rho' + \sum_f a_f a_f^T\Big)\, \nu = \sum_j b_j\, a_j\, \partial_j g

| symbol | meaning | shape |
|---|---|---|
| U_max | the limit | |
| A, mu, rho' | see `nlp.reduced.inputs` | |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.numbers.cholesky import factor, solve_factored
from nlp.numbers.jets import ROUNDED, by_inputs, find_parts, join_parts, larger, point_of_ball
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
    bend: float = 0.05
    """Width over which speeds round the bend of an input at its least: there its root is steep [u_hover]."""


ROWS = RowLimits()


@njit(cache=True)
def speed_rows(
    problem: ReducedProblem,
    at: Platform,
    moved: Moved,
    rho: float,
    mu: Array,
    u: Array,
    g: Array,
    J: Array,
    near: Mask,
) -> None:
    """Find the rows of air speeds, the last ones of g, with their Jacobian.

    Args:
        problem: the task and topology.
        at: the platform.
        moved: its derivatives.
        rho: price of a squared residual.
        mu: dual unknowns of the load cases, shape (K, 6).
        u: their inputs, shape (K, 4n).
        g: is written to, shape (m,).
        J: is added to, shape (m, N).
        near: which rows have a gradient, shape (m,).
    """
    air, rotors, n = problem.speeds, problem.rotors, len(at.p)
    cases, first, mass = air.case[-1] + 1, len(g) - len(air.case), rotors.bodies + rotors.m_E
    points, jet, A = len(air.case) // cases, air.jet, columns(problem, at)
    path, p, z, no_direction = np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    x, by_ball, share = np.empty((points, 3)), np.empty((points, 3, 6)), np.zeros(points)
    d, q, C, no_dC = np.empty((points, n, 3)), np.empty((points, n, 3)), np.empty((points, n, 9)), np.empty((0, 3))
    p_E = at.p_E - at.p_COM
    offset = max(GAPS.least_distance, math.sqrt(p_E @ p_E))
    for point in range(points):  # of a region and module, the same in all load cases
        i = air.module[point]
        for a in range(3):
            path[a] = air.path[point, a] + air.along[point] / offset * p_E[a]
            p[a], z[a] = at.p[i, a] - at.p_E[a], at.z[i, a]
        if path.any():
            w = (p[0] - air.start[point, 0], p[1] - air.start[point, 1], p[2] - air.start[point, 2])
            axis = (-ROWS.far_down * z[0], -ROWS.far_down * z[1], -ROWS.far_down * z[2])
            _, _, share[point], _, _, _ = swept_gap(w, axis, 0.0, 0.0, (path[0], path[1], path[2]), 0.0, 0.0)
        on_path = air.start[point] + share[point] * path
        point_of_ball(on_path, air.radius[point], no_direction, p, z, x[point], by_ball[point])
        for j in range(n):
            for a in range(3):
                d[point, j, a] = x[point, a] + at.p_E[a] - at.p[j, a]
            for a in range(3):
                q[point, j, a] = 0.0
                for b in range(3):
                    q[point, j, a] += at.R[j, b, a] * d[point, j, b]
            find_parts(jet, q[point, j], ROUNDED, C[point, j], no_dC)
    dC, derived = np.empty((points, n, 9, 3)), np.zeros(points, np.bool_)
    v, rounded, by_dual, weights = np.empty((n, 4)), np.empty(4 * n), np.empty(4 * n), np.empty(4 * n)
    free, slopes, no_slopes = np.empty(4 * n, np.bool_), np.empty(7), np.empty(0)
    H, nu, F, T = np.empty((6, 6)), np.empty(6), np.empty((n, 3)), np.empty((n, 3))
    X, E, by_axis = np.empty(3), np.empty(3), np.empty(6)
    for k in range(cases):
        for j in range(4 * n):
            s = 0.0
            for a in range(6):
                s += A[j, a] * mu[k, a]
            free[j] = rotors.u_min < u[k, j] < rotors.u_max
            rounded[j], by_dual[j] = larger(s, rotors.u_min, ROWS.bend)
            if rounded[j] >= rotors.u_max or j == problem.cases.dead[k]:
                rounded[j], by_dual[j] = 0.0 if j == problem.cases.dead[k] else rotors.u_max, 0.0
        for j in range(n):
            by_inputs(jet, rounded[4 * j : 4 * j + 4], v[j])
            for c in range(4):
                by_dual[4 * j + c] *= jet.induced**2 / (2 * v[j, c])
        factored = False
        for point in range(points):
            row, i, over, total = first + k * points + point, air.module[point], air.over[point], 0.0
            for j in range(n):
                total += over * join_parts(C[point, j], no_dC, v[j], ROUNDED, no_slopes)
            g[row] = 1.0 - total
            near[row] = g[row] < ROWS.slow
            if not near[row]:
                continue
            if not factored:
                H[:] = problem.cases.effort[k] / (2 * rho) * np.eye(6)
                for j in range(4 * n):
                    for a in range(6 if free[j] else 0):
                        for b in range(a + 1):
                            H[a, b] += A[j, a] * A[j, b]
                factor(H, 6)
            for j in range(0 if derived[point] else n):
                find_parts(jet, q[point, j], ROUNDED, C[point, j], dC[point, j])
            factored = derived[point] = True
            nu[:], X[:] = 0.0, 0.0
            for j in range(n):
                join_parts(C[point, j], dC[point, j], v[j], ROUNDED, slopes)
                for a in range(3):
                    F[j, a] = 0.0
                    for b in range(3):
                        F[j, a] += over * at.R[j, a, b] * slopes[b]
                    X[a] -= F[j, a]
                for a in range(3):
                    b, c = (a + 1) % 3, (a + 2) % 3
                    T[j, a] = d[point, j, b] * F[j, c] - d[point, j, c] * F[j, b]
                for c in range(4):
                    weights[4 * j + c] = over * slopes[3 + c] * by_dual[4 * j + c]
                    for a in range(6):
                        nu[a] -= weights[4 * j + c] * A[4 * j + c, a]
            solve_factored(H, nu, 6)
            for j in range(4 * n):
                for a in range(6 if free[j] else 0):
                    weights[j] += nu[a] * A[j, a]
            for b in range(6):
                by_axis[b] = X[0] * by_ball[point, 0, b] + X[1] * by_ball[point, 1, b] + X[2] * by_ball[point, 2, b]
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                F[i, a] += by_axis[a]
                T[i, a] += at.z[i, b] * by_axis[3 + c] - at.z[i, c] * by_axis[3 + b]
                E[a] = X[a] - by_axis[a]
            if air.along[point] != 0.0:
                by_path = share[point] * air.along[point] / offset * E
                E += by_path - (by_path @ p_E) / offset**2 * p_E
            add_wrench_gradient(problem, at, k, 1 / mass, nu, u[k], F, T, E)
            add_gradient(problem, at, 1 / mass, mu[k], weights, F, T)
            to_unknowns(problem, at, moved, F, T, E, J[row])

r"""Air speeds over regions as rows of the reduced problem.

For each module, region and load case, a row is the sum of all speeds at one point of the region. In balls and along
paths it is near the module's axis and, among such points, near the module. Outside cones and in hulls it is chosen
from points next to the axis at some depths: where the module's own air is fastest at equal rotor inputs.

.. math::

    g = -\ln \Big(\frac{1}{U_{max}} \sum_i U_i(x, u(x))\Big)

The inputs are those of minimum effort, u = clip(A^T mu), and mu changes with the free ones f, within their bounds:

.. math::

    dg &= \nu \cdot (dw - dA\,u - \sum_f a_f\, da_f \cdot \mu) + \sum_f \partial_f g\, da_f \cdot \mu \\
    &\Big(I / \rho' + \sum_f a_f a_f^T\Big)\, \nu = \sum_f a_f\, \partial_f g

| symbol | meaning | shape |
|---|---|---|
| U_max | limit of the air speed | |
| A, mu, rho' | see `nlp.reduced.inputs` | |
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba.core.types import NoneType
from numba.extending import overload

from nlp.air import jets
from nlp.air.search_rows import Speeds
from nlp.numbers.cholesky import factor, solve_factored
from nlp.numbers.kinematics import add, cross, row
from nlp.reduced.arrays import ReducedProblem
from nlp.reduced.clearance import GAPS, swept_gap
from nlp.reduced.inputs import add_gradient, add_inertia_gradient, add_wrench_gradient, limit, rotor_wrenches
from nlp.reduced.platform import ReducedPlatform, add_slopes, rotate
from topo_search.compiled_code import njit
from topo_search.model import Array, Flags


class RowLimits(NamedTuple):
    """Settings of the rows of air speeds."""

    far_down: float = 60.0
    """Length of the part of a module's axis that is searched for the point nearest to a path [l_arm]."""
    depths: tuple[float, ...] = (0.0, *np.geomspace(0.5, 60.0, 14).tolist())
    """Depths of the points that are compared for cones and hulls [l_arm]."""
    slow: float = 0.2
    """Value of a row above which it has no gradient."""


ROWS = RowLimits()


def add_speed_rows(*arguments: Any) -> None:
    """Compute the rows of air speeds of a task that limits any; arguments as in `_speed_rows`."""


@overload(add_speed_rows, strict=False)
def _by_type(air: Any, *_: Any) -> Callable[..., None]:
    if isinstance(air, NoneType):
        return lambda air, *arguments: None
    return lambda air, *arguments: _speed_rows(air, *arguments)


@njit(cache=True, inner=True)
def _speed_rows(
    air: Speeds,
    problem: ReducedProblem,
    pose: ReducedPlatform,
    rho: float,
    mu: Array,
    u: Array,
    g: Array,
    J: Array,
    is_near: Flags,
) -> None:
    """Compute the rows of air speeds, the last ones of g, and their Jacobian.

    Args:
        air: the rows.
        problem: the task and topology.
        pose: the platform.
        rho: price of a squared residual.
        mu: dual unknowns of the load cases, shape (K, 6).
        u: inputs of the load cases, shape (K, r n).
        g: output: the rows, shape (m,).
        J: increased by the Jacobian, shape (m, N).
        is_near: output: mask of rows that have a gradient, shape (m,).
    """
    rotors, n, r = problem.rotors, len(pose.p), len(problem.rotors.forces) // len(pose.p)
    cases, first = air.case[-1] + 1, len(g) - len(air.case)
    points, jet, A = len(air.case) // cases, air.jet, rotor_wrenches(problem, pose)
    p, z, no_direction = np.empty(3), np.empty(3), np.zeros(3)
    x, by_point, share = np.empty((points, 3)), np.zeros((points, 3, 9)), np.zeros(points)
    q, C, no_dC = np.empty((points, n, 3)), np.empty((points, n, r)), np.empty((0, 3))
    p_E = pose.p_E
    offset = max(GAPS.min_distance, math.sqrt(p_E @ p_E))
    for point in range(points):  # one per region and module, the same in all load cases
        i, region = air.module[point], _region(air, air.region[point], p_E / offset)
        p[:], z[:] = pose.o[i] - p_E, pose.z[i]
        if len(region.planes) or region.half_angle > 0.0:
            _find_fastest_point(jet, region, pose.R[i], p, x[point], by_point[point])
        else:
            if region.axis.any():
                w = (p[0] - region.start[0], p[1] - region.start[1], p[2] - region.start[2])
                axis = (-ROWS.far_down * z[0], -ROWS.far_down * z[1], -ROWS.far_down * z[2])
                path = (region.axis[0], region.axis[1], region.axis[2])
                _, _, share[point], _ = swept_gap(w, axis, 0.0, 0.0, path, 0.0, 0.0)
            centre = region.start + share[point] * region.axis
            jets.point_of_ball(centre, region.radius, no_direction, p, z, x[point], by_point[point, :, :6])
        for j in range(n):
            for a in range(3):
                q[point, j, a] = 0.0
                for b in range(3):
                    q[point, j, a] += pose.R[j, b, a] * (x[point, b] + p_E[b] - pose.o[j, b])
            jets.find_factors(jet, q[point, j], jets.ROUNDED, C[point, j], no_dC)
    dC, has_slopes, weights = np.empty((points, n, r, 3)), np.zeros(points, np.bool_), np.empty(r * n)
    free, slopes, no_slopes = np.empty(r * n, np.bool_), np.empty(3 + r), np.empty(0)
    H, nu, forces, E, by_J = np.empty((6, 6)), np.empty(6), np.empty((n, 6)), np.empty(3), np.empty((3, 3))
    for k in range(cases):
        for j in range(r * n):
            free[j] = limit(rotors.u_min, j) < u[k, j] < limit(rotors.u_max, j)
        factored = False
        for point in range(points):
            row_number, i, region, total = first + k * points + point, air.module[point], air.region[point], 0.0
            for j in range(n):
                total += jets.speed(jet, C[point, j], no_dC, u[k, r * j : r * (j + 1)], no_slopes)
            g[row_number], by_total = -math.log(air.over[region] * total), 1 / total
            is_near[row_number] = g[row_number] < ROWS.slow
            if not is_near[row_number]:
                continue
            if not factored:
                H[:] = problem.cases.weight[k] / (2 * rho) * np.eye(6)
                for j in range(r * n):
                    for a in range(6 if free[j] else 0):
                        for b in range(a + 1):
                            H[a, b] += A[j, a] * A[j, b]
                factor(H, 6)
            for j in range(0 if has_slopes[point] else n):
                jets.find_factors(jet, q[point, j], jets.ROUNDED, C[point, j], dC[point, j])
            factored = has_slopes[point] = True
            nu[:], X, from_com = 0.0, (0.0, 0.0, 0.0), add(row(x, point), 1.0, (p_E[0], p_E[1], p_E[2]))
            for j in range(n):
                jets.speed(jet, C[point, j], dC[point, j], u[k, r * j : r * (j + 1)], slopes)
                F = rotate(pose.R, j, (by_total * slopes[0], by_total * slopes[1], by_total * slopes[2]))
                X = add(X, -1.0, F)
                forces[j, 0], forces[j, 1], forces[j, 2] = F
                forces[j, 3], forces[j, 4], forces[j, 5] = cross(from_com, F)
                for c in range(r * j, r * (j + 1)):
                    weights[c] = by_total * slopes[3 + c - r * j] if free[c] else 0.0
                    for a in range(6):
                        nu[a] -= weights[c] * A[c, a]
            solve_factored(H, nu, 6)
            for j in range(r * n):
                for a in range(6 if free[j] else 0):
                    weights[j] += nu[a] * A[j, a]
            by_x = np.array(X) @ by_point[point]
            forces[i, :3] += by_x[:3]
            forces[i, 3:] += np.cross(pose.o[i], by_x[:3]) + np.cross(pose.z[i], by_x[3:6])
            E[:] = np.array(X) - by_x[:3]
            if air.along[region] != 0.0:
                by_axis = air.along[region] / offset * (share[point] * E + by_x[6:])
                E += by_axis - (by_axis @ p_E) / offset**2 * p_E
            by_J[:] = 0.0
            add_wrench_gradient(problem, k, 1.0, nu, E, by_J)
            if by_J.any():
                add_inertia_gradient(rotors, pose, by_J, forces, E)
            add_gradient(A, 1.0, nu, u[k], forces)
            add_gradient(A, 1.0, mu[k], weights, forces)
            add_slopes(problem, pose, forces, E, J[row_number])


@njit(cache=True, inner=True)
def _region(air: Speeds, k: int, to_tip: Array) -> jets.SpeedRegion:
    axis = air.axis[k] + air.along[k] * to_tip
    planes = air.planes[air.first[k] : air.first[k + 1]]
    return jets.SpeedRegion(air.start[k], axis, air.radius[k], air.half_angle[k], planes, air.within[k])


@njit(cache=True, inner=True)
def _find_fastest_point(
    jet: jets.JetConstants, region: jets.SpeedRegion, R: Array, p: Array, x: Array, slopes: Array
) -> None:
    """Find the point of a region next to a module's axis where the module's own air is fastest.

    Args:
        jet: jet of the module.
        region: the outside of a cone, or a hull.
        R: orientation of the module.
        p: position of the module from p'_E.
        x: output: the point from p'_E, shape (3,).
        slopes: output: derivatives of x by p, by the module's axis and by the region's axis, shape (3, 9).
    """
    discs = len(jet.rotors)
    q, C, u, best_speed, best_depth = np.empty(3), np.empty(discs), np.ones(discs), -1.0, 0.0
    no_slopes, no_dC, no_input_slopes = np.empty((0, 9)), np.empty((0, 3)), np.empty(0)
    for depth in ROWS.depths:
        for a in range(3):
            x[a] = p[a] - depth * R[a, 2]
        if not jets.project_inside(region, x, no_slopes):
            continue
        for a in range(3):
            q[a] = R[0, a] * (x[0] - p[0]) + R[1, a] * (x[1] - p[1]) + R[2, a] * (x[2] - p[2])
        L = jet.rotors[0, jets.DIAMETER]
        if jet.rotors[0, jets.SHARE] < 1.0 and q[2] < -jets.JETS.merged_at * L:  # only the merged jet counts
            S = jet.origin - q[2] / L
            own_speed = jet.induced * jets.merged_jet(jet, L, S, q[0] * q[0] + q[1] * q[1])[0]
        else:
            jets.find_factors(jet, q, jets.SHARP, C, no_dC)
            own_speed = jets.speed(jet, C, no_dC, u, no_input_slopes)
        if own_speed > best_speed:
            best_speed, best_depth = own_speed, depth
    x[:] = p - best_depth * R[:, 2]
    rotations = np.zeros((3, 3))  # rotation of the axis by each of its components; x rotates with it
    slopes[:] = 0.0
    for a in range(3):
        slopes[a, a], slopes[a, 3 + a] = 1.0, -best_depth
        rotations[a, a] = 1.0
        rotations[a] = np.cross(region.axis, rotations[a])
        slopes[:, 6 + a] = -np.cross(rotations[a], x - region.start)
    jets.project_inside(region, x, slopes)
    for a in range(3):
        slopes[:, 6 + a] += np.cross(rotations[a], x - region.start)

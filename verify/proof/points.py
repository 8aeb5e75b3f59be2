"""Data of the dual function at points of a box, its middle or its vertices, and its slopes at the middle.

| symbol | meaning | shape |
|---|---|---|
| a_j | wrench of rotor j at unit input, about the origin of W | (r n, 6) |
| beta_aj | derivative of a_j by angle a | (A, r n, 6) |
| v_a | derivative of the sum of all c_i (`verify.proof.platform`) by angle a | (A, 3) |
| g_a | derivative of D by angle a | (A,) |
"""

from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, Flags
from verify.proof.arcs import ArcFrames, fill_root_orientation
from verify.proof.platform import ROTORS, CheckProblem

MAX_POINTS = 32
"""Largest number of points that enter a step."""


class AngleDerivatives(NamedTuple):
    """Derivatives by the angles at the middle of a box."""

    rho: Array
    """Half widths, shape (A,)."""
    is_turned: Flags
    """True if an angle turns a module, shape (A, n)."""
    axes: Array
    """Direction and point of every angle's axis in W, shape (A, 2, 3)."""
    beta: Array
    v: Array
    wall_slope: Array
    """Derivatives of n_r . e_r, shape (A, W)."""
    g: Array
    dg_dy: Array
    """Derivatives of g by y, shape (A, K, 6)."""


class Points(NamedTuple):
    """V points of a box, and the workspace of a search for multipliers at them."""

    a: Array
    """Wrench of every rotor at unit input, shape (V, r n, 6)."""
    b: Array
    """Required wrenches of the load cases, without the torque of p'_E, shape (V, K, 6)."""
    wall: Array
    """n_r . e_r + d_r, shape (V, W)."""
    D: Array
    """Dual function, shape (V,)."""
    curvature: Array
    """sum_{a, j} rho_a^2 beta_aj beta_aj^T at the middle, 0 at vertices, shape (6, 6)."""
    weight: Array
    """Weight of each load case, at least the kink width s, shape (K,)."""
    active: Flags
    """False for idle load cases, shape (K,)."""
    condition_inverse: Array
    """Pseudo-inverse of sum_k [g_k]x [g_k]x^T over active load cases, shape (3, 3)."""
    R: Array
    """Root orientation of the last point, shape (3, 3)."""
    step: Array
    """Step of y, shape (K, 6)."""
    wall_step: Array
    """Step of sigma, shape (W,)."""
    rows: Array
    """Three rows of the condition, then gradients of points or slopes by y, shape (K, 3 + MAX_POINTS, 6)."""
    wall_rows: Array
    """The same rows by sigma, shape (3 + MAX_POINTS, W)."""
    solved: Array
    """Inverse Hessian of each load case times its gradient and rows, shape (K, 6, 4 + MAX_POINTS)."""
    ridge: Array
    """Ridges of y and of sigma, shape (2,)."""
    slope_smoothing: Array
    """m, shape (1,)."""
    min_gain: Array
    """Least gain of a Newton step over the maximized value, shape (1,)."""
    slopes: AngleDerivatives
    """Slopes at the middle; without angles at vertices."""


@njit(cache=True, literals=False)
def empty_points(problem: CheckProblem, count: int, angles: int) -> Points:
    """Return arrays for `count` points, and for slopes by `angles` angles."""
    n, K, W = len(problem.parent), len(problem.f), len(problem.wall_normal)
    rows, wall_rows = np.zeros((K, 3 + MAX_POINTS, 6)), np.zeros((3 + MAX_POINTS, W))
    is_turned = np.zeros((angles, n), np.bool_)
    for k in range(K):
        x, y, z = problem.g[k]
        rows[k, 0, 4], rows[k, 0, 5] = -z, y
        rows[k, 1, 3], rows[k, 1, 5] = z, -x
        rows[k, 2, 3], rows[k, 2, 4] = -y, x
    for r in range(W):
        wall_rows[:3, r] = -problem.wall_normal[r]
    for a in range(angles):
        for i in range(n):
            is_turned[a, i] = is_turned_by(problem, a, i)
    slopes = AngleDerivatives(
        np.zeros(angles),
        is_turned,
        np.zeros((angles, 2, 3)),
        np.zeros((angles, ROTORS * n, 6)),
        np.zeros((angles, 3)),
        np.zeros((angles, W)),
        np.zeros(angles),
        np.zeros((angles, K, 6)),
    )
    points = Points(
        np.zeros((count, ROTORS * n, 6)),
        np.zeros((count, K, 6)),
        np.zeros((count, W)),
        np.zeros(count),
        np.zeros((6, 6)),
        np.zeros(K),
        np.ones(K, np.bool_),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros((K, 6)),
        np.zeros(W),
        rows,
        wall_rows,
        np.zeros((K, 6, 4 + MAX_POINTS)),
        np.ones(2),
        np.ones(1),
        np.ones(1),
        slopes,
    )
    fill_condition_inverse(points)
    return points


@njit(cache=True, literals=False, allocates=False)
def fill_point(problem: CheckProblem, pairs: Array, frames: ArcFrames, points: Points, v: int) -> None:
    """Fill the data of point v from its pairs (c, s), shape (A, 1, 2), and its frames, one per module."""
    R, cx, cy, cz = points.R, 0.0, 0.0, 0.0
    fill_root_orientation(pairs[0, 0], pairs[1, 0], pairs[2, 0], R)
    for i in range(len(problem.parent)):
        x, y, z = _moment(problem, frames, R, i)
        cx, cy, cz = cx + x, cy + y, cz + z
        for q in range(ROTORS):
            wrench = points.a[v, ROTORS * i + q]
            wrench[:] = 0.0
            for l in range(3):
                torque = frames.B[i, l, 2]
                for m in range(3):
                    torque += frames.R[i, l, m] * problem.rotor_torques[q, m]
                for row in range(3):
                    wrench[row] += R[row, l] * frames.R[i, l, 2]
                    wrench[3 + row] += R[row, l] * torque
    for r in range(points.wall.shape[1]):
        x, y, z = _envelope_end(problem, frames, R, r)
        normal = problem.wall_normal[r]
        points.wall[v, r] = normal[0] * x + normal[1] * y + normal[2] * z + problem.wall_offset[r]
    for k in range(len(problem.f)):
        x, y, z = problem.h[k]
        b = points.b[v, k]
        for l in range(3):
            b[l], b[3 + l] = problem.f[k, l], problem.t[k, l]
        b[3] += cy * z - cz * y
        b[4] += cz * x - cx * z
        b[5] += cx * y - cy * x


@njit(cache=True, inner=True, allocates=False)
def _rotate(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@njit(cache=True, inner=True, allocates=False)
def _moment(problem: CheckProblem, frames: ArcFrames, R: Array, i: int) -> tuple[float, float, float]:
    """Return c_i in W."""
    w, a, b = problem.bodies[i]
    p, axes = frames.p[i], frames.R[i]
    return _rotate(
        R,
        w * p[0] + a * axes[0, 0] + b * axes[0, 1],
        w * p[1] + a * axes[1, 0] + b * axes[1, 1],
        w * p[2] + a * axes[2, 0] + b * axes[2, 1],
    )


@njit(cache=True, inner=True, allocates=False)
def _envelope_end(problem: CheckProblem, frames: ArcFrames, R: Array, r: int) -> tuple[float, float, float]:
    i, distance = problem.wall_module[r], problem.wall_distance[r]
    p, axes = frames.p[i], frames.R[i]
    return _rotate(R, p[0] - distance * axes[0, 2], p[1] - distance * axes[1, 2], p[2] - distance * axes[2, 2])


@njit(cache=True, allocates=False)
def fill_slopes(problem: CheckProblem, pairs: Array, frames: ArcFrames, rho: Array, points: Points) -> None:
    """Fill the derivatives by the angles at the middle, the only point of `points`, after `fill_point`."""
    slopes, curvature, R = points.slopes, points.curvature, points.R
    _fill_axes(problem, pairs, frames, points)
    curvature[:], slopes.v[:], slopes.wall_slope[:] = 0.0, 0.0, 0.0
    for angle in range(len(rho)):
        slopes.rho[angle] = rho[angle]
        (wx, wy, wz), (px, py, pz) = slopes.axes[angle, 0], slopes.axes[angle, 1]
        for i in range(len(problem.parent)):
            if not slopes.is_turned[angle, i]:
                continue
            for j in range(ROTORS * i, ROTORS * (i + 1)):
                beta = slopes.beta[angle, j]
                _fill_beta(slopes.axes[angle], points.a[0, j], beta)
                for l in range(6):
                    for m in range(6):
                        curvature[l, m] += rho[angle] ** 2 * beta[l] * beta[m]
            x, y, z = _moment(problem, frames, R, i)
            w = problem.bodies[i, 0]
            x, y, z = x - w * px, y - w * py, z - w * pz
            slopes.v[angle, 0] += wy * z - wz * y
            slopes.v[angle, 1] += wz * x - wx * z
            slopes.v[angle, 2] += wx * y - wy * x
        for r in range(len(problem.wall_normal)):
            if slopes.is_turned[angle, problem.wall_module[r]]:
                x, y, z = _envelope_end(problem, frames, R, r)
                x, y, z = x - px, y - py, z - pz
                nx, ny, nz = problem.wall_normal[r]
                wall_slope = nx * (wy * z - wz * y) + ny * (wz * x - wx * z) + nz * (wx * y - wy * x)
                slopes.wall_slope[angle, r] = wall_slope


@njit(cache=True, inner=True, allocates=False)
def _fill_axes(problem: CheckProblem, pairs: Array, frames: ArcFrames, points: Points) -> None:
    (c, s), (c0, s0), axes = pairs[0, 0], pairs[1, 0], points.slopes.axes
    axes[:3] = 0.0
    axes[0, 0, 2] = 1.0
    axes[1, 0, 0], axes[1, 0, 1] = c, s
    axes[2, 0, 0], axes[2, 0, 1], axes[2, 0, 2] = -s * c0, c * c0, s0
    for i in range(1, len(problem.parent)):
        h, port = problem.parent[i], problem.port[i]
        arm, across = (0, 1) if port % 2 == 0 else (1, 0)
        step = problem.l_c if port < 2 else -problem.l_c
        for row in range(3):
            direction, point = 0.0, 0.0
            for l in range(3):
                direction += points.R[row, l] * frames.R[h, l, across]
                point += points.R[row, l] * (frames.p[h, l] + step * frames.R[h, l, arm])
            axes[i + 2, 0, row], axes[i + 2, 1, row] = direction, point


@njit(cache=True, allocates=False)
def is_turned_by(problem: CheckProblem, angle: int, i: int) -> bool:
    """Return whether an angle turns module i: it is one of the root's, or of a hinge on the module's path."""
    while i > 0 and i + 2 != angle:
        i = problem.parent[i]
    return angle < 3 or i > 0


@njit(cache=True, inner=True, allocates=False)
def _fill_beta(axis: Array, wrench: Array, beta: Array) -> None:
    """Fill the derivative of a rotor's wrench by an angle: omega x f, and omega x the torque about the axis."""
    (w0, w1, w2), (c0, c1, c2) = axis[0], axis[1]
    f0, f1, f2, t0, t1, t2 = wrench
    d0, d1, d2 = w1 * f2 - w2 * f1, w2 * f0 - w0 * f2, w0 * f1 - w1 * f0
    t0, t1, t2 = t0 - (c1 * f2 - c2 * f1), t1 - (c2 * f0 - c0 * f2), t2 - (c0 * f1 - c1 * f0)
    beta[0], beta[1], beta[2] = d0, d1, d2
    beta[3] = w1 * t2 - w2 * t1 + c1 * d2 - c2 * d1
    beta[4] = w2 * t0 - w0 * t2 + c2 * d0 - c0 * d2
    beta[5] = w0 * t1 - w1 * t0 + c0 * d1 - c1 * d0


@njit(cache=True, inner=True)
def fill_condition_inverse(points: Points) -> None:
    """Fill `condition_inverse` for the active load cases."""
    M = np.zeros((3, 3))
    for k in range(len(points.active)):
        if points.active[k]:
            C = points.rows[k, :3, 3:].copy()
            M += C @ C.T
    points.condition_inverse[:] = np.linalg.pinv(M, 1e-10)

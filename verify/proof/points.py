"""What the dual function of a box depends on: its middle or its vertices, and what the angles change at the middle.

| symbol | meaning | shape |
|---|---|---|
| a_j | wrench of rotor j at the input 1 | (4 n, 6) |
| beta_aj | its change with angle a | (A, 4 n, 6) |
| g_a | slope of D with angle a | (A,) |
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.model.compiled_code import njit
from verify.bodies import Array
from verify.proof.arcs import Frames, root_turn
from verify.proof.platform import Numbers

MOST_POINTS = 32
"""Largest number of points that count in a step."""


class Turns(NamedTuple):
    """Changes with the angles at the middle of a box."""

    rho: Array
    """Half widths, shape (A,)."""
    turned: NDArray[np.bool_]
    """Modules that an angle turns, shape (A, n)."""
    axes: Array
    """Direction and point of every angle's axis in W, shape (A, 2, 3)."""
    change: Array
    """beta, shape (A, 4 n, 6)."""
    moved: Array
    """Derivatives of the sum of all c_i by the angles, shape (A, 3)."""
    shift: Array
    """Those of n_r . e_r, shape (A, W)."""
    slope: Array
    """g, shape (A,)."""
    steep: Array
    """Derivatives of g by y, shape (A, K, 6)."""


class Points(NamedTuple):
    """Points of a box, V of them, and multipliers' surroundings."""

    a: Array
    """Wrench of every rotor at the input 1 about the origin, in W, shape (V, 4 n, 6)."""
    b: Array
    """Wrenches that the load cases ask for, without p'_E, shape (V, K, 6)."""
    wall: Array
    """n_r . e_r + d_r, shape (V, W)."""
    D: Array
    """The dual function, shape (V,)."""
    curved: Array
    """sum_{a, j} rho_a^2 beta_aj beta_aj^T at the middle, 0 at vertices, shape (6, 6)."""
    weight: Array
    """The weight, or s where that is greater, shape (K,)."""
    active: NDArray[np.bool_]
    """Load cases that have multipliers, shape (K,)."""
    project: Array
    """Pseudo-inverse of sum_k [g_k]x [g_k]x^T over those, shape (3, 3)."""
    R: Array
    """The root's orientation, shape (3, 3)."""
    step: Array
    """Step of y, shape (K, 6)."""
    wall_step: Array
    """Step of sigma, shape (W,)."""
    rows: Array
    """Tied rows: how p'_E's factor changes with y, then the points' gradients, shape (K, 3 + MOST_POINTS, 6)."""
    wall_rows: Array
    """Likewise with sigma, shape (3 + MOST_POINTS, W)."""
    solved: Array
    """A load case's Hessian's inverse times its gradient and the tied rows, shape (K, 6, 4 + MOST_POINTS)."""
    ridge: Array
    """Ridges of y and sigma, m, and the share of the value that a step must gain for another, shape (4,)."""
    turning: Turns
    """At the middle; without angles at vertices."""


@njit(cache=True, literals=False)
def workspace(numbers: Numbers, count: int, angles: int) -> Points:
    """Return arrays for `count` points, and for slopes in so many angles."""
    n, K, W = len(numbers.parent), len(numbers.f), len(numbers.normal)
    rows, wall_rows = np.zeros((K, 3 + MOST_POINTS, 6)), np.zeros((3 + MOST_POINTS, W))
    turned = np.zeros((angles, n), np.bool_)
    for k in range(K):
        x, y, z = numbers.g[k]
        rows[k, 0, 4], rows[k, 0, 5] = -z, y
        rows[k, 1, 3], rows[k, 1, 5] = z, -x
        rows[k, 2, 3], rows[k, 2, 4] = -y, x
    for r in range(W):
        wall_rows[:3, r] = -numbers.normal[r]
    for a in range(angles):
        for i in range(n):
            turned[a, i] = turns(numbers, a, i)
    turning = Turns(
        np.zeros(angles),
        turned,
        np.zeros((angles, 2, 3)),
        np.zeros((angles, 4 * n, 6)),
        np.zeros((angles, 3)),
        np.zeros((angles, W)),
        np.zeros(angles),
        np.zeros((angles, K, 6)),
    )
    at = Points(
        np.zeros((count, 4 * n, 6)),
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
        np.zeros((K, 6, 4 + MOST_POINTS)),
        np.ones(4),
        turning,
    )
    fill_project(at)
    return at


@njit(cache=True, literals=False, allocates=False)
def fill_point(numbers: Numbers, points: Array, frames: Frames, at: Points, v: int) -> None:
    """Fill what D depends on at point v; frames are those there, one a module, points its pairs (c, s)."""
    R, cx, cy, cz = at.R, 0.0, 0.0, 0.0
    root_turn(points[0, 0], points[1, 0], points[2, 0], R)
    for i in range(len(numbers.parent)):
        x, y, z = _moment(numbers, frames, R, i)
        cx, cy, cz = cx + x, cy + y, cz + z
        for q in range(4):
            into = at.a[v, 4 * i + q]
            into[:] = 0.0
            for l in range(3):
                torque = frames.B[i, l, 2]
                for m in range(3):
                    torque += frames.R[i, l, m] * numbers.torques[q, m]
                for row in range(3):
                    into[row] += R[row, l] * frames.R[i, l, 2]
                    into[3 + row] += R[row, l] * torque
    for r in range(at.wall.shape[1]):
        x, y, z = _end(numbers, frames, R, r)
        normal = numbers.normal[r]
        at.wall[v, r] = normal[0] * x + normal[1] * y + normal[2] * z + numbers.beyond[r]
    for k in range(len(numbers.f)):
        x, y, z = numbers.h[k]
        b = at.b[v, k]
        for l in range(3):
            b[l], b[3 + l] = numbers.f[k, l], numbers.t[k, l]
        b[3] += cy * z - cz * y
        b[4] += cz * x - cx * z
        b[5] += cx * y - cy * x


@njit(cache=True, allocates=False)
def _rotate(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@njit(cache=True, allocates=False)
def _moment(numbers: Numbers, frames: Frames, R: Array, i: int) -> tuple[float, float, float]:
    """Return c_i in W."""
    w, a, b = numbers.bodies[i]
    p, axes = frames.p[i], frames.R[i]
    return _rotate(
        R,
        w * p[0] + a * axes[0, 0] + b * axes[0, 1],
        w * p[1] + a * axes[1, 0] + b * axes[1, 1],
        w * p[2] + a * axes[2, 0] + b * axes[2, 1],
    )


@njit(cache=True, allocates=False)
def _end(numbers: Numbers, frames: Frames, R: Array, r: int) -> tuple[float, float, float]:
    """Return the end of the envelope of row r of the walls in W."""
    i, down = numbers.module[r], numbers.down[r]
    p, axes = frames.p[i], frames.R[i]
    return _rotate(R, p[0] - down * axes[0, 2], p[1] - down * axes[1, 2], p[2] - down * axes[2, 2])


@njit(cache=True, allocates=False)
def fill_turns(numbers: Numbers, points: Array, frames: Frames, rho: Array, at: Points) -> None:
    """Fill what angles do at the middle, the point of `at`, as `fill_point` does."""
    turning, curved, R = at.turning, at.curved, at.R
    _fill_axes(numbers, points, frames, at)
    curved[:], turning.moved[:], turning.shift[:] = 0.0, 0.0, 0.0
    for angle in range(len(rho)):
        turning.rho[angle] = rho[angle]
        (wx, wy, wz), (px, py, pz) = turning.axes[angle, 0], turning.axes[angle, 1]
        for i in range(len(numbers.parent)):
            if not turning.turned[angle, i]:
                continue
            for j in range(4 * i, 4 * i + 4):
                change = turning.change[angle, j]
                _fill_change(turning.axes[angle], at.a[0, j], change)
                for l in range(6):
                    for m in range(6):
                        curved[l, m] += rho[angle] ** 2 * change[l] * change[m]
            x, y, z = _moment(numbers, frames, R, i)
            w = numbers.bodies[i, 0]
            x, y, z = x - w * px, y - w * py, z - w * pz
            turning.moved[angle, 0] += wy * z - wz * y
            turning.moved[angle, 1] += wz * x - wx * z
            turning.moved[angle, 2] += wx * y - wy * x
        for r in range(len(numbers.normal)):
            if turning.turned[angle, numbers.module[r]]:
                x, y, z = _end(numbers, frames, R, r)
                x, y, z = x - px, y - py, z - pz
                nx, ny, nz = numbers.normal[r]
                shift = nx * (wy * z - wz * y) + ny * (wz * x - wx * z) + nz * (wx * y - wy * x)
                turning.shift[angle, r] = shift


@njit(cache=True, allocates=False)
def _fill_axes(numbers: Numbers, points: Array, frames: Frames, at: Points) -> None:
    (c, s), (c0, s0), axes = points[0, 0], points[1, 0], at.turning.axes
    axes[:3] = 0.0
    axes[0, 0, 2] = 1.0
    axes[1, 0, 0], axes[1, 0, 1] = c, s
    axes[2, 0, 0], axes[2, 0, 1], axes[2, 0, 2] = -s * c0, c * c0, s0
    for i in range(1, len(numbers.parent)):
        h, port = numbers.parent[i], numbers.port[i]
        arm, across = (0, 1) if port % 2 == 0 else (1, 0)
        step = numbers.l_c if port < 2 else -numbers.l_c
        for row in range(3):
            direction, point = 0.0, 0.0
            for l in range(3):
                direction += at.R[row, l] * frames.R[h, l, across]
                point += at.R[row, l] * (frames.p[h, l] + step * frames.R[h, l, arm])
            axes[i + 2, 0, row], axes[i + 2, 1, row] = direction, point


@njit(cache=True, allocates=False)
def turns(numbers: Numbers, angle: int, i: int) -> bool:
    """True if an angle turns a module: one of the root, or of a hinge on its path."""
    while i > 0 and i + 2 != angle:
        i = numbers.parent[i]
    return angle < 3 or i > 0


@njit(cache=True, allocates=False)
def _fill_change(axis: Array, wrench: Array, change: Array) -> None:
    """Fill how a rotor's wrench changes with an angle: omega x f, and likewise the torque about the axis."""
    (w0, w1, w2), (c0, c1, c2) = axis[0], axis[1]
    f0, f1, f2, t0, t1, t2 = wrench
    d0, d1, d2 = w1 * f2 - w2 * f1, w2 * f0 - w0 * f2, w0 * f1 - w1 * f0
    t0, t1, t2 = t0 - (c1 * f2 - c2 * f1), t1 - (c2 * f0 - c0 * f2), t2 - (c0 * f1 - c1 * f0)
    change[0], change[1], change[2] = d0, d1, d2
    change[3] = w1 * t2 - w2 * t1 + c1 * d2 - c2 * d1
    change[4] = w2 * t0 - w0 * t2 + c2 * d0 - c0 * d2
    change[5] = w0 * t1 - w1 * t0 + c0 * d1 - c1 * d0


@njit(cache=True)
def fill_project(at: Points) -> None:
    """Fill what turns a miss into the change that meets the condition."""
    M = np.zeros((3, 3))
    for k in range(len(at.active)):
        if at.active[k]:
            C = at.rows[k, :3, 3:].copy()
            M += C @ C.T
    at.project[:] = np.linalg.pinv(M, 1e-10)

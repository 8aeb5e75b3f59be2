r"""Multipliers for a box: whatever they are the bound holds, and the better they are the higher it is.

What is maximised, by Newton's method within the space of multipliers that p'_E drops out of, is the least dual
function D of some points of the box, smoothed by a temperature T,

.. math:: -T \log \sum_v e^{-D_v(y, \sigma) / T}

less small squares of the multipliers. At one point, the middle, T says nothing. Over the box t = a_j . y changes by
beta_aj . y times the change of angle a, and the bound loses a quarter to a half of the square of that over lambda,
beside what the slopes g_a of D take towards a vertex. So there, with rho the half widths,

.. math:: \sum_a \rho_a \left(\sqrt{g_a^2 + m^2} - m\right)
    + \frac{1}{2} \sum_{k} \frac{1}{\lambda_k} \sum_{a, j} \rho_a^2 (\beta_{aj} \cdot y_k)^2

is subtracted as well. For a step the root is replaced by the parabola over it that touches it where g_a is. That
does for most boxes. For the others the points are all vertices: where a reserve is out of reach, D at the middle
rises without end with the multipliers, and falls the more steeply towards the vertices.

psi of a load case without weight, m t + (1 - m) max(t, 0), has a kink, which Newton's method does not see. Here
max(t, 0) counts as (t + root(t^2 + s^2) - s) / 2, and so it does with any weight under the width s. At the
vertices T and s fall from stage to stage. Load cases that cost nothing then have multipliers that bring nothing:
`leave` sets these to zero.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.model.compiled_code import njit
from verify.bodies import Array
from verify.proof.arcs import Frames, root_turn
from verify.proof.dual import residual
from verify.proof.platform import Indices, Numbers

LIGHTEST = 1e-2
"""s at the middle,"""
BLURRED = 0.1
"""or this times the root of sum_a rho_a^2, if that is less."""
FREE = 6.0
"""A load case whose |a_j . y_k| are all less, in s, costs nothing."""
UNMET = 1e-9
"""Share of the walls' multipliers by which p'_E may fail to drop out, for rounding."""
CHANGES = 3
"""Times that a step takes other walls into account."""
LONGEST = 3.0
"""Longest step, in the multipliers' own size."""
SHORTEST = 1e-3
"""Share of a Newton step under which it is given up."""
PAYS = 1e-4
"""Share of the value that a step must gain for another."""
ENOUGH = 1.1
"""Times the cut at which the search at vertices ends."""
HOPELESS = 0.98
"""Times the cut under which it ends once no other multipliers can bring D there; s makes D greater than it is."""
TOO_MUCH = 2.0
"""Times the cut at which a stage ends, for the same reason."""
FLAT = 0.01
"""m, in the cut."""
STAGES = 8
STEPS = 6
"""Newton steps of a stage."""
SOFT, SOFTER = 0.05, 0.6
"""T of the first stage, in the cut, and that of the next in it."""
KINK, SHARPER = 0.15, 0.35
"""s of the first stage, in the cut over 4 n, and that of the next in it."""
SHARP = 1e-9
"""s that tells what D is."""
LIGHT = 1e-3
"""Least share of a point that counts in a step."""
MOST = 32
"""Points that count in a step at most."""
RIDGE = 1e-3
"""Ridge of y at the middle."""
RIDGE_OF_Y, RIDGE_OF_SIGMA = 1.0, 20.0
"""Ridges of the first stage, which keep multipliers short where the best have no end; then SHARPER of them."""
BESIDE = 1e-3
"""Stiffness of a rotor that a step leaves out, in the ridge of y."""


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
    """Tied rows: how p'_E's factor changes with y, then the points' gradients, shape (K, 3 + MOST, 6)."""
    wall_rows: Array
    """Likewise with sigma, shape (3 + MOST, W)."""
    solved: Array
    """A load case's Hessian's inverse times its gradient and the tied rows, shape (K, 6, 4 + MOST)."""
    ridge: Array
    """Ridges of y and sigma, and m, shape (3,)."""
    turning: Turns
    """At the middle; without angles at vertices."""


@njit(cache=True, literals=False)
def workspace(numbers: Numbers, count: int, angles: int) -> Points:
    """Return arrays for `count` points, and for slopes in so many angles."""
    n, K, W = len(numbers.parent), len(numbers.f), len(numbers.normal)
    rows, wall_rows, turned = np.zeros((K, 3 + MOST, 6)), np.zeros((3 + MOST, W)), np.zeros((angles, n), np.bool_)
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
        np.zeros((K, 6, 4 + MOST)),
        np.ones(3),
        turning,
    )
    _fill_project(at)
    return at


@njit(cache=True, literals=False, allocates=False)
def look(numbers: Numbers, points: Array, frames: Frames, at: Points, v: int) -> None:
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
def look_around(numbers: Numbers, points: Array, frames: Frames, rho: Array, at: Points) -> None:
    """Fill what angles do at the middle, the point of `at`, as `look` does."""
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
def begin(numbers: Numbers, at: Points, rho: Array, cut: float) -> None:
    """Take all load cases in, as a box of half widths rho blurs them."""
    square = (rho * rho).sum()
    lever = 2 * numbers.l_c * numbers.depth.max() + 1
    at.ridge[0], at.ridge[2] = RIDGE, FLAT * cut
    at.ridge[1] = max(square, 1e-4) * lever * lever / cut
    blur(numbers, at, max(SHARP, min(LIGHTEST, BLURRED * math.sqrt(square))))
    if not np.all(at.active):
        at.active[:] = True
        _fill_project(at)


@njit(cache=True)
def blur(numbers: Numbers, at: Points, s: float) -> None:
    """Set the width of kinks."""
    at.weight[:] = np.maximum(numbers.weight, s)


@njit(cache=True)
def leave(numbers: Numbers, at: Points, y: Array, sigma: Array) -> bool:
    """Leave out load cases that cost nothing, and return whether there are any."""
    left = False
    for k in range(len(y)):
        if numbers.weight[k] == 0.0 and at.active[k]:
            dearest = 0.0
            for v in range(len(at.a)):
                dearest = max(dearest, np.abs(at.a[v] @ y[k]).max())
            if dearest <= FREE * at.weight[k]:
                y[k], at.active[k], left = 0.0, False, True
    if left:
        _fill_project(at)
        balance(numbers, at, y, sigma)
    return left


@njit(cache=True)
def _fill_project(at: Points) -> None:
    """Fill what turns a miss into the change that meets the condition."""
    M = np.zeros((3, 3))
    for k in range(len(at.active)):
        if at.active[k]:
            C = at.rows[k, :3, 3:].copy()
            M += C @ C.T
    at.project[:] = np.linalg.pinv(M, 1e-10)


@njit(cache=True)
def balance(numbers: Numbers, at: Points, y: Array, sigma: Array) -> None:
    """Change multipliers of torque so that p'_E drops out; if they cannot, without walls."""
    for _ in range(2):
        x, y_, z = residual(numbers, y, sigma)
        q = at.project @ np.array([x, y_, z])
        for k in range(len(y)):
            if at.active[k]:
                y[k, 3:] -= np.cross(q, numbers.g[k])
        x, y_, z = residual(numbers, y, sigma)
        if math.sqrt(x * x + y_ * y_ + z * z) <= UNMET * sigma.sum():
            break
        sigma[:] = 0.0


@njit(cache=True)
def lift(numbers: Numbers, at: Points, y: Array, sigma: Array, cut: float) -> None:
    """Improve multipliers at the worst of all points, in place."""
    T, s = SOFT * cut, KINK * cut / at.a.shape[1]
    at.ridge[0], at.ridge[1] = RIDGE_OF_Y, RIDGE_OF_SIGMA
    for _ in range(STAGES):
        blur(numbers, at, s)
        climb(numbers, at, y, sigma, T, TOO_MUCH * cut, TOO_MUCH * cut, STEPS)
        held = (at.ridge[0] * (y * y).sum() + at.ridge[1] * (sigma * sigma).sum()) / 2  # by ridges
        if at.D.min() + T * math.log(len(at.D)) + held < HOPELESS * cut:
            break
        blur(numbers, at, SHARP)
        value(numbers, at, y, sigma, T)
        if at.D.min() > ENOUGH * cut:
            break
        T, s = SOFTER * T, SHARPER * s
        at.ridge[:2] *= SHARPER
    blur(numbers, at, s)
    leave(numbers, at, y, sigma)


@njit(cache=True, literals=False)
def climb(
    numbers: Numbers, at: Points, y: Array, sigma: Array, T: float, enough: float, most: float, steps: int
) -> float:
    """Improve multipliers that p'_E drops out of, in place, and return what is maximised.

    Args:
        numbers: the task and the tree.
        at: points of a box.
        y: multipliers, shape (K, 6).
        sigma: those of walls, shape (W,).
        T: temperature.
        enough: beyond which there is nothing to gain.
        most: beyond which a shorter step does as well.
        steps: most of them.
    """
    best = value(numbers, at, y, sigma, T)
    for _ in range(steps):
        if best > enough:
            break
        _newton(numbers, at, y, sigma, T)
        size = math.sqrt((y * y).sum() + (sigma * sigma).sum())
        long = math.sqrt((at.step * at.step).sum() + (at.wall_step * at.wall_step).sum())
        share = min(1.0, LONGEST * size / long) if long > 0.0 and size > 0.0 else 1.0
        smallest, reached = SHORTEST * share, -math.inf
        while share > smallest:
            ahead, pressed = y + share * at.step, np.maximum(sigma + share * at.wall_step, 0.0)
            reached = value(numbers, at, ahead, pressed, T)
            if best < reached < most:
                break
            share *= 0.3
        if not reached > best:
            break
        y[:], sigma[:] = ahead, pressed
        gain, best = reached - best, reached
        if gain < PAYS * abs(best):
            break
    balance(numbers, at, y, sigma)
    return best


@njit(cache=True, allocates=False)
def value(numbers: Numbers, at: Points, y: Array, sigma: Array, T: float) -> float:
    """Return what is maximised, and fill D and slopes."""
    taken, lowest, least = 0.0, math.inf, numbers.least
    for k in range(len(y)):
        if not at.active[k]:
            continue
        for l in range(6):
            for m in range(6):
                taken += y[k, l] * at.curved[l, m] * y[k, m] / (2 * at.weight[k])
            taken += at.ridge[0] / 2 * y[k, l] * y[k, l]
    for r in range(len(sigma)):
        taken += at.ridge[1] / 2 * sigma[r] * sigma[r]
    for v in range(len(at.D)):
        total = 0.0
        for r in range(len(sigma)):
            total += sigma[r] * at.wall[v, r]
        for k in range(len(y)):
            if not at.active[k]:
                continue
            weight, blurred, (y0, y1, y2, y3, y4, y5) = at.weight[k], numbers.weight[k] < at.weight[k], y[k]
            b = at.b[v, k]
            total += b[0] * y0 + b[1] * y1 + b[2] * y2 + b[3] * y3 + b[4] * y4 + b[5] * y5
            for j in range(at.a.shape[1]):
                a = at.a[v, j]
                t = a[0] * y0 + a[1] * y1 + a[2] * y2 + a[3] * y3 + a[4] * y4 + a[5] * y5
                if j == numbers.dead[k]:
                    continue
                if blurred:
                    total -= least * t + (1 - least) / 2 * (t + math.sqrt(t * t + weight * weight) - weight)
                else:
                    u = min(max(t / (2 * weight), least), 1.0)
                    total -= u * (t - weight * u)
        at.D[v] = total
        lowest = min(lowest, total)
    if len(at.turning.rho) > 0:
        _fill_slopes(numbers, at, y, sigma)
        for angle in range(len(at.turning.rho)):
            taken += at.turning.rho[angle] * (math.hypot(at.turning.slope[angle], at.ridge[2]) - at.ridge[2])
    shares = 0.0
    for v in range(len(at.D)):
        shares += math.exp((lowest - at.D[v]) / T)
    return lowest - T * math.log(shares) - taken


@njit(cache=True, allocates=False)
def _fill_slopes(numbers: Numbers, at: Points, y: Array, sigma: Array) -> None:
    """Fill the slopes of D, and how they change with y."""
    turning = at.turning
    slope = turning.slope
    for angle in range(len(slope)):
        slope[angle] = 0.0
        for r in range(len(sigma)):
            slope[angle] += turning.shift[angle, r] * sigma[r]
    for k in range(len(y)):
        if not at.active[k]:
            continue
        (hx, hy, hz), (y0, y1, y2, y3, y4, y5) = numbers.h[k], y[k]
        weight, blurred = at.weight[k], numbers.weight[k] < at.weight[k]
        for angle in range(len(slope)):
            (x, y_, z), steep = turning.moved[angle], turning.steep[angle, k]
            steep[0], steep[1], steep[2] = 0.0, 0.0, 0.0
            steep[3], steep[4], steep[5] = y_ * hz - z * hy, z * hx - x * hz, x * hy - y_ * hx
            slope[angle] += steep[3] * y3 + steep[4] * y4 + steep[5] * y5
        for j in range(at.a.shape[1]):
            a = at.a[0, j]
            t = a[0] * y0 + a[1] * y1 + a[2] * y2 + a[3] * y3 + a[4] * y4 + a[5] * y5
            u, stiff = _pull(t, weight, blurred, numbers.least)
            if u <= 0.0 or j == numbers.dead[k]:
                continue
            for angle in range(len(slope)):
                if not turning.turned[angle, j // 4]:
                    continue
                c, steep = turning.change[angle, j], turning.steep[angle, k]
                changed = c[0] * y0 + c[1] * y1 + c[2] * y2 + c[3] * y3 + c[4] * y4 + c[5] * y5
                slope[angle] -= u * changed
                for l in range(6):
                    steep[l] -= u * c[l] + stiff * changed * a[l]


@njit(cache=True, allocates=False)
def _pull(t: float, weight: float, blurred: bool, least: float) -> tuple[float, float]:
    """Return the first and second derivative of psi."""
    if blurred:
        length, half = math.sqrt(t * t + weight * weight), (1 - least) / 2
        return least + half * (1 + t / length), half * weight * weight / (length * length * length)
    u = t / (2 * weight)
    if u <= least:
        return least, 0.0
    return (u, 1 / (2 * weight)) if u < 1.0 else (1.0, 0.0)


@njit(cache=True)
def _newton(numbers: Numbers, at: Points, y: Array, sigma: Array, T: float) -> None:
    """Fill the step to the maximum of the quadratic model under which p'_E drops out, once `value` was called.

    A point with the share w adds the square of root(w / T) (its gradient less the mean one) . step to the model,
    an angle (g_a + its change with y . step)^2 rho_a / root(g_a^2 + m^2): tied rows that give way.
    """
    K, A, share = len(y), len(at.turning.rho), np.exp((at.D.min() - at.D) / T)
    order = np.argsort(-share)[:MOST]
    order = order[share[order] > LIGHT * share.sum()]
    share = share[order] / share[order].sum()
    points = len(order) if len(order) > 1 else 0
    tied = 3 + points + A
    S, q = np.zeros((tied, tied)), np.zeros(tied)
    q[0], q[1], q[2] = residual(numbers, y, sigma)
    pull = share @ at.wall[order]
    for row in range(3, 3 + points):
        S[row, row] = 1.0
        at.wall_rows[row] = math.sqrt(share[row - 3] / T) * (at.wall[order[row - 3]] - pull)
    for angle in range(A):
        row, g = 3 + points + angle, at.turning.slope[angle]
        S[row, row], q[row] = math.hypot(g, at.ridge[2]) / max(at.turning.rho[angle], 1e-12), g
        at.wall_rows[row] = at.turning.shift[angle]
    H, gradient, mean = np.empty((6, 6)), np.empty((len(order), 6)), np.empty(6)
    for k in range(K):
        if at.active[k]:
            _fill_model(numbers, at, y, k, order, share, math.sqrt(1 / T), H, gradient, mean)
            _solve_model(H, mean, at.rows[k], at.solved[k], tied, S, q)
    size = S[0, 0] + S[1, 1] + S[2, 2]
    for row in range(3):
        S[row, row] += 1e-9 * size if size > 0.0 else 1.0
    x = _tie(at, sigma, pull, S, q)
    for k in range(K):
        for l in range(6):
            at.step[k, l] = 0.0
            if at.active[k]:
                at.step[k, l] = at.solved[k, l, 0]
                for row in range(tied):
                    at.step[k, l] -= at.solved[k, l, 1 + row] * x[row]


@njit(cache=True, allocates=False)
def _fill_model(
    numbers: Numbers,
    at: Points,
    y: Array,
    k: int,
    order: Indices,
    share: Array,
    cold: float,
    H: Array,
    gradient: Array,
    mean: Array,
) -> None:
    """Fill the Hessian, the mean gradient and the tied rows of a load case; `cold` is root(1 / T)."""
    weight, blurred, rows = at.weight[k], numbers.weight[k] < at.weight[k], at.rows[k]
    points = len(order) if len(order) > 1 else 0
    for l in range(6):
        mean[l] = -at.ridge[0] * y[k, l]
        for m in range(6):
            H[l, m] = at.curved[l, m] / weight
            mean[l] -= H[l, m] * y[k, m]
        H[l, l] += at.ridge[0]
    y0, y1, y2, y3, y4, y5 = y[k]
    for point in range(len(order)):
        v, g = order[point], gradient[point]
        for l in range(6):
            g[l] = at.b[v, k, l]
        for j in range(at.a.shape[1]):
            a = at.a[v, j]
            t = a[0] * y0 + a[1] * y1 + a[2] * y2 + a[3] * y3 + a[4] * y4 + a[5] * y5
            if j == numbers.dead[k]:
                continue
            u, stiff = _pull(t, weight, blurred, numbers.least)
            stiff *= share[point]
            if u > 0.0:
                for l in range(6):
                    g[l] -= u * a[l]
            if stiff > BESIDE * at.ridge[0]:
                for l in range(6):
                    for m in range(l + 1):
                        H[l, m] += stiff * a[l] * a[m]
        if points == 0:
            for l in range(6):
                mean[l] += g[l]
    for l in range(6):
        if points > 0:
            average = 0.0
            for point in range(points):
                average += share[point] * gradient[point, l]
            mean[l] += average
            for point in range(points):
                rows[3 + point, l] = math.sqrt(share[point]) * cold * (gradient[point, l] - average)
        for angle in range(len(at.turning.rho)):
            rows[3 + points + angle, l] = at.turning.steep[angle, k, l]


@njit(cache=True, allocates=False)
def _solve_model(H: Array, mean: Array, rows: Array, solved: Array, tied: int, S: Array, q: Array) -> None:
    """Fill H^-1 times the gradient and the tied rows, by Cholesky, and add these rows times that to S and q."""
    for l in range(6):
        for m in range(l + 1):
            total = H[l, m]
            for i in range(m):
                total -= H[l, i] * H[m, i]
            H[l, m] = math.sqrt(total) if l == m else total / H[m, m]
    for l in range(6):
        solved[l, 0] = mean[l]
        for row in range(tied):
            solved[l, 1 + row] = rows[row, l]
        for i in range(l):
            for column in range(1 + tied):
                solved[l, column] -= H[l, i] * solved[i, column]
        for column in range(1 + tied):
            solved[l, column] /= H[l, l]
    for l in range(5, -1, -1):
        for i in range(l + 1, 6):
            for column in range(1 + tied):
                solved[l, column] -= H[i, l] * solved[i, column]
        for column in range(1 + tied):
            solved[l, column] /= H[l, l]
    for row in range(tied):
        for l in range(6):
            q[row] += rows[row, l] * solved[l, 0]
            for column in range(tied):
                S[row, column] += rows[row, l] * solved[l, 1 + column]


@njit(cache=True)
def _tie(at: Points, sigma: Array, uphill: Array, S: Array, q: Array) -> Array:
    """Return the multipliers of the tied rows, and fill the walls' step, which ends at 0 or above."""
    ridge, rows = at.ridge[1], at.wall_rows[: len(q)]
    presses = sigma > 0.0
    x = q
    for _ in range(CHANGES):
        M, right = S.copy(), q.copy()
        for r in range(len(sigma)):
            right += rows[:, r] * ((uphill[r] / ridge if presses[r] else 0.0) - sigma[r])
            if presses[r]:
                M[:] += np.outer(rows[:, r], rows[:, r]) / ridge
        x = np.asarray(np.linalg.solve(M, right), np.float64)
        before = presses.copy()
        for r in range(len(sigma)):
            pull = (uphill[r] - (rows[:, r] * x).sum()) / ridge
            presses[r] = pull > 0.0
            at.wall_step[r] = max(pull, 0.0) - sigma[r]
        if np.all(before == presses):
            break
    return x

r"""Multipliers for a box: whatever they are the bound holds, and the better they are the higher it is.

At the middle of the box the dual function is concave in y. Over the box t = a_j . y changes by beta_aj . y times
the change of angle a, and the bound loses about a quarter of the square of that over lambda. So what is
maximised, by Newton's method, is the dual function at the middle less

.. math:: \frac{1}{4} \sum_{k} \frac{1}{\lambda_k} \sum_{a, j} \rho_a^2 (\beta_{aj} \cdot y_k)^2

with rho the half widths, within the space of multipliers that p'_E drops out of. Where that does not do, the slopes
g_a of the dual function are taken into account as well: towards a corner it falls by rho_a |g_a| an angle, so that

.. math:: \sum_a \rho_a \left(\sqrt{g_a^2 + m^2} - m\right)

is subtracted too, with a part of the above, which stood for the slopes as well. For a step the root is replaced by
the parabola over it that touches it where g_a is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model.compiled_code import njit
from verify.bodies import Array
from verify.proof.arcs import Frames, root_turn
from verify.proof.platform import Numbers

LIGHTEST = 1e-2
"""Weight that a load case counts with here at least: the dual function of one without is not smooth."""
LONGEST = 3.0
"""Longest step, in the multipliers' own size."""
SHORTEST = 1e-3
"""Share of a Newton step under which it is given up."""
PAYS = 1e-4
"""Share of the value that a step must gain for another."""
FLAT = 0.02
"""m, as a share of the cut."""
CURVED = 0.3
"""Part of what is subtracted for beta beside the slopes."""
ENOUGH = 1.1
"""Times the cut at which the search ends: where no balance is possible it has no end."""


class Middle(NamedTuple):
    """The middle of a box."""

    a: Array
    """Wrench of every rotor at the input 1 about the origin, in W, shape (4 n, 6)."""
    b: Array
    """Wrenches that the load cases ask for, without p'_E, shape (K, 6)."""
    curved: Array
    """sum_{a, j} rho_a^2 beta_aj beta_aj^T / 2, shape (6, 6)."""
    axes: Array
    """Direction and point of every angle's axis in W, shape (A, 2, 3)."""
    change: Array
    """beta, shape (A, 4 n, 6)."""
    moved: Array
    """Derivatives of the sum of all c_i by the angles, shape (A, 3)."""
    slope: Array
    """g, shape (A,)."""
    steep: Array
    """Derivatives of g by y, shape (A, 6 K)."""
    R: Array
    """The root's orientation, shape (3, 3)."""
    gradient: Array
    """Shape (6 K,)."""
    hessian: Array
    """Shape (K, 6, 6)."""


@njit(cache=True)
def workspace(numbers: Numbers) -> Middle:
    """Return arrays for one box."""
    n, K = len(numbers.parent), len(numbers.f)
    return Middle(
        np.zeros((4 * n, 6)),
        np.zeros((K, 6)),
        np.zeros((6, 6)),
        np.zeros((n + 2, 2, 3)),
        np.zeros((n + 2, 4 * n, 6)),
        np.zeros((n + 2, 3)),
        np.zeros(n + 2),
        np.zeros((n + 2, 6 * K)),
        np.zeros((3, 3)),
        np.zeros(6 * K),
        np.zeros((K, 6, 6)),
    )


@njit(cache=True)
def look(numbers: Numbers, points: Array, frames: Frames, rho: Array, at: Middle) -> None:
    """Fill what multipliers depend on; frames are those of the middle, one a module, points its pairs (c, s)."""
    n, R = len(numbers.parent), at.R
    root_turn(points[0, 0], points[1, 0], points[2, 0], R)
    _fill_axes(numbers, points, frames, at)
    at.curved[:], at.change[:], at.moved[:] = 0.0, 0.0, 0.0
    total = np.zeros(3)
    for i in range(n):
        w, (a, b) = numbers.bodies[i, 0], numbers.bodies[i, 1:]
        c = R @ (w * frames.p[i] + a * frames.R[i, :, 0] + b * frames.R[i, :, 1])
        total += c
        for q in range(4):
            j = 4 * i + q
            for row in range(3):
                at.a[j, row] = at.a[j, 3 + row] = 0.0
                for l in range(3):
                    at.a[j, row] += R[row, l] * frames.R[i, l, 2]
                    torque = frames.B[i, l, 2]
                    for m in range(3):
                        torque += frames.R[i, l, m] * numbers.own[q, m]
                    at.a[j, 3 + row] += R[row, l] * torque
            for angle in range(n + 2):
                if turns(numbers, angle, i):
                    _add_curve(at, j, angle, rho[angle])
        for angle in range(n + 2):
            if turns(numbers, angle, i):
                at.moved[angle] += np.cross(at.axes[angle, 0], c - w * at.axes[angle, 1])
    for k in range(len(numbers.f)):
        x, y, z = numbers.h[k]
        at.b[k, :3], at.b[k, 3:] = numbers.f[k], numbers.t[k]
        at.b[k, 3] += total[1] * z - total[2] * y
        at.b[k, 4] += total[2] * x - total[0] * z
        at.b[k, 5] += total[0] * y - total[1] * x


@njit(cache=True)
def _fill_axes(numbers: Numbers, points: Array, frames: Frames, at: Middle) -> None:
    (c, s), (c0, s0) = points[0, 0], points[1, 0]
    at.axes[:3] = 0.0
    at.axes[0, 0, 2] = 1.0
    at.axes[1, 0, 0], at.axes[1, 0, 1] = c, s
    at.axes[2, 0, 0], at.axes[2, 0, 1], at.axes[2, 0, 2] = -s * c0, c * c0, s0
    for i in range(1, len(numbers.parent)):
        h, port = numbers.parent[i], numbers.port[i]
        arm, across = (0, 1) if port % 2 == 0 else (1, 0)
        step = numbers.l_c if port < 2 else -numbers.l_c
        for row in range(3):
            direction, point = 0.0, 0.0
            for l in range(3):
                direction += at.R[row, l] * frames.R[h, l, across]
                point += at.R[row, l] * (frames.p[h, l] + step * frames.R[h, l, arm])
            at.axes[i + 2, 0, row], at.axes[i + 2, 1, row] = direction, point


@njit(cache=True)
def turns(numbers: Numbers, angle: int, i: int) -> bool:
    """True if an angle turns a module: one of the root, or of a hinge on its path."""
    while i > 0 and i + 2 != angle:
        i = numbers.parent[i]
    return angle < 3 or i > 0


@njit(cache=True)
def _add_curve(at: Middle, j: int, angle: int, rho: float) -> None:
    """Add what one angle does to the wrench of one rotor."""
    change = at.change[angle, j]
    _fill_change(at, j, angle, change)
    for row in range(6):
        for column in range(6):
            at.curved[row, column] += 0.5 * rho * rho * change[row] * change[column]


@njit(cache=True)
def _fill_change(at: Middle, j: int, angle: int, change: Array) -> None:
    """Fill how the wrench of rotor j changes with an angle: omega x f, and likewise the torque about the axis."""
    w0, w1, w2 = at.axes[angle, 0]
    c0, c1, c2 = at.axes[angle, 1]
    f0, f1, f2, t0, t1, t2 = at.a[j]
    d0, d1, d2 = w1 * f2 - w2 * f1, w2 * f0 - w0 * f2, w0 * f1 - w1 * f0
    t0, t1, t2 = t0 - (c1 * f2 - c2 * f1), t1 - (c2 * f0 - c0 * f2), t2 - (c0 * f1 - c1 * f0)
    change[0], change[1], change[2] = d0, d1, d2
    change[3] = w1 * t2 - w2 * t1 + c1 * d2 - c2 * d1
    change[4] = w2 * t0 - w0 * t2 + c2 * d0 - c0 * d2
    change[5] = w0 * t1 - w1 * t0 + c0 * d1 - c1 * d0


@njit(cache=True)
def climb(numbers: Numbers, at: Middle, z: Array, y: Array, rho: Array, cut: float, steps: int) -> float:
    """Improve z, shape (d,), with y = free z, and return what is maximised.

    Args:
        numbers: the task and the tree.
        at: the middle of a box.
        z: multipliers.
        y: is filled.
        rho: half widths for which slopes are taken into account; 0: they are not.
        cut: beyond which there is nothing to gain.
        steps: most of them.
    """
    best = value(numbers, at, z, y, rho, cut)
    for _ in range(steps):
        if best > ENOUGH * cut:
            break
        step = _newton(numbers, at, y, rho, cut)
        size, long = math.sqrt((z * z).sum()), math.sqrt((step * step).sum())
        share = min(1.0, LONGEST * size / long) if long > 0.0 and size > 0.0 else 1.0
        smallest, found = SHORTEST * share, -math.inf
        while share > smallest:
            found = value(numbers, at, z + share * step, y, rho, cut)
            if found > best:
                break
            share *= 0.3
        if not found > best:
            value(numbers, at, z, y, rho, cut)
            break
        z += share * step
        gain, best = found - best, found
        if gain < PAYS * abs(best):
            break
    return best


@njit(cache=True)
def value(numbers: Numbers, at: Middle, z: Array, y: Array, rho: Array, cut: float) -> float:
    """Fill y, and return what is maximised."""
    K, d, total = len(y), len(z), 0.0
    for k in range(K):
        for l in range(6):
            y[k, l] = 0.0
            for m in range(d):
                y[k, l] += numbers.free[6 * k + l, m] * z[m]
    for k in range(K):
        weight = max(numbers.weight[k], LIGHTEST)
        for l in range(6):
            total += at.b[k, l] * y[k, l]
            for m in range(6):
                total -= y[k, l] * at.curved[l, m] * y[k, m] / (2 * weight)
        for j in range(len(at.a)):
            t = 0.0
            for l in range(6):
                t += at.a[j, l] * y[k, l]
            u = min(max(t / (2 * weight), 0.0), 1.0)
            total -= u * (t - weight * u)
    if rho.max() > 0.0:
        _look_at_slopes(numbers, at, y)
        for a in range(len(rho)):
            total -= rho[a] * (math.hypot(at.slope[a], FLAT * cut) - FLAT * cut)
    return total


@njit(cache=True)
def _look_at_slopes(numbers: Numbers, at: Middle, y: Array) -> None:
    """Fill the slopes, and how they change with y."""
    at.slope[:], at.steep[:] = 0.0, 0.0
    for k in range(len(y)):
        weight, mu = max(numbers.weight[k], LIGHTEST), y[k, 3:]
        for a in range(len(at.slope)):
            (x, y_, z), (hx, hy, hz), steep = at.moved[a], numbers.h[k], at.steep[a, 6 * k : 6 * k + 6]
            steep[3], steep[4], steep[5] = y_ * hz - z * hy, z * hx - x * hz, x * hy - y_ * hx
            at.slope[a] += steep[3] * mu[0] + steep[4] * mu[1] + steep[5] * mu[2]
        for j in range(len(at.a)):
            t = 0.0
            for l in range(6):
                t += at.a[j, l] * y[k, l]
            if t <= 0.0:
                continue
            u = min(t / (2 * weight), 1.0)
            for a in range(len(at.slope)):
                if not turns(numbers, a, j // 4):
                    continue
                changed, steep = 0.0, at.steep[a, 6 * k : 6 * k + 6]
                for l in range(6):
                    changed += at.change[a, j, l] * y[k, l]
                at.slope[a] -= u * changed
                more = changed / (2 * weight) if u < 1.0 else 0.0
                for l in range(6):
                    steep[l] -= u * at.change[a, j, l] + more * at.a[j, l]


@njit(cache=True)
def _newton(numbers: Numbers, at: Middle, y: Array, rho: Array, cut: float) -> Array:
    """Return the step to the maximum of the quadratic model, shape (d,)."""
    K, d, free = len(y), numbers.free.shape[1], numbers.free
    M, gradient = np.zeros((d, d)), np.zeros(d)
    for k in range(K):
        weight, H = max(numbers.weight[k], LIGHTEST), at.hessian[k]
        for l in range(6):
            at.gradient[6 * k + l] = at.b[k, l]
            for m in range(6):
                H[l, m] = at.curved[l, m] / weight
                at.gradient[6 * k + l] -= H[l, m] * y[k, m]
        for j in range(len(at.a)):
            t = 0.0
            for l in range(6):
                t += at.a[j, l] * y[k, l]
            if t > 0.0:
                u = min(t / (2 * weight), 1.0)
                for l in range(6):
                    at.gradient[6 * k + l] -= u * at.a[j, l]
                if u < 1.0:
                    for l in range(6):
                        for m in range(6):
                            H[l, m] += at.a[j, l] * at.a[j, m] / (2 * weight)
        rows = free[6 * k : 6 * k + 6]
        M += rows.T @ (H @ rows)
        gradient += rows.T @ at.gradient[6 * k : 6 * k + 6]
    if rho.max() > 0.0:
        _look_at_slopes(numbers, at, y)
        for a in range(len(rho)):
            row, pull = at.steep[a] @ free, rho[a] / math.hypot(at.slope[a], FLAT * cut)
            M += pull * np.outer(row, row)
            gradient -= pull * at.slope[a] * row
    size = 0.0
    for m in range(d):
        size += M[m, m]
    for m in range(d):
        M[m, m] += 1e-9 * size / d + 1e-300
    return np.asarray(np.linalg.solve(M, gradient), np.float64)

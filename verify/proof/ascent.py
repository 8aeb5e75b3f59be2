r"""Multipliers for a box: whatever they are the bound holds, and the better they are the higher it is.

What is maximised, by Newton's method within the space of multipliers that p'_E drops out of, is the least dual
function D of some points of the box, smoothed by a temperature T,

.. math:: -T \log \sum_v e^{-D_v(y, \sigma) / T}

less small squares of the multipliers. At one point, the middle, T says nothing. Over the box t = a_j . y changes by
beta_aj . y times the change of angle a, and the bound loses about a quarter of the square of that over lambda. So
there, with rho the half widths,

.. math:: \frac{1}{4} \sum_{k} \frac{1}{\lambda_k} \sum_{a, j} \rho_a^2 (\beta_{aj} \cdot y_k)^2

is subtracted as well. That does for most boxes. For the others the points are all vertices: where a reserve is out
of reach, D at the middle rises without end with the multipliers, and falls the more steeply towards the vertices.

psi of a load case without weight, max(t, 0), has a kink, which Newton's method does not see. Here it counts as
(t + root(t^2 + s^2) - s) / 2, and so does that of any weight under the width s. At the vertices T and s fall from
stage to stage. Load cases that cost nothing then have multipliers that bring nothing: `leave` sets these to zero.
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
from verify.proof.platform import Numbers

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
STAGES = 5
STEPS = 3
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
    """sum_{a, j} rho_a^2 beta_aj beta_aj^T / 2 at the middle, 0 at vertices, shape (6, 6)."""
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
    ridge: Array
    """Ridges of y and sigma, shape (2,)."""


class Turns(NamedTuple):
    """Changes with the angles at the middle of a box."""

    axes: Array
    """Direction and point of every angle's axis in W, shape (A, 2, 3)."""
    change: Array
    """beta, shape (A, 4 n, 6)."""
    shift: Array
    """Derivatives of n_r . e_r by the angles, shape (A, W)."""


@njit(cache=True, literals=False)
def workspace(numbers: Numbers, count: int) -> Points:
    """Return arrays for `count` points."""
    n, K, W = len(numbers.parent), len(numbers.f), len(numbers.normal)
    rows, wall_rows = np.zeros((K, 3 + MOST, 6)), np.zeros((3 + MOST, W))
    for k in range(K):
        x, y, z = numbers.g[k]
        rows[k, 0, 4], rows[k, 0, 5] = -z, y
        rows[k, 1, 3], rows[k, 1, 5] = z, -x
        rows[k, 2, 3], rows[k, 2, 4] = -y, x
    for r in range(W):
        wall_rows[:3, r] = -numbers.normal[r]
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
        np.ones(2),
    )
    _fill_project(at)
    return at


@njit(cache=True)
def turn_arrays(numbers: Numbers) -> Turns:
    """Return arrays for one box."""
    n = len(numbers.parent)
    return Turns(np.zeros((n + 2, 2, 3)), np.zeros((n + 2, 4 * n, 6)), np.zeros((n + 2, len(numbers.normal))))


@njit(cache=True, literals=False)
def look(numbers: Numbers, points: Array, frames: Frames, at: Points, v: int) -> None:
    """Fill what D depends on at point v; frames are those there, one a module, points its pairs (c, s)."""
    R, total = at.R, np.zeros(3)
    root_turn(points[0, 0], points[1, 0], points[2, 0], R)
    for i in range(len(numbers.parent)):
        w, a, b = numbers.bodies[i]
        total += R @ (w * frames.p[i] + a * frames.R[i, :, 0] + b * frames.R[i, :, 1])
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
        at.wall[v, r] = (numbers.normal[r] * (R @ _end(numbers, frames, r))).sum() + numbers.beyond[r]
    for k in range(len(numbers.f)):
        x, y, z = numbers.h[k]
        b = at.b[v, k]
        b[:3], b[3:] = numbers.f[k], numbers.t[k]
        b[3] += total[1] * z - total[2] * y
        b[4] += total[2] * x - total[0] * z
        b[5] += total[0] * y - total[1] * x


@njit(cache=True)
def _end(numbers: Numbers, frames: Frames, r: int) -> Array:
    """Return the end of the envelope of row r of the walls, seen from the root."""
    i = numbers.module[r]
    return np.asarray(frames.p[i] - numbers.down[r] * frames.R[i, :, 2], np.float64)


@njit(cache=True)
def look_around(numbers: Numbers, points: Array, frames: Frames, rho: Array, at: Points, turning: Turns) -> None:
    """Fill what angles do at the middle, the point of `at`, as `look` does."""
    _fill_axes(numbers, points, frames, at, turning)
    at.curved[:], turning.change[:], turning.shift[:] = 0.0, 0.0, 0.0
    for angle in range(len(rho)):
        direction, point = turning.axes[angle]
        for j in range(at.a.shape[1]):
            if turns(numbers, angle, j // 4):
                change = turning.change[angle, j]
                _fill_change(direction, point, at.a[0, j], change)
                at.curved[:] += rho[angle] ** 2 / 2 * np.outer(change, change)
        for r in range(len(numbers.normal)):
            if turns(numbers, angle, numbers.module[r]):
                moved = np.cross(direction, at.R @ _end(numbers, frames, r) - point)
                turning.shift[angle, r] = (numbers.normal[r] * moved).sum()


@njit(cache=True)
def _fill_axes(numbers: Numbers, points: Array, frames: Frames, at: Points, turning: Turns) -> None:
    (c, s), (c0, s0) = points[0, 0], points[1, 0]
    turning.axes[:3] = 0.0
    turning.axes[0, 0, 2] = 1.0
    turning.axes[1, 0, 0], turning.axes[1, 0, 1] = c, s
    turning.axes[2, 0, 0], turning.axes[2, 0, 1], turning.axes[2, 0, 2] = -s * c0, c * c0, s0
    for i in range(1, len(numbers.parent)):
        h, port = numbers.parent[i], numbers.port[i]
        arm, across = (0, 1) if port % 2 == 0 else (1, 0)
        step = numbers.l_c if port < 2 else -numbers.l_c
        for row in range(3):
            direction, point = 0.0, 0.0
            for l in range(3):
                direction += at.R[row, l] * frames.R[h, l, across]
                point += at.R[row, l] * (frames.p[h, l] + step * frames.R[h, l, arm])
            turning.axes[i + 2, 0, row], turning.axes[i + 2, 1, row] = direction, point


@njit(cache=True)
def turns(numbers: Numbers, angle: int, i: int) -> bool:
    """True if an angle turns a module: one of the root, or of a hinge on its path."""
    while i > 0 and i + 2 != angle:
        i = numbers.parent[i]
    return angle < 3 or i > 0


@njit(cache=True)
def _fill_change(direction: Array, point: Array, wrench: Array, change: Array) -> None:
    """Fill how a rotor's wrench changes with an angle: omega x f, and likewise the torque about the axis."""
    w0, w1, w2 = direction
    c0, c1, c2 = point
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
    at.ridge[0], at.ridge[1] = RIDGE, max(square, 1e-4) * lever * lever / cut
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
        climb(numbers, at, y, sigma, T, TOO_MUCH * cut, STEPS)
        if at.D.min() + T * math.log(len(at.D)) < HOPELESS * cut:
            break
        blur(numbers, at, SHARP)
        value(numbers, at, y, sigma, T)
        if at.D.min() > ENOUGH * cut:
            break
        T, s = SOFTER * T, SHARPER * s
        at.ridge[:] *= SHARPER
    blur(numbers, at, s)
    leave(numbers, at, y, sigma)


@njit(cache=True, literals=False)
def climb(numbers: Numbers, at: Points, y: Array, sigma: Array, T: float, enough: float, steps: int) -> float:
    """Improve multipliers that p'_E drops out of, in place, and return what is maximised.

    Args:
        numbers: the task and the tree.
        at: points of a box.
        y: multipliers, shape (K, 6).
        sigma: those of walls, shape (W,).
        T: temperature.
        enough: beyond which there is nothing to gain; a shorter step does as well.
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
            if best < reached < enough:
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


@njit(cache=True)
def value(numbers: Numbers, at: Points, y: Array, sigma: Array, T: float) -> float:
    """Return what is maximised, and fill D."""
    squares = at.ridge[0] / 2 * (y * y).sum() + at.ridge[1] / 2 * (sigma * sigma).sum()
    for k in range(len(y)):
        if at.active[k]:
            squares += (y[k] * (at.curved @ y[k])).sum() / (2 * at.weight[k])
    for v in range(len(at.D)):
        total = (sigma * at.wall[v]).sum()
        for k in range(len(y)):
            if not at.active[k]:
                continue
            weight, blurred, (y0, y1, y2, y3, y4, y5) = at.weight[k], numbers.weight[k] < at.weight[k], y[k]
            b = at.b[v, k]
            total += b[0] * y0 + b[1] * y1 + b[2] * y2 + b[3] * y3 + b[4] * y4 + b[5] * y5
            for j in range(at.a.shape[1]):
                a = at.a[v, j]
                t = a[0] * y0 + a[1] * y1 + a[2] * y2 + a[3] * y3 + a[4] * y4 + a[5] * y5
                if blurred:
                    total -= (t + math.sqrt(t * t + weight * weight) - weight) / 2
                elif t > 0.0:
                    u = min(t / (2 * weight), 1.0)
                    total -= u * (t - weight * u)
        at.D[v] = total
    least = at.D.min()
    return float(least - T * math.log(np.exp((least - at.D) / T).sum()) - squares)


@njit(cache=True)
def _newton(numbers: Numbers, at: Points, y: Array, sigma: Array, T: float) -> None:
    """Fill the step to the maximum of the quadratic model under which p'_E drops out, once D is filled.

    A point with the share w adds the square of root(w / T) (its gradient less the mean one) . step to the model: a
    tied row that gives way.
    """
    K, share = len(y), np.exp((at.D.min() - at.D) / T)
    order = np.argsort(-share)[:MOST]
    order = order[share[order] > LIGHT * share.sum()]
    share = share[order] / share[order].sum()
    tied = 3 + len(order) if len(order) > 1 else 3
    S, q = np.zeros((tied, tied)), np.zeros(tied)
    q[0], q[1], q[2] = residual(numbers, y, sigma)
    pull = share @ at.wall[order]
    for row in range(3, tied):
        S[row, row] = 1.0
        at.wall_rows[row] = math.sqrt(share[row - 3] / T) * (at.wall[order[row - 3]] - pull)
    solved, gradient = np.zeros((K, 6, 1 + tied)), np.empty((len(order), 6))
    for k in range(K):
        if not at.active[k]:
            continue
        weight, blurred, rows = at.weight[k], numbers.weight[k] < at.weight[k], at.rows[k, :tied]
        H = at.curved / weight + at.ridge[0] * np.eye(6)
        squares = H @ y[k]
        for point in range(len(order)):
            v, g = order[point], gradient[point]
            g[:] = at.b[v, k]
            for j in range(at.a.shape[1]):
                a, t = at.a[v, j], 0.0
                for l in range(6):
                    t += a[l] * y[k, l]
                if blurred:
                    length = math.sqrt(t * t + weight * weight)
                    u, stiff = (1 + t / length) / 2, weight * weight / (2 * length**3)
                else:
                    u = min(max(t / (2 * weight), 0.0), 1.0)
                    stiff = 1 / (2 * weight) if 0.0 < u < 1.0 else 0.0
                stiff *= share[point]
                for l in range(6):
                    g[l] -= u * a[l]
                if stiff > BESIDE * at.ridge[0]:
                    for l in range(6):
                        for m in range(6):
                            H[l, m] += stiff * a[l] * a[m]
        mean = share @ gradient
        for row in range(3, tied):
            rows[row] = math.sqrt(share[row - 3] / T) * (gradient[row - 3] - mean)
        right = np.empty((6, 1 + tied))
        right[:, 0], right[:, 1:] = mean - squares, rows.T
        solved[k] = np.linalg.solve(H, right)
        q += rows @ solved[k, :, 0].copy()
        S += rows @ solved[k, :, 1:].copy()
    size = S[0, 0] + S[1, 1] + S[2, 2]
    for row in range(3):
        S[row, row] += 1e-9 * size if size > 0.0 else 1.0
    x = _tie(at, sigma, pull, S, q)
    for k in range(K):
        at.step[k] = solved[k, :, 0] - solved[k, :, 1:].copy() @ x


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

r"""Multipliers for a box: whatever they are the bound holds, and the better they are the higher it is.

At the middle of the box the dual function is concave in y. Over the box t = a_j . y changes by beta_aj . y times
the change of angle a, and the bound loses about a quarter of the square of that over lambda. So what is
maximised, by Newton's method, is the dual function at the middle less

.. math:: \frac{1}{4} \sum_{k} \frac{1}{\lambda_k} \sum_{a, j} \rho_a^2 (\beta_{aj} \cdot y_k)^2

with rho the half widths, within the space of multipliers that p'_E drops out of. The multipliers of walls have a
small square subtracted as well. Load cases without weight count with a little, as much as a box of that size blurs
them; those that would cost nothing then have multipliers that bring nothing, and `leave` sets these to zero. Where
that does not do, the slopes g_a of the dual function are taken into account as well: towards a corner it falls by
rho_a |g_a| an angle, so that

.. math:: \sum_a \rho_a \left(\sqrt{g_a^2 + m^2} - m\right)

is subtracted too, with a part of the above, which stood for the slopes as well. For a step the root is replaced by
the parabola over it that touches it where g_a is.
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
"""Weight that a load case counts with here at least: the dual function of one without is not smooth."""
BLURRED = 0.1
"""Or this times the root of sum_a rho_a^2, if that is less."""
FREE = 6.0
"""A load case whose |a_j . y_k| are all less, in the weight that it counts with, costs nothing."""
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
    wall: Array
    """n_r . e_r + d_r, shape (W,)."""
    shift: Array
    """Its derivatives by the angles, shape (A, W)."""
    weight: Array
    """Weights that load cases count with, shape (K,)."""
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
    solved: Array
    """A case's Hessian's inverse times its gradient and the tied rows, shape (K, 6, 4 + A)."""
    rows: Array
    """Tied rows, shape (3 + A, 6 K): how p'_E's factor changes with y, then the slopes."""
    wall_rows: Array
    """Likewise with sigma, shape (3 + A, W)."""
    ridge: Array
    """Ridge of sigma's square, shape (1,)."""


@njit(cache=True)
def workspace(numbers: Numbers) -> Middle:
    """Return arrays for one box."""
    n, K, W = len(numbers.parent), len(numbers.f), len(numbers.normal)
    rows, wall_rows = np.zeros((n + 5, 6 * K)), np.zeros((n + 5, W))
    for k in range(K):
        x, y, z = numbers.g[k]
        rows[0, 6 * k + 4], rows[0, 6 * k + 5] = -z, y
        rows[1, 6 * k + 3], rows[1, 6 * k + 5] = z, -x
        rows[2, 6 * k + 3], rows[2, 6 * k + 4] = -y, x
    for r in range(W):
        wall_rows[:3, r] = -numbers.normal[r]
    at = Middle(
        np.zeros((4 * n, 6)),
        np.zeros((K, 6)),
        np.zeros((6, 6)),
        np.zeros((n + 2, 2, 3)),
        np.zeros((n + 2, 4 * n, 6)),
        np.zeros((n + 2, 3)),
        np.zeros(n + 2),
        np.zeros((n + 2, 6 * K)),
        np.zeros(W),
        np.zeros((n + 2, W)),
        np.zeros(K),
        np.ones(K, np.bool_),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros((K, 6)),
        np.zeros(W),
        np.zeros((K, 6, n + 6)),
        rows,
        wall_rows,
        np.ones(1),
    )
    _fill_project(numbers, at)
    return at


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
    for r in range(len(at.wall)):
        i = numbers.module[r]
        e = R @ (frames.p[i] - numbers.down[r] * frames.R[i, :, 2])
        at.wall[r] = (numbers.normal[r] * e).sum() + numbers.beyond[r]
        for angle in range(n + 2):
            if turns(numbers, angle, i):
                moved = np.cross(at.axes[angle, 0], e - at.axes[angle, 1])
                at.shift[angle, r] = (numbers.normal[r] * moved).sum()
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
def blur(numbers: Numbers, at: Middle, rho: Array, cut: float) -> None:
    """Take all load cases in, none lighter than a box of half widths rho blurs it."""
    square = (rho * rho).sum()
    lightest, lever = min(LIGHTEST, BLURRED * math.sqrt(square)), 2 * numbers.l_c * numbers.depth.max() + 1
    for k in range(len(at.weight)):
        at.weight[k] = max(numbers.weight[k], lightest)
    if not np.all(at.active):
        at.active[:] = True
        _fill_project(numbers, at)
    at.ridge[0] = max(square, 1e-4) * lever * lever / cut


@njit(cache=True)
def leave(numbers: Numbers, at: Middle, y: Array, sigma: Array) -> bool:
    """Leave out load cases that cost nothing, and return whether there are any."""
    left = False
    for k in range(len(y)):
        if numbers.weight[k] == 0.0 and at.active[k]:
            at.active[k] = bool(np.abs(at.a @ y[k]).max() > FREE * at.weight[k])
            left |= not at.active[k]
            if not at.active[k]:
                y[k] = 0.0
    if left:
        _fill_project(numbers, at)
        balance(numbers, at, y, sigma)
    return left


@njit(cache=True)
def _fill_project(numbers: Numbers, at: Middle) -> None:
    """Fill what turns a miss into the change that meets the condition."""
    M = np.zeros((3, 3))
    for k in range(len(at.active)):
        if at.active[k]:
            C = at.rows[:3, 6 * k + 3 : 6 * k + 6].copy()
            M += C @ C.T
    at.project[:] = np.linalg.pinv(M, 1e-10)


@njit(cache=True)
def balance(numbers: Numbers, at: Middle, y: Array, sigma: Array) -> None:
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
def climb(numbers: Numbers, at: Middle, y: Array, sigma: Array, rho: Array, cut: float, steps: int) -> float:
    """Improve multipliers that p'_E drops out of, in place, and return what is maximised.

    Args:
        numbers: the task and the tree.
        at: the middle of a box.
        y: multipliers, shape (K, 6).
        sigma: those of walls, shape (W,).
        rho: half widths for which slopes are taken into account; 0: they are not.
        cut: beyond which there is nothing to gain.
        steps: most of them.
    """
    best = value(numbers, at, y, sigma, rho, cut)
    for _ in range(steps):
        if best > ENOUGH * cut:
            break
        _newton(numbers, at, y, sigma, rho, cut)
        size = math.sqrt((y * y).sum() + (sigma * sigma).sum())
        long = math.sqrt((at.step * at.step).sum() + (at.wall_step * at.wall_step).sum())
        share = min(1.0, LONGEST * size / long) if long > 0.0 and size > 0.0 else 1.0
        smallest, found = SHORTEST * share, -math.inf
        while share > smallest:
            ahead, pressed = y + share * at.step, np.maximum(sigma + share * at.wall_step, 0.0)
            found = value(numbers, at, ahead, pressed, rho, cut)
            if found > best:
                break
            share *= 0.3
        if not found > best:
            break
        y[:], sigma[:] = ahead, pressed
        gain, best = found - best, found
        if gain < PAYS * abs(best):
            break
    balance(numbers, at, y, sigma)
    return best


@njit(cache=True)
def value(numbers: Numbers, at: Middle, y: Array, sigma: Array, rho: Array, cut: float) -> float:
    """Return what is maximised."""
    total = float((sigma * (at.wall - at.ridge[0] / 2 * sigma)).sum())
    for k in range(len(y)):
        if not at.active[k]:
            continue
        weight = at.weight[k]
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
        _look_at_slopes(numbers, at, y, sigma)
        for a in range(len(rho)):
            total -= rho[a] * (math.hypot(at.slope[a], FLAT * cut) - FLAT * cut)
    return total


@njit(cache=True)
def _look_at_slopes(numbers: Numbers, at: Middle, y: Array, sigma: Array) -> None:
    """Fill the slopes, and how they change with y."""
    at.steep[:] = 0.0
    for a in range(len(at.slope)):
        at.slope[a] = (at.shift[a] * sigma).sum()
    for k in range(len(y)):
        if not at.active[k]:
            continue
        weight, mu = at.weight[k], y[k, 3:]
        for a in range(len(at.slope)):
            (x, y_, z), (hx, hy, hz), steep = at.moved[a], numbers.h[k], at.steep[a, 6 * k : 6 * k + 6]
            steep[3], steep[4], steep[5] = y_ * hz - z * hy, z * hx - x * hz, x * hy - y_ * hx
            at.slope[a] += steep[3] * mu[0] + steep[4] * mu[1] + steep[5] * mu[2]
        for j in range(len(at.a)):
            t = 0.0
            for l in range(6):
                t += at.a[j, l] * y[k, l]
            u = min(max(t / (2 * weight), 0.0), 1.0)
            if u <= 0.0:
                continue
            for a in range(len(at.slope)):
                if not turns(numbers, a, j // 4):
                    continue
                changed, steep = 0.0, at.steep[a, 6 * k : 6 * k + 6]
                for l in range(6):
                    changed += at.change[a, j, l] * y[k, l]
                at.slope[a] -= u * changed
                more = changed / (2 * weight) if 0.0 < u < 1.0 else 0.0
                for l in range(6):
                    steep[l] -= u * at.change[a, j, l] + more * at.a[j, l]


@njit(cache=True)
def _newton(numbers: Numbers, at: Middle, y: Array, sigma: Array, rho: Array, cut: float) -> None:
    """Fill the step to the maximum of the quadratic model under which p'_E drops out.

    A slope's part of the model is (g_a + row . step)^2 times its pull / 2: a tied row that gives way.
    """
    K, tied = len(y), 3
    if rho.max() > 0.0:
        _look_at_slopes(numbers, at, y, sigma)
        tied += len(rho)
        at.rows[3:], at.wall_rows[3:] = at.steep, at.shift
    S, q = np.zeros((tied, tied)), np.zeros(tied)
    q[0], q[1], q[2] = residual(numbers, y, sigma)
    for a in range(tied - 3):
        S[3 + a, 3 + a] = math.hypot(at.slope[a], FLAT * cut) / max(rho[a], 1e-12)
        q[3 + a] = at.slope[a]
    right = np.zeros((6, 1 + tied))
    for k in range(K):
        if not at.active[k]:
            continue
        weight, rows = at.weight[k], at.rows[:tied, 6 * k : 6 * k + 6]
        H, trace = at.curved / weight, 0.0
        for l in range(6):
            right[l, 0] = at.b[k, l] - (H[l] * y[k]).sum()
        for j in range(len(at.a)):
            t = 0.0
            for l in range(6):
                t += at.a[j, l] * y[k, l]
            u = min(max(t / (2 * weight), 0.0), 1.0)
            for l in range(6):
                right[l, 0] -= u * at.a[j, l]
            if 0.0 < u < 1.0:
                for l in range(6):
                    for m in range(6):
                        H[l, m] += at.a[j, l] * at.a[j, m] / (2 * weight)
        for l in range(6):
            trace += H[l, l]
        for l in range(6):
            H[l, l] += 1e-9 * trace + 1e-300
            for row in range(tied):
                right[l, 1 + row] = rows[row, l]
        solved = np.linalg.solve(H, right)
        at.solved[k, :, : 1 + tied] = solved
        for row in range(tied):
            for l in range(6):
                q[row] += rows[row, l] * solved[l, 0]
                for column in range(tied):
                    S[row, column] += rows[row, l] * solved[l, 1 + column]
    size = S[0, 0] + S[1, 1] + S[2, 2]
    for row in range(3):
        S[row, row] += 1e-9 * size if size > 0.0 else 1.0
    x = _tie(at, sigma, S, q)
    for k in range(K):
        for l in range(6):
            at.step[k, l] = 0.0
            if at.active[k]:
                at.step[k, l] = at.solved[k, l, 0]
                for row in range(tied):
                    at.step[k, l] -= at.solved[k, l, 1 + row] * x[row]


@njit(cache=True)
def _tie(at: Middle, sigma: Array, S: Array, q: Array) -> Array:
    """Return the multipliers of the tied rows, and fill the walls' step, which ends at 0 or above."""
    ridge, rows = at.ridge[0], at.wall_rows
    presses = sigma > 0.0
    x = q
    for _ in range(CHANGES):
        M, right = S.copy(), q.copy()
        for r in range(len(sigma)):
            right += rows[: len(q), r] * ((at.wall[r] / ridge if presses[r] else 0.0) - sigma[r])
            if presses[r]:
                M[:] += np.outer(rows[: len(q), r], rows[: len(q), r]) / ridge
        x = np.asarray(np.linalg.solve(M, right), np.float64)
        before = presses.copy()
        for r in range(len(sigma)):
            pull = (at.wall[r] - (rows[: len(q), r] * x).sum()) / ridge
            presses[r] = pull > 0.0
            at.wall_step[r] = max(pull, 0.0) - sigma[r]
        if np.all(before == presses):
            break
    return x

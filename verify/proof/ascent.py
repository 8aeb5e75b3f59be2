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

psi of a load case without weight, u_min t + (1 - u_min) max(t, 0), has a kink, which Newton's method does not see.
Here max(t, 0) counts as (t + root(t^2 + s^2) - s) / 2, and so it does with any weight under the width s. At the
vertices T and s fall from stage to stage. Load cases that cost nothing then have multipliers that bring nothing:
`leave` sets these to zero.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model.compiled_code import njit
from verify.bodies import Array
from verify.proof.dual import residual
from verify.proof.platform import Indices, Numbers
from verify.proof.points import MOST_POINTS, Points, fill_project


class Ascent(NamedTuple):
    """Settings of the search."""

    widest_kink: float = 1e-2
    """Largest s at the middle."""
    kink_of_rho: float = 0.1
    """Largest s at the middle, over the root of sum_a rho_a^2."""
    free: float = 6.0
    """Largest |a_j . y_k|, in s, of a load case that costs nothing."""
    unmet: float = 1e-9
    """Share of the walls' multipliers by which p'_E may fail to drop out, for rounding."""
    wall_changes: int = 3
    """Number of times that a step takes other walls into account."""
    longest: float = 3.0
    """Longest step, in the multipliers' own size."""
    shortest: float = 1e-3
    """Share of a Newton step under which it is given up."""
    shorter: float = 0.3
    """Length of the next share of a step that is tried, in that of the last."""
    gain: float = 1e-4
    """Share of the value that a step must gain for another."""
    enough: float = 1.1
    """Share of the cut at which the search at vertices ends."""
    hopeless: float = 0.98
    """Share of the cut that D of other multipliers must be able to reach; s makes D greater than it is."""
    most: float = 2.0
    """Share of the cut at which a stage ends, for the same reason."""
    flat: float = 0.01
    """m, in the cut."""
    stages: int = 8
    steps: int = 6
    """Newton steps per stage."""
    soft: float = 0.05
    """T of the first stage, in the cut."""
    softer: float = 0.6
    """T of the next stage, in that of this one."""
    kink: float = 0.15
    """s of the first stage, in the cut over 4 n."""
    sharper: float = 0.35
    """s and ridges of the next stage, in those of this one."""
    sharp: float = 1e-9
    """s that tells what D is."""
    light: float = 1e-3
    """Least share of a point that counts in a step."""
    ridge: float = 1e-3
    """Ridge of y at the middle, which stands for the bound's loss to remainders, in boxes that are not narrow."""
    narrow: float = 1e-4
    """Largest sum_a rho_a^2 of a narrow box, whose ridge and gain are less in proportion [rad^2]."""
    least_narrow: float = 1e-4
    """Least of that proportion."""
    ridge_of_y: float = 1.0
    """Ridge of y of the first stage, which keeps multipliers short where the best have no end."""
    ridge_of_sigma: float = 20.0
    """Likewise of sigma."""
    beside: float = 1e-3
    """Stiffness of a rotor that a step leaves out, in the ridge of y."""


ASCENT = Ascent()


@njit(cache=True)
def begin(numbers: Numbers, at: Points, rho: Array, cut: float) -> None:
    """Take all load cases in, as a box of half widths rho blurs them."""
    square = (rho * rho).sum()
    narrow = min(1.0, max(ASCENT.least_narrow, square / ASCENT.narrow))
    lever = 2 * numbers.l_c * numbers.depth.max() + 1
    at.ridge[0], at.ridge[2], at.ridge[3] = ASCENT.ridge * narrow, ASCENT.flat * cut, ASCENT.gain * narrow
    at.ridge[1] = max(square, 1e-4) * lever * lever / cut
    blur(numbers, at, max(ASCENT.sharp, min(ASCENT.widest_kink, ASCENT.kink_of_rho * math.sqrt(square))))
    if not np.all(at.active):
        at.active[:] = True
        fill_project(at)


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
            if dearest <= ASCENT.free * at.weight[k]:
                y[k], at.active[k], left = 0.0, False, True
    if left:
        fill_project(at)
        balance(numbers, at, y, sigma)
    return left


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
        if math.sqrt(x * x + y_ * y_ + z * z) <= ASCENT.unmet * sigma.sum():
            break
        sigma[:] = 0.0


@njit(cache=True)
def lift(numbers: Numbers, at: Points, y: Array, sigma: Array, cut: float) -> None:
    """Improve multipliers at the worst of all points, in place."""
    T, s = ASCENT.soft * cut, ASCENT.kink * cut / at.a.shape[1]
    at.ridge[0], at.ridge[1], at.ridge[3] = ASCENT.ridge_of_y, ASCENT.ridge_of_sigma, ASCENT.gain
    for _ in range(ASCENT.stages):
        blur(numbers, at, s)
        climb(numbers, at, y, sigma, T, ASCENT.most * cut, ASCENT.most * cut, ASCENT.steps)
        held = (at.ridge[0] * (y * y).sum() + at.ridge[1] * (sigma * sigma).sum()) / 2  # by ridges
        if at.D.min() + T * math.log(len(at.D)) + held < ASCENT.hopeless * cut:
            break
        blur(numbers, at, ASCENT.sharp)
        value(numbers, at, y, sigma, T)
        if at.D.min() > ASCENT.enough * cut:
            break
        T, s = ASCENT.softer * T, ASCENT.sharper * s
        at.ridge[:2] *= ASCENT.sharper
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
        share = min(1.0, ASCENT.longest * size / long) if long > 0.0 and size > 0.0 else 1.0
        smallest, reached = ASCENT.shortest * share, -math.inf
        while share > smallest:
            ahead, pressed = y + share * at.step, np.maximum(sigma + share * at.wall_step, 0.0)
            reached = value(numbers, at, ahead, pressed, T)
            if best < reached < most:
                break
            share *= ASCENT.shorter
        if not reached > best:
            break
        y[:], sigma[:] = ahead, pressed
        gain, best = reached - best, reached
        if gain < at.ridge[3] * abs(best):
            break
    balance(numbers, at, y, sigma)
    return best


@njit(cache=True, allocates=False)
def value(numbers: Numbers, at: Points, y: Array, sigma: Array, T: float) -> float:
    """Return what is maximised, and fill D and slopes."""
    taken, lowest, u_min = 0.0, math.inf, numbers.u_min
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
                    total -= u_min * t + (1 - u_min) / 2 * (t + math.sqrt(t * t + weight * weight) - weight)
                else:
                    u = min(max(t / (2 * weight), u_min), 1.0)
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
            u, stiff = _pull(t, weight, blurred, numbers.u_min)
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
def _pull(t: float, weight: float, blurred: bool, u_min: float) -> tuple[float, float]:
    """Return the first and second derivative of psi."""
    if blurred:
        length, half = math.sqrt(t * t + weight * weight), (1 - u_min) / 2
        return u_min + half * (1 + t / length), half * weight * weight / (length * length * length)
    u = t / (2 * weight)
    if u <= u_min:
        return u_min, 0.0
    return (u, 1 / (2 * weight)) if u < 1.0 else (1.0, 0.0)


@njit(cache=True)
def _newton(numbers: Numbers, at: Points, y: Array, sigma: Array, T: float) -> None:
    """Fill the step to the maximum of the quadratic model under which p'_E drops out, once `value` was called.

    A point with the share w adds the square of root(w / T) (its gradient less the mean one) . step to the model,
    an angle (g_a + its change with y . step)^2 rho_a / root(g_a^2 + m^2): tied rows that give way.
    """
    K, A, share = len(y), len(at.turning.rho), np.exp((at.D.min() - at.D) / T)
    order = np.argsort(-share)[:MOST_POINTS]
    order = order[share[order] > ASCENT.light * share.sum()]
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
            u, stiff = _pull(t, weight, blurred, numbers.u_min)
            stiff *= share[point]
            if u > 0.0:
                for l in range(6):
                    g[l] -= u * a[l]
            if stiff > ASCENT.beside * at.ridge[0]:
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
    for _ in range(ASCENT.wall_changes):
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

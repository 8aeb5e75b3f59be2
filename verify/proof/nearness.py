r"""Boxes of hinges in which two modules are nearer to each other than is allowed, whatever the root.

Take a point on the axis of each module's envelope, or their centres, or the middle of a ball in one module's parts
and a point on the other one's axis. Seen from the last module that both paths share, each is a product of matrices
in the pairs (c, s) of its own hinges, and with d a step along an arm

.. math:: |x + d|^2 = |x|^2 + 2 d \cdot x + |d|^2, \qquad |H x|^2 = |x|^2

so that w = |x|^2, carried along as a number of its own, is affine in each pair; so is the squared distance w_i +
w_j - 2 x_i . x_j, as no hinge is on both sides. It is greatest at a choice of corners (`verify.proof.arcs`).
Where that is under the squared sum of the two radii, the balls about the two points overlap in all of the box. It
does not matter how the points were chosen.

**Rounding.** With corners of 1.44 at most, x and w are off by less than 10 m eps gamma S and 20 m eps gamma S^2
after m steps (eps = 2^-53, S the length of the path stretched out with both axes, gamma the product of the
corners' sizes): SQUARE_ROUNDING S^2 gamma^2 is over a thousand times what 12 modules need.
"""

from __future__ import annotations

import math

import numpy as np

from topo_search.model.compiled_code import njit
from verify.bodies import Array
from verify.proof.arcs import Frames
from verify.proof.platform import Indices, Numbers

Vector = tuple[float, float, float]
CENTRE = (0.0, 0.0, 0.0)
SQUARE_ROUNDING = 1e-11
"""Share of the squared length of the path by which a squared distance may be wrong."""


@njit(cache=True)
def are_too_near(numbers: Numbers, corners: Array, frames: Frames, pair: Indices) -> bool:
    """Return whether two modules are too near to each other in all of a box.

    Args:
        numbers: the task and the tree.
        corners: of the angles, shape (A, 3, 2).
        frames: those at the middle of the box, one a module.
        pair: the two that were so in the box before, which are tried first; is filled with those found, or with the
            two that are nearest at the middle.
    """
    n, worst, nearest = len(numbers.parent), math.inf, (0, 0)
    if pair[0] != pair[1] and _is_pair_too_near(numbers, corners, frames, pair[0], pair[1])[0]:
        return True
    for i in range(n):
        for j in range(i + 1, n):
            too_near, gap = _is_pair_too_near(numbers, corners, frames, i, j)
            if too_near or gap < worst:
                worst, nearest = gap, (i, j)
            if too_near:
                pair[0], pair[1] = i, j
                return True
    pair[0], pair[1] = nearest
    return False


@njit(cache=True)
def _is_pair_too_near(numbers: Numbers, corners: Array, frames: Frames, i: int, j: int) -> tuple[bool, float]:
    """Return whether two modules are too near in all of a box, and by how much they are not at the middle."""
    gap = math.inf
    if numbers.airflow:
        eta, gamma, gap = deepest(numbers, frames, i, j)
        radii = 2 * numbers.start_radius + (eta + gamma) * numbers.growth
        down = ((0.0, 0.0, -eta * numbers.length), (0.0, 0.0, -gamma * numbers.length))
        gap -= numbers.margin
        if gap < 0.0 and farthest(numbers, corners, i, j, down) < radii * (radii + 2 * numbers.margin):
            return True, gap
    for b in range(0 if numbers.bolted[i, j] else len(numbers.parts)):
        for one, other in ((i, j), (j, i)):
            share, ball = _deepest_in_air(numbers, frames, one, other, b)
            gap = min(gap, ball)
            if ball < 0.0:
                x, y, z, radius = numbers.parts[b]
                radii = radius + numbers.start_radius + share * numbers.growth
                down = ((x, y, z), (0.0, 0.0, -share * numbers.length))
                if farthest(numbers, corners, one, other, down) < radii * (radii + 2 * numbers.margin):
                    return True, gap
    if numbers.apart > 0.0 and not (numbers.exempt and numbers.bolted[i, j]):
        centres = math.sqrt(((frames.p[i] - frames.p[j]) ** 2).sum()) - numbers.apart
        gap = min(gap, centres)
        if centres < 0.0 and farthest(numbers, corners, i, j, (CENTRE, CENTRE)) < numbers.apart**2:
            return True, gap
    return False, gap


@njit(cache=True)
def _deepest_in_air(numbers: Numbers, frames: Frames, i: int, j: int, b: int) -> tuple[float, float]:
    """Return the share of the axis of j at which the ball b of module i is deepest in its airflow, and the gap."""
    x, y, z, radius = numbers.parts[b]
    R, axis = frames.R[i], frames.R[j, :, 2]
    w = frames.p[i] + x * R[:, 0] + y * R[:, 1] + z * R[:, 2] - frames.p[j]
    share = _nearest(-w, axis, numbers.length, numbers.growth)
    apart = w + share * numbers.length * axis
    gap = math.sqrt((apart * apart).sum()) - radius - numbers.start_radius - share * numbers.growth
    return share, gap - numbers.margin


@njit(cache=True)
def deepest(numbers: Numbers, frames: Frames, i: int, j: int) -> tuple[float, float, float]:
    """Return shares of two axes at which the balls are about deepest in each other, and the gap there."""
    L, grow = numbers.length, numbers.growth
    w, zi, zj = frames.p[i] - frames.p[j], frames.R[i, :, 2], frames.R[j, :, 2]
    best = (0.0, 0.0, math.inf)
    for start in range(5):  # from a corner of the square or its middle, one share after the other
        eta, gamma = (0.5, 0.5) if start == 4 else (float(start // 2), float(start % 2))
        for _ in range(12):
            eta = _nearest(w + gamma * L * zj, zi, L, grow)
            gamma = _nearest(-w + eta * L * zi, zj, L, grow)
        apart = w - eta * L * zi + gamma * L * zj
        gap = math.sqrt((apart * apart).sum()) - 2 * numbers.start_radius - (eta + gamma) * grow
        if gap < best[2]:
            best = (eta, gamma, gap)
    return best


@njit(cache=True)
def _nearest(w: Array, z: Array, L: float, grow: float) -> float:
    """Return the share of an axis -L z at which |w - share L z| - share grow is least."""
    if grow >= L:
        return 1.0
    along = (w * z).sum()
    across = math.sqrt(max(0.0, (w * w).sum() - along * along))
    share: float = (along + across * grow / math.sqrt(L * L - grow * grow)) / L
    return min(1.0, max(0.0, share))


@njit(cache=True)
def farthest(numbers: Numbers, corners: Array, i: int, j: int, points: tuple[Vector, Vector]) -> float:
    """Return the greatest squared distance in a box of two points, each in the frame of its module."""
    most: float
    shared, other = i, j
    while shared != other:
        if shared > other:
            shared = numbers.parent[shared]
        else:
            other = numbers.parent[other]
    x, w, gamma = _view_from(numbers, corners, i, shared, points[0])
    x_, w_, gamma_ = _view_from(numbers, corners, j, shared, points[1])
    most = -math.inf
    for v in range(len(w)):
        for v_ in range(len(w_)):
            dot = x[v, 0] * x_[v_, 0] + x[v, 1] * x_[v_, 1] + x[v, 2] * x_[v_, 2]
            most = max(most, w[v] + w_[v_] - 2 * dot)
    steps = numbers.depth[i] + numbers.depth[j] - 2 * numbers.depth[shared]
    S = 2 * numbers.l_c * steps + _length(points[0]) + _length(points[1]) + 1
    most += SQUARE_ROUNDING * (S * gamma * gamma_) ** 2
    return most


@njit(cache=True)
def _length(point: Vector) -> float:
    return math.sqrt(point[0] ** 2 + point[1] ** 2 + point[2] ** 2)


@njit(cache=True)
def _view_from(numbers: Numbers, corners: Array, i: int, above: int, point: Vector) -> tuple[Array, Array, float]:
    """Return a point of module i, and its squared size, for each choice of corners, as a module above sees it.

    Returns:
        points, shape (choices, 3), w, shape (choices,), and the product of the corners' sizes.
    """
    choices = 3 ** (numbers.depth[i] - numbers.depth[above])
    x, w, gamma, filled = np.zeros((choices, 3)), np.zeros(choices), 1.0, 1
    x[0, 0], x[0, 1], x[0, 2] = point
    w[0] = point[0] ** 2 + point[1] ** 2 + point[2] ** 2
    while i != above:
        port = numbers.port[i]
        arm, across = (0, 1) if port % 2 == 0 else (1, 0)
        step = numbers.l_c if port < 2 else -numbers.l_c
        after, beside = (across + 1) % 3, (across + 2) % 3
        for v in range(filled):
            for _ in range(numbers.turns[i]):
                x[v, 0], x[v, 1] = -x[v, 1], x[v, 0]
            w[v] += 2 * step * x[v, arm] + step * step
            x[v, arm] += step
        for corner in range(2, -1, -1):  # the first is left in its own place
            c, s = corners[i + 2, corner]
            for v in range(filled):
                to = corner * filled + v
                first, second = x[v, after], x[v, beside]
                x[to, across], w[to] = x[v, across], w[v]
                x[to, after], x[to, beside] = c * first - s * second, s * first + c * second
                w[to] += 2 * step * x[to, arm] + step * step
                x[to, arm] += step
        gamma *= max(1.0, math.hypot(corners[i + 2, 2, 0], corners[i + 2, 2, 1]))
        filled *= 3
        i = numbers.parent[i]
    return x, w, gamma

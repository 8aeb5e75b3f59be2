r"""Crowded boxes of hinge angles: two modules are too close everywhere in them, whatever the root.

Take a point on the axis of each module's envelope, or the two centres, or the centre of a ball inside one module's
parts and a point on the other's axis. Relative to the last module that both paths share, each point is a product of
matrices in the pairs (c, s) of its own hinges. With d a step along an arm,

.. math:: |x + d|^2 = |x|^2 + 2 d \cdot x + |d|^2, \qquad |H x|^2 = |x|^2

so w = |x|^2, carried along as a separate number, is affine in each pair, and so is the squared distance w_i +
w_j - 2 x_i . x_j, as no hinge is on both sides. It is greatest at a combination of triangle vertices
(`verify.proof.arcs`). If that is under the squared sum of the two radii, the balls around the two points overlap in
the whole box. Any choice of points is valid.

**Rounding.** With vertices of length 1.44 at most, x and w have errors of less than 10 m eps gamma S and 20 m eps
gamma S^2 after m steps (eps = 2^-53, S the length of the stretched-out path with both axes, gamma the product of
the vertices' lengths): SQUARE_ROUNDING S^2 gamma^2 is over a thousand times what 12 modules need.
"""

import math

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, Indices
from verify.proof.arcs import ArcFrames
from verify.proof.platform import CheckProblem

Vector = tuple[float, float, float]
ORIGIN = (0.0, 0.0, 0.0)
SQUARE_ROUNDING = 1e-11
"""Allowance for rounding of a squared distance, over the squared length of the path."""


@njit(cache=True)
def find_crowded_pair(problem: CheckProblem, triangles: Array, frames: ArcFrames, module_pair: Indices) -> bool:
    """Return whether two modules are too close everywhere in a box.

    Args:
        problem: task and tree.
        triangles: triangles of all angles, shape (A, 3, 2).
        frames: frames at the middle of the box, one per module.
        module_pair: input, the pair of the previous box, which is tried first; output, the crowded pair, or else
            the nearest pair at the middle.
    """
    n, least_gap, nearest = len(problem.parent), math.inf, (0, 0)
    i, j = module_pair
    if i != j and _pair_crowding(problem, triangles, frames, i, j)[0]:
        return True
    for i in range(n):
        for j in range(i + 1, n):
            crowded, gap = _pair_crowding(problem, triangles, frames, i, j)
            if crowded or gap < least_gap:
                least_gap, nearest = gap, (i, j)
            if crowded:
                module_pair[0], module_pair[1] = i, j
                return True
    module_pair[0], module_pair[1] = nearest
    return False


@njit(cache=True, inner=True)
def _pair_crowding(
    problem: CheckProblem, triangles: Array, frames: ArcFrames, i: int, j: int
) -> tuple[bool, float]:
    """Return whether two modules are too close everywhere in a box, and their least gap at the middle."""
    gap = math.inf
    if problem.has_airflow:
        eta, gamma, gap = deepest_shares(problem, frames, i, j)
        distance = 2 * problem.start_radius + (eta + gamma) * problem.growth
        points = ((0.0, 0.0, -eta * problem.length), (0.0, 0.0, -gamma * problem.length))
        gap -= problem.margin
        limit = distance * (distance + 2 * problem.margin)
        if gap < 0.0 and largest_squared_distance(problem, triangles, i, j, points) < limit:
            return True, gap
    for b in range(0 if problem.bolted[i, j] else len(problem.balls)):
        for owner, blown in ((i, j), (j, i)):
            share, ball_gap = _ball_in_airflow(problem, frames, owner, blown, b)
            gap = min(gap, ball_gap)
            if ball_gap < 0.0:
                x, y, z, radius = problem.balls[b]
                distance = radius + problem.start_radius + share * problem.growth
                points = ((x, y, z), (0.0, 0.0, -share * problem.length))
                limit = distance * (distance + 2 * problem.margin)
                if largest_squared_distance(problem, triangles, owner, blown, points) < limit:
                    return True, gap
    if problem.centre_distance > 0.0 and not (problem.exempts_bolted and problem.bolted[i, j]):
        centre_gap = math.sqrt(((frames.p[i] - frames.p[j]) ** 2).sum()) - problem.centre_distance
        gap = min(gap, centre_gap)
        points = (ORIGIN, ORIGIN)
        limit = problem.centre_distance**2
        if centre_gap < 0.0 and largest_squared_distance(problem, triangles, i, j, points) < limit:
            return True, gap
    return False, gap


@njit(cache=True, inner=True)
def _ball_in_airflow(problem: CheckProblem, frames: ArcFrames, i: int, j: int, b: int) -> tuple[float, float]:
    """Return the share of the axis of j at which ball b of module i is deepest in the airflow, and the gap."""
    x, y, z, radius = problem.balls[b]
    R, axis = frames.R[i], frames.R[j, :, 2]
    w = frames.p[i] + x * R[:, 0] + y * R[:, 1] + z * R[:, 2] - frames.p[j]
    share = _deepest_share(-w, axis, problem.length, problem.growth)
    offset = w + share * problem.length * axis
    gap = math.sqrt((offset * offset).sum()) - radius - problem.start_radius - share * problem.growth
    return share, gap - problem.margin


@njit(cache=True, inner=True)
def deepest_shares(problem: CheckProblem, frames: ArcFrames, i: int, j: int) -> tuple[float, float, float]:
    """Return the shares of two axes at which the envelopes overlap most, approximately, and the gap there."""
    L, growth = problem.length, problem.growth
    w, zi, zj = frames.p[i] - frames.p[j], frames.R[i, :, 2], frames.R[j, :, 2]
    best = (0.0, 0.0, math.inf)
    for start in range(5):  # the corners of the unit square and its middle; one share after the other
        eta, gamma = (0.5, 0.5) if start == 4 else (float(start // 2), float(start % 2))
        for _ in range(12):
            eta = _deepest_share(w + gamma * L * zj, zi, L, growth)
            gamma = _deepest_share(-w + eta * L * zi, zj, L, growth)
        offset = w - eta * L * zi + gamma * L * zj
        gap = math.sqrt((offset * offset).sum()) - 2 * problem.start_radius - (eta + gamma) * growth
        if gap < best[2]:
            best = (eta, gamma, gap)
    return best


@njit(cache=True, inner=True)
def _deepest_share(w: Array, z: Array, L: float, growth: float) -> float:
    """Return the share of an axis at which |w - share L z| - share growth is least."""
    if growth >= L:
        return 1.0
    axial = (w * z).sum()
    radial = math.sqrt(max(0.0, (w * w).sum() - axial * axial))
    share: float = (axial + radial * growth / math.sqrt(L * L - growth * growth)) / L
    return min(1.0, max(0.0, share))


@njit(cache=True)
def largest_squared_distance(
    problem: CheckProblem, triangles: Array, i: int, j: int, points: tuple[Vector, Vector]
) -> float:
    """Return the largest squared distance in a box between two points, each in the frame of its module."""
    largest: float
    ancestor, other_ = i, j
    while ancestor != other_:
        if ancestor > other_:
            ancestor = problem.parent[ancestor]
        else:
            other_ = problem.parent[other_]
    x, w, gamma = _positions(problem, triangles, i, ancestor, points[0])
    x_, w_, gamma_ = _positions(problem, triangles, j, ancestor, points[1])
    largest = -math.inf
    for v in range(len(w)):
        for v_ in range(len(w_)):
            dot = x[v, 0] * x_[v_, 0] + x[v, 1] * x_[v_, 1] + x[v, 2] * x_[v_, 2]
            largest = max(largest, w[v] + w_[v_] - 2 * dot)
    steps = problem.depth[i] + problem.depth[j] - 2 * problem.depth[ancestor]
    S = 2 * problem.l_c * steps + _length(points[0]) + _length(points[1]) + 1
    largest += SQUARE_ROUNDING * (S * gamma * gamma_) ** 2
    return largest


@njit(cache=True, inner=True)
def _length(point: Vector) -> float:
    return math.sqrt(point[0] ** 2 + point[1] ** 2 + point[2] ** 2)


@njit(cache=True, inner=True)
def _positions(
    problem: CheckProblem, triangles: Array, i: int, ancestor: int, point: Vector
) -> tuple[Array, Array, float]:
    """Return the positions of a point of module i in an ancestor's frame, for each combination of vertices.

    Returns:
        x, shape (choices, 3), w, shape (choices,), and gamma.
    """
    choices = 3 ** (problem.depth[i] - problem.depth[ancestor])
    x, w, gamma, count = np.zeros((choices, 3)), np.zeros(choices), 1.0, 1
    x[0, 0], x[0, 1], x[0, 2] = point
    w[0] = point[0] ** 2 + point[1] ** 2 + point[2] ** 2
    while i != ancestor:
        port = problem.port[i]
        arm, across = (0, 1) if port % 2 == 0 else (1, 0)
        step = problem.l_c if port < 2 else -problem.l_c
        next_axis, third_axis = (across + 1) % 3, (across + 2) % 3
        for v in range(count):
            for _ in range(problem.quarter_turns[i]):
                x[v, 0], x[v, 1] = -x[v, 1], x[v, 0]
            w[v] += 2 * step * x[v, arm] + step * step
            x[v, arm] += step
        for vertex in range(2, -1, -1):  # vertex 0 last: it overwrites the input
            c, s = triangles[i + 2, vertex]
            for v in range(count):
                target = vertex * count + v
                first, second = x[v, next_axis], x[v, third_axis]
                x[target, across], w[target] = x[v, across], w[v]
                x[target, next_axis], x[target, third_axis] = c * first - s * second, s * first + c * second
                w[target] += 2 * step * x[target, arm] + step * step
                x[target, arm] += step
        gamma *= max(1.0, math.hypot(triangles[i + 2, 2, 0], triangles[i + 2, 2, 1]))
        count *= 3
        i = problem.parent[i]
    return x, w, gamma

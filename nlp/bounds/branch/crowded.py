r"""Crowded boxes of hinge angles: two modules are too close to each other everywhere in them.

Take a point on the airflow axis of each of two modules i and j, at the shares eta and gamma of its length. If
airflows may merge, take instead the centre of a ball inside the parts of one module and a point of the other's
axis. Their squared distance is a first harmonic in every hinge between them: the hinge turns one of the points
about its axis and leaves the other fixed, and in |A|^2 + |B|^2 - 2 A . B, from a point of the axis, only A . B
changes. So the interpolation of `nlp.bounds.branch.box` holds: the squared distance is at most its greatest value
at the vertices of the hinges between i and j plus sum_a (max(0, alpha_a) (1 - cos rho_a) + |beta_a| rho_a^3 / (9
sqrt 3)), where alpha = -2 A_# . B_# (parts across the axis) and beta = -2 B . (omega x A) at the middle; another
hinge b increases either by at most 2 rho_b |A| |B|, with A from the axis of the inner hinge and B from that of the
outer one, and neither exceeds 2 |A| |B|. If that is under the squared sum of the radii at the two points, envelopes
overlap, or parts are in airflow, in the whole box. Centres are compared with the required distance in the same way.
Any choice of points is valid.

A clear audit has no tolerance here, so the only allowance is for rounding: the error of coordinates, and so of
squared distances, is less than 1e-13 of the squared length of the tree stretched out with both axes (compare
`nlp.bounds.branch.box`); the allowance is DISTANCE_ROUNDING of that.
"""

import math

from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.box import CUBIC
from nlp.bounds.branch.frames import BoxFrames, Frames
from nlp.numbers.kinematics import Vector, add, cross, dot, row
from topo_search.compiled_code import njit
from topo_search.model.arrays import Array

DISTANCE_ROUNDING = 1e-11
"""Allowance for rounding of a squared distance, over the squared stretched-out length."""
NOWHERE, AT_MIDDLE, EVERYWHERE = 0, 1, 2
MAX_ROUNDS = 20
"""Largest number of rounds of the search for the two points."""


@njit(cache=True, allocates=False)
def crowding(problem: BranchProblem, box: BoxFrames, gain: Array) -> int:
    """Return where in a box of hinge angles two modules are too close: NOWHERE, AT_MIDDLE or EVERYWHERE.

    Args:
        problem: task and tree.
        box: the box of angles; its roots are not used.
        gain: output, the loss to each hinge's remainder if two modules are too close at the middle, shape (A,).
    """
    tree, separation, n = problem.tree, problem.separation, len(problem.tree.parent)
    where = NOWHERE
    gain[:] = 0.0
    for i in range(n):
        for j in range(i + 1, n):
            if separation.has_airflow:
                eta, gamma = _deepest_shares(problem, box.middle, i, j)
                distance = 2 * separation.start_radius + (eta + gamma) * separation.growth
                distance = math.sqrt(distance * (distance + 2 * separation.margin))
                q_i, q_j = (0.0, 0.0, -eta * separation.length), (0.0, 0.0, -gamma * separation.length)
                air = _point_crowding(problem, box, i, j, q_i, q_j, distance, gain)
                where = max(where, air)
            if not tree.bolted[i, j]:
                for b in range(len(separation.balls)):
                    for owner, blown in ((i, j), (j, i)):
                        if where < EVERYWHERE:
                            air = _ball_in_airflow(problem, box, owner, blown, b, gain)
                            where = max(where, air)
            distance = separation.centre_distance
            if where < EVERYWHERE and distance > 0.0 and (separation.includes_bolted or not tree.bolted[i, j]):
                o = (0.0, 0.0, 0.0)
                where = max(where, _point_crowding(problem, box, i, j, o, o, distance, gain))
            if where == EVERYWHERE:
                return EVERYWHERE
    return where


@njit(cache=True, inner=True, allocates=False)
def _deepest_shares(problem: BranchProblem, frames: Frames, i: int, j: int) -> tuple[float, float]:
    """Return the shares of the two axes at which the envelopes overlap most, approximately."""
    L, growth = problem.separation.length, problem.separation.growth
    zi, zj, w = row(frames.z, i), row(frames.z, j), add(row(frames.p, i), -1.0, row(frames.p, j))
    along_i, along_j, cosine = dot(w, zi), dot(w, zj), dot(zi, zj)
    r = 2 * problem.separation.start_radius
    # minimize f = |w - eta L zi + gamma L zj|^2 - (r + (eta + gamma) growth)^2, one share after the other
    square = L * L - growth * growth
    cross_term = -(L * L * cosine + growth * growth)
    if square <= 0.0:
        return 0.0, 0.0
    best, minimum = (0.0, 0.0), math.inf
    for start in (0.0, 1.0):  # nearly parallel axes are too close at their ends, if at all
        eta = gamma = start
        for _ in range(MAX_ROUNDS):
            previous = gamma
            eta = min(1.0, max(0.0, (L * along_i + r * growth - cross_term * gamma) / square))
            gamma = min(1.0, max(0.0, (-L * along_j + r * growth - cross_term * eta) / square))
            if gamma == previous:
                break
        f = square * (eta * eta + gamma * gamma) / 2 + cross_term * eta * gamma
        f -= (L * along_i + r * growth) * eta + (-L * along_j + r * growth) * gamma
        if f < minimum:
            best, minimum = (eta, gamma), f
    return best


@njit(cache=True, inner=True, allocates=False)
def _ball_in_airflow(problem: BranchProblem, box: BoxFrames, i: int, j: int, b: int, gain: Array) -> int:
    """Return where in the box ball b of module i is in the airflow of module j."""
    separation, middle = problem.separation, box.middle
    L, growth = separation.length, separation.growth
    x, y, z, radius = separation.balls[b]
    w = add(_point(middle, i, (x, y, z)), -1.0, row(middle.p, j))
    distance, gamma = separation.start_radius + radius, 1.0
    if growth < L:  # minimize (w + gamma L z)^2 - (distance + gamma growth)^2
        along = dot(w, row(middle.z, j))
        gamma = min(1.0, max(0.0, (distance * growth - L * along) / (L * L - growth * growth)))
    distance += gamma * growth
    distance = math.sqrt(distance * (distance + 2 * separation.margin))
    q_i, q_j = (x, y, z), (0.0, 0.0, -gamma * L)
    return _point_crowding(problem, box, i, j, q_i, q_j, distance, gain)


@njit(cache=True, inner=True, allocates=False)
def _point_crowding(
    problem: BranchProblem, box: BoxFrames, i: int, j: int, q_i: Vector, q_j: Vector, distance: float, gain: Array
) -> int:
    """Return where in the box points q_i and q_j, in the frames of their modules, are nearer than `distance`."""
    tree = problem.tree
    A, B = _point(box.middle, i, q_i), _point(box.middle, j, q_j)
    stretched_length = 2 * problem.l_c * (tree.depth[i] + tree.depth[j]) + _length(q_i) + _length(q_j)
    limit = distance * distance - DISTANCE_ROUNDING * (1 + stretched_length * stretched_length)
    if _squared_distance(A, B) >= limit:
        return NOWHERE
    shared = 0  # number of hinges on both paths, which come first
    while shared < min(tree.depth[i], tree.depth[j]) and tree.path[i, 3 + shared] == tree.path[j, 3 + shared]:
        shared += 1
    for side in range(2):
        moving, other, C, D = (i, j, A, B) if side == 0 else (j, i, B, A)
        q_moving, q_other = (q_i, q_j) if side == 0 else (q_j, q_i)
        for level in range(shared, tree.depth[moving]):
            loss = _hinge_loss(problem, box, moving, other, shared, level, C, D, q_moving, q_other)
            gain[tree.path[moving, 3 + level]] += loss
            limit -= loss
    if _squared_distance(A, B) >= limit:
        return AT_MIDDLE
    for v in range(2 ** (tree.depth[i] - shared)):
        A = _point(box.vertices, tree.first[i] + v, q_i)
        for w in range(2 ** (tree.depth[j] - shared)):
            B = _point(box.vertices, tree.first[j] + w, q_j)
            if _squared_distance(A, B) >= limit:
                return AT_MIDDLE
    return EVERYWHERE


@njit(cache=True, inner=True, allocates=False)
def _hinge_loss(
    problem: BranchProblem,
    box: BoxFrames,
    moving: int,
    other: int,
    shared: int,
    level: int,
    A: Vector,
    B: Vector,
    q_moving: Vector,
    q_other: Vector,
) -> float:
    """Return the remainder of the hinge at `level` of a path; A is a point of that module, B of the other."""
    tree, l_c, rho = problem.tree, problem.l_c, box.rho
    a = tree.path[moving, 3 + level]
    omega, c = row(box.axes.omega, a), row(box.axes.c, a)
    A, B = add(A, -1.0, c), add(B, -1.0, c)
    alpha = -2 * (dot(A, B) - dot(A, omega) * dot(B, omega))
    beta = -2 * dot(cross(omega, A), B)
    # levers from the hinge at `level`, l_c from the centres of the two modules that it joins
    moving_lever = _max_lever(l_c, tree.depth[moving] - 1 - level, q_moving)
    other_lever = _max_lever(l_c, level - shared + tree.depth[other] - shared, q_other)
    excess = 0.0
    for level_b in range(shared, tree.depth[moving]):
        if level_b > level:
            lever = _max_lever(l_c, tree.depth[moving] - 1 - level_b, q_moving)
            excess += 2 * rho[tree.path[moving, 3 + level_b]] * lever * other_lever
        elif level_b < level:
            lever = _max_lever(l_c, level_b - shared + tree.depth[other] - shared, q_other)
            excess += 2 * rho[tree.path[moving, 3 + level_b]] * lever * moving_lever
    for level_b in range(shared, tree.depth[other]):
        lever = _max_lever(l_c, tree.depth[other] - 1 - level_b, q_other)
        excess += 2 * rho[tree.path[other, 3 + level_b]] * lever * moving_lever
    limit = 2 * moving_lever * other_lever
    loss: float = max(0.0, min(alpha + excess, limit)) * (1 - math.cos(rho[a]))
    loss += min(abs(beta) + excess, limit) * CUBIC * rho[a] ** 3
    return loss


@njit(cache=True, inner=True, allocates=False)
def _max_lever(l_c: float, modules: int, q: Vector) -> float:
    if modules == 0:  # the module's axis is at a right angle to the arm
        return math.hypot(l_c + math.hypot(q[0], q[1]), q[2])
    return l_c * (1 + 2 * modules) + _length(q)


@njit(cache=True, inner=True, allocates=False)
def _length(q: Vector) -> float:
    return math.sqrt(dot(q, q))


@njit(cache=True, inner=True, allocates=False)
def _point(frames: Frames, frame: int, q: Vector) -> Vector:
    p = add(row(frames.p, frame), q[0], row(frames.x, frame))
    return add(add(p, q[1], row(frames.y, frame)), q[2], row(frames.z, frame))


@njit(cache=True, inner=True, allocates=False)
def _squared_distance(A: Vector, B: Vector) -> float:
    d = add(A, -1.0, B)
    squared: float = dot(d, d)
    return squared

r"""Boxes of hinge angles in which two modules are too close to each other everywhere.

Take a point on the airflow axis of each of two modules i and j, at the shares eta and gamma of its length, or,
where airflows may merge, the middle of a ball that the parts of one module hold and a point of the other's axis.
Their squared distance is a first harmonic in every hinge between them: of the two points one is turned about the
hinge's axis, the other held, and |A|^2 + |B|^2 - 2 A . B from a point of the axis has A . B alone change. So the
interpolation of `nlp.bounds.branch.box` holds: the squared distance is at most its greatest value at the
vertices of the hinges between plus sum_a (max(0, alpha_a) (1 - cos rho_a) + |beta_a| rho_a^3 / (9 sqrt 3)),
where alpha = -2 A_# . B_# and beta = -2 B . (omega x A) at the middle, both more by 2 rho_b |A| |B| for another
hinge b, the lengths from its axis and from that of a on the far side, and never more than 2 |A| |B|. Where that
is under the squared sum of the radii at the two points, envelopes overlap, or parts are in airflow, in all of the
box; likewise centres, against the distance that is asked of them. It does not matter how the points were chosen.

What an audit calls clear is clear to the last digit, so that only rounding is left to allow for: coordinates and
with them squared distances are off by less than 1e-13 of the squared length of the tree stretched out with both
axes (compare `nlp.bounds.branch.box`), and MARGIN of that is taken.
"""

from __future__ import annotations

import math

from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.box import CUBIC
from nlp.bounds.branch.frames import Axes, Frames
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

MARGIN = 1e-11
"""Share of the largest squared length by which two modules must be too close."""
NOWHERE, AT_MIDDLE, ALL_OVER = 0, 1, 2
Vector = tuple[float, float, float]
ROUNDS = 20
"""Rounds of the search for the two points."""


@njit(cache=True, allocates=False)
def crowding(problem: BranchProblem, middle: Frames, axes: Axes, vertices: Frames, rho: Array, gain: Array) -> int:
    """Return NOWHERE, AT_MIDDLE or ALL_OVER: where in a box of hinges two modules are too close.

    Args:
        problem: the task and the tree.
        middle: frames at the middle of the box.
        axes: the hinges' axes there.
        vertices: frames at the vertices of the hinges.
        rho: half widths, shape (A,) [rad].
        gain: is filled with what each hinge's remainder takes, where they are too close at the middle alone.
    """
    tree, separation, n = problem.tree, problem.separation, len(problem.tree.parent)
    where = NOWHERE
    gain[:] = 0.0
    for i in range(n):
        for j in range(i + 1, n):
            if separation.airflow:
                eta, gamma = _nearest(problem, middle, i, j)
                radii = 2 * separation.start_radius + (eta + gamma) * separation.growth
                radii = math.sqrt(radii * (radii + 2 * separation.margin))
                q_i, q_j = (0.0, 0.0, -eta * separation.length), (0.0, 0.0, -gamma * separation.length)
                where = max(where, _closeness(problem, middle, axes, vertices, rho, i, j, q_i, q_j, radii, gain))
            if not tree.bolted[i, j]:
                for b in range(len(separation.parts)):
                    for one, other in ((i, j), (j, i)):
                        if where < ALL_OVER:
                            in_air = _part_in_air(problem, middle, axes, vertices, rho, one, other, b, gain)
                            where = max(where, in_air)
            if where < ALL_OVER and separation.apart > 0.0 and (separation.of_all or not tree.bolted[i, j]):
                o = (0.0, 0.0, 0.0)
                apart = _closeness(problem, middle, axes, vertices, rho, i, j, o, o, separation.apart, gain)
                where = max(where, apart)
            if where == ALL_OVER:
                return ALL_OVER
    return where


@njit(cache=True, allocates=False)
def _nearest(problem: BranchProblem, at: Frames, i: int, j: int) -> tuple[float, float]:
    """Return shares of the two axes where the envelopes are about deepest in each other."""
    L, grow = problem.separation.length, problem.separation.growth
    zi, zj = at.z[i], at.z[j]
    w0, w1, w2 = at.p[i, 0] - at.p[j, 0], at.p[i, 1] - at.p[j, 1], at.p[i, 2] - at.p[j, 2]
    along_i, along_j = w0 * zi[0] + w1 * zi[1] + w2 * zi[2], w0 * zj[0] + w1 * zj[1] + w2 * zj[2]
    cosine = zi[0] * zj[0] + zi[1] * zj[1] + zi[2] * zj[2]
    r = 2 * problem.separation.start_radius
    # f = |w - eta L zi + gamma L zj|^2 - (r + (eta + gamma) grow)^2, by one share after the other
    square = L * L - grow * grow
    mixed = -(L * L * cosine + grow * grow)
    if square <= 0.0:
        return 0.0, 0.0
    best, deepest = (0.0, 0.0), math.inf
    for start in (0.0, 1.0):  # axes next to parallel are too close at their ends, if anywhere
        eta = gamma = start
        for _ in range(ROUNDS):
            before = gamma
            eta = min(1.0, max(0.0, (L * along_i + r * grow - mixed * gamma) / square))
            gamma = min(1.0, max(0.0, (-L * along_j + r * grow - mixed * eta) / square))
            if gamma == before:
                break
        f = square * (eta * eta + gamma * gamma) / 2 + mixed * eta * gamma
        f -= (L * along_i + r * grow) * eta + (-L * along_j + r * grow) * gamma
        if f < deepest:
            best, deepest = (eta, gamma), f
    return best


@njit(cache=True, allocates=False)
def _part_in_air(
    problem: BranchProblem,
    middle: Frames,
    axes: Axes,
    vertices: Frames,
    rho: Array,
    i: int,
    j: int,
    b: int,
    gain: Array,
) -> int:
    """Return where in the box a part of module i, the ball b, is in the airflow of module j."""
    separation = problem.separation
    L, grow = separation.length, separation.growth
    x, y, z, radius = separation.parts[b]
    w, a, p = _point(middle, i, (x, y, z)), middle.z[j], middle.p[j]
    r, gamma = separation.start_radius + radius, 1.0
    if grow < L:  # where (w + gamma L a)^2 - (r + gamma grow)^2 is least
        along = (w[0] - p[0]) * a[0] + (w[1] - p[1]) * a[1] + (w[2] - p[2]) * a[2]
        gamma = min(1.0, max(0.0, (r * grow - L * along) / (L * L - grow * grow)))
    r += gamma * grow
    r = math.sqrt(r * (r + 2 * separation.margin))
    return _closeness(problem, middle, axes, vertices, rho, i, j, (x, y, z), (0.0, 0.0, -gamma * L), r, gain)


@njit(cache=True, allocates=False)
def _closeness(
    problem: BranchProblem,
    middle: Frames,
    axes: Axes,
    vertices: Frames,
    rho: Array,
    i: int,
    j: int,
    q_i: Vector,
    q_j: Vector,
    radii: float,
    gain: Array,
) -> int:
    """Return where in the box two points, q_i and q_j in the frames of their modules, are nearer than so much."""
    tree = problem.tree
    A, B = _point(middle, i, q_i), _point(middle, j, q_j)
    stretched = 2 * problem.l_c * (tree.depth[i] + tree.depth[j]) + _length(q_i) + _length(q_j)
    limit = radii * radii - MARGIN * (1 + stretched * stretched)
    if _squared_norm(A, B) >= limit:
        return NOWHERE
    shared = 0  # hinges on both paths, which come first
    while shared < min(tree.depth[i], tree.depth[j]) and tree.path[i, 3 + shared] == tree.path[j, 3 + shared]:
        shared += 1
    for side in range(2):
        near, far, of_near, of_far = (i, j, A, B) if side == 0 else (j, i, B, A)
        q_near, q_far = (q_i, q_j) if side == 0 else (q_j, q_i)
        for at in range(shared, tree.depth[near]):
            part = _remainder(problem, axes, rho, near, far, shared, at, of_near, of_far, q_near, q_far)
            gain[tree.path[near, 3 + at]] += part
            limit -= part
    if _squared_norm(A, B) >= limit:
        return AT_MIDDLE
    for v in range(2 ** (tree.depth[i] - shared)):
        A = _point(vertices, tree.first[i] + v, q_i)
        for w in range(2 ** (tree.depth[j] - shared)):
            B = _point(vertices, tree.first[j] + w, q_j)
            if _squared_norm(A, B) >= limit:
                return AT_MIDDLE
    return ALL_OVER


@njit(cache=True, allocates=False)
def _remainder(
    problem: BranchProblem,
    axes: Axes,
    rho: Array,
    near: int,
    far: int,
    shared: int,
    at: int,
    A: Vector,
    B: Vector,
    q_near: Vector,
    q_far: Vector,
) -> float:
    """Return what the hinge at a place of one module's path takes; A is a point of that module, B of the other."""
    tree, l_c = problem.tree, problem.l_c
    a = tree.path[near, 3 + at]
    wx, wy, wz = axes.omega[a]
    Ax, Ay, Az = A[0] - axes.c[a, 0], A[1] - axes.c[a, 1], A[2] - axes.c[a, 2]
    Bx, By, Bz = B[0] - axes.c[a, 0], B[1] - axes.c[a, 1], B[2] - axes.c[a, 2]
    along_A, along_B = Ax * wx + Ay * wy + Az * wz, Bx * wx + By * wy + Bz * wz
    alpha = -2 * (Ax * Bx + Ay * By + Az * Bz - along_A * along_B)
    beta = -2 * ((wy * Az - wz * Ay) * Bx + (wz * Ax - wx * Az) * By + (wx * Ay - wy * Ax) * Bz)
    # from the hinge before the module at place `at`, l_c from its centre and from its parent's
    to_near = _reach(l_c, tree.depth[near] - 1 - at, q_near)
    to_far = _reach(l_c, at - shared + tree.depth[far] - shared, q_far)
    more = 0.0
    for other in range(shared, tree.depth[near]):
        if other > at:
            inner = _reach(l_c, tree.depth[near] - 1 - other, q_near)
            more += 2 * rho[tree.path[near, 3 + other]] * inner * to_far
        elif other < at:
            beyond = _reach(l_c, other - shared + tree.depth[far] - shared, q_far)
            more += 2 * rho[tree.path[near, 3 + other]] * beyond * to_near
    for other in range(shared, tree.depth[far]):
        inner = _reach(l_c, tree.depth[far] - 1 - other, q_far)
        more += 2 * rho[tree.path[far, 3 + other]] * inner * to_near
    most = 2 * to_near * to_far
    part: float = max(0.0, min(alpha + more, most)) * (1 - math.cos(rho[a]))
    part += min(abs(beta) + more, most) * CUBIC * rho[a] ** 3
    return part


@njit(cache=True, allocates=False)
def _reach(l_c: float, modules: int, q: Vector) -> float:
    """Return the largest distance of a point q of a module from a hinge, over the modules between them."""
    if modules == 0:  # the module's axis is at a right angle to the arm
        return math.hypot(l_c + math.hypot(q[0], q[1]), q[2])
    return l_c * (1 + 2 * modules) + _length(q)


@njit(cache=True, allocates=False)
def _length(q: Vector) -> float:
    return math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])


@njit(cache=True, allocates=False)
def _point(at: Frames, frame: int, q: Vector) -> Vector:
    (px, py, pz), (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = at.p[frame], at.x[frame], at.y[frame], at.z[frame]
    return (
        px + q[0] * xx + q[1] * yx + q[2] * zx,
        py + q[0] * xy + q[1] * yy + q[2] * zy,
        pz + q[0] * xz + q[1] * yz + q[2] * zz,
    )


@njit(cache=True, allocates=False)
def _squared_norm(A: Vector, B: Vector) -> float:
    x, y, z = A[0] - B[0], A[1] - B[1], A[2] - B[2]
    squared: float = x * x + y * y + z * z
    return squared

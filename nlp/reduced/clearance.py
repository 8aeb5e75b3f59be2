r"""Clearances of the printed problem in closed form, and their gradients.

.. math::

    f = \min_{\eta, \gamma \in [0, 1]} \|P_i(\eta) - P_j(\gamma)\|^2 - (r_i(\eta) + r_j(\gamma))^2, \qquad
    g = \sqrt{f + R^2} - R

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of a swept ball | l_arm |
| R | sum of both end radii | l_arm |
| g | clearance: exact in sign, and in size for balls of equal size; unit slope in deep overlap | l_arm |
| b | p_E: end-effector from the centre of mass | l_arm |

A row is about two points, two envelopes, parts and an envelope, parts and a region at the end-effector, or an
envelope or rod and such a region. The gradient of a row is a force on module i at its nearest point; the opposite
force acts on module j or on the end-effector (`nlp.reduced.platform`).
"""

import math
from typing import NamedTuple

from nlp.numbers.kinematics import Vector, add, cross, dot, multiply, row
from nlp.reduced.arrays import ReducedProblem
from nlp.reduced.platform import ReducedPlatform, p_E_of, rotate
from nlp.requirements import row_kinds
from topo_search.compiled_code import njit
from topo_search.model.arrays import Array


class GapLimits(NamedTuple):
    """Numerical limits of the closed forms of clearances."""

    flat: float = 1e-9
    """Value relative to its largest below which a determinant or a coefficient of f counts as zero."""
    min_distance: float = 1e-9
    """Lower limit of divisors that are distances: coincident points have no direction [l_arm]."""
    far: float = 8.0
    """Distance of envelopes beyond which their clearance is not computed [l_arm]."""
    rounding: float = 1e-12
    """Tolerance of the flatness of a face [l_arm]."""


GAPS = GapLimits()
NO_AXIS = (0.0, 0.0, 0.0)
SweptPiece = tuple[Vector, Vector, float, float]
"""Start, axis, start radius and growth of a swept ball."""


@njit(cache=True, forceinline=True)
def divide(a: Vector, length: float) -> Vector:
    """Return a vector divided by a length."""
    safe = max(length, GAPS.min_distance)
    return a[0] / safe, a[1] / safe, a[2] / safe


@njit(cache=True, forceinline=True)
def swept_gap(
    w: Vector, d_i: Vector, r_i: float, dr_i: float, d_j: Vector, r_j: float, dr_j: float
) -> tuple[float, float, float, Vector]:
    """Return g, eta and gamma of two swept balls, and the gradient of g by P_i.

    The minimum of f is its stationary point, if that is a minimum inside the square, else it is on an edge; f may
    be concave.

    Args:
        w: o_i - o_j.
        d_i: axis of ball i.
        r_i: start radius of ball i.
        dr_i: growth of ball i.
        d_j: axis of ball j.
        r_j: start radius of ball j.
        dr_j: growth of ball j.
    """
    r = r_i + r_j
    ii, jj, ij = dot(d_i, d_i), dot(d_j, d_j), dot(d_i, d_j)
    A, B, C = ii - dr_i * dr_i, jj - dr_j * dr_j, -2 * (ij + dr_i * dr_j)
    D, E = 2 * (dot(d_i, w) - r * dr_i), -2 * (dot(d_j, w) + r * dr_j)
    det, scale = 4 * A * B - C * C, ii + jj
    f_min, eta, gamma, inside = math.inf, 0.0, 0.0, False
    if A > 0.0 and B > 0.0 and det > GAPS.flat * 4 * A * B:
        eta, gamma = (C * E - 2 * B * D) / det, (C * D - 2 * A * E) / det
        inside = 0.0 <= eta <= 1.0 and 0.0 <= gamma <= 1.0
    if not inside:
        eta = gamma = 0.0
        for k in range(2):
            end = float(k)
            for trial in range(2):
                free = float(trial)
                if GAPS.flat * scale < A:
                    free = min(max(-(C * end + D) / (2 * A), 0.0), 1.0)
                f = (A * free + C * end + D) * free + (B * end + E) * end
                if f < f_min:
                    f_min, eta, gamma = f, free, end
                free = float(trial)
                if GAPS.flat * scale < B:
                    free = min(max(-(C * end + E) / (2 * B), 0.0), 1.0)
                f = (A * end + C * free + D) * end + (B * free + E) * free
                if f < f_min:
                    f_min, eta, gamma = f, end, free
    x = add(add(w, eta, d_i), -gamma, d_j)
    R, radii = r + dr_i + dr_j, r + eta * dr_i + gamma * dr_j
    root = math.sqrt(dot(x, x) + (R - radii) * (R + radii))
    return root - R, eta, gamma, divide(x, root)


@njit(cache=True)
def hull_gap(
    w: Vector, d: Vector, r_0: float, dr: float, planes: Array, edges: Array
) -> tuple[float, float, Vector]:
    """Return g and eta of a swept ball and a hull, and the gradient of g by P.

    The point of the hull nearest to an axis outside is on an edge, or inside a face and then nearest to an end of
    the axis, since the distance from a plane is linear. If the axis enters the hull, the gap is minus R and minus
    the distance by which the axis must move to be outside some face.

    Args:
        w: o in the frame of the planes and edges.
        d: the axis.
        r_0: start radius.
        dr: growth.
        planes: see `Hulls`.
        edges: see `Hulls`.
    """
    R, enters, leaves = r_0 + dr, 0.0, 1.0
    outside, eta, gradient = -math.inf, 0.0, (0.0, 0.0, 0.0)
    for f in range(len(planes)):
        normal = row(planes, f)
        height, slope = dot(normal, w) - planes[f, 3], dot(normal, d)
        if height + min(slope, 0.0) > outside:
            outside, eta, gradient = height + min(slope, 0.0), 1.0 if slope < 0.0 else 0.0, normal
        if slope < 0.0:
            enters = max(enters, -height / slope)
        elif slope > 0.0:
            leaves = min(leaves, -height / slope)
        elif height > 0.0:
            leaves = -math.inf
    if enters <= leaves:
        return outside - R, eta, gradient
    if outside > R + GAPS.far:
        return math.inf, eta, gradient
    nearest = math.inf
    for e in range(len(edges)):
        g, eta_e, _, gradient_e = swept_gap(add(w, -1.0, row(edges, e)), d, r_0, dr, row(edges, e, 3), 0.0, 0.0)
        if g < nearest:
            nearest, eta, gradient = g, eta_e, gradient_e
    for end in (0.0, 1.0):
        point, radius = add(w, end, d), r_0 + end * dr
        height, normal = face_excess(point, planes)
        excess, _ = face_excess(add(point, -height, normal), planes)
        root = math.sqrt(height * height + (R - radius) * (R + radius))
        if height > 0.0 and excess <= GAPS.rounding and root - R < nearest:
            nearest, eta, gradient = root - R, end, multiply(height, divide(normal, root))
    return nearest, eta, gradient


@njit(cache=True, inner=True)
def face_excess(q: Vector, planes: Array) -> tuple[float, Vector]:
    """Return the largest distance of a point beyond a face of a hull, and the normal of that face."""
    excess, face = -math.inf, 0
    for f in range(len(planes)):
        height = dot(row(planes, f), q) - planes[f, 3]
        if height > excess:
            excess, face = height, f
    return excess, row(planes, face)


@njit(cache=True, inner=True, allocates=False)
def clearances(problem: ReducedProblem, pose: ReducedPlatform, g: Array, gradients: Array, rods: Array) -> None:
    """Compute the clearances of all rows, and their gradients.

    Args:
        problem: the task and topology.
        pose: the platform.
        g: output: the clearances, shape (m,). One is infinite beyond GAPS.far, or if its rod is not the best one;
            its gradient is then undefined.
        gradients: output: F and T of module i, and E, shape (m, 9). For a row of two modules, F and T of module j
            are the opposite, and E is unused.
        rods: output: largest missing clearance, 0 at first, and length of each rod, shape (rods, 2).
    """
    rows = problem.rows
    for r in range(len(rows.i)):
        g[r] = math.inf
        if rows.obstacles.kind[r] == row_kinds.AIRFLOW and _are_far(problem, pose, r):
            continue
        first, end, b_0 = 0, 1, rows.bodies.first[r]
        if rows.bodies.kind[r] == row_kinds.PARTS:
            first, end = int(rows.bodies.numbers[b_0]), int(rows.bodies.numbers[b_0 + 1])
        for k in range(first, end):
            body = _piece(problem, pose, r, k)
            gap, eta, push, E = _gap(problem, pose, r, body)
            if gap < g[r]:
                g[r] = gap
                point = add(body[0], eta, body[1])
                if rows.bodies.kind[r] == row_kinds.ROD:
                    push, point = _push_on_rod(problem, pose, r, body, eta, push), body[0]
                gradients[r, 0], gradients[r, 1], gradients[r, 2] = push
                gradients[r, 3], gradients[r, 4], gradients[r, 5] = cross(point, push)
                gradients[r, 6], gradients[r, 7], gradients[r, 8] = add(E, -1.0, push)
    _keep_best_rod(problem, pose, g, rods)


@njit(cache=True, inner=True, allocates=False, forceinline=True)
def _are_far(problem: ReducedProblem, pose: ReducedPlatform, r: int) -> bool:
    """True if a body is so far from an envelope's middle that the gap must exceed GAPS.far."""
    i, j, bodies, b_0 = problem.rows.i[r], problem.rows.j[r], problem.rows.bodies, problem.rows.bodies.first[r]
    length, radius, growth = _vector(problem.rows.obstacles.numbers, problem.rows.obstacles.first[r])
    between, size = add(row(pose.o, i), -1.0, row(pose.o, j)), length / 2 + radius + growth
    between = add(between, length / 2, row(pose.z, j))
    if bodies.kind[r] == row_kinds.ENVELOPE:
        own = bodies.numbers[b_0] / 2
        between, reach = add(between, -own, row(pose.z, i)), own + bodies.numbers[b_0 + 1] + bodies.numbers[b_0 + 2]
    else:
        reach = bodies.numbers[b_0 + 2]
    return bool(dot(between, between) >= (reach + size + GAPS.far) ** 2)


@njit(cache=True, inner=True, allocates=False, forceinline=True)
def _piece(problem: ReducedProblem, pose: ReducedPlatform, r: int, k: int) -> SweptPiece:
    """Return piece k of the body of row r: its start from the COM, its axis, start radius and growth."""
    i, bodies = problem.rows.i[r], problem.rows.bodies
    kind, k_0, numbers, o = bodies.kind[r], bodies.first[r], bodies.numbers, row(pose.o, i)
    if kind == row_kinds.ENVELOPE:
        return o, multiply(-numbers[k_0], row(pose.z, i)), numbers[k_0 + 1], numbers[k_0 + 2]
    if kind == row_kinds.PARTS:
        return add(o, 1.0, rotate(pose.R, i, row(problem.parts, k))), NO_AXIS, problem.parts[k, 3], 0.0
    if kind == row_kinds.JET:
        start = add(o, 1.0, rotate(pose.R, i, _vector(numbers, k_0 + 3)))
        axis = multiply(-numbers[k_0], rotate(pose.R, i, _vector(numbers, k_0 + 6)))
        return start, axis, numbers[k_0 + 1], numbers[k_0 + 2]
    if kind == row_kinds.ROD:  # without its tip
        start = add(o, 1.0, rotate(pose.R, i, _vector(numbers, k_0 + 1)))
        to_start = add(start, -1.0, p_E_of(pose))
        return start, multiply(_tip_share(to_start, numbers[k_0 + 5]) - 1.0, to_start), numbers[k_0 + 4], 0.0
    return o, NO_AXIS, 0.0, 0.0


@njit(cache=True, inner=True, allocates=False, forceinline=True)
def _gap(
    problem: ReducedProblem, pose: ReducedPlatform, r: int, body: SweptPiece
) -> tuple[float, float, Vector, Vector]:
    """Return the gap of a body from the obstacle of row r, and eta of its nearest point.

    Also returned are the gradients by that point and, for a fixed point, by p_E.
    """
    obstacles, j, b = problem.rows.obstacles, problem.rows.j[r], p_E_of(pose)
    kind, k_0, numbers, (o, d, radius, growth) = obstacles.kind[r], obstacles.first[r], obstacles.numbers, body
    if kind == row_kinds.AIRFLOW:
        length, r_air, dr_air = _vector(numbers, k_0)
        w, axis = add(o, -1.0, row(pose.o, j)), multiply(-length, row(pose.z, j))
        gap, eta, _, push = swept_gap(w, d, radius, growth, axis, r_air, dr_air)
        return gap, eta, push, NO_AXIS
    if kind == row_kinds.MODULE:
        return _distance_gap(add(o, -1.0, row(pose.o, j)), numbers[k_0])
    if kind == row_kinds.OFFSET:
        gap, _, E, _ = _distance_gap(b, numbers[k_0])
        return gap, 0.0, NO_AXIS, E
    o = add(o, -1.0, b)
    if kind == row_kinds.TIP_POINT:
        return _distance_gap(o, numbers[k_0])
    if kind == row_kinds.REACH:
        gap, _, push, _ = _distance_gap(o, numbers[k_0])
        return -gap, 0.0, multiply(-1.0, push), NO_AXIS
    if kind == row_kinds.CAPSULE:
        return _capsule_gap(o, d, radius, growth, b, numbers, k_0)
    if kind == row_kinds.CONE:
        return _cone_row(o, d, radius, growth, b, numbers, k_0)
    planes = problem.hulls.planes[int(numbers[k_0]) : int(numbers[k_0 + 1])]
    if kind == row_kinds.FACES:
        gap, push = face_excess(o, planes)
        return gap - radius, 0.0, push, NO_AXIS
    edges = problem.hulls.edges[int(numbers[k_0 + 2]) : int(numbers[k_0 + 3])]
    gap, eta, push = hull_gap(o, d, radius, growth, planes, edges)
    return gap, eta, push, NO_AXIS


@njit(cache=True, forceinline=True)
def _distance_gap(w: Vector, distance: float) -> tuple[float, float, Vector, Vector]:
    length = math.sqrt(dot(w, w))
    return length - distance, 0.0, divide(w, length), NO_AXIS


@njit(cache=True, inner=True, allocates=False)
def _capsule_gap(
    w: Vector, d: Vector, radius: float, growth: float, b: Vector, numbers: Array, k_0: int
) -> tuple[float, float, Vector, Vector]:
    """Return the gap of a body from a capsule, as in `_gap`; w is from p'_E."""
    length, path = numbers[k_0 + 7], _vector(numbers, k_0 + 3)
    if length > 0.0:
        path = multiply(length / _offset(b), b)
    start = _vector(numbers, k_0)
    gap, eta, gamma, push = swept_gap(add(w, -1.0, start), d, radius, growth, path, numbers[k_0 + 6], 0.0)
    return gap, eta, push, _by_p_E(b, length, multiply(-gamma, push))


@njit(cache=True, inner=True, allocates=False)
def _cone_row(
    w: Vector, d: Vector, radius: float, growth: float, b: Vector, numbers: Array, k_0: int
) -> tuple[float, float, Vector, Vector]:
    """Return the gap of an end ball of a body inside a cone, as in `_gap`; w is from p'_E."""
    axis, end, to_com = _vector(numbers, k_0 + 3), numbers[k_0 + 8], numbers[k_0 + 9]
    if to_com > 0.0:
        axis = multiply(-1.0 / _offset(b), b)
    ball = add(add(w, -1.0, _vector(numbers, k_0)), end, d)
    gap, push, by_axis = _cone_gap(ball, axis, numbers[k_0 + 6], numbers[k_0 + 7])
    return gap - (radius + end * growth), end, push, _by_p_E(b, -to_com, by_axis)


@njit(cache=True, forceinline=True)
def _vector(numbers: Array, k: int) -> Vector:
    return numbers[k], numbers[k + 1], numbers[k + 2]


@njit(cache=True, forceinline=True)
def _offset(b: Vector) -> float:
    return max(GAPS.min_distance, math.sqrt(dot(b, b)))


@njit(cache=True, forceinline=True)
def _by_p_E(b: Vector, length: float, by_axis: Vector) -> Vector:
    offset = _offset(b)
    return multiply(length / offset, add(by_axis, -dot(by_axis, b) / offset**2, b))


@njit(cache=True, forceinline=True)
def _tip_share(to_start: Vector, tip: float) -> float:
    return min(1.0, tip / max(GAPS.min_distance, math.sqrt(dot(to_start, to_start))))


@njit(cache=True, inner=True, allocates=False, forceinline=True)
def _push_on_rod(
    problem: ReducedProblem, pose: ReducedPlatform, r: int, body: SweptPiece, eta: float, push: Vector
) -> Vector:
    """Return the gradient by a rod's start, whose nearest point is (1 - eta) t + eta tip t / |t| from p'_E."""
    bodies = problem.rows.bodies
    t = add(body[0], -1.0, p_E_of(pose))
    length = max(GAPS.min_distance, math.sqrt(dot(t, t)))
    share = _tip_share(t, bodies.numbers[bodies.first[r] + 5])
    along = eta * share * dot(push, t) / length**2
    return add(multiply(1.0 - eta + eta * share, push), -along, t)


@njit(cache=True, inner=True, allocates=False)
def _keep_best_rod(problem: ReducedProblem, pose: ReducedPlatform, g: Array, rods: Array) -> None:
    """Make the clearances of all rods but the best infinite, and of those that are nothing but tip."""
    rows, bodies, best = problem.rows, problem.rows.bodies, 0
    numbers = bodies.numbers
    for r in range(len(rows.i) if len(rods) else 0):
        if bodies.kind[r] == row_kinds.ROD:
            k_0 = bodies.first[r]
            start = add(row(pose.o, rows.i[r]), 1.0, rotate(pose.R, rows.i[r], _vector(numbers, k_0 + 1)))
            t, rod = add(start, -1.0, p_E_of(pose)), int(numbers[k_0])
            if _tip_share(t, numbers[k_0 + 5]) >= 1.0:
                g[r] = math.inf
            rods[rod, 0] = max(rods[rod, 0], rows.lower[r] - g[r])
            rods[rod, 1] = max(GAPS.min_distance, math.sqrt(dot(t, t)))
    for rod in range(1, len(rods)):
        change = rods[rod, 0] - rods[best, 0]
        if change < 0.0 or (change == 0.0 and rods[rod, 1] < rods[best, 1]):
            best = rod
    for r in range(len(rows.i) if len(rods) else 0):
        if bodies.kind[r] == row_kinds.ROD and int(numbers[bodies.first[r]]) != best:
            g[r] = math.inf


@njit(cache=True, forceinline=True)
def _cone_gap(q: Vector, d: Vector, sine: float, cosine: float) -> tuple[float, Vector, Vector]:
    """Return the depth s of a point inside a cone, and the gradients by the point and by the axis.

    s = d . q sin(theta) - |q - (d . q) d| cos(theta); its gradient by d is q sin(theta) + n (d . q) cos(theta).

    Args:
        q: the point, from the apex.
        d: unit vector of the axis.
        sine: sine of the half-angle theta.
        cosine: cosine of theta.
    """
    along = dot(d, q)
    n = add(q, -along, d)
    rho = math.sqrt(dot(n, n))
    n = divide(n, rho)
    by_q, by_d = add(multiply(sine, d), -cosine, n), add(multiply(sine, q), cosine * along, n)
    return sine * along - cosine * rho, by_q, by_d

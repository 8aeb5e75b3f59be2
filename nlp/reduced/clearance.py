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

from __future__ import annotations

import math
from typing import NamedTuple

from nlp.numbers.kinematics import Vector, add, cross, dot, multiply, row
from nlp.reduced.arrays import ReducedProblem
from nlp.reduced.platform import Platform, rotate
from nlp.requirements.statement import (
    AIR,
    ALONG,
    APART,
    COLUMNS,
    CONE,
    CONE_COM,
    EXCLUSION,
    HULL,
    OFFSET,
    PARTS,
    PARTS_ALONG,
    PARTS_CONE,
    PARTS_CONE_COM,
    PARTS_HULL,
    REACH,
)
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


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


@njit(cache=True)
def face_excess(q: Vector, planes: Array) -> tuple[float, Vector]:
    """Return the largest distance of a point beyond a face of a hull, and the normal of that face."""
    excess, face = -math.inf, 0
    for f in range(len(planes)):
        height = dot(row(planes, f), q) - planes[f, 3]
        if height > excess:
            excess, face = height, f
    return excess, row(planes, face)


@njit(cache=True, allocates=False)
def clearances(problem: ReducedProblem, pose: Platform, g: Array, gradients: Array, rods: Array) -> None:
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
    kinds, module_i, module_j, data, lower = rows.kind, rows.i, rows.j, rows.data, rows.lower
    parts, R, centres, axes, zero = problem.parts, pose.R, pose.o, pose.z, (0.0, 0.0, 0.0)
    length, r_air, dr_air = problem.air
    b = (pose.p_E[0], pose.p_E[1], pose.p_E[2])
    offset, reach = max(GAPS.min_distance, math.sqrt(dot(b, b))), 0.0
    for k in range(len(parts)):
        reach = max(reach, math.sqrt(dot(row(parts, k), row(parts, k))) + parts[k, 3])
    for r in range(len(kinds)):
        kind, i, j = kinds[r], module_i[r], module_j[r]
        o, scale, is_pair = row(centres, i), 0.0, kind in (AIR, APART, PARTS)
        # w: vector to module i from a point, or from the start of an axis or path d with a radius
        if is_pair:
            w, d, radius, growth = add(o, -1.0, row(centres, j)), multiply(-length, row(axes, j)), r_air, dr_air
        else:
            w = add(add(o, -1.0, b), -1.0, row(data, r, COLUMNS.origin))
            d = row(data, r, COLUMNS.axis if kind in (CONE, PARTS_CONE) else COLUMNS.along)
            radius, growth = data[r, COLUMNS.radius], 0.0
            if kind in (CONE_COM, PARTS_CONE_COM, ALONG, PARTS_ALONG):  # d follows p_E
                scale = (-1.0 if kind in (CONE_COM, PARTS_CONE_COM) else data[r, COLUMNS.length]) / offset
                d = multiply(scale, b)
        # gradients: push, by the point of module i at `arm` from its centre; by_d, by d; and E
        gap, push, arm, by_d, E = math.inf, zero, zero, zero, zero
        if kind == OFFSET:
            gap, E = offset - data[r, COLUMNS.distance], divide(b, offset)
        elif kind in (APART, EXCLUSION):
            gap = math.sqrt(dot(w, w))
            push = divide(w, gap)
            gap -= data[r, COLUMNS.distance]
        elif PARTS <= kind <= PARTS_HULL:
            if kind == PARTS and _are_far(w, zero, d, length / 2 + r_air + dr_air + reach):
                g[r] = math.inf
                continue
            for k in range(len(parts)):
                c, by_axis = rotate(R, i, row(parts, k)), zero
                ball = add(w, 1.0, c)
                if kind == PARTS_HULL:
                    ball_gap, by_ball = face_excess(ball, _slice(problem.hulls.planes, data, r, COLUMNS.planes))
                    ball_gap -= parts[k, 3]
                elif kind in (PARTS_CONE, PARTS_CONE_COM):
                    ball_gap, by_ball, by_axis = _cone_gap(ball, d, data[r, COLUMNS.sine], data[r, COLUMNS.cosine])
                    ball_gap -= parts[k, 3]
                else:
                    ball_gap, _, gamma, by_ball = swept_gap(ball, zero, parts[k, 3], 0.0, d, radius, growth)
                    by_axis = multiply(-gamma, by_ball)
                if ball_gap < gap:
                    gap, push, arm, by_d = ball_gap, by_ball, c, by_axis
        else:  # an envelope, or a rod from a connector
            rod, tip_share, rod_length, eta, t = int(data[r, COLUMNS.rod]), 0.0, 0.0, 0.0, add(o, -1.0, b)
            axis, r_0, dr = (length, r_air, dr_air) if kind == AIR else row(data, r, COLUMNS.envelope)
            d_i = multiply(-axis, row(axes, i))
            if kind == AIR and _are_far(w, d_i, d, length + 2 * (r_air + dr_air)):
                g[r] = math.inf
                continue
            if rod >= 0:
                arm = rotate(R, i, row(data, r, COLUMNS.connector))
                w, t = add(w, 1.0, arm), add(t, 1.0, arm)
                rod_length = max(GAPS.min_distance, math.sqrt(dot(t, t)))
                r_0, dr, tip_share = data[r, COLUMNS.rod_radius], 0.0, data[r, COLUMNS.tip] / rod_length
                rods[rod, 1] = rod_length
                if tip_share >= 1.0:  # the rod is nothing but tip
                    g[r] = math.inf
                    continue
                d_i = multiply(tip_share - 1.0, t)
            if kind == REACH:
                gap, push = data[r, COLUMNS.distance] - rod_length, multiply(-1.0 / rod_length, t)
            elif kind == HULL:
                planes = _slice(problem.hulls.planes, data, r, COLUMNS.planes)
                edges = _slice(problem.hulls.edges, data, r, COLUMNS.edges)
                gap, eta, push = hull_gap(w, d_i, r_0, dr, planes, edges)
            elif kind in (CONE, CONE_COM):  # an end ball
                eta, end = data[r, COLUMNS.end], add(w, data[r, COLUMNS.end], d_i)
                gap, push, by_d = _cone_gap(end, d, data[r, COLUMNS.sine], data[r, COLUMNS.cosine])
                gap -= r_0 + eta * dr
            else:
                gap, eta, gamma, push = swept_gap(w, d_i, r_0, dr, d, radius, growth)
                by_d = multiply(-gamma, push)
            if rod >= 0:  # the nearest point is (1 - eta) t + eta tip t / |t|
                rods[rod, 0] = max(rods[rod, 0], lower[r] - gap)
                along = eta * tip_share * dot(push, t) / rod_length**2
                push = add(multiply(1.0 - eta + eta * tip_share, push), -along, t)
            else:
                arm = multiply(eta, d_i)
        g[r] = gap
        gradients[r, 0], gradients[r, 1], gradients[r, 2] = push
        gradients[r, 3], gradients[r, 4], gradients[r, 5] = cross(add(o, 1.0, arm), push)
        if not is_pair:
            across = add(by_d, -dot(by_d, b) / offset**2, b)
            gradients[r, 6], gradients[r, 7], gradients[r, 8] = add(add(E, scale, across), -1.0, push)
    best = 0
    for rod in range(1, len(rods)):
        change = rods[rod, 0] - rods[best, 0]
        if change < 0.0 or (change == 0.0 and rods[rod, 1] < rods[best, 1]):
            best = rod
    for r in range(len(kinds)):
        if data[r, COLUMNS.rod] >= 0.0 and data[r, COLUMNS.rod] != best:
            g[r] = math.inf


@njit(cache=True, forceinline=True)
def _slice(table: Array, data: Array, r: int, column: int) -> Array:
    """Return the faces or edges of the hull of row r, from a table of all."""
    return table[int(data[r, column]) : int(data[r, column + 1])]


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


@njit(cache=True, forceinline=True)
def _are_far(w: Vector, d_i: Vector, d_j: Vector, reach: float) -> bool:
    """True if the midpoints of two axes are so far apart that the gap must exceed GAPS.far."""
    middles = add(add(w, 0.5, d_i), -0.5, d_j)
    return dot(middles, middles) >= (reach + GAPS.far) ** 2

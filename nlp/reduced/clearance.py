r"""Exact clearances of the printed problem, closed form by cases, and their gradients.

.. math::

    f = \min_{\eta, \gamma \in [0, 1]} \|P_i(\eta) - P_j(\gamma)\|^2 - (r_i(\eta) + r_j(\gamma))^2, \qquad
    g = \sqrt{f + R^2} - R

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of a swept ball | l_arm |
| R | sum of both end radii | l_arm |
| g | clearance: zero with f, exact for balls of one size, and as steep in deep overlap | l_arm |
| b | p_E: end-effector from the centre of mass | l_arm |

`clearances` knows what a row of each kind is about: two points, two envelopes, parts and an envelope, parts and a
region at the end-effector, or an envelope or rod and such a region. The gradient of a row is a force on module i at
the point of it that is nearest; the opposite one is on module j or on the end-effector (`nlp.reduced.platform`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.reduced.arrays import ReducedProblem
from nlp.reduced.platform import Platform, Vector, add, cross, dot, multiply, rotate, row
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
    """Limits of the closed forms of clearances."""

    flat: float = 1e-9
    """Share of its largest value under which a determinant or a coefficient of f counts as zero."""
    least_distance: float = 1e-9
    """Floor on distances that are divided by: the distance of coincident points has no direction [l_arm]."""
    far: float = 8.0
    """Envelopes at least so far apart are not looked at closer [l_arm]."""
    rounding: float = 1e-12
    """Tolerance of the flatness of a face [l_arm]."""


GAPS = GapLimits()


@njit(cache=True, forceinline=True)
def divide(a: Vector, length: float) -> Vector:
    """Return a vector over a length, which it may have itself."""
    safe = max(length, GAPS.least_distance)
    return a[0] / safe, a[1] / safe, a[2] / safe


@njit(cache=True, forceinline=True)
def swept_gap(
    w: Vector, d_i: Vector, r_i: float, dr_i: float, d_j: Vector, r_j: float, dr_j: float
) -> tuple[float, float, float, Vector]:
    """Return g, eta and gamma of two swept balls, and the gradient of g by P_i.

    f is least at its stationary point, if that is a minimum inside the square, or else on an edge; f may be
    concave.

    Args:
        w: o_i - o_j.
        d_i: axis of the one, with start radius r_i and growth dr_i.
        r_i: see d_i.
        dr_i: see d_i.
        d_j: axis of the other, with r_j and dr_j.
        r_j: see d_j.
        dr_j: see d_j.
    """
    r = r_i + r_j
    ii, jj, ij = dot(d_i, d_i), dot(d_j, d_j), dot(d_i, d_j)
    A, B, C = ii - dr_i * dr_i, jj - dr_j * dr_j, -2 * (ij + dr_i * dr_j)
    D, E = 2 * (dot(d_i, w) - r * dr_i), -2 * (dot(d_j, w) + r * dr_j)
    det, largest = 4 * A * B - C * C, ii + jj
    least, eta, gamma, inside = math.inf, 0.0, 0.0, False
    if A > 0.0 and B > 0.0 and det > GAPS.flat * 4 * A * B:
        eta, gamma = (C * E - 2 * B * D) / det, (C * D - 2 * A * E) / det
        inside = 0.0 <= eta <= 1.0 and 0.0 <= gamma <= 1.0
    if not inside:
        eta = gamma = 0.0
        for k in range(2):
            end = float(k)
            for trial in range(2):
                between = float(trial)
                if GAPS.flat * largest < A:
                    between = min(max(-(C * end + D) / (2 * A), 0.0), 1.0)
                f = (A * between + C * end + D) * between + (B * end + E) * end
                if f < least:
                    least, eta, gamma = f, between, end
                between = float(trial)
                if GAPS.flat * largest < B:
                    between = min(max(-(C * end + E) / (2 * B), 0.0), 1.0)
                f = (A * end + C * between + D) * end + (B * between + E) * between
                if f < least:
                    least, eta, gamma = f, end, between
    x = add(add(w, eta, d_i), -gamma, d_j)
    R, radii = r + dr_i + dr_j, r + eta * dr_i + gamma * dr_j
    root = math.sqrt(dot(x, x) + (R - radii) * (R + radii))
    return root - R, eta, gamma, divide(x, root)


@njit(cache=True)
def hull_gap(
    w: Vector, d: Vector, r_0: float, dr: float, planes: Array, edges: Array
) -> tuple[float, float, Vector]:
    """Return g and eta of a swept ball and a hull, and the gradient of g by P.

    Outside the hull its nearest point is on an edge, or inside a face and then nearest to an end of the axis, for
    the distance from a plane is linear. An axis that enters the hull counts by how far it must be moved until it is
    beyond some face.

    Args:
        w: o from where the planes and edges are given from.
        d: the axis, with start radius r_0 and growth dr.
        r_0: see d.
        dr: see d.
        planes: see `Hulls`.
        edges: see `Hulls`.
    """
    R, enters, leaves = r_0 + dr, 0.0, 1.0
    apart, eta, push = -math.inf, 0.0, (0.0, 0.0, 0.0)
    for f in range(len(planes)):
        normal = row(planes, f)
        height, slope = dot(normal, w) - planes[f, 3], dot(normal, d)
        if height + min(slope, 0.0) > apart:
            apart, eta, push = height + min(slope, 0.0), 1.0 if slope < 0.0 else 0.0, normal
        if slope < 0.0:
            enters = max(enters, -height / slope)
        elif slope > 0.0:
            leaves = min(leaves, -height / slope)
        elif height > 0.0:
            leaves = -math.inf
    if enters <= leaves:
        return apart - R, eta, push
    if apart > R + GAPS.far:
        return math.inf, eta, push
    least = math.inf
    for e in range(len(edges)):
        g, at, _, by = swept_gap(add(w, -1.0, row(edges, e)), d, r_0, dr, row(edges, e, 3), 0.0, 0.0)
        if g < least:
            least, eta, push = g, at, by
    for end in (0.0, 1.0):
        point, radius = add(w, end, d), r_0 + end * dr
        height, normal = face_excess(point, planes)
        excess, _ = face_excess(add(point, -height, normal), planes)
        root = math.sqrt(height * height + (R - radius) * (R + radius))
        if height > 0.0 and excess <= GAPS.rounding and root - R < least:
            least, eta, push = root - R, end, multiply(height, divide(normal, root))
    return least, eta, push


@njit(cache=True)
def face_excess(q: Vector, planes: Array) -> tuple[float, Vector]:
    """Return how far a point is beyond the face of a hull that it is beyond most, and that face's normal."""
    most, face = -math.inf, 0
    for f in range(len(planes)):
        height = dot(row(planes, f), q) - planes[f, 3]
        if height > most:
            most, face = height, f
    return most, row(planes, face)


@njit(cache=True)
def clearances(problem: ReducedProblem, at: Platform, g: Array, by: Array) -> None:
    """Find the clearances of all rows, and their gradients.

    Args:
        problem: the task and topology.
        at: the platform.
        g: the clearances, shape (m,); an infinite one is more than GAPS.far, or of a rod that is not the best,
            and its gradient means nothing.
        by: F and T of module i, and E, shape (m, 9); on a module j are the opposite F and T in place of E.
    """
    rows = problem.rows
    kinds, one, other, data, least = rows.kind, rows.i, rows.j, rows.data, rows.least
    parts, R, places, axes, still = problem.parts, at.R, at.o, at.z, (0.0, 0.0, 0.0)
    length, r_air, dr_air = problem.air
    b = (at.p_E[0], at.p_E[1], at.p_E[2])
    offset, reach = max(GAPS.least_distance, math.sqrt(dot(b, b))), 0.0
    for k in range(len(parts)):
        reach = max(reach, math.sqrt(dot(row(parts, k), row(parts, k))) + parts[k, 3])
    lacking, lengths = np.zeros(problem.rows.rods), np.empty(problem.rows.rods)
    for r in range(len(kinds)):
        kind, i, j = kinds[r], one[r], other[r]
        o, turns, between = row(places, i), 0.0, kind in (AIR, APART, PARTS)
        # module i is w from a point, or from where the axis or path d of something with a radius begins
        if between:
            w, d, radius, growth = add(o, -1.0, row(places, j)), multiply(-length, row(axes, j)), r_air, dr_air
        else:
            w = add(add(o, -1.0, b), -1.0, row(data, r, COLUMNS.origin))
            d = row(data, r, COLUMNS.axis if kind in (CONE, PARTS_CONE) else COLUMNS.along)
            radius, growth = data[r, COLUMNS.radius], 0.0
            if kind in (CONE_COM, PARTS_CONE_COM, ALONG, PARTS_ALONG):  # it turns with p_E
                turns = (-1.0 if kind in (CONE_COM, PARTS_CONE_COM) else data[r, COLUMNS.length]) / offset
                d = multiply(turns, b)
        # gradients: `push` by a point `arm` from module i's centre, by_d by d, E besides
        gap, push, arm, by_d, E = math.inf, still, still, still, still
        if kind == OFFSET:
            gap, E = offset - data[r, COLUMNS.distance], divide(b, offset)
        elif kind in (APART, EXCLUSION):
            gap = math.sqrt(dot(w, w))
            push = divide(w, gap)
            gap -= data[r, COLUMNS.distance]
        elif PARTS <= kind <= PARTS_HULL:
            if kind == PARTS and _are_far(w, still, d, length / 2 + r_air + dr_air + reach):
                g[r] = math.inf
                continue
            for k in range(len(parts)):
                c, by_axis = rotate(R, i, row(parts, k)), still
                ball = add(w, 1.0, c)
                if kind == PARTS_HULL:
                    closest, by_ball = face_excess(ball, _slice(problem.hulls.planes, data, r, COLUMNS.planes))
                    closest -= parts[k, 3]
                elif kind in (PARTS_CONE, PARTS_CONE_COM):
                    closest, by_ball, by_axis = _cone_gap(ball, d, data[r, COLUMNS.sine], data[r, COLUMNS.cosine])
                    closest -= parts[k, 3]
                else:
                    closest, _, gamma, by_ball = swept_gap(ball, still, parts[k, 3], 0.0, d, radius, growth)
                    by_axis = multiply(-gamma, by_ball)
                if closest < gap:
                    gap, push, arm, by_d = closest, by_ball, c, by_axis
        else:  # an envelope, or a rod from a connector
            rod, skipped, apart, eta, t = int(data[r, COLUMNS.rod]), 0.0, 0.0, 0.0, add(o, -1.0, b)
            axis, r_0, dr = (length, r_air, dr_air) if kind == AIR else row(data, r, COLUMNS.envelope)
            d_i = multiply(-axis, row(axes, i))
            if kind == AIR and _are_far(w, d_i, d, length + 2 * (r_air + dr_air)):
                g[r] = math.inf
                continue
            if rod >= 0:
                arm = rotate(R, i, row(data, r, COLUMNS.connector))
                w, t = add(w, 1.0, arm), add(t, 1.0, arm)
                apart = max(GAPS.least_distance, math.sqrt(dot(t, t)))
                r_0, dr, skipped = data[r, COLUMNS.rod_radius], 0.0, data[r, COLUMNS.tip] / apart
                lengths[rod] = apart
                if skipped >= 1.0:  # all of it is tip
                    g[r] = math.inf
                    continue
                d_i = multiply(skipped - 1.0, t)
            if kind == REACH:
                gap, push = data[r, COLUMNS.distance] - apart, multiply(-1.0 / apart, t)
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
            if rod >= 0:  # at eta, (1 - eta) t + eta tip t / |t|
                lacking[rod] = max(lacking[rod], least[r] - gap)
                along = eta * skipped * dot(push, t) / apart**2
                push = add(multiply(1.0 - eta + eta * skipped, push), -along, t)
            else:
                arm = multiply(eta, d_i)
        g[r] = gap
        by[r, 0], by[r, 1], by[r, 2] = push
        by[r, 3], by[r, 4], by[r, 5] = cross(add(o, 1.0, arm), push)
        if not between:
            across = add(by_d, -dot(by_d, b) / offset**2, b)
            by[r, 6], by[r, 7], by[r, 8] = add(add(E, turns, across), -1.0, push)
    best = 0
    for rod in range(1, len(lacking)):
        if lacking[rod] < lacking[best] or (lacking[rod] == lacking[best] and lengths[rod] < lengths[best]):
            best = rod
    for r in range(len(kinds)):
        if data[r, COLUMNS.rod] >= 0.0 and data[r, COLUMNS.rod] != best:
            g[r] = math.inf


@njit(cache=True, forceinline=True)
def _slice(table: Array, data: Array, r: int, column: int) -> Array:
    """Return the rows of a table of faces or edges that are those of the hull of row r."""
    return table[int(data[r, column]) : int(data[r, column + 1])]


@njit(cache=True, forceinline=True)
def _cone_gap(q: Vector, d: Vector, sine: float, cosine: float) -> tuple[float, Vector, Vector]:
    """Return how far a point is inside a cone, the gradient by the point, and that by the axis.

    s = d . q sin(theta) - |q - (d . q) d| cos(theta), which changes by q sin + n (d . q) cos with the axis.

    Args:
        q: the point, from the apex.
        d: unit vector of the axis.
        sine: of the half-angle theta.
        cosine: of it.
    """
    along = dot(d, q)
    n = add(q, -along, d)
    rho = math.sqrt(dot(n, n))
    n = divide(n, rho)
    by_q, by_d = add(multiply(sine, d), -cosine, n), add(multiply(sine, q), cosine * along, n)
    return sine * along - cosine * rho, by_q, by_d


@njit(cache=True, forceinline=True)
def _are_far(w: Vector, d_i: Vector, d_j: Vector, reach: float) -> bool:
    """True if the middles of two axes are so far apart that the envelopes must be GAPS.far apart."""
    middles = add(add(w, 0.5, d_i), -0.5, d_j)
    return dot(middles, middles) >= (reach + GAPS.far) ** 2

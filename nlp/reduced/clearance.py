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
region at the end-effector, or an envelope or rod and such a region. A row depends on seven vectors: p_i, z_i, p_j,
z_j, p'_E, p_E, and small turns of module i. All is read by single numbers: every array that a call or a slice hands
on costs more than a clearance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.reduced.arrays import ReducedProblem
from nlp.reduced.platform import Platform
from nlp.requirements.statement import (
    AIR,
    ALONG,
    APART,
    BALL,
    CAPSULE,
    COLUMNS,
    CONE,
    CONE_COM,
    EXCLUSION,
    HULL,
    OFFSET,
    PARTS,
    PARTS_ALONG,
    PARTS_CAPSULE,
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


Vector = tuple[float, float, float]


@njit(cache=True, forceinline=True)
def swept_gap(
    w: Vector, d_i: Vector, r_i: float, dr_i: float, d_j: Vector, r_j: float, dr_j: float
) -> tuple[float, float, float, float, float, float]:
    """Return g, eta and gamma of two swept balls, and the gradient of g by P_i (x, y, z).

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
    ii = d_i[0] * d_i[0] + d_i[1] * d_i[1] + d_i[2] * d_i[2]
    jj = d_j[0] * d_j[0] + d_j[1] * d_j[1] + d_j[2] * d_j[2]
    ij = d_i[0] * d_j[0] + d_i[1] * d_j[1] + d_i[2] * d_j[2]
    A, B, C = ii - dr_i * dr_i, jj - dr_j * dr_j, -2 * (ij + dr_i * dr_j)
    D = 2 * (d_i[0] * w[0] + d_i[1] * w[1] + d_i[2] * w[2] - r * dr_i)
    E = -2 * (d_j[0] * w[0] + d_j[1] * w[1] + d_j[2] * w[2] + r * dr_j)
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
    x, y, z = (
        w[0] + eta * d_i[0] - gamma * d_j[0],
        w[1] + eta * d_i[1] - gamma * d_j[1],
        w[2] + eta * d_i[2] - gamma * d_j[2],
    )
    R, radii = r + dr_i + dr_j, r + eta * dr_i + gamma * dr_j
    root = math.sqrt(x * x + y * y + z * z + (R - radii) * (R + radii))
    safe = max(root, GAPS.least_distance)
    return root - R, eta, gamma, x / safe, y / safe, z / safe


@njit(cache=True)
def hull_gap(
    w: Vector, d: Vector, r_0: float, dr: float, planes: Array, edges: Array
) -> tuple[float, float, float, float, float]:
    """Return g and eta of a swept ball and a hull, and the gradient of g by P (x, y, z).

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
    apart, eta, x, y, z = -math.inf, 0.0, 0.0, 0.0, 0.0
    first, last, at_first, at_last = -math.inf, -math.inf, 0, 0
    for f in range(len(planes)):
        n0, n1, n2 = planes[f, 0], planes[f, 1], planes[f, 2]
        height = n0 * w[0] + n1 * w[1] + n2 * w[2] - planes[f, 3]
        slope = n0 * d[0] + n1 * d[1] + n2 * d[2]
        if height > first:
            first, at_first = height, f
        if height + slope > last:
            last, at_last = height + slope, f
        if height + min(slope, 0.0) > apart:
            apart, eta, x, y, z = height + min(slope, 0.0), 1.0 if slope < 0.0 else 0.0, n0, n1, n2
        if slope < 0.0:
            enters = max(enters, -height / slope)
        elif slope > 0.0:
            leaves = min(leaves, -height / slope)
        elif height > 0.0:
            leaves = -math.inf
    if enters <= leaves:
        return apart - R, eta, x, y, z
    if apart > R + GAPS.far:
        return math.inf, eta, x, y, z
    least = math.inf
    for e in range(len(edges)):
        from_start = (w[0] - edges[e, 0], w[1] - edges[e, 1], w[2] - edges[e, 2])
        edge = (edges[e, 3], edges[e, 4], edges[e, 5])
        g, at, _, s0, s1, s2 = swept_gap(from_start, d, r_0, dr, edge, 0.0, 0.0)
        if g < least:
            least, eta, x, y, z = g, at, s0, s1, s2
    for k in range(2):
        end, height, f = (1.0, last, at_last) if k else (0.0, first, at_first)
        foot0 = w[0] + end * d[0] - height * planes[f, 0]
        foot1 = w[1] + end * d[1] - height * planes[f, 1]
        foot2 = w[2] + end * d[2] - height * planes[f, 2]
        inside = height > 0.0
        for m in range(len(planes)):
            beyond = planes[m, 0] * foot0 + planes[m, 1] * foot1 + planes[m, 2] * foot2 - planes[m, 3]
            inside = inside and beyond <= GAPS.rounding
        radius = r_0 + end * dr
        root = math.sqrt(height * height + (R - radius) * (R + radius))
        if inside and root - R < least:
            slope = height / max(root, GAPS.least_distance)
            least, eta = root - R, end
            x, y, z = slope * planes[f, 0], slope * planes[f, 1], slope * planes[f, 2]
    return least, eta, x, y, z


@njit(cache=True)
def face_excess(q: Vector, planes: Array) -> tuple[float, float, float, float]:
    """Return how far a point is beyond the face of a hull that it is beyond most, and that face's normal."""
    most, face = -math.inf, 0
    for f in range(len(planes)):
        height = planes[f, 0] * q[0] + planes[f, 1] * q[1] + planes[f, 2] * q[2] - planes[f, 3]
        if height > most:
            most, face = height, f
    return most, planes[face, 0], planes[face, 1], planes[face, 2]


P_I, Z_I, P_J, Z_J, P_TIP, P_OFFSET, TURN_I = range(7)
"""The vectors that a row depends on: p_i, z_i, p_j, z_j, p'_E, p_E, and small turns of module i."""


@njit(cache=True)
def clearances(problem: ReducedProblem, at: Platform, g: Array, by: Array) -> None:
    """Find the clearances of all rows, and their gradients by the vectors that they depend on.

    Args:
        problem: the task and topology.
        at: the platform.
        g: the clearances, shape (m,); an infinite one is more than GAPS.far, or of a rod that is not the best,
            and its gradient means nothing.
        by: the gradients, shape (m, 7, 3).
    """
    kinds, one, other, data = problem.rows.kind, problem.rows.i, problem.rows.j, problem.rows.data
    parts, p, z, R, still = problem.parts, at.p, at.z, at.R, (0.0, 0.0, 0.0)
    length, r_air, dr_air = problem.air
    e0, e1, e2 = at.p_E[0], at.p_E[1], at.p_E[2]
    b = (e0 - at.p_COM[0], e1 - at.p_COM[1], e2 - at.p_COM[2])
    offset = max(GAPS.least_distance, math.sqrt(b[0] * b[0] + b[1] * b[1] + b[2] * b[2]))
    reach = 0.0
    for k in range(len(parts)):
        x, y, zz = parts[k, 0], parts[k, 1], parts[k, 2]
        reach = max(reach, math.sqrt(x * x + y * y + zz * zz) + parts[k, 3])
    by[:] = 0.0
    lacking, lengths = np.zeros(problem.rows.rods), np.empty(problem.rows.rods)
    for r in range(len(kinds)):
        kind, i, j = kinds[r], one[r], other[r]
        if kind == OFFSET:
            g[r] = _distance(b[0], b[1], b[2], by, r, P_OFFSET, P_OFFSET) - data[r, COLUMNS.distance]
            continue
        p0, p1, p2 = p[i, 0], p[i, 1], p[i, 2]
        if kind == EXCLUSION:
            g[r] = _distance(p0 - e0, p1 - e1, p2 - e2, by, r, P_I, P_TIP) - data[r, COLUMNS.distance]
            continue
        if kind in (APART, AIR, PARTS):
            w = (p0 - p[j, 0], p1 - p[j, 1], p2 - p[j, 2])
            d_j = (-length * z[j, 0], -length * z[j, 1], -length * z[j, 2])
            if kind == APART:
                g[r] = _distance(w[0], w[1], w[2], by, r, P_I, P_J) - data[r, COLUMNS.distance]
                continue
            g[r] = math.inf
            if kind == AIR:
                d_i = (-length * z[i, 0], -length * z[i, 1], -length * z[i, 2])
                if _are_far(w, d_i, d_j, length + 2 * (r_air + dr_air)):
                    continue
                g[r], eta, gamma, x, y, zz = swept_gap(w, d_i, r_air, dr_air, d_j, r_air, dr_air)
                _to(by, r, P_I, 1.0, x, y, zz)
                _to(by, r, Z_I, -length * eta, x, y, zz)
                _to(by, r, P_J, -1.0, x, y, zz)
                _to(by, r, Z_J, length * gamma, x, y, zz)
                continue
            if _are_far(w, still, d_j, length / 2 + r_air + dr_air + reach):
                continue
            for k in range(len(parts)):
                c = _rotate(R, i, parts[k, 0], parts[k, 1], parts[k, 2])
                ball = (w[0] + c[0], w[1] + c[1], w[2] + c[2])
                gap, _, gamma, x, y, zz = swept_gap(ball, still, parts[k, 3], 0.0, d_j, r_air, dr_air)
                if gap < g[r]:
                    g[r] = gap
                    _to(by, r, P_I, 1.0, x, y, zz)
                    _to(by, r, P_J, -1.0, x, y, zz)
                    _to(by, r, Z_J, length * gamma, x, y, zz)
                    _to_turn(by, r, c, x, y, zz)
            continue
        # what is left is about a region at the end-effector, whose axis or path may turn with p_E
        column = COLUMNS.axis if kind in (CONE, PARTS_CONE) else COLUMNS.along
        d, turns = (data[r, column], data[r, column + 1], data[r, column + 2]), 0.0
        if kind in (CONE_COM, PARTS_CONE_COM, ALONG, PARTS_ALONG):
            turns = (-1.0 if kind in (CONE_COM, PARTS_CONE_COM) else data[r, COLUMNS.length]) / offset
            d = (turns * b[0], turns * b[1], turns * b[2])
        q0, q1, q2 = data[r, COLUMNS.origin], data[r, COLUMNS.origin + 1], data[r, COLUMNS.origin + 2]
        if PARTS_CONE <= kind <= PARTS_HULL:
            g[r], w = math.inf, (p0 - e0 - q0, p1 - e1 - q1, p2 - e2 - q2)
            for k in range(len(parts)):
                radius, u = parts[k, 3], still  # u: what of the gradient turns axis or path
                c = _rotate(R, i, parts[k, 0], parts[k, 1], parts[k, 2])
                ball = (w[0] + c[0], w[1] + c[1], w[2] + c[2])
                if kind == PARTS_HULL:
                    first, past = int(data[r, COLUMNS.planes]), int(data[r, COLUMNS.planes + 1])
                    gap, x, y, zz = face_excess(ball, problem.hulls.planes[first:past])
                    gap -= radius
                elif kind in (PARTS_CAPSULE, PARTS_ALONG):
                    gap, _, gamma, x, y, zz = swept_gap(ball, still, radius, 0.0, d, data[r, COLUMNS.radius], 0.0)
                    u = (-gamma * x, -gamma * y, -gamma * zz)
                else:
                    gap, x, y, zz, u = _cone_gap(ball, d, data[r, COLUMNS.sine], data[r, COLUMNS.cosine])
                    gap -= radius
                if gap < g[r]:
                    g[r] = gap
                    _to(by, r, P_I, 1.0, x, y, zz)
                    _to(by, r, P_TIP, -1.0, x, y, zz)
                    _to_turn(by, r, c, x, y, zz)
                    if turns != 0.0:
                        _to_offset(by, r, b, offset, turns, u)
            continue
        # the body beside the region is an envelope, or a rod from a connector at c from its module's centre
        rod, skipped, apart, c, eta = int(data[r, COLUMNS.rod]), 0.0, 0.0, still, 0.0
        axis, r_0, dr = data[r, COLUMNS.envelope], data[r, COLUMNS.envelope + 1], data[r, COLUMNS.envelope + 2]
        d_i = (-axis * z[i, 0], -axis * z[i, 1], -axis * z[i, 2])
        t = (p0 - e0, p1 - e1, p2 - e2)
        if rod >= 0:
            k = COLUMNS.connector
            c = _rotate(R, i, data[r, k], data[r, k + 1], data[r, k + 2])
            t = (p0 + c[0] - e0, p1 + c[1] - e1, p2 + c[2] - e2)
            apart = max(GAPS.least_distance, math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]))
            r_0, dr, skipped = data[r, COLUMNS.rod_radius], 0.0, data[r, COLUMNS.tip] / apart
            lengths[rod] = apart
            if skipped >= 1.0:  # all of it is tip
                g[r] = math.inf
                continue
            d_i = ((skipped - 1.0) * t[0], (skipped - 1.0) * t[1], (skipped - 1.0) * t[2])
        w = (t[0] - q0, t[1] - q1, t[2] - q2)
        if kind == REACH:
            g[r], x, y, zz = data[r, COLUMNS.distance] - apart, -t[0] / apart, -t[1] / apart, -t[2] / apart
        elif kind == HULL:
            planes = problem.hulls.planes[int(data[r, COLUMNS.planes]) : int(data[r, COLUMNS.planes + 1])]
            edges = problem.hulls.edges[int(data[r, COLUMNS.edges]) : int(data[r, COLUMNS.edges + 1])]
            g[r], eta, x, y, zz = hull_gap(w, d_i, r_0, dr, planes, edges)
        elif kind in (BALL, CAPSULE, ALONG):
            g[r], eta, gamma, x, y, zz = swept_gap(w, d_i, r_0, dr, d, data[r, COLUMNS.radius], 0.0)
            if turns != 0.0:
                _to_offset(by, r, b, offset, -gamma * turns, (x, y, zz))
        else:  # an end ball in a cone
            eta = data[r, COLUMNS.end]
            end = (w[0] + eta * d_i[0], w[1] + eta * d_i[1], w[2] + eta * d_i[2])
            gap, x, y, zz, u = _cone_gap(end, d, data[r, COLUMNS.sine], data[r, COLUMNS.cosine])
            g[r] = gap - r_0 - eta * dr
            if turns != 0.0:
                _to_offset(by, r, b, offset, turns, u)
        if rod >= 0:  # at eta, (1 - eta) t + eta tip t / |t|
            lacking[rod] = max(lacking[rod], problem.rows.least[r] - g[r])
            along = eta * skipped * (x * t[0] + y * t[1] + zz * t[2]) / apart**2
            scale = 1.0 - eta + eta * skipped
            x, y, zz = scale * x - along * t[0], scale * y - along * t[1], scale * zz - along * t[2]
            _to_turn(by, r, c, x, y, zz)
        else:
            _to(by, r, Z_I, -axis * eta, x, y, zz)
        _to(by, r, P_I, 1.0, x, y, zz)
        _to(by, r, P_TIP, -1.0, x, y, zz)
    best = 0
    for rod in range(1, len(lacking)):
        if lacking[rod] < lacking[best] or (lacking[rod] == lacking[best] and lengths[rod] < lengths[best]):
            best = rod
    for r in range(len(kinds)):
        if data[r, COLUMNS.rod] >= 0.0 and data[r, COLUMNS.rod] != best:
            g[r] = math.inf


@njit(cache=True, forceinline=True)
def _cone_gap(q: Vector, d: Vector, sine: float, cosine: float) -> tuple[float, float, float, float, Vector]:
    """Return how far a point is inside a cone, the gradient by the point (x, y, z), and that by the axis.

    s = d . q sin(theta) - |q - (d . q) d| cos(theta), which changes by q sin + n (d . q) cos with the axis.

    Args:
        q: the point, from the apex.
        d: unit vector of the axis.
        sine: of the half-angle theta.
        cosine: of it.
    """
    along = d[0] * q[0] + d[1] * q[1] + d[2] * q[2]
    n0, n1, n2 = q[0] - along * d[0], q[1] - along * d[1], q[2] - along * d[2]
    rho = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    safe = max(rho, GAPS.least_distance)
    n0, n1, n2 = n0 / safe, n1 / safe, n2 / safe
    u = (sine * q[0] + cosine * along * n0, sine * q[1] + cosine * along * n1, sine * q[2] + cosine * along * n2)
    return (
        sine * along - cosine * rho,
        sine * d[0] - cosine * n0,
        sine * d[1] - cosine * n1,
        sine * d[2] - cosine * n2,
        u,
    )


@njit(cache=True, forceinline=True)
def _rotate(R: Array, i: int, x: float, y: float, z: float) -> Vector:
    """Return a vector of module i's frame in W."""
    return (
        R[i, 0, 0] * x + R[i, 0, 1] * y + R[i, 0, 2] * z,
        R[i, 1, 0] * x + R[i, 1, 1] * y + R[i, 1, 2] * z,
        R[i, 2, 0] * x + R[i, 2, 1] * y + R[i, 2, 2] * z,
    )


@njit(cache=True, forceinline=True)
def _to_turn(by: Array, r: int, c: Vector, x: float, y: float, z: float) -> None:
    """Set the gradient by turns of module i, of one by the place of its point at c from its centre."""
    _to(by, r, TURN_I, 1.0, c[1] * z - c[2] * y, c[2] * x - c[0] * z, c[0] * y - c[1] * x)


@njit(cache=True, forceinline=True)
def _to_offset(by: Array, r: int, b: Vector, offset: float, scale: float, u: Vector) -> None:
    """Set the gradient by p_E = b, of length `offset`, of what turns with it: the part of a vector u across b."""
    along = (u[0] * b[0] + u[1] * b[1] + u[2] * b[2]) / offset**2
    _to(by, r, P_OFFSET, scale, u[0] - along * b[0], u[1] - along * b[1], u[2] - along * b[2])


@njit(cache=True, forceinline=True)
def _to(by: Array, r: int, vector: int, scale: float, x: float, y: float, z: float) -> None:
    by[r, vector, 0], by[r, vector, 1], by[r, vector, 2] = scale * x, scale * y, scale * z


@njit(cache=True, forceinline=True)
def _distance(x: float, y: float, z: float, by: Array, r: int, plus: int, minus: int) -> float:
    length = math.sqrt(x * x + y * y + z * z)
    safe = max(length, GAPS.least_distance)
    if minus != plus:
        _to(by, r, minus, -1.0 / safe, x, y, z)
    _to(by, r, plus, 1.0 / safe, x, y, z)
    return length


@njit(cache=True, forceinline=True)
def _are_far(w: Vector, d_i: Vector, d_j: Vector, reach: float) -> bool:
    """True if the middles of two axes are so far apart that the envelopes must be GAPS.far apart."""
    x, y, z = w[0] + (d_i[0] - d_j[0]) / 2, w[1] + (d_i[1] - d_j[1]) / 2, w[2] + (d_i[2] - d_j[2]) / 2
    return x * x + y * y + z * z >= (reach + GAPS.far) ** 2

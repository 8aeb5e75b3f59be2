r"""Exact clearances of the printed problem, closed form by cases, with what they change by.

.. math::

    f = \min_{\eta, \gamma \in [0, 1]} \|P_i(\eta) - P_j(\gamma)\|^2 - (r_i(\eta) + r_j(\gamma))^2, \qquad
    g = \sqrt{f + R^2} - R

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of a swept ball | l_arm |
| R | sum of both end radii | l_arm |
| g | clearance: zero with f, exact for balls of one size, and as steep in deep overlap | l_arm |

A row depends on seven vectors: p_i, z_i, p_j, z_j, the end-effector's p'_E and p_E, and small turns of module i.

Exact clearances of single shapes in closed form by cases, and their gradients by the one shape's place.

.. math::

    g = \sqrt{f + R^2} - R

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of a swept ball | l_arm |
| f | least squared distance less the squared radii there | l_arm^2 |
| R | sum of both end radii | l_arm |
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
    most, found = -math.inf, 0
    for f in range(len(planes)):
        height = planes[f, 0] * q[0] + planes[f, 1] * q[1] + planes[f, 2] * q[2] - planes[f, 3]
        if height > most:
            most, found = height, f
    return most, planes[found, 0], planes[found, 1], planes[found, 2]


P_I, Z_I, P_J, Z_J, TIP, OFFSET_B, TURN_I = range(7)
"""The vectors that a row depends on: p_i, z_i, p_j, z_j, p'_E, p_E, and small turns of module i."""


@njit(cache=True)
def clearances(stated: ReducedProblem, at: Platform, g: Array, by: Array) -> None:
    """Find the clearances of all rows, and their gradients by the vectors that they depend on.

    All is read by single numbers: every array that a call or a slice hands on costs more than a clearance.

    Args:
        stated: the task and topology.
        at: the platform.
        g: the clearances, shape (m,); an infinite one is more than GAPS.far, or of a rod that is not the best,
            and its gradient means nothing.
        by: the gradients, shape (m, 7, 3).
    """
    kinds, one, other, data = stated.rows.kind, stated.rows.i, stated.rows.j, stated.rows.data
    parts, p, z, R = stated.parts, at.p, at.z, at.R
    length, r_air, dr = stated.air
    ex, ey, ez = at.p_E[0], at.p_E[1], at.p_E[2]
    bx, by_, bz = ex - at.p_COM[0], ey - at.p_COM[1], ez - at.p_COM[2]
    offset = max(GAPS.least_distance, math.sqrt(bx * bx + by_ * by_ + bz * bz))
    reach = 0.0
    for b in range(len(parts)):
        x, y, zz = parts[b, 0], parts[b, 1], parts[b, 2]
        reach = max(reach, math.sqrt(x * x + y * y + zz * zz) + parts[b, 3])
    by[:] = 0.0
    lacking, lengths = np.zeros(stated.rows.rods), np.empty(stated.rows.rods)
    for r in range(len(kinds)):
        kind, i, j, size = kinds[r], one[r], other[r], data[r, 3]
        if kind == OFFSET:
            g[r] = _distance(bx, by_, bz, by, r, OFFSET_B, OFFSET_B) - size
            continue
        px, py, pz = p[i, 0], p[i, 1], p[i, 2]
        if kind == EXCLUSION:
            g[r] = _distance(px - ex, py - ey, pz - ez, by, r, P_I, TIP) - size
            continue
        if PARTS_CONE <= kind <= PARTS_HULL:
            g[r], w = math.inf, (px - ex - data[r, 6], py - ey - data[r, 7], pz - ez - data[r, 8])
            a0, a1, a2, still, turns = data[r, 0], data[r, 1], data[r, 2], (0.0, 0.0, 0.0), 0.0
            if kind in (PARTS_CONE_COM, PARTS_ALONG):  # what of the gradient lies across p_E turns axis and path
                turns = -1.0 if kind == PARTS_CONE_COM else data[r, 0]
                a0, a1, a2 = turns * bx / offset, turns * by_ / offset, turns * bz / offset
            for b in range(len(parts)):
                x, y, zz = parts[b, 0], parts[b, 1], parts[b, 2]
                c0 = R[i, 0, 0] * x + R[i, 0, 1] * y + R[i, 0, 2] * zz
                c1 = R[i, 1, 0] * x + R[i, 1, 1] * y + R[i, 1, 2] * zz
                c2 = R[i, 2, 0] * x + R[i, 2, 1] * y + R[i, 2, 2] * zz
                q0, q1, q2 = w[0] + c0, w[1] + c1, w[2] + c2
                u0, u1, u2 = 0.0, 0.0, 0.0  # what moves by the turn of axis or path
                if kind == PARTS_HULL:
                    gap, x, y, zz = face_excess((q0, q1, q2), stated.hulls.planes[int(a0) : int(a1)])
                    gap -= parts[b, 3]
                elif kind in (PARTS_CAPSULE, PARTS_ALONG):
                    ball = (q0, q1, q2)
                    gap, _, gamma, x, y, zz = swept_gap(ball, still, parts[b, 3], 0.0, (a0, a1, a2), size, 0.0)
                    u0, u1, u2 = -gamma * x, -gamma * y, -gamma * zz
                else:
                    along = q0 * a0 + q1 * a1 + q2 * a2
                    r0, r1, r2 = q0 - along * a0, q1 - along * a1, q2 - along * a2
                    across = max(GAPS.least_distance, math.sqrt(r0 * r0 + r1 * r1 + r2 * r2))
                    sine, cosine = data[r, 4], data[r, 5] / across
                    gap = along * sine - cosine * across * across - parts[b, 3]
                    x, y, zz = a0 * sine - cosine * r0, a1 * sine - cosine * r1, a2 * sine - cosine * r2
                    u0, u1 = sine * q0 + cosine * along * r0, sine * q1 + cosine * along * r1
                    u2 = sine * q2 + cosine * along * r2
                if gap < g[r]:
                    g[r] = gap
                    _to(by, r, P_I, 1.0, x, y, zz)
                    _to(by, r, TIP, -1.0, x, y, zz)
                    _to(by, r, TURN_I, 1.0, c1 * zz - c2 * y, c2 * x - c0 * zz, c0 * y - c1 * x)
                    if turns != 0.0:
                        along = (u0 * bx + u1 * by_ + u2 * bz) / offset**2
                        _to(by, r, OFFSET_B, turns / offset, u0 - along * bx, u1 - along * by_, u2 - along * bz)
            continue
        zx, zy, zz = z[i, 0], z[i, 1], z[i, 2]
        if kind in (APART, AIR, PARTS):
            d_i = (-length * zx, -length * zy, -length * zz)
            w = (px - p[j, 0], py - p[j, 1], pz - p[j, 2])
            if kind == APART:
                g[r] = _distance(w[0], w[1], w[2], by, r, P_I, P_J) - size
                continue
            d_j = (-length * z[j, 0], -length * z[j, 1], -length * z[j, 2])
            if kind == AIR:
                if _are_far(w, d_i, d_j, length + 2 * (r_air + dr)):
                    g[r] = math.inf
                    continue
                g[r], eta, gamma, x, y, zz = swept_gap(w, d_i, r_air, dr, d_j, r_air, dr)
                _to(by, r, P_I, 1.0, x, y, zz)
                _to(by, r, Z_I, -length * eta, x, y, zz)
                _to(by, r, P_J, -1.0, x, y, zz)
                _to(by, r, Z_J, length * gamma, x, y, zz)
                continue
            g[r], still = math.inf, (0.0, 0.0, 0.0)
            if _are_far(w, still, d_j, length / 2 + r_air + dr + reach):
                continue
            for b in range(len(parts)):
                x, y, zz = parts[b, 0], parts[b, 1], parts[b, 2]
                c0 = R[i, 0, 0] * x + R[i, 0, 1] * y + R[i, 0, 2] * zz
                c1 = R[i, 1, 0] * x + R[i, 1, 1] * y + R[i, 1, 2] * zz
                c2 = R[i, 2, 0] * x + R[i, 2, 1] * y + R[i, 2, 2] * zz
                ball = (w[0] + c0, w[1] + c1, w[2] + c2)
                gap, _, gamma, x, y, zz = swept_gap(ball, still, parts[b, 3], 0.0, d_j, r_air, dr)
                if gap < g[r]:
                    g[r] = gap
                    _to(by, r, P_I, 1.0, x, y, zz)
                    _to(by, r, P_J, -1.0, x, y, zz)
                    _to(by, r, Z_J, length * gamma, x, y, zz)
                    _to(by, r, TURN_I, 1.0, c1 * zz - c2 * y, c2 * x - c0 * zz, c0 * y - c1 * x)
            continue
        # what is left: a body and a region, the body being the envelope or a rod from p_i + c
        rod, skipped = int(data[r, 14]), 0.0
        axis, r_0, growth = data[r, 9], data[r, 10], data[r, 11]
        d_i = (-axis * zx, -axis * zy, -axis * zz)
        c0, c1, c2, t0, t1, t2 = 0.0, 0.0, 0.0, px - ex, py - ey, pz - ez
        if rod >= 0:
            x, y, zz = data[r, 9], data[r, 10], data[r, 11]
            c0 = R[i, 0, 0] * x + R[i, 0, 1] * y + R[i, 0, 2] * zz
            c1 = R[i, 1, 0] * x + R[i, 1, 1] * y + R[i, 1, 2] * zz
            c2 = R[i, 2, 0] * x + R[i, 2, 1] * y + R[i, 2, 2] * zz
            t0, t1, t2 = px + c0 - ex, py + c1 - ey, pz + c2 - ez
            apart = max(GAPS.least_distance, math.sqrt(t0 * t0 + t1 * t1 + t2 * t2))
            r_0, growth, skipped = data[r, 12], 0.0, data[r, 13] / apart
            lengths[rod] = apart
            if skipped >= 1.0:  # all of it is tip
                g[r] = math.inf
                continue
            d_i = ((skipped - 1.0) * t0, (skipped - 1.0) * t1, (skipped - 1.0) * t2)
        w, eta = (t0 - data[r, 6], t1 - data[r, 7], t2 - data[r, 8]), 0.0
        if kind == REACH:
            g[r], x, y, zz = size - apart, -t0 / apart, -t1 / apart, -t2 / apart
        elif kind == HULL:
            planes = stated.hulls.planes[int(data[r, 0]) : int(data[r, 1])]
            edges = stated.hulls.edges[int(data[r, 2]) : int(data[r, 3])]
            g[r], eta, x, y, zz = hull_gap(w, d_i, r_0, growth, planes, edges)
        elif kind in (BALL, CAPSULE, ALONG):
            d_j, path = (data[r, 0], data[r, 1], data[r, 2]), data[r, 0]
            if kind == ALONG:
                d_j = (path * bx / offset, path * by_ / offset, path * bz / offset)
            g[r], eta, gamma, x, y, zz = swept_gap(w, d_i, r_0, growth, d_j, size, 0.0)
            if kind == ALONG:  # what of the gradient lies across p_E turns the path
                along = (x * bx + y * by_ + zz * bz) / offset**2
                scale = -gamma * path / offset
                _to(by, r, OFFSET_B, scale, x - along * bx, y - along * by_, zz - along * bz)
        else:  # an end ball inside a cone: s - r, s = d . q sin(theta) - |q - (d . q) d| cos(theta)
            eta, sine, cosine = size, data[r, 4], data[r, 5]
            q0, q1, q2 = w[0] + eta * d_i[0], w[1] + eta * d_i[1], w[2] + eta * d_i[2]
            a0, a1, a2 = data[r, 0], data[r, 1], data[r, 2]
            if kind == CONE_COM:
                a0, a1, a2 = -bx / offset, -by_ / offset, -bz / offset
            along = a0 * q0 + a1 * q1 + a2 * q2
            n0, n1, n2 = q0 - along * a0, q1 - along * a1, q2 - along * a2
            rho = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
            safe = max(rho, GAPS.least_distance)
            n0, n1, n2 = n0 / safe, n1 / safe, n2 / safe
            if kind == CONE_COM:  # along changes by q . dd, rho by -along n . dd; d turns across p_E alone
                x, y = sine * q0 + cosine * along * n0, sine * q1 + cosine * along * n1
                zz = sine * q2 + cosine * along * n2
                across = x * a0 + y * a1 + zz * a2
                _to(by, r, OFFSET_B, -1.0 / offset, x - across * a0, y - across * a1, zz - across * a2)
            x, y, zz = sine * a0 - cosine * n0, sine * a1 - cosine * n1, sine * a2 - cosine * n2
            g[r] = sine * along - cosine * rho - r_0 - eta * growth
        if rod >= 0:  # at eta, (1 - eta) t + eta tip t / |t|
            lacking[rod] = max(lacking[rod], stated.rows.least[r] - g[r])
            along = eta * skipped * (x * t0 + y * t1 + zz * t2) / apart**2
            scale = 1.0 - eta + eta * skipped
            x, y, zz = scale * x - along * t0, scale * y - along * t1, scale * zz - along * t2
            _to(by, r, TURN_I, 1.0, c1 * zz - c2 * y, c2 * x - c0 * zz, c0 * y - c1 * x)
        else:
            _to(by, r, Z_I, -axis * eta, x, y, zz)
        _to(by, r, P_I, 1.0, x, y, zz)
        _to(by, r, TIP, -1.0, x, y, zz)
    best = 0
    for rod in range(1, len(lacking)):
        if lacking[rod] < lacking[best] or (lacking[rod] == lacking[best] and lengths[rod] < lengths[best]):
            best = rod
    for r in range(len(kinds)):
        if data[r, 14] >= 0.0 and data[r, 14] != best:
            g[r] = math.inf


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

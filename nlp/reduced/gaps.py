r"""Exact clearances of single shapes in closed form by cases, and their gradients by the one shape's place.

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

from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

FLAT = 1e-9
"""Share of its largest value under which a determinant or a coefficient of f counts as zero."""
LEAST_DISTANCE = 1e-9
"""Floor on distances that are divided by: the distance of coincident points has no direction [l_arm]."""
FAR = 8.0
"""Envelopes at least so far apart are not looked at closer [l_arm]."""
ROUNDING = 1e-12
"""Tolerance of the flatness of a face [l_arm]."""

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
    if A > 0.0 and B > 0.0 and det > FLAT * 4 * A * B:
        eta, gamma = (C * E - 2 * B * D) / det, (C * D - 2 * A * E) / det
        inside = 0.0 <= eta <= 1.0 and 0.0 <= gamma <= 1.0
    if not inside:
        eta = gamma = 0.0
        for k in range(2):
            end = float(k)
            for trial in range(2):
                between = float(trial)
                if FLAT * largest < A:
                    between = min(max(-(C * end + D) / (2 * A), 0.0), 1.0)
                f = (A * between + C * end + D) * between + (B * end + E) * end
                if f < least:
                    least, eta, gamma = f, between, end
                between = float(trial)
                if FLAT * largest < B:
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
    safe = max(root, LEAST_DISTANCE)
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
    if apart > R + FAR:
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
            inside = inside and beyond <= ROUNDING
        radius = r_0 + end * dr
        root = math.sqrt(height * height + (R - radius) * (R + radius))
        if inside and root - R < least:
            slope = height / max(root, LEAST_DISTANCE)
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

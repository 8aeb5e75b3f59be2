r"""Exact clearances of the page, closed form by cases, with what they change by.

.. math::

    f = \min_{\eta, \gamma \in [0, 1]} \|P_i(\eta) - P_j(\gamma)\|^2 - (r_i(\eta) + r_j(\gamma))^2, \qquad
    g = \sqrt{f + R^2} - R

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of a swept ball | l_arm |
| R | sum of both end radii | l_arm |
| g | clearance: zero with f, exact for balls of one size, and as steep in deep overlap | l_arm |

A row depends on seven vectors: p_i, z_i, p_j, z_j, the end-effector's p'_E and p_E, and small turns of module i.
"""

from __future__ import annotations

import math

from numba import njit

from nlp.reduced.platform import Platform
from nlp.reduced.stated import AIR, ALONG, APART, BALL, CAPSULE, CONE_COM, EXCLUSION, OFFSET, PARTS, Stated
from topo_search.model.arrays import Array

FLAT = 1e-9
"""Share of its largest value under which a determinant or a coefficient of f counts as zero."""
LEAST_DISTANCE = 1e-9
"""Where two points coincide their distance has no direction [l_arm]."""
FAR = 8.0
"""Envelopes at least so far apart are not looked at closer [l_arm]."""
P_I, Z_I, P_J, Z_J, TIP, OFFSET_B, TURN_I = range(7)
"""The vectors that a row depends on: p_i, z_i, p_j, z_j, p'_E, p_E, and small turns of module i."""


@njit(cache=True)
def row(stated: Stated, at: Platform, number: int, local: Array) -> float:
    """Return the clearance of a row, and in `local`, shape (7, 3), its gradient by the vectors that it depends on.

    An infinite clearance is more than FAR and comes without a gradient.
    """
    kind, i, j = stated.rows.kind[number], stated.rows.i[number], stated.rows.j[number]
    data = stated.rows.data[number]
    length, r_air, dr = stated.air
    local[:] = 0.0
    px, py, pz = at.p[i]
    ex, ey, ez = at.p_E
    size = data[3]
    if kind == APART:
        apart: float = _distance(px - at.p[j, 0], py - at.p[j, 1], pz - at.p[j, 2], local, P_I, P_J) - size
        return apart
    if kind == EXCLUSION:
        off: float = _distance(px - ex, py - ey, pz - ez, local, P_I, TIP) - size
        return off
    bx, by, bz = ex - at.p_COM[0], ey - at.p_COM[1], ez - at.p_COM[2]
    if kind == OFFSET:
        far: float = _distance(bx, by, bz, local, OFFSET_B, OFFSET_B) - size
        return far
    zx, zy, zz = at.z[i]
    d_i = (-length * zx, -length * zy, -length * zz)
    if kind == AIR:
        w = (px - at.p[j, 0], py - at.p[j, 1], pz - at.p[j, 2])
        d_j = (-length * at.z[j, 0], -length * at.z[j, 1], -length * at.z[j, 2])
        if _far(w, d_i, d_j, length + 2 * (r_air + dr)):
            return math.inf
        g, eta, gamma, x, y, z = swept(w, d_i, r_air, dr, d_j, r_air, dr)
        _to(local, P_I, 1.0, x, y, z)
        _to(local, Z_I, -length * eta, x, y, z)
        _to(local, P_J, -1.0, x, y, z)
        _to(local, Z_J, length * gamma, x, y, z)
        return g
    if kind == PARTS:
        return _parts(stated, at, i, j, local)
    w = (px - ex, py - ey, pz - ez)
    if kind in (BALL, CAPSULE, ALONG):
        d_j = (data[0], data[1], data[2])
        offset, path = max(LEAST_DISTANCE, math.sqrt(bx * bx + by * by + bz * bz)), data[0]
        if kind == ALONG:
            d_j = (path * bx / offset, path * by / offset, path * bz / offset)
        g, eta, gamma, x, y, z = swept(w, d_i, r_air, dr, d_j, size, 0.0)
        _to(local, P_I, 1.0, x, y, z)
        _to(local, Z_I, -length * eta, x, y, z)
        _to(local, TIP, -1.0, x, y, z)
        if kind == ALONG:  # what of the gradient lies across p_E turns the path
            along = (x * bx + y * by + z * bz) / offset**2
            scale = -gamma * path / offset
            _to(local, OFFSET_B, scale, x - along * bx, y - along * by, z - along * bz)
        return g
    # an end ball inside a cone: s - r, s = d . q sin(theta) - |q - (d . q) d| cos(theta)
    eta, sine, cosine = float(j), data[4], data[5]
    q0, q1, q2 = w[0] + eta * d_i[0], w[1] + eta * d_i[1], w[2] + eta * d_i[2]
    c0, c1, c2 = data[0], data[1], data[2]
    offset = max(LEAST_DISTANCE, math.sqrt(bx * bx + by * by + bz * bz))
    if kind == CONE_COM:
        c0, c1, c2 = -bx / offset, -by / offset, -bz / offset
    along = c0 * q0 + c1 * q1 + c2 * q2
    n0, n1, n2 = q0 - along * c0, q1 - along * c1, q2 - along * c2
    rho = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    safe = max(rho, LEAST_DISTANCE)
    n0, n1, n2 = n0 / safe, n1 / safe, n2 / safe
    x, y, z = sine * c0 - cosine * n0, sine * c1 - cosine * n1, sine * c2 - cosine * n2
    _to(local, P_I, 1.0, x, y, z)
    _to(local, Z_I, -length * eta, x, y, z)
    _to(local, TIP, -1.0, x, y, z)
    if kind == CONE_COM:  # along changes by q . dd, rho by -along n . dd; d turns across p_E alone
        x, y, z = sine * q0 + cosine * along * n0, sine * q1 + cosine * along * n1, sine * q2 + cosine * along * n2
        across = x * c0 + y * c1 + z * c2
        _to(local, OFFSET_B, -1.0 / offset, x - across * c0, y - across * c1, z - across * c2)
    inside: float = sine * along - cosine * rho - r_air - eta * dr
    return inside


@njit(cache=True)
def _parts(stated: Stated, at: Platform, i: int, j: int, local: Array) -> float:
    """Return the least clearance of the balls around module i's parts from the envelope of module j."""
    length, r_air, dr = stated.air
    d_i, d_j = (0.0, 0.0, 0.0), (-length * at.z[j, 0], -length * at.z[j, 1], -length * at.z[j, 2])
    w = (at.p[i, 0] - at.p[j, 0], at.p[i, 1] - at.p[j, 1], at.p[i, 2] - at.p[j, 2])
    reach = 0.0
    for b in range(len(stated.parts)):
        x, y, z, size = stated.parts[b]
        reach = max(reach, math.sqrt(x * x + y * y + z * z) + size)
    if _far(w, d_i, d_j, length / 2 + r_air + dr + reach):
        return math.inf
    least = math.inf
    for b in range(len(stated.parts)):
        x, y, z, size = stated.parts[b]
        R = at.R[i]
        c0 = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
        c1 = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
        c2 = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
        ball = (w[0] + c0, w[1] + c1, w[2] + c2)
        g, _, gamma, x, y, z = swept(ball, d_i, size, 0.0, d_j, r_air, dr)
        if g < least:
            least = g
            _to(local, P_I, 1.0, x, y, z)
            _to(local, P_J, -1.0, x, y, z)
            _to(local, Z_J, length * gamma, x, y, z)
            _to(local, TURN_I, 1.0, c1 * z - c2 * y, c2 * x - c0 * z, c0 * y - c1 * x)
    return least


@njit(cache=True)
def _to(local: Array, vector: int, scale: float, x: float, y: float, z: float) -> None:
    local[vector, 0], local[vector, 1], local[vector, 2] = scale * x, scale * y, scale * z


@njit(cache=True)
def _distance(x: float, y: float, z: float, local: Array, plus: int, minus: int) -> float:
    length = math.sqrt(x * x + y * y + z * z)
    safe = max(length, LEAST_DISTANCE)
    if minus != plus:
        _to(local, minus, -1.0 / safe, x, y, z)
    _to(local, plus, 1.0 / safe, x, y, z)
    return length


@njit(cache=True)
def _far(
    w: tuple[float, float, float], d_i: tuple[float, float, float], d_j: tuple[float, float, float], reach: float
) -> bool:
    """Whether the middles of two axes are so far apart that the envelopes must be FAR apart."""
    x, y, z = w[0] + (d_i[0] - d_j[0]) / 2, w[1] + (d_i[1] - d_j[1]) / 2, w[2] + (d_i[2] - d_j[2]) / 2
    return x * x + y * y + z * z >= (reach + FAR) ** 2


@njit(cache=True)
def swept(
    w: tuple[float, float, float],
    d_i: tuple[float, float, float],
    r_i: float,
    dr_i: float,
    d_j: tuple[float, float, float],
    r_j: float,
    dr_j: float,
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

r"""Smooth clearances as symbols, with stand-ins for min and max (paper, Sec. III-A).

Smooth clearance of two swept balls: airflow envelopes, capsules, a ball (paper, Sec. III-A to III-C).

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of a cone-sphere, eta in [0, 1] | l_arm |
| w_0 = o_i - o_j | | l_arm |
| f(eta, gamma) = ||P_i - P_j||^2 - (r_i + r_j)^2 | squared-length clearance (paper, Eq. f_air) | l_arm^2 |

Smooth clearance of an airflow envelope and a convex polytope.

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of the envelope, eta in [0, 1] | l_arm |
| Q | the polytope | |
| f(eta, y) = \|\|P(eta) - y\|\|^2 - r(eta)^2 | clearance of the ball at eta and a point y of Q | l_arm^2 |
| n_f, b_f | outward unit normal and offset of a face of Q | -, l_arm |

The paper names boxes and other shapes as local envelopes and spells out the ball. Here its way goes on: the least f
is sought among KKT candidates in closed form, each the f of some eta and some y of Q, so that none is less than the
least. The nearest point of Q lies

- on an edge, with eta and the place on the edge stationary, or one of them at an end: the paper's KKT candidates
  for a capsule without radius; what belongs to a corner is counted once;
- inside a face, and then eta is at an end of the axis, because the distance from a plane is linear: each triangle
  gives the foot of either end, pulled into the triangle;
- where the axis pierces a face: each triangle gives the crossing, pulled into the axis and into the triangle.

That leaves an axis that lies in Q altogether, which a row of its own excludes: the module's centre is beyond some
face, max_f n_f . o - b_f >= 0. No clear platform loses anything by it.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from nlp.numbers.geometry import Ball, Swept
from topo_search.model.arrays import Array
from topo_search.model.shape import Hull

EPSILON = 1e-6
"""Regularisation of the clamps and of the stationary points; dimensionless."""


def smooth_max(a: ca.SX | float, b: ca.SX | float) -> ca.SX:
    """Return max(a, b), over by sqrt(epsilon)/2 at most."""
    return 0.5 * (a + b + ca.sqrt((a - b) ** 2 + EPSILON))


def smooth_min(a: ca.SX | float, b: ca.SX | float) -> ca.SX:
    """Return min(a, b), under by sqrt(epsilon)/2 at most."""
    return 0.5 * (a + b - ca.sqrt((a - b) ** 2 + EPSILON))


def smooth_clamp(value: ca.SX) -> ca.SX:
    """Return the value bounded to [0, 1]."""
    return smooth_max(0.0, smooth_min(1.0, value))


def log_sum_exp(values: Sequence[ca.SX], beta: float | ca.SX) -> ca.SX:
    """LSE_beta (paper, Eq. lse_def): at most the least value, at least that minus log(count)/beta.

    The least value is taken out before exp, so that nothing overflows; the result does not change.
    """
    least = values[0]
    for value in values[1:]:
        least = ca.fmin(least, value)
    total = sum(ca.exp(-beta * (value - least)) for value in values)
    return least - ca.log(total) / beta


def clearance(one: Swept, other: Swept, beta: ca.SX) -> ca.SX:
    """Return the smooth clearance, in l_arm near contact.

    The log-sum-exp of f over the KKT candidates is an area; divided by twice the sum of the end radii it is a
    length, above the true clearance c > 0 by c^2 / (2 sum) at most and equal to it at contact.
    """
    f = _against_ball(one, other) if isinstance(other, Ball) else _against_segment(one, other)
    return as_length(f, one.end_radius + other.end_radius, beta)


def as_length(f: Sequence[ca.SX], R: float, beta: ca.SX) -> ca.SX:
    """Return the log-sum-exp of squares over 2 R; sharper where R is small, or it would ask for too much."""
    return log_sum_exp(f, beta * ca.fmax(1.0, 1 / (2 * R))) / (2 * R)


def clearance_of_all(one: Swept, balls: Sequence[Swept], beta: ca.SX) -> ca.SX:
    """Return the smooth clearance of some balls together, in l_arm near contact.

    Every ball's f counts as the length that it is near contact, times twice the sum of the first one's radii.
    """
    scale = one.end_radius + balls[0].end_radius
    scaled = [scale / (one.end_radius + ball.end_radius) * f for ball in balls for f in _against_ball(one, ball)]
    return log_sum_exp(scaled, beta) / (2 * scale)


def _against_ball(one: Swept, ball: Swept) -> list[ca.SX]:
    """Return f at its three KKT candidates: the stationary point and both ends."""
    w_0, r_0 = one.o - ball.o, one.r_0 + ball.end_radius
    A = ca.dot(one.d, one.d) - one.dr**2
    D = 2 * ca.dot(one.d, w_0) - 2 * r_0 * one.dr
    F = ca.dot(w_0, w_0) - r_0**2
    eta = smooth_clamp(-D * A / (2 * A**2 + EPSILON))
    return [A * eta**2 + D * eta + F, F, A + D + F]


def _against_segment(one: Swept, other: Swept) -> list[ca.SX]:
    """Return f at its nine KKT candidates, from the coefficients of the paper's Eq. (f_air)."""
    d_i, d_j = one.d, other.d
    w_0, r_0 = one.o - other.o, one.r_0 + other.r_0
    A = ca.dot(d_i, d_i) - one.dr**2
    B = ca.dot(d_j, d_j) - other.dr**2
    C = -2 * (ca.dot(d_i, d_j) + one.dr * other.dr)
    D = 2 * ca.dot(d_i, w_0) - 2 * r_0 * one.dr
    E = -2 * ca.dot(d_j, w_0) - 2 * r_0 * other.dr
    F = ca.dot(w_0, w_0) - r_0**2
    return quadratic_candidates(A, B, C, D, E, F)


def quadratic_candidates(
    A: ca.SX | float, B: ca.SX | float, C: ca.SX, D: ca.SX, E: ca.SX, F: ca.SX | float
) -> list[ca.SX]:
    """Return f = A eta^2 + B gamma^2 + C eta gamma + D eta + E gamma + F at the KKT candidates of its minimum.

    They are the stationary point, one point on each edge of [0, 1]^2, and the corners.
    """
    f_det = 4 * A * B - C**2
    bounds = (0.0, 1.0)

    def f(eta: ca.SX | float, gamma: ca.SX | float) -> ca.SX:
        return A * eta**2 + B * gamma**2 + C * eta * gamma + D * eta + E * gamma + F

    eta_0 = smooth_clamp((C * E - 2 * B * D) * f_det / (f_det**2 + EPSILON))
    gamma_0 = smooth_clamp((C * D - 2 * A * E) * f_det / (f_det**2 + EPSILON))
    gamma_1 = {eta_1: smooth_clamp(-(C * eta_1 + E) * B / (2 * B**2 + EPSILON)) for eta_1 in bounds}
    eta_2 = {gamma_2: smooth_clamp(-(C * gamma_2 + D) * A / (2 * A**2 + EPSILON)) for gamma_2 in bounds}
    return [
        f(eta_0, gamma_0),
        *(f(eta_1, gamma_1[eta_1]) for eta_1 in bounds),
        *(f(eta_2[gamma_2], gamma_2) for gamma_2 in bounds),
        *(f(eta, gamma) for eta in bounds for gamma in bounds),
    ]


Scalar = ca.SX | float


def hull_clearances(seen: Swept, hull: Hull, beta: ca.SX) -> ca.SX:
    """Return two rows: the smooth clearance, in l_arm near contact, and how far the first centre is outside.

    Args:
        seen: the airflow envelope of a module, or a rod, from the hull's origin.
        hull: Q, lengths in l_arm.
        beta: sharpness of the log-sum-exp.
    """
    f = [_against_ball(seen, Ball(ca.DM(corner), 0.0))[0] for corner in hull.corners]
    for start, end in hull.corners[hull.edges]:  # what belongs to a corner is counted once
        f += _against_segment(seen, Swept(ca.DM(start), ca.DM(end - start), 0.0))[:3]
    for triangle, normal, offset in zip(hull.corners[hull.triangles], hull.normals, hull.offsets, strict=True):
        f += _at_face(seen, triangle, normal, float(offset))
    outside = [ca.dot(ca.DM(normal), seen.o) - offset for *normal, offset in hull.planes.tolist()]
    return ca.vertcat(
        as_length(f, seen.end_radius, beta),
        -log_sum_exp([-height for height in outside], beta),
    )


def _f(one: Swept, eta: Scalar, y: ca.SX | ca.DM) -> ca.SX:
    apart: ca.SX = one.o + eta * one.d - y
    return ca.dot(apart, apart) - (one.r_0 + eta * one.dr) ** 2


def _at_face(one: Swept, triangle: Array, normal: Array, offset: float) -> list[ca.SX]:
    """Return f of a face's triangle at either end of the axis, and where the axis pierces its plane."""
    n = ca.DM(normal)
    height, slope = ca.dot(n, one.o) - offset, ca.dot(n, one.d)
    crossing = smooth_clamp(-height * slope / (slope**2 + EPSILON))
    return [_f(one, eta, _foot(one.o + eta * one.d, triangle)) for eta in (0.0, 1.0, crossing)]


def _foot(x: ca.SX, triangle: Array) -> ca.SX:
    """Return a point of a triangle: the foot of x where that lies inside."""
    a, u, v = triangle[0], triangle[1] - triangle[0], triangle[2] - triangle[0]
    uu, uv, vv = float(u @ u), float(u @ v), float(v @ v)
    area = uu * vv - uv * uv
    along_u, along_v = ca.dot(ca.DM(u), x - ca.DM(a)), ca.dot(ca.DM(v), x - ca.DM(a))
    s = smooth_clamp((vv * along_u - uv * along_v) / area)
    t = smooth_max(0.0, smooth_min(1 - s, (uu * along_v - uv * along_u) / area))
    return ca.DM(a) + s * ca.DM(u) + t * ca.DM(v)

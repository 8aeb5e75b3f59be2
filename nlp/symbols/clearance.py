r"""Symbolic smooth clearances.

Two swept balls: airflow envelopes, capsules, a ball (paper, Sec. III-A to III-C):

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of a cone-sphere, eta in [0, 1] | l_arm |
| w_0 = o_i - o_j | | l_arm |
| f(eta, gamma) = ||P_i - P_j||^2 - (r_i + r_j)^2 | squared-length clearance (paper, Eq. f_air) | l_arm^2 |

An airflow envelope and a convex polytope:

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of the envelope, eta in [0, 1] | l_arm |
| Q | the polytope | |
| f(eta, y) = \|\|P(eta) - y\|\|^2 - r(eta)^2 | clearance of the ball at eta and a point y of Q | l_arm^2 |
| n_f, b_f | outward unit normal and offset of a face of Q | -, l_arm |

The paper mentions boxes and other shapes as local envelopes, and works out the ball. The same method is used here:
the minimum of f is taken over KKT candidates in closed form. Each is the f of some eta and some y of Q, so none is
below the minimum. The nearest point of Q is

- on an edge, with eta and the position on the edge stationary, or one of them at an end: the paper's KKT candidates
  for a capsule of zero radius, with those of a corner counted once;
- or inside a face, with eta at an end of the axis since the distance from a plane is linear: each triangle gives
  the foot of either end, moved into the triangle;
- or where the axis crosses a face: each triangle gives the crossing, moved into the axis and into the triangle.

The remaining case, an axis entirely inside Q, is excluded by another row: the module's centre is beyond some face,
max_f n_f . o - b_f >= 0. It holds for every clear platform.
"""

from collections.abc import Sequence

import casadi as ca

from nlp.numbers.geometry import Ball, Swept
from topo_search.model.arrays import Array
from topo_search.model.shape import Hull

EPSILON = 1e-6
"""Regularisation of the clamps and of the stationary points; dimensionless."""


def smooth_max(a: ca.SX | float, b: ca.SX | float) -> ca.SX:
    """Return max(a, b), too large by at most sqrt(epsilon)/2."""
    return 0.5 * (a + b + ca.sqrt((a - b) ** 2 + EPSILON))


def smooth_min(a: ca.SX | float, b: ca.SX | float) -> ca.SX:
    """Return min(a, b), too small by at most sqrt(epsilon)/2."""
    return 0.5 * (a + b - ca.sqrt((a - b) ** 2 + EPSILON))


def smooth_clamp(value: ca.SX) -> ca.SX:
    """Return the value smoothly clamped to [0, 1]."""
    return smooth_max(0.0, smooth_min(1.0, value))


def log_sum_exp(values: Sequence[ca.SX], beta: float | ca.SX) -> ca.SX:
    """Return LSE_beta (paper, Eq. lse_def), between the minimum minus log(count)/beta and the minimum.

    The minimum is subtracted before exp to avoid overflow, which does not change the result.
    """
    minimum = values[0]
    for value in values[1:]:
        minimum = ca.fmin(minimum, value)
    total = sum(ca.exp(-beta * (value - minimum)) for value in values)
    return minimum - ca.log(total) / beta


def clearance(first: Swept, second: Swept, beta: ca.SX) -> ca.SX:
    """Return the smooth clearance, in l_arm near contact.

    The log-sum-exp of f over the KKT candidates is an area. Divided by twice the sum of the end radii it is a
    length: it exceeds the true clearance c > 0 by at most c^2 / (2 sum), and equals it at contact.
    """
    f = _against_ball(first, second) if isinstance(second, Ball) else _against_segment(first, second)
    return as_length(f, first.end_radius + second.end_radius, beta)


def as_length(f: Sequence[ca.SX], R: float, beta: ca.SX) -> ca.SX:
    """Return the log-sum-exp of areas over 2 R, sharper for small R to limit its error."""
    return log_sum_exp(f, beta * ca.fmax(1.0, 1 / (2 * R))) / (2 * R)


def clearance_of_all(swept: Swept, balls: Sequence[Swept], beta: ca.SX) -> ca.SX:
    """Return the smooth clearance of a swept ball from several balls, in l_arm near contact.

    Each ball's f is scaled from twice its own sum of radii to that of the first ball.
    """
    r = swept.end_radius
    scale = r + balls[0].end_radius
    scaled = [scale / (r + ball.end_radius) * f for ball in balls for f in _against_ball(swept, ball)]
    return log_sum_exp(scaled, beta) / (2 * scale)


def _against_ball(swept: Swept, ball: Swept) -> list[ca.SX]:
    """Return f at its three KKT candidates: the stationary point and both ends."""
    w_0, r_0 = swept.o - ball.o, swept.r_0 + ball.end_radius
    A = ca.dot(swept.d, swept.d) - swept.dr**2
    D = 2 * ca.dot(swept.d, w_0) - 2 * r_0 * swept.dr
    F = ca.dot(w_0, w_0) - r_0**2
    eta = smooth_clamp(-D * A / (2 * A**2 + EPSILON))
    return [A * eta**2 + D * eta + F, F, A + D + F]


def _against_segment(first: Swept, second: Swept) -> list[ca.SX]:
    """Return f at its nine KKT candidates, from the coefficients of the paper's Eq. (f_air)."""
    d_i, d_j = first.d, second.d
    w_0, r_0 = first.o - second.o, first.r_0 + second.r_0
    A = ca.dot(d_i, d_i) - first.dr**2
    B = ca.dot(d_j, d_j) - second.dr**2
    C = -2 * (ca.dot(d_i, d_j) + first.dr * second.dr)
    D = 2 * ca.dot(d_i, w_0) - 2 * r_0 * first.dr
    E = -2 * ca.dot(d_j, w_0) - 2 * r_0 * second.dr
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


def hull_clearances(swept: Swept, hull: Hull, beta: ca.SX) -> ca.SX:
    """Return two rows: the smooth clearance, in l_arm near contact, and the smooth distance of o outside the hull.

    Args:
        swept: the airflow envelope of a module, or a rod, relative to the hull's origin.
        hull: Q, lengths in l_arm.
        beta: sharpness of the log-sum-exp.
    """
    f = [_against_ball(swept, Ball(ca.DM(corner), 0.0))[0] for corner in hull.corners]
    for start, end in hull.corners[hull.edges]:  # candidates of corners are counted once
        f += _against_segment(swept, Swept(ca.DM(start), ca.DM(end - start), 0.0))[:3]
    for triangle, normal, offset in zip(hull.corners[hull.triangles], hull.normals, hull.offsets, strict=True):
        f += _at_face(swept, triangle, normal, float(offset))
    heights = [ca.dot(ca.DM(normal), swept.o) - offset for *normal, offset in hull.planes.tolist()]
    return ca.vertcat(as_length(f, swept.end_radius, beta), -log_sum_exp([-height for height in heights], beta))


def _f(swept: Swept, eta: Scalar, y: ca.SX | ca.DM) -> ca.SX:
    vector: ca.SX = swept.o + eta * swept.d - y
    return ca.dot(vector, vector) - (swept.r_0 + eta * swept.dr) ** 2


def _at_face(swept: Swept, triangle: Array, normal: Array, offset: float) -> list[ca.SX]:
    """Return f of a face's triangle at both ends of the axis, and where the axis crosses its plane."""
    n = ca.DM(normal)
    height, slope = ca.dot(n, swept.o) - offset, ca.dot(n, swept.d)
    crossing = smooth_clamp(-height * slope / (slope**2 + EPSILON))
    return [_f(swept, eta, _foot(swept.o + eta * swept.d, triangle)) for eta in (0.0, 1.0, crossing)]


def _foot(x: ca.SX, triangle: Array) -> ca.SX:
    """Return a point of a triangle, which is the foot of x if that is inside."""
    a, u, v = triangle[0], triangle[1] - triangle[0], triangle[2] - triangle[0]
    uu, uv, vv = float(u @ u), float(u @ v), float(v @ v)
    area = uu * vv - uv * uv
    along_u, along_v = ca.dot(ca.DM(u), x - ca.DM(a)), ca.dot(ca.DM(v), x - ca.DM(a))
    s = smooth_clamp((vv * along_u - uv * along_v) / area)
    t = smooth_max(0.0, smooth_min(1 - s, (uu * along_v - uv * along_u) / area))
    return ca.DM(a) + s * ca.DM(u) + t * ca.DM(v)

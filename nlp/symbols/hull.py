r"""Smooth clearance of an airflow envelope and a convex polytope.

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

import casadi as ca

from nlp.symbols.envelope import ConeSphere, as_length
from nlp.symbols.smooth import EPSILON, log_sum_exp, smooth_clamp, smooth_max, smooth_min
from topo_search.model.arrays import Array
from topo_search.model.shape import Hull

Scalar = ca.SX | float


def hull_clearances(envelope: ConeSphere, origin: ca.SX, hull: Hull, beta: ca.SX) -> ca.SX:
    """Return two rows: the smooth clearance, in l_arm near contact, and how far the first centre is outside.

    Args:
        envelope: the airflow envelope of a module, or a rod.
        origin: where the hull's origin is.
        hull: Q, lengths in l_arm.
        beta: sharpness of the log-sum-exp.
    """
    seen = ConeSphere(envelope.o - origin, envelope.d, envelope.r_0, envelope.dr)
    f = [_at_corner(seen, corner) for corner in hull.corners]
    for start, end in hull.corners[hull.edges]:
        f += _along_edge(seen, start, end)
    for triangle, normal, offset in zip(hull.corners[hull.triangles], hull.normals, hull.offsets, strict=True):
        f += _at_face(seen, triangle, normal, float(offset))
    outside = [ca.dot(ca.DM(normal), seen.o) - offset for *normal, offset in hull.planes.tolist()]
    return ca.vertcat(
        as_length(f, envelope.end_radius, beta),
        -log_sum_exp([-height for height in outside], beta),
    )


def _f(one: ConeSphere, eta: Scalar, y: ca.SX | ca.DM) -> ca.SX:
    apart = one.o + eta * one.d - y
    return ca.dot(apart, apart) - (one.r_0 + eta * one.dr) ** 2


def _at_corner(one: ConeSphere, corner: Array) -> ca.SX:
    """Return f of a corner and the nearest ball, as for a ball at p_E (paper, Sec. III-B)."""
    w_0 = one.o - ca.DM(corner)
    A = ca.dot(one.d, one.d) - one.dr**2
    D = 2 * ca.dot(one.d, w_0) - 2 * one.r_0 * one.dr
    return _f(one, smooth_clamp(-D * A / (2 * A**2 + EPSILON)), ca.DM(corner))


def _along_edge(one: ConeSphere, start: Array, end: Array) -> list[ca.SX]:
    """Return f of an edge where both parameters are stationary, and at either end of the axis."""
    d_j = ca.DM(end - start)
    w_0 = one.o - ca.DM(start)
    A, B = ca.dot(one.d, one.d) - one.dr**2, ca.dot(d_j, d_j)
    C = -2 * ca.dot(one.d, d_j)
    D, E = 2 * ca.dot(one.d, w_0) - 2 * one.r_0 * one.dr, -2 * ca.dot(d_j, w_0)
    f_det = 4 * A * B - C**2
    eta_0 = smooth_clamp((C * E - 2 * B * D) * f_det / (f_det**2 + EPSILON))
    gamma_0 = smooth_clamp((C * D - 2 * A * E) * f_det / (f_det**2 + EPSILON))
    places: list[tuple[Scalar, Scalar]] = [(eta_0, gamma_0)]
    places += [(eta, smooth_clamp(-(C * eta + E) / (2 * B))) for eta in (0.0, 1.0)]
    return [_f(one, eta, ca.DM(start) + gamma * d_j) for eta, gamma in places]


def _at_face(one: ConeSphere, triangle: Array, normal: Array, offset: float) -> list[ca.SX]:
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

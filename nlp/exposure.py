"""Exposure requirements as smooth clearances (paper, Sec. III-B to III-D).

| symbol | meaning | unit |
|---|---|---|
| p'_E, p_E | end-effector in W, and from the COM | l_arm |
| r_sph | radius of the ball or capsule | l_arm |
| d_con, theta | unit axis of the allowed cone, from p_E into it; half-angle | -, rad |
| q, rho | P(eta) - p'_E and its part across the axis | l_arm |

The paper asks two things of the cone: d_con . q >= r and s - r >= 0, s = d_con . q sin(theta) - ||rho|| cos(theta).
The second implies the first for theta up to 90 deg (d_con . q >= r / sin(theta) >= r), so it stands alone here.
It is concave along the axis, so that the two end balls are enough.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import casadi as ca

from nlp.envelope import Ball, ConeSphere, clearance
from nlp.hull import hull_clearances
from nlp.units import Units
from topo_search.model import Directional, Exterior, Local
from topo_search.model.hulls import convex_hull

ROUNDING = 1e-8
"""Added to ||rho||^2 so that its root is smooth on the axis [l_arm^2]; asks for more clearance, never for less."""


def exposure_clearances(
    requirement: Local | Directional | Exterior,
    envelope: ConeSphere,
    *,
    p_E: ca.SX,
    p_EB: ca.SX,
    beta: ca.SX,
    unit: Units,
) -> Iterator[tuple[int | None, ca.SX]]:
    """Yield (segment, clearance) of one envelope against one requirement, in l_arm near contact.

    Args:
        requirement: the exposure requirement.
        envelope: the airflow envelope of a module.
        p_E: p'_E, the end-effector in W.
        p_EB: p_E, the end-effector from the COM.
        beta: sharpness of the log-sum-exp.
        unit: units of the dimensionless problem.
    """
    match requirement:
        case Local(radius=float(radius)):
            yield None, clearance(envelope, Ball(p_E, radius / unit.length), beta)
        case Local():
            yield None, hull_clearances(envelope, p_E, convex_hull(requirement.corners / unit.length), beta)
        case Directional():
            for segment, d_cap in enumerate(_segments(requirement, p_EB, unit)):
                capsule = ConeSphere(p_E, d_cap, requirement.radius / unit.length)
                yield segment, clearance(envelope, capsule, beta)
        case Exterior():
            ends = [_inside_cone(requirement, envelope, eta, p_E=p_E, p_EB=p_EB) for eta in (0.0, 1.0)]
            yield None, ca.vertcat(*ends)


def _inside_cone(requirement: Exterior, envelope: ConeSphere, eta: float, *, p_E: ca.SX, p_EB: ca.SX) -> ca.SX:
    """Return s - r of the ball at eta."""
    d_con, theta = _axis(requirement, p_EB), math.radians(requirement.half_angle_deg)
    q = envelope.o + eta * envelope.d - p_E
    along = ca.dot(d_con, q)
    rho = q - along * d_con
    s = along * math.sin(theta) - ca.sqrt(ca.dot(rho, rho) + ROUNDING) * math.cos(theta)
    return s - (envelope.r_0 + eta * envelope.dr)


def _segments(requirement: Directional, p_EB: ca.SX, unit: Units) -> list[ca.SX]:
    if requirement.segments is not None:
        return [ca.SX(ca.DM(segment)) / unit.length for segment in requirement.segments]
    assert requirement.length is not None
    return [requirement.length / unit.length * p_EB / ca.norm_2(p_EB)]


def _axis(requirement: Exterior, p_EB: ca.SX) -> ca.SX:
    if requirement.axis == "com":
        return -p_EB / ca.norm_2(p_EB)
    return ca.SX(ca.DM(requirement.axis) / ca.norm_2(ca.DM(requirement.axis)))

"""Proven verdicts on a cone-sphere inside an infinite cone (the exterior requirement).

| symbol | meaning |
|---|---|
| s(x), m | signed distance to the cone's surface; inward normal of a supporting half-space m.(x - apex) >= 0 |
| d | exact clearance, the least s - r over both end balls |
| lower | least s over the vertices of a polytope around the body: the cone is convex, so d >= lower |
| upper | s at a point proven in the body |

`clear` when every vertex has s > 0, `violated` when the point has s < 0. FCL is shown what lies beyond the
supporting planes nearest to the end balls, as large boxes: the body's outer mesh must keep off both, or its inner
mesh must reach into the violated one. At 90 degrees the cone is the half-space itself.

A mesh that is fine in one direction is not enough: a ball centred on the cone's axis comes near the cone all the
way round. So the polytope of the vertex test is one of revolution about the cone's axis, with as many sides as it
takes.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from topo_search.model import Status
from verify.bodies import Array, Cone, ConeSphere
from verify.certificate import COMMON_LEVEL, ROUNDING, Certificate, Solid, judge
from verify.clearance import cone_clearance
from verify.fcl_queries import FARTHEST, Shape
from verify.meshes import ROUNDING as MESH_ROUNDING
from verify.meshes import box_below, encloses, inner_mesh, lies_within, outer_mesh

SIDES = (64, 512, 4096, 32768)
"""Sides of the polytope of revolution, level by level: its gap is r (pi / sides)^2 / 2."""
LATITUDES = 9
"""Circles of contact between the poles of the polytope of revolution."""


def certify_inside(solid: Solid, cone: Cone) -> Certificate:
    """Return the certificate that a cone-sphere lies inside an infinite cone."""
    body = solid.body
    d, worst = cone_clearance(body, cone)
    if not (solid.in_range and np.all(np.abs(cone.apex) < FARTHEST / 16)):
        return Certificate(Status.UNDECIDED, None, None, d, 0)
    m = cone.inward_normal(body.centre(worst))
    x = body.centre(worst) - body.radius(worst) * m
    upper = float(cone.s(x))
    proven = body.depth(x) > -ROUNDING and (d > 0 or upper < -ROUNDING)
    proof = (
        functools.partial(_depth_inside, solid, cone)
        if d > 0
        else functools.partial(_reach_outside, body, cone, worst)
    )
    return judge(d, upper if proven else None, np.stack([x, x - upper * m]), proof, levels=len(SIDES))


def _depth_inside(solid: Solid, cone: Cone, level: int) -> float | None:
    """Return the least s over a mesh of a level, if it is positive and FCL sees the body inside too."""
    least = least_s(solid.body, cone, SIDES[level])
    return least if least > ROUNDING and all(keeps_off(solid, cone, eta) for eta in (0.0, 1.0)) else None


def _reach_outside(body: ConeSphere, cone: Cone, worst: float, level: int) -> float | None:
    """Return the least s over a mesh of a level, if FCL sees the body reach beyond the cone at its worst end."""
    return least_s(body, cone, SIDES[level]) if reaches_beyond(body, cone, worst) else None


def least_s(body: ConeSphere, cone: Cone, sides: int) -> float:
    """Return the least s over the vertices of polytopes of revolution around both end balls: around the body."""
    sin, cos = cone.sin_cos
    radial, axial, azimuth = lathe(math.atan2(sin, cos), sides)
    least = math.inf
    for eta in (0.0, 1.0):
        centre = body.centre(eta)
        e_1 = cone.direction_across(centre)
        e_2 = np.cross(cone.axis, e_1)
        unit = np.outer(radial * np.cos(azimuth), e_1) + np.outer(radial * np.sin(azimuth), e_2)
        unit += np.outer(axial, cone.axis)
        least = min(least, float(cone.s(centre + body.radius(eta) * unit).min()))
    return least


def keeps_off(solid: Solid, cone: Cone, eta: float) -> bool:
    """True if FCL sees an outer mesh of the body apart from the half-space beyond the cone nearest to an end ball.

    One that is turned towards the half-space is made only where the common one does not do.
    """
    m, x, beyond = _half_space(solid.body, cone, eta)
    if solid.outer is not None and not solid.outer[1].overlaps(beyond.place(np.eye(3), x)):
        return True
    near = solid.body.move(-x)
    mesh = outer_mesh(near, COMMON_LEVEL, -m)
    return encloses(mesh, near) and not Shape(mesh).overlaps(beyond)


def reaches_beyond(body: ConeSphere, cone: Cone, eta: float) -> bool:
    """True if FCL sees the body's inner mesh reach into the half-space beyond the cone nearest to an end ball."""
    m, x, beyond = _half_space(body, cone, eta)
    near = body.move(-x)
    mesh = inner_mesh(near, COMMON_LEVEL, -m)
    return lies_within(mesh, near) and Shape(mesh).overlaps(beyond)


def _half_space(body: ConeSphere, cone: Cone, eta: float) -> tuple[Array, Array, Shape]:
    """Return the supporting half-space nearest to an end ball: its normal, the ball's point next to it, and a box.

    The box is what lies beyond: on the plane, with that point as origin, and large enough that the body cannot pass
    it by or through: no point of the body is farther from the origin than twice its extent.
    """
    centre = body.centre(eta)
    m = cone.inward_normal(centre)
    x = centre - body.radius(eta) * m
    height = float(m @ (x - cone.apex))
    return m, x, Shape(box_below(-height * m, m, 4 * body.extent + abs(height)))


def lathe(theta: float, sides: int) -> tuple[Array, Array, Array]:
    """Return the vertices of a polytope of revolution around the unit ball, as (radial, axial, azimuth) columns.

    Its profile, a polygon around the half disc, touches the ball at the latitude -theta, where a ball in a cone of
    half-angle theta about the same axis touches that cone; round the axis it is a regular polygon around a circle,
    with a flat side at azimuth 0. So each of its faces is tangent to the ball or beyond it.

    Args:
        theta: half-angle [rad].
        sides: number of flat sides round the axis, at least 3.
    """
    latitudes = np.unique(np.append(np.linspace(-np.pi / 2, np.pi / 2, LATITUDES), -theta))
    middle, half = (latitudes[1:] + latitudes[:-1]) / 2, np.diff(latitudes) / 2
    stretch = (1 + MESH_ROUNDING) / np.cos(half)
    radial = stretch * np.cos(middle) / np.cos(np.pi / sides)
    azimuth = (np.arange(sides) + 0.5) * (2 * np.pi / sides)
    shape = len(middle), sides
    return (
        np.broadcast_to(radial[:, None], shape).ravel(),
        np.broadcast_to((stretch * np.sin(middle))[:, None], shape).ravel(),
        np.broadcast_to(azimuth, shape).ravel(),
    )

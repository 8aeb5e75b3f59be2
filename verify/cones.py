"""Proven verdicts on cone-spheres and rigid parts inside an infinite cone (the exterior requirement).

A cone-sphere:

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

Rigid parts, where all outside of the cone is solid:

| symbol | meaning |
|---|---|
| s(x), m | signed distance to the cone's surface; inward normal of a supporting half-space m.(x - apex) >= 0 |
| d | clearance, the least s over all parts: negative where one reaches beyond |
| lower | least s over the corners of polytopes around all parts: s is concave, so d >= lower |
| upper | s at a point proven in a part |

A concave function is least at corners, and on a cylinder on the circles around its ends: there points side by side
are looked at, then points on both sides of the least. Around those circles the polytopes have as many
sides as it takes; at 90 degrees, where the cone is a half-space, one corner where the support is.

`clear` when every corner has s > 0, `violated` when the point has s < 0. FCL is shown what lies beyond the
supporting plane nearest to a part, as a large box: polytopes around the parts must keep off, or one inside the
part must reach into it.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from topo_search.model import Status
from verify.bodies import Array, Cone, ConeSphere, basis_across, cone_clearance
from verify.certificate import BOUND_ROUNDING, COMMON_LEVEL, Certificate, Solid, facing_mesh, judge
from verify.compounds import Compound
from verify.convex import Convex, Cylinder
from verify.meshes import LARGEST_COORDINATE, MESH_ROUNDING, Shape, box_below


class ConeMeshes(NamedTuple):
    """How finely a body is enclosed that must be inside a cone."""

    sides: tuple[int, int, int, int] = (64, 512, 4096, 32768)
    """Sides of the polytope of revolution, level by level: its gap is r (pi / sides)^2 / 2."""
    latitudes: int = 9
    """Circles of contact between the poles of the polytope of revolution."""
    part_sides: tuple[int, int, int, int] = (64, 1024, 16384, 262144)
    """Sides of the polygons around circles, level by level: their gap is R (pi / sides)^2 / 2."""
    points: int = 720
    """Places on a circle that are looked at side by side."""
    zooms: int = 5
    """Refinements on both sides of the least."""


MESHES = ConeMeshes()


def certify_inside(solid: Solid, cone: Cone) -> Certificate:
    """Return the certificate that a cone-sphere lies inside an infinite cone."""
    body = solid.body
    d, worst = cone_clearance(body, cone)
    if not (solid.in_range and np.all(np.abs(cone.apex) < LARGEST_COORDINATE / 16)):
        return Certificate(Status.UNDECIDED, None, None, d, 0)
    m = cone.inward_normal(body.centre(worst))
    x = body.centre(worst) - body.radius(worst) * m
    upper = float(cone.s(x))
    proven = body.depth(x) > -BOUND_ROUNDING and (d > 0 or upper < -BOUND_ROUNDING)

    def proof(level: int) -> tuple[float, bool]:
        """Return the least s over a mesh, and whether FCL sees the body inside, or its worst end reach beyond."""
        inside = d > 0 and all(keeps_off(solid, cone, eta) for eta in (0.0, 1.0))
        return least_s(body, cone, MESHES.sides[level]), inside if d > 0 else reaches_beyond(body, cone, worst)

    return judge(d, upper if proven else None, np.stack([x, x - upper * m]), proof, levels=len(MESHES.sides))


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
    m, x, beyond = _beyond_ball(solid.body, cone, eta)
    if solid.outer is not None and not solid.outer[1].overlaps(beyond.place(np.eye(3), x)):
        return True
    mesh = facing_mesh(solid.body, x, -m, COMMON_LEVEL, inside=False)
    return mesh is not None and not Shape(mesh).overlaps(beyond)


def reaches_beyond(body: ConeSphere, cone: Cone, eta: float) -> bool:
    """True if FCL sees the body's inner mesh reach into the half-space beyond the cone nearest to an end ball."""
    m, x, beyond = _beyond_ball(body, cone, eta)
    mesh = facing_mesh(body, x, -m, COMMON_LEVEL, inside=True)
    return mesh is not None and Shape(mesh).overlaps(beyond)


def _beyond_ball(body: ConeSphere, cone: Cone, eta: float) -> tuple[Array, Array, Shape]:
    """Return the normal of the half-space nearest to an end ball, the ball's point next to it, and what is beyond.

    No point of the body is farther from that point than twice its extent.
    """
    centre = body.centre(eta)
    m = cone.inward_normal(centre)
    x = centre - body.radius(eta) * m
    return m, x, _far_side(cone, x, m, 4 * body.extent)


def _far_side(cone: Cone, x: Array, m: Array, size: float) -> Shape:
    """Return a box of what lies beyond a supporting half-space with the normal m, with its origin at a point x.

    It is so large that no body of that size at x can pass it by or through.
    """
    height = float(m @ (x - cone.apex))
    return Shape(box_below(-height * m, m, size + abs(height)))


def lathe(theta: float, sides: int) -> tuple[Array, Array, Array]:
    """Return the vertices of a polytope of revolution around the unit ball, as (radial, axial, azimuth) columns.

    Its profile, a polygon around the half disc, touches the ball at the latitude -theta, where a ball in a cone of
    half-angle theta about the same axis touches that cone; round the axis it is a regular polygon around a circle,
    with a flat side at azimuth 0. So each of its faces is tangent to the ball or beyond it.

    Args:
        theta: half-angle [rad].
        sides: number of flat sides round the axis, at least 3.
    """
    latitudes = np.unique(np.append(np.linspace(-np.pi / 2, np.pi / 2, MESHES.latitudes), -theta))
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


def certify_parts_inside(module: Compound, cone: Cone) -> Certificate:
    """Return the certificate that all parts of a module are inside a cone."""
    if not (module.in_range and np.all(np.abs(cone.apex) < LARGEST_COORDINATE / 16)):
        return Certificate(Status.UNDECIDED, None, None, 0.0, 0)
    lowest = [lowest_point(part, cone) for part in module.parts]
    heights = [float(cone.s(x)) for x in lowest]
    k = int(np.argmin(heights))
    d, x = heights[k], lowest[k]
    within = module.parts[k].depth(x) > -BOUND_ROUNDING and (d > 0 or d < -BOUND_ROUNDING)

    def overlaps(part: Convex, x: Array, *, inside: bool) -> bool:
        """True if FCL sees a polytope inside, or around, a part reach beyond the half-space nearest to x."""
        m, near = cone.inward_normal(x), part.place(np.eye(3), -x)
        mesh = near.inner(np.zeros(3)) if inside else near.outer(-m)
        return Shape(mesh).overlaps(_far_side(cone, x, m, 8 * part.radius))

    def proof(level: int) -> tuple[float, bool]:
        """Return the least s over corners, and whether FCL sees all parts inside, or the deepest reach beyond."""
        least = _least_corner(module.parts, cone, MESHES.part_sides[level])
        if d > 0:
            return least, not any(map(functools.partial(overlaps, inside=False), module.parts, lowest))
        return least, overlaps(module.parts[k], x, inside=True)

    closest = np.stack([x, x - d * cone.inward_normal(x)])
    return judge(d, d if within else None, closest, proof, levels=len(MESHES.part_sides))


def lowest_point(part: Convex, cone: Cone) -> Array:
    """Return the point of a part with the least s, shape (3,)."""
    if not isinstance(part, Cylinder):
        return np.asarray(part.vertices[np.argmin(cone.s(part.vertices))])
    if cone.sin_cos[1] == 0.0:
        across = (cone.axis @ part.axis) * part.axis - cone.axis
        length = np.linalg.norm(across)
        rim = part.vertices + (part.disc / length * across if length > BOUND_ROUNDING else 0.0)
        return np.asarray(rim[np.argmin(cone.s(rim))])
    middle, half = np.zeros(2), math.pi
    for _ in range(MESHES.zooms):
        angles = middle[:, None] + half * np.linspace(-1, 1, MESHES.points)
        s = cone.s(_rings(part, angles, part.disc))
        middle = angles[[0, 1], s.argmin(axis=1)]
        half *= 2 / (MESHES.points - 1)
    points = _rings(part, middle[:, None], part.disc)[:, 0]
    return np.asarray(points[np.argmin(cone.s(points))])


def _rings(part: Cylinder, angles: Array, radius: float) -> Array:
    """Return points around both ends of a cylinder's axis, for angles of shape (2, k): shape (2, k, 3)."""
    e_1, e_2 = basis_across(part.axis)
    ring = np.cos(angles)[..., None] * e_1 + np.sin(angles)[..., None] * e_2
    return np.asarray(part.vertices[:, None] + radius * ring)


def _least_corner(parts: tuple[Convex, ...], cone: Cone, sides: int) -> float:
    """Return the least s over corners of polytopes around parts."""
    least = math.inf
    for part in parts:
        if not isinstance(part, Cylinder):
            corners = part.vertices
        elif cone.sin_cos[1] == 0.0:
            corners = lowest_point(part, cone)
        else:
            angles = np.tile((np.arange(sides) + 0.5) * (2 * np.pi / sides), (2, 1))
            corners = _rings(part, angles, (1 + MESH_ROUNDING) * part.disc / math.cos(math.pi / sides))
        least = min(least, float(cone.s(corners).min()))
    return least

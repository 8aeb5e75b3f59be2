"""Proven verdicts on cone-spheres and rigid parts inside an infinite cone (the exterior requirement).

Cone-spheres:

| symbol | meaning |
|---|---|
| s(x), m | signed distance to the cone's surface; inward normal of a supporting half-space m.(x - apex) >= 0 |
| d | exact clearance, min of s - r over both end balls |
| lower | min of s over the vertices of a polytope around the body; the cone is convex, so d >= lower |
| upper | s at a point proven in the body |

`clear` if every vertex has s > 0, `violated` if the point has s < 0. FCL gets large boxes that fill the outside of
the supporting half-spaces nearest to the end balls: the body's outer mesh must be disjoint from both boxes, or its
inner mesh must overlap the violated one. At 90 degrees the cone is itself a half-space.

A mesh that is exact in one direction is not enough: a ball centred on the cone's axis is close to the cone all the
way round. So the vertex test uses a polytope of revolution about the cone's axis, with as many sides as necessary.

Rigid parts, where everything outside the cone is solid:

| symbol | meaning |
|---|---|
| d | clearance, min of s over all parts; negative if one reaches out of the cone |
| lower | min of s over the vertices of polytopes around all parts; s is concave, so d >= lower |
| upper | s at a point proven in a part |

The concave s is smallest at a vertex, or on the rim circles of a cylinder, which are sampled and refined around the
minimum. The polytopes have as many sides around these circles as necessary; at 90 degrees, where the cone is a
half-space, one vertex at the support point is enough.

`clear` if every vertex has s > 0, `violated` if the point has s < 0. FCL gets a large box that fills the outside of
the supporting half-space nearest to a part: polytopes around the parts must be disjoint from it, or one inside the
part must overlap it.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Status
from verify.bodies import AllowedCone, ConeSphere, basis_across, cone_clearance
from verify.certificate import BOUND_ROUNDING, COMMON_LEVEL, Certificate, RoundBody, facing_mesh, judge
from verify.compounds import Compound
from verify.convex import Convex, Cylinder
from verify.meshes import LARGEST_COORDINATE, MESH_ROUNDING, FclPolytope, box_below


class ConeMeshes(NamedTuple):
    """Resolution of the polytopes around bodies in a cone."""

    sides: tuple[int, int, int, int] = (64, 512, 4096, 32768)
    """Sides of the polytope of revolution at each level; it exceeds the ball by r (pi / sides)^2 / 2."""
    latitudes: int = 9
    """Number of tangent latitudes of the polytope of revolution, poles included."""
    part_sides: tuple[int, int, int, int] = (64, 1024, 16384, 262144)
    """Sides of the polygons around rim circles at each level; they exceed the circle by R (pi / sides)^2 / 2."""
    points: int = 720
    """Number of sample points on a circle."""
    zooms: int = 5
    """Number of sampling rounds, each around the previous minimum."""


MESHES = ConeMeshes()


def certify_inside(side: RoundBody, cone: AllowedCone) -> Certificate:
    """Certify that a cone-sphere lies inside an infinite cone."""
    body = side.body
    d, worst = cone_clearance(body, cone)
    if not (side.in_range and np.all(np.abs(cone.apex) < LARGEST_COORDINATE / 16)):
        return Certificate(Status.UNDECIDED, None, None, d, 0)
    m = cone.inward_normal(body.centre(worst))
    x = body.centre(worst) - body.radius(worst) * m
    upper = float(cone.s(x))
    proven = body.depth(x) > -BOUND_ROUNDING and (d > 0 or upper < -BOUND_ROUNDING)

    def proof(level: int) -> tuple[float, bool]:
        """Return the smallest s over a mesh, and whether FCL agrees: body inside, or worst end ball outside."""
        inside = d > 0 and all(keeps_off(side, cone, eta) for eta in (0.0, 1.0))
        return smallest_s(body, cone, MESHES.sides[level]), inside if d > 0 else reaches_beyond(body, cone, worst)

    return judge(d, upper if proven else None, np.stack([x, x - upper * m]), proof, levels=len(MESHES.sides))


def smallest_s(body: ConeSphere, cone: AllowedCone, sides: int) -> float:
    """Return the smallest s over the vertices of polytopes of revolution around both end balls."""
    sin, cos = cone.sin_cos
    radial, axial, azimuth = lathe(math.atan2(sin, cos), sides)
    smallest = math.inf
    for eta in (0.0, 1.0):
        centre = body.centre(eta)
        e_1 = cone.direction_across(centre)
        e_2 = np.cross(cone.axis, e_1)
        unit = np.outer(radial * np.cos(azimuth), e_1) + np.outer(radial * np.sin(azimuth), e_2)
        unit += np.outer(axial, cone.axis)
        smallest = min(smallest, float(cone.s(centre + body.radius(eta) * unit).min()))
    return smallest


def keeps_off(side: RoundBody, cone: AllowedCone, eta: float) -> bool:
    """True if FCL finds an outer mesh disjoint from the outside of the half-space nearest to an end ball.

    A mesh turned towards the half-space is built only if the common mesh overlaps.
    """
    m, x, outside = _outside_at_ball(side.body, cone, eta)
    if side.outer is not None and not side.outer[1].overlaps(outside.place(np.eye(3), x)):
        return True
    mesh = facing_mesh(side.body, x, -m, COMMON_LEVEL, inside=False)
    return mesh is not None and not FclPolytope(mesh).overlaps(outside)


def reaches_beyond(body: ConeSphere, cone: AllowedCone, eta: float) -> bool:
    """True if FCL finds an inner mesh overlapping the outside of the half-space nearest to an end ball."""
    m, x, outside = _outside_at_ball(body, cone, eta)
    mesh = facing_mesh(body, x, -m, COMMON_LEVEL, inside=True)
    return mesh is not None and FclPolytope(mesh).overlaps(outside)


def _outside_at_ball(body: ConeSphere, cone: AllowedCone, eta: float) -> tuple[Array, Array, FclPolytope]:
    """Return the normal of the half-space nearest to an end ball, the ball's point nearest to it, and its outside.

    No point of the body is farther from that point than twice its extent.
    """
    centre = body.centre(eta)
    m = cone.inward_normal(centre)
    x = centre - body.radius(eta) * m
    return m, x, _outside_box(cone, x, m, 4 * body.extent)


def _outside_box(cone: AllowedCone, x: Array, m: Array, size: float) -> FclPolytope:
    """Return a box that fills the outside of the supporting half-space with normal m, with its origin at x.

    It is large enough that no body of the given size at x reaches past it.
    """
    height = float(m @ (x - cone.apex))
    return FclPolytope(box_below(-height * m, m, size + abs(height)))


def lathe(theta: float, sides: int) -> tuple[Array, Array, Array]:
    """Return the vertices of a polytope of revolution around the unit ball, as (radial, axial, azimuth) columns.

    Its profile, a polygon around the half disc, touches the ball at the latitude -theta, where a ball in a coaxial
    cone of half-angle theta touches that cone. Its cross-section is a regular polygon around a circle, with a flat
    side at azimuth 0. So each face is tangent to the ball or outside it.

    Args:
        theta: half-angle [rad].
        sides: number of flat sides around the axis, at least 3.
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


def certify_parts_inside(module: Compound, cone: AllowedCone) -> Certificate:
    """Certify that all parts of a module are inside a cone."""
    if not (module.in_range and np.all(np.abs(cone.apex) < LARGEST_COORDINATE / 16)):
        return Certificate(Status.UNDECIDED, None, None, 0.0, 0)
    lowest = [lowest_point(part, cone) for part in module.parts]
    heights = [float(cone.s(x)) for x in lowest]
    k = int(np.argmin(heights))
    d, x = heights[k], lowest[k]
    proven = module.parts[k].depth(x) > -BOUND_ROUNDING and (d > 0 or d < -BOUND_ROUNDING)

    def overlaps(part: Convex, x: Array, *, inside: bool) -> bool:
        """True if FCL finds a polytope inside, or around, a part overlapping the outside nearest to x."""
        m, shifted = cone.inward_normal(x), part.place(np.eye(3), -x)
        mesh = shifted.inner(np.zeros(3)) if inside else shifted.outer(-m)
        return FclPolytope(mesh).overlaps(_outside_box(cone, x, m, 8 * part.radius))

    def proof(level: int) -> tuple[float, bool]:
        """Return the smallest s over vertices, and whether FCL agrees: all parts inside, or the worst outside."""
        smallest = _smallest_s(module.parts, cone, MESHES.part_sides[level])
        if d > 0:
            return smallest, not any(map(functools.partial(overlaps, inside=False), module.parts, lowest))
        return smallest, overlaps(module.parts[k], x, inside=True)

    closest = np.stack([x, x - d * cone.inward_normal(x)])
    return judge(d, d if proven else None, closest, proof, levels=len(MESHES.part_sides))


def lowest_point(part: Convex, cone: AllowedCone) -> Array:
    """Return the point of a part with the smallest s, shape (3,)."""
    if not isinstance(part, Cylinder):
        return np.asarray(part.vertices[np.argmin(cone.s(part.vertices))])
    if cone.sin_cos[1] == 0.0:
        across = (cone.axis @ part.axis) * part.axis - cone.axis
        length = np.linalg.norm(across)
        support_points = part.vertices + (part.disc / length * across if length > BOUND_ROUNDING else 0.0)
        return np.asarray(support_points[np.argmin(cone.s(support_points))])
    centre_angle, half_width = np.zeros(2), math.pi
    for _ in range(MESHES.zooms):
        angles = centre_angle[:, None] + half_width * np.linspace(-1, 1, MESHES.points)
        s = cone.s(_rim_points(part, angles, part.disc))
        centre_angle = angles[[0, 1], s.argmin(axis=1)]
        half_width *= 2 / (MESHES.points - 1)
    points = _rim_points(part, centre_angle[:, None], part.disc)[:, 0]
    return np.asarray(points[np.argmin(cone.s(points))])


def _rim_points(part: Cylinder, angles: Array, radius: float) -> Array:
    """Return points on circles around both ends of a cylinder's axis, for angles (2, k), shape (2, k, 3)."""
    e_1, e_2 = basis_across(part.axis)
    ring = np.cos(angles)[..., None] * e_1 + np.sin(angles)[..., None] * e_2
    return np.asarray(part.vertices[:, None] + radius * ring)


def _smallest_s(parts: tuple[Convex, ...], cone: AllowedCone, sides: int) -> float:
    """Return the smallest s over the vertices of polytopes around parts."""
    smallest = math.inf
    for part in parts:
        if not isinstance(part, Cylinder):
            vertices = part.vertices
        elif cone.sin_cos[1] == 0.0:
            vertices = lowest_point(part, cone)
        else:
            angles = np.tile((np.arange(sides) + 0.5) * (2 * np.pi / sides), (2, 1))
            vertices = _rim_points(part, angles, (1 + MESH_ROUNDING) * part.disc / math.cos(math.pi / sides))
        smallest = min(smallest, float(cone.s(vertices).min()))
    return smallest

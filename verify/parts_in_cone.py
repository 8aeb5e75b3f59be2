"""Proven verdicts on rigid parts inside an infinite cone, outside of which all is solid.

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

import numpy as np

from topo_search.model import Status
from verify.bodies import Array, Cone, basis_across
from verify.certificate import ROUNDING, Certificate, judge
from verify.compounds import Compound
from verify.convex import Convex, Cylinder
from verify.fcl_queries import FARTHEST, Shape
from verify.meshes import ROUNDING as MESH_ROUNDING
from verify.meshes import box_below

SIDES = (64, 1024, 16384, 262144)
"""Sides of the polygons around circles, level by level: their gap is R (pi / sides)^2 / 2."""
POINTS = 720
"""Places on a circle that are looked at side by side."""
ZOOMS = 5
"""Refinements on both sides of the least."""


def certify_parts_inside(module: Compound, cone: Cone) -> Certificate:
    """Return the certificate that all parts of a module are inside a cone."""
    if not (module.in_range and np.all(np.abs(cone.apex) < FARTHEST / 16)):
        return Certificate(Status.UNDECIDED, None, None, 0.0, 0)
    lowest = [lowest_point(part, cone) for part in module.parts]
    heights = [float(cone.s(x)) for x in lowest]
    k = int(np.argmin(heights))
    d, x = heights[k], lowest[k]
    within = module.parts[k].depth(x) > -ROUNDING and (d > 0 or d < -ROUNDING)
    inwards, beyond = (
        functools.partial(_depth_inside, module, cone, lowest),
        functools.partial(_reach_outside, module, cone, x, k),
    )
    closest = np.stack([x, x - d * cone.inward_normal(x)])
    return judge(d, d if within else None, closest, inwards if d > 0 else beyond, levels=len(SIDES))


def cone_evidence(module: Compound, cone: Cone) -> tuple[str, ...]:
    """Return what to look at when points, corners and FCL disagree; one finding a line [l_arm]."""
    found = [(part, lowest_point(part, cone)) for part in module.parts]
    part, x = min(found, key=lambda each: float(cone.s(each[1])))
    return (
        f"{part.name}: {part!r}",
        f"cone: {cone!r}",
        f"lowest point {x.tolist()}, s {float(cone.s(x))!r}, depth in the part {part.depth(x)!r}",
        *(f"least s of corners, {sides} sides: {_least_corner([part], cone, sides)!r}" for sides in SIDES),
        f"FCL, polytope around it: {'apart' if _keeps_off(part, cone, x) else 'overlaps'} beyond the cone",
        f"FCL, polytope inside it: {'overlaps' if _reaches_beyond(part, cone, x) else 'apart'} beyond the cone",
    )


def lowest_point(part: Convex, cone: Cone) -> Array:
    """Return the point of a part with the least s, shape (3,)."""
    if not isinstance(part, Cylinder):
        return np.asarray(part.vertices[np.argmin(cone.s(part.vertices))])
    if cone.sin_cos[1] == 0.0:
        across = (cone.axis @ part.axis) * part.axis - cone.axis
        length = np.linalg.norm(across)
        rim = part.vertices + (part.disc / length * across if length > ROUNDING else 0.0)
        return np.asarray(rim[np.argmin(cone.s(rim))])
    middle, half = np.zeros(2), math.pi
    for _ in range(ZOOMS):
        angles = middle[:, None] + half * np.linspace(-1, 1, POINTS)
        s = cone.s(_rings(part, angles, part.disc))
        middle = angles[[0, 1], s.argmin(axis=1)]
        half *= 2 / (POINTS - 1)
    ends = _rings(part, middle[:, None], part.disc)[:, 0]
    return np.asarray(ends[np.argmin(cone.s(ends))])


def _rings(part: Cylinder, angles: Array, radius: float) -> Array:
    """Return points around both ends of a cylinder's axis, for angles of shape (2, k): shape (2, k, 3)."""
    e_1, e_2 = basis_across(part.axis)
    ring = np.cos(angles)[..., None] * e_1 + np.sin(angles)[..., None] * e_2
    return np.asarray(part.vertices[:, None] + radius * ring)


def _least_corner(parts: list[Convex], cone: Cone, sides: int) -> float:
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


def _depth_inside(module: Compound, cone: Cone, lowest: list[Array], level: int) -> float | None:
    """Return the least s over the corners of a level, if it is positive and FCL sees all parts inside too."""
    least = _least_corner(list(module.parts), cone, SIDES[level])
    apart = (_keeps_off(part, cone, x) for part, x in zip(module.parts, lowest, strict=True))
    return least if least > ROUNDING and all(apart) else None


def _reach_outside(module: Compound, cone: Cone, x: Array, k: int, level: int) -> float | None:
    """Return the least s over the corners of a level, if FCL sees the deepest part reach beyond the cone."""
    return (
        _least_corner(list(module.parts), cone, SIDES[level]) if _reaches_beyond(module.parts[k], cone, x) else None
    )


def _keeps_off(part: Convex, cone: Cone, x: Array) -> bool:
    m, beyond = _half_space_beyond(part, cone, x)
    return not Shape(part.place(np.eye(3), -x).outer(-m)).overlaps(beyond)


def _reaches_beyond(part: Convex, cone: Cone, x: Array) -> bool:
    _, beyond = _half_space_beyond(part, cone, x)
    return Shape(part.place(np.eye(3), -x).inner(np.zeros(3))).overlaps(beyond)


def _half_space_beyond(part: Convex, cone: Cone, x: Array) -> tuple[Array, Shape]:
    """Return the normal of the supporting half-space nearest to a point of a part, and a box of what lies beyond.

    The box has the point as origin, and is so large that the part cannot pass it by or through.
    """
    m = cone.inward_normal(x)
    height = float(m @ (x - cone.apex))
    return m, Shape(box_below(-height * m, m, 8 * part.radius + abs(height)))

"""Proven verdicts on pairs of rigid bodies.

| symbol | meaning |
|---|---|
| A_i, B_j | convex parts of two bodies |
| d | clearance: the distance of the nearest two parts, or minus how far the two deepest are in each other |
| n_ij | unit vector from A to B across which the parts are apart |
| lower | the least gap of any two parts across their n_ij, so d >= lower |
| upper | distance of a point proven in A to one proven in B, or minus the depth of one proven in both: d <= upper |

`clear` when NumPy finds a plane between any two parts that must not touch and FCL finds boxes around the bodies, or
else polytopes around all the parts, apart; `violated` when NumPy finds the point and FCL finds polytopes inside the
two parts overlapping. As with cone-spheres, neither the search for n nor FCL can make a verdict by itself.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from topo_search.model import Status
from verify.bodies import Array
from verify.certificate import ROUNDING, Certificate, judge
from verify.compounds import Compound, Proximity, proximities
from verify.convex import Convex, Polyhedron
from verify.fcl_queries import Shape

LEVELS = 2
"""0: boxes around whole bodies; 1: every part, with meshes turned towards its witness."""
LEAST_UNIT = 1e-9
"""Least unit of length in which a deeper common point is looked for [l_arm]."""


def certify_compounds(pairs: Sequence[tuple[Compound, Compound]], bolted: Sequence[bool]) -> list[Certificate]:
    """Return the certificates of pairs of rigid bodies.

    Args:
        pairs: the bodies, in l_arm.
        bolted: whether the frames of a pair may touch where they are bolted together.
    """
    near = [A.in_range and B.in_range for A, B in pairs]
    asked = [k for k, in_range in enumerate(near) if in_range]
    found = iter(
        proximities([pairs[k] for k in asked], [bolted[k] for k in asked]),
    )
    lost = Certificate(Status.UNDECIDED, None, None, 0.0, 0)
    return [_certify(*pair, next(found)) if in_range else lost for pair, in_range in zip(pairs, near, strict=True)]


def compound_evidence(A: Compound, B: Compound, bolted: bool) -> tuple[str, ...]:
    """Return what to look at when search, planes and FCL disagree about two bodies; one finding a line [l_arm]."""
    (at,) = proximities([(A, B)], [bolted])
    part_A, part_B, x = A.parts[at.a], B.parts[at.b], (at.x_A + at.x_B) / 2
    meshes = ("outer", part_A.outer(at.n), part_B.outer(-at.n)), ("inner", part_A.inner(x), part_B.inner(x))
    return (
        f"A, {part_A.name}: {part_A!r}",
        f"B, {part_B.name}: {part_B!r}",
        f"search: clearance {at.d!r}, normal from A to B {at.n.tolist()}",
        f"nearest points, or the common one: {at.x_A.tolist()} and {at.x_B.tolist()}",
        f"depth of the places in their parts {part_A.depth(at.x_A)!r} and {part_B.depth(at.x_B)!r}",
        f"least gap across a plane between any two parts {at.lower!r}",
        *(
            f"{name} meshes of the two parts, FCL: {'overlap' if Shape(a).overlaps(Shape(b)) else 'apart'}"
            for name, a, b in meshes
        ),
    )


def _certify(A: Compound, B: Compound, found: Proximity) -> Certificate:
    part_A, part_B = A.parts[found.a], B.parts[found.b]
    if found.d > 0:
        upper, closest = math.dist(found.x_A, found.x_B), np.stack([found.x_A, found.x_B])
        proven = min(part_A.depth(found.x_A), part_B.depth(found.x_B)) > -ROUNDING
        proof = functools.partial(_least_gap, A, B, found)
    else:
        x = _common_point(part_A, part_B, (found.x_A + found.x_B) / 2)
        depths = part_A.depth(x), part_B.depth(x)
        upper, closest = -sum(depths), np.stack([x, x])
        proven = min(depths) > ROUNDING
        proof = functools.partial(_overlap, A, B, found, x)
    return judge(found.d, upper if proven else None, closest, proof, LEVELS)


def _least_gap(A: Compound, B: Compound, found: Proximity, level: int) -> float | None:
    """Return the least gap across the planes between parts, if FCL sees the bodies apart too."""
    if found.lower <= ROUNDING:
        return None
    if level == 0:
        apart = bool(found.relevant.all()) and not A.bounds.shape.overlaps(B.bounds.shape)
    else:
        apart = all(
            _keep_off(A.parts[i], B.parts[j], found.normals[i, j], _point_between(A, B, found, i, j))
            for i, j in np.argwhere(found.relevant).tolist()
        )
    return found.lower if apart else None


def _point_between(A: Compound, B: Compound, found: Proximity, i: int, j: int) -> Array:
    """Return a point between two parts: of the nearest two it is where they are nearest."""
    if (i, j) == (found.a, found.b):
        return (found.x_A + found.x_B) / 2
    return (A.parts[i].centre + B.parts[j].centre) / 2


def _keep_off(part_A: Convex, part_B: Convex, n: Array, x: Array) -> bool:
    """True if FCL sees two parts apart; meshes turned towards n are made only where common ones do not do.

    Those have their origin at x, between the parts: FCL needs the digits there, above all for sides that face each
    other.
    """
    if not part_A.shape.overlaps(part_B.shape):
        return True
    near_A, near_B = (part.place(np.eye(3), -x) for part in (part_A, part_B))
    return not Shape(near_A.outer(n)).overlaps(Shape(near_B.outer(-n)))


def _overlap(A: Compound, B: Compound, found: Proximity, x: Array, level: int) -> float | None:
    """Return the (negative) gap of the deepest parts, if FCL sees meshes inside them overlap around x."""
    near = [part.place(np.eye(3), -x) for part in (A.parts[found.a], B.parts[found.b])]
    inner_A, inner_B = (part.inner(np.zeros(3)) for part in near)
    return found.d if level > 0 and Shape(inner_A).overlaps(Shape(inner_B)) else None


def _common_point(part_A: Convex, part_B: Convex, x: Array) -> Array:
    """Return x, or a point deeper in two parts where x is on the surface of one.

    Of the polytopes inside them, turned towards x, it is the centre of the largest ball in both: a linear program.
    """
    if min(part_A.depth(x), part_B.depth(x)) > ROUNDING:
        return x
    planes = [_planes(part.place(np.eye(3), -x)) for part in (part_A, part_B)]
    normals, offsets = (np.concatenate(columns) for columns in zip(*planes, strict=True))
    unit = max(float(np.abs(offsets).min()), LEAST_UNIT)
    rows = np.column_stack([normals, np.ones(len(normals))])
    from scipy.optimize import linprog  # slow to load, and few audits need it

    found = linprog([0, 0, 0, -1], A_ub=rows, b_ub=offsets / unit, bounds=[(None, None)] * 4)
    return x + unit * found.x[:3] if found.success else x


def _planes(part: Convex) -> tuple[Array, Array]:
    """Return outward unit normals and offsets of the faces of the polytope inside a part near the origin."""
    inner = part.inner(np.zeros(3))
    return Polyhedron(part.name, inner.vertices, inner.triangles).faces

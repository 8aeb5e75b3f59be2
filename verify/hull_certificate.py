"""Proven verdicts on a cone-sphere and a convex target region.

| symbol | meaning |
|---|---|
| K, Q | the cone-sphere and the region, lengths in l_arm |
| d | exact signed clearance, from the closed form of `verify.hulls` |
| n | unit vector from K to Q where they are nearest |
| lower | gap of a plane across n: least n.x over Q's corners, minus the most over K's outer mesh |
| upper | distance of a point proven in K to one proven in Q, or minus the depth in K of a point x proven in Q |

As for cone-spheres, `clear` needs the plane in NumPy, and FCL must find Q and the outer mesh apart; `violated`
needs the point, and FCL must find Q and K's inner mesh overlapping. Q is a polytope itself, so that nothing is lost
there.
"""

from __future__ import annotations

import functools

import numpy as np

from topo_search.model import Status
from verify.bodies import ConeSphere
from verify.certificate import ROUNDING, TURNED_LEVELS, Certificate, Solid, Witness, judge
from verify.fcl_queries import FARTHEST, Shape
from verify.hulls import Hull, approach
from verify.meshes import encloses, inner_mesh, lies_within, outer_mesh


def certify_outside(solid: Solid, region: Hull) -> Certificate:
    """Return the certificate that a cone-sphere keeps out of a region."""
    at = witness(solid.body, region)
    if not (solid.in_range and np.all(np.abs(region.mesh.vertices) < FARTHEST / 16)):
        return Certificate(Status.UNDECIDED, None, None, at.d, 0)
    prove = _separating_gap if at.d > 0 else _common_point
    proof = functools.partial(prove, solid.body, region, at)
    return judge(at.d, at.upper, at.closest, proof, levels=len(TURNED_LEVELS))


def witness(body: ConeSphere, region: Hull) -> Witness:
    """Return where a cone-sphere and a region are nearest, or a point in both."""
    found = approach(body, region)
    P, r = body.centre(found.eta), body.radius(found.eta)
    x = P if region.depth(P) > ROUNDING else region.nearest_of_surface(P)
    apart, into = float(np.linalg.norm(x - P)), region.centre - P
    deep = float(np.linalg.norm(into))
    inwards = into / deep if deep > 0 else np.array([0.0, 0.0, 1.0])
    n = (x - P) / apart if apart > 0 else inwards
    if found.d > 0:
        x_K = P + r * n
        reached = body.depth(x_K) > -ROUNDING
        upper = float(np.linalg.norm(x - x_K)) if reached else None
        return Witness(found.d, n, (x_K + x) / 2, upper, np.stack([x_K, x]))
    depth = float(body.depth(x))
    return Witness(found.d, n, x, -depth if depth > ROUNDING else None, np.stack([x, x]))


def outer_gap(body: ConeSphere, region: Hull, at: Witness, level: int) -> tuple[float, bool] | None:
    """Return the gap of a plane across n between K's outer mesh and Q, and whether FCL sees them overlap.

    None if the mesh fails its own check.
    """
    body, Q = body.move(-at.x), region.move(-at.x).mesh  # the digits are needed around x
    mesh = outer_mesh(body, TURNED_LEVELS[level], at.n)
    if not encloses(mesh, body):
        return None
    return float((Q.vertices @ at.n).min() - (mesh.vertices @ at.n).max()), Shape(mesh).overlaps(Shape(Q))


def inner_overlap(body: ConeSphere, region: Hull, at: Witness, level: int) -> bool | None:
    """Return whether FCL sees K's inner mesh and Q overlap; None if the mesh fails its own check."""
    body, Q = body.move(-at.x), region.move(-at.x).mesh
    mesh = inner_mesh(body, TURNED_LEVELS[level], at.n)
    return Shape(mesh).overlaps(Shape(Q)) if lies_within(mesh, body) else None


def _separating_gap(body: ConeSphere, region: Hull, at: Witness, level: int) -> float | None:
    """Return the gap across a plane, if it is one and FCL sees the two apart too."""
    found = outer_gap(body, region, at, level)
    return found[0] if found is not None and found[0] > ROUNDING and not found[1] else None


def _common_point(body: ConeSphere, region: Hull, at: Witness, level: int) -> float | None:
    """Return the supports' (negative) gap along n, if FCL sees an overlap too."""
    if not inner_overlap(body, region, at, level):
        return None
    return float((region.mesh.vertices @ at.n).min() - body.support(at.n))

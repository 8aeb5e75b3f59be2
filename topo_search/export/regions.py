"""The one geometry of exposure requirements that pictures, pages and files for other programs draw.

Shapes have their directions, which some leave to the design, and are in metres from the end-effector.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from trimesh import Trimesh

from topo_search.export import outlines
from topo_search.export.meshes import cone_sphere
from topo_search.export.poses import Poses
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.shape import Capsule, Cone, Hull, Polytope, Shape, convex_hull


def shapes(task: ResolvedTask, p_E: Array) -> Iterator[tuple[int, Shape]]:
    """Yield every shape of every requirement with its number, for an end-effector p_E from the centre of mass."""
    for number, requirement in enumerate(task.exposure):
        for shape in requirement.shapes:
            yield number, shape.at(p_E)


def hull(shape: Polytope) -> Hull:
    """Return the hull of a polytope's corners."""
    return convex_hull(np.array(shape.corners))


def cone(shape: Cone, slant: float) -> Array:
    """Return the triangles of a cone's surface out to a slant height, (sides, 3, 3); a disc for a half-space."""
    assert shape.axis is not None  # as `Shape.at` leaves it
    theta = math.radians(shape.half_angle_deg)
    return outlines.cone(np.array(shape.apex), np.array(shape.axis), theta, slant)


def mesh(shape: Shape, slant: float) -> Trimesh:
    """Return the surface of a shape; of a cone out to a slant height."""
    match shape:
        case Capsule():
            return cone_sphere(np.array(shape.start), shape.radius, np.array(shape.end), shape.radius)
        case Polytope():
            found = hull(shape)
            return Trimesh(found.corners, found.triangles)
        case Cone():
            triangles = cone(shape, slant)
            return Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def cone_slant(design: Design, at: Poses) -> float:
    """Return how far an infinite cone is drawn, so that it holds most of the airflow [m]."""
    return float(np.linalg.norm(at.p - at.end_effector, axis=1).max()) + 2 * design.task.module.reach / 3

"""Exposure requirements in space: the directions and sizes that they leave to the design."""

from __future__ import annotations

import numpy as np

from topo_search.export.poses import Poses
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.exposure import Directional, Exterior, Local
from topo_search.model.hulls import Hull, convex_hull


def paths(requirement: Directional, at: Poses) -> list[Array]:
    """Return the end of every path from the end-effector, (3,) each [m]."""
    if requirement.segments is not None:
        return [np.array(segment) for segment in requirement.segments]
    assert requirement.length is not None  # given with `along`
    return [requirement.length * _unit(at.p_E)]


def polytope(requirement: Local | Directional) -> Hull:
    """Return the hull of a region without a radius, a box or another convex shape, from the end-effector [m]."""
    assert isinstance(requirement, Local)
    return convex_hull(requirement.corners)


def cone_axis(requirement: Exterior, at: Poses) -> Array:
    """Return the unit vector from the apex into the cone, (3,)."""
    return _unit(-at.p_E if requirement.axis == "com" else np.array(requirement.axis))


def cone_slant(design: Design, at: Poses) -> float:
    """Return how far an infinite cone is drawn, so that it holds most of the airflow [m]."""
    return float(np.linalg.norm(at.p - at.end_effector, axis=1).max()) + 2 * design.task.module.reach / 3


def _unit(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    return vector / length if length else np.array([0.0, 0.0, 1.0])

"""Where pictures of a design are looked at from."""

from __future__ import annotations

import math

import numpy as np

from topo_search.export.poses import Poses, poses
from topo_search.model import BadInput, Design, Fault
from topo_search.model.arrays import Array

ELEVATION_DEG = 20.0
AZIMUTHS_DEG = (-60, -30, 30, 60)
"""Of the viewer; none is close to an axis, whose labels would then run into each other."""


FARTHEST = 1000.0
"""Largest distance of the end-effector that can be drawn, in sizes of the platform with its airflow."""


def poses_to_draw(design: Design) -> Poses:
    """Return the poses of a design; BadInput if the end-effector is so far away that nothing else could be seen."""
    module = design.task.module
    limit = FARTHEST * (2 * module.connector_distance * design.topology.n + module.reach)
    if max(map(abs, design.end_effector_m)) > limit:
        rule = f"must be within {limit:.3g} m of the root module to be drawn, but got {list(design.end_effector_m)}"
        raise BadInput(design.task.name, [Fault("end_effector_m", rule)])
    return poses(design)


def azimuth_deg(at: Poses) -> float:
    """Return the azimuth [deg] that looks across the line from the centre of mass to p_E, and along no axis."""
    x, y, _ = at.p_E
    return max(AZIMUTHS_DEG, key=lambda azimuth: abs(_part_across(x, y, math.radians(azimuth))))


def towards_viewer(azimuth_deg: float) -> Array:
    """Return the unit vector towards the viewer, (3,)."""
    elevation, azimuth = math.radians(ELEVATION_DEG), math.radians(azimuth_deg)
    across = math.cos(elevation)
    return np.array([across * math.cos(azimuth), across * math.sin(azimuth), math.sin(elevation)])


def _part_across(x: float, y: float, azimuth: float) -> float:
    """Return the part of a horizontal vector that a viewer at an azimuth sees across the picture."""
    return y * math.cos(azimuth) - x * math.sin(azimuth)

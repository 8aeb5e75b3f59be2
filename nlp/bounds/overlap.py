"""Airflow envelopes that overlap whatever the hinge angles are."""

from __future__ import annotations

import math

import numpy as np

from nlp import names
from nlp.bounds.shortfall import Shortfall
from nlp.geometry import Swept, clearance
from topo_search.model import ResolvedTask

CELLS = 1000
"""Intervals of the hinge angle, over its half turn."""
ROUNDING = 1e-12
"""Length by which a radius may be wrong [m]."""


def bolted_overlap(task: ResolvedTask) -> Shortfall | None:
    """Two bolted modules, at every angle of their hinge: the same for all ports, and for both signs of the angle.

    In a cell of the angles no point of the child's axis moves farther from where it is at the middle than half
    the cell times the axis' farthest distance from the hinge. Envelopes whose radii are less by that together, and
    that overlap still, overlap in the whole cell.
    """
    air, l_c = task.module.envelope, task.module.connector_distance
    if task.n == 1 or task.search.interference != "airflow":
        return None
    half = math.pi / (2 * CELLS)
    alpha = -math.pi / 2 + half * (2 * np.arange(CELLS) + 1)
    c, s = np.cos(alpha), np.sin(alpha)
    zero = np.zeros(CELLS)
    moved = half * math.hypot(l_c, air.length) + ROUNDING
    axis = np.stack([-s, zero, -c], axis=-1) * air.length
    centre = l_c * np.stack([1 + c, zero, -s], axis=-1)
    start_radius = air.start_radius - moved / 2
    parent = Swept(np.zeros(3), np.array([0.0, 0.0, -air.length]), start_radius, air.growth)
    gaps = clearance(parent, Swept(centre, axis, start_radius, air.growth))
    if start_radius < 0 or np.any(gaps >= 0):
        return None
    overlap = -float(np.max(gaps))
    return Shortfall(
        names.airflow(0, 1),
        overlap,
        "m",
        f"the airflow envelopes of two bolted modules overlap at every hinge angle, by {overlap:.4g} m at least: "
        f"module.connector_distance = {l_c:g} m is too short for module.airflow.start_radius = "
        f"{air.start_radius:g} m, reach = {task.module.reach:g} m and spread_angle_deg = "
        f"{task.module.airflow.spread_angle_deg:g}",
    )

"""Rotors that reach beyond their module's connectors: bolted together, two modules' rotors overlap."""

from __future__ import annotations

import math

from nlp.bounds.shortfall import Shortfall
from topo_search.model import ResolvedTask


def rotors_overlap(task: ResolvedTask) -> Shortfall | None:
    """Each of two bolted modules has a rotor that reaches across their hinge's axis, at one place, at any angle."""
    module = task.module
    reach, l_c = module.arm_length / math.sqrt(2) + module.body.rotor_radius, module.connector_distance
    if task.n == 1 or task.body_clearance is None or reach <= l_c:
        return None
    return Shortfall(
        "rotors of bolted modules",
        reach - l_c,
        "m",
        f"rotors of two modules that are bolted together overlap at any hinge angle: they reach {reach:.4g} m "
        f"towards a connector, beyond module.connector_distance = {l_c:g} m",
    )

"""Rotors across the hinge's axis: bolted together, two modules' rotors overlap."""

from __future__ import annotations

import math

from nlp.bounds.refutation import Refutation
from topo_search.model import ResolvedTask
from topo_search.model.proven import excess_texts

ROUNDING = 1e-9
"""Share of a rotor's reach by which it must be across the axis."""


def rotors_overlap(task: ResolvedTask) -> Refutation | None:
    """Each of two bolted modules has a rotor across their hinge's axis, at one place, at any angle.

    The axis passes l_c from the centres of both, their rotors from l_arm / sqrt 2 - r to l_arm / sqrt 2 + r. Only a
    rotor that ends before the axis, or begins beyond it, can be clear of the other one there.
    """
    module = task.module
    middle, r, l_c = module.arm_length / math.sqrt(2), module.body.rotor_radius, module.connector_distance
    across = r - abs(middle - l_c)
    if task.n == 1 or task.body_clearance is None or across <= ROUNDING * (middle + r):
        return None
    inner, outer = excess_texts(l_c, middle - r)[1], excess_texts(middle + r, l_c)[0]
    return Refutation(
        "rotors of bolted modules",
        across,
        "m",
        "rotors of two modules that are bolted together overlap at any hinge angle: they reach from "
        f"{inner} to {outer} m towards a connector, across the hinge at module.connector_distance = {l_c:.15g} m",
    )

"""A drawn platform with types of module, for the tests of exports and pages."""

from typing import Any

import numpy as np
from export_cases import random_design, with_rod

from topo_search.model import Design, Topology

ROUND = [
    {"position": [0.09, 0.0, 0.0], "spin": 1, "radius": 0.04, "axis": [0.1, 0.0, 1.0]},
    {"position": [-0.05, 0.08, 0.0], "spin": -1, "max_thrust": 2.0, "axis": [-0.05, 0.05 * 3**0.5, 1.0]},
    {"position": [-0.05, -0.08, 0.0], "spin": 1, "axis": [-0.05, -0.05 * 3**0.5, 1.0]},
]
"""Rotors of a tricopter, tilted outwards."""
TYPES: list[dict[str, Any]] = [
    {"name": "quad", "count": 2, "mass": 0.2},
    {"name": "tri & tilt", "count": 1, "mass": 0.15, "rotors": ROUND, "thrust_coefficient": 5e-7},
    {
        "name": "battery",
        "count": 1,
        "mass": 0.3,
        "rotors": [],
        "connector_distance": 0.11,
        "body": {"hub": [0.12, 0.06, 0.05]},
    },
]
TREE = Topology.from_key("a3010-acba")
ROTORS = [4, 0, 3, 4]


def typed(topology: Topology = TREE, types: list[dict[str, Any]] = TYPES, **module: Any) -> Design:
    """A drawn design with types of module and a rod, whose inputs are within limits, those of absent rotors 0."""
    made = random_design(topology, 7, {"modules": topology.n, "module_types": types, "module": module})
    limits = made.task.input_limits
    u = np.clip(made.inputs, 0.05 * limits, 0.95 * limits)
    inputs = tuple(tuple(row.ravel().tolist()) for row in u)
    return with_rod(made.model_copy(update={"rotor_speeds_squared": inputs}))


DESIGN = typed(joint_mass=0.05, min_input=0.04)

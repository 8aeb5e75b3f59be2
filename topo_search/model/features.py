"""Features of the model: what they add to tasks, designs and audits.

The core imports this list and, but for those that its contract in pyproject.toml lets through, no feature.
"""

from topo_search.model.air import AirSpeeds, FastAir
from topo_search.model.assembly import Assembly, ShorterRod
from topo_search.model.flight import CasePower, Flight
from topo_search.model.flying import Missed, fallback, find_missed, with_defaults, with_older_defaults
from topo_search.model.goals import GOALS, Goals, Level, broken_goals
from topo_search.model.html import audit_html, design_html, task_html
from topo_search.model.joint_mass import joint_mass
from topo_search.model.largest_value import objective_of
from topo_search.model.lattice import broken_lattice
from topo_search.model.maximized import broken_maximize
from topo_search.model.mesh_file import MeshExcess
from topo_search.model.module_types import ModuleType, broken_types, with_sources
from topo_search.model.placement import Placement
from topo_search.model.relaxed import Relaxed
from topo_search.model.reserves import AskedFlight, broken_flight, failure_corners, reserve_corners
from topo_search.model.room import broken_hinges
from topo_search.model.rotor_rules import broken_rotors
from topo_search.model.sensitivity import WITHIN_TOLERANCES, Sensitivity, Tolerances
from topo_search.model.stated import Stated, StatedCheck, Versioned

TASK_RULES = (
    broken_types,
    broken_lattice,
    broken_hinges,
    broken_rotors,
    broken_flight,
    broken_goals,
    broken_maximize,
)
"""Rules that a task as a whole may break, in the order of their messages."""
CORNER_SETS = (reserve_corners, failure_corners)
"""Sets of wrenches required besides the load cases, in the order of their corners."""

__all__ = [
    "CORNER_SETS", "GOALS", "TASK_RULES", "WITHIN_TOLERANCES", "AirSpeeds", "AskedFlight", "Assembly",
    "CasePower", "FastAir", "Flight", "Goals", "Level", "MeshExcess", "Missed", "ModuleType", "Placement",
    "Relaxed", "Sensitivity", "ShorterRod", "Stated", "StatedCheck", "Tolerances", "Versioned",
    "audit_html", "design_html", "fallback", "find_missed", "joint_mass", "objective_of", "task_html",
    "with_defaults", "with_older_defaults", "with_sources",
]  # fmt: skip

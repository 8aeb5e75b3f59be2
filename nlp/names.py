"""The constraints' names: the same in the problem, in its independent evaluation and in failure reports.

The audit, which shares no code with the solver, uses the same words; a test holds the two to that.
"""

from __future__ import annotations

from topo_search.model import AnyExposure
from topo_search.model.exposure import PART_NAMES

OFFSET = "end-effector's distance from the COM"
POSITION = "end-effector position"
REACH = "end-effector's reach"
ROD = "reach of the end-effector's rod"


def force(case: str) -> str:
    """Name the force balance of a load case, by what it is called."""
    return f"{case}, force"


def torque(case: str) -> str:
    """Name the torque balance of a load case."""
    return f"{case}, torque"


def largest_input(case: str) -> str:
    """Name the upper bound of a load case's rotor inputs."""
    return f"{case}, largest rotor input"


def smallest_input(case: str) -> str:
    """Name the lower bound of a load case's rotor inputs."""
    return f"{case}, smallest rotor input"


def hinge_angle(i: int) -> str:
    """Name the bounds of the hinge between module i and its parent."""
    return f"hinge angle of module {i}"


def root_angle(angle: str) -> str:
    """Name the bounds of a root angle: psi, alpha_0 or alpha_1."""
    return f"root orientation, {angle}"


def airflow(i: int, j: int) -> str:
    """Name the clearance of two airflow envelopes."""
    return f"airflow of modules {i} and {j}"


def separation(i: int, j: int) -> str:
    """Name the least distance of two modules' centres."""
    return f"separation of modules {i} and {j}"


def rotor_airflow(i: int, j: int) -> str:
    """Name the clearance of module i's rotors, and of other parts of it, from the airflow of module j."""
    return f"rotors of module {i} and airflow of module {j}"


def tip_airflow(i: int) -> str:
    """Name the clearance of the end-effector, as thick as its rod, from the airflow of module i."""
    return f"end-effector and airflow of module {i}"


def exclusion(i: int) -> str:
    """Name the end-effector's exclusion ball of module i."""
    return f"end-effector exclusion of module {i}"


def solid(number: int, i: int, segment: int | None = None) -> str:
    """Name the clearance of module i's rigid parts from a solid region."""
    part = "" if segment is None else f", segment {segment}"
    return f"module {i} and solid exposure {number}{part}"


def rod_region(number: int, segment: int | None = None) -> str:
    """Name the clearance of the end-effector's rod from a solid region."""
    part = "" if segment is None else f", segment {segment}"
    return f"the end-effector's rod and solid exposure {number}{part}"


def exposure(number: int, requirement: AnyExposure, i: int, segment: int | None = None) -> str:
    """Name the clearance of module i's envelope from one exposure requirement."""
    part = "" if segment is None else f", {PART_NAMES[requirement.kind]} {segment}"
    return f"exposure {number} ({requirement.kind}{part}) of module {i}"


def air(number: int, requirement: AnyExposure, case: str) -> str:
    """Name the limit of the air speed over the region of one exposure requirement in a load case."""
    return f"air over exposure {number} ({requirement.kind}), {case}"

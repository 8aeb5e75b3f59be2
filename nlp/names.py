"""Names of constraints that several modules use; other names are defined with their requirement.

The audit, which shares no code with the solver, uses the same names for the clearances that both have; a test
compares them.
"""

from topo_search.model import AnyExposure
from topo_search.model.exposure import PART_NAMES

OFFSET = "end-effector's distance from the COM"
POSITION = "end-effector position"
REACH = "end-effector's reach"
ROD = "reach of the end-effector's rod"
ROD_AXIS = "cone about the axis of the end-effector's rod"


def force(case: str) -> str:
    """Name the force balance of a load case."""
    return f"{case}, force"


def torque(case: str) -> str:
    """Name the torque balance of a load case."""
    return f"{case}, torque"


def airflow(i: int, j: int, _: int | None = None) -> str:
    """Name the clearance of two airflow envelopes."""
    return f"airflow of modules {i} and {j}"


def separation(i: int, j: int, _: int | None = None) -> str:
    """Name the distance of two module centres."""
    return f"separation of modules {i} and {j}"


def rotor_airflow(i: int, j: int, _: int | None = None) -> str:
    """Name the clearance of module i's rotors and other parts from the airflow of module j."""
    return f"rotors of module {i} and airflow of module {j}"


def exposure(number: int, exposure: AnyExposure, rotor: int | None, i: int, _: int, segment: int | None) -> str:
    """Name the clearance of module i's envelope, or of one of its rotors, from an exposure requirement."""
    part = "" if segment is None else f", {PART_NAMES[exposure.kind]} {segment}"
    of_rotor = "" if rotor is None else f"rotor {rotor} of "
    return f"exposure {number} ({exposure.kind}{part}) of {of_rotor}module {i}"

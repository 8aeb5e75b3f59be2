r"""A platform as parameters of PX4's control allocation: its airframe 7, `Motors (6DOF)`.

| symbol | meaning | unit |
|---|---|---|
| o, z | position of a rotor from the COM and its thrust axis, axes of the task: x forward, y left, z up | m, - |
| p, a | the same in PX4's body axes: x forward, y right, z down (FRD), half a turn about x | m, - |
| CT | thrust at an output of 1; PX4 takes thrusts to be CT times the output | N |
| KM | drag torque over thrust; positive for a rotor that turns counter-clockwise seen against its thrust | m |

From its source (`ActuatorEffectivenessRotors::computeEffectivenessMatrix`) a column of PX4's matrix is

.. math:: (CT \; p \times a - CT \; KM \; a, \;\; CT \; a)

torque first, and from its parameter reference (`src/modules/control_allocator/module.yaml`): positions are from
the centre of gravity, only the direction of an axis counts, CT is in [0, 100], KM in [-1, 1], and there are at most
twelve rotors. The file has the form that QGroundControl loads: vehicle, component, name, value, type (6: int32, 9:
float32).
"""

from __future__ import annotations

from collections.abc import Iterator

from topo_search.export.allocation import Allocation, Rotor
from topo_search.model.bad_input import BadInput, Fault

MOST_ROTORS = 12
MOST_CT, MOST_KM, FARTHEST = 100.0, 1.0, 100.0
"""Ranges of PX4's parameters."""
AIRFRAME = 7
INT32, FLOAT32 = 6, 9
ALTERNATIVE = "use allocation.json in your own controller, or one autopilot per module"
FLOAT32_DIGITS = 9


def reason_against(acts: Allocation) -> str | None:
    """Return why PX4 cannot have a platform; None if it can."""
    count = len(acts.rotors)
    if count > MOST_ROTORS:
        return f"PX4 takes at most {MOST_ROTORS} rotors, but the platform has {count}; {ALTERNATIVE}"
    return None


def px4_parameters(acts: Allocation) -> str:
    """Return the text of a parameter file.

    Raises:
        BadInput: there are too many rotors, or a number is beyond the range of its parameter.
    """
    if (rule := reason_against(acts)) is not None:
        raise BadInput("--format px4", [Fault("", rule)])
    lines = [
        "# Control allocation of a platform with fixed rotors in any direction",
        "# Body axes: x as in the task, y and z opposite (forward, right, down); origin: the centre of mass.",
        "# Put the autopilot there, x along the task's x, or set SENS_BOARD_ROT and EKF2_IMU_POS_*.",
        "# An output of 1 is the largest thrust of a rotor, CT newtons; PX4 takes thrust to be proportional to it",
        "# (THR_MDL_FAC corrects that). Motors keep the order of rotors.csv.",
        "# Vehicle-Id Component-Id Name Value Type",
    ]
    integers = (("CA_AIRFRAME", AIRFRAME), ("CA_ROTOR_COUNT", len(acts.rotors)))
    lines += [f"1\t1\t{name}\t{value}\t{INT32}" for name, value in integers]
    faults = []
    for j, rotor in enumerate(acts.rotors):
        for suffix, value, least, most in _of(rotor):
            name = f"CA_ROTOR{j}_{suffix}"
            if not least <= value <= most:
                faults.append(Fault(name, f"must be between {least:g} and {most:g} in PX4, but got {value:g}"))
            lines.append(f"1\t1\t{name}\t{value:.{FLOAT32_DIGITS}g}\t{FLOAT32}")
    if faults:
        raise BadInput("--format px4", faults)
    return "\n".join(lines) + "\n"


def _of(rotor: Rotor) -> Iterator[tuple[str, float, float, float]]:
    """Yield name, value and range of each parameter of a rotor."""
    for kind, (x, y, z), most in (("P", rotor.position_m, FARTHEST), ("A", rotor.axis, 1.0 + 1e-9)):
        for axis, value in (("X", x), ("Y", -y), ("Z", -z)):
            yield f"{kind}{axis}", value + 0.0, -most, most
    yield "CT", rotor.largest_thrust_N, 0.0, MOST_CT
    yield "KM", rotor.spin * rotor.torque_coefficient / rotor.thrust_coefficient, -MOST_KM, MOST_KM

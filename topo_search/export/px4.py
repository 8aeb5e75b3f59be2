r"""PX4's control allocation for a platform: its parameters, and what they cannot do.

The platform is PX4's airframe 0, `Multirotor`, whose rotors may point anywhere. Airframe 7, `Motors (6DOF)`, has
the same matrix but stops motors below 2 % of their output in flight (`ActuatorEffectivenessUUV::updateSetpoint`).

| symbol | meaning | unit |
|---|---|---|
| o, z | position of a rotor from the COM and its thrust axis, axes of the task: x forward, y left, z up | m, - |
| p, a | the same in PX4's body axes: x forward, y right, z down (FRD), half a turn about x | m, - |
| CT | thrust at an output of 1; PX4 takes thrusts to be CT times the output | N |
| KM | drag torque over thrust; positive for a rotor that turns counter-clockwise seen against its thrust | m |
| G | PX4's matrix from outputs to torques and forces, (6, N) | N m, N |
| c_i | what PX4 divides column i of the pseudo-inverse of G by | 1/(N m), 1/N |

From its source (`ActuatorEffectivenessRotors::computeEffectivenessMatrix`) a column of G is

.. math:: (CT \; p \times a - CT \; KM \; a, \;\; CT \; a)

torque first, and from its parameter reference (`src/modules/control_allocator/module.yaml`): positions are from
the centre of gravity, only the direction of an axis counts, CT is in [0, 100], KM in [-1, 1], and there are at most
twelve rotors. Rows of G without an entry above 0.05 become zero (`ControlAllocator.cpp`). A set-point of 1 is
1 / c_i: of roll and pitch c is the larger root mean square of half of a column's entries, of yaw its largest entry,
of a force the mean of its entries' sizes (`ControlAllocationPseudoInverse::updateControlAllocationMatrixScale`,
version 1.17). The file has the form that QGroundControl loads: vehicle, component, name, value, type (6: int32,
9: float32).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from topo_search.export.allocation import RANK_TOLERANCE, Allocation, Rotor
from topo_search.model.arrays import Array
from topo_search.model.value import BadInput, Fault

MOST_ROTORS = 12
WEAK = 0.05
"""Size that an entry of a row of G must exceed for PX4 to keep the row [N m], [N]."""
SMALL = 1e-3
"""Size up to which an entry counts as zero for PX4."""
AXES = ("roll", "pitch", "yaw", "force x", "force y", "force z")


def reason_against(acts: Allocation) -> str | None:
    """Return why PX4 cannot have a platform; None if it can."""
    count = len(acts.rotors)
    if count > MOST_ROTORS:
        alternative = "use allocation.json in your own controller, or one autopilot per module"
        return f"PX4 takes at most {MOST_ROTORS} rotors, but the platform has {count}; {alternative}"
    return None


def px4_warnings(acts: Allocation) -> tuple[str, ...]:
    """Return what PX4 cannot do with a platform, one sentence each."""
    G = _matrix(acts)
    warnings = []
    if missing := _missing(G):
        warnings.append(
            f"PX4: the platform has rank {acts.rank} of 6 and cannot exert {', nor '.join(missing)}; a set-point "
            "with a part of that is lost, or turns into other forces and torques"
        )
    weak = [axis for axis, row in zip(AXES, np.abs(G).max(axis=1), strict=True) if SMALL < row <= WEAK]
    if weak:
        warnings.append(
            f"PX4 ignores {' and '.join(weak)}, to which no rotor adds more than {WEAK:g}: multiply all "
            "CA_ROTORi_CT by one factor, which changes nothing else"
        )
    return tuple(warnings)


def set_points(acts: Allocation) -> tuple[float, ...]:
    """Return what a set-point of 1 is: roll, pitch, yaw [N m], forces along x, y, z [N]; 0 where PX4 has none."""
    G = _matrix(acts)
    G[np.abs(G).max(axis=1) <= WEAK] = 0.0
    mix = np.linalg.pinv(G, rcond=RANK_TOLERANCE)
    counts = np.maximum(np.count_nonzero(np.abs(mix) > SMALL, axis=0), 1)
    tilt = max(np.sqrt(2 * np.sum(mix[:, k] ** 2) / counts[k]) for k in (0, 1))
    means = [np.abs(column).sum() / max(np.count_nonzero(np.abs(column) > 1e-7), 1) for column in mix.T[3:]]
    scales = (tilt, tilt, mix[:, 2].max(), *means)
    return tuple(float(p / c) if c > 0 else 0.0 for p, c in zip(np.diag(G @ mix), scales, strict=True))


def px4_parameters(acts: Allocation) -> str:
    """Return the text of a parameter file.

    Raises:
        BadInput: there are too many rotors, or a number is beyond the range of its parameter.
    """
    if (rule := reason_against(acts)) is not None:
        raise BadInput("--format px4", rule)
    roll, pitch, yaw, x, y, z = set_points(acts)
    hover = acts.mass_kg * 9.80665 / z if z > 0 else np.inf  # with gravity as PX4 has it [m/s^2]
    lines = [
        "# Control allocation of a platform with fixed rotors in any direction",
        "# Body axes: x as in the task, y and z opposite (forward, right, down); origin: the centre of mass.",
        "# Put the autopilot there, x along the task's x, or set SENS_BOARD_ROT and EKF2_IMU_POS_*.",
        "# An output of 1 is the largest thrust of a rotor, CT newtons; PX4 takes thrust to be proportional to it",
        "# (THR_MDL_FAC corrects that). Motors keep the order of rotors.csv.",
        "# A set-point of 1 is, in PX4 1.17 and before limits of rotors:",
        f"# torque {roll:.4g} N m of roll, {pitch:.4g} of pitch, {yaw:.4g} of yaw; "
        f"force {x:.4g} N along x, {y:.4g} along y, {z:.4g} along z",
        f"# Hover in the attitude of the task: a set-point of {-hover:.4g} along z.",
        *(f"# {text}." for text in px4_warnings(acts)),
        "# Vehicle-Id Component-Id Name Value Type",
    ]
    # a fully actuated platform is clipped, as PX4's own omnicopter: desaturation gives up forces first
    method = 0 if acts.rank == len(AXES) else 1
    lines += [f"1\t1\t{name}\t{value}\t6" for name, value in (("CA_AIRFRAME", 0), ("CA_METHOD", method))]
    lines.append(f"1\t1\tCA_ROTOR_COUNT\t{len(acts.rotors)}\t6")
    if 0.1 <= hover <= 0.8:  # the range of MPC_THR_HOVER
        lines.append(f"1\t1\tMPC_THR_HOVER\t{hover:.9g}\t9")
    faults = []
    for j, rotor in enumerate(acts.rotors):
        for suffix, value, least, most in _of(rotor):
            name = f"CA_ROTOR{j}_{suffix}"
            if not least <= value <= most:
                faults.append(Fault(name, f"must be between {least:g} and {most:g} in PX4, but got {value:g}"))
            lines.append(f"1\t1\t{name}\t{value:.9g}\t9")
    if faults:
        raise BadInput("--format px4", faults)
    return "\n".join(lines) + "\n"


def _matrix(acts: Allocation) -> Array:
    """Return G."""
    thrusts = np.array([rotor.largest_thrust_N for rotor in acts.rotors])
    B = np.array(acts.thrust_matrix) * thrusts
    turned = np.array([1.0, -1.0, -1.0])[:, None]
    return np.concatenate([turned * B[3:], turned * B[:3]])


def _missing(G: Array) -> list[str]:
    """Return the directions in PX4's axes in which nothing can be exerted: whole axes, then what is oblique."""
    size = np.abs(G).max(axis=1)
    scaled = G / np.repeat([max(size[:3].max(), 1e-9), max(size[3:].max(), 1e-9)], 3)[:, None]
    axes, sizes, _ = np.linalg.svd(np.hstack([scaled, np.zeros((6, 6))]))
    missing = axes[:, sizes <= RANK_TOLERANCE * sizes[0]].T
    whole = np.sum(missing**2, axis=0) > 1 - RANK_TOLERANCE
    oblique = missing[:, ~whole]
    _, sizes, parts = np.linalg.svd(oblique)
    names = [axis for axis, one in zip(AXES, whole, strict=True) if not one]
    return [axis for axis in AXES if axis not in names] + [
        " ".join(f"{x:+.2f} {name}" for x, name in zip(part, names, strict=True) if abs(x) > 0.005)
        for part in parts[: np.count_nonzero(sizes > 0.5)]
    ]


def _of(rotor: Rotor) -> Iterator[tuple[str, float, float, float]]:
    """Yield name, value and PX4's range of each parameter of a rotor."""
    for kind, (x, y, z), most in (("P", rotor.position_m, 100.0), ("A", rotor.axis, 1.0 + 1e-9)):
        for axis, value in (("X", x), ("Y", -y), ("Z", -z)):
            yield f"{kind}{axis}", value + 0.0, -most, most
    yield "CT", rotor.largest_thrust_N, 0.0, 100.0
    yield "KM", rotor.spin * rotor.torque_coefficient / rotor.thrust_coefficient, -1.0, 1.0

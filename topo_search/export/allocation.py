r"""Data of a platform for flight controllers: forces and torques of rotors, mass, inertia, PX4 parameters.

.. math::

    w = B u = B_T T, \qquad B = k_f B_T, \qquad
    B_T[:, j] = (z_j, \; o_j \times z_j + s_j \tfrac{k_\tau}{k_f} z_j)

| symbol | meaning | shape | unit |
|---|---|---|---|
| w | force, then torque about the COM, in the axes of the task | (6,) | N, N m |
| u; T = k_f u | squared rotor speeds; thrusts; j counts the rotors of each module in turn | (N,) | rad^2/s^2; N |
| o_j, z_j | position of rotor j from the COM; its thrust axis | (3,) | m, - |
| s_j | sign of the drag torque along z_j: +1 for a rotor that is clockwise as seen against z_j | | |
| J | inertia about the COM; joints and the end-effector are point masses | (3, 3) | kg m^2 |

In PX4's control allocation the platform is airframe 0, `Multirotor`, whose rotors may point anywhere. Airframe 7,
`Motors (6DOF)`, has the same matrix but stops motors below 2 % of their output in flight
(`ActuatorEffectivenessUUV::updateSetpoint`).

| symbol | meaning | unit |
|---|---|---|
| o, z | position of a rotor from the COM and its thrust axis, axes of the task: x forward, y left, z up | m, - |
| p, a | the same in PX4's body axes (FRD): x forward, y right, z down; rotated by 180 deg about x | m, - |
| CT | thrust at an output of 1; PX4 assumes thrust = CT times output | N |
| KM | drag torque over thrust; positive for a rotor that is counter-clockwise as seen against its thrust | m |
| G | PX4's matrix from outputs to torques and forces, (6, N) | N m, N |
| c_i | PX4's normalization of column i of the pseudo-inverse of G | 1/(N m), 1/N |

PX4 uses the ratios of CT alone, but drops weak rows of G. So the CT of light rotors are written larger, all by the
same factor, until PX4 counts every row; those above its range are written smaller.

In PX4's source (`ActuatorEffectivenessRotors::computeEffectivenessMatrix`) a column of G is

.. math:: (CT \; p \times a - CT \; KM \; a, \;\; CT \; a)

torque first. By the parameter reference (`src/modules/control_allocator/module.yaml`), positions are from the
centre of gravity, axes are normalized, CT is in [0, 100], KM in [-1, 1], and there are at most twelve rotors. Rows
of G without an entry above 0.05 are set to zero (`ControlAllocator.cpp`). A set-point of 1 is 1 / c_i. For roll
and pitch c is the larger root mean square of half of a column's entries, for yaw the largest entry, for a force
the mean absolute entry (`ControlAllocationPseudoInverse::updateControlAllocationMatrixScale`, version 1.17). The
file has QGroundControl's format: vehicle, component, name, value, type (6: int32, 9: float32).
"""

import re
from collections.abc import Iterator
from pathlib import Path
from pprint import pformat
from typing import Literal

import numpy as np

from topo_search.export import allocator
from topo_search.export.hover import Hover
from topo_search.model import Array, BadInput, Design, Fault, Flags, ResolvedTask, Value
from topo_search.model.kinds import Index, Number, Vector
from topo_search.model.text import csv_text
from verify.flight.joints import inertia
from verify.kinematics import Platform, has_rotor, platform

RANK_TOLERANCE = 1e-9
"""Singular values below this share of the largest count as zero; rounding makes them positive."""
ACC_HOR = (2.0, 15.0)
"""Smallest and largest value of PX4's MPC_ACC_HOR and MPC_ACC_HOR_MAX [m/s^2]."""
UNITS = {
    "matrix": "N and N m per rad^2/s^2",
    "pseudo_inverse": "rad^2/s^2 per N and per N m",
    "thrust_matrix": "N and N m per N",
    "thrust_pseudo_inverse": "N per N and per N m",
    "rotors": "positions in m, thrusts in N, speeds in rad/s",
}
TORQUE_FIRST = 10.0
"""Weight of a missing torque over l_arm, relative to a missing force: without attitude, forces fail too."""

MatrixRow = tuple[Number, ...]


class Rotor(Value):
    """One rotor, in the axes of the task."""

    name: str
    """Same as in the exported simulator models."""
    module: Index
    rotor: Index
    """0..3; the paper's q minus one."""
    position_m: Vector
    """From the COM."""
    axis: Vector
    """Unit vector along the thrust."""
    spin: Literal[-1, 1]
    """1: counter-clockwise seen against the thrust axis (from above a rotor that pulls up); -1: clockwise."""
    thrust_coefficient: Number
    """k_f [N s^2]."""
    torque_coefficient: Number
    """k_tau [N m s^2]; the drag torque acts against the spin."""
    largest_thrust_N: Number


class Allocation(Value):
    """The file `allocation.json`."""

    format: Literal["topo-search/allocation"] = "topo-search/allocation"
    version: Literal[1] = 1
    matrix: tuple[MatrixRow, ...]
    """B, (6, N): wrench per squared rotor speed."""
    pseudo_inverse: tuple[MatrixRow, ...]
    """Pseudo-inverse of `matrix`, (N, 6): the squared speeds with the smallest norm, ignoring limits."""
    thrust_matrix: tuple[MatrixRow, ...]
    """B_T, (6, N): wrench per thrust."""
    thrust_pseudo_inverse: tuple[MatrixRow, ...]
    """Pseudo-inverse of `thrust_matrix`, (N, 6)."""
    rank: Index
    """Rank of the matrix: 6 if the platform is fully actuated."""
    rows: tuple[str, ...] = ("force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")
    """Names of the rows of the matrices."""
    units: dict[str, str] = UNITS
    frame: str = (
        "Axes of the task (z up). Origin of forces, torques, rotor positions and inertia: the centre of mass. "
        "com_m is the centre of mass from the centre of module 0, in the same axes."
    )
    largest_input: Number
    """Largest squared speed of a rotor [rad^2/s^2]."""
    least_input: Number
    """Smallest squared speed of a running rotor [rad^2/s^2]."""
    side_force_N: Number = 0.0
    """Largest horizontal force that can be added to hover at the centre of mass, in any direction [N]."""
    mass_kg: Number
    com_m: Vector
    inertia_kg_m2: tuple[Vector, Vector, Vector]
    """J."""
    principal_moments_kg_m2: Vector
    """Ascending."""
    principal_axes: tuple[Vector, Vector, Vector]
    """Three unit vectors, right-handed."""
    rotors: tuple[Rotor, ...]
    """In the order of the columns."""

    @property
    def side_acceleration(self) -> float:
        """Horizontal acceleration that the rotors can produce in hover, in any direction [m/s^2]."""
        return self.side_force_N / self.mass_kg

    def csv(self) -> str:
        """Return `matrix` as the text of a CSV file, a row per component of the wrench."""
        head = ("component", *(rotor.name for rotor in self.rotors))
        return csv_text(head, [(name, *row) for name, row in zip(self.rows, self.matrix, strict=True)])

    def rotor_csv(self) -> str:
        """Return the rotors as the text of a CSV file."""
        head = ("column", "name", "module", "rotor", "x_m", "y_m", "z_m", "axis_x", "axis_y", "axis_z", "spin")
        rows = [
            (
                *(j, rotor.name, rotor.module, rotor.rotor, *rotor.position_m, *rotor.axis, rotor.spin),
                *(rotor.thrust_coefficient, rotor.torque_coefficient, rotor.largest_thrust_N),
            )
            for j, rotor in enumerate(self.rotors)
        ]
        return csv_text((*head, "thrust_coefficient_Ns2", "torque_coefficient_Nms2", "largest_thrust_N"), rows)


def allocation(design: Design) -> Allocation:
    """Return the allocation data of a design."""
    task, poses, n = design.task, platform(design), design.topology.n
    is_rotor, modules = has_rotor(task), task.modules_of_nodes
    largest = [module.max_input(task.gravity) for module in modules if module.rotor_table.count]
    o, a = poses.rotors[is_rotor], poses.thrust_axes[is_rotor]
    k_f = np.concatenate([module.thrust_coefficient * module.rotor_table.gains for module in modules])
    k_tau = np.concatenate([module.torque_coefficient * np.abs(module.rotor_table.drags) for module in modules])
    spins = [spin for module in modules for spin in module.rotor_table.spins]
    B_T, thrusts = thrust_matrix(task, poses), largest_thrusts(task)
    inverse: Array = np.asarray(np.linalg.pinv(B_T, rcond=RANK_TOLERANCE), dtype=np.float64)
    J = inertia(design, platform(design))
    J = (J + J.T) / 2
    moments, axes = np.linalg.eigh(J)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    rotors = [
        Rotor(
            name=f"module_{i}_rotor_{q}",
            module=i,
            rotor=q,
            position_m=o[j].tolist(),
            axis=a[j].tolist(),
            spin=spins[j],
            thrust_coefficient=float(k_f[j]),
            torque_coefficient=float(k_tau[j]),
            largest_thrust_N=float(thrusts[j]),
        )
        for j, (i, q) in enumerate(np.argwhere(is_rotor).tolist())
    ]
    hover = Hover(B_T, thrusts, task.module.min_input, task.force_unit(n), task.module.arm_length)
    return Allocation(
        matrix=(k_f * B_T).tolist(),
        pseudo_inverse=(inverse / k_f[:, None]).tolist(),
        thrust_matrix=B_T.tolist(),
        thrust_pseudo_inverse=inverse.tolist(),
        rank=int(np.linalg.matrix_rank(B_T, rtol=RANK_TOLERANCE)),
        largest_input=max(largest),
        least_input=task.module.min_input * min(largest),
        side_force_N=hover.weakest_force()[0],
        mass_kg=task.total_mass(n),
        com_m=poses.p_com.tolist(),
        inertia_kg_m2=J.tolist(),
        principal_moments_kg_m2=moments.tolist(),
        principal_axes=axes.T.tolist(),
        rotors=rotors,
    )


def largest_thrusts(task: ResolvedTask) -> Array:
    """Return the largest thrust of every rotor, module by module, shape (N,) [N]."""
    return np.concatenate(
        [
            module.rotor_table.gains * (module.thrust_coefficient * module.max_inputs(task.gravity))
            for module in task.modules_of_nodes
        ]
    )


def thrust_matrix(task: ResolvedTask, poses: Platform) -> Array:
    """Return B_T, shape (6, N) [N and N m per N]."""
    is_rotor = has_rotor(task)
    o, a = poses.rotors[is_rotor], poses.thrust_axes[is_rotor]
    drag = np.concatenate(
        [
            module.rotor_table.drags
            / module.rotor_table.gains
            * module.torque_coefficient
            / module.thrust_coefficient
            for module in task.modules_of_nodes
        ]
    )
    return np.concatenate([a, np.cross(o, a) + drag[:, None] * a], axis=1).T


def allocator_file(design: Design, platform_data: Allocation) -> str:
    """Return the text of a kit's `allocator.py`: the source of `export.allocator` with the data of a platform.

    Args:
        design: the design.
        platform_data: its allocation data.
    """
    task, weight = design.task, platform_data.mass_kg * design.task.gravity
    shares = [
        (module, share) for module in task.modules_of_nodes for share in module.input_shares(task.gravity).tolist()
    ]
    data = {
        "PLATFORM": f"{design.task.name}, {design.topology.key}",
        "NAMES": tuple(rotor.name for rotor in platform_data.rotors),
        "MATRIX": platform_data.thrust_matrix,
        "LEAST": tuple(
            rotor.thrust_coefficient * (task.module.min_input * module.max_input(task.gravity)) * share
            for rotor, (module, share) in zip(platform_data.rotors, shares, strict=True)
        ),
        "LARGEST": tuple(rotor.largest_thrust_N for rotor in platform_data.rotors),
        "SCALE": (1 / weight,) * 3 + (TORQUE_FIRST / (task.module.arm_length * weight),) * 3,
        "FULL": max(module.thrust_coefficient * module.max_input(task.gravity) for module, _ in shares),
        "WEIGHT": weight,
        "THRUST_COEFFICIENT": tuple(rotor.thrust_coefficient for rotor in platform_data.rotors),
    }

    def value(line: re.Match[str]) -> str:
        return f"{line[1]} = {pformat(data[line[2]], width=110, compact=True)}"

    source = Path(allocator.__file__).read_text(encoding="utf-8")
    return re.sub(rf"^(({'|'.join(data)}): [^=\n]+) = .*$", value, source, flags=re.MULTILINE)


WEAK = 0.05
"""PX4 drops a row of G unless an entry exceeds this size [N m], [N]."""
FAINT = 1e-3
"""Largest entry of a row of G, over that of all torques or forces, up to which PX4 may drop the row."""
LARGEST_CT = 100.0
SMALL = 1e-3
"""Size up to which PX4 treats an entry of the pseudo-inverse as zero."""
AXES = ("roll", "pitch", "yaw", "force x", "force y", "force z")


def reason_against(platform_data: Allocation) -> str | None:
    """Return why PX4 cannot fly a platform; None if it can."""
    count, largest_count = len(platform_data.rotors), 12
    if count > largest_count:
        alternative = "use allocation.json in your own controller, or one autopilot per module"
        return f"PX4 takes at most {largest_count} rotors, but the platform has {count}; {alternative}"
    return None


def px4_warnings(platform_data: Allocation) -> tuple[str, ...]:
    """Return the limits of PX4 with a platform, one sentence each."""
    warnings = []
    if missing := _missing_directions(_largest_wrenches(platform_data)):
        warnings.append(
            f"PX4: the platform has rank {platform_data.rank} of 6 and cannot exert {', nor '.join(missing)}; "
            "set-points along these are lost, or cause other forces and torques"
        )
    sizes, counts = _row_sizes(_px4_matrix(platform_data))
    if weak := [axis for axis, is_weak in zip(AXES, counts & (sizes <= WEAK), strict=True) if is_weak]:
        warnings.append(
            f"PX4 ignores {' and '.join(weak)}, because even with CA_ROTORi_CT of {LARGEST_CT:g} no rotor "
            f"contributes more than {WEAK:g}"
        )
    side, (least, _) = platform_data.side_acceleration, ACC_HOR
    if platform_data.rank == len(AXES) and side < least:  # others tilt to accelerate
        warnings.append(
            f"PX4 asks for horizontal accelerations of at least {least:g} m/s^2 (MPC_ACC_HOR), but in hover the "
            f"rotors can only produce {side:.2g} m/s^2 in any direction"
        )
    return tuple(warnings)


def set_points(platform_data: Allocation) -> tuple[float, ...]:
    """Return the effect of a set-point of 1: roll, pitch, yaw [N m], force along x, y, z [N]; 0 if dropped."""
    G, factor = _px4_matrix(platform_data), ct_factor(platform_data)
    G[np.abs(G).max(axis=1) <= WEAK] = 0.0
    mix = np.linalg.pinv(G, rcond=RANK_TOLERANCE)
    counts = np.maximum(np.count_nonzero(np.abs(mix) > SMALL, axis=0), 1)
    tilt = max(np.sqrt(2 * np.sum(mix[:, k] ** 2) / counts[k]) for k in (0, 1))
    means = [np.abs(column).sum() / max(np.count_nonzero(np.abs(column) > 1e-7), 1) for column in mix.T[3:]]
    scales = (tilt, tilt, mix[:, 2].max(), *means)
    return tuple(float(p / c / factor) if c > 0 else 0.0 for p, c in zip(np.diag(G @ mix), scales, strict=True))


def px4_parameters(platform_data: Allocation) -> str:
    """Return the text of a PX4 parameter file.

    Raises:
        BadInput: there are too many rotors, or a value is out of its parameter's range.
    """
    if (rule := reason_against(platform_data)) is not None:
        raise BadInput("--format px4", rule)
    roll, pitch, yaw, x, y, z = set_points(platform_data)
    hover = platform_data.mass_kg * 9.80665 / z if z > 0 else np.inf  # PX4's gravity [m/s^2]
    factor = ct_factor(platform_data)
    scale = "CT newtons" if factor == 1 else f"CT / {factor:.6g} newtons, so that PX4 counts every direction"
    lines = [
        "# Control allocation of a platform whose fixed rotors point in any direction",
        "# Body axes: x as in the task, y and z opposite (forward, right, down); origin: the centre of mass.",
        "# Mount the autopilot there, x along the task's x, or set SENS_BOARD_ROT and EKF2_IMU_POS_*.",
        f"# An output of 1 is the largest thrust of a rotor, {scale};",
        "# PX4 assumes that thrust is proportional to output (THR_MDL_FAC corrects that).",
        "# Motors are in the order of rotors.csv.",
        "# In PX4 1.17, before rotor limits, a set-point of 1 is:",
        f"# torque {roll:.4g} N m of roll, {pitch:.4g} of pitch, {yaw:.4g} of yaw; "
        f"force {x:.4g} N along x, {y:.4g} along y, {z:.4g} along z",
        f"# Hover in the task's attitude needs a set-point of {-hover:.4g} along z.",
        *(f"# {text}." for text in px4_warnings(platform_data)),
        "# Vehicle-Id Component-Id Name Value Type",
    ]
    # fully actuated: clipping, as for PX4's omnicopter, because desaturation gives up forces first
    method = 0 if platform_data.rank == len(AXES) else 1
    lines += [f"1\t1\t{name}\t{value}\t6" for name, value in (("CA_AIRFRAME", 0), ("CA_METHOD", method))]
    lines.append(f"1\t1\tCA_ROTOR_COUNT\t{len(platform_data.rotors)}\t6")
    if 0.1 <= hover <= 0.8:  # the range of MPC_THR_HOVER
        lines.append(f"1\t1\tMPC_THR_HOVER\t{hover:.9g}\t9")
    side, (least, largest) = platform_data.side_acceleration, ACC_HOR
    if side >= least:
        lines += [f"1\t1\t{name}\t{min(side, largest):.9g}\t9" for name in ("MPC_ACC_HOR", "MPC_ACC_HOR_MAX")]
    faults = []
    for j, rotor in enumerate(platform_data.rotors):
        for suffix, value, low, high in _px4_rotor_parameters(rotor, factor):
            name = f"CA_ROTOR{j}_{suffix}"
            if not low <= value <= high:
                faults.append(Fault(name, f"must be between {low:g} and {high:g} in PX4, but got {value:g}"))
            lines.append(f"1\t1\t{name}\t{value:.9g}\t9")
    if faults:
        raise BadInput("--format px4", faults)
    return "\n".join(lines) + "\n"


def ct_factor(platform_data: Allocation) -> float:
    """Return the factor on the largest thrusts with which they are written as CT."""
    sizes, counts = _row_sizes(_largest_wrenches(platform_data))
    needed = WEAK / float(sizes[counts].min())
    return min(
        LARGEST_CT / max(rotor.largest_thrust_N for rotor in platform_data.rotors),
        2 * needed if needed >= 1 else 1.0,
    )


def _row_sizes(G: Array) -> tuple[Array, Flags]:
    """Return the largest entry of each row of G, and which rows are not faint, both (6,)."""
    sizes = np.abs(G).max(axis=1)
    return sizes, sizes > FAINT * np.repeat(sizes.reshape(2, 3).max(axis=1), 3)


def _px4_matrix(platform_data: Allocation) -> Array:
    """Return G."""
    return ct_factor(platform_data) * _largest_wrenches(platform_data)


def _largest_wrenches(platform_data: Allocation) -> Array:
    """Return torque and force of each rotor at its largest thrust, in PX4's body axes, (6, N) [N m, N]."""
    thrusts = np.array([rotor.largest_thrust_N for rotor in platform_data.rotors])
    B = np.array(platform_data.thrust_matrix) * thrusts
    turned = np.array([1.0, -1.0, -1.0])[:, None]
    return np.concatenate([turned * B[3:], turned * B[:3]])


def _missing_directions(G: Array) -> list[str]:
    """Return the directions in PX4's axes in which nothing can be exerted: whole axes, then oblique directions."""
    row_size = np.abs(G).max(axis=1)
    scaled = G / np.repeat([max(row_size[:3].max(), 1e-9), max(row_size[3:].max(), 1e-9)], 3)[:, None]
    axes, sizes, _ = np.linalg.svd(np.hstack([scaled, np.zeros((6, 6))]))
    missing = axes[:, sizes <= RANK_TOLERANCE * sizes[0]].T
    whole = np.sum(missing**2, axis=0) > 1 - RANK_TOLERANCE
    oblique = missing[:, ~whole]
    _, sizes, parts = np.linalg.svd(oblique)
    names = [axis for axis, is_missing in zip(AXES, whole, strict=True) if not is_missing]
    return [axis for axis in AXES if axis not in names] + [
        " ".join(f"{x:+.2f} {name}" for x, name in zip(part, names, strict=True) if abs(x) > 0.005)
        for part in parts[: np.count_nonzero(sizes > 0.5)]
    ]


def _px4_rotor_parameters(rotor: Rotor, factor: float) -> Iterator[tuple[str, float, float, float]]:
    """Yield name, value and PX4's range of each parameter of a rotor; `factor` is that on CT."""
    for kind, (x, y, z), limit in (("P", rotor.position_m, 100.0), ("A", rotor.axis, 1.0 + 1e-9)):
        for axis, value in (("X", x), ("Y", -y), ("Z", -z)):
            yield f"{kind}{axis}", value + 0.0, -limit, limit
    yield "CT", factor * rotor.largest_thrust_N, 0.0, LARGEST_CT
    yield "KM", rotor.spin * rotor.torque_coefficient / rotor.thrust_coefficient, -1.0, 1.0

r"""Data of a platform for a flight controller: forces and torques of its rotors, mass and inertia.

.. math::

    w = B u = B_T T, \qquad B = k_f B_T, \qquad
    B_T[:, j] = (z_j, \; o_j \times z_j + s_j \tfrac{k_\tau}{k_f} z_j)

| symbol | meaning | shape | unit |
|---|---|---|---|
| w | force, then torque about the COM, in the axes of the task | (6,) | N, N m |
| u; T = k_f u | squared rotor speeds; thrusts; j = 4 i + q, rotor q = 0..3 of module i | (4n,) | rad^2/s^2; N |
| o_j, z_j | position of rotor j from the COM; its thrust axis | (3,) | m, - |
| s_j = -(-1)^q | sign of the drag torque along z_j: +1 for a rotor that turns clockwise seen against z_j | | |
| J | inertia about the COM: modules by their own, joints and the end-effector as points | (3, 3) | kg m^2 |
"""

from __future__ import annotations

import re
from pathlib import Path
from pprint import pformat
from typing import Literal

import numpy as np

from topo_search.export import allocator
from topo_search.export.poses import Poses, poses
from topo_search.model.arrays import ROTOR_SPINS, Array
from topo_search.model.design import Design
from topo_search.model.module import Module
from topo_search.model.text import csv_text
from topo_search.model.value import Index, Number, Value, Vector
from verify.flight.joints import inertia
from verify.kinematics import platform

ROWS = ("force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")
"""Names of the components of w."""
RANK_TOLERANCE = 1e-9
"""Singular values below this share of the largest are zero: a flat platform has some that rounding leaves."""
UNITS = {
    "matrix": "N and N m per rad^2/s^2",
    "pseudo_inverse": "rad^2/s^2 per N and per N m",
    "thrust_matrix": "N and N m per N",
    "thrust_pseudo_inverse": "N per N and per N m",
    "rotors": "positions in m, thrusts in N, speeds in rad/s",
}
FRAME = (
    "Axes of the task (z up). Origin of forces, torques, rotor positions and inertia: the centre of mass. com_m is "
    "the centre of mass from the centre of module 0, in the same axes."
)
TORQUE_FIRST = 10.0
"""Weight of a missing torque, per l_arm, beside that of a missing force: who turns away loses forces as well."""

Row = tuple[Number, ...]


class Rotor(Value):
    """One rotor, in the axes of the task."""

    name: str
    """As in the exported models for simulators."""
    module: Index
    rotor: Index
    """0..3; the paper's q less one."""
    position_m: Vector
    """From the COM."""
    axis: Vector
    """Unit vector that the thrust pulls along."""
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
    matrix: tuple[Row, ...]
    """B, (6, 4n): from squared speeds."""
    pseudo_inverse: tuple[Row, ...]
    """Pseudo-inverse of `matrix`, (4n, 6): the squared speeds of least norm, without limits."""
    thrust_matrix: tuple[Row, ...]
    """B_T, (6, 4n): from thrusts."""
    thrust_pseudo_inverse: tuple[Row, ...]
    """Pseudo-inverse of `thrust_matrix`, (4n, 6)."""
    rank: Index
    """Rank of the matrix: 6 if the platform is fully actuated."""
    rows: tuple[str, ...] = ROWS
    """Names of the rows of the matrices."""
    units: dict[str, str] = UNITS
    frame: str = FRAME
    largest_input: Number
    """Largest squared speed of a rotor [rad^2/s^2]."""
    least_input: Number
    """Least squared speed of a rotor that runs [rad^2/s^2]."""
    mass_kg: Number
    com_m: Vector
    inertia_kg_m2: tuple[Vector, Vector, Vector]
    """J."""
    principal_moments_kg_m2: Vector
    """Ascending."""
    principal_axes: tuple[Vector, Vector, Vector]
    """A unit vector each, right-handed."""
    rotors: tuple[Rotor, ...]
    """In the order of the columns."""

    def csv(self) -> str:
        """Return the matrix from squared speeds as a table, a row for each component of the wrench."""
        head = ("component", *(rotor.name for rotor in self.rotors))
        return csv_text(head, [(name, *row) for name, row in zip(self.rows, self.matrix, strict=True)])

    def rotor_csv(self) -> str:
        """Return the rotors as a table."""
        head = ("column", "name", "module", "rotor", "x_m", "y_m", "z_m", "axis_x", "axis_y", "axis_z", "spin")
        rows = [
            (
                *(j, one.name, one.module, one.rotor, *one.position_m, *one.axis, one.spin),
                *(one.thrust_coefficient, one.torque_coefficient, one.largest_thrust_N),
            )
            for j, one in enumerate(self.rotors)
        ]
        return csv_text((*head, "thrust_coefficient_Ns2", "torque_coefficient_Nms2", "largest_thrust_N"), rows)


def allocation(design: Design) -> Allocation:
    """Return how the rotors of a design act on it."""
    task, module, at, n = design.task, design.task.module, poses(design), design.topology.n
    k_f, k_tau = module.thrust_coefficient, module.torque_coefficient
    o, z, s = at.rotors.reshape(-1, 3), np.repeat(at.z, 4, axis=0), np.tile(ROTOR_SPINS, n)
    B_T = thrust_matrix(module, at)
    inverse: Array = np.asarray(np.linalg.pinv(B_T, rcond=RANK_TOLERANCE), dtype=np.float64)
    J = inertia(design, platform(design))
    J = (J + J.T) / 2
    moments, axes = np.linalg.eigh(J)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    u_max = module.max_input(task.gravity)
    rotors = [
        Rotor(
            name=f"module_{j // 4}_rotor_{j % 4}",
            module=j // 4,
            rotor=j % 4,
            position_m=o[j].tolist(),
            axis=z[j].tolist(),
            spin=-1 if s[j] > 0 else 1,
            thrust_coefficient=k_f,
            torque_coefficient=k_tau,
            largest_thrust_N=k_f * u_max,
        )
        for j in range(4 * n)
    ]
    return Allocation(
        matrix=(k_f * B_T).tolist(),
        pseudo_inverse=(inverse / k_f).tolist(),
        thrust_matrix=B_T.tolist(),
        thrust_pseudo_inverse=inverse.tolist(),
        rank=int(np.linalg.matrix_rank(B_T, rtol=RANK_TOLERANCE)),
        largest_input=u_max,
        least_input=task.min_input,
        mass_kg=task.total_mass(n),
        com_m=at.p_com.tolist(),
        inertia_kg_m2=J.tolist(),
        principal_moments_kg_m2=moments.tolist(),
        principal_axes=axes.T.tolist(),
        rotors=rotors,
    )


def thrust_matrix(module: Module, at: Poses) -> Array:
    """Return B_T, shape (6, 4n) [N and N m per N]."""
    o, z = at.rotors.reshape(-1, 3), np.repeat(at.z, 4, axis=0)
    drag = np.tile(ROTOR_SPINS, len(at.p)) * module.torque_coefficient / module.thrust_coefficient
    return np.concatenate([z, np.cross(o, z) + drag[:, None] * z], axis=1).T


def allocator_file(design: Design, acts: Allocation) -> str:
    """Return the text of a kit's `allocator.py`: the source of `export.allocator` with the data of a platform.

    Args:
        design: the design.
        acts: how its rotors act on it.
    """
    module, weight = design.task.module, acts.mass_kg * design.task.gravity
    data = {
        "PLATFORM": f"{design.task.name}, {design.topology.key}",
        "NAMES": tuple(rotor.name for rotor in acts.rotors),
        "MATRIX": acts.thrust_matrix,
        "LEAST": tuple(rotor.thrust_coefficient * acts.least_input for rotor in acts.rotors),
        "LARGEST": tuple(rotor.largest_thrust_N for rotor in acts.rotors),
        "SCALE": (1 / weight,) * 3 + (TORQUE_FIRST / (module.arm_length * weight),) * 3,
        "FULL": module.thrust_coefficient * acts.largest_input,
        "WEIGHT": weight,
        "THRUST_COEFFICIENT": module.thrust_coefficient,
    }

    def value(line: re.Match[str]) -> str:
        return f"{line[1]} = {pformat(data[line[2]], width=110, compact=True)}"

    source = Path(allocator.__file__).read_text(encoding="utf-8")
    return re.sub(rf"^(({'|'.join(data)}): [^=\n]+) = .*$", value, source, flags=re.MULTILINE)

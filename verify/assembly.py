"""The assembly sheet: which connector to which, at which angle, and the rod from its mount to the end-effector."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from topo_search.model import (
    Assembly,
    BoltedJoint,
    Design,
    EndEffectorSheet,
    FreeConnector,
    Mount,
    Residual,
    Rod,
    Status,
)
from topo_search.model.room import LARGE, packed_width
from topo_search.model.value import Vector
from verify.bodies import Array
from verify.kinematics import PORT_DIRECTIONS, Platform, platform
from verify.parts import RigidParts, rigid_parts
from verify.residuals import finite
from verify.rod import free_connectors, straight_rod

NO_ROD = "no straight rod reaches the end-effector: every free connector is blocked"
IN_AIRFLOW = "no straight rod that reaches the end-effector is clear of all airflow"
HEAVY = 0.05
"""Share of the platform's mass from which a rod's, which the model leaves out, is told."""
LOST = "positions are too large, or parts too thin, to tell which connectors a straight rod reaches from"


def assembly(design: Design, found: Platform, parts: RigidParts) -> Assembly:
    """Return the sheet; a design's own mount stands, otherwise it is the nearest available connector."""
    joints = tuple(
        BoltedJoint(module=h, port=a, child=i, child_port=b, angle_deg=finite(math.degrees(alpha)))
        for (h, i, a, b), alpha in zip(design.topology.edges(), design.hinge_angles_rad, strict=True)
    )
    connectors = free_connectors(design, parts)
    mount = design.mount or nearest_available(connectors)
    rod = _rod(design, parts, mount) if mount is not None and parts.in_range else None
    of_rod = () if rod is None else (_long(design, rod), _heavy(design, rod, found))
    notes = (_note(parts, mount, connectors), *of_rod)
    sheet = EndEffectorSheet(
        position_m=design.end_effector_m,
        from_com_m=_vector(found.p_e),
        mount=mount,
        rod=rod,
        note="; ".join(note for note in notes if note) or None,
        connectors=connectors,
    )
    return Assembly(joints=joints, end_effector=sheet)


def nearest_available(connectors: tuple[FreeConnector, ...]) -> Mount | None:
    """Return the first connector from which a rod is clear of parts and airflow, else of parts alone, if any.

    They come shortest rod first.
    """
    unblocked = [connector for connector in connectors if not connector.blocked_by]
    free = next((connector for connector in unblocked if not connector.in_airflow_of), next(iter(unblocked), None))
    return None if free is None else Mount(module=free.module, port=free.port)


def choose_mount(design: Design) -> Mount | None:
    """Return the connector of the shortest straight rod to the end-effector: clear of airflow too, if any is."""
    return nearest_available(free_connectors(design, rigid_parts(design, platform(design))))


def rod_residuals(design: Design, parts: RigidParts, sheet: Assembly) -> Iterator[Residual]:
    """Yield whether a straight rod reaches the end-effector, where the task asks for one."""
    if design.task.end_effector.rod == "straight":
        missing = 0.0 if sheet.mount is not None and parts.in_range else 1.0
        lost = Status.VIOLATED if parts.in_range else Status.UNDECIDED
        status = lost if missing else Status.CLEAR
        yield Residual(
            name="straight rod to the end-effector",
            value=missing,
            unit="rods missing",
            scaled=missing,
            tolerance=0.0,
            status=status,
        )


def _rod(design: Design, parts: RigidParts, mount: Mount) -> Rod:
    """Return the rod from a mount; of no length, it points as the connector does."""
    end_effector, l_arm = design.task.end_effector, design.task.module.arm_length
    rod = straight_rod(design, parts, mount)
    R = parts.R[mount.module]
    in_module = R.T @ rod.path / rod.length if rod.length > 0 else PORT_DIRECTIONS[mount.port]
    length = rod.length * l_arm
    return Rod(
        length_m=length,
        radius_m=end_effector.rod_radius,
        mass_kg=end_effector.rod_linear_density * length,
        direction=_vector(R @ in_module),
        direction_in_module=_vector(in_module),
    )


def _note(parts: RigidParts, mount: Mount | None, connectors: tuple[FreeConnector, ...]) -> str | None:
    if not parts.in_range:
        return LOST
    if mount is None:
        return NO_ROD
    chosen = next(c for c in connectors if (c.module, c.port) == (mount.module, mount.port))
    obstacles = ", ".join(f"{obstacle.part} of module {obstacle.module}" for obstacle in chosen.blocked_by)
    if obstacles:
        return f"the stated mount is blocked by {obstacles}"
    if not chosen.in_airflow_of:
        return None
    through = f"the rod is in the airflow of module{'s' * (len(chosen.in_airflow_of) > 1)} "
    through += ", ".join(map(str, chosen.in_airflow_of))
    clear = any(not connector.blocked_by and not connector.in_airflow_of for connector in connectors)
    return through if clear else f"{through}: {IN_AIRFLOW}"


def _long(design: Design, rod: Rod) -> str | None:
    """Say so if a rod is far longer than the platform that carries it is wide."""
    n = design.topology.n
    width = packed_width(design.task.module, n)
    if rod.length_m <= LARGE * width:
        return None
    times = f"{rod.length_m / width:.0f} times the width of {n} modules in a square"
    return f"the rod is {rod.length_m:.3g} m long, {times}"


def _heavy(design: Design, rod: Rod, found: Platform) -> str | None:
    """Say what a heavy rod changes: masses of the model are those of the modules and of the end-effector."""
    task = design.task
    share = rod.mass_kg / task.total_mass(task.n)
    if share < HEAVY:
        return None
    middle = found.p_e - rod.length_m / 2 * np.array(rod.direction)
    weight = rod.mass_kg * task.gravity
    torque = weight * float(np.hypot(middle[0], middle[1]))
    left_out = f"the rod, {100 * share:.3g} % of the platform's mass, is left out of the model"
    return f"{left_out}: {weight:.3g} N, and {torque:.3g} N m about the centre of mass"


def _vector(v: Array) -> Vector:
    x, y, z = (finite(float(value)) for value in v)
    return x, y, z

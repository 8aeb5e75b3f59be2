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
    Obstacle,
    Residual,
    Rod,
    Status,
)
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.proven import TOLERANCE
from topo_search.model.room import LARGE, packed_width
from topo_search.model.value import Vector
from verify.bodies import Array, ConeSpheres, rowwise_clearances
from verify.certificate import FLOOR
from verify.compounds import proximities
from verify.contacts import rod_keeps_out
from verify.parts import FIT, StraightRod
from verify.requirements import Scene
from verify.residuals import clamp, residual


def assembly(scene: Scene) -> Assembly:
    """Return the sheet; a design's own mount stands, otherwise it is the best available connector."""
    design = scene.design
    joints = tuple(
        BoltedJoint(module=h, port=a, child=i, child_port=b, angle_deg=clamp(math.degrees(alpha)))
        for (h, i, a, b), alpha in zip(design.topology.edges(), design.hinge_angles_rad, strict=True)
    )
    connectors = free_connectors(scene)
    mount = design.mount or best_available(connectors, scene)
    rod = _rod(scene, mount) if mount is not None and scene.in_range else None
    of_rod = () if rod is None else (_remark_length(design, rod), _remark_mass(scene, rod))
    notes = (_note(scene, mount, connectors), *of_rod)
    sheet = EndEffectorSheet(
        position_m=design.end_effector_m,
        from_com_m=_vector(scene.platform.p_e),
        mount=mount,
        rod=rod,
        note="; ".join(note for note in notes if note) or None,
        connectors=connectors,
    )
    return Assembly(joints=joints, end_effector=sheet)


def best_available(connectors: tuple[FreeConnector, ...], scene: Scene) -> Mount | None:
    """Return the connector of the shortest rod that is clear of parts, airflow and solid regions.

    If there is none, the shortest that is clear of parts and airflow, else of parts alone, if any. Connectors come
    shortest rod first.
    """
    unblocked = [connector for connector in connectors if not connector.blocked_by]
    clear = [connector for connector in unblocked if not connector.in_airflow_of] or unblocked
    mounts = [Mount(module=connector.module, port=connector.port) for connector in clear]
    outside = (mount for mount in mounts if rod_keeps_out(scene, mount))
    return next(outside, next(iter(mounts), None))


def choose_mount(design: Design) -> Mount | None:
    """Return the connector from which a straight rod to the end-effector is best, as `best_available` says.

    Of connectors that differ in the rod's length alone, the one whose rod the design counts stays.
    """
    scene, kept = Scene(design), design.mount and (design.mount.module, design.mount.port)
    connectors = sorted(free_connectors(scene), key=lambda one: (one.module, one.port) != kept)
    return best_available(tuple(connectors), scene)


def rod_residuals(scene: Scene, sheet: Assembly) -> Iterator[Residual]:
    """Yield whether a straight rod reaches the end-effector, and from near enough, where the task asks for it."""
    design = scene.design
    if design.task.end_effector.rod == "straight":
        missing = 0.0 if sheet.mount is not None and scene.in_range else 1.0
        lost = None if scene.in_range else Status.UNDECIDED
        name = "straight rod to the end-effector"
        yield residual(name, missing, "rods missing", 1.0, tolerance=0.0, status=lost)

    reach = design.task.largest_reach(design.topology.n)
    if reach is not None:
        yield _reach(scene, sheet, reach)
    if design.task.end_effector.rod_mass == "included" and sheet.end_effector is not None:
        yield _rod_mass(design, sheet.end_effector.rod)


def _rod_mass(design: Design, rod: Rod | None) -> Residual:
    """Return by how much the rod weighs more or less than the design counts with."""
    counted = design.task.end_effector.counted_rod
    given, weighs = 0.0 if counted is None else counted.mass, 0.0 if rod is None else rod.mass_kg
    name, total = "mass of the end-effector's rod", design.task.total_mass(design.topology.n)
    return residual(name, abs(weighs - given), "kg", total, claim=given, derived=weighs)


def _reach(scene: Scene, sheet: Assembly, reach: float) -> Residual:
    """Return by how much the end-effector is too far from the connector that holds its rod.

    Without a rod that is the nearest free one; a platform without free connectors holds none.
    """
    l_arm, free = scene.l_arm, scene.design.topology.free_connectors
    mounts = [sheet.mount] if sheet.mount is not None else [Mount(module=i, port=port) for i, port in free]
    lengths = [scene.straight_rod(mount).length * l_arm for mount in mounts] if scene.in_range else []
    excess = max(0.0, min(lengths) - reach) if lengths else 0.0
    name, length = "reach of the end-effector's rod", min(lengths, default=None)
    unknown = None if lengths else Status.UNDECIDED
    return residual(name, excess, "m", l_arm, tolerance=TOLERANCE, claim=reach, derived=length, status=unknown)


def _rod(scene: Scene, mount: Mount) -> Rod:
    """Return the rod from a mount; of no length, it points as the connector does."""
    end_effector, rod, R = scene.design.task.end_effector, scene.straight_rod(mount), scene.R[mount.module]
    in_module = R.T @ rod.path / rod.length if rod.length > 0 else PORT_DIRECTIONS[mount.port]
    length = rod.length * scene.l_arm
    return Rod(
        length_m=length,
        radius_m=end_effector.rod_radius,
        mass_kg=end_effector.rod_linear_density * length,
        direction=_vector(R @ in_module),
        direction_in_module=_vector(in_module),
    )


def _note(scene: Scene, mount: Mount | None, connectors: tuple[FreeConnector, ...]) -> str | None:
    if not scene.in_range:
        return "positions are too large, or parts too thin, to tell which connectors a straight rod reaches from"
    if mount is None:
        return "no straight rod reaches the end-effector: every free connector is blocked"
    chosen = next(c for c in connectors if (c.module, c.port) == (mount.module, mount.port))
    obstacles = ", ".join(f"{obstacle.part} of module {obstacle.module}" for obstacle in chosen.blocked_by)
    if obstacles:
        return f"the stated mount is blocked by {obstacles}"
    if not chosen.in_airflow_of:
        return None
    through = f"the rod is in the airflow of module{'s' * (len(chosen.in_airflow_of) > 1)} "
    through += ", ".join(map(str, chosen.in_airflow_of))
    clear = any(not connector.blocked_by and not connector.in_airflow_of for connector in connectors)
    return through if clear else f"{through}: no straight rod that reaches the end-effector is clear of all airflow"


def _remark_length(design: Design, rod: Rod) -> str | None:
    """Say so if a rod is far longer than the platform that carries it is wide."""
    n = design.topology.n
    width = packed_width(design.task.module, n)
    if rod.length_m <= LARGE * width:
        return None
    times = f"{rod.length_m / width:.0f} times the width of {n} modules in a square"
    return f"the rod is {rod.length_m:.3g} m long, {times}"


def _remark_mass(scene: Scene, rod: Rod) -> str | None:
    """Say what a heavy rod changes that the model ignores."""
    task = scene.design.task
    share = rod.mass_kg / task.total_mass(task.n)
    if share < 0.05 or task.end_effector.rod_mass == "included":  # less is as good as nothing
        return None
    middle = scene.platform.p_e - rod.length_m / 2 * np.array(rod.direction)
    weight = rod.mass_kg * task.gravity
    torque = weight * float(np.hypot(middle[0], middle[1]))
    left_out = f"the rod, {100 * share:.3g} % of the platform's mass, is left out of the model"
    return f"{left_out}: {weight:.3g} N, and {torque:.3g} N m about the centre of mass"


def _vector(v: Array) -> Vector:
    x, y, z = (clamp(float(value)) for value in v)
    return x, y, z


def free_connectors(scene: Scene) -> tuple[FreeConnector, ...]:
    """Return every free connector with what blocks a straight rod from it, shortest rod first.

    A rod that is too near to a part to tell counts as blocked; where coordinates have lost their digits nothing is
    known of any connector.
    """
    if not scene.in_range:
        return ()
    mounts = [Mount(module=i, port=port) for i, port in scene.design.topology.free_connectors]
    rods = sorted(map(scene.straight_rod, mounts), key=lambda rod: round(rod.length, FIT.digits))
    near = [
        (rod, i, beside) for rod in rods for i in _near(rod, scene) if (beside := rod.body_beside(i)) is not None
    ]
    pairs = [(scene.modules[i], beside) for _, i, beside in near]
    blocked: dict[Mount, list[Obstacle]] = {}
    for (rod, i, _), proximity in zip(near, proximities(pairs, [False] * len(pairs), measured=False), strict=True):
        if proximity.d <= FLOOR:
            obstacle = Obstacle(module=i, part=scene.modules[i].parts[proximity.a].name)
            blocked.setdefault(rod.mount, []).append(obstacle)
    return tuple(
        FreeConnector(
            module=rod.mount.module,
            port=rod.mount.port,
            length_m=rod.length * scene.l_arm,
            blocked_by=tuple(blocked.get(rod.mount, ())),
            in_airflow_of=tuple(through),
        )
        for rod, through in zip(rods, _in_airflow(scene, rods), strict=True)
    )


def _in_airflow(scene: Scene, rods: list[StraightRod]) -> list[list[int]]:
    """Return the modules whose airflow each rod passes through, or is too near to to tell; its own one's too."""
    if not rods:
        return []
    each, passed = np.indices((len(rods), len(scene.envelopes))).reshape(2, -1)
    airflow, straight = (
        ConeSpheres.of([one.body for one in some]) for some in (scene.envelopes, [r.solid for r in rods])
    )
    d = rowwise_clearances(airflow.take(passed), straight.take(each)).d.reshape(len(rods), -1)
    return [np.flatnonzero(~(row > FLOOR)).tolist() for row in d]


def _near(rod: StraightRod, scene: Scene) -> list[int]:
    """Return the modules whose bounding ball comes near a rod; the others cannot block it."""
    from_start = scene.centres - rod.start
    t = np.clip(from_start @ rod.path / (rod.length**2 or 1.0), 0.0, 1.0)
    apart = np.linalg.norm(from_start - t[:, None] * rod.path, axis=1)
    return np.flatnonzero(apart <= scene.body.reach + rod.radius + FLOOR).tolist()

"""The assembly sheet: joints with their ports and angles, and the rod from its mount to the end-effector."""

import math
from collections.abc import Iterator

import numpy as np

from topo_search.model import PORT_DIRECTIONS, Array, Design, Mount, Residual, Status, Vector
from topo_search.model.assembly import Assembly, BoltedJoint, EndEffectorSheet, FreeConnector, Obstacle, Rod
from topo_search.model.proven import TOLERANCE
from topo_search.model.room import LARGE, packed_width
from verify.bodies import ConeSpheres, rowwise_clearances
from verify.certificate import FLOOR
from verify.compounds import proximities
from verify.kinematics import Platform
from verify.parts import FIT, StraightRod
from verify.requirements import Scene
from verify.residuals import clamp, residual
from verify.sections import Findings
from verify.solid_regions import rod_keeps_out


def assembly(scene: Scene) -> Assembly:
    """Return the assembly sheet, with the design's own mount or else the best available connector."""
    design = scene.design
    joints = tuple(
        BoltedJoint(module=h, port=a, child=i, child_port=b, angle_deg=clamp(math.degrees(alpha)))
        for (h, a, i, b), alpha in design.bolts
    )
    connectors = free_connectors(scene)
    mount = design.mount or best_available(connectors, scene)
    rod = _rod(scene, mount) if mount is not None and scene.in_range else None
    notes = [_mount_note(scene, mount, connectors)]
    if rod is not None:
        notes += [_length_note(design, rod), _bending_note(scene, rod), _mass_note(scene, rod)]
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
    """Return the connector with the shortest rod along its axis that is clear of parts, airflow and solid regions.

    Failing that, the shortest such rod at any angle, then one that is clear of parts and airflow, then of parts
    only. `connectors` are sorted by rod length.
    """
    unblocked = [connector for connector in connectors if not connector.blocked_by]
    clear = [connector for connector in unblocked if not connector.in_airflow_of] or unblocked
    mounts = [Mount(module=connector.module, port=connector.port) for connector in clear]
    # rods within the tolerance are alike; rounded, so that a design and its mirror image choose the same connector
    mounts.sort(key=lambda m: round(max(TOLERANCE, _axis_angles(scene, _rod(scene, m))[0]), FIT.digits))
    outside = (mount for mount in mounts if rod_keeps_out(scene, mount))
    return next(outside, next(iter(mounts), None))


def choose_mount(design: Design) -> Mount | None:
    """Return the best connector for a straight rod to the end-effector, as `best_available` defines it.

    Among connectors with the same clearance the design's own mount wins, whatever its rod's length.
    """
    scene, own_mount = Scene(design), design.mount and (design.mount.module, design.mount.port)
    connectors = sorted(free_connectors(scene), key=lambda c: (c.module, c.port) != own_mount)
    return best_available(tuple(connectors), scene)


def rod_residuals(found: Findings) -> Iterator[Residual]:
    """Yield the residuals of the rod that the task requires: its existence, length, direction and mass."""
    scene, sheet, design = found.scene, found.sheet, found.scene.design
    if design.task.end_effector.rod == "straight":
        missing = 0.0 if sheet.mount is not None and scene.in_range else 1.0
        status = None if scene.in_range else Status.UNDECIDED
        name = "straight rod to the end-effector"
        yield residual(name, missing, "rods missing", 1.0, tolerance=0.0, status=status)

    reach = design.task.largest_reach(design.topology.n)
    if reach is not None:
        yield _reach_residual(scene, sheet, reach)
    if design.task.rod_axis is not None and sheet.end_effector is not None and sheet.end_effector.rod is not None:
        excess, angle = map(math.degrees, _axis_angles(scene, sheet.end_effector.rod))
        limit = design.task.end_effector.largest_angle_deg
        yield residual("rod-axis", excess, "deg", math.degrees(1.0), claim=limit, derived=angle)
    if design.task.end_effector.rod_mass == "included" and sheet.end_effector is not None:
        yield _mass_residual(design, sheet.end_effector.rod)


def _mass_residual(design: Design, rod: Rod | None) -> Residual:
    """Return the difference between the rod's mass and the mass that the task counts."""
    counted = design.task.end_effector.counted_rod
    claim, mass = 0.0 if counted is None else counted.mass, 0.0 if rod is None else rod.mass_kg
    name, total = "mass of the end-effector's rod", design.task.total_mass(design.topology.n)
    return residual(name, abs(mass - claim), "kg", total, claim=claim, derived=mass)


def _reach_residual(scene: Scene, sheet: Assembly, reach: float) -> Residual:
    """Return the excess of the rod's length over the reach; without a rod, from the nearest free connector."""
    l_arm, free = scene.l_arm, scene.design.topology.free_connectors
    mounts = [sheet.mount] if sheet.mount is not None else [Mount(module=i, port=port) for i, port in free]
    lengths = [scene.straight_rod(mount).length * l_arm for mount in mounts] if scene.in_range else []
    excess = max(0.0, min(lengths) - reach) if lengths else 0.0
    name, length = "reach of the end-effector's rod", min(lengths, default=None)
    status = None if lengths else Status.UNDECIDED
    return residual(name, excess, "m", l_arm, claim=reach, derived=length, status=status)


def _rod(scene: Scene, mount: Mount) -> Rod:
    """Return the rod from a mount; a rod of length zero points along the connector."""
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


def _axis_angles(scene: Scene, rod: Rod) -> tuple[float, float]:
    """Return the excess of the angle between a rod and its axis over the largest one, and the angle [rad]."""
    task = scene.design.task
    if task.rod_axis is None:
        return 0.0, 0.0
    v, axis = np.array(rod.direction), np.array(task.rod_axis)
    angle = math.atan2(float(np.linalg.norm(np.cross(v, axis))), float(v @ axis))
    return max(0.0, angle - math.radians(task.end_effector.largest_angle_deg)), angle


def _mount_note(scene: Scene, mount: Mount | None, connectors: tuple[FreeConnector, ...]) -> str | None:
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


def _length_note(design: Design, rod: Rod) -> str | None:
    """Return a note if a rod is far longer than its platform is wide."""
    n = design.topology.n
    width = packed_width(design.task.longest_connector, n)
    if rod.length_m <= LARGE * width:
        return None
    times = f"{rod.length_m / width:.0f} times the width of {n} modules in a square"
    return f"the rod is {rod.length_m:.3g} m long, {times}"


def _bending_note(scene: Scene, rod: Rod) -> str | None:
    """Return a note if a required rod is longer than one that is as stiff as the task states."""
    task = scene.design.task
    stiff_length, tip = task.stiff_length(task.n), task.end_effector
    is_limited = (task.largest_reach(task.n) or math.inf) <= stiff_length
    if tip.rod == "none" or is_limited or rod.length_m <= stiff_length:
        return None
    bends = f"bends by more than rod_deflection = {1000 * tip.rod_deflection:g} mm"
    load = "under the largest load of the task and its own weight"
    return f"the rod of {rod.length_m:.3g} m {bends} {load}; one of up to {stiff_length:.3g} m does not"


def _mass_note(scene: Scene, rod: Rod) -> str | None:
    """Return a note on the weight and torque of a heavy rod whose mass the model ignores."""
    task = scene.design.task
    share = rod.mass_kg / task.total_mass(task.n)
    if share < 0.05 or task.end_effector.rod_mass == "included":  # smaller shares are negligible
        return None
    weight, torque = rod.mass_kg * task.gravity, rod_moment(rod, scene.platform, task.gravity)
    omission = f"the rod, {100 * share:.3g} % of the platform's mass, is left out of the model"
    return f"{omission}: {weight:.3g} N, and {torque:.3g} N m about the centre of mass"


def rod_moment(rod: Rod, platform: Platform, gravity: float) -> float:
    """Return the moment of a rod's weight about the centre of mass [N m]."""
    x, y, _ = platform.p_e - rod.length_m / 2 * np.array(rod.direction)
    return clamp(rod.mass_kg * gravity * math.hypot(x, y))


def _vector(v: Array) -> Vector:
    x, y, z = (clamp(float(value)) for value in v)
    return x, y, z


def free_connectors(scene: Scene) -> tuple[FreeConnector, ...]:
    """Return every free connector with the obstacles of a straight rod from it, sorted by rod length.

    A rod too close to a part to decide counts as blocked. The result is empty if coordinates are too large.
    """
    if not scene.in_range:
        return ()
    mounts = [Mount(module=i, port=port) for i, port in scene.design.topology.free_connectors]
    rods = sorted(map(scene.straight_rod, mounts), key=lambda rod: round(rod.length, FIT.digits))
    candidates = [
        (rod, i, body)
        for rod in rods
        for i in _nearby_modules(rod, scene)
        if (body := rod.body_beside(i)) is not None
    ]
    pairs = [(scene.modules[i], body) for _, i, body in candidates]
    results = proximities(pairs, [False] * len(pairs), measured=False)
    blocked: dict[Mount, list[Obstacle]] = {}
    for (rod, i, _), proximity in zip(candidates, results, strict=True):
        if proximity.d <= FLOOR:
            obstacle = Obstacle(module=i, part=scene.modules[i].parts[proximity.a].name)
            blocked.setdefault(rod.mount, []).append(obstacle)
    return tuple(
        FreeConnector(
            module=rod.mount.module,
            port=rod.mount.port,
            length_m=rod.length * scene.l_arm,
            blocked_by=tuple(blocked.get(rod.mount, ())),
            in_airflow_of=tuple(sources),
        )
        for rod, sources in zip(rods, _airflow_sources(scene, rods), strict=True)
    )


def _airflow_sources(scene: Scene, rods: list[StraightRod]) -> list[list[int]]:
    """Return the modules, its own included, whose airflow each rod passes through or comes too close to."""
    if not rods:
        return []
    rod_index, number = np.indices((len(rods), len(scene.envelopes))).reshape(2, -1)
    airflow = ConeSpheres.of([air.body.body for air in scene.envelopes]).take(number)
    bodies = ConeSpheres.of([rod.round_body.body for rod in rods]).take(rod_index)
    modules = np.array([air.module for air in scene.envelopes])
    d = rowwise_clearances(airflow, bodies).d.reshape(len(rods), -1)
    return [np.unique(modules[~(row > FLOOR)]).tolist() for row in d]


def _nearby_modules(rod: StraightRod, scene: Scene) -> list[int]:
    """Return the modules whose bounding ball meets a rod; the others cannot block it."""
    from_start = scene.centres - rod.start
    t = np.clip(from_start @ rod.path / (rod.length**2 or 1.0), 0.0, 1.0)
    distance = np.linalg.norm(from_start - t[:, None] * rod.path, axis=1)
    reach = np.array([body.reach for body in scene.bodies])
    return np.flatnonzero(distance <= reach + rod.radius + FLOOR).tolist()

"""The rigid parts of a platform, in the audit's coordinates: hub, arms, rotor discs, and the rod.

Module frame: the hub a box about the centre; four arms, boxes from the centre to the rotors (X layout); four rotor
discs, cylinders about the rotors, at the height of the centre. Sizes are those of `[module.body]`; convex pieces of
the user may stand in place of hub and arms.

A straight rod from a free connector carries the end-effector.

| symbol | meaning | shape |
|---|---|---|
| c | a free connector, o_i + l_c R_i e_a | (3,) |
| p_E | the end-effector | (3,) |
| r | radius of the rod, a capsule from c to p_E | |

A rod is bolted on by its first two radii, which may touch the module that carries it; the rest may touch nothing.
Lengths are in l_arm and positions relative to the mean of the module centres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from topo_search.model import Design, FreeConnector, Module, Mount, Obstacle
from topo_search.model.arrays import PORT_DIRECTIONS, ROTOR_DIRECTIONS
from verify.bodies import Array, Rows, clearances_of
from verify.certificate import FLOOR
from verify.compounds import Compound, proximities
from verify.convex import Convex, Polyhedron, box, capsule, cylinder
from verify.kinematics import Platform
from verify.meshes import FARTHEST

UP = np.array([0.0, 0.0, 1.0])


def module_parts(module: Module) -> tuple[tuple[Convex, ...], tuple[Convex, ...]]:
    """Return the frame (hub and arms) and the rotors of a module, in its own frame [l_arm]."""
    body, l_arm = module.body, module.arm_length
    width, radius, height = body.arm_width / l_arm, body.rotor_radius / l_arm, body.rotor_height / l_arm
    rotors = tuple(cylinder(f"rotor {q}", along, UP, radius, height) for q, along in enumerate(ROTOR_DIRECTIONS))
    if body.frame is not None:
        surfaces = [(np.array(piece.vertices) / l_arm, np.array(piece.triangles)) for piece in body.frame]
        return tuple(Polyhedron(f"frame {k}", *surface) for k, surface in enumerate(surfaces)), rotors
    hub = box("hub", np.zeros(3), np.diag(body.hub) / l_arm / 2)
    arms = [
        box(f"arm {q}", along / 2, np.stack([along, width * np.cross(UP, along), width * UP]) / 2)
        for q, along in enumerate(ROTOR_DIRECTIONS)
    ]
    return (hub, *arms), rotors


def bounding_box(parts: tuple[Convex, ...]) -> Convex:
    """Return the box along the axes of the frame that encloses some parts."""
    high, low = np.zeros(3), np.zeros(3)
    for k, axis in enumerate(np.eye(3)):
        high[k] = max(part.support(axis) for part in parts)
        low[k] = -max(part.support(-axis) for part in parts)
    return box("bounds", (low + high) / 2, np.diag(high - low) / 2)


@dataclass(frozen=True, eq=False)
class RigidParts:
    """All modules of a design, as rigid bodies."""

    modules: tuple[Compound, ...]
    centres: Array
    """Centres of the modules, shape (n, 3)."""
    R: Array
    """Orientations of the modules, shape (n, 3, 3)."""
    p_E: Array
    """The end-effector, shape (3,)."""
    module_parts: tuple[Convex, ...]
    """The parts of every module in its own frame, rotors last."""
    reach: float
    """Every module lies in the ball of this radius around its centre."""

    @property
    def in_range(self) -> bool:
        """True if all coordinates keep the digits that a proof needs."""
        return all(module.in_range for module in self.modules) and bool(np.all(np.abs(self.p_E) < FARTHEST / 16))


def rigid_parts(design: Design, platform: Platform) -> RigidParts:
    """Return the rigid parts of a design."""
    l_arm = design.task.module.arm_length
    middle = platform.o.mean(axis=0)
    centres = (platform.o - middle) / l_arm
    frame, rotors = module_parts(design.task.module)
    parts = frame + rotors
    bounds = bounding_box(parts)
    modules = tuple(
        Compound(tuple(part.place(R, o) for part in parts), bounds.place(R, o), len(frame))
        for R, o in zip(platform.poses.R, centres, strict=True)
    )
    reach = max(part.reach for part in parts)
    return RigidParts(modules, centres, platform.poses.R, (platform.p_e - middle) / l_arm, parts, reach)


class RodFit(NamedTuple):
    """Where rods of connectors fit."""

    digits: int = 9
    """Lengths equal to as many decimals are equal: the first connector in order stands before its mirror images."""
    socket: float = 2.0
    """Length over which a rod is fixed to its mount, in radii of the rod."""


FIT = RodFit()


@dataclass(frozen=True, eq=False)
class StraightRod:
    """A rod from a free connector to the end-effector."""

    mount: Mount
    start: Array
    """c, shape (3,)."""
    path: Array
    """From the connector to the end-effector, shape (3,)."""
    radius: float
    """r."""

    @property
    def length(self) -> float:
        """Length of its axis."""
        return float(np.linalg.norm(self.path))

    def body_beside(self, module: int) -> Compound | None:
        """Return what must not touch a module: all of it, or what is beyond the fitting; None if nothing is."""
        fitting = FIT.socket * self.radius if module == self.mount.module else 0.0
        if self.length < fitting or fitting == self.length > 0:
            return None
        skipped = fitting / self.length if fitting else 0.0
        rod = capsule("rod", self.start + skipped * self.path, self.start + self.path, self.radius)
        return Compound((rod,), rod)


def straight_rod(design: Design, parts: RigidParts, mount: Mount) -> StraightRod:
    """Return the rod from a free connector."""
    module = design.task.module
    l_c, radius = (x / module.arm_length for x in (module.connector_distance, design.task.end_effector.rod_radius))
    start = parts.centres[mount.module] + l_c * parts.R[mount.module] @ PORT_DIRECTIONS[mount.port]
    return StraightRod(mount, start, parts.p_E - start, radius)


def free_connectors(design: Design, parts: RigidParts) -> tuple[FreeConnector, ...]:
    """Return every free connector with what blocks a straight rod from it, shortest rod first.

    A rod that is too near to a part to tell counts as blocked; where coordinates have lost their digits nothing is
    known of any connector.
    """
    if not parts.in_range:
        return ()
    mounts = [Mount(module=i, port=port) for i, port in design.topology.free_connectors]
    rods = sorted(
        (straight_rod(design, parts, mount) for mount in mounts), key=lambda rod: round(rod.length, FIT.digits)
    )
    near = [
        (rod, i, beside) for rod in rods for i in _near(rod, parts) if (beside := rod.body_beside(i)) is not None
    ]
    pairs = [(parts.modules[i], beside) for _, i, beside in near]
    blocked: dict[Mount, list[Obstacle]] = {}
    for (rod, i, _), proximity in zip(near, proximities(pairs, [False] * len(pairs), measured=False), strict=True):
        if proximity.d <= FLOOR:
            obstacle = Obstacle(module=i, part=parts.modules[i].parts[proximity.a].name)
            blocked.setdefault(rod.mount, []).append(obstacle)
    l_arm = design.task.module.arm_length
    return tuple(
        FreeConnector(
            module=rod.mount.module,
            port=rod.mount.port,
            length_m=rod.length * l_arm,
            blocked_by=tuple(blocked.get(rod.mount, ())),
            in_airflow_of=tuple(through),
        )
        for rod, through in zip(rods, _in_airflow(design, parts, rods), strict=True)
    )


def _in_airflow(design: Design, parts: RigidParts, rods: list[StraightRod]) -> list[list[int]]:
    """Return the modules whose airflow each rod passes through, or is too near to to tell; its own one's too."""
    if not rods:
        return []
    envelope, l_arm, n = design.task.module.envelope, design.task.module.arm_length, len(parts.centres)
    m, blown = len(rods), -envelope.length / l_arm * parts.R[:, :, 2]
    start, path = (np.repeat([getattr(rod, name) for rod in rods], n, axis=0) for name in ("start", "path"))
    thick = np.array([rod.radius for rod in rods for _ in range(n)])
    r, dr = (np.full(m * n, x / l_arm) for x in (envelope.start_radius, envelope.growth))
    airflow = Rows(np.tile(parts.centres, (m, 1)), np.tile(blown, (m, 1)), r, dr)
    d = clearances_of(airflow, Rows(start, path, thick, np.zeros(m * n))).d.reshape(m, n)
    return [np.flatnonzero(~(row > FLOOR)).tolist() for row in d]


def _near(rod: StraightRod, parts: RigidParts) -> list[int]:
    """Return the modules whose bounding ball comes near a rod; the others cannot block it."""
    from_start = parts.centres - rod.start
    t = np.clip(from_start @ rod.path / (rod.length**2 or 1.0), 0.0, 1.0)
    apart = np.linalg.norm(from_start - t[:, None] * rod.path, axis=1)
    return np.flatnonzero(apart <= parts.reach + rod.radius + FLOOR).tolist()

"""The straight rod that carries the end-effector, and the connectors that it may start from.

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

from topo_search.model import Design, FreeConnector, Mount, Obstacle
from topo_search.model.arrays import PORT_DIRECTIONS
from verify.bodies import Array, Rows
from verify.certificate import FLOOR
from verify.clearance import clearances_of
from verify.compounds import Compound, proximities
from verify.convex import capsule
from verify.parts import RigidParts


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

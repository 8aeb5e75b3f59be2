"""The rigid parts of a platform, in the audit's coordinates: hub, arms, rotor discs, and the rod.

In the module frame, the hub is a box about the centre, the arms are boxes from the centre to the rotors, and the
rotor discs are cylinders about the rotors, across their axes. Sizes are those of the body of the module's type; the
user's convex pieces may replace hub and arms.

A straight rod from a free connector carries the end-effector.

| symbol | meaning | shape |
|---|---|---|
| c | a free connector, o_i + l_c R_i e_a, with the module's own l_c | (3,) |
| p_E | the end-effector | (3,) |
| r | radius of the rod, a capsule from c to p_E | |

The fitting, the first two radii of the rod, may touch the module that carries it; the rest may touch nothing.
Lengths are in the l_arm of `[module]` and positions relative to the mean of the module centres.
"""

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Module, Mount
from verify.bodies import ConeSphere
from verify.certificate import RoundBody
from verify.compounds import Compound
from verify.convex import Convex, Polyhedron, box, capsule, cylinder


@functools.lru_cache(maxsize=32)
def module_body(module: Module, l_arm: float) -> Compound:
    """Return a module's rigid body in its own frame: hub and arms, which form the frame, then rotors [l_arm]."""
    frame, rotors = module_parts(module, l_arm)
    return Compound(frame + rotors, bounding_box(frame + rotors), len(frame))


def module_parts(module: Module, l_arm: float | None = None) -> tuple[tuple[Convex, ...], tuple[Convex, ...]]:
    """Return the frame (hub and arms) and the rotors of a module, in its own frame [l_arm, default: its own]."""
    body, l_arm = module.body, l_arm or module.arm_length
    width, height = body.arm_width / l_arm, body.rotor_height / l_arm
    table, scale = module.rotor_table, module.arm_length / l_arm
    discs = enumerate(zip(scale * table.positions, table.axes, module.rotor_radii / l_arm, strict=True))
    rotors = tuple(cylinder(f"rotor {q}", centre, axis, radius, height) for q, (centre, axis, radius) in discs)
    if body.frame is not None:
        surfaces = [(np.array(piece.vertices) / l_arm, np.array(piece.triangles)) for piece in body.frame]
        return tuple(Polyhedron(f"frame {k}", *surface) for k, surface in enumerate(surfaces)), rotors
    hub = box("hub", np.zeros(3), np.diag(body.hub) / l_arm / 2)
    arms = [
        box(f"arm {q}", length * axes[0] / 2, np.array([length, width, width])[:, None] * axes / 2)
        for q, (axes, length) in enumerate(table.arms(scale))
    ]
    return (hub, *arms), rotors


def bounding_box(parts: tuple[Convex, ...]) -> Convex:
    """Return the axis-aligned bounding box of parts."""
    high, low = np.zeros(3), np.zeros(3)
    for k, axis in enumerate(np.eye(3)):
        high[k] = max(part.support(axis) for part in parts)
        low[k] = -max(part.support(-axis) for part in parts)
    return box("bounds", (low + high) / 2, np.diag(high - low) / 2)


class RodFit(NamedTuple):
    """Fit of a rod in its connector."""

    digits: int = 9
    """Decimals to which rod lengths are compared, so that mirror-image connectors tie and keep their order."""
    socket: float = 2.0
    """Length of the fitting, in radii of the rod."""


FIT = RodFit()


@dataclass(frozen=True, eq=False)
class StraightRod:
    """A rod from a free connector to the end-effector."""

    mount: Mount
    start: Array
    """c, shape (3,)."""
    path: Array
    """Vector from the connector to the end-effector, shape (3,)."""
    radius: float
    """r."""

    @property
    def length(self) -> float:
        """Length of the axis."""
        return float(np.linalg.norm(self.path))

    @property
    def round_body(self) -> RoundBody:
        """The whole rod, for clearance from airflow."""
        return RoundBody(ConeSphere(self.start, self.path, self.radius, 0.0))

    def body_beside(self, module: int) -> Compound | None:
        """Return what must not touch a module: the rod, on its own module without the fitting; None if empty."""
        fitting = FIT.socket * self.radius if module == self.mount.module else 0.0
        if self.length < fitting or fitting == self.length > 0:
            return None
        skipped = fitting / self.length if fitting else 0.0
        rod = capsule("rod", self.start + skipped * self.path, self.start + self.path, self.radius)
        return Compound((rod,), rod)

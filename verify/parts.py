"""The rigid parts of a platform: hub, arms and rotor discs of every module, in the audit's coordinates.

Module frame: the hub a box about the centre; four arms, boxes from the centre to the rotors (X layout); four rotor
discs, cylinders about the rotors, at the height of the centre. Sizes are those of `[module.body]`; convex pieces of
the user may stand in place of hub and arms. Lengths are in l_arm, positions relative to the mean of the module
centres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topo_search.model import Design, Module
from topo_search.model.arrays import ROTOR_DIRECTIONS
from verify.bodies import Array
from verify.compounds import Compound
from verify.convex import Convex, Polyhedron, box, cylinder
from verify.fcl_queries import FARTHEST
from verify.kinematics import Platform

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

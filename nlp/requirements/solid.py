"""Rigid parts keep out of regions that are solid; (9) of the printed problem.

The regions keep out of all airflow besides, so that the balls around what reaches out of a module's own airflow
(`topo_search.model.room`) are all that is to be asked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlp.numbers.geometry import Swept
from nlp.numbers.geometry import clearance as exact_clearance
from nlp.requirements.kinds import PARTS_ALONG, PARTS_CAPSULE, PARTS_CONE, PARTS_CONE_COM, PARTS_HULL, Kernel
from nlp.requirements.regions import InfiniteCone, divide, hull_of
from nlp.requirements.statement import FROM_COM, FROM_TIP, X_I, Y_I, Z_I, LocalVector
from nlp.symbols.envelope import Ball, ConeSphere, clearance_of_all
from nlp.units import Units
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array
from topo_search.model.value import Vector

PARTS = (FROM_TIP, X_I, Y_I, Z_I)


@dataclass(frozen=True)
class PartBalls:
    """The balls around a module's parts, seen from the end-effector or another module."""

    balls: tuple[tuple[Vector, float], ...]
    """Centres in the module's frame, and radii [l_arm]."""

    @classmethod
    def of(cls, task: ResolvedTask) -> PartBalls:
        """Return those of a task's module."""
        cover, unit = task.part_cover, Units.of(task).length
        return cls(tuple((divide(o, unit), r / unit) for o, r in zip(cover.centres, cover.radii, strict=True)))

    def symbols(self, y: Sequence[ca.SX]) -> list[Ball]:
        """Return them as symbols."""
        q, *axes = y
        R = ca.horzcat(*axes)
        return [Ball(q + R @ ca.DM(place), radius) for place, radius in self.balls]

    def numbers(self, y: Sequence[Array]) -> list[Swept]:
        """Return them as numbers, of m modules each."""
        q, *axes = y
        R = np.stack(axes, axis=-1)
        return [Swept(q + R @ np.array(place), np.zeros(3), radius) for place, radius in self.balls]


@dataclass(frozen=True)
class PartsInCone:
    """The parts of a module stay in an infinite cone."""

    balls: PartBalls
    cone: InfiniteCone
    segment: int | None = None

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Those of the module and of the cone."""
        return (*PARTS, *self.cone.local_vectors)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return s - r of every ball."""
        return self.cone.smooth(self.balls.symbols(y[:4]), y[4:])

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the least s - r."""
        gaps = [self.cone.exact(ball, y[4:]) for ball in self.balls.numbers(y[:4])]
        return np.asarray(np.min(gaps, axis=0))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (self.cone.kernel(PARTS_CONE_COM if self.cone.axis is None else PARTS_CONE, 0.0),)


@dataclass(frozen=True)
class PartsOffCapsule:
    """The parts of a module keep out of a capsule near the end-effector, or of a ball around it."""

    balls: PartBalls
    radius: float
    start: Vector
    """From p_E."""
    path: Vector
    """From there to its end; zero: a ball."""
    segment: int | None = None
    local_vectors = PARTS

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the log-sum-exp over all balls; for a ball their distances."""
        balls = self.balls.symbols(y)
        if any(self.path):
            capsule = ConeSphere(ca.SX(ca.DM(self.start)), ca.SX(ca.DM(self.path)), self.radius)
            return clearance_of_all(capsule, balls, beta)
        away = [ball.o - ca.DM(self.start) for ball in balls]
        least = [self.radius + ball.end_radius for ball in balls]
        gaps = [(ca.dot(q, q) - d**2) / (2 * d) for q, d in zip(away, least, strict=True)]
        return ca.vertcat(*gaps)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the least gap."""
        capsule = Swept(np.array(self.start), np.array(self.path), self.radius)
        return np.asarray(np.min([exact_clearance(ball, capsule) for ball in self.balls.numbers(y)], axis=0))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(PARTS_CAPSULE, self.path, self.radius, start=self.start),)


@dataclass(frozen=True)
class PartsOffCapsuleAlong:
    """The parts of a module keep out of a capsule from the end-effector away from the COM."""

    balls: PartBalls
    radius: float
    length: float
    local_vectors = (*PARTS, FROM_COM)
    segment = 0

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the log-sum-exp over all balls."""
        *parts, p_E = y
        capsule = ConeSphere(ca.SX.zeros(3), self.length * p_E / ca.norm_2(p_E), self.radius)
        return clearance_of_all(capsule, self.balls.symbols(parts), beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the least gap."""
        *parts, p_E = y
        path = self.length * p_E / np.linalg.norm(p_E, axis=-1, keepdims=True)
        capsule = Swept(np.zeros(3), path, self.radius)
        return np.asarray(np.min([exact_clearance(ball, capsule) for ball in self.balls.numbers(parts)], axis=0))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(PARTS_ALONG, (self.length, 0.0, 0.0), size=self.radius),)


@dataclass(frozen=True)
class PartsOffHull:
    """The parts of a module keep beyond one face of the hull of points: at edges that asks for a little more."""

    balls: PartBalls
    corners: tuple[Vector, ...]
    """From p_E."""
    segment: int | None = None
    local_vectors = PARTS

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the log-sum-exp of the heights over all faces, for every ball."""
        hull = hull_of(self.corners)
        normals, offsets = hull.normals, hull.offsets
        gaps = []
        for ball in self.balls.symbols(y):
            heights = ca.DM(normals) @ ball.o - ca.DM(offsets)
            gaps.append(ca.logsumexp(beta * heights) / beta - math.log(len(offsets)) / beta - ball.end_radius)
        return ca.vertcat(*gaps)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the least of the largest heights."""
        hull = hull_of(self.corners)
        normals, offsets = hull.normals, hull.offsets
        gaps = [(ball.o @ normals.T - offsets).max(axis=-1) - ball.r_0 for ball in self.balls.numbers(y)]
        return np.asarray(np.min(gaps, axis=0))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(PARTS_HULL, hull=hull_of(self.corners)),)

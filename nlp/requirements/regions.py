"""Regions at the end-effector that an airflow envelope or a rod keeps out of, or in (paper, Sec. III-B to III-D).

| symbol | meaning | unit |
|---|---|---|
| q | p_i - p'_E, the module's centre from the end-effector | l_arm |
| p_E | end-effector from the COM | l_arm |
| r_sph | radius of a ball or capsule | l_arm |
| d_con, theta | unit axis of an allowed cone, from p_E into it; half-angle | -, rad |
| P, rho | P(eta) from the apex of the cone, and its part across that axis | l_arm |

The paper asks two things of the cone: d_con . P >= r and s - r >= 0, s = d_con . P sin(theta) - ||rho|| cos(theta).
The second implies the first for theta up to 90 deg (d_con . P >= r / sin(theta) >= r), so it stands alone here.
It is concave along the axis, so that the two end balls are enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlp.numbers.geometry import Swept, cone_clearance, hull_clearance
from nlp.numbers.geometry import clearance as exact_clearance
from nlp.requirements.air import Air, Rod
from nlp.requirements.kinds import ALONG, BALL, CAPSULE, CONE, CONE_COM, HULL, Kernel
from nlp.requirements.statement import FROM_COM, FROM_TIP, Z_I, Formula, LocalVector
from nlp.symbols.envelope import Ball, ConeSphere, clearance
from nlp.symbols.hull import hull_clearances
from topo_search.model.arrays import Array
from topo_search.model.shape import Capsule, Cone, Hull, Polytope, Shape, convex_hull
from topo_search.model.value import Vector

ROUNDING = 1e-8
"""Added to ||rho||^2 so that its root is smooth on the axis [l_arm^2]; asks for more clearance, never for less."""


@lru_cache(maxsize=64)
def hull_of(corners: tuple[Vector, ...]) -> Hull:
    """Return the hull of points; rows of the compiled search that share it have it once."""
    return convex_hull(np.array(corners))


@dataclass(frozen=True)
class OffBall:
    """A body keeps out of a ball around the end-effector."""

    body: Air | Rod
    radius: float
    local_vectors = (FROM_TIP, Z_I)
    segment = None

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the paper's log-sum-exp over three KKT candidates."""
        return clearance(self.body.symbol(*y), Ball(ca.SX.zeros(3), self.radius), beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap where f is least."""
        return exact_clearance(self.body.number(*y), Swept(np.zeros(3), np.zeros(3), self.radius))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (self.body.add_sizes(Kernel(BALL, size=self.radius)),)


@dataclass(frozen=True)
class OffCapsule:
    """A body keeps out of a capsule along a path near the end-effector."""

    body: Air | Rod
    radius: float
    start: Vector
    """From p_E."""
    path: Vector
    """From there to the end."""
    segment: int
    local_vectors = (FROM_TIP, Z_I)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the paper's log-sum-exp over nine KKT candidates."""
        capsule = ConeSphere(ca.SX(ca.DM(self.start)), ca.SX(ca.DM(self.path)), self.radius)
        return clearance(self.body.symbol(*y), capsule, beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap where f is least."""
        return exact_clearance(self.body.number(*y), Swept(np.array(self.start), np.array(self.path), self.radius))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (self.body.add_sizes(Kernel(CAPSULE, self.path, size=self.radius, start=self.start)),)


@dataclass(frozen=True)
class OffCapsuleAlong:
    """A body keeps out of a capsule from the end-effector away from the COM."""

    body: Air | Rod
    radius: float
    length: float
    local_vectors = (FROM_TIP, Z_I, FROM_COM)
    segment = 0

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the paper's log-sum-exp over nine KKT candidates."""
        q, z, p_E = y
        capsule = ConeSphere(ca.SX.zeros(3), self.length * p_E / ca.norm_2(p_E), self.radius)
        return clearance(self.body.symbol(q, z), capsule, beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap where f is least."""
        q, z, p_E = y
        path = self.length * p_E / np.linalg.norm(p_E, axis=-1, keepdims=True)
        return exact_clearance(self.body.number(q, z), Swept(np.zeros(3), path, self.radius))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (self.body.add_sizes(Kernel(ALONG, (self.length, 0.0, 0.0), size=self.radius)),)


@dataclass(frozen=True)
class OffHull:
    """A body keeps out of the convex hull of points."""

    body: Air | Rod
    corners: tuple[Vector, ...]
    """From p_E."""
    segment: int | None = None
    local_vectors = (FROM_TIP, Z_I)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return two rows: the log-sum-exp, and how far the centre is outside (`nlp.symbols.hull`)."""
        return hull_clearances(self.body.symbol(*y), ca.SX.zeros(3), hull_of(self.corners), beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap where f is least."""
        return hull_clearance(self.body.number(*y), np.zeros(3), hull_of(self.corners))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (self.body.add_sizes(Kernel(HULL, hull=hull_of(self.corners))),)


@dataclass(frozen=True)
class InfiniteCone:
    """An infinite cone that must hold something; at a right angle a half-space."""

    half_angle: float
    axis: Vector | None
    """d_con; None: towards the COM."""
    apex: Vector = (0.0, 0.0, 0.0)
    """From p_E."""

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The COM where the axis points there."""
        return () if self.axis is not None else (FROM_COM,)

    def smooth(self, balls: Sequence[Ball], towards: Sequence[ca.SX]) -> ca.SX:
        """Return s - r of every ball; `towards`: its local vectors."""
        d_con = ca.SX(ca.DM(self.axis)) if self.axis is not None else -towards[0] / ca.norm_2(towards[0])
        gaps = []
        for ball in balls:
            P = ball.o - ca.DM(self.apex)
            along = ca.dot(d_con, P)
            rho = P - along * d_con
            s = along * math.sin(self.half_angle)
            s -= ca.sqrt(ca.dot(rho, rho) + ROUNDING) * math.cos(self.half_angle)
            gaps.append(s - ball.end_radius)
        return ca.vertcat(*gaps)

    def exact(self, swept: Swept, towards: Sequence[Array]) -> Array:
        """Return the lesser s - r of both ends; `towards`: its local vectors."""
        axis = np.array(self.axis)
        if self.axis is None:
            axis = -towards[0] / np.linalg.norm(towards[0], axis=-1, keepdims=True)
        return cone_clearance(swept, np.array(self.apex), axis, self.half_angle)

    def kernel(self, kind: int, eta: float) -> Kernel:
        """Return the row of a ball; eta distinguishes it from others."""
        sine, cosine = math.sin(self.half_angle), math.cos(self.half_angle)
        return Kernel(kind, self.axis or (0.0, 0.0, 0.0), eta, sine, cosine, self.apex)


@dataclass(frozen=True)
class InCone:
    """A body stays in an infinite cone."""

    body: Air | Rod
    cone: InfiniteCone
    segment: int | None = None

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Those of the body and of the cone."""
        return (FROM_TIP, Z_I, *self.cone.local_vectors)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return s - r of both end balls."""
        body = self.body.symbol(y[0], y[1])
        ends = [Ball(body.o + eta * body.d, body.r_0 + eta * body.dr) for eta in (0.0, 1.0)]
        return self.cone.smooth(ends, y[2:])

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the lesser s - r of both end balls."""
        return self.cone.exact(self.body.number(y[0], y[1]), y[2:])

    def kernels(self) -> tuple[Kernel, ...]:
        """Return a row for each end ball."""
        kind = CONE_COM if self.cone.axis is None else CONE
        return tuple(self.body.add_sizes(self.cone.kernel(kind, eta)) for eta in (0.0, 1.0))


def to_formula(shape: Shape, body: Air | Rod, unit: float, segment: int | None) -> Formula:
    """Return the clearance of a body from one shape of a requirement; `unit`: l_arm [m]."""
    match shape:
        case Capsule(radius=radius, length=float(length)):
            return OffCapsuleAlong(body, radius / unit, length / unit)
        case Capsule(radius=radius, start=start, end=end) if start == end:
            return OffBall(body, radius / unit)
        case Capsule(radius=radius, start=start, end=end):
            path = np.array(end) - np.array(start)
            return OffCapsule(body, radius / unit, divide(start, unit), divide(path, unit), segment or 0)
        case Polytope(corners=corners):
            return OffHull(body, tuple(divide(corner, unit) for corner in corners), segment)
        case Cone():
            return InCone(body, to_cone(shape, unit), segment)


def to_cone(shape: Cone, unit: float) -> InfiniteCone:
    """Return a cone; `unit`: l_arm [m]."""
    return InfiniteCone(math.radians(shape.half_angle_deg), shape.axis, divide(shape.apex, unit))


def divide(vector: ArrayLike, unit: float) -> Vector:
    """Return a vector in other units, as numbers that hash."""
    x, y, z = (np.array(vector) / unit).tolist()
    return x, y, z

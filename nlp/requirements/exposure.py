r"""Clearances at the end-effector: exclusion, nearby airflow, exposure; (7) to (9) of the printed problem.

Bodies stay outside regions at the end-effector, or inside them (paper, Sec. III-B to III-D). The clearances of the
rod are in `nlp.requirements.rod`.

| symbol | meaning | unit |
|---|---|---|
| q | p_i - p'_E, the module's centre from the end-effector | l_arm |
| p_E | end-effector from the COM | l_arm |
| r_sph | radius of a ball or capsule | l_arm |
| d_con, theta | unit axis of an allowed cone, from p_E to its inside; half-angle | -, rad |
| P, rho | P(eta) from the apex of the cone, and its part across that axis | l_arm |

The paper has two constraints for the cone: d_con . P >= r and s - r >= 0, s = d_con . P sin(theta) - ||rho||
cos(theta). For theta up to 90 deg the second implies the first (d_con . P >= r / sin(theta) >= r), so only the
second is used. It is concave along the axis, so the two end balls are enough.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import product

import casadi as ca
import numpy as np

from nlp import names
from nlp.numbers.geometry import Ball, Swept, cone_clearance, hull_clearance
from nlp.numbers.geometry import clearance as exact_clearance
from nlp.requirements import row_kinds
from nlp.requirements.bodies import Air, AnyBody, PartBalls, divide
from nlp.requirements.statement import FROM_COM, FROM_TIP, Distance, LocalVector, Requirement, Subjects
from nlp.symbols.clearance import clearance, clearance_of_all, hull_clearances
from nlp.units import Units
from topo_search.model import (
    LEAST_OFFSET,
    AnyExposure,
    Array,
    ResolvedTask,
    Vector,
    needs_offset,
    segment_of,
)
from topo_search.model.exposure import solid_name
from topo_search.model.shape import Capsule, Cone, Hull, Polytope, Shape, convex_hull

ROOT_SMOOTHING = 1e-8
"""Added to ||rho||^2 so that its root is smooth on the axis [l_arm^2]; only increases the required clearance."""


@lru_cache(maxsize=64)
def hull_of(corners: tuple[Vector, ...]) -> Hull:
    """Return the convex hull of points, one object for equal points: the compiled search stores it once."""
    return convex_hull(np.array(corners))


@dataclass(frozen=True)
class CapsuleRegion:
    """A capsule along a path near the end-effector, or along p_E beyond it; without a path a ball."""

    radius: float
    start: Vector = row_kinds.ORIGIN
    path: Vector = row_kinds.ORIGIN
    """Vector from start to end."""
    length: float | None = None
    """Length of a path along p_E; None: `path` is used."""

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """p_E if the path is along it."""
        return () if self.length is None else (FROM_COM,)

    def smooth(self, body: Sequence[Swept], towards: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the paper's log-sum-exp over nine KKT candidates; over three for a ball; for balls, distances."""
        start, path = ca.SX(ca.DM(self.start)), ca.SX(ca.DM(self.path))
        if self.length is not None:
            path = self.length * towards[0] / ca.norm_2(towards[0])
        elif not any(self.path):
            if not isinstance(body[0], Ball):
                return clearance(body[0], Ball(start, self.radius), beta)
            distances = [Distance(FROM_TIP, self.radius + ball.end_radius, row_kinds.TipObstacle) for ball in body]
            return ca.vertcat(*(d.smooth([ball.o - start], beta) for d, ball in zip(distances, body, strict=True)))
        capsule = Swept(start, path, self.radius)
        if isinstance(body[0], Ball):
            return clearance_of_all(capsule, body, beta)
        return clearance(body[0], capsule, beta)

    def exact(self, swept: Swept, towards: Sequence[Array]) -> Array:
        """Return the gap where f is smallest."""
        path = np.array(self.path)
        if self.length is not None:
            path = self.length * towards[0] / np.linalg.norm(towards[0], axis=-1, keepdims=True)
        return exact_clearance(swept, Swept(np.array(self.start), path, self.radius))

    def obstacles(self) -> tuple[row_kinds.SearchObstacle, ...]:
        """Return one obstacle."""
        return (row_kinds.CapsuleObstacle(self.start, self.path, self.radius, self.length or 0.0),)


@dataclass(frozen=True)
class HullRegion:
    """The convex hull of points."""

    corners: tuple[Vector, ...]
    local_vectors = ()

    def smooth(self, body: Sequence[Swept], towards: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return two rows: the log-sum-exp, and the centre's distance outside (`nlp.symbols.clearance`)."""
        return hull_clearances(body[0], hull_of(self.corners), beta)

    def exact(self, swept: Swept, towards: Sequence[Array]) -> Array:
        """Return the gap where f is smallest."""
        return hull_clearance(swept, np.zeros(3), hull_of(self.corners))

    def obstacles(self) -> tuple[row_kinds.SearchObstacle, ...]:
        """Return one obstacle."""
        return (row_kinds.HullObstacle(hull_of(self.corners)),)


class HullFaces(HullRegion):
    """The convex hull of points, with each ball beyond a face: near edges a little stricter than the distance."""

    def smooth(self, body: Sequence[Swept], towards: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the log-sum-exp of the heights over all faces, for every ball."""
        normals, offsets = hull_of(self.corners).normals, hull_of(self.corners).offsets
        gaps = []
        for ball in body:
            heights: ca.SX = ca.DM(normals) @ ball.o - ca.DM(offsets)
            gaps.append(ca.logsumexp(beta * heights) / beta - math.log(len(offsets)) / beta - ball.end_radius)
        return ca.vertcat(*gaps)

    def exact(self, swept: Swept, towards: Sequence[Array]) -> Array:
        """Return the largest height."""
        normals, offsets = hull_of(self.corners).normals, hull_of(self.corners).offsets
        return np.asarray((swept.o @ normals.T - offsets).max(axis=-1) - swept.r_0)

    def obstacles(self) -> tuple[row_kinds.SearchObstacle, ...]:
        """Return one obstacle."""
        return (row_kinds.FacesObstacle(hull_of(self.corners)),)


@dataclass(frozen=True)
class InfiniteCone:
    """An infinite cone that contains a body; a half-space if its half-angle is a right angle."""

    half_angle: float
    axis: Vector | None
    """d_con; None: towards the COM."""
    apex: Vector = row_kinds.ORIGIN

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """p_E if the axis points to the COM."""
        return () if self.axis is not None else (FROM_COM,)

    def smooth(self, body: Sequence[Swept], towards: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return s - r of every ball, or of both end balls of a swept body."""
        d_con = ca.SX(ca.DM(self.axis)) if self.axis is not None else -towards[0] / ca.norm_2(towards[0])
        if not isinstance(body[0], Ball):
            (swept,) = body
            body = [Ball(swept.o + eta * swept.d, swept.r_0 + eta * swept.dr) for eta in (0.0, 1.0)]
        gaps = []
        for ball in body:
            P: ca.SX = ball.o - ca.DM(self.apex)
            along = ca.dot(d_con, P)
            rho = P - along * d_con
            s = along * math.sin(self.half_angle)
            s -= ca.sqrt(ca.dot(rho, rho) + ROOT_SMOOTHING) * math.cos(self.half_angle)
            gaps.append(s - ball.end_radius)
        return ca.vertcat(*gaps)

    def exact(self, swept: Swept, towards: Sequence[Array]) -> Array:
        """Return the smaller s - r of both ends."""
        axis = np.array(self.axis)
        if self.axis is None:
            axis = -towards[0] / np.linalg.norm(towards[0], axis=-1, keepdims=True)
        return cone_clearance(swept, np.array(self.apex), axis, self.half_angle)

    def obstacles(self) -> tuple[row_kinds.SearchObstacle, ...]:
        """Return an obstacle for each end ball."""
        axis, angle = self.axis or row_kinds.ORIGIN, (math.sin(self.half_angle), math.cos(self.half_angle))
        return tuple(
            row_kinds.ConeObstacle(self.apex, axis, *angle, end, float(self.axis is None)) for end in (0.0, 1.0)
        )


AnyRegion = CapsuleRegion | HullRegion | InfiniteCone
"""A region, in l_arm from p'_E; hashable. Its local vectors are p_E if its direction follows p_E, else none."""


@dataclass(frozen=True)
class RegionClearance:
    """Clearance of a body from a region that it stays out of, or of a cone that it stays in."""

    body: AnyBody
    region: AnyRegion
    segment: int | None = None

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Local vectors of the body, then of the region."""
        return (*self.body.local_vectors, *self.region.local_vectors)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the region's rows."""
        count = len(self.body.local_vectors)
        return self.region.smooth(self.body.solids(y[:count]), y[count:], beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the smallest gap of the body's solids."""
        count = len(self.body.local_vectors)
        gaps = [self.region.exact(swept, y[count:]) for swept in self.body.solids(y[:count])]
        return np.asarray(np.min(gaps, axis=0))

    def search_rows(self) -> tuple[row_kinds.SearchRow, ...]:
        """Return a row for each obstacle; balls around parts have both ends in one place."""
        obstacles = self.region.obstacles()[: 1 if isinstance(self.body, PartBalls) else None]
        return tuple(row_kinds.SearchRow(self.body.search_body, obstacle) for obstacle in obstacles)


def to_formula(shape: Shape, body: AnyBody, unit: float, segment: int | None) -> RegionClearance:
    """Return the clearance of a body from one shape of a requirement; `unit` is l_arm [m]."""
    region: AnyRegion
    match shape:
        case Capsule(radius=radius, length=float(length)):
            region = CapsuleRegion(radius / unit, length=length / unit)
        case Capsule(radius=radius, start=start, end=end):
            region = CapsuleRegion(radius / unit, divide(start, unit), divide(np.subtract(end, start), unit))
        case Polytope(corners=corners):
            kind = HullFaces if isinstance(body, PartBalls) else HullRegion
            region = kind(tuple(divide(corner, unit) for corner in corners))
        case Cone(half_angle_deg=half_angle, axis=axis, apex=apex):
            region = InfiniteCone(math.radians(half_angle), axis, divide(apex, unit))
    return RegionClearance(body, region, segment)


def end_effector_clearances(task: ResolvedTask) -> Iterator[Requirement]:
    """Yield the exclusion of (7), and (8)."""
    unit, subjects = Units.of(task).length, _alone(range(task.n))
    margin = task.search.margin / unit
    if task.exclusion_radius is not None:
        exclusion = Distance(FROM_TIP, task.exclusion_radius / unit, row_kinds.TipObstacle)
        yield Requirement(7, lambda i, *_: f"end-effector exclusion of module {i}", subjects, (exclusion,), margin)
    for module, alike in task.placed_types:
        if task.tip_radius is not None and (air := Air.of(task, module)) is not None:
            tip = RegionClearance(air, CapsuleRegion(task.tip_radius / unit))
            yield Requirement(
                8, lambda i, *_: f"end-effector and airflow of module {i}", _alone(alike), (tip,), margin
            )


def exposure_clearances(task: ResolvedTask) -> Iterator[Requirement]:
    """Yield (9), and the smallest length of p_E if some direction follows p_E."""
    unit, subjects = Units.of(task).length, _alone(range(task.n))
    margin = task.search.margin / unit

    def formulas(exposure: AnyExposure, body: AnyBody) -> tuple[RegionClearance, ...]:
        return tuple(
            to_formula(shape, body, unit, segment_of(exposure, k)) for k, shape in enumerate(exposure.shapes)
        )

    for (number, exposure), (module, alike) in product(enumerate(task.exposure), task.placed_types):
        if exposure.geometry:
            for rotor, air in Air.at_regions(task, module).items():
                name = partial(names.exposure, number, exposure, rotor)
                yield Requirement(9, name, _alone(alike), formulas(exposure, air), margin)
        if exposure.solid:
            parts = formulas(exposure, PartBalls.of(task, module))
            yield Requirement(9, partial(_solid_name, number, exposure.contact), _alone(alike), parts, margin)
    if any(needs_offset(exposure) for exposure in task.exposure):
        offset = Distance(FROM_COM, LEAST_OFFSET, row_kinds.OffsetObstacle)
        yield Requirement(9, lambda *_: names.OFFSET, subjects[:1], (offset,), 0.0)  # no clearance: no margin


def _alone(modules: Sequence[int]) -> Subjects:
    return np.repeat(np.array(modules, dtype=np.intp)[:, None], 2, axis=1)


def _solid_name(number: int, contact: int | None, i: int, _: int, segment: int | None) -> str:
    return f"module {i} and {solid_name(number, segment, contact)}"

"""The rod that carries the end-effector: within reach, along the task's axis, and clear of solid regions.

One free connector whose rod meets every limit is enough. As in the audit it is the nearest such connector, or if no
rod meets all limits, the one with the smallest violation. A rod with mass starts at its given connector. Airflow
and parts in the way of rods are left to the audit, which measures the rod from each connector.

| symbol | meaning | unit |
|---|---|---|
| q, e | p_i - p'_E; direction in which a free connector of module i points | l_arm, - |
| c | q + l_c e: the connector from the end-effector | l_arm |
| L | largest reach | l_arm |
| r | radius of the rod | l_arm |
| a, theta | axis of the rod, a unit vector; largest angle between -c and a | -, rad |

The rod is within theta of a if its connector is inside the cone with apex p'_E, axis -a and half-angle theta. The
margin of that distance is at most sin(theta) / 2: from a rod as long as an arm it takes at most half of theta.

Regions are fixed relative to p'_E, so the part of the rod that keeps out of one is the same for all platforms. If
p'_E is within r of the region's surface, the rod's last `TIP` radii may touch the region. If p'_E is deeper inside,
the rod must reach in, and the region does not limit it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from nlp import names
from nlp.numbers.geometry import Ball
from nlp.numbers.point import Connector, Point, connectors, rod_path
from nlp.requirements.bodies import RodShape, divide
from nlp.requirements.exposure import HullRegion, InfiniteCone, RegionClearance, hull_of, to_formula
from nlp.requirements.row_kinds import ReachObstacle, RodBody, SearchRow
from nlp.requirements.statement import (
    FROM_COM,
    FROM_TIP,
    X_I,
    Formula,
    LocalVector,
    PlatformVector,
    Requirement,
    VectorsByName,
)
from nlp.units import Units
from topo_search.model import PORT_DIRECTIONS, Array, ResolvedTask, Topology, segment_of
from topo_search.model.end_effector import TIP
from topo_search.model.exposure import solid_name
from topo_search.model.shape import Shape

NEAR_LIMIT = 6.0
"""Clearance of the rod above which a round of Ipopt leaves out a limit [l_arm]."""
TOUCHING = 1e-7
"""Largest difference of a distance between solver and audit [l_arm]."""


@dataclass(frozen=True)
class WithinReach:
    """A connector is within the largest reach of the end-effector."""

    l_c: float
    """[l_arm]"""
    largest: float
    """L."""
    local_vectors = (FROM_TIP, X_I)
    segment = None

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return (L^2 - ||c||^2) / (2 L), smooth everywhere and exact to first order at contact."""
        c = y[0] + self.l_c * y[1]
        return (self.largest**2 - ca.dot(c, c)) / (2 * self.largest)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return L - ||c||."""
        return np.asarray(self.largest - np.linalg.norm(y[0] + self.l_c * y[1], axis=-1))

    def search_rows(self) -> tuple[SearchRow, ...]:
        """Return one row."""
        return (SearchRow(RodBody(), ReachObstacle(self.largest)),)


@dataclass(frozen=True)
class AlongAxis:
    """A connector is inside the cone that holds all rods within an angle of the task's axis."""

    l_c: float
    """[l_arm]"""
    cone: InfiniteCone
    local_vectors = (FROM_TIP, X_I)
    segment = None

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the distance of the connector inside the cone."""
        return self.cone.smooth([Ball(y[0] + self.l_c * y[1], 0.0)], (), beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the same: ||c|| sin(theta - angle)."""
        return self.cone.exact(Ball(y[0] + self.l_c * y[1], 0.0), ())

    def search_rows(self) -> tuple[SearchRow, ...]:
        """Return one row, for the rod's start."""
        return (SearchRow(RodBody(), self.cone.obstacles()[0]),)


class RodClearance(RegionClearance):
    """A rod, except its tip, keeps out of a solid region."""

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap; infinite if the rod is nothing but tip."""
        assert isinstance(self.body, RodShape)
        length = np.linalg.norm(y[0] + self.body.l_c * y[1], axis=-1)
        return np.where((self.body.tip > 0) & (length <= self.body.tip), math.inf, super().exact(y))


@dataclass(frozen=True)
class LimitOfBestRod:
    """One limit of the rod from the best free connector."""

    free: tuple[tuple[int, int], ...]
    """Free connectors: index of the module in the subject, and port."""
    l_c: tuple[float, ...]
    """Their distances from the modules' centres [l_arm]."""
    limits: tuple[tuple[Formula, ...], ...]
    """Limits of each one's rod as functions of q, e and, for some, p_E."""
    segment: int
    """Index of the limit."""

    @cached_property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Return q and e of every free connector, then p_E if a limit depends on it."""
        rods = [vector for i, port in self.free for vector in _from_connector(i, port)]
        return (*rods, *([FROM_COM] if any(len(limit.local_vectors) > 2 for limit in self.limits[0]) else []))

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the mean over all connectors, weighted towards those whose rods clear all limits the most."""
        p_E = y[2 * len(self.free) :]
        rods = [[*y[2 * k : 2 * k + 2], *p_E] for k in range(len(self.free))]
        gaps = [limits[self.segment].smooth(rod, beta) for limits, rod in zip(self.limits, rods, strict=True)]
        if len(rods) == 1:
            return gaps[0]
        all_gaps = [[limit.smooth(rod, beta) for limit in own] for own, rod in zip(self.limits, rods, strict=True)]
        smallest = [ca.mmin(ca.vertcat(*of_rod)) for of_rod in all_gaps]
        best = ca.mmax(ca.vertcat(*smallest))
        weights = [ca.exp(beta * (gap - best)) for gap in smallest]
        total = ca.sum1(ca.vertcat(*weights))
        return sum((weight / total * gap for weight, gap in zip(weights, gaps, strict=True)), ca.SX(0))

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap of the best connector."""
        best, gaps = self.best(y)
        return gaps[best, [self.segment]]

    def best(self, y: Sequence[Array], margin: float = 0.0) -> tuple[int, Array]:
        """Return the index of the best connector of a platform, and the exact gaps, shape (connectors, limits).

        `margin` is the gap required of a rod.
        """
        split = 2 * len(self.free)
        q, e = np.concatenate(y[0:split:2]), np.concatenate(y[1:split:2])
        gaps = np.empty((len(self.free), len(self.limits[0])))
        for limits in dict.fromkeys(self.limits):
            alike = [k for k, own in enumerate(self.limits) if own is limits]
            gaps[alike] = np.stack([limit.exact([q[alike], e[alike], *y[split:]]) for limit in limits], axis=1)
        violations = np.maximum(0.0, margin - gaps.min(axis=1))
        lengths = np.linalg.norm(q + np.array(self.l_c)[:, None] * e, axis=1)
        # rounded as in the audit, so that a design and its mirror image choose the same connector
        return int(np.lexsort((np.round(lengths, 9), np.round(violations, 9)))[0]), gaps

    def search_rows(self) -> tuple[SearchRow, ...]:
        """Return the rows of every connector; only those of the best one apply."""
        found = []
        for number, (i, port) in enumerate(self.free):
            connector = divide(self.l_c[number] * PORT_DIRECTIONS[port], 1.0)
            for rod, obstacle, _ in self.limits[number][self.segment].search_rows():
                assert isinstance(rod, RodBody)
                found.append(SearchRow(rod._replace(number=number, connector=connector), obstacle, i))
        return tuple(found)


@dataclass(frozen=True, eq=False)
class BestRod(Requirement):
    """Limits of the rod from any free connector; a round of Ipopt has those of the best one."""

    def best(self, vectors: VectorsByName, margin: float = 0.0) -> tuple[LimitOfBestRod, int, Array]:
        """Return the first formula, its best connector, and the gaps of all; see `LimitOfBestRod.best`."""
        first = self.formulas[0]
        assert isinstance(first, LimitOfBestRod)
        columns = self.subjects.T
        return first, *first.best([vector.at(vectors, columns) for vector in first.local_vectors], margin)

    def gaps(self, vectors: VectorsByName) -> Array:
        """Return the gaps of the best connector, shape (1, limits)."""
        _, best, gaps = self.best(vectors)
        return gaps[[best]]

    def restrict(self, vectors: VectorsByName) -> Requirement:
        """Return the reach limit of the best connector, and the limits by regions near its rod.

        The reach is never left out: if the effort is flat in the rod's length, nothing else bounds it.
        """
        first, best, gaps = self.best(vectors, self.margin)
        i, port = first.free[best]
        near_limits = [
            limit
            for limit, gap in zip(first.limits[best], gaps[best], strict=True)
            if gap < self.near or isinstance(limit, WithinReach)
        ]
        rod = replace(first, free=((0, port),), l_c=(first.l_c[best],), segment=0)
        formulas = tuple(replace(rod, limits=((limit,),)) for limit in near_limits)
        return Requirement(self.equation, self.name, np.array([[i, i]]), formulas, self.margin)


@lru_cache(maxsize=16)
def rod_clearances(task: ResolvedTask, topology: Topology) -> tuple[BestRod, ...]:
    """Return the limits of the rod, if it has any."""
    free, unit = connectors(task, topology), Units.of(task).length
    l_c = tuple((task.connector_distances[[i for i, _ in free]] / unit).tolist())
    all_limits = {distance: _limits(task, topology.n, distance) for distance in dict.fromkeys(l_c)}
    (limits, margin), *_ = all_limits.values()
    if not limits:
        return ()
    limit_names, by_rod = tuple(limits), {d: tuple(own.values()) for d, (own, _) in all_limits.items()}
    of_rods = tuple(by_rod[distance] for distance in l_c)
    formulas = tuple(LimitOfBestRod(free, l_c, of_rods, k) for k in range(len(limits)))
    subjects = np.arange(max(topology.n, 2))[None]  # at least i and j
    return (BestRod(7, lambda _, __, k: limit_names[k or 0], subjects, formulas, margin, near=NEAR_LIMIT),)


def _limits(task: ResolvedTask, n: int, l_c: float) -> tuple[dict[str, Formula], float]:
    """Return the limits of the rod from a connector at a distance l_c, by name, and their margin [l_arm]."""
    unit, limits = Units.of(task).length, dict[str, Formula]()
    margin = task.search.margin / unit
    if (largest := task.largest_reach(n)) is not None:
        limits[names.ROD] = WithinReach(l_c, largest / unit)
    if (axis := task.rod_axis) is not None:
        theta = math.radians(task.end_effector.largest_angle_deg)
        limits[names.ROD_AXIS] = AlongAxis(l_c, InfiniteCone(theta, divide(axis, -1.0)))
        margin = min(margin, math.sin(theta) / 2)
    if task.end_effector.rod == "straight":
        r = task.end_effector.rod_radius / unit
        for number, exposure in enumerate(task.exposure):
            for part, shape in enumerate(exposure.shapes if exposure.solid else ()):
                distance = _distance(shape, unit)
                if distance <= TOUCHING - r:
                    continue
                rod = RodShape(l_c, r, TIP * r if distance <= r + TOUCHING else 0.0)
                segment = segment_of(exposure, part)
                name = f"the end-effector's rod and {solid_name(number, segment, exposure.contact)}"
                limits[name] = RodClearance(rod, to_formula(shape, rod, unit, segment).region, segment)
                margin = min(margin, (distance + rod.tip - r) / 2)  # the gap of any rod is at most twice that
    return limits, margin


def rod_of(point: Point) -> Connector | None:
    """Return the connector of the nearest rod that meets its limits, or of the rod with mass; None if none does."""
    free, l_arm = connectors(point.task, point.topology), point.task.module.arm_length
    # rounded as in the audit, so that a design and its mirror image choose the same connector
    lengths = [round(float(np.linalg.norm(rod_path(point, connector))) / l_arm, 9) for connector in free]
    nearest = int(np.argmin(lengths))
    for limits in rod_clearances(point.task, point.topology):
        _, nearest, gaps = limits.best(point.vectors)
        if gaps[nearest].min() < 0:
            return None
    return free[nearest]


def _distance(shape: Shape, unit: float) -> float:
    """Return the distance of p'_E outside a shape, negative inside [l_arm]."""
    point = to_formula(shape, RodShape(0.0, 0.0, 0.0), unit, None)
    if isinstance(point.region, HullRegion) and (inside := hull_of(point.region.corners).offsets.min()) >= 0:
        return -float(inside)
    tip, any_p_E = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])  # the distance from p'_E does not depend on p_E
    return float(point.exact([tip, tip, any_p_E][: len(point.local_vectors)])[0])


def _from_connector(i: int, port: int) -> tuple[LocalVector, LocalVector]:
    q, axis = LocalVector(PlatformVector("p", i), FROM_TIP.minus), PlatformVector("xy"[port % 2], i)
    return q, LocalVector(axis) if port < 2 else LocalVector(None, axis)

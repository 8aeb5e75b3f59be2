"""The rod that carries the end-effector: from a connector that is near enough, and beside all that is solid.

One free connector whose rod meets every limit is enough. As in the audit it is the nearest such connector; where no
rod meets all limits, that of the rod which lacks least. A rod that counts starts where it does. Airflow and
parts in the way of rods are for the audit to find, which measures the rod from each connector.

| symbol | meaning | unit |
|---|---|---|
| q, e | p_i - p'_E; direction in which a free connector of module i points | l_arm, - |
| c | q + l_c e: the connector from the end-effector | l_arm |
| L | largest reach | l_arm |
| r | radius of the rod | l_arm |

Regions are stated from p'_E, so what of the rod has to keep out of one is the same for all platforms. Where the
surface of the region is within r of p'_E, the rod's last `TIP` radii may touch it. Where p'_E is deeper inside, the
rod has to reach in.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from nlp import names
from nlp.numbers.point import connectors
from nlp.requirements.bodies import Rod, divide
from nlp.requirements.exposure import AtRegion, HullRegion, hull_of, to_formula
from nlp.requirements.statement import (
    FROM_COM,
    FROM_TIP,
    REACH,
    X_I,
    Formula,
    Kernel,
    LocalVector,
    PlatformVector,
    Requirement,
    VectorsByName,
)
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology, segment_of
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.model.module import TIP
from topo_search.model.shape import Shape

NEAR_LIMIT = 6.0
"""A limit that the rod meets by at least so much is not stated in a round [l_arm]."""
TOUCHING = 1e-7
"""Largest difference of a distance between solver and audit [l_arm]."""


@dataclass(frozen=True)
class WithinReach:
    """A connector is no farther from the end-effector than the largest reach."""

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

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(REACH, self.largest),)


class RodBeside(AtRegion):
    """A rod, except its tip, keeps out of a solid region."""

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap; infinite for a rod that is nothing but tip."""
        assert isinstance(self.body, Rod)
        length = np.linalg.norm(y[0] + self.body.l_c * y[1], axis=-1)
        return np.where((self.body.tip > 0) & (length <= self.body.tip), math.inf, super().exact(y))


@dataclass(frozen=True)
class LimitOfBestRod:
    """One limit of the rod from the best free connector."""

    l_c: float
    """[l_arm]"""
    free: tuple[tuple[int, int], ...]
    """Free connectors: the module's number in the subject, and the port."""
    limits: tuple[Formula, ...]
    """Limits of a rod as functions of q, e and, if at all, p_E."""
    segment: int
    """Index of the limit."""

    @cached_property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Return q and e of every free connector, then what limits need besides."""
        rods = [vector for i, port in self.free for vector in _from_connector(i, port)]
        return (*rods, *([FROM_COM] if any(len(limit.local_vectors) > 2 for limit in self.limits) else []))

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the mean over all connectors; those whose rods keep farthest from any limit weigh most."""
        rest = y[2 * len(self.free) :]
        rods = [[*y[2 * k : 2 * k + 2], *rest] for k in range(len(self.free))]
        gaps = [self.limits[self.segment].smooth(rod, beta) for rod in rods]
        if len(rods) == 1:
            return gaps[0]
        least = [ca.mmin(ca.vertcat(*(limit.smooth(rod, beta) for limit in self.limits))) for rod in rods]
        best = ca.mmax(ca.vertcat(*least))
        weights = [ca.exp(beta * (one - best)) for one in least]
        total = ca.sum1(ca.vertcat(*weights))
        return sum((weight / total * gap for weight, gap in zip(weights, gaps, strict=True)), ca.SX(0))

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap of the best connector."""
        best, gaps = self.best(y)
        return gaps[best, [self.segment]]

    def best(self, y: Sequence[Array], margin: float = 0.0) -> tuple[int, Array]:
        """Return which connector is best on one platform, and the exact gaps of all, shape (connectors, limits).

        `margin`: by how much a rod has to meet a limit.
        """
        split = 2 * len(self.free)
        q, e = np.concatenate(y[0:split:2]), np.concatenate(y[1:split:2])
        gaps = np.stack([limit.exact([q, e, *y[split:]]) for limit in self.limits], axis=1)
        lacking = np.maximum(0.0, margin - gaps.min(axis=1))
        lengths = np.linalg.norm(q + self.l_c * e, axis=1)
        # equal to as many digits as in the audit, so that of mirror images both choose the same one
        return int(np.lexsort((np.round(lengths, 9), np.round(lacking, 9)))[0]), gaps

    def kernels(self) -> tuple[Kernel, ...]:
        """Return the rows of each connector, of which those of the best one count."""
        return tuple(
            kernel._replace(
                of=i,
                rod=kernel.rod._replace(number=number, connector=divide(self.l_c * PORT_DIRECTIONS[port], 1.0)),
            )
            for number, (i, port) in enumerate(self.free)
            for kernel in self.limits[self.segment].kernels()
        )


@dataclass(frozen=True, eq=False)
class BestRod(Requirement):
    """Limits of the rod from some free connector: a round of Ipopt states those of the best one."""

    def best(self, vectors: VectorsByName, margin: float = 0.0) -> tuple[LimitOfBestRod, int, Array]:
        """Return a formula, which of its connectors is best, and the gaps of all; see `LimitOfBestRod.best`."""
        first = self.formulas[0]
        assert isinstance(first, LimitOfBestRod)
        columns = self.subjects.T
        return first, *first.best([vector.at(vectors, columns) for vector in first.local_vectors], margin)

    def gaps(self, vectors: VectorsByName) -> Array:
        """Return those of the best connector, shape (1, limits)."""
        _, best, gaps = self.best(vectors)
        return gaps[[best]]

    def restrict(self, vectors: VectorsByName) -> Requirement:
        """Return the reach of the best connector, and the regions that its rod is near.

        The reach is never left out: where the effort is flat in the rod's length, nothing else keeps the
        end-effector near.
        """
        first, best, gaps = self.best(vectors, self.margin)
        i, port = first.free[best]
        near = [
            limit
            for limit, gap in zip(first.limits, gaps[best], strict=True)
            if gap < self.near or isinstance(limit, WithinReach)
        ]
        alone = tuple(replace(first, free=((0, port),), limits=(limit,), segment=0) for limit in near)
        return Requirement(self.equation, self.name, np.array([[i, i]]), alone, self.margin)


def rod_clearances(task: ResolvedTask, topology: Topology) -> Iterator[BestRod]:
    """Yield the limits of the rod, if there are any."""
    unit, n = Units.of(task).length, topology.n
    l_c, margin = task.module.connector_distance / unit, task.search.margin / unit
    largest, listed, limits = task.largest_reach(n), list[str](), list[Formula]()
    if largest is not None:
        listed.append(names.ROD)
        limits.append(WithinReach(l_c, largest / unit))
    if task.end_effector.rod == "straight":
        r = task.end_effector.rod_radius / unit
        for number, exposure in enumerate(task.exposure):
            for part, shape in enumerate(exposure.shapes if exposure.solid else ()):
                apart = _distance(shape, unit)
                if apart <= TOUCHING - r:
                    continue
                rod = Rod(l_c, r, TIP * r if apart <= r + TOUCHING else 0.0)
                segment = segment_of(exposure, part)
                which = "" if segment is None else f", segment {segment}"
                listed.append(f"the end-effector's rod and solid exposure {number}{which}")
                limits.append(RodBeside(rod, to_formula(shape, rod, unit, segment).region, segment))
                margin = min(margin, (apart + rod.tip - r) / 2)  # no rod is farther than twice that from the region
    if limits:
        formulas = tuple(
            LimitOfBestRod(l_c, connectors(task, topology), tuple(limits), k) for k in range(len(limits))
        )
        subjects = np.arange(max(n, 2))[None]  # never fewer than i and j
        yield BestRod(7, lambda _, __, k: listed[k or 0], subjects, formulas, margin, near=NEAR_LIMIT)


def _distance(shape: Shape, unit: float) -> float:
    """Return how far p'_E is outside a shape, negative inside [l_arm]."""
    point = to_formula(shape, Rod(0.0, 0.0, 0.0), unit, None)
    if isinstance(point.region, HullRegion) and (inside := hull_of(point.region.corners).offsets.min()) >= 0:
        return -float(inside)
    here, anywhere = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])  # no shape at p'_E has its distance from p_E
    return float(point.exact([here, here, anywhere][: len(point.local_vectors)])[0])


def _from_connector(i: int, port: int) -> tuple[LocalVector, LocalVector]:
    """Return q and e."""
    q, axis = LocalVector(PlatformVector("p", i), FROM_TIP.minus), PlatformVector("xy"[port % 2], i)
    return q, LocalVector(axis) if port < 2 else LocalVector(None, axis)

"""Requirements as the solver sees them: clearances of some modules, each stated once.

| symbol | meaning | shape | unit |
|---|---|---|---|
| p_i, x_i, y_i, z_i | place and axes of module i in W | (3,) each | l_arm, - |
| p'_E, p_COM, p_E | end-effector and centre of mass in W; p'_E - p_COM | (3,) each | l_arm |
| y | the s local vectors that a clearance is a function of: differences of those above | (s, 3) | l_arm, - |
| g | clearance, positive when clear | | l_arm |

A clearance has a smooth form, which Ipopt gets, an exact value, which judges what Ipopt found, and rows of the
compiled search. All three are functions of the same local vectors.

The kinds of rows that the compiled search knows, and what a row of each is made of.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from topo_search.model.arrays import Array
from topo_search.model.shape import Hull
from topo_search.model.value import Vector

AIR, APART, EXCLUSION, BALL, CAPSULE, ALONG, HULL, CONE, CONE_COM, OFFSET, PARTS = range(11)
"""Kinds of rows: two envelopes; two centres; p'_E and a centre; an envelope and a ball about p'_E, a capsule from
near there, one along p_E, the hull of points near there; an end ball of an envelope in a cone, its axis fixed or to
the COM; the length of p_E; the parts of one module and the envelope of another."""
PARTS_CONE, PARTS_CONE_COM, PARTS_CAPSULE, PARTS_ALONG, PARTS_HULL, REACH = range(11, 17)
"""The parts of a module in a cone, its axis fixed or to the COM; off a capsule near p'_E, one along p_E, a hull;
p'_E and a free connector. This and the rows of regions may be about rods: those of the best rod alone count."""

OF_PARTS = {
    BALL: PARTS_CAPSULE, CAPSULE: PARTS_CAPSULE, ALONG: PARTS_ALONG,
    HULL: PARTS_HULL, CONE: PARTS_CONE, CONE_COM: PARTS_CONE_COM,
}  # fmt: skip
"""From the kind of a row of an envelope and a region to that of a module's parts and the region."""

ORIGIN: Vector = (0.0, 0.0, 0.0)


class PathRow(NamedTuple):
    """All that is near a path [l_arm]; a ball is near a path without length."""

    radius: float = 0.0
    along: Vector = ORIGIN
    """From start to end."""
    length: float = 0.0
    """Length of a path that has the direction of p_E instead."""


class ConeRow(NamedTuple):
    """Infinite cone around an end ball of an envelope, or around all balls of a module's parts."""

    sine: float = 0.0
    """Sine of the half-angle."""
    cosine: float = 0.0
    axis: Vector = ORIGIN
    """Unit vector; unused where the axis points to the COM."""
    end: float = 0.0
    """Which end ball: eta, 0 or 1."""


class RodRow(NamedTuple):
    """Rod from a free connector that may carry the end-effector [l_arm]."""

    number: int = -1
    """Index among the free connectors; -1: no rod."""
    connector: Vector = ORIGIN
    """Start of the rod, in its module's frame."""
    radius: float = 0.0
    tip: float = 0.0
    """Length at its end that does not count."""


class Kernel(NamedTuple):
    """A row of the compiled search; its kind says which of its parts it has."""

    kind: int
    distance: float = 0.0
    """Distance that two points keep, or may have at most [l_arm]."""
    origin: Vector = ORIGIN
    """Start of a path or apex of a cone, from p'_E [l_arm]."""
    path: PathRow = PathRow()
    cone: ConeRow = ConeRow()
    hull: Hull | None = None
    """Its corners from p'_E; a row has its place in the tables of planes and edges (`Hulls`)."""
    envelope: Vector = ORIGIN
    """Length, start radius and growth of an envelope beside a region [l_arm]."""
    rod: RodRow = RodRow()
    of: int = 0
    """Index in the subject of the module it is about."""

    def numbers(self) -> list[float]:
        """Return its numbers in the order of `COLUMNS`; the columns of a hull are 0."""
        path, cone, rod = self.path, self.cone, self.rod
        region = self.distance, *self.origin, path.radius, *path.along, path.length
        held = cone.sine, cone.cosine, *cone.axis, cone.end, 0.0, 0.0, 0.0, 0.0
        return [*region, *held, *self.envelope, rod.number, *rod.connector, rod.radius, rod.tip]


class Columns(NamedTuple):
    """First column of each number, pair or vector of a row; see `Kernel`."""

    distance: int = 0
    origin: int = 1
    radius: int = 4
    along: int = 5
    length: int = 8
    sine: int = 9
    cosine: int = 10
    axis: int = 11
    end: int = 14
    planes: int = 15
    """Index of a hull's first plane, and one past its last."""
    edges: int = 17
    """Index of its first edge, and one past its last."""
    envelope: int = 19
    rod: int = 22
    """Number of the rod."""
    connector: int = 23
    rod_radius: int = 26
    tip: int = 27
    width: int = 28
    """Number of columns."""


COLUMNS = Columns()


Subjects = NDArray[np.intp]
"""Modules i and j of some clearances, shape (m, 2); where a clearance concerns one module, or none, j is i.

One that may concern any module has all of them, in order."""
VectorsByName = Mapping[str, Any]
"""From `PlatformVector.name` to those vectors: of every module, or the one of the platform alone."""


class PlatformVector(NamedTuple):
    """A place or an axis that moves with the platform."""

    name: str
    """`p`, `x`, `y`, `z`, `p'_E` or `p_COM`."""
    of: int | None = None
    """Module that it belongs to: 0 for i, 1 for j, its index among more; None for what the platform has one of."""

    def at(self, vectors: VectorsByName, subject: Any) -> Any:
        """Return it, of a subject (i, j, ...) or, where the vectors are arrays, of columns of subjects."""
        return vectors[self.name][0 if self.of is None else subject[self.of]]


class LocalVector(NamedTuple):
    """A local vector: the difference of two vectors of the platform, or one of them with either sign."""

    plus: PlatformVector | None
    minus: PlatformVector | None = None

    def at(self, vectors: VectorsByName, subject: Any) -> Any:
        """Return it; see `PlatformVector.at`."""
        plus = 0.0 if self.plus is None else self.plus.at(vectors, subject)
        return plus if self.minus is None else plus - self.minus.at(vectors, subject)


TIP, COM = PlatformVector("p'_E"), PlatformVector("p_COM")
FROM_J = LocalVector(PlatformVector("p", 0), PlatformVector("p", 1))
"""p_i - p_j."""
FROM_TIP = LocalVector(PlatformVector("p", 0), TIP)
"""p_i - p'_E."""
FROM_COM = LocalVector(TIP, COM)
"""p_E."""
X_I, Y_I, Z_I = (LocalVector(PlatformVector(axis, 0)) for axis in "xyz")
Z_J = LocalVector(PlatformVector("z", 1))


class Formula(Hashable, Protocol):
    """One clearance as a function of local vectors, its own numbers in l_arm; hashable."""

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Local vectors that it is a function of."""

    @property
    def segment(self) -> int | None:
        """Index of the part of its requirement it is about, if that has several."""

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return its rows for Ipopt, each positive when clear and g to first order at contact.

        Args:
            y: the local vectors.
            beta: sharpness of the log-sum-exp.
        """

    def exact(self, y: Sequence[Array]) -> Array:
        """Return g with its exact sign, shape (m,), of m local vectors each, (m, 3)."""

    def kernels(self) -> tuple[Kernel, ...]:
        """Return its rows of the compiled search."""


@dataclass(frozen=True)
class Distance:
    """Two points keep a distance."""

    between: LocalVector
    """From one to the other."""
    least: float
    """[l_arm]"""
    kind: int
    """Kind of its row in the compiled search."""
    segment = None

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The vector between them."""
        return (self.between,)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return (||y||^2 - d^2) / (2 d), smooth everywhere and exact to first order at contact.

        A margin m is kept to first order too: the distance is short of it by m^2 / (2 d).
        """
        (w,) = y
        return (ca.dot(w, w) - self.least**2) / (2 * self.least)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return ||y|| - d."""
        return np.asarray(np.linalg.norm(y[0], axis=-1) - self.least)

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(self.kind, self.least),)


@dataclass(frozen=True, eq=False)
class Requirement:
    """Clearances of one kind, asked for of some modules."""

    equation: int
    """Its number on the printed problem (`nlp.problem`)."""
    name: Callable[[int, int, int | None], str]
    """From (i, j, segment) to the constraint's name."""
    subjects: Subjects
    formulas: tuple[Formula, ...]
    margin: float
    """Required clearance beyond zero [l_arm]."""
    near: float = math.inf
    """Clearance from which on a round of Ipopt does without a row [l_arm]."""

    def rows(self) -> Iterator[tuple[str, tuple[int, ...], Formula]]:
        """Yield name, modules and formula of every clearance."""
        for subject in map(tuple, self.subjects.tolist()):
            for formula in self.formulas:
                yield self.name(subject[0], subject[1], formula.segment), subject, formula

    def gaps(self, vectors: VectorsByName) -> Array:
        """Return the exact clearances of all subjects and formulas, shape (m, len(formulas)) [l_arm]."""
        m, columns = len(self.subjects), self.subjects.T
        y = {one: one.at(vectors, columns) for formula in self.formulas for one in formula.local_vectors}
        exact = (formula.exact([y[one] for one in formula.local_vectors]) for formula in self.formulas)
        return np.stack([np.broadcast_to(gaps, m) for gaps in exact], axis=-1)

    def restrict(self, vectors: VectorsByName) -> Requirement:
        """Return what a round of Ipopt from there states of it: the subjects that are near, all as a rule."""
        if self.near == math.inf:
            return self
        return replace(self, subjects=self.subjects[(self.gaps(vectors) < self.near).any(axis=1)])

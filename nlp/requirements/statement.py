"""Requirements of the solver: clearances of some modules, each defined once.

| symbol | meaning | shape | unit |
|---|---|---|---|
| p_i, x_i, y_i, z_i | position and axes of module i in W | (3,) each | l_arm, - |
| p'_E, p_COM, p_E | end-effector and centre of mass in W; p'_E - p_COM | (3,) each | l_arm |
| y | the s local vectors of a clearance: differences of the vectors above | (s, 3) | l_arm, - |
| g | clearance, positive if clear | | l_arm |

A clearance has a smooth form for Ipopt, an exact value for judging Ipopt's result, and rows of the compiled search.
All three are functions of the same local vectors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np

from nlp.requirements.row_kinds import CentreBody, ModuleObstacle, OffsetObstacle, SearchRow, TipObstacle
from topo_search.model import Array, Indices

Subjects = Indices
"""Modules i and j of some clearances, shape (m, 2); j is i if a clearance concerns one module or none.

A clearance that may concern any module has all of them, in order."""
VectorsByName = Mapping[str, Any]
"""Vectors by `PlatformVector.name`: one per module, or one of the platform."""


class PlatformVector(NamedTuple):
    """A point or an axis that moves with the platform."""

    name: str
    """`p`, `x`, `y`, `z`, `p'_E` or `p_COM`."""
    module: int | None = None
    """Index of its module in the subject: 0 for i, 1 for j, ...; None for vectors of the platform."""

    def at(self, vectors: VectorsByName, subject: Any) -> Any:
        """Return the vector for a subject (i, j, ...), or for columns of subjects if the vectors are arrays."""
        return vectors[self.name][0 if self.module is None else subject[self.module]]


class LocalVector(NamedTuple):
    """A local vector: the difference of two vectors of the platform, or plus or minus one of them."""

    plus: PlatformVector | None
    minus: PlatformVector | None = None

    def at(self, vectors: VectorsByName, subject: Any) -> Any:
        """Return the local vector; arguments as in `PlatformVector.at`."""
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
    """One clearance as a function of local vectors, in l_arm; hashable."""

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Local vectors that the clearance depends on."""

    @property
    def segment(self) -> int | None:
        """Index of its part, if the requirement has several."""

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the rows for Ipopt, each positive if clear and equal to g to first order at contact.

        Args:
            y: the local vectors.
            beta: sharpness of the log-sum-exp.
        """

    def exact(self, y: Sequence[Array]) -> Array:
        """Return g with its exact sign, shape (m,), for local vectors of shape (m, 3) each."""

    def search_rows(self) -> tuple[SearchRow, ...]:
        """Return the rows of the compiled search."""


@dataclass(frozen=True)
class Distance:
    """Two points keep a minimum distance."""

    between: LocalVector
    """Vector between the points."""
    minimum: float
    """d [l_arm]."""
    obstacle: type[ModuleObstacle | TipObstacle | OffsetObstacle]
    """Obstacle of its row in the compiled search."""
    segment = None

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The vector between the points."""
        return (self.between,)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return (||y||^2 - d^2) / (2 d), smooth everywhere and exact to first order at contact.

        A margin m holds to first order, too: the distance may fall short of it by m^2 / (2 d).
        """
        (w,) = y
        return (ca.dot(w, w) - self.minimum**2) / (2 * self.minimum)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return ||y|| - d."""
        return np.asarray(np.linalg.norm(y[0], axis=-1) - self.minimum)

    def search_rows(self) -> tuple[SearchRow, ...]:
        """Return one row."""
        return (SearchRow(CentreBody(), self.obstacle(self.minimum)),)


@dataclass(frozen=True, eq=False)
class Requirement:
    """Clearances of one kind for some modules."""

    equation: int
    """Number of its equation in the printed problem (`nlp.problem`)."""
    name: Callable[[int, int, int | None], str]
    """Returns the constraint's name for (i, j, segment)."""
    subjects: Subjects
    formulas: tuple[Formula, ...]
    margin: float
    """Required clearance beyond zero [l_arm]."""
    near: float = math.inf
    """Clearance above which a round of Ipopt leaves out a row [l_arm]."""

    def rows(self) -> Iterator[tuple[str, tuple[int, ...], Formula]]:
        """Yield name, subject and formula of every clearance."""
        for subject in map(tuple, self.subjects.tolist()):
            for formula in self.formulas:
                yield self.name(subject[0], subject[1], formula.segment), subject, formula

    def gaps(self, vectors: VectorsByName) -> Array:
        """Return the exact clearances of all subjects and formulas, shape (m, len(formulas)) [l_arm]."""
        m, columns = len(self.subjects), self.subjects.T
        y = {vector: vector.at(vectors, columns) for formula in self.formulas for vector in formula.local_vectors}
        exact = (formula.exact([y[vector] for vector in formula.local_vectors]) for formula in self.formulas)
        return np.stack([np.broadcast_to(gaps, m) for gaps in exact], axis=-1)

    def restrict(self, vectors: VectorsByName) -> Requirement:
        """Return the requirement for one round of Ipopt: only the subjects that are near at this platform."""
        if self.near == math.inf:
            return self
        return replace(self, subjects=self.subjects[(self.gaps(vectors) < self.near).any(axis=1)])

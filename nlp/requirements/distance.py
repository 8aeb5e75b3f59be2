"""Least distances of two points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlp.requirements.kinds import Kernel
from nlp.requirements.statement import LocalVector
from topo_search.model.arrays import Array


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
        gap: Array = np.linalg.norm(y[0], axis=-1) - self.least
        return gap

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(self.kind, size=self.least),)

"""The vectors that clearances are functions of: values, derivatives, and where a gradient by them goes.

The geometric unknowns x are theta (n+2 angles) and p'_E (3, unless the task fixes the position from the COM).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nlp.assembled.chain import Links
from topo_search.model.arrays import Array

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass
class Gradients:
    """Gradients of the Lagrangian by what the platform carries."""

    p: Array
    z: Array
    p_E: Array = field(default_factory=lambda: np.zeros(3))
    p_COM: Array = field(default_factory=lambda: np.zeros(3))


class Platform:
    """The platform at some geometric unknowns."""

    def __init__(self, links: Links, p_E: Array, m_E: float, *, free: bool) -> None:
        """Place the end-effector, of mass m_E [m]; `free`: p'_E is an unknown, else the modules carry it along."""
        self.links, self.p_E, self.free = links, p_E, free
        n = len(links.p)
        self._share = m_E / (n + m_E)  # of the end-effector in the COM
        self.p_COM = self._share * p_E + (1 - self._share) * links.p.mean(axis=0)

    @cached_property
    def dp_E(self) -> Array:
        """Derivative of p'_E by x, shape (3, len(x))."""
        centroid = self.links.dp.mean(axis=0)
        return np.concatenate([np.zeros_like(centroid), np.eye(3)], axis=1) if self.free else centroid

    @cached_property
    def dp_COM(self) -> Array:
        """Derivative of p_COM by x, shape (3, len(x))."""
        centroid = self.links.dp.mean(axis=0)
        by_COM = self._share * self.dp_E
        by_COM[:, : centroid.shape[1]] += (1 - self._share) * centroid
        return by_COM

    @property
    def size(self) -> int:
        """Number of geometric unknowns."""
        return int(self.dp_E.shape[1])

    def pushed_to_modules(self, gradients: Gradients) -> Array:
        """Return the gradient by the modules' positions, p_COM's and a carried p'_E's shares included, (n, 3)."""
        n = len(gradients.p)
        on_centroid = (1 - self._share) * gradients.p_COM
        if not self.free:
            on_centroid = on_centroid + gradients.p_E + self._share * gradients.p_COM
        result: Array = gradients.p + on_centroid / n
        return result


class LocalVector(Protocol):
    """One vector for each of m clearances."""

    def value(self, at: Platform) -> Array:
        """Return the vectors, shape (m, 3)."""

    def slope(self, at: Platform) -> Array:
        """Return their derivatives by x, shape (m, 3, len(x))."""

    def push(self, gradient: Array, to: Gradients) -> None:
        """Add a gradient by the vectors, shape (m, 3), to the gradients by what they are made of."""

    def depends(self, moves: Mask, free_p_E: bool) -> Mask:
        """Return which angles (and p'_E last) the vectors depend on, up to a common turn, shape (m, n+3)."""


@dataclass(frozen=True)
class Between:
    """p_i - p_j."""

    i: Indices
    j: Indices

    def value(self, at: Platform) -> Array:
        """See `LocalVector`."""
        return at.links.p[self.i] - at.links.p[self.j]

    def slope(self, at: Platform) -> Array:
        """See `LocalVector`."""
        return _padded(at.links.dp[self.i] - at.links.dp[self.j], at)

    def push(self, gradient: Array, to: Gradients) -> None:
        """See `LocalVector`."""
        np.add.at(to.p, self.i, gradient)
        np.add.at(to.p, self.j, -gradient)

    def depends(self, moves: Mask, free_p_E: bool) -> Mask:
        """Only the angles between the modules: an angle that moves both changes no clearance of theirs."""
        return _columns((moves[:, self.i] ^ moves[:, self.j]).T, False)


@dataclass(frozen=True)
class ThrustAxis:
    """z_i, beside a vector that already names module i."""

    i: Indices

    def value(self, at: Platform) -> Array:
        """See `LocalVector`."""
        return at.links.z[self.i]

    def slope(self, at: Platform) -> Array:
        """See `LocalVector`."""
        return _padded(at.links.dz[self.i], at)

    def push(self, gradient: Array, to: Gradients) -> None:
        """See `LocalVector`."""
        np.add.at(to.z, self.i, gradient)

    def depends(self, moves: Mask, free_p_E: bool) -> Mask:
        """Nothing beyond what the vector beside it depends on."""
        return np.zeros((len(self.i), len(moves) + 1), dtype=bool)


@dataclass(frozen=True)
class FromTip:
    """p_i - p'_E."""

    i: Indices

    def value(self, at: Platform) -> Array:
        """See `LocalVector`."""
        return at.links.p[self.i] - at.p_E

    def slope(self, at: Platform) -> Array:
        """See `LocalVector`."""
        return _padded(at.links.dp[self.i], at) - at.dp_E

    def push(self, gradient: Array, to: Gradients) -> None:
        """See `LocalVector`."""
        np.add.at(to.p, self.i, gradient)
        to.p_E -= gradient.sum(axis=0)

    def depends(self, moves: Mask, free_p_E: bool) -> Mask:
        """The angles that move module i, and p'_E; all angles if those place p'_E."""
        angles = moves[:, self.i].T
        return _columns(angles if free_p_E else np.ones_like(angles), True)


@dataclass(frozen=True)
class Offset:
    """p_E = p'_E - p_COM, the same for all m clearances."""

    m: int

    def value(self, at: Platform) -> Array:
        """See `LocalVector`."""
        return np.broadcast_to(at.p_E - at.p_COM, (self.m, 3))

    def slope(self, at: Platform) -> Array:
        """See `LocalVector`."""
        return np.broadcast_to(at.dp_E - at.dp_COM, (self.m, 3, at.size))

    def push(self, gradient: Array, to: Gradients) -> None:
        """See `LocalVector`."""
        to.p_E += gradient.sum(axis=0)
        to.p_COM -= gradient.sum(axis=0)

    def depends(self, moves: Mask, free_p_E: bool) -> Mask:
        """Everything: every module has a share in the COM."""
        return np.ones((self.m, len(moves) + 1), dtype=bool)


def _padded(by_theta: Array, at: Platform) -> Array:
    """Return derivatives by theta as derivatives by x."""
    slope = np.zeros((*by_theta.shape[:2], at.size))
    slope[:, :, : by_theta.shape[2]] = by_theta
    return slope


def _columns(angles: Mask, p_E: bool) -> Mask:
    return np.concatenate([angles, np.full((len(angles), 1), p_E)], axis=1)

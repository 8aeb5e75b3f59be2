"""The vectors that clearances are functions of: differences of vectors of the platform.

| symbol | meaning | shape | unit |
|---|---|---|---|
| x | geometric unknowns: theta, then p'_E unless the task fixes it from the COM | (g,) | rad, l_arm |
| V | platform vectors: p_0..p_{n-1}, p'_E, p_COM, the modules' axes z, x and y, and zero | (4n+3, 3) | l_arm, - |
| dV | their derivatives by x | (4n+3, g, 3) | |
| y | local vectors of a clearance, V[plus] - V[minus] each; s of them | (s, 3) | |
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nlp.assembled.chain import Links
from nlp.numbers.masses import Masses
from nlp.requirements.statement import LocalVector, PlatformVector
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class VectorLayout:
    """Layout of the platform vectors of n modules in V."""

    n: int

    @property
    def tip(self) -> int:
        """p'_E."""
        return self.n

    @property
    def com(self) -> int:
        """p_COM."""
        return self.n + 1

    @property
    def nothing(self) -> int:
        """Zero."""
        return 4 * self.n + 2

    def ends(self, vector: LocalVector, subjects: Indices) -> tuple[Indices | int, Indices | int]:
        """Return where both ends of a local vector stand, of subjects i and j, shape (2, m)."""
        return self._index(vector.plus, subjects), self._index(vector.minus, subjects)

    def _index(self, vector: PlatformVector | None, subjects: Indices) -> Indices | int:
        if vector is None:
            return self.nothing
        if vector.of is None:
            return {"p'_E": self.tip, "p_COM": self.com}[vector.name]
        first: int = {"p": 0, "z": self.n + 2, "x": 2 * self.n + 2, "y": 3 * self.n + 2}[vector.name]
        index: Indices = first + subjects[vector.of]
        return index

    def all_movers(self, moves: Mask, *, free: bool) -> Mask:
        """Return which of the unknowns move each platform vector, shape (4n+3, g).

        Args:
            moves: [j, i]: angle j moves module i.
            free: p'_E is an unknown; else it stands where the modules and joints take it.
        """
        n, angles = self.n, len(moves)
        mask = np.zeros((4 * n + 3, angles + (3 if free else 0)), dtype=bool)
        mask[:n, :angles] = moves.T
        mask[n + 2 : -1, :angles] = np.tile(moves.T, (3, 1))
        mask[self.tip, angles:] = True
        mask[self.tip, :angles] = not free
        mask[self.com] = True
        return mask


@dataclass(frozen=True)
class Differences:
    """The s local vectors of m clearances: V[plus] - V[minus], indices of shape (m, s)."""

    plus: Indices
    minus: Indices

    @staticmethod
    def of(*vectors: tuple[Indices | int, Indices | int]) -> Differences:
        """Return those of s pairs (plus, minus), of m indices each or one for all."""
        columns = np.broadcast_arrays(*(side for vector in vectors for side in vector))
        indices = np.stack([column.ravel() for column in columns], axis=-1)
        return Differences(np.ascontiguousarray(indices[:, ::2]), np.ascontiguousarray(indices[:, 1::2]))

    def values(self, at: PlatformVectors) -> Array:
        """Return y, shape (m, s, 3)."""
        result: Array = _differences(at.V, self.plus, self.minus)
        return result

    def movers(self, moved: Mask) -> Mask:
        """Return which unknowns move one of a clearance's vectors, shape (m, g), given `all_movers`."""
        return np.asarray(moved[self._involved].any(axis=1))

    def common_turns(self, moved: Mask, n: int) -> Mask:
        """Return which unknowns turn all of a clearance's vectors as one, which leaves it as it is, shape (m, g).

        No angle does that to p_COM, nor to p'_E where the modules and joints take it along.
        """
        layout = VectorLayout(n)
        as_one = moved.copy()
        as_one[layout.com] = as_one[layout.tip] = False
        as_one[layout.nothing] = True
        return np.asarray(as_one[self._involved].all(axis=1))

    @property
    def _involved(self) -> Indices:
        return np.concatenate([self.plus, self.minus], axis=1)


class PlatformVectors:
    """V and dV at some geometric unknowns."""

    def __init__(self, links: Links, tip: Array, masses: Masses, *, free: bool) -> None:
        """Place the end-effector.

        Args:
            links: where the modules are.
            tip: p'_E; from B (`nlp.numbers.masses`) unless free.
            masses: those of the platform.
            free: p'_E is an unknown; else B takes it along.
        """
        self.links, self._free = links, free
        self._share, self._masses, self._bodies = masses.tip / masses.total, masses.modules, masses.bodies
        self._moments = masses.modules[:, None] * masses.centres
        self.axes = np.ascontiguousarray(links.R.transpose(2, 0, 1)[[2, 0, 1]].reshape(-1, 3))
        """z, x and y of all modules, shape (3n, 3)."""
        self.V = _vectors(links.p, self.axes, tip, self._share, self._bodies, self._masses, self._moments, free)

    @property
    def p_E(self) -> Array:
        """p'_E."""
        p_E: Array = self.V[len(self.links.p)]
        return p_E

    @property
    def p_COM(self) -> Array:
        """Centre of mass."""
        p_COM: Array = self.V[len(self.links.p) + 1]
        return p_COM

    @cached_property
    def dV(self) -> Array:
        """Derivatives of V by x."""
        links = self.links
        shares = self._share, self._bodies, self._masses, self._moments
        return _derivatives(links.p, self.axes, links.omega, links.v, links.chain.moves, *shares, self._free)

    def push_to_modules(self, gradients: Array) -> tuple[Array, Array]:
        """Return the gradients by the modules' positions, (n, 3), and axes, (3n, 3).

        They include what p_COM and a p'_E that is not free add.

        Args:
            gradients: by V, shape (4n+3, 3).
        """
        n = len(self.links.p)
        by_tip, by_com = gradients[n], gradients[n + 1]
        by_B = (1 - self._share) * by_com
        if not self._free:
            by_B = by_B + by_tip + self._share * by_com
        by_axes = gradients[n + 2 : -1].copy()
        by_axes[n:] += np.outer(self._moments.T.ravel(), by_B) / self._bodies
        return gradients[:n] + np.outer(self._masses, by_B) / self._bodies, by_axes


@njit(cache=True)
def _vectors(
    p: Array, axes: Array, tip: Array, share: float, bodies: float, masses: Array, moments: Array, free: bool
) -> Array:
    """Return V; see `PlatformVectors`."""
    n = len(p)
    V = np.zeros((4 * n + 3, 3))
    V[n + 2 : -1] = axes
    for i in range(n):
        V[i] = p[i]
        moment = masses[i] * p[i] + moments[i, 0] * axes[n + i] + moments[i, 1] * axes[2 * n + i]
        V[n + 1] += moment / bodies  # B, until the COM is known
    V[n] = tip if free else tip + V[n + 1]
    V[n + 1] = share * V[n] + (1 - share) * V[n + 1]
    return V


@njit(cache=True)
def _differences(V: Array, plus: Indices, minus: Indices) -> Array:
    """Return V[plus] - V[minus]."""
    m, s = plus.shape
    y = np.empty((m, s, 3))
    for r in range(m):
        for part in range(s):
            a, b = plus[r, part], minus[r, part]
            for axis in range(3):
                y[r, part, axis] = V[a, axis] - V[b, axis]
    return y


@njit(cache=True)
def _derivatives(
    p: Array,
    axes: Array,
    omega: Array,
    v: Array,
    moves: Array,
    share: float,
    bodies: float,
    masses: Array,
    moments: Array,
    free: bool,
) -> Array:
    """Return dV; `share` is that of the end-effector in the COM, B the moment of the modules over `bodies`."""
    n, angles = len(p), len(omega)
    dV = np.zeros((4 * n + 3, angles + (3 if free else 0), 3))
    tip, com = n, n + 1
    for j in range(angles):
        a, b, c = omega[j]
        for i in range(n):
            if moves[j, i] != 0.0:
                x, y, w = p[i]
                dV[i, j, 0] = b * w - c * y + v[j, 0]
                dV[i, j, 1] = c * x - a * w + v[j, 1]
                dV[i, j, 2] = a * y - b * x + v[j, 2]
                for k in (i, n + i, 2 * n + i):
                    x, y, w = axes[k]
                    dV[n + 2 + k, j, 0] = b * w - c * y
                    dV[n + 2 + k, j, 1] = c * x - a * w
                    dV[n + 2 + k, j, 2] = a * y - b * x
                at_x, at_y = 2 * n + 2 + i, 3 * n + 2 + i
                moment = masses[i] * dV[i, j] + moments[i, 0] * dV[at_x, j] + moments[i, 1] * dV[at_y, j]
                dV[com, j] += moment / bodies
        if not free:
            dV[tip, j] = dV[com, j]
        else:
            dV[com, j] *= 1.0 - share
    if free:
        for axis in range(3):
            dV[tip, angles + axis, axis] = 1.0
            dV[com, angles + axis, axis] = share
    return dV

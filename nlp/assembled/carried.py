"""The vectors that clearances are functions of: differences of what the platform carries.

| symbol | meaning | shape | unit |
|---|---|---|---|
| x | geometric unknowns: theta, then p'_E unless the task fixes it from the COM | (g,) | rad, l_arm |
| V | carried vectors: p_0..p_{n-1}, p'_E, p_COM, z_0..z_{n-1}, and zero | (2n+3, 3) | l_arm, - |
| dV | their derivatives by x | (2n+3, g, 3) | |
| y | local vectors of a clearance, V[plus] - V[minus] each; s of them | (s, 3) | |
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nlp.assembled.chain import Links
from topo_search.model.arrays import Array

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Carried:
    """Where the carried vectors of n modules stand in V."""

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
        return 2 * self.n + 2

    def axis(self, i: Indices) -> Indices:
        """z_i."""
        return self.n + 2 + i

    def moved(self, moves: Mask, *, free: bool) -> Mask:
        """Return which of the unknowns move each carried vector, shape (2n+3, g).

        Args:
            moves: [j, i]: angle j moves module i.
            free: p'_E is an unknown; else it stands where the modules' centroid takes it.
        """
        n, angles = self.n, len(moves)
        mask = np.zeros((2 * n + 3, angles + (3 if free else 0)), dtype=bool)
        mask[:n, :angles] = mask[n + 2 : 2 * n + 2, :angles] = moves.T
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

    def values(self, at: Platform) -> Array:
        """Return y, shape (m, s, 3)."""
        result: Array = at.V[self.plus] - at.V[self.minus]
        return result

    def moving(self, moved: Mask) -> Mask:
        """Return which unknowns move one of a clearance's vectors, shape (m, g); `moved`: see `Carried`."""
        return np.asarray(moved[self._involved].any(axis=1))

    def turned_as_one(self, moved: Mask, n: int) -> Mask:
        """Return which unknowns turn all of a clearance's vectors as one, which leaves it as it is, shape (m, g).

        No angle does that to p_COM, nor to p'_E where the modules' centroid takes it along.
        """
        carried = Carried(n)
        as_one = moved.copy()
        as_one[carried.com] = as_one[carried.tip] = False
        as_one[carried.nothing] = True
        return np.asarray(as_one[self._involved].all(axis=1))

    @property
    def _involved(self) -> Indices:
        return np.concatenate([self.plus, self.minus], axis=1)


class Platform:
    """The platform at some geometric unknowns."""

    def __init__(self, links: Links, p_E: Array, m_E: float, *, free: bool) -> None:
        """Place the end-effector, of mass m_E [m]; `free`: p'_E is an unknown, else the modules carry it along."""
        self.links, self.p_E, self.free = links, p_E, free
        n = len(links.p)
        self._share = m_E / (n + m_E)  # of the end-effector in the COM
        self.p_COM = self._share * p_E + (1 - self._share) * links.p.mean(axis=0)
        self.V = np.concatenate([links.p, p_E[None], self.p_COM[None], links.z, np.zeros((1, 3))])

    @cached_property
    def dV(self) -> Array:
        """Derivatives of V by x."""
        links = self.links
        return _derivatives(links.p, links.z, links.omega, links.v, links.chain.moves, self._share, self.free)

    def pushed_to_modules(self, gradients: Array) -> Array:
        """Return the gradient by the modules' positions, p_COM's and a carried p'_E's shares included, (n, 3).

        Args:
            gradients: by V, shape (2n+3, 3).
        """
        n = len(self.links.p)
        by_tip, by_com = gradients[n], gradients[n + 1]
        on_centroid = (1 - self._share) * by_com
        if not self.free:
            on_centroid = on_centroid + by_tip + self._share * by_com
        result: Array = gradients[:n] + on_centroid / n
        return result


@njit(cache=True)
def _derivatives(p: Array, z: Array, omega: Array, v: Array, moves: Array, share: float, free: bool) -> Array:
    """Return dV; `share` is that of the end-effector in the COM."""
    n, angles = len(p), len(omega)
    dV = np.zeros((2 * n + 3, angles + (3 if free else 0), 3))
    tip, com = n, n + 1
    for j in range(angles):
        a, b, c = omega[j]
        for i in range(n):
            if moves[j, i] != 0.0:
                x, y, w = p[i]
                dV[i, j, 0] = b * w - c * y + v[j, 0]
                dV[i, j, 1] = c * x - a * w + v[j, 1]
                dV[i, j, 2] = a * y - b * x + v[j, 2]
                x, y, w = z[i]
                dV[n + 2 + i, j, 0] = b * w - c * y
                dV[n + 2 + i, j, 1] = c * x - a * w
                dV[n + 2 + i, j, 2] = a * y - b * x
                dV[com, j] += dV[i, j] / n
        if not free:
            dV[tip, j] = dV[com, j]
        else:
            dV[com, j] *= 1.0 - share
    if free:
        for axis in range(3):
            dV[tip, angles + axis, axis] = 1.0
            dV[com, angles + axis, axis] = share
    return dV


@njit(cache=True)
def chain_rule(gradient: Array, plus: Indices, minus: Indices, dV: Array, rows: Indices, columns: Indices) -> Array:
    """Return the derivatives of clearances by x where they are not zero: entry e is row rows[e], column columns[e].

    Args:
        gradient: by the local vectors, shape (m, s, 3).
        plus: see `Differences`.
        minus: see `Differences`.
        dV: see the notation.
        rows: of the entries.
        columns: of the entries.
    """
    entries = np.zeros(len(rows))
    for e in range(len(rows)):
        r, j = rows[e], columns[e]
        for part in range(plus.shape[1]):
            a, b = plus[r, part], minus[r, part]
            for axis in range(3):
                entries[e] += gradient[r, part, axis] * (dV[a, j, axis] - dV[b, j, axis])
    return entries


@njit(cache=True)
def add_curvature(
    hessian: Array, plus: Indices, minus: Indices, dV: Array, starts: Indices, columns: Indices, H: Array
) -> None:
    """Add dy^T hessian dy of every clearance to H, shape (g, g), upper triangle.

    Args:
        hessian: by the local vectors, times the multiplier, shape (m, 3 s, 3 s).
        plus: see `Differences`.
        minus: see `Differences`.
        dV: see the notation.
        starts: of each clearance's unknowns in `columns`, shape (m+1,).
        columns: unknowns that move one of its vectors, in ascending order.
        H: is added to.
    """
    size = hessian.shape[1]
    dy, bent = np.empty((dV.shape[1], size)), np.empty(size)
    for r in range(len(plus)):
        first, last = starts[r], starts[r + 1]
        for e in range(first, last):
            j = columns[e]
            for part in range(plus.shape[1]):
                a, b = plus[r, part], minus[r, part]
                for axis in range(3):
                    dy[e - first, 3 * part + axis] = dV[a, j, axis] - dV[b, j, axis]
        for e in range(first, last):
            for one in range(size):
                bent[one] = 0.0
                for other in range(size):
                    bent[one] += hessian[r, one, other] * dy[e - first, other]
            for later in range(e, last):
                total = 0.0
                for one in range(size):
                    total += bent[one] * dy[later - first, one]
                H[columns[e], columns[later]] += total


@njit(cache=True)
def add_gradients(gradient: Array, plus: Indices, minus: Indices, to: Array) -> None:
    """Add gradients by local vectors, shape (m, s, 3), to the gradients by V, shape (2n+3, 3)."""
    for r in range(len(plus)):
        for part in range(plus.shape[1]):
            for axis in range(3):
                to[plus[r, part], axis] += gradient[r, part, axis]
                to[minus[r, part], axis] -= gradient[r, part, axis]

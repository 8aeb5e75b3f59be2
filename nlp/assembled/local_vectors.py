r"""The vectors that clearances are functions of: differences of vectors of the platform.

| symbol | meaning | shape | unit |
|---|---|---|---|
| x | geometric unknowns: theta, then p'_E unless the task fixes it from the COM | (g,) | rad, l_arm |
| V | platform vectors: p_0..p_{n-1}, p'_E, p_COM, the modules' axes z, x and y, and zero | (4n+3, 3) | l_arm, - |
| dV | their derivatives by x | (4n+3, g, 3) | |
| y | local vectors of a clearance, V[plus] - V[minus] each; s of them | (s, 3) | |

Poses along the kinematic chain, and the axes that give their derivatives.

| symbol | meaning | shape | unit |
|---|---|---|---|
| theta | psi, alpha_0, alpha_1 of the root, then the hinge angles | (n+2,) | rad |
| omega_j, c_j | axis that theta_j turns about, and a point on it | (3,) | -, l_arm |
| v_j = c_j x omega_j | velocity of W's origin under the unit turn | (3,) | l_arm |

Every angle turns all that lies outward of it as one rigid body:

.. math::

    \partial_j p = \omega_j \times p + v_j, \quad \partial_j z = \omega_j \times z

and, with j inward of k or the same, \partial_j \partial_k p = \omega_j \times (\omega_k \times p + v_k), and so on.

From derivatives of clearances by their local vectors to those by the geometric unknowns, compiled.

| symbol | meaning | shape | unit |
|---|---|---|---|
| x, V, dV, y | unknowns, vectors, their derivatives, local vectors; see `nlp.assembled.local_vectors` | | |
| plus, minus | indices in V of a clearance's local vectors, y = V[plus] - V[minus] | (m, s) | |
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp.numbers.kinematics import Tree, chain
from nlp.numbers.masses import Masses
from nlp.requirements.statement import LocalVector, PlatformVector
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class Links(NamedTuple):
    """Poses at some angles, with the angles' axes."""

    R: Array
    p: Array
    omega: Array
    v: Array


@njit(cache=True)
def links_at(theta: Array, tree: Tree, l_c: float) -> Links:
    """Return the poses at some angles, lengths in the unit of l_c."""
    R, p, omega, c = chain(theta, tree.parent, tree.port, tree.kappa, l_c)
    v = np.zeros_like(c)
    for j in range(3, len(c)):
        add_cross(c[j], omega[j], 1.0, v[j])
    return Links(R, p, omega, v)


@njit(cache=True)
def dot(a: Array, b: Array) -> float:
    """Return a . b, many times faster than NumPy on three numbers."""
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@njit(cache=True)
def add_cross(a: Array, b: Array, factor: float, to: Array) -> None:
    """Add factor a x b to a vector."""
    to[0] += factor * (a[1] * b[2] - a[2] * b[1])
    to[1] += factor * (a[2] * b[0] - a[0] * b[2])
    to[2] += factor * (a[0] * b[1] - a[1] * b[0])


Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


class VectorLayout:
    """Layout of the platform vectors of n modules in V, and which unknowns move them."""

    def __init__(self, moves: Mask, *, free: bool) -> None:
        """Index them.

        Args:
            moves: [j, i]: angle j moves module i.
            free: p'_E is an unknown; else it stands where the modules and joints take it.
        """
        angles, n = moves.shape
        tip, com = n, n + 1
        self._nothing: int = 4 * n + 2
        self._first = {"p": 0, "p'_E": tip, "p_COM": com, "z": n + 2, "x": 2 * n + 2, "y": 3 * n + 2}
        self.moved = np.zeros((4 * n + 3, angles + (3 if free else 0)), dtype=bool)
        """Which unknowns move each vector, shape (4n+3, g)."""
        self.moved[:n, :angles] = moves.T
        self.moved[n + 2 : -1, :angles] = np.tile(moves.T, (3, 1))
        self.moved[tip, angles:] = True
        self.moved[tip, :angles] = not free
        self.moved[com] = True
        self.turned = self.moved.copy()
        """Which of them turn it with all that they move, shape (4n+3, g).

        No angle does that to p_COM, nor to p'_E where the modules and joints take it along."""
        self.turned[[tip, com]] = False
        self.turned[self._nothing] = True

    def endpoints(self, vectors: Iterable[LocalVector], subjects: Indices) -> tuple[Indices, Indices]:
        """Return where both ends of s local vectors of m subjects (i, j) stand, V[plus] - V[minus]: (m, s) each."""
        sides = [self._index(side, subjects) for vector in vectors for side in vector]
        indices = np.stack([column.ravel() for column in np.broadcast_arrays(*sides)], axis=-1)
        return np.ascontiguousarray(indices[:, ::2]), np.ascontiguousarray(indices[:, 1::2])

    def _index(self, vector: PlatformVector | None, subjects: Indices) -> Indices | int:
        if vector is None:
            return self._nothing
        first: int = self._first[vector.name]
        if vector.of is None:
            return first
        index: Indices = first + subjects[vector.of]
        return index


class PlatformVectors:
    """V and dV at some geometric unknowns."""

    def __init__(self, links: Links, moves: Mask, tip: Array, masses: Masses, *, free: bool) -> None:
        """Place the end-effector.

        Args:
            links: where the modules are.
            moves: [j, i]: angle j moves module i.
            tip: p'_E; from B (`nlp.numbers.masses`) unless free.
            masses: those of the platform.
            free: p'_E is an unknown; else B takes it along.
        """
        self.links, self._moves, self._free = links, moves, free
        self._share, self._masses, self._bodies = masses.tip / masses.total, masses.modules, masses.bodies
        self._moments = masses.modules[:, None] * masses.centres
        self.axes = np.ascontiguousarray(links.R.transpose(2, 0, 1)[[2, 0, 1]].reshape(-1, 3))
        """z, x and y of all modules, shape (3n, 3)."""
        self.V = _vectors(links.p, self.axes, tip, self._share, self._bodies, self._masses, self._moments, free)

    @property
    def p_E(self) -> Array:
        """p'_E."""
        return np.asarray(self.V[len(self.links.p)])

    @property
    def p_COM(self) -> Array:
        """Centre of mass."""
        return np.asarray(self.V[len(self.links.p) + 1])

    @cached_property
    def dV(self) -> Array:
        """Derivatives of V by x."""
        links = self.links
        shares = self._share, self._bodies, self._masses, self._moments
        return _derivatives(links.p, self.axes, links.omega, links.v, self._moves, *shares, self._free)

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
def differences(V: Array, plus: Indices, minus: Indices) -> Array:
    """Return y, V[plus] - V[minus], shape (m, s, 3)."""
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
    moves: Mask,
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
            if moves[j, i]:
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


@njit(cache=True)
def chain_rule(gradient: Array, plus: Indices, minus: Indices, dV: Array, rows: Indices, columns: Indices) -> Array:
    """Return the derivatives of clearances by x where they are not zero: entry e is row rows[e], column columns[e].

    Args:
        gradient: by the local vectors, shape (m, s, 3).
        plus: see the notation.
        minus: see the notation.
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
    multipliers: Array,
    hessian: Array,
    plus: Indices,
    minus: Indices,
    dV: Array,
    starts: Indices,
    columns: Indices,
    H: Array,
) -> None:
    """Add dy^T hessian dy of every clearance, times its multiplier, to H, shape (g, g), upper triangle.

    Args:
        multipliers: of the clearances, shape (m,).
        hessian: by the local vectors, shape (m, 3 s, 3 s).
        plus: see the notation.
        minus: see the notation.
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
                bent[one] *= multipliers[r]
            for later in range(e, last):
                total = 0.0
                for one in range(size):
                    total += bent[one] * dy[later - first, one]
                H[columns[e], columns[later]] += total


@njit(cache=True)
def add_gradients(multipliers: Array, gradient: Array, plus: Indices, minus: Indices, to: Array) -> None:
    """Add gradients by local vectors, shape (m, s, 3), times multipliers, to those by V, shape (4n+3, 3)."""
    for r in range(len(plus)):
        for part in range(plus.shape[1]):
            for axis in range(3):
                push = multipliers[r] * gradient[r, part, axis]
                to[plus[r, part], axis] += push
                to[minus[r, part], axis] -= push

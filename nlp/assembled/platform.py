r"""The numeric platform: its vectors and its rotors' wrenches, with derivatives along the kinematic chain.

| symbol | meaning | shape | unit |
|---|---|---|---|
| theta | psi, alpha_0, alpha_1 of the root, then the hinge angles | (n+2,) | rad |
| x | geometric unknowns: theta, then p'_E unless the task fixes it from the COM | (g,) | rad, l_arm |
| V | p, axes x, y and z of all modules, then p'_E, p_COM and zero | (4n+3, 3) | l_arm, - |
| dV | derivatives of V by x | (4n+3, g, 3) | |
| y | local vectors of a clearance, V[plus] - V[minus] each; s of them | (s, 3) | |
| A | wrench of every rotor at unit input about W's origin, over n | (r n, 6) | m g, l_arm m g |
| dA | derivatives of A by theta | (6, r n, n+2) | |
| omega_j, c_j | axis of theta_j, and a point on it | (3,) | -, l_arm |
| v_j = c_j x omega_j | velocity of W's origin at unit angular velocity | (3,) | l_arm |

Every angle turns everything outward of it as one rigid body: positions p, axes z and wrenches a = (f, m):

.. math::

    \partial_j p = \omega_j \times p + v_j, \quad \partial_j z = \omega_j \times z, \quad
    \partial_j a = X_j a = (\omega_j \times f,\; v_j \times f + \omega_j \times m)

With j inward of or equal to k, the second derivative is the inner angle's derivative of the first by the outer
angle: \partial_j \partial_k a = X_j \partial_k a, and so on.
"""

from collections.abc import Iterable
from functools import cached_property

import numpy as np

from nlp.numbers.geometry import cross, rotor_maps
from nlp.numbers.kinematics import chain, tree_of
from nlp.numbers.masses import masses
from nlp.requirements.statement import LocalVector, PlatformVector
from nlp.units import Units
from topo_search.model import Array, Indices, ResolvedTask, Topology

CROSS = np.cross(np.eye(3), np.eye(3)[:, None]).transpose(0, 2, 1)
"""Maps a, at the last index, to the matrix of a x b; the first index is that of b."""


class Layout:
    """Layout of V for one task and topology, and which unknowns move its vectors."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        n = topology.n
        self.n, self.tree = n, tree_of(topology)
        self.force_maps, self.torque_maps = rotor_maps(task)
        self.l_c = task.connector_distances / task.module.arm_length
        self.masses = carried = masses(task, topology)
        fixed = task.end_effector.fixed_position
        self.g = n + 2 + (3 if fixed is None else 0)
        share, moments = carried.tip / carried.total, carried.modules[:, None] * carried.centres
        B_weights = np.concatenate([carried.modules, *moments.T, np.zeros(n)]) / carried.bodies
        self.module_weights = np.outer((0.0, 1.0 - share) if fixed is None else (1.0, 1.0), B_weights)
        """Coefficients of the modules' vectors in p'_E and p_COM, shape (2, 4n)."""
        self.tip_weights = np.array([[1.0], [share]])
        """Coefficients in both of p'_E, or of its fixed offset from B (`nlp.numbers.masses`)."""
        self.fixed = None if fixed is None else carried.lever * np.array(fixed) / Units.of(task).length
        self.moves = np.tile(self.tree.moves.T, (4, 1)).astype(float)
        """1 if an angle moves a vector of a module, shape (4n, n+2)."""
        self.rotor_moves = np.repeat(self.moves[:n], task.rotors_per_module, axis=0)
        """1 if an angle moves a rotor, shape (r n, n+2)."""
        self.inward = np.zeros((n + 2, n + 2))
        """1 if angle j is inward of or equal to k."""
        self.inward[:, 3:], self.inward[:3, :3] = self.tree.moves[:, 1:], np.triu(np.ones((3, 3)))
        self.moved = np.zeros((4 * n + 3, self.g), dtype=bool)
        """Mask of unknowns that move each vector, shape (4n+3, g)."""
        self.moved[: 4 * n, : n + 2] = self.moves > 0
        self.turned = self.moved.copy()
        """Mask of angles that turn it rigidly: none for p_COM, nor for a p'_E fixed from it."""
        self.turned[-1] = True
        self.moved[4 * n, (n + 2 if fixed is None else 0) :] = True
        self.moved[4 * n + 1] = True

    def endpoints(self, vectors: Iterable[LocalVector], subjects: Indices) -> tuple[Indices, Indices]:
        """Return the indices of local vectors V[plus] - V[minus] of m subjects (i, j), shape (m, s) each."""
        sides = [self._index(side, subjects) for vector in vectors for side in vector]
        indices = np.stack([column.ravel() for column in np.broadcast_arrays(*sides)], axis=-1)
        return np.ascontiguousarray(indices[:, ::2]), np.ascontiguousarray(indices[:, 1::2])

    def _index(self, vector: PlatformVector | None, subjects: Indices) -> Indices | int:
        names = ("p", "x", "y", "z")
        if vector is None or vector.module is None:
            return 4 * self.n + (2 if vector is None else ("p'_E", "p_COM").index(vector.name))
        index: Indices = names.index(vector.name) * self.n + subjects[vector.module]
        return index


class AssembledPlatform:
    """V and A at geometric unknowns x."""

    def __init__(self, layout: Layout, x: Array) -> None:
        self._layout, n, tree = layout, layout.n, layout.tree
        R, p, self._omega, self._c = chain(x[: n + 2], tree.parent, tree.port, tree.kappa, layout.l_c)
        self.V = np.zeros((4 * n + 3, 3))
        self.V[:n], self.V[n : 4 * n] = p, R.transpose(2, 0, 1).reshape(-1, 3)
        tip = x[n + 2 :] if layout.fixed is None else layout.fixed
        self.V[4 * n : -1] = layout.module_weights @ self.V[: 4 * n] + layout.tip_weights * tip
        forces, torques = (
            (R @ by_inputs / n).transpose(0, 2, 1) for by_inputs in (layout.force_maps, layout.torque_maps)
        )
        self.A = np.concatenate([forces, cross(p[:, None], forces) + torques], axis=2).reshape(-1, 6)

    @cached_property
    def _v(self) -> Array:
        return cross(self._c, self._omega)

    @cached_property
    def _X(self) -> Array:
        """X_j, shape (6, 6, n+2); the first index is that of its argument."""
        X = np.zeros((6, 6, len(self._omega)))
        X[:3, :3] = X[3:, 3:] = CROSS @ self._omega.T
        X[:3, 3:] = CROSS @ self._v.T
        return X

    @cached_property
    def dV(self) -> Array:
        """Derivatives of V by x."""
        layout, n, angles = self._layout, self._layout.n, len(self._omega)
        turn = self._X[:3, :3].transpose(0, 2, 1).reshape(3, -1)
        modules, result = (self.V[: 4 * n] @ turn).reshape(-1, angles, 3), np.zeros((len(self.V), layout.g, 3))
        modules[:n] += self._v
        modules *= layout.moves[:, :, None]
        result[: 4 * n, :angles] = modules
        result[4 * n : -1, :angles] = (layout.module_weights @ modules.reshape(4 * n, -1)).reshape(2, angles, 3)
        if layout.fixed is None:
            result[4 * n : -1, angles:] = layout.tip_weights[:, :, None] * np.eye(3)
        return result

    @cached_property
    def dA(self) -> Array:
        """Derivatives of A by theta."""
        slopes: Array = self.A @ self._X.transpose(1, 0, 2)
        slopes *= self._layout.rotor_moves
        return slopes

    def curvature(self, by_V: Array, by_A: Array | None = None) -> Array:
        """Return the part of the second derivatives by x from the curvature of V and A: upper triangle.

        Args:
            by_V: gradient of the function by V.
            by_A: gradient of the function by A; None: it does not depend on A.
        """
        layout, n, angles = self._layout, self._layout.n, len(self._omega)
        by_modules = by_V[: 4 * n] + layout.module_weights.T @ by_V[4 * n : -1]
        by_moved = (by_modules.T @ self.dV[: 4 * n].reshape(4 * n, -1)).reshape(3, -1, 3)
        pushed = np.zeros((6, 6, angles)) if by_A is None else by_A.T @ self.dA  # moved wrench, then gradient by A
        pushed[:3, :3] += by_moved.transpose(2, 0, 1)[:, :, :angles]
        H = np.zeros((layout.g, layout.g))
        H[:angles, :angles] = (self._X.reshape(36, angles).T @ pushed.reshape(36, angles)) * layout.inward
        return H

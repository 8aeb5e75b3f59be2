r"""Poses and their first and second derivatives along the kinematic chain.

| symbol | meaning | shape | unit |
|---|---|---|---|
| theta | psi, alpha_0, alpha_1 of the root, then the hinge angles | (n+2,) | rad |
| omega_j, c_j | axis that theta_j turns about, and a point on it | (3,) | -, l_arm |
| v_j = c_j x omega_j | velocity of W's origin under the unit turn | (3,) | l_arm |
| a = (f, m) | a force and its torque about W's origin, carried by a module | (6,) | |

Every angle turns all that lies outward of it as one rigid body:

.. math::

    \partial_j p = \omega_j \times p + v_j, \quad \partial_j z = \omega_j \times z, \quad
    \partial_j a = X_j a = (\omega_j \times f,\; v_j \times f + \omega_j \times m)

and, with j inward of k or the same, \partial_j \partial_k p = \omega_j \times (\omega_k \times p + v_k), and so on.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from nlp.geometry import PORTS, rotation
from topo_search.model import Topology
from topo_search.model.arrays import Array


class Chain:
    """The kinematic chain of a topology: what each angle moves."""

    def __init__(self, topology: Topology, l_c: float) -> None:
        """Index the tree; l_c in the unit of length that the poses shall have."""
        n = topology.n
        self.n, self.l_c = n, l_c
        outward = np.zeros((n, n), dtype=bool)  # [h, i]: module i is h or hangs on it
        for i, h in enumerate(topology.parents):
            outward[i, i] = True
            if h >= 0:
                outward[:, i] |= outward[:, h]
        self.moves = np.ones((n + 2, n))
        """[j, i] = 1 where theta_j moves module i, else 0."""
        self.moves[3:] = outward[1:]
        self.inward = np.zeros((n + 2, n + 2), dtype=bool)
        """[j, k]: theta_j is inward of theta_k, or the same."""
        self.inward[:3] = True
        self.inward[:3, :3] = np.triu(self.inward[:3, :3])
        self.inward[3:, 3:] = outward[1:, 1:]
        turns = (rotation([0, 0, 1], kappa * np.pi / 2).round() for kappa in topology.kappas[1:])
        self._joints = [(h, i, a, turn) for (h, i, a, _), turn in zip(topology.edges(), turns, strict=True)]

    def at(self, theta: Array) -> Links:
        """Return the poses at some angles."""
        n, l_c = self.n, self.l_c
        R, p = np.empty((n, 3, 3)), np.zeros((n, 3))
        omega, c = np.empty((n + 2, 3)), np.zeros((n + 2, 3))
        yaw = rotation([0, 0, 1], theta[0])
        tilt = yaw @ rotation([1, 0, 0], theta[1])
        omega[0], omega[1], omega[2] = (0, 0, 1), yaw[:, 0], tilt[:, 1]
        R[0] = tilt @ rotation([0, 1, 0], theta[2])
        cosines, sines = np.cos(theta).tolist(), np.sin(theta).tolist()
        for h, i, a, turn in self._joints:
            x, y, z = R[h].T
            cosine, sine = cosines[i + 2], sines[i + 2]
            if a % 2 == 0:  # Ry
                omega[i + 2] = y
                hinged = np.array([cosine * x - sine * z, y, sine * x + cosine * z]).T
            else:  # Rx
                omega[i + 2] = x
                hinged = np.array([x, cosine * y + sine * z, cosine * z - sine * y]).T
            c[i + 2] = p[h] + l_c * (R[h] @ PORTS[a])
            p[i] = c[i + 2] + l_c * (hinged @ PORTS[a])
            R[i] = hinged @ turn
        return Links(self, R, p, omega, cross(c, omega))


class Links:
    """Poses at some angles, and what follows from them."""

    def __init__(self, chain: Chain, R: Array, p: Array, omega: Array, v: Array) -> None:
        self.chain, self.R, self.p, self.omega, self.v = chain, R, p, omega, v
        self.z = R[:, :, 2]

    @cached_property
    def dp(self) -> Array:
        """Derivatives of p by theta, shape (n, 3, n+2)."""
        moved = (cross(self.omega[:, None], self.p) + self.v[:, None]) * self.chain.moves[..., None]
        return moved.transpose(1, 2, 0)

    @cached_property
    def dz(self) -> Array:
        """Derivatives of z by theta, shape (n, 3, n+2)."""
        return (cross(self.omega[:, None], self.z) * self.chain.moves[..., None]).transpose(1, 2, 0)

    @cached_property
    def X(self) -> Array:
        """The matrices X_j, shape (n+2, 6, 6)."""
        X = np.zeros((len(self.omega), 6, 6))
        X[:, :3, :3] = X[:, 3:, 3:] = skew(self.omega)
        X[:, 3:, :3] = skew(self.v)
        return X

    def outward(self, per_module: Array) -> Array:
        """Return the sums of a quantity of the modules over those that each angle moves, shape (n+2, ...)."""
        sums: Array = (self.chain.moves @ per_module.reshape(self.chain.n, -1)).reshape(-1, *per_module.shape[1:])
        return sums

    def curvature(self, T: Array, N: Array, g: Array) -> Array:
        """Return the second derivatives by theta of a sum over all that the modules carry, upper triangle.

        Args:
            T: sum of x y^T over a module's vectors x (z, p, f, m), y the sum's gradient by x, shape (n, 3, 3).
            N: sum of f y^T over a module's forces f, y the gradient by its torque m, shape (n, 3, 3).
            g: gradient by the module's position p, shape (n, 3).
        """
        T, N, g = self.outward(T), self.outward(N), self.outward(g)
        turned = skew(self.omega) @ N
        moved = skew(self.omega) @ T + skew(self.v) @ N + self.v[:, :, None] * g[:, None, :]
        H: Array = np.where(self.chain.inward, self.omega @ axial(moved).T + self.v @ axial(turned).T, 0.0)
        return H


def cross(a: Array, b: Array) -> Array:
    """Return a x b over the last axis; several times faster than numpy's on small arrays."""
    (a0, a1, a2), (b0, b1, b2) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack((a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0), axis=-1)


def skew(v: Array) -> Array:
    """Return the matrices of the cross product with v from the left, shape (..., 3, 3)."""
    K = np.zeros((*v.shape[:-1], 3, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    K[..., 1, 2], K[..., 2, 0], K[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return K


def axial(Y: Array) -> Array:
    """Return the sum of x cross y, Y the sum of x y^T: what omega takes to the sum of y . (omega cross x)."""
    parts = (Y[..., 1, 2] - Y[..., 2, 1], Y[..., 2, 0] - Y[..., 0, 2], Y[..., 0, 1] - Y[..., 1, 0])
    return np.stack(parts, axis=-1)

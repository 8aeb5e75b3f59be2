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

import math

import numpy as np
from numba import njit

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
        self._parents = np.array(topology.parents)
        self._ports = np.array([0, *(a for _, _, a, _ in topology.edges())])
        self._turns = np.array([rotation([0, 0, 1], kappa * np.pi / 2).round() for kappa in topology.kappas])

    def at(self, theta: Array) -> Links:
        """Return the poses at some angles."""
        return Links(self, *_outwards(theta, self._parents, self._ports, self._turns, self.l_c, PORTS))


@njit(cache=True)
def _outwards(
    theta: Array, parents: Array, ports: Array, turns: Array, l_c: float, e: Array
) -> tuple[Array, Array, Array, Array]:
    """Return R, p, omega and v, module after module; `turns` are the Rz(kappa pi/2)."""
    n = len(parents)
    R, p = np.empty((n, 3, 3)), np.zeros((n, 3))
    omega, v = np.zeros((n + 2, 3)), np.zeros((n + 2, 3))
    (c0, c1, c2), (s0, s1, s2) = np.cos(theta[:3]), np.sin(theta[:3])
    R[0, 0] = c0 * c2 - s0 * s1 * s2, -s0 * c1, c0 * s2 + s0 * s1 * c2
    R[0, 1] = s0 * c2 + c0 * s1 * s2, c0 * c1, s0 * s2 - c0 * s1 * c2
    R[0, 2] = -c1 * s2, s1, c1 * c2
    omega[0] = 0.0, 0.0, 1.0
    omega[1] = c0, s0, 0.0
    omega[2] = R[0, :, 1]
    hinged, c = np.empty((3, 3)), np.empty(3)
    for i in range(1, n):
        h, a, j = parents[i], ports[i], i + 2
        cosine, sine = math.cos(theta[j]), math.sin(theta[j])
        for row in range(3):
            x, y, z = R[h, row]
            if a % 2 == 0:  # Ry
                omega[j, row] = y
                hinged[row] = cosine * x - sine * z, y, sine * x + cosine * z
            else:  # Rx
                omega[j, row] = x
                hinged[row] = x, cosine * y + sine * z, cosine * z - sine * y
            c[row] = p[h, row] + l_c * (x * e[a, 0] + y * e[a, 1])
            p[i, row] = c[row] + l_c * (hinged[row, 0] * e[a, 0] + hinged[row, 1] * e[a, 1])
            for column in range(3):
                R[i, row, column] = (
                    hinged[row, 0] * turns[i, 0, column]
                    + hinged[row, 1] * turns[i, 1, column]
                    + hinged[row, 2] * turns[i, 2, column]
                )
        v[j] = _crossed(c, omega[j])
    return R, p, omega, v


class Links:
    """Poses at some angles, and what follows from them."""

    def __init__(self, chain: Chain, R: Array, p: Array, omega: Array, v: Array) -> None:
        self.chain, self.R, self.p, self.omega, self.v = chain, R, p, omega, v
        self.z = np.ascontiguousarray(R[:, :, 2])

    def outward(self, per_module: Array) -> Array:
        """Return the sums of a quantity of the modules over those that each angle moves, shape (n+2, ...)."""
        sums: Array = (self.chain.moves @ per_module.reshape(self.chain.n, -1)).reshape(-1, *per_module.shape[1:])
        return sums

    def turned(self, a: Array) -> Array:
        """Return the derivatives X_j a_jk by each angle of forces with torques a, both of shape (n+2, K, 6)."""
        result: Array = _turned(a, self.omega, self.v)
        return result

    def work(self, mu: Array) -> Array:
        """Return X_j^T mu_k, shape (n+2, K, 6): mu_k . X_j a = (X_j^T mu_k) . a, for mu of shape (K, 6)."""
        result: Array = _work(mu, self.omega, self.v)
        return result

    def curvature(self, T: Array, N: Array, g: Array) -> Array:
        """Return the second derivatives by theta of a sum over all that the modules carry, upper triangle.

        Args:
            T: sum of x y^T over a module's vectors x (z, p, f, m), y the sum's gradient by x, shape (n, 3, 3).
            N: sum of f y^T over a module's forces f, y the gradient by its torque m, shape (n, 3, 3).
            g: gradient by the module's position p, shape (n, 3).
        """
        T, N, g = self.outward(T), self.outward(N), self.outward(g)
        result: Array = _curvature(T, N, g, self.omega, self.v, self.chain.inward)
        return result


@njit(cache=True)
def _crossed(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def _turned(a: Array, omega: Array, v: Array) -> Array:
    result = np.empty_like(a)
    for j in range(a.shape[0]):
        for k in range(a.shape[1]):
            f, m = a[j, k, :3], a[j, k, 3:]
            result[j, k, :3] = _crossed(omega[j], f)
            result[j, k, 3:] = _crossed(v[j], f) + _crossed(omega[j], m)
    return result


@njit(cache=True)
def _work(mu: Array, omega: Array, v: Array) -> Array:
    result = np.empty((len(omega), len(mu), 6))
    for j in range(len(omega)):
        for k in range(len(mu)):
            f, m = mu[k, :3], mu[k, 3:]
            result[j, k, :3] = _crossed(f, omega[j]) + _crossed(m, v[j])
            result[j, k, 3:] = _crossed(m, omega[j])
    return result


@njit(cache=True)
def _curvature(T: Array, N: Array, g: Array, omega: Array, v: Array, inward: Array) -> Array:
    """Return the sum of y . d^2 x; `by_omega` and `by_v` are what omega_j and v_j of the inner angle do to it."""
    size = len(omega)
    H = np.zeros((size, size))
    by_omega, by_v = np.empty(3), np.empty(3)
    moved, turned = np.empty((3, 3)), np.empty((3, 3))
    for k in range(size):
        for column in range(3):
            turned[:, column] = _crossed(omega[k], N[k, :, column])
            moved[:, column] = (
                _crossed(omega[k], T[k, :, column]) + _crossed(v[k], N[k, :, column]) + v[k] * g[k, column]
            )
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            by_omega[a] = moved[b, c] - moved[c, b]
            by_v[a] = turned[b, c] - turned[c, b]
        for j in range(size):
            if inward[j, k]:
                H[j, k] = np.sum(omega[j] * by_omega) + np.sum(v[j] * by_v)
    return H


def cross(a: Array, b: Array) -> Array:
    """Return a x b over the last axis; several times faster than numpy's on small arrays."""
    a0, a1, a2, b0, b1, b2 = a[..., 0], a[..., 1], a[..., 2], b[..., 0], b[..., 1], b[..., 2]
    first = a1 * b2 - a2 * b1
    product = np.empty((*first.shape, 3))
    product[..., 0] = first
    product[..., 1] = a2 * b0 - a0 * b2
    product[..., 2] = a0 * b1 - a1 * b0
    return product


def skew(v: Array) -> Array:
    """Return the matrices of the cross product with v from the left, shape (..., 3, 3)."""
    K = np.zeros((*v.shape[:-1], 3, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    K[..., 1, 2], K[..., 2, 0], K[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return K

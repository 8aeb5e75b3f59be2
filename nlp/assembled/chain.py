r"""Poses along the kinematic chain, and the axes that give their derivatives.

| symbol | meaning | shape | unit |
|---|---|---|---|
| theta | psi, alpha_0, alpha_1 of the root, then the hinge angles | (n+2,) | rad |
| omega_j, c_j | axis that theta_j turns about, and a point on it | (3,) | -, l_arm |
| v_j = c_j x omega_j | velocity of W's origin under the unit turn | (3,) | l_arm |

Every angle turns all that lies outward of it as one rigid body:

.. math::

    \partial_j p = \omega_j \times p + v_j, \quad \partial_j z = \omega_j \times z

and, with j inward of k or the same, \partial_j \partial_k p = \omega_j \times (\omega_k \times p + v_k), and so on.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from nlp.assembled.vectors import crossed
from nlp.numbers.geometry import PORTS, QUARTER_TURNS
from topo_search.model import Topology
from topo_search.model.arrays import Array


class Chain:
    """The kinematic chain of a topology: what each angle moves."""

    def __init__(self, topology: Topology, l_c: float) -> None:
        """Index the tree; l_c in the unit of length that the poses shall have."""
        n = topology.n
        self.l_c = l_c
        outward = np.zeros((n, n), dtype=bool)  # [h, i]: module i is h or hangs on it
        for i, h in enumerate(topology.parents):
            outward[i, i] = True
            if h >= 0:
                outward[:, i] |= outward[:, h]
        self.moves = np.ones((n + 2, n))
        """[j, i] = 1 where theta_j moves module i, else 0."""
        self.moves[3:] = outward[1:]
        self.parents = np.array(topology.parents)
        """Of the modules, shape (n,)."""
        self._ports = np.array([0, *(a for _, _, a, _ in topology.edges())])
        self._turns = QUARTER_TURNS[np.array(topology.kappas)]

    def at(self, theta: Array) -> Links:
        """Return the poses at some angles."""
        return Links(self, *_outwards(theta, self.parents, self._ports, self._turns, self.l_c, PORTS))


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
        v[j] = crossed(c, omega[j])
    return R, p, omega, v


class Links:
    """Poses at some angles, with the angles' axes."""

    def __init__(self, chain: Chain, R: Array, p: Array, omega: Array, v: Array) -> None:
        self.chain, self.R, self.p, self.omega, self.v = chain, R, p, omega, v

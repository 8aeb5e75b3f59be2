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

import numpy as np

from nlp.assembled.vectors import cross
from nlp.numbers.kinematics import Indices, chain
from topo_search.model import Topology
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


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
        """Parents of the modules, shape (n,)."""
        self._ports = np.array([0, *(a for _, _, a, _ in topology.edges())])
        self._kappas = np.array(topology.kappas)

    def at(self, theta: Array) -> Links:
        """Return the poses at some angles."""
        return Links(self, *_links(theta, self.parents, self._ports, self._kappas, self.l_c))


@njit(cache=True)
def _links(theta: Array, parents: Indices, ports: Indices, kappas: Indices, l_c: float) -> tuple[Array, ...]:
    """Return R, p, omega and v."""
    R, p, omega, c = chain(theta, parents, ports, kappas, l_c)
    v = np.zeros_like(c)
    for j in range(3, len(c)):
        v[j] = cross(c[j], omega[j])
    return R, p, omega, v


class Links:
    """Poses at some angles, with the angles' axes."""

    def __init__(self, chain: Chain, R: Array, p: Array, omega: Array, v: Array) -> None:
        self.chain, self.R, self.p, self.omega, self.v = chain, R, p, omega, v

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

from typing import NamedTuple

import numpy as np

from nlp.numbers.kinematics import Tree, chain
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

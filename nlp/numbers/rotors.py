"""Torque of a module's rotors, in the solver's numbers.

| symbol | meaning | shape | unit |
|---|---|---|---|
| delta_q | position of rotor q in the module's frame | (3,) | l_arm |
| m_i | torque of module i about its centre, in its own frame | (3,) | l_arm m g |

m_i = sum_q (u_iq / 4) (delta_q x e_z + (-1)^q k_tau / (k_f l_arm) e_z), with u_iq in u_hover.
"""

from __future__ import annotations

import numpy as np

from topo_search.model import Module
from topo_search.model.arrays import Array
from topo_search.model.layout import ROTOR_DIRECTIONS, ROTOR_SPINS


def torque_map(module: Module) -> Array:
    """Return the matrix from the inputs of a module to m_i, shape (3, 4)."""
    drag = module.torque_coefficient / (module.thrust_coefficient * module.arm_length)
    x, y, _ = ROTOR_DIRECTIONS.T
    return np.stack([y, -x, drag * ROTOR_SPINS]) / 4

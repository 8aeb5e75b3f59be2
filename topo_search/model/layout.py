"""Positions of a module's connectors and rotors: data that solver, audit and exports share.

Directions are in the module's frame, z along the thrust.
"""

from __future__ import annotations

import math

import numpy as np

from topo_search.model.arrays import read_only

PORT_DIRECTIONS = read_only([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""e_a for connectors 0..3, which are connector_distance from the centre; shape (4, 3)."""
ROTOR_DIRECTIONS = read_only(
    np.array([[1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]]) / math.sqrt(2)
)
"""From the centre to rotors 0..3, which are arm_length from it; shape (4, 3)."""
ROTOR_SPINS = read_only([-1.0, 1.0, -1.0, 1.0])
"""-(-1)^q: sign of the drag torque of rotors q = 0..3 along z; shape (4,)."""

"""Arrays inside values, float64 and read-only, and where a module has its connectors and rotors.

Solver, audit and exports share these positions. Directions are in the module's frame, z along the thrust.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def read_only(values: ArrayLike | Any) -> Array:
    """Return a float64 array that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


PORT_DIRECTIONS = read_only([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""e_a for connectors 0..3, which are connector_distance from the centre; shape (4, 3)."""
ROTOR_DIRECTIONS = read_only(
    np.array([[1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]]) / math.sqrt(2)
)
"""From the centre to rotors 0..3, which are arm_length from it; shape (4, 3)."""
ROTOR_SPINS = read_only([-1.0, 1.0, -1.0, 1.0])
"""-(-1)^q: sign of the drag torque of rotors q = 0..3 along z; shape (4,)."""

"""Arrays inside values, float64 and read-only, and where a module has its connectors, in its own frame."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]


def read_only(values: ArrayLike | Any) -> Array:
    """Return a float64 array that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


PORT_DIRECTIONS = read_only([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""e_a for connectors 0..3, which are connector_distance from the centre; shape (4, 3)."""

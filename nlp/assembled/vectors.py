"""Products of vectors in space, compiled: many times faster than NumPy's on three numbers."""

from __future__ import annotations

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


@njit(cache=True)
def dot(a: Array, b: Array) -> float:
    """Return a . b."""
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@njit(cache=True)
def cross(a: Array, b: Array) -> Array:
    """Return a x b."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def add_cross(a: Array, b: Array, factor: float, to: Array) -> None:
    """Add factor a x b to a vector."""
    to[0] += factor * (a[1] * b[2] - a[2] * b[1])
    to[1] += factor * (a[2] * b[0] - a[0] * b[2])
    to[2] += factor * (a[0] * b[1] - a[1] * b[0])

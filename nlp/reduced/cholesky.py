"""Small symmetric systems, in loops of a fixed order: a library's rounding may change with the machine."""

from __future__ import annotations

import math

from numba import njit

from topo_search.model.arrays import Array

LEAST_PIVOT = 1e-30
"""A pivot that rounding has made smaller counts as this."""


@njit(cache=True)
def solve_in_place(H: Array, d: Array) -> None:
    """Solve H x = d in place by Cholesky's factors of the lower half of H, which it overwrites."""
    n = len(d)
    for a in range(n):
        for b in range(a):
            s = H[a, b]
            for c in range(b):
                s -= H[a, c] * H[b, c]
            H[a, b] = s / H[b, b]
        s = H[a, a]
        for c in range(a):
            s -= H[a, c] * H[a, c]
        H[a, a] = math.sqrt(max(s, LEAST_PIVOT))
    for a in range(n):
        for c in range(a):
            d[a] -= H[a, c] * d[c]
        d[a] /= H[a, a]
    for a in range(n - 1, -1, -1):
        for c in range(a + 1, n):
            d[a] -= H[c, a] * d[c]
        d[a] /= H[a, a]

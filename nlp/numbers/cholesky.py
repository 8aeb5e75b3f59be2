"""Small symmetric systems, compiled, in loops of a fixed order: a library's rounding may change with the machine.

The size n is an argument, although H knows it: a caller's literal lets the compiler unroll the loops, without
which proofs of push with three modules take 7 % longer.
"""

import math

from topo_search.compiled_code import njit
from topo_search.model.arrays import Array

LEAST_PIVOT = 1e-30
"""Lower bound on a pivot, which rounding can make smaller."""


@njit(cache=True, inner=True)
def solve_in_place(H: Array, d: Array) -> None:
    """Solve H x = d in place by Cholesky's factors of the lower half of H, which it overwrites."""
    factor(H, len(d))
    solve_factored(H, d, len(d))


@njit(cache=True, inner=True)
def factor(H: Array, n: int) -> None:
    """Replace the lower half of H, shape (n, n), by its Cholesky factor."""
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


@njit(cache=True, inner=True)
def solve_factored(L: Array, d: Array, n: int) -> None:
    """Solve L L^T x = d in place; only the lower half of L is read."""
    for a in range(n):
        for c in range(a):
            d[a] -= L[a, c] * d[c]
        d[a] /= L[a, a]
    for a in range(n - 1, -1, -1):
        for c in range(a + 1, n):
            d[a] -= L[c, a] * d[c]
        d[a] /= L[a, a]

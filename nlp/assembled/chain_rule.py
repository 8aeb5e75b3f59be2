"""From derivatives of clearances by their local vectors to those by the geometric unknowns, compiled.

| symbol | meaning | shape | unit |
|---|---|---|---|
| x, V, dV, y | unknowns, vectors, their derivatives, local vectors; see `nlp.assembled.local_vectors` | | |
| plus, minus | indices in V of a clearance's local vectors, y = V[plus] - V[minus] | (m, s) | |
"""

from __future__ import annotations

import numpy as np

from nlp.assembled.local_vectors import Indices
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


@njit(cache=True)
def chain_rule(gradient: Array, plus: Indices, minus: Indices, dV: Array, rows: Indices, columns: Indices) -> Array:
    """Return the derivatives of clearances by x where they are not zero: entry e is row rows[e], column columns[e].

    Args:
        gradient: by the local vectors, shape (m, s, 3).
        plus: see the notation.
        minus: see the notation.
        dV: see the notation.
        rows: of the entries.
        columns: of the entries.
    """
    entries = np.zeros(len(rows))
    for e in range(len(rows)):
        r, j = rows[e], columns[e]
        for part in range(plus.shape[1]):
            a, b = plus[r, part], minus[r, part]
            for axis in range(3):
                entries[e] += gradient[r, part, axis] * (dV[a, j, axis] - dV[b, j, axis])
    return entries


@njit(cache=True)
def add_curvature(
    multipliers: Array,
    hessian: Array,
    plus: Indices,
    minus: Indices,
    dV: Array,
    starts: Indices,
    columns: Indices,
    H: Array,
) -> None:
    """Add dy^T hessian dy of every clearance, times its multiplier, to H, shape (g, g), upper triangle.

    Args:
        multipliers: of the clearances, shape (m,).
        hessian: by the local vectors, shape (m, 3 s, 3 s).
        plus: see the notation.
        minus: see the notation.
        dV: see the notation.
        starts: of each clearance's unknowns in `columns`, shape (m+1,).
        columns: unknowns that move one of its vectors, in ascending order.
        H: is added to.
    """
    size = hessian.shape[1]
    dy, bent = np.empty((dV.shape[1], size)), np.empty(size)
    for r in range(len(plus)):
        first, last = starts[r], starts[r + 1]
        for e in range(first, last):
            j = columns[e]
            for part in range(plus.shape[1]):
                a, b = plus[r, part], minus[r, part]
                for axis in range(3):
                    dy[e - first, 3 * part + axis] = dV[a, j, axis] - dV[b, j, axis]
        for e in range(first, last):
            for one in range(size):
                bent[one] = 0.0
                for other in range(size):
                    bent[one] += hessian[r, one, other] * dy[e - first, other]
                bent[one] *= multipliers[r]
            for later in range(e, last):
                total = 0.0
                for one in range(size):
                    total += bent[one] * dy[later - first, one]
                H[columns[e], columns[later]] += total


@njit(cache=True)
def add_gradients(multipliers: Array, gradient: Array, plus: Indices, minus: Indices, to: Array) -> None:
    """Add gradients by local vectors, shape (m, s, 3), times multipliers, to those by V, shape (4n+3, 3)."""
    for r in range(len(plus)):
        for part in range(plus.shape[1]):
            for axis in range(3):
                push = multipliers[r] * gradient[r, part, axis]
                to[plus[r, part], axis] += push
                to[minus[r, part], axis] -= push

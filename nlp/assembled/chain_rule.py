"""From derivatives of clearances by their local vectors to those by the geometric unknowns, compiled.

An unknown moves few of the vectors of a large platform, so that loops over what is moved win over dense products.
The notation is that of `nlp.assembled.platform`.
"""

from __future__ import annotations

import numpy as np

from nlp.assembled.platform import Indices, Mask
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


@njit(cache=True)
def slopes(gradient: Array, plus: Indices, minus: Indices, dV: Array, changing: Mask) -> Array:
    """Return the derivatives of m clearances by x, shape (m, g).

    Args:
        gradient: by the local vectors, shape (m, s, 3).
        plus: where the local vectors begin and end in V, V[plus] - V[minus], shape (m, s).
        minus: see there.
        dV: see the notation.
        changing: unknowns that change each clearance, shape (m, g).
    """
    result = np.zeros(changing.shape)
    for r in range(len(plus)):
        for j in np.flatnonzero(changing[r]):
            for part in range(plus.shape[1]):
                a, b = plus[r, part], minus[r, part]
                for axis in range(3):
                    result[r, j] += gradient[r, part, axis] * (dV[a, j, axis] - dV[b, j, axis])
    return result


@njit(cache=True)
def add_curvature(
    weights: Array,
    gradient: Array,
    hessian: Array,
    plus: Indices,
    minus: Indices,
    dV: Array,
    moving: Mask,
    by_V: Array,
    H: Array,
) -> None:
    """Add the gradient by V of weighted clearances, and dy^T hessian dy of each.

    Args:
        weights: of the clearances, shape (m,).
        gradient: as of `slopes`, and so are `plus`, `minus` and `dV`.
        hessian: by the local vectors, shape (m, 3 s, 3 s).
        plus: see there.
        minus: see there.
        dV: see there.
        moving: unknowns that move a vector of each clearance, shape (m, g).
        by_V: the gradient is added to it, shape (4n+3, 3).
        H: the second derivatives are, shape (g, g), upper triangle.
    """
    size = hessian.shape[1]
    dy, bent = np.empty((dV.shape[1], size)), np.empty(size)
    for r in range(len(plus)):
        columns = np.flatnonzero(moving[r])
        for part in range(plus.shape[1]):
            a, b = plus[r, part], minus[r, part]
            for axis in range(3):
                push = weights[r] * gradient[r, part, axis]
                by_V[a, axis] += push
                by_V[b, axis] -= push
        for e, j in enumerate(columns):
            for part in range(plus.shape[1]):
                a, b = plus[r, part], minus[r, part]
                for axis in range(3):
                    dy[e, 3 * part + axis] = dV[a, j, axis] - dV[b, j, axis]
        for e, j in enumerate(columns):
            for one in range(size):
                bent[one] = 0.0
                for other in range(size):
                    bent[one] += hessian[r, one, other] * dy[e, other]
            for later in range(e, len(columns)):
                total = 0.0
                for one in range(size):
                    total += bent[one] * dy[later, one]
                H[j, columns[later]] += weights[r] * total

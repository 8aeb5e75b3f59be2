"""Chain rule: derivatives of clearances by their local vectors to those by the geometric unknowns, compiled.

An unknown moves few of the vectors of a large platform, so loops over the moved vectors are faster than dense
products. The notation is that of `nlp.assembled.platform`.
"""

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, Flags, Indices


@njit(cache=True)
def slopes(gradient: Array, plus: Indices, minus: Indices, dV: Array, changing: Flags) -> Array:
    """Return the derivatives of m clearances by x, shape (m, g).

    Args:
        gradient: gradient by the local vectors, shape (m, s, 3).
        plus: indices in V of the local vectors V[plus] - V[minus], shape (m, s).
        minus: same as `plus`.
        dV: derivatives of V by x, shape (4n+3, g, 3).
        changing: mask of unknowns that change each clearance, shape (m, g).
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
    moving: Flags,
    by_V: Array,
    H: Array,
) -> None:
    """Add the gradient by V of weighted clearances, and dy^T hessian dy of each.

    Args:
        weights: weights of the clearances, shape (m,).
        gradient: same as in `slopes`.
        hessian: Hessian by the local vectors, shape (m, 3 s, 3 s).
        plus: same as in `slopes`.
        minus: same as in `slopes`.
        dV: same as in `slopes`.
        moving: mask of unknowns that move a vector of each clearance, shape (m, g).
        by_V: increased by the gradient, shape (4n+3, 3).
        H: increased by the second derivatives, shape (g, g), upper triangle.
    """
    size = hessian.shape[1]
    dy, product = np.empty((dV.shape[1], size)), np.empty(size)
    for r in range(len(plus)):
        columns = np.flatnonzero(moving[r])
        for part in range(plus.shape[1]):
            a, b = plus[r, part], minus[r, part]
            for axis in range(3):
                share = weights[r] * gradient[r, part, axis]
                by_V[a, axis] += share
                by_V[b, axis] -= share
        for e, j in enumerate(columns):
            for part in range(plus.shape[1]):
                a, b = plus[r, part], minus[r, part]
                for axis in range(3):
                    dy[e, 3 * part + axis] = dV[a, j, axis] - dV[b, j, axis]
        for e, j in enumerate(columns):
            for row in range(size):
                product[row] = 0.0
                for column in range(size):
                    product[row] += hessian[r, row, column] * dy[e, column]
            for f in range(e, len(columns)):
                total = 0.0
                for row in range(size):
                    total += product[row] * dy[f, row]
                H[j, columns[f]] += weights[r] * total

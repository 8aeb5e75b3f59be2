"""What a tree looks like when it lies flat: numbers by which trees that were never solved are compared with others.

| symbol | meaning | shape, unit |
|---|---|---|
| c | centres of the modules with all hinge angles zero, from their mean | (n, 2), 2 l_c |
| M = c^T c / n | second moments; its eigenvalues are the squares of half axes | (2, 2) |
| z | number of joints of each module | (n,) |
| s | spin of each module relative to the root's, +1 or -1 | (n,) |

All of them are the same for trees that a turn, a mirror or another choice of the root takes into each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topo_search.model import Topology

DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
"""Where the ports of a module that is not turned point."""


def descriptors(topology: Topology) -> NDArray[np.float64]:
    """Return the numbers that describe a tree, shape (12,).

    They are both eigenvalues of M; the numbers of modules in a cell that another one has, of pairs in cells side by
    side that are not bolted together, of modules with one, two and more joints; the sum of the spins, unsigned; the
    joints between two modules, summed over all pairs, a module; how many modules have no counterpart under a half
    turn about the mean of the centres, and in the best of the mirrors along rows, columns and diagonals; and
    |sum c |c|^2| / n, by which one side reaches farther from that mean.
    """
    n = topology.n
    cells = np.zeros((n, 2), dtype=int)
    quarters = [0] * n
    z, s = np.zeros(n, dtype=int), np.ones(n, dtype=int)
    for (h, i, a, _), kappa in zip(topology.edges(), topology.kappas[1:], strict=True):
        cells[i] = cells[h] + DIRECTIONS[(a + quarters[h]) % 4]
        quarters[i] = quarters[h] + kappa
        s[i] = s[h] * (-1) ** kappa
        z[[h, i]] += 1
    c = cells - cells.mean(axis=0)
    apart = np.abs(cells[:, None] - cells[None]).sum(axis=2)
    beside = np.count_nonzero(np.triu(apart == 1)) - (n - 1)
    stacked = n - len(np.unique(cells, axis=0))
    joints = (np.count_nonzero(z == 1), np.count_nonzero(z == 2), np.count_nonzero(z > 2))
    return np.array(
        [
            *np.linalg.eigvalsh(c.T @ c / n),
            *(stacked, beside, *joints, abs(s.sum())),
            _path_lengths(topology) / n,
            *_lopsided(n * cells - cells.sum(axis=0)),
            np.linalg.norm((c * np.sum(c * c, axis=1, keepdims=True)).mean(axis=0)),
        ],
        dtype=float,
    )


def _path_lengths(topology: Topology) -> int:
    """Return the Wiener index: every joint lies on the paths between the modules on its two sides."""
    beyond = [1] * topology.n
    for h, i, _, _ in reversed(list(topology.edges())):
        beyond[h] += beyond[i]
    return sum(size * (topology.n - size) for size in beyond[1:])


def _lopsided(places: NDArray[np.int_]) -> tuple[int, int]:
    """Return how many places, shape (n, 2), have no counterpart under a half turn, and in a mirror, at least."""
    x, y = places.T
    filled = set(zip(x.tolist(), y.tolist(), strict=True))
    images = ((-x, -y), (x, -y), (-x, y), (y, x), (-y, -x))
    turn, *mirrors = (sum(at not in filled for at in zip(u.tolist(), v.tolist(), strict=True)) for u, v in images)
    return turn, min(mirrors)

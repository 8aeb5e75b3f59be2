"""What a tree looks like when it lies flat: numbers by which trees that were never solved are compared with others.

| symbol | meaning | shape, unit |
|---|---|---|
| c | centres of the modules with all hinge angles zero, from their mean | (n, 2), 2 l_c |
| M = c^T c / n | second moments; its eigenvalues are the squares of half axes | (2, 2) |
| z | number of joints of each module | (n,) |
| s | spin of each module relative to the root's, +1 or -1 | (n,) |
| e, f | joints, each in both directions along it; f follows e where e leads to | 2 (n - 1) |
| A_p | whether f follows e with its hinge axis parallel to (p = 0) or across that of e (p = 1) | (2 (n - 1),) * 2 |

A path of joints has a pattern: which of its hinge axes are across the one before. It decides what orientations the
modules can have relative to each other. A part that is mirrored at its joint keeps all patterns, and trees that
differ in that alone are often about as good.

All of the numbers are the same for trees that a turn, a mirror or another choice of the root takes into each other.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from topo_search.model import Topology

DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
"""Where the ports of a module that is not turned point."""
LONGEST = 4
"""Joints of the longest paths whose patterns are counted."""
PATTERNS = tuple(
    pattern
    for length in range(1, LONGEST)
    for pattern in product((0, 1), repeat=length)
    if pattern <= pattern[::-1]  # the same path the other way
)


def descriptors(topology: Topology) -> NDArray[np.float64]:
    """Return the numbers that describe a tree, shape (12 + number of PATTERNS,).

    They are both eigenvalues of M; the numbers of modules in a cell that another one has, of pairs in cells side by
    side that are not bolted together, of modules with one, two and more joints; the sum of the spins, unsigned; the
    joints between two modules, summed over all pairs, a module; how many modules have no counterpart under a half
    turn about the mean of the centres, and in the best of the mirrors along rows, columns and diagonals; and
    |sum c |c|^2| / n, by which one side reaches farther from that mean; and how many paths have each pattern.
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
            *_paths(topology, quarters),
        ],
        dtype=float,
    )


def _path_lengths(topology: Topology) -> int:
    """Return the Wiener index: every joint lies on the paths between the modules on its two sides."""
    beyond = [1] * topology.n
    for h, i, _, _ in reversed(list(topology.edges())):
        beyond[h] += beyond[i]
    return sum(size * (topology.n - size) for size in beyond[1:])


def _paths(topology: Topology, quarters: list[int]) -> list[float]:
    """Return how many paths have each of the PATTERNS: 1^T A_p A_q ... 1, which counts a palindrome twice."""
    joints = [(h, i, (a + quarters[h]) % 2) for h, i, a, _ in topology.edges()]
    start, end, axis = np.array([*joints, *((i, h, axis) for h, i, axis in joints)], dtype=int).reshape(-1, 3).T
    follows = (end[:, None] == start) & (start[:, None] != end)
    across = axis[:, None] != axis
    A = ((follows & ~across).astype(float), (follows & across).astype(float))
    counted = []
    for pattern in PATTERNS:
        paths = np.ones(len(axis))
        for p in reversed(pattern):
            paths = A[p] @ paths
        counted.append(float(paths.sum()) / (2 if pattern == pattern[::-1] else 1))
    return counted


def _lopsided(places: NDArray[np.int_]) -> tuple[int, int]:
    """Return how many places, shape (n, 2), have no counterpart under a half turn, and in a mirror, at least."""
    x, y = places.T
    filled = set(zip(x.tolist(), y.tolist(), strict=True))
    images = ((-x, -y), (x, -y), (-x, y), (y, x), (-y, -x))
    turn, *mirrors = (sum(at not in filled for at in zip(u.tolist(), v.tolist(), strict=True)) for u, v in images)
    return turn, min(mirrors)

"""A guess of how an unsolved tree will stand among those that are: Gaussian process regression on its descriptors.

The descriptors are what a tree looks like when it lies flat.

| symbol | meaning | shape, unit |
|---|---|---|
| c | centres of the modules with all hinge angles zero, from their mean | (k, n, 2), 2 l_c |
| N = n c | the same as whole numbers: what is alike is described alike to the last bit | (k, n, 2) |
| M = c^T c / n | second moments xx, xy, yy; its eigenvalues are the squares of half axes | (k, 2, 2) |
| z | number of joints of each module | (k, n) |
| s | spin of each module relative to the root's, +1 or -1 | (k, n) |
| e, f | joints, each in both directions along it; f follows e where e leads to | m = 2 (n - 1) |
| A_p | whether f follows e with its hinge axis parallel to (p = 0) or across that of e (p = 1) | (k, m, m) |

A path of joints has a pattern: which of its hinge axes are across the one before. It decides what orientations the
modules can have relative to each other. A part that is mirrored at its joint keeps all patterns, and trees that
differ in that alone are often about as good.

All of the numbers are the same for trees that a turn, a mirror or another choice of the root takes into each other.

The regression:

| symbol | meaning | shape |
|---|---|---|
| X | descriptors of the m solved trees, columns of mean 0 and deviation 1 | (m, d) |
| y | places of the solved trees in their ranking, as normal scores of mean 0 and deviation 1 | (m,) |
| k(x, x') | covariance before anything is solved: exp(-|x - x'|^2 / 4 d) + linear (1 + x.x' / d) | |
| K | k(X, X) + noise I | (m, m) |

A tree x is expected at k(x, X) K^-1 y with variance k(x, x) - k(x, X) K^-1 k(X, x) [1]. The first part of k speaks
of trees that look alike, the second of trends; the mean of |x - x'|^2 over all pairs is 2 d. Places instead of
objectives need no unit, and no value for a tree without a design; trees that stand alike share the middle of their
places. What the others tell of solved tree i has the mean y_i - (K^-1 y)_i / (K^-1)_ii, and together with
noise the variance 1 / (K^-1)_ii [2].

[1] C. E. Rasmussen, C. K. I. Williams, "Gaussian processes for machine learning", MIT Press (2006), eq. 2.23-2.24.
[2] The same, eq. 5.12.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist
from scipy.special import ndtri

from topo_search.model import Topology
from topo_search.model.arrays import Array
from topo_search.model.layout import PORT_DIRECTIONS

Indices = NDArray[np.int_]

PATTERNS = tuple(
    pattern
    for length in range(1, 4)  # paths of two to four joints
    for pattern in product((0, 1), repeat=length)
    if pattern <= pattern[::-1]  # the same path the other way
)


@dataclass(frozen=True)
class Regression:
    """Settings of the regression; variances are those of normal scores."""

    linear: float = 0.1
    """Variance of the trends."""
    noise: float = 0.6
    """Variance of what one start says."""
    optimism: float = 2.0
    """Standard deviations by which a tree may do better than expected."""
    trees: int = 500
    """Number of trees above which only every second, third, ... of their ranking is looked at."""


REGRESSION = Regression()


class Flat(NamedTuple):
    """Trees of one size, flat on a grid."""

    parent: Indices
    """Parents of all modules but the root, shape (k, n - 1)."""
    cells: Indices
    """Cells of the modules, from the root, shape (k, n, 2)."""
    quarters: Indices
    """Quarter turns of the modules relative to the root, shape (k, n)."""
    axis: Indices
    """Directions of the hinge axes, up to a half turn: 0 or 1, shape (k, n - 1)."""


def descriptors(topologies: Sequence[Topology]) -> Array:
    """Return the numbers that describe each of k >= 1 trees of one size, shape (k, 12 + number of PATTERNS).

    They are both eigenvalues of M; the numbers of modules in a cell that another one has, of pairs in cells side by
    side that are not bolted together, of modules with one, two and more joints; the sum of the spins, unsigned; the
    joints between two modules, summed over all pairs, a module; how many modules have no counterpart under a half
    turn about the mean of the centres, and in the best of the mirrors along rows, columns and diagonals; and
    |sum c |c|^2| / n, by which one side reaches farther from that mean; and how many paths have each pattern.
    """
    flat = _lay_flat(topologies)
    cells = flat.cells
    k, n, _ = cells.shape
    z = np.ones((k, n), dtype=int)
    z[:, 0] = 0
    np.add.at(z, (np.arange(k)[:, None], flat.parent), 1)
    s = 1 - 2 * (flat.quarters % 2)
    N = n * cells - cells.sum(axis=1, keepdims=True)
    (xx, xy), (_, yy) = np.einsum("kia,kib->abk", N, N) / n**3
    middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    steps = np.abs(cells[:, :, None] - cells[:, None]).sum(axis=3)
    stacked = np.tril(steps == 0, -1).any(axis=2).sum(axis=1)
    beside = np.tril(steps == 1).sum(axis=(1, 2)) - (n - 1)
    far = np.einsum("kia,kib,kib->ka", N, N, N) / n**4
    columns = [
        *(middle - half, middle + half),
        *(stacked, beside, (z == 1).sum(axis=1), (z == 2).sum(axis=1), (z > 2).sum(axis=1)),
        np.abs(s.sum(axis=1)),
        _path_lengths(flat.parent) / n,
        *_asymmetry(N),
        np.hypot(*far.T),
        *_paths(flat),
    ]
    return np.stack(columns, axis=1).astype(float)


def _lay_flat(topologies: Sequence[Topology]) -> Flat:
    """Return trees with all hinge angles zero."""
    joints = np.array([topology.joints for topology in topologies])
    k, n, _ = joints.shape
    parent, a, b = joints[:, 1:].transpose(2, 0, 1)
    each, directions = np.arange(k), PORT_DIRECTIONS[:, :2].astype(int)
    cells, quarters = np.zeros((k, n, 2), dtype=int), np.zeros((k, n), dtype=int)
    axis = np.zeros((k, n - 1), dtype=int)
    for joint, h in enumerate(parent.T):
        towards = (a[:, joint] + quarters[each, h]) % 4
        cells[:, joint + 1] = cells[each, h] + directions[towards]
        quarters[:, joint + 1] = quarters[each, h] + (a[:, joint] + 2 - b[:, joint]) % 4
        axis[:, joint] = towards % 2
    return Flat(parent, cells, quarters, axis)


def _path_lengths(parent: Indices) -> Indices:
    """Return the Wiener indices: every joint lies on the paths between the modules on its two sides."""
    k, joints = parent.shape
    beyond = np.ones((k, joints + 1), dtype=int)
    for i in range(joints, 0, -1):
        beyond[np.arange(k), parent[:, i - 1]] += beyond[:, i]
    sizes = beyond[:, 1:]
    return np.asarray((sizes * (joints + 1 - sizes)).sum(axis=1))


def _paths(flat: Flat) -> list[Array]:
    """Return how many paths have each of the PATTERNS: 1^T A_p A_q ... 1, which counts a palindrome twice."""
    child = np.broadcast_to(np.arange(1, flat.parent.shape[1] + 1), flat.parent.shape)
    start, end = np.hstack([flat.parent, child]), np.hstack([child, flat.parent])
    axis = np.hstack([flat.axis, flat.axis])
    follows = (end[:, :, None] == start[:, None]) & (start[:, :, None] != end[:, None])
    across = axis[:, :, None] != axis[:, None]
    A = ((follows & ~across).astype(float), (follows & across).astype(float))
    counted = []
    for pattern in PATTERNS:
        paths = np.ones((*axis.shape, 1))
        for p in reversed(pattern):
            paths = A[p] @ paths
        counted.append(paths.sum(axis=(1, 2)) / (2 if pattern == pattern[::-1] else 1))
    return counted


def _asymmetry(places: Indices) -> tuple[Indices, Indices]:
    """Return how many places, shape (k, n, 2), have no counterpart under a half turn, and in a mirror, at least."""
    x, y = places[..., 0], places[..., 1]
    images = ((-x, -y), (x, -y), (-x, y), (y, x), (-y, -x))
    turn, *mirrors = (
        (~((u[:, :, None] == x[:, None]) & (v[:, :, None] == y[:, None])).any(axis=2)).sum(axis=1)
        for u, v in images
    )
    return turn, np.min(mirrors, axis=0)


class Surrogate:
    """The regression on trees that are solved."""

    def __init__(self, described: Array, places: Sequence[int]) -> None:
        """Fit.

        Args:
            described: descriptors of the solved trees in the order of their ranking, shape (m, d).
            places: their places in the ranking, equal ones for trees that stand alike.
        """
        self.kept = slice(None, None, math.ceil(len(described) / REGRESSION.trees))
        """Slice of the solved trees that are used."""
        described, places = described[self.kept], places[self.kept]
        self._mean, self._scale = described.mean(axis=0), _deviation(described)
        self._X = self._columns(described)
        alike = np.bincount(places)
        y = ndtri((np.cumsum(alike) - 0.5 * alike)[places] / len(places))
        self._y = (y - y.mean()) / _deviation(y)
        self._K = cho_factor(_covariance(self._X, self._X) + REGRESSION.noise * np.eye(len(self._X)))
        self._weights = cho_solve(self._K, self._y)

    def lower_confidence_bounds(self, described: Array) -> Array:
        """Return where trees may stand if they do better than expected, shape (k,).

        Args:
            described: descriptors of the trees, shape (k, d).
        """
        X = self._columns(described)
        known = _covariance(X, self._X)
        before = 1.0 + REGRESSION.linear * (1.0 + np.mean(X * X, axis=1))
        variance = before - np.sum(known * cho_solve(self._K, known.T).T, axis=1)
        return np.asarray(known @ self._weights - REGRESSION.optimism * np.sqrt(np.maximum(variance, 0.0)))

    def leave_one_out_bounds(self) -> Array:
        """Return the bounds of the solved trees that are `kept`, each predicted from all the others."""
        diagonal = np.diag(cho_solve(self._K, np.eye(len(self._y))))
        expected = self._y - self._weights / diagonal
        variance = np.maximum(1.0 / diagonal - REGRESSION.noise, 0.0)
        return np.asarray(expected - REGRESSION.optimism * np.sqrt(variance))

    def _columns(self, described: Array) -> Array:
        return np.asarray((described - self._mean) / self._scale)


def _covariance(X: Array, Y: Array) -> Array:
    """Return k of all pairs of rows, shape (rows of X, rows of Y)."""
    d = X.shape[1]
    apart = cdist(X, Y, "sqeuclidean")
    return np.asarray(np.exp(-apart / (4 * d)) + REGRESSION.linear * (1.0 + X @ Y.T / d))


def _deviation(values: Array) -> Array:
    deviation = values.std(axis=0)
    return np.where(deviation > 0, deviation, 1.0)

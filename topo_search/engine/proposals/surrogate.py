"""A guess of how an unsolved tree will stand among those that are: Gaussian process regression on its descriptors.

| symbol | meaning | shape |
|---|---|---|
| X | descriptors of the m solved trees, columns of mean 0 and deviation 1 | (m, d) |
| y | places of the solved trees in their ranking, as normal scores of mean 0 and deviation 1 | (m,) |
| k(x, x') | covariance before anything is solved: exp(-|x - x'|^2 / 4 d) + LINEAR (1 + x.x' / d) | |
| K | k(X, X) + NOISE I | (m, m) |

A tree x is expected at k(x, X) K^-1 y with variance k(x, x) - k(x, X) K^-1 k(X, x) [1]. The first part of k speaks
of trees that look alike, the second of trends; the mean of |x - x'|^2 over all pairs is 2 d. Places instead of
objectives need no unit, and no value for a tree without a design; trees that stand alike share the middle of their
places. What the others tell of solved tree i has the mean y_i - (K^-1 y)_i / (K^-1)_ii, and together with
NOISE the variance 1 / (K^-1)_ii [2].

[1] C. E. Rasmussen, C. K. I. Williams, "Gaussian processes for machine learning", MIT Press (2006), eq. 2.23-2.24.
[2] The same, eq. 5.12.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist
from scipy.special import ndtri

from topo_search.model.arrays import Array

LINEAR = 0.1
"""Variance of the trends."""
NOISE = 0.6
"""Variance of what one start says."""
OPTIMISM = 2.0
"""Standard deviations by which a tree may do better than expected."""
MOST = 500
"""Of more solved trees every second, third, ... in their ranking is looked at."""


class Surrogate:
    """The regression on trees that are solved."""

    def __init__(self, described: Array, places: Sequence[int]) -> None:
        """Fit.

        Args:
            described: descriptors of the solved trees in the order of their ranking, shape (m, d).
            places: their places in the ranking, equal ones for trees that stand alike.
        """
        self.kept = slice(None, None, math.ceil(len(described) / MOST))
        """Which of the solved trees are looked at."""
        described, places = described[self.kept], places[self.kept]
        self._mean, self._scale = described.mean(axis=0), _deviation(described)
        self._X = self._columns(described)
        alike = np.bincount(places)
        y = ndtri((np.cumsum(alike) - 0.5 * alike)[places] / len(places))
        self._y = (y - y.mean()) / _deviation(y)
        self._K = cho_factor(_covariance(self._X, self._X) + NOISE * np.eye(len(self._X)))
        self._weights = cho_solve(self._K, self._y)

    def lower_confidence_bounds(self, described: Array) -> Array:
        """Return where trees may stand if they do better than expected, shape (k,).

        Args:
            described: descriptors of the trees, shape (k, d).
        """
        X = self._columns(described)
        known = _covariance(X, self._X)
        before = 1.0 + LINEAR * (1.0 + np.mean(X * X, axis=1))
        variance = before - np.sum(known * cho_solve(self._K, known.T).T, axis=1)
        return np.asarray(known @ self._weights - OPTIMISM * np.sqrt(np.maximum(variance, 0.0)))

    def leave_one_out_bounds(self) -> Array:
        """Return the bounds of the solved trees that are `kept`, each predicted from all the others."""
        diagonal = np.diag(cho_solve(self._K, np.eye(len(self._y))))
        expected = self._y - self._weights / diagonal
        return np.asarray(expected - OPTIMISM * np.sqrt(np.maximum(1.0 / diagonal - NOISE, 0.0)))

    def _columns(self, described: Array) -> Array:
        return np.asarray((described - self._mean) / self._scale)


def _covariance(X: Array, Y: Array) -> Array:
    """Return k of all pairs of rows, shape (rows of X, rows of Y)."""
    d = X.shape[1]
    apart = cdist(X, Y, "sqeuclidean")
    return np.asarray(np.exp(-apart / (4 * d)) + LINEAR * (1.0 + X @ Y.T / d))


def _deviation(values: Array) -> Array:
    """Return the standard deviation of each column, 1 where all values are the same."""
    deviation = values.std(axis=0)
    return np.where(deviation > 0, deviation, 1.0)

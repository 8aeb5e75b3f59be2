"""A guess of how an unsolved tree will stand among those that are: linear regression on its descriptors.

| symbol | meaning | shape |
|---|---|---|
| X | descriptors of the m solved trees, columns of mean 0 and deviation 1 after one of ones | (m, 1 + d) |
| y | places of the solved trees in their ranking, with mean 0 and deviation 1 | (m,) |
| w | weights; before anything is solved independent, with mean 0, variance 1 (the first) and 1/d | (1 + d,) |

With noise of variance 1 in y the weights have mean A^-1 X^T y and covariance A^-1, A = X^T X + diag(1, d, ..., d)
(Bayesian linear regression). Places instead of objectives need no unit, and no value for a tree without a design.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Forecast:
    """The regression on trees that are solved."""

    def __init__(self, described: Array, places: Sequence[int]) -> None:
        """Fit.

        Args:
            described: descriptors of the solved trees, shape (m, d).
            places: their places in the ranking, equal ones for trees that stand alike.
        """
        self._mean, self._scale = described.mean(axis=0), _deviation(described)
        X, y = self._columns(described), np.asarray(places, dtype=float)
        d = described.shape[1]
        self._covariance = np.linalg.inv(X.T @ X + np.diag([1.0, *[float(d)] * d]))
        self._weights = self._covariance @ X.T @ ((y - y.mean()) / _deviation(y))

    def hopes(self, described: Array) -> Array:
        """Return where trees may stand if they do better than expected by a standard deviation, shape (k,).

        Args:
            described: descriptors of the trees, shape (k, d).
        """
        X = self._columns(described)
        deviation: Array = np.sqrt(np.einsum("ki,ij,kj->k", X, self._covariance, X))
        expected: Array = X @ self._weights
        return expected - deviation

    def _columns(self, described: Array) -> Array:
        return np.column_stack([np.ones(len(described)), (described - self._mean) / self._scale])


def _deviation(values: Array) -> Array:
    """Return the standard deviation of each column, 1 where all values are the same."""
    deviation = values.std(axis=0)
    return np.where(deviation > 0, deviation, 1.0)

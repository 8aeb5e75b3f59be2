"""How a quantity grows with the number of modules: y = c n^p, a straight line through the logarithms."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import pandas as pd


class PowerLaw(NamedTuple):
    """A fit by least squares."""

    exponent: float
    """p."""
    at_100: float
    """The value for a hundred modules, in the unit of y."""


def fit(n: pd.Series, y: pd.Series) -> PowerLaw | None:
    """Return the power law through points of positive y; None where they are all of one size."""
    n, y = n[y > 0], y[y > 0].astype("float64")
    if n.nunique() < 2:
        return None
    slope, intercept = np.polyfit(np.log(n), np.log(y), 1)
    return PowerLaw(float(slope), float(np.exp(intercept + slope * np.log(100))))

"""The candidates of a run as a data frame."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from topo_search.study.folder import RunFolder
from topo_search.study.row import COLUMNS


def candidates(path: Path) -> pd.DataFrame:
    """Return a row for every candidate of a run's folder, with the columns of `candidates.csv`, best first.

    Raises:
        BadInput: it is no run's folder.
    """
    with RunFolder.found(path) as folder:
        rows = [
            [getattr(row, name) for name in COLUMNS]
            for n in folder.request.task.sizes
            for row in folder.ledger.ranked(n)
        ]
    numbers = dict.fromkeys(("objective", "lower_bound", "gap", "violation"), "float64")
    return pd.DataFrame(rows, columns=list(COLUMNS)).astype(numbers)

"""The candidates of a run as a data frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from topo_search.study.folder import RunFolder
from topo_search.study.front import FRONT_COLUMNS, Point
from topo_search.study.row import COLUMNS


def candidates(path: Path) -> pd.DataFrame:
    """Return a row for every candidate of a run's folder, with the columns of `candidates.csv`, best first.

    With goals there is one for every level too, and its number in the last column.

    Raises:
        BadInput: it is no run's folder.
    """
    with RunFolder.found(path) as folder:
        rows = [
            [*(getattr(row, name) for name in COLUMNS), number]
            for number, level in enumerate(folder.levels())
            for n in level.request.task.sizes
            for row in level.ledger.ranked(n)
        ]
        goals = folder.request.task.goals.names
    numbers = dict.fromkeys(("objective", "lower_bound", "gap", "violation"), "float64")
    frame = pd.DataFrame(rows, columns=[*COLUMNS, "level"]).astype(numbers)
    return frame if goals else frame.drop(columns="level")


def front(points: Sequence[Point]) -> pd.DataFrame:
    """Return a row for every point of a front, with the columns of `front.csv`."""
    texts = {"key", "audit", "design"}
    numbers = {name: "int64" if name in ("modules", "level") else "float64" for name in FRONT_COLUMNS}
    frame = pd.DataFrame([point.cells for point in points], columns=list(FRONT_COLUMNS))
    return frame.astype({name: kind for name, kind in numbers.items() if name not in texts})

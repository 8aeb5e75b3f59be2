"""The candidates of a run, what those without a design miss, and its solves, as data frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, fields
from pathlib import Path

import pandas as pd

from topo_search.model import Infeasible
from topo_search.study.folder import RunFolder
from topo_search.study.front import FRONT_COLUMNS, FrontPoint
from topo_search.study.row import AUDITED, COLUMNS, FLIGHT, SolveEvent, kind_of


def candidates(path: Path) -> pd.DataFrame:
    """Return a row for every candidate of a run's folder, with the columns of `candidates.csv`, best first.

    With goals there is one for every level too, and its number in the last column.

    Raises:
        BadInput: it is not a run folder.
    """
    frame = _frame(path, COLUMNS, RunFolder.cells)
    numbers = ("objective", "lower_bound", "gap", "violation", *FLIGHT, *AUDITED, "proven_bound", "proven_gap")
    return frame.astype(dict.fromkeys(numbers, "float64"))


def front(points: Sequence[FrontPoint]) -> pd.DataFrame:
    """Return a row for every point of a front, with the columns of `front.csv`."""
    texts = {"key", "audit", "design", "rotor_out", "level_rotor_out"}
    numbers = {name: "int64" if name in ("modules", "level") else "float64" for name in FRONT_COLUMNS}
    frame = pd.DataFrame([point.cells for point in points], columns=list(FRONT_COLUMNS))
    return frame.astype({name: kind for name, kind in numbers.items() if name not in texts})


def shortfalls(path: Path) -> pd.DataFrame:
    """Return a row for every constraint that the starts of a candidate without a design missed.

    A candidate's most frequent constraint is first, `starts` says how many; `violation` is the least of theirs, in
    `unit`; `kind` is the constraint without module numbers. A candidate that is proven impossible was not solved
    and has no row. With goals the last column has the number of the level.

    Raises:
        BadInput: it is not a run folder.
    """

    def rows_of(level: RunFolder, n: int) -> Iterator[Sequence[object]]:
        contexts = level.request.contexts(n)
        for row in level.ledger.ranking(n):
            result = None if row.feasible else level.ledger.result(contexts[row.step], row.key)
            for one in result.shortfalls if isinstance(result, Infeasible) else ():
                yield row.key, n, one.constraint, one.starts, one.violation, one.unit, kind_of(one.constraint)

    return _frame(path, ("key", "modules", "constraint", "starts", "violation", "unit", "kind"), rows_of)


def solves(path: Path) -> pd.DataFrame:
    """Return a row for every solve of a run, in the order of their ends, with the fields of `SolveEvent`.

    With goals the last column has the number of the level.

    Raises:
        BadInput: it is not a run folder.
    """
    columns = [field.name for field in fields(SolveEvent)]
    frame = _frame(path, columns, lambda level, n: map(astuple, level.ledger.solves(n)))
    return frame.astype({"objective": "float64"}).sort_values("at", kind="stable", ignore_index=True)


def _frame(
    path: Path, columns: Sequence[str], rows_of: Callable[[RunFolder, int], Iterable[Sequence[object]]]
) -> pd.DataFrame:
    """Return the rows of all sizes, with goals of all levels, each with the number of its level."""
    with RunFolder.load(path) as folder:
        rows = [
            (*row, number)
            for number, level in enumerate(folder.levels)
            for n in level.request.task.sizes
            for row in rows_of(level, n)
        ]
        goals = folder.request.task.goals.names
    frame = pd.DataFrame(rows, columns=[*columns, "level"])
    return frame if goals else frame.drop(columns="level")

"""Tables of a run: `candidates.csv`, and data frames of its candidates, shortfalls, solves and front."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import TYPE_CHECKING

from topo_search.model import Infeasible
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import AUDITED, COLUMNS, FLIGHT, SolveEvent, figures_of, kind_of
from topo_search.study.pareto import FRONT_COLUMNS, FrontPoint
from topo_search.study.proofs import candidates_of

if TYPE_CHECKING:
    import pandas as pd


def write_candidates(folder: RunFolder) -> None:
    """Write `candidates.csv`, for every level of the goals."""
    for level in folder.levels:
        rows = (row for n in level.request.task.sizes for row in _cells(level, n))
        level.write_table("candidates.csv", COLUMNS, rows)


def _cells(folder: RunFolder, n: int) -> Iterator[list[object]]:
    """Yield the rows of `candidates.csv` for n modules."""
    for row, state, audit in candidates_of(folder, n):
        figures = {**state._asdict(), **(dict.fromkeys(AUDITED) if audit is None else figures_of(audit))}
        yield [figures[name] if name in figures else getattr(row, name) for name in COLUMNS]


def candidates(path: Path) -> pd.DataFrame:
    """Return a row for every candidate of a run's folder, with the columns of `candidates.csv`, best first.

    With goals there is a row for every level, and the last column is the level's number.

    Raises:
        BadInput: it is not a run folder.
    """
    frame = _frame(path, COLUMNS, _cells)
    numbers = ("objective", "lower_bound", "gap", "violation", *FLIGHT, *AUDITED, "proven_bound", "proven_gap")
    return frame.astype(dict.fromkeys(numbers, "float64"))


def shortfalls(path: Path) -> pd.DataFrame:
    """Return the shortfalls of the candidates without a design; see `Answer.shortfalls`."""

    def rows_of(level: RunFolder, n: int) -> Iterator[Sequence[object]]:
        contexts = level.request.contexts(n)
        for row in level.ledger.ranking(n):
            result = None if row.feasible else level.ledger.result(contexts[row.step], row.key)
            for s in result.shortfalls if isinstance(result, Infeasible) else ():
                yield row.key, n, s.constraint, s.starts, s.violation, s.unit, kind_of(s.constraint)

    columns = ("key", "modules", "constraint", "starts", "violation", "unit", "kind")
    return _frame(path, columns, rows_of)


def solves(path: Path) -> pd.DataFrame:
    """Return the solves in the order of completion; see `Answer.solves`."""
    columns = [field.name for field in fields(SolveEvent)]
    frame = _frame(path, columns, lambda level, n: map(astuple, level.ledger.solves(n)))
    return frame.astype({"objective": "float64"}).sort_values("at", kind="stable", ignore_index=True)


def front_table(points: Sequence[FrontPoint]) -> pd.DataFrame:
    """Return the designs of the front; see `Answer.front`."""
    import pandas as pd  # slow to import

    texts = {"key", "audit", "design", "rotor_out", "level_rotor_out"}
    kinds = {name: "int64" if name in ("modules", "level") else "float64" for name in FRONT_COLUMNS}
    frame = pd.DataFrame([point.cells for point in points], columns=list(FRONT_COLUMNS))
    return frame.astype({name: kind for name, kind in kinds.items() if name not in texts})


def _frame(
    path: Path, columns: Sequence[str], rows_of: Callable[[RunFolder, int], Iterable[Sequence[object]]]
) -> pd.DataFrame:
    """Return the rows of all sizes and levels; with goals, the last column is the level's number."""
    import pandas as pd  # slow to import

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

"""Tables of a run: `candidates.csv`, data frames of candidates, shortfalls, solves and front, and HTML."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import TYPE_CHECKING

from topo_search.model import Infeasible
from topo_search.model.html import heading, paragraph, table
from topo_search.model.proven import gap_percent
from topo_search.study.columns import AUDIT_FIGURES, COLUMNS, figures_of, kind_of, proven_cell
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import FLIGHT, NEAR_BEST, SolveEvent
from topo_search.study.pareto import FRONT_COLUMNS, FrontPoint
from topo_search.study.proofs import candidates_of

if TYPE_CHECKING:
    import pandas as pd

    from topo_search.study.answer import Answer, SizeAnswer


def write_candidates(folder: RunFolder) -> None:
    """Write `candidates.csv`, for every level of the goals."""
    for level in folder.levels:
        rows = (row for n in level.request.task.sizes for row in _cells(level, n))
        level.write_table("candidates.csv", COLUMNS, rows)


def _cells(folder: RunFolder, n: int) -> Iterator[list[object]]:
    """Yield the rows of `candidates.csv` for n modules."""
    for row, state, audit in candidates_of(folder, n):
        figures = {**state._asdict(), **(dict.fromkeys(AUDIT_FIGURES) if audit is None else figures_of(audit))}
        yield [figures[name] if name in figures else getattr(row, name) for name in COLUMNS]


def candidates(path: Path) -> pd.DataFrame:
    """Return a row for every candidate of a run's folder, with the columns of `candidates.csv`, best first.

    With goals there is a row for every level, and the last column is the level's number.

    Raises:
        BadInput: it is not a run folder.
    """
    frame = _frame(path, COLUMNS, _cells)
    bounds = ("objective", "lower_bound", "gap", "violation", "proven_bound", "proven_gap")
    numbers = (*bounds, *FLIGHT, *AUDIT_FIGURES, "value", "value_bound", "reach")
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
    frame = frame.astype({"objective": "float64", "value": "float64"})
    return frame.sort_values("at", kind="stable", ignore_index=True)


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


def size_html(size: SizeAnswer) -> str:
    """Return the best designs of this size for a notebook."""
    title = heading(f"modules: {size.modules}; candidates: {size.candidates} ({size.counts or 'none settled'})")
    number = size.objective.number
    names = ("key", size.objective.column, "gap", "symmetric copies", "audit")
    rows = [
        (row.key, number(row), None if gap is None else gap_percent(gap), row.orbit, row.audit)
        for row, gap in ((row, size.gap_of(row)) for row in size.top)
    ]
    relaxed = size.relaxed.sentences if size.relaxed else ()
    remarks = (size.quotient, *size.remarks, *([size.reason] if size.reason else []), *relaxed)
    html = title + (table(names, rows) if rows else "")
    if len(size.near_ties) > 1:
        cells = ([proven_cell(name, getattr(row, name)) for name in FLIGHT] for row in size.near_ties)
        ties = [(row.key, number(row), *figures) for row, figures in zip(size.near_ties, cells, strict=True)]
        html += heading(f"within {100 * NEAR_BEST:g} % of the {size.objective.least}, largest force reserve first")
        html += table(("key", size.objective.column, *FLIGHT), ties)
    return html + "".join(paragraph(text) for text in remarks)


def size_repr(size: SizeAnswer) -> str:
    """Return the best design of a size, or why there is none, in one line."""
    best = size.best and f"{size.best.key}, {size.objective.words(size.best, 6)}"
    return textwrap.shorten(f"{size.modules} modules: {size.counts}; {best or size.failure or size.reason}", 120)


def answer_repr(answer: Answer) -> str:
    """Return the answer and its first sizes in at most ten lines, for a notebook or a terminal."""
    sizes = [size for level in answer.levels for size in level.sizes] or answer.sizes
    return "\n".join([textwrap.shorten(str(answer), 500), *map(repr, sizes[:9])])


def answer_html(answer: Answer) -> str:
    """Return a sentence and a table for each size, or for the front, for a notebook."""
    if answer.levels:
        columns = ["key", "modules", "J [rad^4/s^4]", "clearance [m]", "stand-off [m]", "peak input / u_max"]
        names = ["key", "modules", "objective", "clearance", "stand_off", "peak_input"]
        if answer.objective.better == "more":
            columns, names = [*columns, answer.objective.column], [*names, "value"]
        cells = [[(name, point.cells[name]) for name in names] for point in answer.points]
        rows = [[x if name == "objective" else proven_cell(name, x) for name, x in row] for row in cells]
        html = heading(f"front of {len(answer.points)} designs, found at {len(answer.levels)} levels")
        return html + table(columns, rows) + paragraph(f"everything is in {answer.folder}")
    return "".join(size_html(size) for size in answer.sizes) + paragraph(f"everything is in {answer.folder}")

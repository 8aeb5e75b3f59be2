"""The candidates of a run, what those without a design miss, and its solves, as data frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

import pandas as pd

from topo_search.model import Infeasible
from topo_search.study.answer import kind_of
from topo_search.study.folder import RunFolder
from topo_search.study.front import FRONT_COLUMNS, FrontPoint
from topo_search.study.proofs import cells
from topo_search.study.row import COLUMNS, FLIGHT, SolveEvent


def candidates(path: Path) -> pd.DataFrame:
    """Return a row for every candidate of a run's folder, with the columns of `candidates.csv`, best first.

    With goals there is one for every level too, and its number in the last column.

    Raises:
        BadInput: it is not a run folder.
    """
    with RunFolder.load(path) as folder:
        rows = [
            [*cells(row, state), number]
            for number, level in enumerate(folder.levels)
            for n in level.request.task.sizes
            for row, state in level.proof_states(n)
        ]
        goals = folder.request.task.goals.names
    numbers = dict.fromkeys(
        ("objective", "lower_bound", "gap", "violation", *FLIGHT, "proven_bound", "proven_gap"), "float64"
    )
    frame = pd.DataFrame(rows, columns=[*COLUMNS, "level"]).astype(numbers)
    return frame if goals else frame.drop(columns="level")


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
    rows = []
    with RunFolder.load(path) as folder:
        for number, level in enumerate(folder.levels):
            for n in level.request.task.sizes:
                contexts = level.request.contexts(n)
                for row in level.ledger.ranking(n):
                    found = None if row.feasible else level.ledger.result(contexts[row.step], row.key)
                    missed = found.shortfalls if isinstance(found, Infeasible) else ()
                    rows += [
                        {
                            "key": row.key,
                            "modules": n,
                            **one.model_dump(),
                            "kind": kind_of(one.constraint),
                            "level": number,
                        }
                        for one in missed
                    ]
        goals = folder.request.task.goals.names
    frame = pd.DataFrame(
        rows, columns=["key", "modules", "constraint", "starts", "violation", "unit", "kind", "level"]
    )
    return frame if goals else frame.drop(columns="level")


def solves(path: Path) -> pd.DataFrame:
    """Return a row for every solve of a run, in the order of their ends, with the fields of `SolveEvent`.

    With goals the last column has the number of the level.

    Raises:
        BadInput: it is not a run folder.
    """
    with RunFolder.load(path) as folder:
        rows = [
            {**asdict(solve), "level": number}
            for number, level in enumerate(folder.levels)
            for n in level.request.task.sizes
            for solve in level.ledger.solves(n)
        ]
        goals = folder.request.task.goals.names
    frame = pd.DataFrame(rows, columns=[*(field.name for field in fields(SolveEvent)), "level"])
    frame = frame.astype({"objective": "float64"}).sort_values("at", kind="stable", ignore_index=True)
    return frame if goals else frame.drop(columns="level")

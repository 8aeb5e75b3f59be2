"""The gain from more starts of a large platform: gap of the first design, and of the best in two minutes."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

from attempts import TaskChoice, load
from children import Child
from clock import Clock
from options import AIRFLOW_ALONE, Options, at
from rows import Row, Rows

import nlp
from nlp.solving import UNTANGLED_STARTS
from topo_search.experiments.study import peak_mb
from topo_search.model import Design, Topology
from topo_search.topologies import sample
from verify import audit

PART, SIZES, EXAMPLE, DISTANCE = "best", (40, 100), "ten-wrenches", 0.30
SECONDS = 120
"""Largest CPU time of one topology [s]; a start that is running then does not count."""


def measure(rows: Rows, options: Options) -> None:
    """Measure each topology in a new process, with as many starts as a search makes, or as fit into the time."""
    for distance in options.distances or (DISTANCE,):
        for n in options.sizes:
            for topology in sample(n, options.topologies, 0):
                identity = {"part": PART, "n": n, "key": topology.key, "distance": distance}
                if rows.where(**identity):
                    continue
                choice = TaskChoice(EXAMPLE, n, (AIRFLOW_ALONE, at(distance)))
                with Child(_starts, choice, topology.key, cap=min(SECONDS, options.cap)) as child:
                    attempts = list(child)
                rows.add({**identity, "tried": attempts, "verdict": _verdict(attempts)})


def _starts(choice: TaskChoice, key: str) -> Iterator[Row]:
    """Yield an empty row, then the result of every start."""
    load(choice)
    task, topology = choice.resolve(), Topology.from_key(key)
    yield {}
    for index in range(UNTANGLED_STARTS):
        clock = Clock()
        outcome = nlp.solve(task, topology, starts=range(index, index + 1), seed=0)
        row: Row = {"start": index, "seconds": clock.lap(), "peak_mb": peak_mb(), "gap": None}
        if isinstance(outcome, Design):
            row |= {"gap": outcome.gap, "design": outcome.model_dump_json()}
        yield row


def _verdict(attempts: list[Row]) -> str | None:
    """Return the verdict of the audit on the best design, and drop the designs from the rows."""
    designs = [(row["gap"], row.pop("design")) for row in attempts if row["gap"] is not None]
    return audit(Design.model_validate_json(min(designs)[1])).verdict if designs else None


def table(rows: Rows) -> str:
    """Return the gaps of first and best designs by size."""
    lines = [
        "| n | m | with a design | gap of the first, median | of the best, median | starts, median | peak MB |",
        "|---|---|---|---|---|---|---|",
    ]
    measured = rows.where(part=PART)
    for n, distance in sorted({(row["n"], row["distance"]) for row in measured}):
        group = rows.where(part=PART, n=n, distance=distance)
        runs = [row["tried"] for row in group]
        gaps = [[start["gap"] for start in starts if start["gap"] is not None] for starts in runs]
        solved = [design_gaps for design_gaps in gaps if design_gaps]
        unclear = sum(row["verdict"] not in (None, "clear") for row in group)
        cells = [
            f"{len(solved)} of {len(runs)}" + (f", {unclear} audits not clear" if unclear else ""),
            f"{100 * statistics.median(design_gaps[0] for design_gaps in solved):.1f} %" if solved else "",
            f"{100 * statistics.median(map(min, solved)):.1f} %" if solved else "",
            f"{statistics.median(map(len, runs)):.0f}",
            f"{max((start['peak_mb'] for starts in runs for start in starts), default=0.0):.0f}",
        ]
        lines.append(f"| {n} | {distance:.2f} | {' | '.join(cells)} |")
    return "\n".join(lines)

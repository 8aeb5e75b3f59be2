"""What more starts of a large platform bring: the effort of its first design, and of the best in two minutes."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

from attempts import Stated, load
from children import Child
from options import AIRFLOW_ALONE, Options, at
from rows import Row, Rows

import nlp
from nlp.solve import UNTANGLED_STARTS
from topo_search.model import Design, Topology
from topo_search.supervisor import Clock, peak_mb
from topo_search.topologies import sample
from verify import audit

PART, SIZES, EXAMPLE, DISTANCE = "best", (40, 100), "ten-wrenches", 0.30
SECONDS = 120
"""CPU seconds of one topology at most; a start that is under way then does not count."""


def measure(rows: Rows, options: Options) -> None:
    """Measure each topology in a new process: as many starts as a search makes, or as the time allows."""
    for distance in options.distances or (DISTANCE,):
        for n in options.sizes:
            for topology in sample(n, options.topologies, 0):
                identity = {"part": PART, "n": n, "key": topology.key, "distance": distance}
                if rows.where(**identity):
                    continue
                stated = Stated(EXAMPLE, n, (AIRFLOW_ALONE, at(distance)))
                with Child(_starts, stated, topology.key, cap=min(SECONDS, options.cap)) as child:
                    tried = list(child)
                rows.add({**identity, "tried": tried, "verdict": _verdict(tried)})


def _starts(stated: Stated, key: str) -> Iterator[Row]:
    """Yield an empty row, then what comes of every start."""
    load(stated)
    task, topology = stated.resolve(), Topology.from_key(key)
    yield {}
    for index in range(UNTANGLED_STARTS):
        clock = Clock()
        outcome = nlp.solve(task, topology, starts=range(index, index + 1), seed=0)
        row: Row = {"start": index, "seconds": clock.lap(), "peak_mb": peak_mb(), "gap": None}
        if isinstance(outcome, Design):
            row |= {"gap": outcome.gap, "design": outcome.model_dump_json()}
        yield row


def _verdict(tried: list[Row]) -> str | None:
    """Return what the audit says of the best design, and leave the rows with their figures alone."""
    designs = [(row["gap"], row.pop("design")) for row in tried if row["gap"] is not None]
    return audit(Design.model_validate_json(min(designs)[1])).verdict if designs else None


def table(rows: Rows) -> str:
    """Return what first and best designs lack to the bound, by size."""
    lines = [
        "| n | m | with a design | gap of the first, median | of the best, median | starts, median | most MB |",
        "|---|---|---|---|---|---|---|",
    ]
    measured = rows.where(part=PART)
    for n, distance in sorted({(row["n"], row["distance"]) for row in measured}):
        group = rows.where(part=PART, n=n, distance=distance)
        runs = [row["tried"] for row in group]
        gaps = [[start["gap"] for start in tried if start["gap"] is not None] for tried in runs]
        solved = [of for of in gaps if of]
        unclear = sum(row["verdict"] not in (None, "clear") for row in group)
        cells = [
            f"{len(solved)} of {len(runs)}" + (f", {unclear} audits not clear" if unclear else ""),
            f"{100 * statistics.median(of[0] for of in solved):.1f} %" if solved else "",
            f"{100 * statistics.median(min(of) for of in solved):.1f} %" if solved else "",
            f"{statistics.median(len(tried) for tried in runs):.0f}",
            f"{max((start['peak_mb'] for tried in runs for start in tried), default=0.0):.0f}",
        ]
        lines.append(f"| {n} | {distance:.2f} | {' | '.join(cells)} |")
    return "\n".join(lines)

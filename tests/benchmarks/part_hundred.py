"""A hundred modules: time, memory and audit, and the reasons why topologies are not solved."""

from __future__ import annotations

from collections.abc import Iterator

from attempts import TaskChoice, load
from children import Child
from clock import Clock
from options import AIRFLOW_ALONE, Options, at
from part_share import kind_of
from rows import Row, Rows

import nlp
from nlp.evaluation import violations
from nlp.starts.random_starts import draw, generator
from topo_search.experiments.study import peak_mb
from topo_search.model import Design, Topology
from topo_search.topologies import sample
from verify import audit

PART, SIZES, EXAMPLE = "hundred", (100,), "ten-wrenches"
DISTANCES = (0.30, 0.22)
SECONDS, MEGABYTES = 120, 4096
"""Targets for the CPU time [s] and the memory of a solved topology."""


def measure(rows: Rows, options: Options) -> None:
    """Measure each topology in a new process, until a start leads to a design with a clear audit."""
    for distance in options.distances or DISTANCES:
        for n in options.sizes:
            for topology in sample(n, options.topologies, 0):
                identity = {"part": PART, "n": n, "key": topology.key, "distance": distance}
                if rows.where(**identity):
                    continue
                choice, tried = TaskChoice(EXAMPLE, n, (AIRFLOW_ALONE, at(distance))), []
                with Child(_starts, choice, topology.key, options.starts, cap=options.cap) as child:
                    while (
                        not (tried and tried[-1]["verdict"] == "clear") and (row := next(child, None)) is not None
                    ):
                        tried.append(row)
                rows.add({**identity, "capped": child.capped, "tried": tried})


def _starts(choice: TaskChoice, key: str, starts: int) -> Iterator[Row]:
    """Yield an empty row, then the result of every start, with separate times of untangling and audit."""
    load(choice)
    task, topology = choice.resolve(), Topology.from_key(key)
    yield {}
    for index in range(starts):
        clock = Clock()
        start = draw(task, topology, generator(task, topology, index, 0))
        row: Row = {"start": index, "draw": clock.lap()}
        row["placed"] = min(-check.amount for check in violations(start) if kind_of(check.name) == "airflow")
        clock.lap()
        outcome = nlp.solve(task, topology, starts=range(index, index + 1), seed=0)
        row |= {"seconds": clock.lap(), "peak_mb": peak_mb()}
        if isinstance(outcome, Design):
            row |= {"verdict": audit(outcome).verdict, "J": outcome.objective, "gap": outcome.gap}
            row["audit"] = clock.lap()
        else:
            row |= {
                "verdict": None,
                "missed": outcome.worst_constraint,
                "by": outcome.violation,
                "unit": outcome.unit,
            }
        yield row


def _reason(tried: list[Row]) -> str:
    """Return why a topology was not solved: the solver's violation, and the clearance after untangling."""
    untangled = max((start["placed"] for start in tried), default=float("-inf"))
    missed = [start for start in tried if start["verdict"] is None]
    if not missed:
        return "no start was finished" if not tried else f"audit {tried[-1]['verdict']}"
    nearest = min(missed, key=lambda start: start["by"])
    solver = f"{nearest['missed']} by {nearest['by']:.2g} {nearest['unit']}"
    return f"{solver}; least clearance after untangling {untangled:.3f} m"


def table(rows: Rows) -> str:
    """Return one line per topology, and the numbers solved and solved within the targets."""
    lines = [
        "| distance, m | topology | audit | starts | CPU s | untangling s | peak MB | gap | reason |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    groups: dict[tuple[float, int], list[tuple[bool, bool]]] = {}
    for row in rows.where(part=PART):
        tried = row["tried"]
        seconds, untangling = (sum(start[name] for start in tried) for name in ("seconds", "draw"))
        peak = max((start["peak_mb"] for start in tried), default=0.0)
        last = tried[-1] if tried else {"verdict": None}
        clear = last["verdict"] == "clear"
        group = groups.setdefault((row["distance"], row["n"]), [])
        group.append((clear, clear and seconds < SECONDS and peak < MEGABYTES))
        reason = "" if clear else _reason(tried) + (", stopped by the cap" if row["capped"] else "")
        gap = f"{last['gap']:.1%}" if clear else ""
        cells = [
            f"{row['distance']:.2f}",
            str(len(group) - 1),
            last["verdict"] or "none",
            str(len(tried)),
            f"{seconds:.0f}",
        ]
        lines.append(f"| {' | '.join([*cells, f'{untangling:.0f}', f'{peak:.0f}', gap, reason])} |")
    for (distance, n), answers in groups.items():
        clear, within_targets = (sum(answer) for answer in zip(*answers, strict=True))
        lines.append(f"\nn = {n}, {distance:.2f} m: {clear} of {len(answers)} solved, audit clear;")
        lines.append(f"{within_targets} in under {SECONDS} CPU s and {MEGABYTES} MB.")
    return "\n".join(lines)

"""What it costs to ask for more than load cases: the best effort with each request over that without any.

    python tests/benchmarks/flight_costs.py [TASK] [--out ROWS.jsonl] [--requests NAME ...] [--every]

Every tree that differs by more than symmetry is solved as the task stands; with a request, trees come in the order
of those efforts, and only as long as one could still be the best: whatever is asked for besides, no tree takes less
effort than without it. `--every` solves them all. Designs that are not clear are solved again with larger margins,
as in a run. Rows are kept one by one, so that an interrupted measurement goes on.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

from rows import Row, Rows

import verify
from nlp import default_starts, solve
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.files import read_task
from topo_search.study.request import Margins, margins, with_margin
from topo_search.topologies import candidates

PLAIN = "nothing"
REQUESTS: dict[str, tuple[str, ...]] = {
    PLAIN: (),
    "hover with any rotor dead": ('flight.rotor_out="hover"',),
    "0.1 weights sideways in hover": ("flight.force_reserve=0.1", 'flight.directions="horizontal"'),
    "margin of 5 mm": ("search.margin=0.005",),
    "joint moment of 2 N m": ("flight.joint_moment=2.0",),
    "hinge error of 0.2 degrees": ("flight.tolerances=true", "tolerances.hinge_angle_deg=0.2"),
}
TOGETHER = "all together"
REQUESTS[TOGETHER] = tuple(setting for settings in REQUESTS.values() for setting in settings)
SEED = 0


def solved(task: ResolvedTask, tree: Topology, starts: int) -> Row:
    """Return what became of a tree: its last design and what the audit says of it, or why there is none."""
    row: Row = {"status": "", "objective": None}
    raised = Margins([with_margin(task, margin) for margin in margins(task)])
    began = time.process_time()
    while True:
        outcome = solve(raised.task, tree, starts=range(starts), seed=SEED)
        if not isinstance(outcome, Design):
            if raised.step == 0:
                row.update(status=outcome.status, worst=outcome.worst_constraint)
            break
        audit = verify.audit(outcome)
        row.update(status=audit.verdict.value, objective=outcome.objective, margin=raised.task.search.margin)
        if audit.verdict == "clear" or not raised.raise_after(audit):
            break
    return {**row, "seconds": time.process_time() - began}


def clear(rows: list[Row]) -> dict[str, float]:
    """Return the effort of every tree whose design is clear."""
    return {row["key"]: row["objective"] for row in rows if row["status"] == "clear"}


def main() -> None:
    """Measure what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", nargs="?", default="push")
    parser.add_argument("--out", type=Path, default=Path("flight-costs.jsonl"))
    parser.add_argument("--requests", nargs="+", choices=REQUESTS, default=[*REQUESTS])
    parser.add_argument("--every", action="store_true")
    arguments = parser.parse_args()
    kept = Rows(arguments.out)
    plain: dict[str, float] = {}
    for name in dict.fromkeys([PLAIN, *arguments.requests]):
        task = read_task(arguments.task, REQUESTS[name])
        resolved, starts = task.resolve(task.n), default_starts(task)
        trees = [one.topology for one in candidates(task.n, symmetry="task", task=resolved)]
        for tree in sorted(trees, key=lambda tree: plain.get(tree.key, math.inf)):
            best = min(clear(kept.where(request=name)).values(), default=math.inf)
            if name != PLAIN and not arguments.every and plain.get(tree.key, math.inf) >= best:
                continue
            if not kept.where(request=name, key=tree.key):
                row = {"request": name, "key": tree.key, **solved(resolved, tree, starts)}
                kept.add(row)
                print(row, flush=True)
        plain = plain or clear(kept.where(request=name))

    print("| asked for | best effort | over without | tree | trees solved, of them clear | CPU s |")
    print("|---|---|---|---|---|---|")
    for name in REQUESTS:
        if not (rows := kept.where(request=name)):
            continue
        efforts, seconds = clear(rows), sum(row["seconds"] for row in rows)
        best = min(efforts, key=lambda key: efforts[key], default=None)
        cells = ("none", "", "")
        if best is not None:
            cells = f"{efforts[best]:.6g}", f"{100 * (efforts[best] / min(plain.values()) - 1):+.2f} %", best
        print(f"| {name} | {' | '.join(cells)} | {len(rows)}, {len(efforts)} | {seconds:.0f} |")


if __name__ == "__main__":
    main()

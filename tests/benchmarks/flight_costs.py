"""Cost of requirements beyond the load cases: the best effort with each over the best without any.

    python tests/benchmarks/flight_costs.py [TASK] [--out ROWS.jsonl] [--requests NAME ...] [--every]

Every tree that differs by more than symmetry is solved without the requirements. With a requirement, trees are
solved in the order of those efforts, and only while one can still be the best: a requirement never lowers the
effort of a tree. `--every` solves all of them. Designs that are not clear are solved again with larger margins, as
in a run. Rows are stored one by one, so that an interrupted measurement resumes.
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
from topo_search.model.task_file import read_task
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


def solved_row(task: ResolvedTask, tree: Topology, starts: int) -> Row:
    """Return the row of a tree: its last design with the verdict of the audit, or the reason why it has none."""
    row: Row = {"status": "", "objective": None}
    levels = Margins([with_margin(task, margin) for margin in margins(task)])
    started = time.process_time()
    while True:
        outcome = solve(levels.task, tree, starts=range(starts), seed=SEED)
        if not isinstance(outcome, Design):
            if levels.step == 0:
                row.update(status=outcome.status, worst=outcome.worst_constraint)
            break
        audit = verify.audit(outcome)
        row.update(status=audit.verdict.value, objective=outcome.objective, margin=levels.task.search.margin)
        if audit.verdict == "clear" or not levels.raise_after(audit):
            break
    return {**row, "seconds": time.process_time() - started}


def clear_efforts(rows: list[Row]) -> dict[str, float]:
    """Return the effort of every tree with a clear design, by key."""
    return {row["key"]: row["objective"] for row in rows if row["status"] == "clear"}


def main() -> None:
    """Measure the missing rows, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", nargs="?", default="push")
    parser.add_argument("--out", type=Path, default=Path("flight-costs.jsonl"))
    parser.add_argument("--requests", nargs="+", choices=REQUESTS, default=[*REQUESTS])
    parser.add_argument("--every", action="store_true")
    arguments = parser.parse_args()
    store = Rows(arguments.out)
    plain: dict[str, float] = {}
    for name in dict.fromkeys([PLAIN, *arguments.requests]):
        task = read_task(arguments.task, REQUESTS[name])
        resolved, starts = task.resolve(task.n), default_starts(task)
        trees = [candidate.topology for candidate in candidates(task.n, symmetry="task", task=resolved)]
        for tree in sorted(trees, key=lambda tree: plain.get(tree.key, math.inf)):
            best = min(clear_efforts(store.where(request=name)).values(), default=math.inf)
            if name != PLAIN and not arguments.every and plain.get(tree.key, math.inf) >= best:
                continue
            if not store.where(request=name, key=tree.key):
                row = {"request": name, "key": tree.key, **solved_row(resolved, tree, starts)}
                store.add(row)
                print(row, flush=True)
        plain = plain or clear_efforts(store.where(request=name))

    print("| requirement | best effort | increase | tree | trees solved, of them clear | CPU s |")
    print("|---|---|---|---|---|---|")
    for name in REQUESTS:
        if not (rows := store.where(request=name)):
            continue
        efforts, seconds = clear_efforts(rows), sum(row["seconds"] for row in rows)
        best = min(efforts, key=lambda key: efforts[key], default=None)
        cells = ("none", "", "")
        if best is not None:
            cells = f"{efforts[best]:.6g}", f"{100 * (efforts[best] / min(plain.values()) - 1):+.2f} %", best
        print(f"| {name} | {' | '.join(cells)} | {len(rows)}, {len(efforts)} | {seconds:.0f} |")


if __name__ == "__main__":
    main()

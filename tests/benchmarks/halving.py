"""Cost and results of schedules that drop the worse half of the starts.

    python tests/benchmarks/halving.py EXAMPLE [--modules N] [--trees M] [--seeds R]
        [--schedules STARTS[:STEPS:LEAST] ...]

A schedule is a number of starts per tree, the number of steps after which half of the draws are dropped, and the
smallest number of draws that remain; with only a number of starts, none is dropped. Trees are uniformly drawn,
without body clearance, and solved with several seeds. CPU time, of one thread for all trees, and the number of
designs are means over the seeds. The best known effort of a tree is the least of all runs.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import NamedTuple
from unittest.mock import patch

from reduced import mean_and_largest, within

import nlp
from nlp import multistart
from nlp.reduced import search
from topo_search.model import Design
from topo_search.model.task_file import read_task
from topo_search.topologies import sample


class Schedule(NamedTuple):
    """Number of starts, and the rule that drops some of them."""

    starts: int
    steps: int = 0
    least: int = sys.maxsize


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example")
    parser.add_argument("--modules", type=int, default=7)
    parser.add_argument("--trees", type=int, default=60)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--schedules",
        nargs="+",
        type=_schedule,
        default=[Schedule(16), Schedule(20, search.SELECTION.halving_step, search.SELECTION.min_starts)],
    )
    arguments = parser.parse_args()
    schedules: list[Schedule] = arguments.schedules
    task = read_task(arguments.example, (f"modules={arguments.modules}", "search.body_clearance=false"))
    resolved = task.resolve(arguments.modules)
    trees = sample(arguments.modules, arguments.trees, 0, symmetry="task", task=resolved)
    nlp.solve(resolved, trees[0], starts=range(1), seed=0)  # compile or load code
    efforts: dict[Schedule, list[tuple[str, float]]] = {schedule: [] for schedule in schedules}
    seconds = dict.fromkeys(schedules, 0.0)
    for seed in range(arguments.seeds):
        for tree in trees:
            for schedule in schedules:
                selection = search.SELECTION._replace(halving_step=schedule.steps, min_starts=schedule.least)
                started = time.process_time()
                with patch.object(search, "SELECTION", selection), patch.object(multistart, "SELECTION", selection):
                    outcome = nlp.solve(resolved, tree, starts=range(schedule.starts), seed=seed)
                seconds[schedule] += time.process_time() - started
                if isinstance(outcome, Design):
                    efforts[schedule].append((tree.key, outcome.objective))
    best: dict[str, float] = {}
    for key, J in (pair for pairs in efforts.values() for pair in pairs):
        best[key] = min(J, best.get(key, J))
    print(f"{arguments.example}, n = {arguments.modules}: {len(trees)} trees drawn")
    print("| starts | designs | within 0.1 % | mean, largest excess | CPU s |")
    print("|" + "---|" * 5)
    for schedule in schedules:
        excess = [J / best[key] - 1 for key, J in efforts[schedule]]
        counts = (len(excess) / arguments.seeds, within(excess) / arguments.seeds)
        halved = f"halved after {schedule.steps} to {schedule.least}" if schedule.steps else "none dropped"
        cells = (f"{schedule.starts}, {halved}", *(f"{count:.1f}" for count in counts), mean_and_largest(excess))
        print(f"| {' | '.join(cells)} | {seconds[schedule] / arguments.seeds:.2f} |")


def _schedule(text: str) -> Schedule:
    """Parse STARTS[:STEPS:LEAST]."""
    return Schedule(*(int(part) for part in text.split(":")))


if __name__ == "__main__":
    main()

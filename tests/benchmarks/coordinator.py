"""CPU time of the coordinator of a search relative to the solves.

    PYTHONPATH=tests python tests/benchmarks/coordinator.py push --modules 8 [--trees N] [--profile]

First uniformly drawn trees are solved from all starts, as in an exhaustive search; then as many that `moves`
proposes, most of them from one start. There is one worker, a ledger and audits; a short search before loads code.
The coordinator's own time for audits counts, the time of the audits does not.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from engine_jobs import timed

from nlp import default_starts
from topo_search.compose import BACKENDS
from topo_search.engine import Candidates, Engine, Failed, Job, Workers
from topo_search.model.task_file import read_task
from topo_search.study import Request, SilentObserver, run
from topo_search.study.request import UserInputs

WARM_UP_TREES = 4
"""Trees of the search that loads code."""


class TimedEngine(Engine):
    """An engine that adds up the CPU time of its solves."""

    def __init__(self, engine: Engine) -> None:
        """Wrap an engine."""
        self.engine, self.solves, self.seconds = engine, 0, 0.0

    def run(self, function: Any, jobs: Iterable[Any], **options: Any) -> Iterator[tuple[Any, Any]]:
        """Run jobs on the engine."""
        for job, outcome in self.engine.run(partial(timed, function), jobs, **options):
            if isinstance(outcome, Failed):
                raise SystemExit(f"a job failed: {outcome.reason}")
            result, _, seconds = outcome
            if isinstance(job, Job):
                self.solves, self.seconds = self.solves + 1, self.seconds + seconds
            yield job, result


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="push")
    parser.add_argument("--modules", type=int, default=8)
    parser.add_argument("--trees", type=int, default=100)
    parser.add_argument("--strategies", nargs="+", default=["exhaustive", "optuna"])
    parser.add_argument("--profile", action="store_true", help="print a profile of the main thread")
    arguments = parser.parse_args()
    n = arguments.modules
    task = read_task(arguments.example, (f"modules={n}",))
    drawn = sorted({tree.key for tree in Candidates(task.resolve(n), "task").sample(arguments.trees, 0)})
    print(f"{task.name}, n = {n}, {default_starts(task)} starts")
    print("| | solves | CPU of a solve | coordinator's CPU a solve | share |")
    print("|---|---|---|---|---|")
    with Workers(1) as workers:
        for strategy in arguments.strategies:

            def request(trees: int, strategy: str = strategy) -> Request:
                request = Request(task, "task", default_starts(task), 0)
                if strategy == "exhaustive":
                    return replace(request, user_inputs=UserInputs(topologies=tuple(drawn[:trees])))
                return replace(request, strategy="optuna", trials=trees)

            timed_search(request(WARM_UP_TREES), workers)
            profile = cProfile.Profile() if arguments.profile else None
            engine, seconds = timed_search(request(len(drawn)), workers, profile)
            per_solve = f"{1e3 * engine.seconds / engine.solves:.0f} ms | {1e3 * seconds / engine.solves:.1f} ms"
            print(f"| {strategy} | {engine.solves} | {per_solve} | {seconds / engine.seconds:.1%} |", flush=True)
            if profile is not None:
                pstats.Stats(profile).sort_stats("cumulative").print_stats(60)


def timed_search(
    request: Request, workers: Workers, profile: cProfile.Profile | None = None
) -> tuple[TimedEngine, float]:
    """Run a new search, and return its engine and the coordinator's CPU time [s]."""
    engine = TimedEngine(workers)
    with tempfile.TemporaryDirectory() as folder:
        started = time.process_time()
        if profile is not None:
            profile.enable()
        run(request, Path(folder), BACKENDS, engine=engine, observer=SilentObserver())
        if profile is not None:
            profile.disable()
        return engine, time.process_time() - started


if __name__ == "__main__":
    main()

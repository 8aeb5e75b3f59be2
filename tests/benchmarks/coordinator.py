"""What the coordinator of a search costs beside the solves, in CPU time.

    PYTHONPATH=tests python tests/benchmarks/coordinator.py push --modules 8 [--trees N] [--profile]

Uniformly drawn trees, each from all starts, as an exhaustive search solves them; then as many that `moves`
proposes, most of them from one start. By one worker, to a ledger and with audits, after a short search in which
code is loaded. What the coordinator takes for audits counts, what audits themselves take does not.
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
from topo_search.model.files import read_task
from topo_search.study import Request, Silent, run
from topo_search.study.request import UserInputs

FEW = 4
"""Trees of the search in which code is loaded."""


class Watched(Engine):
    """An engine that adds up what its solves take."""

    def __init__(self, engine: Engine) -> None:
        """Watch an engine."""
        self.engine, self.solves, self.seconds = engine, 0, 0.0

    def run(self, function: Any, jobs: Iterable[Any], **options: Any) -> Iterator[tuple[Any, Any]]:
        """Run jobs on the engine."""
        for job, ended in self.engine.run(partial(timed, function), jobs, **options):
            if isinstance(ended, Failed):
                raise SystemExit(f"a job failed: {ended.reason}")
            result, _, seconds = ended
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
    parser.add_argument("--profile", action="store_true", help="print what the main thread spends its time on")
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
                asked = Request(task, "task", default_starts(task), 0)
                if strategy == "exhaustive":
                    return replace(asked, user_inputs=UserInputs(topologies=tuple(drawn[:trees])))
                return replace(asked, strategy="optuna", trials=trees)

            searched(request(FEW), workers)
            profile = cProfile.Profile() if arguments.profile else None
            watched, seconds = searched(request(len(drawn)), workers, profile)
            of_each = f"{1e3 * watched.seconds / watched.solves:.0f} ms | {1e3 * seconds / watched.solves:.1f} ms"
            print(f"| {strategy} | {watched.solves} | {of_each} | {seconds / watched.seconds:.1%} |", flush=True)
            if profile is not None:
                pstats.Stats(profile).sort_stats("cumulative").print_stats(60)


def searched(request: Request, workers: Workers, profile: cProfile.Profile | None = None) -> tuple[Watched, float]:
    """Search from nothing, and return the engine and the coordinator's CPU seconds."""
    watched = Watched(workers)
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        if profile is not None:
            profile.enable()
        run(request, Path(folder), BACKENDS, engine=watched, observer=Silent())
        if profile is not None:
            profile.disable()
        return watched, time.process_time() - began


if __name__ == "__main__":
    main()

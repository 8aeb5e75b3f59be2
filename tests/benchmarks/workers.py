"""Gain from a second worker, and cost of the coordinator and of Dask compared with local processes.

    PYTHONPATH=tests python tests/benchmarks/workers.py push --modules 5 [--starts N] [--trials N] [--rounds N]

The same search of an example, with ledger and audits, runs with one worker, with two, and with two Dask workers and
a scheduler, in turn in every round; of all trees, or of those that `moves` proposes. Wall time means little on a
machine with other load, so two more figures are printed: the share of the time in which workers have a job, and the
CPU time of all processes, which gives the speed-up of two dedicated cores over one worker.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil
from dask_cluster import Cluster
from engine_jobs import timed

from topo_search.compose import BACKENDS
from topo_search.engine import DaskWorkers, Engine, Failed, Workers
from topo_search.model.task_file import read_task
from topo_search.study import Request, SilentObserver, run


@dataclass
class Usage:
    """Times of searches, summed over all rounds [s]."""

    jobs: int = 0
    wall: float = 0.0
    occupied: float = 0.0
    """Wall time inside jobs."""
    solving: float = 0.0
    """CPU time inside jobs."""
    coordinator: float = 0.0
    """CPU time of this process."""
    engine: float = 0.0
    """CPU time of all processes of the engine, jobs included."""

    @property
    def all(self) -> float:
        """CPU time of all processes."""
        return self.engine + self.coordinator


class TimedEngine(Engine):
    """An engine that adds up the times of its jobs."""

    def __init__(self, engine: Engine) -> None:
        """Wrap an engine."""
        self.engine, self.usage = engine, Usage()

    def run(self, function: Any, jobs: Iterable[Any], **options: Any) -> Iterator[tuple[Any, Any]]:
        """Run jobs on the engine."""
        for job, outcome in self.engine.run(partial(timed, function), jobs, **options):
            if isinstance(outcome, Failed):
                raise SystemExit(f"a job failed: {outcome.reason}")
            result, occupied, solving = outcome
            self.usage.jobs += 1
            self.usage.occupied += occupied
            self.usage.solving += solving
            yield job, result


def cpu(processes: Iterable[psutil.Process]) -> float:
    """Return the CPU time of processes and their descendants [s]."""
    family = {member for process in processes for member in (process, *process.children(recursive=True))}
    return sum(sum(member.cpu_times()[:2]) for member in family)


def search(request: Request, engine: TimedEngine, processes: Callable[[], list[psutil.Process]]) -> None:
    """Run a new search, and add up its times."""
    with tempfile.TemporaryDirectory() as folder:
        wall, coordinator, others = time.perf_counter(), time.process_time(), cpu(processes())
        run(request, Path(folder), BACKENDS, engine=engine, observer=SilentObserver())
        engine.usage.wall += time.perf_counter() - wall
        engine.usage.coordinator += time.process_time() - coordinator
        engine.usage.engine += cpu(processes()) - others


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="push")
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument(
        "--trials", type=int, help="number of trees that `moves` proposes; default: exhaustive search"
    )
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    task = read_task(arguments.example, (f"modules={arguments.modules}",))
    strategy = "exhaustive" if arguments.trials is None else "optuna"
    request = Request(task, "c2", arguments.starts, 0, strategy, trials=arguments.trials)
    with ExitStack() as stack:
        cluster = stack.enter_context(Cluster(Path(stack.enter_context(tempfile.TemporaryDirectory()))))
        cluster.add_worker("--nworkers", "2")
        dask = [psutil.Process(process.pid) for process in (cluster.scheduler, *cluster.workers)]

        def local() -> list[psutil.Process]:
            return [child for child in psutil.Process().children() if child not in dask]

        engines = (
            ("one worker", Workers(1), local),
            ("two workers", Workers(2), local),
            ("two Dask workers", DaskWorkers(cluster.address), lambda: dask),
        )
        rows = [(name, TimedEngine(stack.enter_context(engine)), processes) for name, engine, processes in engines]
        for number in range(arguments.rounds + 1):
            for _, engine, processes in rows if number % 2 else reversed(rows):
                search(request, engine, processes)
            if number == 0:  # a warm-up round: processes start and load code
                for _, engine, _ in rows:
                    engine.usage = Usage()
    one_worker, two_workers, two_dask = (engine.usage for _, engine, _ in rows)
    print(f"{one_worker.jobs} solves and audits each, load average {os.getloadavg()[1]:.1f}")
    print("CPU as a share of that in jobs")
    print(f"{'':18}{'jobs/s':>10}{'busy':>10}{'CPU/job':>10}{'own CPU':>10}{'others':>10}{'rate':>10}")
    for (name, engine, _), count in zip(rows, (1, 2, 2), strict=True):
        usage = engine.usage
        others = usage.engine / usage.solving - 1.0
        # one worker has a core to itself; two workers share two cores with all other processes
        rate = 1.0 if count == 1 else 2.0 * one_worker.solving / usage.all
        print(
            f"{name:18}{usage.jobs / usage.wall:10.2f}{usage.occupied / (count * usage.wall):10.1%}"
            f"{1e3 * usage.solving / usage.jobs:7.0f} ms{usage.coordinator / usage.solving:10.2%}"
            f"{others:10.2%}{rate:10.2f}"
        )
    print(
        f"all CPU with two Dask workers, as a share of that with two workers: {two_dask.all / two_workers.all:.3f}"
    )


if __name__ == "__main__":
    main()

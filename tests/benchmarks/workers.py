"""What a second worker brings, what the coordinator costs, and what Dask costs beside processes of this machine.

    PYTHONPATH=tests python tests/benchmarks/workers.py push --modules 5 [--starts N] [--trials N] [--rounds N]

The same search of an example, to its ledger and with its audits, by one worker, by two, and by two Dask workers
with a scheduler of their own, in turn, as often as there are rounds; of all trees, or of so many that `moves`
proposes. Wall time means little on a machine that has other work to do, so there are two more views: the share of
the time that workers had a job, and the CPU time that all processes took, from which follows how much faster than
one worker two cores of their own would be.
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
from topo_search.model.files import read_task
from topo_search.study import Request, Silent, run


@dataclass
class Spent:
    """What searches took, all rounds together [s]."""

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


class Watched(Engine):
    """An engine that adds up what its jobs take."""

    def __init__(self, engine: Engine) -> None:
        """Watch an engine."""
        self.engine, self.spent = engine, Spent()

    def run(self, function: Any, jobs: Iterable[Any], **options: Any) -> Iterator[tuple[Any, Any]]:
        """Run jobs on the engine."""
        for job, ended in self.engine.run(partial(timed, function), jobs, **options):
            if isinstance(ended, Failed):
                raise SystemExit(f"a job failed: {ended.reason}")
            result, occupied, solving = ended
            self.spent.jobs += 1
            self.spent.occupied += occupied
            self.spent.solving += solving
            yield job, result


def cpu(processes: Iterable[psutil.Process]) -> float:
    """Return the CPU time that processes and their descendants have taken [s]."""
    family = {member for process in processes for member in (process, *process.children(recursive=True))}
    return sum(sum(member.cpu_times()[:2]) for member in family)


def search(request: Request, watched: Watched, processes: Callable[[], list[psutil.Process]]) -> None:
    """Search from nothing, and add up what it takes."""
    with tempfile.TemporaryDirectory() as folder:
        wall, own, others = time.perf_counter(), time.process_time(), cpu(processes())
        run(request, Path(folder), BACKENDS, engine=watched, observer=Silent())
        watched.spent.wall += time.perf_counter() - wall
        watched.spent.coordinator += time.process_time() - own
        watched.spent.engine += cpu(processes()) - others


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="push")
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--trials", type=int, help="trees that `moves` proposes; else the search is exhaustive")
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
            ("two Dask workers", DaskWorkers(cluster.address, request.versions), lambda: dask),
        )
        rows = [(name, Watched(stack.enter_context(engine)), processes) for name, engine, processes in engines]
        for number in range(arguments.rounds + 1):
            for _, watched, processes in rows if number % 2 else reversed(rows):
                search(request, watched, processes)
            if number == 0:  # processes have started, and have loaded what they need
                for _, watched, _ in rows:
                    watched.spent = Spent()
    one, two, two_dask = (watched.spent for _, watched, _ in rows)
    print(
        f"{one.jobs} solves and audits each, load average {os.getloadavg()[1]:.1f}; CPU in shares of that in jobs"
    )
    print(f"{'':18}{'jobs/s':>10}{'busy':>10}{'CPU/job':>10}{'own CPU':>10}{'others':>10}{'rate':>10}")
    for (name, watched, _), count in zip(rows, (1, 2, 2), strict=True):
        spent = watched.spent
        others = spent.engine / spent.solving - 1.0
        # one worker has a core to itself; two share theirs with the coordinator and all other processes
        rate = 1.0 if count == 1 else 2.0 * one.solving / spent.all
        print(
            f"{name:18}{spent.jobs / spent.wall:10.2f}{spent.occupied / (count * spent.wall):10.1%}"
            f"{1e3 * spent.solving / spent.jobs:7.0f} ms{spent.coordinator / spent.solving:10.2%}"
            f"{others:10.2%}{rate:10.2f}"
        )
    print(f"all CPU with two Dask workers, in shares of that with two workers: {two_dask.all / two.all:.3f}")


if __name__ == "__main__":
    main()

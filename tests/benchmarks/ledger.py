"""Time to resume a run with a ledger of many candidates, by step.

    PYTHONPATH=tests python tests/benchmarks/ledger.py [--modules N] [--symmetry NAME] [--folder DIR]

Fills the ledger of a run with designs of every candidate but the last (10 modules up to half turns: 130,338) and
with records of as many files, then resumes the run in a separate process, up to the first pending job. With
--folder the ledger is kept in that folder, and reused if it exists. All times are CPU times.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from itertools import islice
from pathlib import Path

from toy_problem import BOUND, solve, toy_task

from topo_search.engine import Job
from topo_search.engine.strategy import ExhaustiveSearch
from topo_search.model import Design
from topo_search.model.objective import LEAST_EFFORT
from topo_search.study import Request, RunFolder, SilentObserver
from topo_search.study.directory import digest_of
from topo_search.study.ledger import row_of
from topo_search.study.solving import ProposedJobs

BATCH = 1000


def fill(path: Path, request: Request, n: int) -> None:
    """Write a design for every candidate but the last."""
    context, space = request.contexts(n)[0], request.space(n)
    candidates = islice(space.candidates(), space.count() - 1)
    first = solve(Job(context.task, next(space.candidates()).topology, starts=range(1), seed=0))
    assert isinstance(first, Design)
    with RunFolder.open(path, request) as folder:
        folder.ledger.add_context(context, BOUND, None)
        while batch := list(islice(candidates, BATCH)):
            rows = []
            for candidate in batch:
                update = {"topology": candidate.topology, "topology_key": candidate.key}
                design = first.model_copy(update=update)
                row = row_of(design, candidate.key, n, candidate.orbit, 1, BOUND, LEAST_EFFORT)
                rows.append((row, design))
            folder.ledger.record(context, rows)
            digests = [(f"designs/{row.key}.json", digest_of(row.key.encode())) for row, _ in rows]
            folder._files.record(digests)


def resume(path: Path, request: Request, n: int) -> None:
    """Resume the run and print the time of each step."""
    laps = [("loading the program", time.process_time())]
    space = request.space(n)
    with RunFolder.open(path, request) as folder:
        laps.append(("opening and checking the ledger", time.process_time()))
        jobs = ProposedJobs(ExhaustiveSearch(space, starts=1, timed=False), folder, n, BOUND, SilentObserver())
        if next(jobs) is None:
            raise SystemExit("no job is pending: the ledger holds all candidates")
        laps.append(("reading known results, and enumerating and answering their candidates", time.process_time()))
    previous = 0.0
    for name, end in laps:
        print(f"{name:45}{end - previous:8.2f} s")
        previous = end
    print(f"{f'all, {space.count()} candidates':45}{previous:8.2f} s")


def main() -> None:
    """Fill and resume."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modules", type=int, default=10)
    parser.add_argument("--symmetry", default="c2")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--resume", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    request = Request(toy_task(arguments.modules), arguments.symmetry, starts=1, seed=0)
    if arguments.resume:
        resume(arguments.folder, request, arguments.modules)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary) / "run"
        if not folder.exists():
            fill(folder, request, arguments.modules)
        size = sum(file.stat().st_size for file in folder.iterdir())
        print(f"{size / 1e6:.0f} MB", flush=True)
        command = [sys.executable, *sys.argv, "--folder", str(folder), "--resume"]
        subprocess.run(command, check=True)


if __name__ == "__main__":
    main()

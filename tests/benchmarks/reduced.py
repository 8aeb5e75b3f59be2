"""Cost and results of the present solver against an older revision's, by default one before the reduced search.

    python tests/benchmarks/reduced.py REVISION [--examples EXAMPLE ...] [--modules N] [--trees M] [--starts S]
        [--starts-before S] [--repeat R] [--set FIELD=VALUE ...] [--keep FILE] [--part I/P]

Solves all candidates of a search of the example, or M uniformly drawn ones. The solver of REVISION runs from its
own source, checked out in a temporary folder, in a separate process; it alternates tree by tree with the present
solver, so that both have the same load. Times are CPU times of one thread, without compilation. The best known
effort of a tree is the smaller of the two; the table shows the number of trees within 0.1 % of it, and the mean and
largest excess over it. Trees in FILE are not solved again; several processes may each solve a part of the trees and
share it. The table shows all of its trees.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nlp import default_starts
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates, sample

HERE = Path(__file__).resolve().parents[2]
WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""
OLD_STARTS = 24
"""Default number of starts per tree of the solver before the reduced search."""
SOLVE = """
from nlp.solving import solve
from topo_search.model import Design

def effort(task, topology):
    outcome = solve(task, topology, starts=range(STARTS), seed=0)
    return outcome.objective if isinstance(outcome, Design) else None
"""
SERVE = """
import json, sys, time
from topo_search.model import Topology
from topo_search.model.task_file import read_task

task = read_task(EXAMPLE, SETTINGS).resolve(N)
first = True
for line in sys.stdin:
    topology = Topology.from_key(line.strip())
    if first:  # compile or load code
        effort(task, topology)
        first = False
    started = time.process_time()
    J = effort(task, topology)
    print(json.dumps([J, time.process_time() - started]), flush=True)
"""

Pair = tuple[tuple[float | None, float], tuple[float | None, float]]
"""Least effort of a tree, if it has a design, and CPU time [s], of the older and the present solver."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", help="revision of the older solver")
    parser.add_argument("--examples", nargs="+", default=["push", "push-local", "push-exterior-60"])
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--trees", type=int, help="number of uniformly drawn trees; default: all trees")
    parser.add_argument("--starts", type=int, help="starts per tree of the present solver; default: its own")
    parser.add_argument(
        "--starts-before",
        type=int,
        default=OLD_STARTS,
        help="starts per tree of the revision; default: %(default)s",
    )
    parser.add_argument("--repeat", type=int, default=1, help="number of solves of every tree")
    parser.add_argument("--set", action="append", default=["search.body_clearance=false"], dest="settings")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="JSON lines of solved trees, to resume from")
    parser.add_argument("--part", default="1/1", metavar="I/P", help="solve only every P-th tree, from the I-th on")
    arguments = parser.parse_args()
    n = arguments.modules
    settings = (f"modules={n}", *arguments.settings)
    first, step = (int(part) for part in arguments.part.split("/"))
    if not 1 <= first <= step:
        parser.error(f"--part I/P: 1 <= I <= P must hold, but got {arguments.part}")
    print(f"n = {n}, {' '.join(settings[1:])}")
    columns = "designs | within 0.1 % | mean, largest excess | CPU s"
    print(
        f"| example | trees | {arguments.starts_before} starts before: {columns} | starts now: {columns} | ratio |"
    )
    print("|" + "---|" * 11)
    with source_of(arguments.revision) as old:
        for example in arguments.examples:
            task = read_task(example, settings)
            starts = arguments.starts or default_starts(task)
            resolved = task.resolve(n)
            all_trees = (candidate.topology for candidate in candidates(n, symmetry="task", task=resolved))
            trees = (
                sample(n, arguments.trees, 0, symmetry="task", task=resolved)
                if arguments.trees
                else list(all_trees)
            )
            constants = {"EXAMPLE": example, "SETTINGS": settings, "N": n}
            older, present = {**constants, "STARTS": arguments.starts_before}, {**constants, "STARTS": starts}
            store = Store(arguments.keep, [arguments.revision, _digest(HERE), older, present])
            with _served(older, old) as before, _served(present, HERE) as now:
                for turn in range(arguments.repeat):
                    for tree in trees[first - 1 :: step]:
                        if (tree.key, turn) not in store.pairs:
                            store.add((tree.key, turn), (_request(before, tree.key), _request(now, tree.key)))
            store.read()
            solves = ((tree.key, turn) for turn in range(arguments.repeat) for tree in trees)
            cells = _cells([store.pairs[solve] for solve in solves if solve in store.pairs])
            number = len({key for key, _ in store.pairs})
            print(f"| {example} | {number} | {cells[0]} | {starts}: {cells[1]} | {cells[2]} |", flush=True)


class Store:
    """Results of both solvers, optionally in a file of JSON lines to which several processes may append."""

    def __init__(self, file: Path | None, request: list[object]) -> None:
        """Identify results by a request (sources and constants of both solvers), and read those in the file."""
        self._file, self._request = file, json.loads(json.dumps(request))
        self.pairs: dict[tuple[str, int], Pair] = {}
        """Results of both solvers, by tree and turn."""
        self.read()

    def read(self) -> None:
        """Read the results that the file has by now."""
        for line in self._file.read_text().splitlines() if self._file and self._file.exists() else ():
            request, (key, turn), (before, now) = json.loads(line)
            if request == self._request:
                self.pairs[key, turn] = (tuple(before), tuple(now))

    def add(self, tree: tuple[str, int], pair: Pair) -> None:
        """Store the results for a tree at a turn."""
        self.pairs[tree] = pair
        if self._file:
            with self._file.open("a") as file:
                file.write(json.dumps([self._request, tree, pair]) + "\n")


def _digest(source: Path) -> str:
    """Return a digest of the solver's source."""
    files = sorted((source / "nlp").rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _cells(pairs: list[Pair]) -> tuple[str, str, str]:
    """Return the cells of a row of the table: before, now and the ratio."""
    cells, seconds = [], []
    for side in (0, 1):
        efforts = [pair[side][0] for pair in pairs]
        best = [min((J for J, _ in pair if J is not None), default=None) for pair in pairs]
        both = zip(efforts, best, strict=True)
        excess = [J / least - 1 for J, least in both if J is not None and least is not None]
        seconds.append(sum(pair[side][1] for pair in pairs))
        cells.append(f"{len(excess)} | {within(excess)} | {mean_and_largest(excess)} | {seconds[-1]:.1f}")
    return cells[0], cells[1], f"{seconds[0] / seconds[1]:.2f}"


def within(excess: list[float]) -> int:
    """Return the number of trees that are within WITHIN of the best known effort."""
    return sum(value <= WITHIN for value in excess)


def mean_and_largest(excess: list[float]) -> str:
    """Return the mean and the largest relative excess over best known efforts."""
    return f"{sum(excess) / len(excess):.3%}, {max(excess):.3%}" if excess else "none"


@contextmanager
def source_of(revision: str) -> Iterator[Path]:
    """Yield a folder with the packages of a revision."""
    archive = subprocess.run(
        ["git", "archive", revision, "nlp", "topo_search", "verify"], cwd=HERE, check=True, capture_output=True
    )
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as packed:
            packed.extractall(folder, filter="data")
        yield Path(folder)


@contextmanager
def _served(constants: dict[str, object], source: Path) -> Iterator[subprocess.Popen[str]]:
    """Yield a process that answers the key of a tree with its least effort and CPU time."""
    definitions = "\n".join(f"{name} = {value!r}" for name, value in constants.items())
    environment = {**os.environ, "PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-c", f"{definitions}\n{SOLVE}\n{SERVE}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=source,
    )
    with process:
        yield process
        assert process.stdin is not None
        process.stdin.close()


def _request(process: subprocess.Popen[str], key: str) -> tuple[float | None, float]:
    """Return the least effort of a tree, if it has a design, and the CPU time [s]."""
    assert process.stdin is not None
    assert process.stdout is not None
    print(key, file=process.stdin, flush=True)
    answer = process.stdout.readline()
    if not answer:
        raise SystemExit("a solver has failed; the reason is above")
    J, seconds = json.loads(answer)
    return J, seconds


if __name__ == "__main__":
    main()

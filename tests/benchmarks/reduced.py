"""What a solve costs and finds beside that of an older revision: by default, one before the reduced search.

    python tests/benchmarks/reduced.py REVISION [--examples EXAMPLE ...] [--modules N] [--trees M] [--starts S]
        [--starts-before S] [--repeat R] [--set FIELD=VALUE ...] [--keep FILE] [--part I/P]

All candidates of a search of the example, or M uniformly drawn ones. The solver of REVISION runs from its own
source, checked out in a temporary folder, in a process of its own beside another one with the present solver: one
after the other, tree by tree, so that both meet the same load. CPU seconds of one thread; code is compiled before.
The best known effort of a tree is the less of the two; shown are the numbers of trees within 0.1 % of it, and how
far the efforts found are over it in the mean and at most. What a file keeps is not solved again; parts of the trees
may be solved side by side and share it. The table is of all that it has by then.
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
from topo_search.model.files import read_task
from topo_search.topologies import candidates, sample

HERE = Path(__file__).resolve().parents[2]
WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""
OLD_STARTS = 24
"""Starts of Ipopt a tree, as the solver before the reduced search made them by default."""
SOLVE = """
from nlp.solve import solve
from topo_search.model import Design

def effort(task, topology):
    found = solve(task, topology, starts=range(STARTS), seed=0)
    return found.objective if isinstance(found, Design) else None
"""
SERVE = """
import json, sys, time
from topo_search.model import Topology
from topo_search.model.files import read_task

task = read_task(EXAMPLE, SETTINGS).resolve(N)
first = True
for line in sys.stdin:
    topology = Topology.from_key(line.strip())
    if first:  # compiled code is loaded, or made
        effort(task, topology)
        first = False
    began = time.process_time()
    J = effort(task, topology)
    print(json.dumps([J, time.process_time() - began]), flush=True)
"""

Pair = tuple[tuple[float | None, float], tuple[float | None, float]]
"""Least effort of a tree, if there is a design, and CPU seconds: before and now."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", help="of the older solver")
    parser.add_argument("--examples", nargs="+", default=["push", "push-local", "push-exterior-60"])
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--trees", type=int, help="uniformly drawn ones; default: all")
    parser.add_argument("--starts", type=int, help="present starts per tree; default: those of the solver")
    parser.add_argument(
        "--starts-before", type=int, default=OLD_STARTS, help="of the revision; default: %(default)s"
    )
    parser.add_argument("--repeat", type=int, default=1, help="solve every tree so many times")
    parser.add_argument("--set", action="append", default=["search.body_clearance=false"], dest="settings")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="JSON lines of what was solved, to go on from")
    parser.add_argument("--part", default="1/1", metavar="I/P", help="solve but every P-th tree, from the I-th on")
    arguments = parser.parse_args()
    n = arguments.modules
    settings = (f"modules={n}", *arguments.settings)
    first, step = (int(part) for part in arguments.part.split("/"))
    if not 1 <= first <= step:
        parser.error(f"--part I/P: 1 <= I <= P must hold, but got {arguments.part}")
    print(f"n = {n}, {' '.join(settings[1:])}")
    of_each = "designs | within 0.1 % | mean, most over best known | CPU s"
    print(
        f"| example | trees | {arguments.starts_before} starts before: {of_each} | starts now: {of_each} | ratio |"
    )
    print("|" + "---|" * 11)
    with source_of(arguments.revision) as old:
        for example in arguments.examples:
            task = read_task(example, settings)
            starts = arguments.starts or default_starts(task)
            resolved = task.resolve(n)
            every = (one.topology for one in candidates(n, symmetry="task", task=resolved))
            trees = (
                sample(n, arguments.trees, 0, symmetry="task", task=resolved) if arguments.trees else list(every)
            )
            known = {"EXAMPLE": example, "SETTINGS": settings, "N": n}
            was, present = {**known, "STARTS": arguments.starts_before}, {**known, "STARTS": starts}
            kept = Kept(arguments.keep, [arguments.revision, _digest(HERE), was, present])
            with _served(was, old) as before, _served(present, HERE) as now:
                for turn in range(arguments.repeat):
                    for tree in trees[first - 1 :: step]:
                        if (tree.key, turn) not in kept.pairs:
                            kept.add((tree.key, turn), (_asked(before, tree.key), _asked(now, tree.key)))
            kept.read()
            solves = ((tree.key, turn) for turn in range(arguments.repeat) for tree in trees)
            cells = _cells([kept.pairs[one] for one in solves if one in kept.pairs])
            number = len({key for key, _ in kept.pairs})
            print(f"| {example} | {number} | {cells[0]} | {starts}: {cells[1]} | {cells[2]} |", flush=True)


class Kept:
    """What both solvers said of trees, also in a file of JSON lines that several processes may add to."""

    def __init__(self, file: Path | None, request: list[object]) -> None:
        """Take a request, both sources and what is known to both solvers, and read what the file has of it."""
        self._file, self._request = file, json.loads(json.dumps(request))
        self.pairs: dict[tuple[str, int], Pair] = {}
        """Efforts and CPU seconds of both, by tree and turn."""
        self.read()

    def read(self) -> None:
        """Take what the file, if any, has by now."""
        for line in self._file.read_text().splitlines() if self._file and self._file.exists() else ():
            request, (key, turn), (before, now) = json.loads(line)
            if request == self._request:
                self.pairs[key, turn] = (tuple(before), tuple(now))

    def add(self, tree: tuple[str, int], pair: Pair) -> None:
        """Keep what both said of a tree at a turn."""
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
        over = [J / least - 1 for J, least in both if J is not None and least is not None]
        seconds.append(sum(pair[side][1] for pair in pairs))
        cells.append(f"{len(over)} | {within(over)} | {mean_and_most(over)} | {seconds[-1]:.1f}")
    return cells[0], cells[1], f"{seconds[0] / seconds[1]:.2f}"


def within(over: list[float]) -> int:
    """Return how many relative distances from best known efforts are next to none."""
    return sum(share <= WITHIN for share in over)


def mean_and_most(over: list[float]) -> str:
    """Return the mean and the largest of relative distances from best known efforts."""
    return f"{sum(over) / len(over):.3%}, {max(over):.3%}" if over else "none"


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
def _served(known: dict[str, object], source: Path) -> Iterator[subprocess.Popen[str]]:
    """Yield a process that answers a tree's key with its least effort and what that took."""
    given = "\n".join(f"{name} = {value!r}" for name, value in known.items())
    environment = {**os.environ, "PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-c", f"{given}\n{SOLVE}\n{SERVE}"],
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


def _asked(process: subprocess.Popen[str], key: str) -> tuple[float | None, float]:
    """Return the least effort of a tree, if there is a design, and CPU seconds."""
    assert process.stdin is not None
    assert process.stdout is not None
    print(key, file=process.stdin, flush=True)
    answer = process.stdout.readline()
    if not answer:
        raise SystemExit("a solver ended early; its reason is above")
    J, seconds = json.loads(answer)
    return J, seconds


if __name__ == "__main__":
    main()

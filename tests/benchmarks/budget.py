"""Equal starts for every tree against successive halving: cost, and probability of finding the best tree.

    python tests/benchmarks/budget.py push --modules 6 [--starts N] [--searches N] [--solved FILE]

Every tree is solved from N starts. Searches are then simulated: each start of a simulated search is drawn from
those N results. With successive halving the best third of the designs, at least ten, is promoted from one rung of
starts to the next, and so is every tree without a design; a promoted tree is built again, as in a worker.

Printed for each schedule of starts, as means over the simulated searches: starts and CPU time relative to 24 starts
per tree; the probability of finding the best, and all of the ten best, to 1e-4; the share of the ten best that are
found; the share of the feasible trees that get a design. --solved stores the solves in a file, and reads them from
it.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random

import nlp
from nlp.evaluation import correct, violations, worst
from nlp.program import AssembledProgram
from nlp.starts.random_starts import draw, generator
from topo_search.engine import Candidates
from topo_search.model import ResolvedTask, Topology
from topo_search.model.task_file import read_task

SCHEDULES = ((24,), (12,), (16,), (32,), (48,), (72,), (3, 9, 24), (8, 24), (12, 24), (16, 24), (24, 72))
"""Numbers of starts at each rung."""
FACTOR, MIN_PROMOTED = 3, 10
"""One design in FACTOR is promoted to the next rung, and at least MIN_PROMOTED."""
SAME = 1.0 + 1.0e-4
TOP = 10


@dataclass(frozen=True)
class Solved:
    """All starts of one tree."""

    key: str
    build: float
    """CPU time of building the program [s]."""
    seconds: list[float]
    """CPU time of every start [s]; empty for a tree that is proven impossible."""
    efforts: list[float | None]
    """J of every start; None without a design."""


def solve(task: ResolvedTask, topology: Topology, starts: int) -> Solved:
    """Solve a tree from all starts."""
    if nlp.prove_impossible(task, topology):
        return Solved(topology.key, 0.0, [], [])
    started = time.process_time()
    program = AssembledProgram(task, topology)
    build = time.process_time() - started
    seconds, efforts = [], []
    for index in range(starts):
        started = time.process_time()
        result = program.solve(draw(task, topology, generator(task, topology, index, 0)))
        point = correct(result.point)
        met = worst(violations(point)).met
        seconds.append(time.process_time() - started)
        weighted = zip(task.load_cases, point.u, strict=True)
        efforts.append(sum(case.weight * float((u**2).sum()) for case, u in weighted) if met else None)
    return Solved(topology.key, build, seconds, efforts)


def all_solved(task: ResolvedTask, starts: int, store: Path | None) -> Iterator[Solved]:
    """Yield all trees, each from the file if that has it."""
    stored = {}
    if store is not None and store.exists():
        stored = {(row := json.loads(line))["key"]: Solved(**row) for line in store.read_text().splitlines()}
    for candidate in Candidates(task, "task").candidates():
        tree = stored.get(candidate.key)
        if tree is None:
            tree = solve(task, candidate.topology, starts)
            if store is not None:
                with store.open("a") as stream:
                    print(json.dumps(asdict(tree)), file=stream)
        yield tree


@dataclass(frozen=True)
class SimulatedSearch:
    """Cost and result of one simulated search."""

    starts: int
    seconds: float
    best: dict[str, float]
    """Least J of every tree with a design."""


def search(trees: dict[str, Solved], rungs: tuple[int, ...], random: Random) -> SimulatedSearch:
    """Simulate one search."""
    drawn = {key: random.choices(tree.efforts, k=rungs[-1]) for key, tree in trees.items()}
    starts = dict.fromkeys(trees, 0)
    best: dict[str, float] = {}
    active = set(trees)
    seconds = 0.0
    for rung in rungs:
        for key in active:
            tree = trees[key]
            seconds += tree.build + (rung - starts[key]) * sum(tree.seconds) / len(tree.seconds)
            starts[key] = rung
            if efforts := [J for J in drawn[key][:rung] if J is not None]:
                best[key] = min(efforts)
        designs = sorted(active & best.keys(), key=lambda key: best[key])
        active = (active - best.keys()) | set(designs[: max(MIN_PROMOTED, math.ceil(len(designs) / FACTOR))])
    return SimulatedSearch(sum(starts.values()), seconds, best)


def main() -> None:
    """Solve, simulate searches and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example")
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--searches", type=int, default=1000)
    parser.add_argument("--solved", type=Path)
    arguments = parser.parse_args()
    task = read_task(arguments.example, (f"modules={arguments.modules}",)).resolve(arguments.modules)
    trees = {tree.key: tree for tree in all_solved(task, arguments.starts, arguments.solved) if tree.seconds}
    least = {key: min(efforts) for key, tree in trees.items() if (efforts := [J for J in tree.efforts if J])}
    top = sorted(least, key=lambda key: least[key])[:TOP]
    print(f"{len(trees)} trees that are not proven impossible, {len(least)} feasible")
    print(f"{'rungs':>10}{'starts':>8}{'time':>8}{'best':>8}{'all ten':>9}{'of ten':>8}{'feasible':>10}")
    reference = None
    for rungs in SCHEDULES:
        random = Random(0)
        searches = [search(trees, rungs, random) for _ in range(arguments.searches)]
        hits = [[run.best.get(key, math.inf) <= SAME * least[key] for key in top] for run in searches]
        starts, seconds = sum(run.starts for run in searches), sum(run.seconds for run in searches)
        reference = reference or (starts, seconds)
        sums = (
            sum(row[0] for row in hits),
            sum(map(all, hits)),
            sum(map(sum, hits)) / len(top),
            sum(len(run.best) for run in searches) / len(least),
        )
        best, ten, share, feasible = (value / len(searches) for value in sums)
        print(
            f"{', '.join(map(str, rungs)):>10}{starts / reference[0]:>8.2f}{seconds / reference[1]:>8.2f}"
            f"{best:>8.2f}{ten:>9.2f}{share:>8.3f}{feasible:>10.3f}"
        )


if __name__ == "__main__":
    main()

"""Equal starts for every tree against successive halving: what each costs, and how surely it finds the best.

    python tests/benchmarks/budget.py push --modules 6 [--starts N] [--searches N] [--solved FILE]

Every tree is solved from N starts. What they found is then taken for all there is to find, and searches are
followed on paper, each of whose starts is drawn from those of its tree. With successive halving the best third of
the designs, ten at least, goes on from one rung of starts to the next, and so does every tree without a design; a
tree that goes on is built again, as in a worker.

Printed for each way of spending starts, as means over the searches: starts and CPU seconds of one thread, beside
those of 24 starts per tree; how often the best and all of the ten best are found to 1e-4; the share of the ten that
are; the share of the feasible trees that get a design. With --solved the solves are kept in a file, or taken from
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
from nlp.assembled import AssembledProgram
from nlp.evaluation import correct, violations, worst
from nlp.starts.random_starts import draw, generator
from topo_search.engine import Candidates
from topo_search.model import ResolvedTask, Topology
from topo_search.model.files import read_task

WAYS = ((24,), (12,), (16,), (32,), (48,), (72,), (3, 9, 24), (8, 24), (12, 24), (16, 24), (24, 72))
"""Rungs of starts."""
FACTOR, LEAST = 3, 10
"""Of the designs one in so many goes on to the next rung, and so many at least."""
SAME = 1.0 + 1.0e-4
TOP = 10


@dataclass(frozen=True)
class Solved:
    """All starts of one tree."""

    key: str
    build: float
    """CPU seconds to make the program ready."""
    seconds: list[float]
    """CPU seconds of every start; none for a tree that is proven impossible."""
    efforts: list[float | None]
    """J of every start; None where it reached no design."""


def solve(task: ResolvedTask, topology: Topology, starts: int) -> Solved:
    """Solve a tree from all starts."""
    if nlp.prove_impossible(task, topology):
        return Solved(topology.key, 0.0, [], [])
    began = time.process_time()
    ready = AssembledProgram(task, topology)
    build = time.process_time() - began
    seconds, efforts = [], []
    for index in range(starts):
        began = time.process_time()
        result = ready.solve(draw(task, topology, generator(task, topology, index, 0)))
        point = correct(result.point)
        met = worst(violations(point)).met
        seconds.append(time.process_time() - began)
        weighted = zip(task.load_cases, point.u, strict=True)
        efforts.append(sum(case.weight * float((u**2).sum()) for case, u in weighted) if met else None)
    return Solved(topology.key, build, seconds, efforts)


def all_solved(task: ResolvedTask, starts: int, kept: Path | None) -> Iterator[Solved]:
    """Yield all trees, from the file where it has them."""
    known = {}
    if kept is not None and kept.exists():
        known = {(row := json.loads(line))["key"]: Solved(**row) for line in kept.read_text().splitlines()}
    for candidate in Candidates(task, "task").candidates():
        found = known.get(candidate.key)
        if found is None:
            found = solve(task, candidate.topology, starts)
            if kept is not None:
                with kept.open("a") as stream:
                    print(json.dumps(asdict(found)), file=stream)
        yield found


@dataclass(frozen=True)
class Found:
    """What one search spent and found."""

    starts: int
    seconds: float
    best: dict[str, float]
    """Least J of every tree with a design."""


def search(trees: dict[str, Solved], rungs: tuple[int, ...], random: Random) -> Found:
    """Follow one search on paper."""
    drawn = {key: random.choices(tree.efforts, k=rungs[-1]) for key, tree in trees.items()}
    reached = dict.fromkeys(trees, 0)
    best: dict[str, float] = {}
    going = set(trees)
    seconds = 0.0
    for rung in rungs:
        for key in going:
            tree = trees[key]
            seconds += tree.build + (rung - reached[key]) * sum(tree.seconds) / len(tree.seconds)
            reached[key] = rung
            if found := [J for J in drawn[key][:rung] if J is not None]:
                best[key] = min(found)
        designs = sorted(going & best.keys(), key=lambda key: best[key])
        going = (going - best.keys()) | set(designs[: max(LEAST, math.ceil(len(designs) / FACTOR))])
    return Found(sum(reached.values()), seconds, best)


def main() -> None:
    """Solve, search on paper and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example")
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--searches", type=int, default=1000)
    parser.add_argument("--solved", type=Path)
    arguments = parser.parse_args()
    task = read_task(arguments.example, (f"modules={arguments.modules}",)).resolve(arguments.modules)
    trees = {tree.key: tree for tree in all_solved(task, arguments.starts, arguments.solved) if tree.seconds}
    least = {key: min(found) for key, tree in trees.items() if (found := [J for J in tree.efforts if J])}
    top = sorted(least, key=lambda key: least[key])[:TOP]
    print(f"{len(trees)} trees that are not proven impossible, {len(least)} feasible")
    print(f"{'rungs':>10}{'starts':>8}{'time':>8}{'best':>8}{'all ten':>9}{'of ten':>8}{'feasible':>10}")
    whole = None
    for rungs in WAYS:
        random = Random(0)
        found = [search(trees, rungs, random) for _ in range(arguments.searches)]
        hits = [[one.best.get(key, math.inf) <= SAME * least[key] for key in top] for one in found]
        spent, seconds = sum(one.starts for one in found), sum(one.seconds for one in found)
        whole = whole or (spent, seconds)
        sums = (
            sum(row[0] for row in hits),
            sum(map(all, hits)),
            sum(map(sum, hits)) / len(top),
            sum(len(one.best) for one in found) / len(least),
        )
        best, ten, share, feasible = (value / len(found) for value in sums)
        print(
            f"{', '.join(map(str, rungs)):>10}{spent / whole[0]:>8.2f}{seconds / whole[1]:>8.2f}"
            f"{best:>8.2f}{ten:>9.2f}{share:>8.3f}{feasible:>10.3f}"
        )


if __name__ == "__main__":
    main()

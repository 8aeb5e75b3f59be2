"""What a search of all trees of a size would take, by a uniform sample; and whether the reduced search leads there.

    OMP_NUM_THREADS=1 python tests/benchmarks/sampled.py push --modules 10 [--trees M] [--both] [--set FIELD=VALUE]

Each tree is solved from the starts of a run. With `--both` it is solved with the reduced search and from untangled
starts as well, whatever size is the largest for which a run takes the one, one after the other; a tree counts as
done within 0.1 % of the less of both efforts. CPU seconds of one thread; the first tree is solved twice, for code
is compiled or loaded the first time.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
from typing import NamedTuple

import nlp
import nlp.reduced
from nlp.solve import REDUCED_STARTS, UNTANGLED_STARTS
from topo_search.engine import Candidates
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.files import read_task

WITHIN = 1e-3
"""A tree is done within this relative distance of the least effort."""


class Way(NamedTuple):
    """A way to solve."""

    name: str
    reduced_up_to: int
    starts: int


class Solved(NamedTuple):
    """What a solve led to."""

    effort: float
    """Infinite without a design [rad^4/s^4]."""
    seconds: float


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="push")
    parser.add_argument("--modules", type=int, default=10)
    parser.add_argument("--trees", type=int, default=300)
    parser.add_argument("--both", action="store_true")
    parser.add_argument("--set", action="append", default=["search.body_clearance=false"], dest="settings")
    arguments = parser.parse_args()
    n, settings = arguments.modules, (f"modules={arguments.modules}", *arguments.settings)
    task = read_task(arguments.example, settings)
    space = Candidates(task.resolve(n), "task")
    ways = [Way("as a run does", nlp.reduced.REDUCED_UP_TO, nlp.default_starts(task))]
    if arguments.both:
        ways = [Way("reduced", n, max(REDUCED_STARTS.values())), Way("untangled", 0, UNTANGLED_STARTS)]
    found: dict[Way, list[Solved]] = {way: [] for way in ways}
    for number, tree in enumerate(space.sample(arguments.trees, 0)):
        for way in ways:
            if number == 0:
                solved(space.task, tree, way)
            found[way].append(solved(space.task, tree, way))
        told = (f"{way.name} {every[-1].effort:.5g} in {every[-1].seconds:.2f} s" for way, every in found.items())
        print(f"{tree.key}: {', '.join(told)}", file=sys.stderr, flush=True)
    what = f"{task.name}, n = {n}, {' '.join(arguments.settings)}"
    print(f"{what}: {arguments.trees} of {space.count():,} candidates")
    print("| way | starts | designs | within 0.1 % | CPU s a tree | all candidates, CPU h |")
    print("|---|---|---|---|---|---|")
    best = [min(each, key=lambda one: one.effort).effort for each in zip(*found.values(), strict=True)]
    for way, every in found.items():
        seconds = [one.seconds for one in every]
        error = statistics.stdev(seconds) / math.sqrt(len(seconds)) if len(seconds) > 1 else math.nan
        hours = space.count() / 3600
        designs = sum(math.isfinite(one.effort) for one in every)
        done = sum(
            math.isfinite(one.effort) and one.effort <= least * (1 + WITHIN)
            for one, least in zip(every, best, strict=True)
        )
        mean = statistics.mean(seconds)
        cost = f"{mean:.2f} +- {error:.2f} | {hours * mean:.1f} +- {hours * error:.1f}"
        print(f"| {way.name} | {way.starts} | {designs} | {done} | {cost} |")


def solved(task: ResolvedTask, tree: Topology, way: Way) -> Solved:
    """Solve a tree in one way."""
    nlp.reduced.REDUCED_UP_TO = way.reduced_up_to
    began = time.process_time()
    outcome = nlp.solve(task, tree, starts=range(way.starts), seed=0)
    seconds = time.process_time() - began
    return Solved(outcome.objective if isinstance(outcome, Design) else math.inf, seconds)


if __name__ == "__main__":
    main()

"""Cost of a search of all trees of a size, estimated from a uniform sample, and success of the reduced search.

    OMP_NUM_THREADS=1 python tests/benchmarks/sampled.py push --modules 10 [--trees M] [--both] [--set FIELD=VALUE]

Each tree is solved from the starts of a run. With `--both` it is solved with the reduced search and from untangled
starts, whatever the largest size for which a run uses the former; a tree counts as done within 0.1 % of the smaller
of both efforts. Times are CPU times of one thread; the first tree is solved twice, since the first solve compiles
or loads code.
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
from nlp.solving import REDUCED_STARTS, UNTANGLED_STARTS
from topo_search.engine import Candidates
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.task_file import read_task

WITHIN = 1e-3
"""A tree is done within this relative distance of the least effort."""


class Method(NamedTuple):
    """A solution method."""

    name: str
    reduced_up_to: int
    starts: int


class Solved(NamedTuple):
    """Result of a solve."""

    effort: float
    """J [rad^4/s^4]; infinite without a design."""
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
    methods = [Method("as in a run", nlp.reduced.REDUCED_UP_TO, nlp.default_starts(task))]
    if arguments.both:
        methods = [Method("reduced", n, max(REDUCED_STARTS.values())), Method("untangled", 0, UNTANGLED_STARTS)]
    results_by_method: dict[Method, list[Solved]] = {method: [] for method in methods}
    for number, tree in enumerate(space.sample(arguments.trees, 0)):
        for method in methods:
            if number == 0:
                solve(space.task, tree, method)
            results_by_method[method].append(solve(space.task, tree, method))
        progress = (
            f"{method.name} {results[-1].effort:.5g} in {results[-1].seconds:.2f} s"
            for method, results in results_by_method.items()
        )
        print(f"{tree.key}: {', '.join(progress)}", file=sys.stderr, flush=True)
    title = f"{task.name}, n = {n}, {' '.join(arguments.settings)}"
    print(f"{title}: {arguments.trees} of {space.count():,} candidates")
    print("| method | starts | designs | within 0.1 % | CPU s a tree | all candidates, CPU h |")
    print("|---|---|---|---|---|---|")
    best = [min(result.effort for result in results) for results in zip(*results_by_method.values(), strict=True)]
    for method, results in results_by_method.items():
        seconds = [result.seconds for result in results]
        error = statistics.stdev(seconds) / math.sqrt(len(seconds)) if len(seconds) > 1 else math.nan
        hours = space.count() / 3600
        designs = sum(math.isfinite(result.effort) for result in results)
        done = sum(
            math.isfinite(result.effort) and result.effort <= least * (1 + WITHIN)
            for result, least in zip(results, best, strict=True)
        )
        mean = statistics.mean(seconds)
        cost = f"{mean:.2f} +- {error:.2f} | {hours * mean:.1f} +- {hours * error:.1f}"
        print(f"| {method.name} | {method.starts} | {designs} | {done} | {cost} |")


def solve(task: ResolvedTask, tree: Topology, method: Method) -> Solved:
    """Solve a tree with one method."""
    nlp.reduced.REDUCED_UP_TO = method.reduced_up_to
    started = time.process_time()
    outcome = nlp.solve(task, tree, starts=range(method.starts), seed=0)
    seconds = time.process_time() - started
    return Solved(outcome.objective if isinstance(outcome, Design) else math.inf, seconds)


if __name__ == "__main__":
    main()

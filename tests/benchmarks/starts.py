"""Share of feasible solves from splayed and from uniformly random starts, in one run.

    python tests/benchmarks/starts.py [EXAMPLE] [--starts N]

Every tree of the example up to a half turn is solved by the same program from the same number of starts of each
kind.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from direct import random_start

from nlp.bounds import lower_bound
from nlp.evaluation import correct, violations, worst
from nlp.numbers.point import Point
from nlp.program import AssembledProgram
from nlp.starts.random_starts import draw, generator
from topo_search.model import ResolvedTask, Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates

Draw = Callable[[ResolvedTask, Topology, np.random.Generator], Point]


@dataclass
class Tally:
    """Results of one kind of start."""

    feasible: int = 0
    solves: int = 0
    iterations: int = 0
    seconds: float = 0.0
    best: dict[str, float] = field(default_factory=dict)
    """Least effort of every tree with a design."""

    def add(self, program: AssembledProgram, task: ResolvedTask, start: Point, key: str) -> None:
        """Solve from a start and count the result."""
        started = time.perf_counter()
        result = program.solve(start)
        self.seconds += time.perf_counter() - started
        self.solves += 1
        self.iterations += result.iterations
        point = correct(result.point)
        if worst(violations(point)).met:
            self.feasible += 1
            weights = np.array([case.weight for case in task.load_cases])
            J = float(weights @ np.sum(point.u**2, axis=(1, 2)))
            self.best[key] = min(J, self.best.get(key, np.inf))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="push")
    parser.add_argument("--starts", type=int, default=8, help="starts of each kind and tree")
    arguments = parser.parse_args()
    example = read_task(arguments.example)
    task = example.resolve(example.n)
    kinds: dict[str, Draw] = {"uniform": random_start, "splayed": draw}
    tallies = {name: Tally() for name in kinds}
    for candidate in candidates(task.n, symmetry="c2", connectors="aligned", root="free"):
        program = AssembledProgram(task, candidate.topology)
        for start in range(arguments.starts):
            for name, kind in kinds.items():
                point = kind(task, candidate.topology, generator(task, candidate.topology, start, 0))
                tallies[name].add(program, task, point, candidate.topology.key)
    print(f"{arguments.example}, n = {task.n}, {arguments.starts} starts per tree")
    header = f"{'starts':10}{'feasible solves':>16}{'feasible trees':>16}{'best J / bound':>16}"
    print(f"{header}{'iterations a solve':>20}{'s a solve':>12}")
    bound = lower_bound(task)
    for name, tally in tallies.items():
        share, trees = tally.feasible / tally.solves, len(tally.best)
        best = f"{min(tally.best.values()) / bound:.4f}" if tally.best else "none"
        iterations, seconds = tally.iterations / tally.solves, tally.seconds / tally.solves
        print(f"{name:10}{share:>16.1%}{trees:>16}{best:>16}{iterations:>20.0f}{seconds:>12.3f}")


if __name__ == "__main__":
    main()

"""A warm start from a tree that differs by one move, against random starts.

    python tests/benchmarks/warm_starts.py [EXAMPLE] [--modules N] [--parents M] [--starts S] [--set FIELD=VALUE]...

Parents are uniformly drawn trees with a design, the best of a few starts. Each gives one tree by moving a leaf and
one by moving a subtree, rerooted and renumbered as in the search. Every tree is solved from the parent's design,
and from random starts. Times are CPU times of starts and solves, without building the program.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count, islice
from random import Random

import numpy as np

import nlp
from nlp.evaluation import correct, violations, worst
from nlp.numbers.point import Point
from nlp.program import AssembledProgram
from nlp.starts.random_starts import draw, generator
from nlp.starts.warm_start import warm_start
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import candidate_of, sample

WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""
PARENT_STARTS = 4
"""Starts of a parent."""
ROOT = (-1, -1, -1)


@dataclass(frozen=True)
class Result:
    """Result of a solve."""

    J: float
    """Effort [rad^4/s^4]; infinite without a design."""
    seconds: float


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="push")
    parser.add_argument("--modules", type=int, default=6)
    parser.add_argument("--parents", type=int, default=20, help="parents with a design")
    parser.add_argument("--starts", type=int, default=24, help="random starts of each tree")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings")
    arguments = parser.parse_args()
    n = arguments.modules
    task = read_task(arguments.example, (f"modules={n}", *arguments.settings)).resolve(n)
    moves: dict[str, list[tuple[Result, list[Result]]]] = {"leaf": [], "subtree": []}
    for parent in parents(task, arguments.parents):
        for name, trees in moves.items():
            topology = move(parent.topology, Random(f"{name} {parent.topology_key}"), leaf=name == "leaf")
            trees.append(measure(task, topology, parent, arguments.starts))
    print(f"{arguments.example}, n = {n}, {' '.join(arguments.settings)}")
    print("| move | trees, feasible | start | solved | within 0.1 % of best | J / best, mean | CPU s a tree |")
    print("|---|---|---|---|---|---|---|")
    for name, trees in moves.items():
        for line in lines(trees, sorted({1, min(4, arguments.starts), arguments.starts})):
            print(f"| {name} {line}")


def parents(task: ResolvedTask, number: int) -> Iterator[Design]:
    """Yield designs of uniformly drawn topologies."""
    drawn, designs = 0, 0
    while designs < number:
        drawn += 1
        topology = sample(task.n, drawn, 0)[-1]
        outcome = nlp.solve(task, topology, starts=range(PARENT_STARTS), seed=1)
        if isinstance(outcome, Design):
            designs += 1
            yield outcome


def move(topology: Topology, random: Random, *, leaf: bool) -> Topology:
    """Cut off a leaf, or a subtree of at least two modules, and attach it elsewhere to get another tree."""
    below: list[set[int]] = [{i} for i in range(topology.n)]
    for i in range(topology.n - 1, 0, -1):
        below[topology.parents[i]] |= below[i]
    cuts = [i for i in range(1, topology.n) if (len(below[i]) == 1) == leaf]
    original_key = candidate_of(topology).key
    while True:
        cut = random.choice(cuts)
        connectors = [connector for connector in topology.free_connectors if connector[0] not in below[cut]]
        h, a = random.choice(connectors)
        order = [i for i in range(topology.n) if i not in below[cut]] + sorted(below[cut])
        number = {i: k for k, i in enumerate(order)}
        joints = [ROOT]
        turn = (a + 2 - topology.joints[cut][2]) % 4  # turn of the whole subtree that aligns its joint
        for i in order[1:]:
            parent, port, child_port = topology.joints[i]
            if i == cut:
                joints.append((number[h], a, (child_port + turn) % 4))
            elif i in below[cut]:
                joints.append((number[parent], (port + turn) % 4, (child_port + turn) % 4))
            else:
                joints.append((number[parent], port, child_port))
        candidate = candidate_of(Topology(tuple(joints)))
        if candidate.key != original_key:
            return candidate.topology


def measure(task: ResolvedTask, topology: Topology, parent: Design, starts: int) -> tuple[Result, list[Result]]:
    """Solve from the parent's design and from every random start."""
    program = AssembledProgram(task, topology)
    rngs = (generator(task, topology, start, 0) for start in count(-1))
    warm = partial(warm_start, task, topology, parent, next(rngs))
    cold = (partial(draw, task, topology, rng) for rng in islice(rngs, starts))
    return solve_from(program, warm), [solve_from(program, start) for start in cold]


def solve_from(program: AssembledProgram, start: Callable[[], Point]) -> Result:
    """Solve from a start."""
    started = time.process_time()
    point = correct(program.solve(start()).point)
    met = worst(violations(point)).met
    weights = np.array([case.weight for case in point.task.load_cases])
    J = float(weights @ np.einsum("kiq,kiq->k", point.u, point.u)) if met else np.inf
    return Result(J, time.process_time() - started)


def lines(trees: list[tuple[Result, list[Result]]], counts: list[int]) -> Iterator[str]:
    """Yield one line for the warm start and one for every number of random starts."""
    best = np.array([min(warm.J, *(cold.J for cold in colds)) for warm, colds in trees])
    feasible = np.isfinite(best)
    kinds = {"warm start": [[warm] for warm, _ in trees]}
    kinds |= {f"best of {count}": [colds[:count] for _, colds in trees] for count in counts}
    kinds |= {
        f"warm start, or best of {count}": [[warm, *colds[:count]] for warm, colds in trees] for count in counts
    }
    for name, groups in kinds.items():
        J = np.array([min(result.J for result in group) for group in groups])[feasible]
        seconds = np.mean([sum(result.seconds for result in group) for group in groups])
        ratio = J / best[feasible]
        solved = np.isfinite(ratio)
        cells = [f"{solved.mean():.0%}", f"{(ratio <= 1 + WITHIN).mean():.0%}", f"{ratio[solved].mean():.4f}"]
        yield f"| {len(trees)}, {feasible.sum()} | {name} | {' | '.join(cells)} | {seconds:.3f} |"


if __name__ == "__main__":
    main()

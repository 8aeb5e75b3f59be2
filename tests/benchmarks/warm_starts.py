"""What a warm start from a tree one move apart is worth against random starts.

    python tests/benchmarks/warm_starts.py [EXAMPLE] [--modules N] [--parents M] [--starts S] [--set FIELD=VALUE]...

Uniformly drawn parents with a design, the best of a few starts. From each, one tree by moving a leaf and one by
moving a subtree, listed as the search lists it: rooted and numbered anew. Every tree is solved from the parent's
design alone, and from random starts. Times are CPU seconds of starts and solves, without building the program.
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
from nlp.assembled import AssembledProgram
from nlp.evaluation import correct, violations, worst
from nlp.numbers.point import Point
from nlp.starts.random_starts import draw, generator
from nlp.starts.warm_start import warm_start
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.files import read_task
from topo_search.topologies import candidate_of, sample

WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""
PARENT_STARTS = 4
"""Starts of a parent."""
ROOT = (-1, -1, -1)


@dataclass(frozen=True)
class Reached:
    """What a tree's solve ended with."""

    J: float
    """Infinite without a design."""
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
    moves: dict[str, list[tuple[Reached, list[Reached]]]] = {"leaf": [], "subtree": []}
    for parent in parents(task, arguments.parents):
        for name, trees in moves.items():
            topology = moved(parent.topology, Random(f"{name} {parent.topology_key}"), leaf=name == "leaf")
            trees.append(measured(task, topology, parent, arguments.starts))
    print(f"{arguments.example}, n = {n}, {' '.join(arguments.settings)}")
    print("| move | trees, feasible | start | solved | within 0.1 % of best | J / best, mean | CPU s a tree |")
    print("|---|---|---|---|---|---|---|")
    for name, trees in moves.items():
        for line in lines(trees, sorted({1, min(4, arguments.starts), arguments.starts})):
            print(f"| {name} {line}")


def parents(task: ResolvedTask, wanted: int) -> Iterator[Design]:
    """Yield designs of uniformly drawn topologies."""
    drawn, found = 0, 0
    while found < wanted:
        drawn += 1
        topology = sample(task.n, drawn, 0)[-1]
        outcome = nlp.solve(task, topology, starts=range(PARENT_STARTS), seed=1)
        if isinstance(outcome, Design):
            found += 1
            yield outcome


def moved(topology: Topology, random: Random, *, leaf: bool) -> Topology:
    """Return another tree: a leaf, or a subtree of two modules or more, is cut off and bolted on elsewhere."""
    below: list[set[int]] = [{i} for i in range(topology.n)]
    for i in range(topology.n - 1, 0, -1):
        below[topology.parents[i]] |= below[i]
    cuts = [i for i in range(1, topology.n) if (len(below[i]) == 1) == leaf]
    here = candidate_of(topology).key
    while True:
        cut = random.choice(cuts)
        places = [place for place in topology.free_connectors if place[0] not in below[cut]]
        h, a = random.choice(places)
        order = [i for i in range(topology.n) if i not in below[cut]] + sorted(below[cut])
        number = {i: k for k, i in enumerate(order)}
        joints = [ROOT]
        turn = (a + 2 - topology.joints[cut][2]) % 4  # the subtree turns as one so that its joint is aligned again
        for i in order[1:]:
            parent, port, own = topology.joints[i]
            if i == cut:
                joints.append((number[h], a, (own + turn) % 4))
            elif i in below[cut]:
                joints.append((number[parent], (port + turn) % 4, (own + turn) % 4))
            else:
                joints.append((number[parent], port, own))
        other = candidate_of(Topology(tuple(joints)))
        if other.key != here:
            return other.topology


def measured(task: ResolvedTask, topology: Topology, parent: Design, starts: int) -> tuple[Reached, list[Reached]]:
    """Return what is reached from the parent, and from every random start."""
    ready = AssembledProgram(task, topology)
    rngs = (generator(task, topology, start, 0) for start in count(-1))
    warm = partial(warm_start, task, topology, parent, next(rngs))
    cold = (partial(draw, task, topology, rng) for rng in islice(rngs, starts))
    return reached(ready, warm), [reached(ready, start) for start in cold]


def reached(ready: AssembledProgram, start: Callable[[], Point]) -> Reached:
    """Return what a start leads to."""
    began = time.process_time()
    point = correct(ready.solve(start()).point)
    met = worst(violations(point)).met
    weights = np.array([case.weight for case in point.task.load_cases])
    J = float(weights @ np.einsum("kiq,kiq->k", point.u, point.u)) if met else np.inf
    return Reached(J, time.process_time() - began)


def lines(trees: list[tuple[Reached, list[Reached]]], counts: list[int]) -> Iterator[str]:
    """Yield one line for the warm start and one for every number of random starts."""
    best = np.array([min(warm.J, *(cold.J for cold in colds)) for warm, colds in trees])
    feasible = np.isfinite(best)
    kinds = {"warm start": [[warm] for warm, _ in trees]}
    kinds |= {f"best of {count}": [colds[:count] for _, colds in trees] for count in counts}
    kinds |= {
        f"warm start, or best of {count}": [[warm, *colds[:count]] for warm, colds in trees] for count in counts
    }
    for name, groups in kinds.items():
        J = np.array([min(one.J for one in group) for group in groups])[feasible]
        seconds = np.mean([sum(one.seconds for one in group) for group in groups])
        ratio = J / best[feasible]
        solved = np.isfinite(ratio)
        cells = [f"{solved.mean():.0%}", f"{(ratio <= 1 + WITHIN).mean():.0%}", f"{ratio[solved].mean():.4f}"]
        yield f"| {len(trees)}, {feasible.sum()} | {name} | {' | '.join(cells)} | {seconds:.3f} |"


if __name__ == "__main__":
    main()

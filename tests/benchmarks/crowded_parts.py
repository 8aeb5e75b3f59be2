"""Why large trees cannot be placed: the least part of a tree that is in its own way, and a proof that it is.

    OMP_NUM_THREADS=1 python tests/benchmarks/crowded_parts.py [--modules 40] [--connector-distance 0.22]
        [--trees N] [--starts N] [--boxes N]

Uniformly drawn trees with body clearance, geometry alone. Where no start places a tree, the pairs that its starts
most often leave in each other's way are taken, and what lies within a few joints of the path between them, until
that part alone cannot be placed either; then modules are taken off its ends as long as this remains so. Its hinge
angles are halved, depth first, until two modules are too close everywhere in every box
(`nlp.bounds.branch.crowded`): then the part is proven to have no angles, and every tree that holds it.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator

import networkx as nx
import numpy as np
from numba import njit
from untangling import overlaps

from nlp.bounds.branch import frames
from nlp.bounds.branch.arrays import BranchProblem, centre, reroot, to_arrays, whole_box
from nlp.bounds.branch.crowded import EVERYWHERE, NOWHERE, crowding
from nlp.starts.random_starts import draw, generator
from nlp.starts.untangling import untangle
from topo_search.model import ResolvedTask, Task, Topology
from topo_search.model.arrays import Array
from topo_search.topologies import sample

PAIRS = 3
"""Pairs that are looked at: those most often in each other's way."""
RADII = range(5)
"""Joints from the path between the two up to which modules belong to the part that is tried."""
ASPECT = 4.0
"""How much wider than the hinge whose box is halved another one may be."""
PROVEN, PLACED, OPEN = "proven", "can be placed", "open"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modules", type=int, default=40)
    parser.add_argument("--connector-distance", type=float, default=0.22, help="[m]")
    parser.add_argument("--trees", type=int, default=10)
    parser.add_argument("--starts", type=int, default=8, help="of a whole tree; parts get eight times as many")
    parser.add_argument("--boxes", type=int, default=1_000_000, help="after which a proof is given up")
    given = parser.parse_args()
    print("| tree | part that cannot be placed | modules | boxes | proof | CPU s |\n|---|---|---|---|---|---|")
    for topology in sample(given.modules, given.trees, 0):
        began = time.process_time()
        task = task_of(given.modules, given.connector_distance)
        found = crowded_part(task, topology, given.starts)
        cells = ["(placed)", "", "", ""] if found == topology else ["not found", "", "", ""]
        if found is not None and found != topology:
            boxes, proof = prove_crowded(task_of(found.n, given.connector_distance), found, given.boxes)
            cells = [f"`{found.key}`", str(found.n), f"{boxes:,}", proof]
        seconds = f"{time.process_time() - began:.1f}"
        print(f"| `{topology.key[:12]}` | {' | '.join(cells)} | {seconds} |", flush=True)


def task_of(n: int, connector_distance: float) -> ResolvedTask:
    """Return a task of n modules that hovers; only its clearances matter."""
    hover = [{"com": {"force": [0.0, 0.0, 1.0]}}]
    module = {"connector_distance": connector_distance}
    return Task.model_validate({"name": "hover", "modules": n, "module": module, "load_cases": hover}).resolve(n)


def crowded_part(task: ResolvedTask, topology: Topology, starts: int) -> Topology | None:
    """Return the least part found that no start places: the tree itself if one places it, None if none is found."""
    often = Counter[tuple[int, int]]()
    for start in range(starts):
        alpha = draw(task, topology, generator(task, topology, start, 0)).alpha
        if not (left := overlaps(task, topology, alpha)):
            return topology
        often.update(left)
    graph, l_c = topology.graph(), task.module.connector_distance
    for pair, _ in often.most_common(PAIRS):
        path = nx.shortest_path(graph, *pair)
        for radius in RADII:
            nodes = frozenset[int]().union(*(nx.ego_graph(graph, i, radius).nodes for i in path))
            if len(nodes) < topology.n and not can_be_placed(part(graph, nodes), l_c, 8 * starts):
                return least(graph, nodes, l_c, 8 * starts)
    return None


def least(graph: nx.Graph[int], nodes: frozenset[int], l_c: float, starts: int) -> Topology:
    """Return what is left of a part when no leaf can be taken off without its being placed."""
    for leaf in leaves(graph, nodes):
        if not can_be_placed(part(graph, nodes - {leaf}), l_c, starts):
            return least(graph, nodes - {leaf}, l_c, starts)
    return part(graph, nodes)


def leaves(graph: nx.Graph[int], nodes: frozenset[int]) -> Iterator[int]:
    """Yield the modules of a part that hang on one of its others."""
    yield from (i for i in sorted(nodes) if sum(j in nodes for j in graph[i]) == 1)


def part(graph: nx.Graph[int], nodes: frozenset[int]) -> Topology:
    """Return a connected part of a tree as a topology of its own."""
    return Topology.from_graph(graph.subgraph(nodes))


def can_be_placed(topology: Topology, l_c: float, starts: int) -> bool:
    """Return whether one of so many starts finds hinge angles without overlaps."""
    task, rng = task_of(topology.n, l_c), np.random.default_rng(0)
    draws = (rng.uniform(-np.pi / 2, np.pi / 2, topology.n - 1) for _ in range(starts))
    return any(not overlaps(task, topology, untangle(task, topology, a, rng, leeway=False)) for a in draws)


def prove_crowded(task: ResolvedTask, topology: Topology, most: int) -> tuple[int, str]:
    """Return how many boxes were looked at, and what they came to."""
    hung = reroot(topology, centre(task, topology))
    lower, upper = whole_box(task, topology.n)
    lower[:3] = upper[:3] = 0.0  # where the root points does not matter
    boxes, placed = exclude(to_arrays(task, hung), lower, upper, most)
    return boxes, PLACED if placed else OPEN if boxes > most else PROVEN


@njit(cache=True)
def exclude(stated: BranchProblem, lower: Array, upper: Array, most: int) -> tuple[int, bool]:
    """Halve a box of angles until two modules are too close all over every part of it, or not so at some middle.

    Args:
        stated: the task and the tree.
        lower: least angles, shape (A,) [rad].
        upper: greatest angles.
        most: boxes after which it is given up.

    Returns:
        The number of boxes, and whether modules keep clear of each other at the middle of the last one.
    """
    A, n = len(lower), len(stated.tree.parent)
    lo, hi = np.empty((64 * A, A)), np.empty((64 * A, A))
    lo[0], hi[0] = lower, upper
    vertices, middle = frames.empty_frames(stated.tree.first[-1]), frames.empty_frames(n)
    axes, gain = frames.Axes(np.zeros((A, 3)), np.zeros((A, 3))), np.zeros(A)
    left, boxes = 1, 0
    while left > 0 and boxes <= most:
        left -= 1
        boxes += 1
        at, rho = (lo[left] + hi[left]) / 2, (hi[left] - lo[left]) / 2
        frames.fill_middle_frames(stated.tree, stated.l_c, at, middle, axes)
        frames.fill_vertex_frames(stated.tree, stated.l_c, lo[left], hi[left], vertices)
        where = crowding(stated, middle, axes, vertices, rho, gain)
        if where == EVERYWHERE:
            continue
        if where == NOWHERE:
            return boxes, True
        gain[rho < rho.max() / ASPECT] = -1.0
        axis = 3 + int(np.argmax(gain[3:]))
        if left + 2 > len(lo):
            return most + 1, False
        lo[left + 1], hi[left + 1] = lo[left], hi[left]
        lo[left, axis] = hi[left + 1, axis] = at[axis]
        left += 2
    return boxes, False


if __name__ == "__main__":
    main()

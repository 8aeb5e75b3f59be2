"""Why large trees have no placement: the smallest part of a tree without one, and a proof that it has none.

    OMP_NUM_THREADS=1 python tests/benchmarks/crowded_parts.py [--modules 40] [--connector-distance 0.22]
        [--trees N] [--starts N] [--boxes N]

Uniformly drawn trees with body clearance; only geometry matters. If no start places a tree, that is, finds hinge
angles without overlap, the part within a few joints of the path between two modules that most often overlap is
tried, with growing radius, until the part cannot be placed either. Leaves are then removed as long as this remains
so. Branch and bound halves boxes of hinge angles, depth first, until two modules are too close everywhere in every
box (`nlp.bounds.branch.crowded`): this proves that neither the part nor any tree that contains it can be placed.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator

import networkx as nx
import numpy as np
from numba import njit
from older import older_task
from untangling import overlaps

from nlp.bounds.branch import frames
from nlp.bounds.branch.arrays import BranchProblem, centre, reroot, to_arrays, whole_box
from nlp.bounds.branch.crowded import EVERYWHERE, NOWHERE, crowding
from nlp.starts.random_starts import draw, generator
from nlp.starts.untangling import untangle
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.topologies import sample

MAX_PAIRS = 3
"""Pairs that are tried: those that overlap most often."""
RADII = range(5)
"""Distances from the path between two modules, in joints, within which modules belong to the part."""
ASPECT = 4.0
"""Largest ratio between the widths of a box; narrower sides are not halved."""
PROVEN, PLACED, OPEN = "proven", "can be placed", "open"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modules", type=int, default=40)
    parser.add_argument("--connector-distance", type=float, default=0.22, help="[m]")
    parser.add_argument("--trees", type=int, default=10)
    parser.add_argument(
        "--starts", type=int, default=8, help="starts of a whole tree; parts get eight times as many"
    )
    parser.add_argument("--boxes", type=int, default=1_000_000, help="largest number of boxes of a proof")
    arguments = parser.parse_args()
    print("| tree | part that cannot be placed | modules | boxes | proof | CPU s |\n|---|---|---|---|---|---|")
    for topology in sample(arguments.modules, arguments.trees, 0):
        started = time.process_time()
        task = task_of(arguments.modules, arguments.connector_distance)
        core = crowded_part(task, topology, arguments.starts)
        cells = ["(placed)", "", "", ""] if core == topology else ["not found", "", "", ""]
        if core is not None and core != topology:
            boxes, proof = prove_crowded(task_of(core.n, arguments.connector_distance), core, arguments.boxes)
            cells = [f"`{core.key}`", str(core.n), f"{boxes:,}", proof]
        seconds = f"{time.process_time() - started:.1f}"
        print(f"| `{topology.key[:12]}` | {' | '.join(cells)} | {seconds} |", flush=True)


def task_of(n: int, connector_distance: float) -> ResolvedTask:
    """Return a task of n modules that hovers; only its clearances matter."""
    hover = [{"com": {"force": [0.0, 0.0, 1.0]}}]
    module = {"connector_distance": connector_distance}
    return older_task(name="hover", modules=n, module=module, load_cases=hover).resolve(n)


def crowded_part(task: ResolvedTask, topology: Topology, starts: int) -> Topology | None:
    """Return a minimal part that no start places; the tree itself if one places it; None if no part is found."""
    overlap_counts = Counter[tuple[int, int]]()
    for start in range(starts):
        alpha = draw(task, topology, generator(task, topology, start, 0)).alpha
        if not (pairs := overlaps(task, topology, alpha)):
            return topology
        overlap_counts.update(pairs)
    graph, l_c = topology.graph(), task.module.connector_distance
    for pair, _ in overlap_counts.most_common(MAX_PAIRS):
        path = nx.shortest_path(graph, *pair)
        for radius in RADII:
            nodes = frozenset[int]().union(*(nx.ego_graph(graph, i, radius).nodes for i in path))
            if len(nodes) < topology.n and not can_be_placed(part(graph, nodes), l_c, 8 * starts):
                return minimal_part(graph, nodes, l_c, 8 * starts)
    return None


def minimal_part(graph: nx.Graph[int], nodes: frozenset[int], l_c: float, starts: int) -> Topology:
    """Return a minimal part within a part that cannot be placed, by removing leaves."""
    for leaf in leaves(graph, nodes):
        if not can_be_placed(part(graph, nodes - {leaf}), l_c, starts):
            return minimal_part(graph, nodes - {leaf}, l_c, starts)
    return part(graph, nodes)


def leaves(graph: nx.Graph[int], nodes: frozenset[int]) -> Iterator[int]:
    """Yield the leaves of a part: modules with one neighbour in it."""
    yield from (i for i in sorted(nodes) if sum(j in nodes for j in graph[i]) == 1)


def part(graph: nx.Graph[int], nodes: frozenset[int]) -> Topology:
    """Return a connected part of a tree as a topology."""
    return Topology.from_graph(graph.subgraph(nodes))


def can_be_placed(topology: Topology, l_c: float, starts: int) -> bool:
    """Return whether one of several random starts leads to hinge angles without overlap."""
    task, rng = task_of(topology.n, l_c), np.random.default_rng(0)
    draws = (rng.uniform(-np.pi / 2, np.pi / 2, topology.n - 1) for _ in range(starts))
    return any(not overlaps(task, topology, untangle(task, topology, a, rng, leeway=False)) for a in draws)


def prove_crowded(task: ResolvedTask, topology: Topology, max_boxes: int) -> tuple[int, str]:
    """Run branch and bound, and return the number of boxes and the verdict."""
    rerooted = reroot(topology, centre(task, topology))
    lower, upper = whole_box(task, topology.n)
    lower[:3] = upper[:3] = 0.0  # the root orientation does not matter
    boxes, placed = exclude(to_arrays(task, rerooted), lower, upper, max_boxes)
    return boxes, PLACED if placed else OPEN if boxes > max_boxes else PROVEN


@njit(cache=True)
def exclude(problem: BranchProblem, lower: Array, upper: Array, max_boxes: int) -> tuple[int, bool]:
    """Halve a box of angles until two modules are too close everywhere in every part, or clear at a midpoint.

    Args:
        problem: the task and the tree.
        lower: smallest angles, shape (A,) [rad].
        upper: largest angles, shape (A,) [rad].
        max_boxes: number of boxes after which the search stops.

    Returns:
        The number of boxes, and whether all modules are clear of each other at the midpoint of the last one.
    """
    A = len(lower)
    lo, hi = np.empty((64 * A, A)), np.empty((64 * A, A))
    lo[0], hi[0] = lower, upper
    box, gain = frames.empty_box(problem.tree), np.zeros(A)
    pending, boxes = 1, 0
    while pending > 0 and boxes <= max_boxes:
        pending -= 1
        boxes += 1
        frames.fill_box(problem.tree, problem.l_c, lo[pending], hi[pending], box)
        where = crowding(problem, box, gain)
        if where == EVERYWHERE:
            continue
        if where == NOWHERE:
            return boxes, True
        gain[box.rho < box.rho.max() / ASPECT] = -1.0
        axis = 3 + int(np.argmax(gain[3:]))
        if pending + 2 > len(lo):
            return max_boxes + 1, False
        lo[pending + 1], hi[pending + 1] = lo[pending], hi[pending]
        lo[pending, axis] = hi[pending + 1, axis] = box.centre[axis]
        pending += 2
    return boxes, False


if __name__ == "__main__":
    main()

"""Whether it pays to displace what a start has reached, instead of drawing a fresh start.

    python tests/benchmarks/restarts.py [EXAMPLE] [--modules N] [--trees M] [--starts S] [--by RAD ...]
        [--set FIELD=VALUE ...]

Every tree up to a half turn, or M uniformly drawn ones. With the same number of solves a tree: S fresh starts; half
as many, each displaced once from where it ended; and half as many, then the best point so far displaced again and
again, the closest one as long as there is no design. Hinges and root turn by normal angles with the standard
deviation RAD, the end-effector moves by RAD connector distances, overlaps of many modules are sorted out as in the
starts, and the inputs are the least-norm ones.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from nlp.assembled import AssembledProgram
from nlp.bounds import prove_impossible
from nlp.evaluation import correct, violations, worst
from nlp.numbers.geometry import nearest_angles
from nlp.numbers.point import Point, fixed_end_effector
from nlp.starts.random_starts import DRAWING, draw, generator, with_inputs
from nlp.starts.untangling import untangle
from topo_search.model import ResolvedTask, Topology
from topo_search.model.files import read_task
from topo_search.topologies import candidates, sample

WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""


@dataclass(frozen=True)
class End:
    """Where a solve ended."""

    point: Point
    rank: tuple[bool, float]
    """Designs first, by effort; the others by their worst violation."""
    seconds: float

    @property
    def J(self) -> float:
        """The effort; infinite without a design."""
        return np.inf if self.rank[0] else self.rank[1]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="push")
    parser.add_argument("--modules", type=int, default=5)
    parser.add_argument("--trees", type=int, help="uniformly drawn ones; default: all")
    parser.add_argument("--starts", type=int, default=8, help="solves of each tree and strategy; even")
    parser.add_argument("--by", type=float, nargs="+", default=[0.3, 1.0], help="size of displacements [rad]")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings")
    arguments = parser.parse_args()
    n = arguments.modules
    task = read_task(arguments.example, (f"modules={n}", *arguments.settings)).resolve(n)
    trees = [candidate.topology for candidate in candidates(n)] if arguments.trees is None else []
    trees = [tree for tree in trees or sample(n, arguments.trees, 0) if prove_impossible(task, tree) is None]
    ends: dict[str, list[list[End]]] = defaultdict(list)
    for tree in trees:
        for name, solves in strategies(task, tree, arguments.starts, arguments.by).items():
            ends[name].append(solves)
    best = np.min([[min(end.J for end in solves) for solves in trees] for trees in ends.values()], axis=0)
    print(f"{arguments.example}, n = {n}, {' '.join(arguments.settings)}")
    print(f"{len(trees)} trees that are not proven impossible, {np.isfinite(best).sum()} with a design")
    print("| starts | designs, of all solves | trees with a design | within 0.1 % of best | CPU s a tree |")
    print("|---|---|---|---|---|")
    for name, of_trees in ends.items():
        J = np.array([[end.J for end in solves] for solves in of_trees])
        least, seconds = J.min(axis=1), np.mean([sum(end.seconds for end in solves) for solves in of_trees])
        at_best = np.isfinite(least) & (least <= (1 + WITHIN) * best)
        cells = f"{np.isfinite(J).mean():.1%} | {np.isfinite(least).sum()} | {at_best.sum()} | {seconds:.3f}"
        print(f"| {name} | {cells} |")


def strategies(task: ResolvedTask, topology: Topology, starts: int, sizes: list[float]) -> dict[str, list[End]]:
    """Return all ends of every strategy."""
    ready = AssembledProgram(task, topology)
    fresh = [reached(ready, draw(task, topology, generator(task, topology, s, 0))) for s in range(starts)]
    half = fresh[: starts // 2]
    result = {"fresh": fresh}
    for by in sizes:
        rng = np.random.default_rng(0)
        result[f"each displaced by {by:g}"] = half + [reached(ready, displaced(end.point, by, rng)) for end in half]
        hops = list(half)
        for _ in half:
            best = min(hops, key=lambda end: end.rank)
            hops.append(reached(ready, displaced(best.point, by, rng)))
        result[f"the best displaced by {by:g}"] = hops
    return result


def displaced(point: Point, by: float, rng: np.random.Generator) -> Point:
    """Return a start near a point."""
    task, topology = point.task, point.topology
    right = np.pi / 2
    root = point.root + by * rng.normal(size=3)
    alpha = nearest_angles(task, topology, point.alpha + by * rng.normal(size=topology.n - 1))
    if topology.n >= DRAWING.untangled_from:
        alpha = untangle(task, topology, alpha, rng)
    p_E = point.p_E + by * task.module.connector_distance * rng.normal(size=3)
    if task.search.root == "paper":
        root = np.clip(root, [0.0, -right, -right], [0.0, right, right])
    if task.end_effector.fixed_position is not None:
        p_E = fixed_end_effector(task, topology, root, alpha)
    return with_inputs(Point(task, topology, root, alpha, p_E, point.u))


def reached(ready: AssembledProgram, start: Point) -> End:
    """Return where a start leads."""
    began = time.process_time()
    point = correct(ready.solve(start).point)
    reason = worst(violations(point))
    weights = np.array([case.weight for case in point.task.load_cases])
    J = float(weights @ np.einsum("kiq,kiq->k", point.u, point.u))
    rank = (False, J) if reason.met else (True, reason.rank)
    return End(point, rank, time.process_time() - began)


if __name__ == "__main__":
    main()

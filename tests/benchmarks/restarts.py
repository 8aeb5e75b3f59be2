"""Displacing the result of a start, against drawing a new start.

    python tests/benchmarks/restarts.py [EXAMPLE] [--modules N] [--trees M] [--starts S] [--by RAD ...]
        [--set FIELD=VALUE ...]

Every tree up to a half turn, or M uniformly drawn ones. Strategies with the same number of solves per tree: S fresh
starts; S / 2, and each result displaced once; S / 2, then repeatedly the best result so far displaced, or the one
with the smallest violation while there is no design. Hinge angles and root orientation change by normal angles of
standard deviation RAD, the end-effector moves by RAD connector distances, overlaps of many modules are removed as
for starts, and inputs are of least norm.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from nlp.bounds.proofs import prove_impossible
from nlp.evaluation import correct, violations, worst
from nlp.numbers.geometry import nearest_angles
from nlp.numbers.point import Point, fixed_end_effector
from nlp.program import AssembledProgram
from nlp.starts.random_starts import DRAWING, draw, generator, with_inputs
from nlp.starts.untangling import untangle
from topo_search.model import ResolvedTask, Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates, sample

WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""


@dataclass(frozen=True)
class Result:
    """Result of a solve."""

    point: Point
    rank: tuple[bool, float]
    """Sort key: designs by effort, then other points by worst violation."""
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
    parser.add_argument("--trees", type=int, help="number of uniformly drawn trees; default: all trees")
    parser.add_argument("--starts", type=int, default=8, help="solves of each tree and strategy; even")
    parser.add_argument("--by", type=float, nargs="+", default=[0.3, 1.0], help="size of displacements [rad]")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings")
    arguments = parser.parse_args()
    n = arguments.modules
    task = read_task(arguments.example, (f"modules={n}", *arguments.settings)).resolve(n)
    trees = [candidate.topology for candidate in candidates(n)] if arguments.trees is None else []
    trees = [tree for tree in trees or sample(n, arguments.trees, 0) if prove_impossible(task, tree) is None]
    results: dict[str, list[list[Result]]] = defaultdict(list)
    for tree in trees:
        for name, solves in strategies(task, tree, arguments.starts, arguments.by).items():
            results[name].append(solves)
    best = np.min([[min(result.J for result in solves) for solves in trees] for trees in results.values()], axis=0)
    print(f"{arguments.example}, n = {n}, {' '.join(arguments.settings)}")
    print(f"{len(trees)} trees that are not proven impossible, {np.isfinite(best).sum()} with a design")
    print("| starts | designs, of all solves | trees with a design | within 0.1 % of best | CPU s a tree |")
    print("|---|---|---|---|---|")
    for name, solves_by_tree in results.items():
        J = np.array([[result.J for result in solves] for solves in solves_by_tree])
        least = J.min(axis=1)
        seconds = np.mean([sum(result.seconds for result in solves) for solves in solves_by_tree])
        at_best = np.isfinite(least) & (least <= (1 + WITHIN) * best)
        cells = f"{np.isfinite(J).mean():.1%} | {np.isfinite(least).sum()} | {at_best.sum()} | {seconds:.3f}"
        print(f"| {name} | {cells} |")


def strategies(task: ResolvedTask, topology: Topology, starts: int, sizes: list[float]) -> dict[str, list[Result]]:
    """Return the results of all solves of every strategy."""
    program = AssembledProgram(task, topology)
    fresh = [solve_from(program, draw(task, topology, generator(task, topology, s, 0))) for s in range(starts)]
    half = fresh[: starts // 2]
    result = {"fresh": fresh}
    for by in sizes:
        rng = np.random.default_rng(0)
        result[f"each displaced by {by:g}"] = half + [solve_from(program, displace(r.point, by, rng)) for r in half]
        hops = list(half)
        for _ in half:
            best = min(hops, key=lambda hop: hop.rank)
            hops.append(solve_from(program, displace(best.point, by, rng)))
        result[f"the best displaced by {by:g}"] = hops
    return result


def displace(point: Point, by: float, rng: np.random.Generator) -> Point:
    """Return a start at a random displacement from a point."""
    task, topology = point.task, point.topology
    right = np.pi / 2
    root = point.root + by * rng.normal(size=3)
    alpha = nearest_angles(task, topology, point.alpha + by * rng.normal(size=topology.n - 1))
    if topology.n >= DRAWING.untangled_from:
        alpha = untangle(task, topology, alpha, rng)
    p_E = point.tip + by * task.module.connector_distance * rng.normal(size=3)
    if task.search.root == "paper":
        root = np.clip(root, [0.0, -right, -right], [0.0, right, right])
    if task.end_effector.fixed_position is not None:
        p_E = fixed_end_effector(task, topology, root, alpha)
    return with_inputs(Point(task, topology, root, alpha, p_E, point.u))


def solve_from(program: AssembledProgram, start: Point) -> Result:
    """Solve from a start."""
    started = time.process_time()
    point = correct(program.solve(start).point)
    reason = worst(violations(point))
    weights = np.array([case.weight for case in point.task.load_cases])
    J = float(weights @ np.einsum("kiq,kiq->k", point.u, point.u))
    rank = (False, J) if reason.met else (True, reason.rank)
    return Result(point, rank, time.process_time() - started)


if __name__ == "__main__":
    main()

"""The share of the gap that the bounds close, and the sources of the rest.

    python tests/benchmarks/bounds.py [--starts N]

First table, by task: the bound over the closed form, the best effort found over both, and the time of bound and
proof over that of one start of one tree. Second table, for the push example without some constraints, over all
trees: the least effort over the closed form, which is the best that a bound without those constraints can reach;
and the number of trees, of the 49 that differ by more than a half turn, that such a bound would exclude, because
their least effort exceeds the best of the whole problem. Solves are local, so all of these are upper estimates.
Last: the trees of the push example that are proven impossible, and the time for all of them.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from older import older_task

from nlp import lower_bound, prove_impossible, solve
from nlp.bounds.effort import closed_form
from nlp.ipopt import BETA, OPTIONS
from nlp.problem import Constraint, problem
from nlp.starts.random_starts import draw, generator
from nlp.units import Units
from topo_search.model import Design, ResolvedTask, Task, Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates, sample

LOAD_FORCES = {
    "up and down": [[0.0, 0.0, 1.0], [0.0, 0.0, -0.2]],
    "sideways, both ways": [[0.5, 0.0, 0.3], [-0.5, 0.0, 0.3]],
    "sideways, all ways": [[0.5, 0.0, 0.3], [-0.5, 0.0, 0.3], [0.0, 0.5, 0.3], [0.0, -0.5, 0.3]],
}
"""Forces at the end-effector of five modules that no single thrust direction can all serve."""

KEPT_CONSTRAINTS: dict[str, Callable[[Constraint, Topology], bool]] = {
    "all but the forces": lambda row, _: row.name.endswith(", force"),
    "all but forces and torques": lambda row, _: row.name.startswith("load case"),
    "and but the airflow of bolted modules": lambda row, tree: (
        row.name.startswith("load case") or row.name in {f"airflow of modules {h} and {i}" for h, i in tree.bolted}
    ),
    "and but all airflow": lambda row, _: row.name.startswith(("load case", "airflow")),
    "nothing": lambda _row, _tree: True,
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=6)
    starts = parser.parse_args().starts
    examples = {name: read_task(name) for name in ("push", "push-exterior-60", "ten-wrenches")}
    print(
        f"{'task':22}{'bound / closed':>15}{'best / closed':>15}{'best / bound':>14}{'bound, proof [starts]':>23}"
    )
    for name, task in (examples | {name: pulling(forces) for name, forces in LOAD_FORCES.items()}).items():
        print_gap(name, task.resolve(task.n), starts)
    print_left_out(examples["push"].resolve(5), starts)
    for n in (5, 6, 7, 8):
        print_proven(examples["push"].resolve(n))


def pulling(forces: list[list[float]]) -> Task:
    """Return a task of five modules with these forces at the end-effector."""
    cases: list[dict[str, Any]] = [{"end_effector": {"force": force}} for force in forces]
    return older_task(name="pulling", modules=5, load_cases=cases)


def print_gap(name: str, task: ResolvedTask, starts: int) -> None:
    """Print one row of the first table."""
    started = time.perf_counter()
    bound, proof = lower_bound(task), prove_impossible(task)
    seconds = time.perf_counter() - started
    all_trees = (candidate.topology for candidate in candidates(5, symmetry="task", task=task))
    trees = list(all_trees) if task.n == 5 else sample(task.n, 8, 0)
    started = time.perf_counter()
    results = [solve(task, tree, starts=range(starts), seed=0) for tree in trees]
    seconds_per_start = (time.perf_counter() - started) / (len(results) * starts)
    best = min((result.objective for result in results if isinstance(result, Design)), default=math.inf)
    closed = closed_form(task)
    ratios = f"{bound / closed:15.4f}{best / closed:15.4f}{best / bound:14.4f}"
    print(f"{name:22}{ratios}{seconds / seconds_per_start:23.1f}{'  impossible' if proof else ''}", flush=True)


def print_left_out(task: ResolvedTask, starts: int) -> None:
    """Print the second table."""
    trees = list(candidates(task.n, symmetry="task", task=task))
    least = {
        name: [least_effort(task, tree.topology, keeps, starts) for tree in trees]
        for name, keeps in KEPT_CONSTRAINTS.items()
    }
    incumbent = min(least["nothing"])
    print(f"\n{'push, left out':40}{'least / closed':>15}{'trees it would exclude':>24}")
    for name, efforts in least.items():
        excluded = sum(tree.orbit for tree, J in zip(trees, efforts, strict=True) if incumbent < J)
        print(f"{name:40}{min(efforts) / closed_form(task):15.4f}{excluded:24}")


def print_proven(task: ResolvedTask) -> None:
    """Print how many trees of a size are proven impossible."""
    trees = list(candidates(task.n))
    started = time.perf_counter()
    proven = sum(prove_impossible(task, tree.topology) is not None for tree in trees)
    seconds = time.perf_counter() - started
    print(f"{task.n} modules: {proven} of {len(trees)} trees are proven impossible, {seconds:.1f} s")


def least_effort(
    task: ResolvedTask, tree: Topology, keeps: Callable[[Constraint, Topology], bool], starts: int
) -> float:
    """Return the least effort found with bounds and only some of the constraints [rad^4/s^4]."""
    full = problem(task, tree)
    rows = [row for row in full.constraints if keeps(row, tree)]
    program = {
        "x": full.variables.vector(),
        "p": full.beta,
        "f": full.objective,
        "g": ca.vertcat(*(row.expression for row in rows)),
    }
    solver = ca.nlpsol("relaxed", "ipopt", program, OPTIONS)
    lower = np.concatenate([np.full(row.expression.numel(), row.lower) for row in rows])
    upper = np.concatenate([np.full(row.expression.numel(), row.upper) for row in rows])
    best = math.inf
    for s in range(starts):
        start = draw(task, tree, generator(task, tree, s, seed=0)).pack()
        result = solver(x0=start, p=BETA, lbx=full.lower, ubx=full.upper, lbg=lower, ubg=upper)
        if solver.stats()["success"]:
            best = min(best, float(result["f"]))
    weights = sum(case.weight for case in task.load_cases)
    return best * 4 * task.n * weights * Units.of(task).input ** 2


if __name__ == "__main__":
    main()

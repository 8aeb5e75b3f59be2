"""How much of the gap the bounds close, and where the rest of it comes from.

    python tests/benchmarks/bounds.py [--starts N]

First table: tasks, the bound over the closed form, the best effort found over both, and what bound and proof cost
against one start of one tree. Second table: the push example with constraints left out, all trees: the least effort
over the closed form, which is what a perfect bound that leaves them out could reach, and how many of the 49 trees
that differ by more than a half turn it would exclude: those whose least effort exceeds the best of the whole
problem. The solves are local, so each of these numbers is an upper estimate. Last: the trees of the push example
that are proven impossible, and the time for all of them.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from nlp import lower_bound, prove_impossible, solve
from nlp.bounds.effort import closed_form
from nlp.ipopt import BETA, OPTIONS
from nlp.problem import Constraint, problem
from nlp.starts.random_starts import draw, generator
from nlp.units import Units
from topo_search.model import Design, ResolvedTask, Task, Topology
from topo_search.model.files import read_task
from topo_search.topologies import candidates, sample

WAYS = {
    "up and down": [[0.0, 0.0, 1.0], [0.0, 0.0, -0.2]],
    "sideways, both ways": [[0.5, 0.0, 0.3], [-0.5, 0.0, 0.3]],
    "sideways, all ways": [[0.5, 0.0, 0.3], [-0.5, 0.0, 0.3], [0.0, 0.5, 0.3], [0.0, -0.5, 0.3]],
}
"""Forces of load cases at the end-effector, of five modules, that no thrust of one module serves all."""

LEFT_OUT: dict[str, Callable[[Constraint, Topology], bool]] = {
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
    for name, task in (examples | {name: pulling(forces) for name, forces in WAYS.items()}).items():
        print_gap(name, task.resolve(task.n), starts)
    print_left_out(examples["push"].resolve(5), starts)
    for n in (5, 6, 7, 8):
        print_proven(examples["push"].resolve(n))


def pulling(forces: list[list[float]]) -> Task:
    """Return a task of five modules with these forces at the end-effector."""
    cases: list[dict[str, Any]] = [{"end_effector": {"force": force}} for force in forces]
    return Task.model_validate({"name": "pulling", "modules": 5, "load_cases": cases})


def print_gap(name: str, task: ResolvedTask, starts: int) -> None:
    """Print one row of the first table."""
    began = time.perf_counter()
    bound, proof = lower_bound(task), prove_impossible(task)
    seconds = time.perf_counter() - began
    every = (candidate.topology for candidate in candidates(5, symmetry="task", task=task))
    trees = list(every) if task.n == 5 else sample(task.n, 8, 0)
    began = time.perf_counter()
    results = [solve(task, tree, starts=range(starts), seed=0) for tree in trees]
    a_start = (time.perf_counter() - began) / (len(results) * starts)
    best = min((result.objective for result in results if isinstance(result, Design)), default=math.inf)
    closed = closed_form(task)
    ratios = f"{bound / closed:15.4f}{best / closed:15.4f}{best / bound:14.4f}"
    print(f"{name:22}{ratios}{seconds / a_start:23.1f}{'  impossible' if proof else ''}", flush=True)


def print_left_out(task: ResolvedTask, starts: int) -> None:
    """Print the second table."""
    trees = list(candidates(task.n, symmetry="task", task=task))
    least = {
        name: [least_effort(task, tree.topology, kept, starts) for tree in trees] for name, kept in LEFT_OUT.items()
    }
    incumbent = min(least["nothing"])
    print(f"\n{'push, left out':40}{'least / closed':>15}{'trees it would exclude':>24}")
    for name, efforts in least.items():
        excluded = sum(tree.orbit for tree, J in zip(trees, efforts, strict=True) if incumbent < J)
        print(f"{name:40}{min(efforts) / closed_form(task):15.4f}{excluded:24}")


def print_proven(task: ResolvedTask) -> None:
    """Print how many trees of a size are proven impossible."""
    trees = list(candidates(task.n))
    began = time.perf_counter()
    proven = sum(prove_impossible(task, tree.topology) is not None for tree in trees)
    seconds = time.perf_counter() - began
    print(f"{task.n} modules: {proven} of {len(trees)} trees are proven impossible, {seconds:.1f} s")


def least_effort(
    task: ResolvedTask, tree: Topology, kept: Callable[[Constraint, Topology], bool], starts: int
) -> float:
    """Return the least effort found when only some constraints are kept, besides the bounds [rad^4/s^4]."""
    stated = problem(task, tree)
    rows = [row for row in stated.constraints if kept(row, tree)]
    program = {
        "x": stated.variables.vector(),
        "p": stated.beta,
        "f": stated.objective,
        "g": ca.vertcat(*(row.expression for row in rows)),
    }
    solver = ca.nlpsol("relaxed", "ipopt", program, OPTIONS)
    lower = np.concatenate([np.full(row.expression.numel(), row.lower) for row in rows])
    upper = np.concatenate([np.full(row.expression.numel(), row.upper) for row in rows])
    best = math.inf
    for s in range(starts):
        start = draw(task, tree, generator(task, tree, s, seed=0)).pack()
        result = solver(x0=start, p=BETA, lbx=stated.lower, ubx=stated.upper, lbg=lower, ubg=upper)
        if solver.stats()["success"]:
            best = min(best, float(result["f"]))
    weights = sum(case.weight for case in task.load_cases)
    return best * 4 * task.n * weights * Units.of(task).input ** 2


if __name__ == "__main__":
    main()

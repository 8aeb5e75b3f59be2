"""The direct formulation on the problems of the scaling study; rows have the columns of its results.

    python tests/benchmarks/direct_scaling.py --out direct [--sizes 10 20 30 40 50 60] [--topologies 3]

It solves the first topologies of each size that `topo-search experiment scaling` draws, with the same wrenches and
from the same starts, until the first design. Times are CPU times of one thread, in a separate process for every
topology; `build_s` is the time of building the graph with its derivatives, once per topology. Points are evaluated
like the solver's, but not audited. The folder is that of an experiment: the same command resumes it.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

from attempts import TaskChoice, attempts
from children import Child, Row

from topo_search.experiments import experiment
from topo_search.experiments.conducting import CellResult, Results, identify
from topo_search.experiments.plan import Cell

METHOD = "direct"


def main() -> None:
    """Measure the cells that have no row in the folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="the folder of the rows")
    parser.add_argument("--tasks", nargs="+", default=["ten-wrenches"], help="shipped examples")
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 20, 30, 40, 50, 60], help="numbers of modules")
    parser.add_argument("--topologies", type=int, default=3, help="topologies of each size")
    parser.add_argument("--distance", type=float, default=0.30, help="connector distance [m]")
    parser.add_argument("--starts", type=int, default=3, help="largest number of starts of each topology")
    parser.add_argument("--cap", type=int, default=600, help="largest CPU time of each topology [s]")
    arguments = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"  # for the child processes
    settings = experiment("scaling").full.override(
        tasks=tuple((task, tuple(arguments.sizes)) for task in arguments.tasks),
        topologies=(arguments.topologies, arguments.topologies),
        distances=(arguments.distance,),
        starts=arguments.starts,
        time_limit=float(arguments.cap),
    )
    command = (
        f"python tests/benchmarks/direct_scaling.py --tasks {' '.join(arguments.tasks)} "
        f"--sizes {' '.join(map(str, arguments.sizes))} --topologies {arguments.topologies} "
        f"--distance {arguments.distance} --starts {arguments.starts} --cap {arguments.cap}"
    )
    with Results.open(arguments.out, identify(experiment("scaling").name, settings.as_json(), command)) as rows:
        for cell in experiment("scaling").cells(settings):
            if not rows.has(cell):
                rows.add(cell_result(cell, arguments.cap))


def cell_result(cell: Cell, cap: int) -> CellResult:
    """Solve one topology and return its row."""
    overrides = (*cell.variant.overrides, f"module.connector_distance={cell.distance_m}")
    choice = TaskChoice(cell.task, cell.n, (*overrides, f"task_seed={cell.task_seed}"))
    row = CellResult(**cell.identity, status="infeasible", method=METHOD)
    with Child(attempts, METHOD, "ours", choice, [cell.key], range(cell.settings.starts), cap=cap) as child:
        while row.status == "infeasible" and (answer := next(child, None)) is not None:
            row = _add_start(row, answer)
    if not row.starts:
        return replace(row, status="failed", worst_constraint=f"no start was finished within {cap} s of CPU time")
    return row


def _add_start(row: CellResult, answer: Row) -> CellResult:
    """Return a row with one more start added."""
    updated = replace(
        row,
        starts=row.starts + 1,
        build_s=round((row.build_s or 0.0) + answer["build"], 4),
        solve_s=round(row.solve_s + answer["draw"] + answer["solve"], 4),
        iterations=row.iterations + answer["iterations"],
        peak_mb=round(answer["peak_mb"], 1),
    )
    if answer["J"] is None:
        missed = {"worst_constraint": answer["missed"], "violation": answer["by"], "unit": answer["unit"]}
        return replace(updated, **missed)
    return replace(
        updated, status="feasible", objective=answer["J"], worst_constraint=None, violation=None, unit=None
    )


if __name__ == "__main__":
    main()

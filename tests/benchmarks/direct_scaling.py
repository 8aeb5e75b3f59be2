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
from typing import Any

from attempts import TaskChoice, attempts
from children import Child

from topo_search.experiments import experiment
from topo_search.experiments.study import Cell, identity, open_record

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
    study = experiment("scaling")
    settings = replace(
        study.full,
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
    with open_record(arguments.out, study.name, settings, command) as (done, add):
        for cell in study.cells(settings):
            if identity(cell.row) not in done:
                add(row_of(cell, arguments.starts, arguments.cap))


def row_of(cell: Cell, starts: int, cap: int) -> dict[str, Any]:
    """Solve one topology and return its row."""
    overrides = (*cell.variant.overrides, f"module.connector_distance={cell.distance_m}")
    choice = TaskChoice(cell.task, cell.n, (*overrides, f"task_seed={cell.task_seed}"))
    row = cell.row | {"method": METHOD, "build_s": 0.0}
    with Child(attempts, METHOD, "ours", choice, [cell.key], range(starts), cap=cap) as child:
        for start in child:
            row["starts"] += 1
            row["build_s"] = round(row["build_s"] + start["build"], 4)
            row["solve_s"] = round(row["solve_s"] + start["draw"] + start["solve"], 4)
            row["iterations"] += start["iterations"]
            row["peak_mb"] = round(start["peak_mb"], 1)
            if start["J"] is not None:
                return row | {"status": "feasible", "objective": start["J"]}
            missed = {"worst_constraint": start["missed"], "violation": start["by"], "unit": start["unit"]}
    if not row["starts"]:
        reason = f"no start was finished within {cap} s of CPU time"
        return row | {"status": "failed", "worst_constraint": reason}
    return row | {"status": "infeasible"} | missed


if __name__ == "__main__":
    main()

"""The formulation written directly, on the problems of the scaling study: rows with the columns of its results.

    python tests/benchmarks/direct_scaling.py --out direct [--sizes 10 20 30 40 50 60] [--topologies 3]

It solves the first topologies of each size that `topo-search experiment scaling` draws, with the same wrenches and
from the same starts, until the first design. Times are CPU seconds of one thread, in a process of its own for every
topology; `build_s` is the graph with its derivatives, which is built once a topology. Its point is evaluated like
the solver's, but not audited. The folder is that of an experiment: the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

from attempts import Stated, attempts
from children import Child, Row

from topo_search.experiments import experiment
from topo_search.experiments.conducting import CellResult, Results, identify
from topo_search.experiments.plan import Cell

METHOD = "direct"


def main() -> None:
    """Measure what is missing in the folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="the folder of the rows")
    parser.add_argument("--tasks", nargs="+", default=["ten-wrenches"], help="shipped examples")
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 20, 30, 40, 50, 60], help="numbers of modules")
    parser.add_argument("--topologies", type=int, default=3, help="topologies of each size")
    parser.add_argument("--distance", type=float, default=0.30, help="connector distance [m]")
    parser.add_argument("--starts", type=int, default=3, help="most starts of each topology")
    parser.add_argument("--cap", type=int, default=600, help="most CPU seconds of each topology")
    given = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"  # for the children, which measure
    settings = experiment("scaling").full.override(
        tasks=tuple((task, tuple(given.sizes)) for task in given.tasks),
        topologies=(given.topologies, given.topologies),
        distances=(given.distance,),
        starts=given.starts,
        time_limit=float(given.cap),
    )
    command = (
        f"python tests/benchmarks/direct_scaling.py --tasks {' '.join(given.tasks)} "
        f"--sizes {' '.join(map(str, given.sizes))} --topologies {given.topologies} --distance {given.distance} "
        f"--starts {given.starts} --cap {given.cap}"
    )
    with Results.open(given.out, identify(experiment("scaling").name, settings.as_json(), command)) as rows:
        for cell in experiment("scaling").cells(settings):
            if not rows.has(cell):
                rows.add(measured(cell, given.cap))


def measured(cell: Cell, cap: int) -> CellResult:
    """Return the row of one topology."""
    overrides = (*cell.variant.overrides, f"module.connector_distance={cell.distance_m}")
    stated = Stated(cell.task, cell.n, (*overrides, f"task_seed={cell.task_seed}"))
    row = CellResult(**cell.identity, status="infeasible", method=METHOD)
    with Child(attempts, METHOD, "ours", stated, [cell.key], range(cell.settings.starts), cap=cap) as child:
        while row.status == "infeasible" and (answer := next(child, None)) is not None:
            row = _with(row, answer)
    if not row.starts:
        return replace(row, status="failed", worst_constraint=f"no start ended within {cap} CPU seconds")
    return row


def _with(row: CellResult, answer: Row) -> CellResult:
    """Return a row with one more start."""
    spent = replace(
        row,
        starts=row.starts + 1,
        build_s=round((row.build_s or 0.0) + answer["build"], 4),
        solve_s=round(row.solve_s + answer["draw"] + answer["solve"], 4),
        iterations=row.iterations + answer["iterations"],
        peak_mb=round(answer["peak_mb"], 1),
    )
    if answer["J"] is None:
        missed = {"worst_constraint": answer["missed"], "violation": answer["by"], "unit": answer["unit"]}
        return replace(spent, **missed)
    return replace(
        spent, status="feasible", objective=answer["J"], worst_constraint=None, violation=None, unit=None
    )


if __name__ == "__main__":
    main()

"""Rows of experiments, as they are read from a file."""

import csv
import tempfile
from dataclasses import astuple
from pathlib import Path

from topo_search.experiments import results
from topo_search.experiments.conducting import COLUMNS, CellResult


def frame(*rows):
    """Rows as they are read from a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "results.csv"
        with path.open("w", newline="") as stream:
            csv.writer(stream).writerows([COLUMNS, *map(astuple, rows)])
        return results(path)


def measured(n, *, status="feasible", task="ten-wrenches", variant="airflow", key="a300", **values):
    clear = {"verdict": "clear"} if status == "feasible" else {}
    return CellResult(
        variant=variant,
        task=task,
        distance_m=values.pop("distance_m", 0.3),
        n=n,
        key=key,
        task_seed=0 if task.startswith("ten-wrenches") else None,
        status=status,
        **{**clear, **values},
    )

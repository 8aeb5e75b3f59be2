"""Rows of experiments, as they are read from a file."""

import csv
import tempfile
from pathlib import Path

from topo_search.experiments import results
from topo_search.experiments.study import COLUMNS, METHOD


def frame(*rows):
    """Rows as they are read from a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "results.csv"
        with path.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)
        return results(path)


def measured(n, *, status="feasible", task="ten-wrenches", variant="airflow", key="a300", **values):
    row = {"variant": variant, "task": task, "distance_m": 0.3, "n": n, "key": key, "status": status}
    row |= {"task_seed": 0 if task.startswith("ten-wrenches") else None, "method": METHOD, "starts": 0}
    row |= {"solve_s": 0.0, "iterations": 0, "verdict": "clear" if status == "feasible" else None}
    return row | values

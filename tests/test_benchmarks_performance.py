import importlib
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import pytest

from topo_search.experiments import experiment, results

SMALLEST = ["--sizes", "3", "--topologies", "1", "--starts", "1", "--seconds", "0.1", "--cap", "1"]
SMALLEST += ["--distances", "0.22", "--examples", "ten-wrenches"]
PARTS = ["five", "shared", "random", "share", "hundred", "growth"]


class InProcess:
    """Stands in for the child processes of the measurements where they are not what is tested."""

    def __init__(self, measurement: Any, *args: Any, cap: float = 60.0) -> None:
        self.rows: Iterator[dict[str, Any]] = measurement(*args)
        next(self.rows)
        self.end, self.capped = time.process_time() + cap, False

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> dict[str, Any]:
        row = next(self.rows)
        self.capped = time.process_time() > self.end
        if self.capped:
            raise StopIteration
        return {"peak_mb": 1.0, **row}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass


def test_every_benchmark_loads(benchmarks: Path) -> None:
    for path in benchmarks.glob("*.py"):
        importlib.import_module(path.stem)


@pytest.mark.slow
def test_every_part_measures_once_and_prints_its_table(
    benchmarks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rows.jsonl"
    monkeypatch.setattr(importlib.import_module("children"), "Child", InProcess)
    monkeypatch.setattr(sys, "argv", ["performance.py", *PARTS, *SMALLEST, "--out", str(out)])
    performance = importlib.import_module("performance")
    performance.main()
    printed, rows = capsys.readouterr().out, out.read_text().splitlines()
    assert {json.loads(row)["part"] for row in rows} == set(PARTS)
    assert all(f"\n{part}\n\n|" in printed for part in PARTS)
    performance.main()
    assert capsys.readouterr().out == printed
    assert out.read_text().splitlines() == rows


def test_the_direct_formulation_s_rows_are_those_of_the_scaling_study(
    benchmarks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "direct"
    small = ["--sizes", "3", "--topologies", "2", "--starts", "1", "--cap", "60"]
    monkeypatch.setattr(sys, "argv", ["direct_scaling.py", "--out", str(out), *small])
    measure = importlib.import_module("direct_scaling").main
    measure()
    rows = results(out)
    asked = experiment("scaling")
    planned = asked.cells(replace(asked.full, tasks=(("ten-wrenches", (3,)),), topologies=(2, 2)))
    assert list(rows["key"]) == [cell.key for cell in planned]
    assert list(rows["task_seed"]) == [cell.task_seed for cell in planned]
    assert set(rows["method"]) == {"direct"}
    assert set(rows["status"]) <= {"feasible", "infeasible"}
    assert (rows["build_s"] > 0).all()
    about = json.loads((out / "about.json").read_text())
    assert about["command"].split()[1:] == [
        "tests/benchmarks/direct_scaling.py",
        *("--tasks", "ten-wrenches", "--sizes", "3", "--topologies", "2"),
        *("--distance", "0.3", "--starts", "1", "--cap", "60"),
    ]
    before = (out / "results.csv").read_bytes()
    measure()
    assert (out / "results.csv").read_bytes() == before

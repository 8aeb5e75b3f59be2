import json
import subprocess
import sys
from pathlib import Path

import pytest

from topo_search.experiments import experiment, results

COMMAND = Path(__file__).parent / "benchmarks" / "performance.py"
SMALLEST = ["--sizes", "3", "--topologies", "1", "--starts", "1", "--seconds", "0.1", "--cap", "1"]
SMALLEST += ["--distances", "0.22", "--examples", "ten-wrenches"]

LOAD = """
import importlib, sys
from pathlib import Path
sys.path[:0] = sys.argv[1:]
for path in sorted(Path(sys.argv[1]).glob("*.py")):
    importlib.import_module(path.stem)
"""


def test_every_benchmark_loads() -> None:
    subprocess.run([sys.executable, "-c", LOAD, str(COMMAND.parent), str(COMMAND.parents[1])], check=True)


@pytest.mark.parametrize("parts", [["five", "shared", "random"], ["share", "hundred", "growth"]])
def test_every_part_measures_once_and_prints_its_table(parts: list[str], tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    command = [sys.executable, str(COMMAND), *parts, *SMALLEST, "--out", str(out)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rows = out.read_text().splitlines()
    assert {json.loads(row)["part"] for row in rows} == set(parts)
    assert all(f"\n{part}\n\n|" in printed for part in parts)
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == printed
    assert out.read_text().splitlines() == rows


def test_the_direct_formulation_s_rows_are_those_of_the_scaling_study(tmp_path: Path) -> None:
    out = tmp_path / "direct"
    command = [sys.executable, str(COMMAND.with_name("direct_scaling.py")), "--out", str(out)]
    command += ["--sizes", "3", "--topologies", "2", "--starts", "1", "--cap", "60"]
    subprocess.run(command, check=True)
    rows = results(out)
    asked = experiment("scaling")
    planned = asked.cells(asked.full.override(tasks=(("ten-wrenches", (3,)),), topologies=(2, 2)))
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
    subprocess.run(command, check=True)
    assert (out / "results.csv").read_bytes() == before

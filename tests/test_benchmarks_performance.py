import json
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = Path(__file__).parent / "benchmarks" / "performance.py"
SMALLEST = ["--sizes", "3", "--topologies", "1", "--starts", "1", "--seconds", "0.1", "--cap", "1"]
SMALLEST += ["--distances", "0.22", "--examples", "ten-wrenches"]


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

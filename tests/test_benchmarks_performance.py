import json
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = Path(__file__).parent / "benchmarks" / "performance.py"
SMALLEST = {
    "five": ["--modules", "3", "--seconds", "0.1"],
    "shared": ["--sizes", "3", "--topologies", "1", "--starts", "2"],
}


@pytest.mark.parametrize("part", SMALLEST)
def test_a_small_run_measures_both_methods_and_is_not_measured_again(part: str, tmp_path: Path) -> None:
    command = [sys.executable, str(COMMAND), part, *SMALLEST[part], "--out", str(tmp_path / "rows.jsonl")]
    first = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rows = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert {row["part"] for row in rows} == {part}
    assert first.startswith(f"\n{part}\n\n|")
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == first
    assert len((tmp_path / "rows.jsonl").read_text().splitlines()) == len(rows)

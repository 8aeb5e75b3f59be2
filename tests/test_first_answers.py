"""Tasks as people write them: first answers hold the defaults of flying tasks and fly, or say what they miss."""

from pathlib import Path

import pytest
from suites import few

from topo_search import read_task, search
from topo_search.report.task_warnings import task_warnings
from topo_search.simulation.campaign import fly_all
from topo_search.simulation.fly import Options

TASKS = {path.stem: path for path in sorted((Path(__file__).parent / "tasks").glob("*.toml"))}
FRAGILE = {"drill", "plug", "sensor"}
"""Tasks whose defaults no design of three modules holds: a wall keeps out the air of a heavy tool's platform."""


@pytest.mark.parametrize("name", few(sorted(TASKS), {"camera", "cart"}))
def test_the_first_answer_flies_or_says_what_it_misses(name: str, tmp_path: Path, in_process: None) -> None:
    answer = search(read_task(TASKS[name], ("modules=3",)), out=tmp_path / "run", starts=4)
    assert answer.exit_status == 0
    assert answer.audit.verdict == "clear"
    assert bool(answer.fragile) is (name in FRAGILE)
    if not answer.fragile:
        assert fly_all(answer.design, Options()).result.outcome == "recovered"


@pytest.mark.parametrize("name", sorted(TASKS))
def test_nothing_is_odd_about_them(name: str) -> None:
    assert [warning.path for warning in task_warnings(read_task(TASKS[name]))] == []

"""The referee: designs of any program judged by a shipped task."""

import json
from pathlib import Path
from typing import Any

import pytest
from commands import invoke

from topo_search.compose.binding import BACKENDS
from topo_search.compose.referee import best_known, judge, tightest_bound
from topo_search.model.largest_value import objective_of
from topo_search.model.task_file import read_task

DESIGNS = Path(__file__).parent / "designs"
BEST = Path(__file__).parents[1] / "topo_search/examples/best"
FOREIGN = [
    "format",
    "version",
    "topology",
    "root_orientation_rad",
    "hinge_angles_rad",
    "end_effector_m",
    "rotor_speeds_squared",
]


@pytest.fixture
def data() -> dict[str, Any]:
    """A design for push, as another program may write it."""
    whole = json.loads((DESIGNS / "push-a70010.json").read_text(encoding="utf-8"))
    return {name: whole[name] for name in FOREIGN}


def judged(data: Any, folder: Path, *words: str, status: int) -> str:
    """Return the command's output for a design of push."""
    (file := folder / "mine.json").write_text(json.dumps(data), encoding="utf-8")
    result = invoke("audit", "--against", "push", file, *words, status=status)
    return result.output


def test_a_design_of_another_program_is_judged_by_the_named_task(data: dict[str, Any], tmp_path: Path) -> None:
    own = judge(json.loads((DESIGNS / "push-a70010.json").read_text()), "own", "push", read_task("push"))
    told = json.loads(judged(data, tmp_path, "--json", status=0))
    assert told["verdict"] == "clear"
    assert told["objective"] == pytest.approx(own.design.objective)
    assert told["bound"] < told["best_known"] <= told["objective"] * (1 + 1e-6)
    assert told["best_known_key"] == "a70010"
    assert "the best known, a70010" in judged(data, tmp_path, status=0)


def test_the_task_of_a_file_does_not_count(data: dict[str, Any], tmp_path: Path) -> None:
    """A design that claims an easier task, and an effort of its own, is judged all the same."""
    task = json.loads((DESIGNS / "push-a70010.json").read_text(encoding="utf-8"))["task"]
    easier = {**data, "task": {**task, "load_cases": task["load_cases"][:1]}, "objective": 1.0}
    told = json.loads(judged(easier, tmp_path, "--json", status=0))
    assert told["objective"] > 1e14


def test_inputs_that_are_left_out_are_computed(data: dict[str, Any], tmp_path: Path) -> None:
    del data["rotor_speeds_squared"]
    told = json.loads(judged(data, tmp_path, "--json", status=0))
    assert told["inputs_computed"] is True


@pytest.mark.parametrize(
    ("change", "status", "words"),
    [
        ({"hinge_angles_rad": [0.1, 0.2, 0.3, 0.4]}, 1, "violated"),
        ({"topology": [[-1, -1, -1], [0, 0, 2]], "hinge_angles_rad": [0.1]}, 2, "must have 5 modules"),
        ({"rotor_speeds_squared": [[1.0] * 20]}, 2, "must have a row for each of the 3 load cases"),
        ({"rotor_speeds_squared": [[1.0] * 3] * 3}, 2, "rotor_speeds_squared"),
        ({"rotor_speeds_squared": [[1e300] * 20] * 3}, 2, "must have a finite control effort"),
        ({"end_effector_m": "up"}, 2, "end_effector_m"),
        ({"format": "other"}, 2, "format"),
    ],
)
def test_what_is_no_design_of_the_task_is_told(
    data: dict[str, Any], tmp_path: Path, change: dict[str, Any], status: int, words: str
) -> None:
    assert words in " ".join(judged({**data, **change}, tmp_path, status=status).split())


def test_a_file_that_is_none_is_refused_and_the_others_are_judged(data: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "none.json").write_text("[1, 2]", encoding="utf-8")
    (tmp_path / "mine.json").write_text(json.dumps(data), encoding="utf-8")
    told = invoke("audit", "--against", "push", tmp_path / "none.json", tmp_path / "mine.json", status=2).output
    assert "a JSON object" in told
    assert "mine.json: clear" in told


@pytest.mark.parametrize("name", ["push", "strongest", "wall-push", "h-modquad-twelve"])
def test_shipped_designs_are_clear_and_have_the_number_that_they_state(name: str) -> None:
    task = read_task(name)
    known = best_known(name, task.sizes[0])
    assert known is not None
    found = judge(json.loads(known.model_dump_json()), name, name, task)
    rated = objective_of(known.task)
    assert found.audit.verdict == "clear"
    assert rated.number(found.design) == pytest.approx(rated.number(known), rel=1e-6)
    assert not rated.breaks(found.design, found.bound)


def test_best_known_designs_keep_the_bounds_of_branch_and_bound() -> None:
    """No shipped design beats the bound that is shipped with it, which is no less than the one in closed form."""
    for file in sorted(path.stem for path in BEST.glob("*.json")):
        name, _, n = file.rpartition("-")
        known = best_known(name, int(n))
        assert known is not None
        if known.lower_bound is not None:
            task = read_task(name, (f"modules={n}",)).resolve(int(n))
            closed_form = BACKENDS.lower_bound(task.with_closures(len(known.topology.closures)))
            assert closed_form <= tightest_bound(known, closed_form) <= known.objective
    wall_push = best_known("wall-push", 3)
    assert wall_push is not None
    assert wall_push.gap is not None
    assert wall_push.gap < 0.06

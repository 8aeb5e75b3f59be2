"""What `check`, `fly`, `capability` and `airflow` return in Python: the values that their commands print."""

import json
import warnings

import numpy as np
import pytest
from commands import invoke
from toy_problem import BACKENDS, InProcess, toy_run, toy_task
from vehicle_cases import star

import topo_search as ts
import verify
from topo_search.compose import binding
from topo_search.model.files import to_json, to_toml
from topo_search.model.task_file import examples
from topo_search.study import Solved


def test_a_check_is_the_text_of_the_command_and_a_table(tmp_path) -> None:
    task = ts.read_task("push", ("module.mass=40.0",))
    (tmp_path / "heavy.toml").write_text(to_toml(task))
    checked = ts.check(task)
    assert str(checked) == invoke("check", str(tmp_path / "heavy.toml")).stdout.rstrip("\n")
    assert checked.warnings
    assert len(repr(checked)) < 100
    assert checked.warnings[0].words.split(";")[0] in checked._repr_html_()


def test_python_warns_of_each_suspicious_value_that_is_read_and_searched_once(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(binding, "backends", lambda _: BACKENDS)
    monkeypatch.setattr(binding, "open_engine", lambda *_: InProcess(1))
    odd = toy_task(2).replace(gravity=9.7)
    (tmp_path / "odd.toml").write_text(to_toml(odd))
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("default", ts.SuspiciousTask)
        ts.search(ts.read_task(tmp_path / "odd.toml"), out=tmp_path / "run", starts=np.int64(1), seed=np.int64(0))
    assert [str(warning.message) for warning in shown] == [*map(str, ts.check(odd).warnings)] != []
    with pytest.warns(ts.SuspiciousTask, match="^gravity: "):
        ts.search(odd, out=tmp_path / "run", starts=1)


def test_commands_give_warnings_as_lines(run_toy, tmp_path, in_process) -> None:
    (tmp_path / "toy.toml").write_text(to_toml(toy_task(2).replace(gravity=9.7)))
    warned = [f"warning: {warning}" for warning in ts.check(tmp_path / "toy.toml").warnings]
    with warnings.catch_warnings(action="error", category=ts.SuspiciousTask):
        for command in (run_toy, lambda *words: invoke("kit", "toy.toml", *words)):
            printed = command("--out", tmp_path / command.__repr__()[1:5]).stderr.splitlines()
            assert [line for line in printed if line.startswith("warning")] == warned != []


def test_a_task_and_a_comparison_are_tables(wall_press, tmp_path) -> None:
    html = ts.read_task("push", ("gravity=9.7",))._repr_html_()
    assert "<td>gravity</td><td>9.7</td>" in html
    assert "<td>air_density</td>" not in html
    (tmp_path / "wall.json").write_text(to_json(wall_press))
    toy_run(tmp_path / "run")
    compared = ts.compare(tmp_path / "wall.json", tmp_path / "run")
    assert repr(compared).startswith("wall (1 design) and ")
    assert len(repr(compared)) < 100
    assert "<th>figure</th><th>wall</th>" in compared._repr_html_()
    assert "<td>Control effort</td>" in compared._repr_html_()


def test_air_is_that_of_the_command() -> None:
    air = ts.airflow(ts.read_task("push-local"), speed=2, at=2.0)
    printed = json.loads(invoke("airflow", "push-local", "--speed", "2", "--at", "2", "--json").stdout)
    assert air.smallest.volume_m3 == printed["volume_m3"]
    assert air.present.end_m_s == printed["end_m_s"]
    assert repr(air) == invoke("airflow", "push-local", "--speed", "2", "--at", "2").stdout.rstrip("\n")


def test_no_value_prints_more_than_2000_characters(wall_press, tmp_path) -> None:
    answer, audited = toy_run(tmp_path / "run", modules=(2, 3)), verify.audit(wall_press)
    flown = ts.fly(wall_press, only=("hover",), wake=False)
    task = ts.read_task("push").replace(modules=(2, 3))
    values = [answer, answer.sizes[0], answer.best, answer.design, answer.audit, Solved(wall_press, audited, ())]
    values += [wall_press, wall_press.task, audited, audited.flight, *audited.pairs, flown, task]
    values += [wall_press.topology, *map(ts.read_task, examples()), ts.capability(star(0.4))]
    assert max(len(text(value)) for value in values for text in (repr, str)) <= 2000
    assert len(repr(answer).splitlines()) == 3
    assert repr(answer.sizes[1]).startswith("3 modules: ")
    assert repr(task.replace(gravity=9.8)).count("gravity=9.8") == 1 + repr(task).count("gravity=9.8")


@pytest.mark.parametrize(("speed", "at", "named"), [(0, "hover", "speed"), (2, 9, "at"), (2, "no", "at")])
def test_air_of_values_out_of_range_is_refused(speed, at, named) -> None:
    with pytest.raises(ts.BadInput, match=f"{named}: must be"):
        ts.airflow(speed=speed, at=at)


def test_a_flight_is_that_of_the_command(wall_press, tmp_path) -> None:
    (tmp_path / "wall.json").write_text(to_json(wall_press))
    flown = ts.fly(wall_press, only=("hover",), wake=False, seed=3, out=tmp_path / "flight")
    printed = json.loads(
        invoke("fly", str(tmp_path / "wall.json"), "--only", "hover", "--no-wake", "--seed", "3", "--json").stdout
    )
    assert flown.model_dump(mode="json") == printed
    assert json.loads((tmp_path / "flight/flight.json").read_text()) == printed


@pytest.mark.parametrize(
    "given", [{"noise": -1}, {"model_error": 0.6}, {"detection_time": 11}, {"allocator": "lsq"}]
)
def test_a_flight_with_values_out_of_range_is_refused(wall_press, given) -> None:
    with pytest.raises(ts.BadInput, match=f"{next(iter(given))}: must be .*, but got"):
        ts.fly(wall_press, **given)

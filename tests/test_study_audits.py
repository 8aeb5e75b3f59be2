import itertools
import sqlite3
import tomllib
from contextlib import closing
from dataclasses import replace

import pytest
import toy_problem
from ledger_edit import altered
from processes import table
from toy_problem import toy_run, toy_solved, toy_task

from topo_search.cli.tables import answer_lines
from topo_search.model import Assembly, BadInput, BoltedJoint, Clearance, Design, Status, Task, Tolerances
from topo_search.model.files import read_json
from topo_search.model.flying import with_older_defaults
from topo_search.model.reserves import AskedFlight
from topo_search.study.folder import RunFolder
from topo_search.study.request import LARGER_MARGINS, margins


def keys_by_rank(tmp_path, modules=3):
    toy_run(tmp_path / "plain", modules=modules)
    return list(table(tmp_path / "plain"))


def solved(path, key, columns):
    """Records of a candidate in the ledger, one for each margin."""
    with closing(sqlite3.connect(path / "ledger.sqlite")) as database:
        query = f"SELECT {columns} FROM candidates WHERE key = ? ORDER BY margin"
        return list(database.execute(query, (key,)))


def margins_of(path, key):
    return [margin for (margin,) in solved(path, key, "margin")]


def test_a_design_that_fails_is_solved_again_with_a_larger_margin_and_ranked_anew(tmp_path, monkeypatch):
    keys = keys_by_rank(tmp_path)
    monkeypatch.setenv("TOY_VIOLATED", keys[0])
    monkeypatch.setenv("TOY_MARGIN", "1e-2")
    answer = toy_run(tmp_path / "run")
    rows = table(tmp_path / "run")
    assert margins_of(tmp_path / "run", keys[0]) == [1e-4, 1e-3, 1e-2]
    again = read_json(Design, tmp_path / "run" / "designs" / f"{keys[0]}.json")
    assert again.task.search.margin == 1e-2
    assert float(rows[keys[0]]["objective"]) == again.objective > float(rows[keys[1]]["objective"])
    assert rows[keys[0]]["audit"] == "clear"
    assert answer.best.key == keys[1]
    assert answer.sizes[0].remarks == ("1 design solved again with a larger margin, as the audit was not clear",)


@pytest.mark.parametrize(("neighbour", "attempts"), [(0, 1), (1, 1), (2, 4)])
def test_a_bracket_that_does_not_fit_its_own_joint_is_named_and_not_solved_again(tmp_path, neighbour, attempts):
    """The solver leaves brackets out: a margin moves only other modules away from them."""
    pair = {"kind": "bracket-airflow", "a": 1, "b": neighbour, "segment": None, "status": "violated"}
    clearance = Clearance(**pair, lower_m=None, upper_m=-0.01, analytic_m=-0.01, level=0)
    joint = BoltedJoint(module=0, port=0, child=1, child_port=2, angle_deg=0.0)

    def audit(design):
        sheet = Assembly(joints=(joint,))
        return toy_problem.audit(design).model_copy(
            update={"verdict": Status.VIOLATED, "pairs": (clearance,), "assembly": sheet}
        )

    answer = toy_run(tmp_path / "run", backends=replace(toy_problem.BACKENDS, audit=audit))
    assert {len(margins_of(tmp_path / "run", key)) for key in table(tmp_path / "run")} == {attempts}
    assert answer.complete
    assert answer.exit_status == 1
    name = f"the bracket of module 1 and airflow of module {neighbour}"
    assert name in answer.sizes[0].failure
    assert f"{answer.sizes[0].top[0].key}: {name}" in list(answer_lines(answer))[-2]


def test_a_design_that_never_passes_is_passed_over_visibly(tmp_path, monkeypatch):
    keys = keys_by_rank(tmp_path)
    monkeypatch.setenv("TOY_VIOLATED", keys[0])
    answer = toy_run(tmp_path / "run")
    assert margins_of(tmp_path / "run", keys[0]) == [1e-4, 1e-3, 1e-2, 1e-1]
    assert table(tmp_path / "run")[keys[0]]["audit"] == "violated"
    assert answer.best.key == keys[1]
    assert answer.exit_status == 0
    assert any(
        keys[0] in remark and "skipped, its audit is violated" in remark for remark in answer.sizes[0].remarks
    )


def test_audits_go_down_the_ranking_until_one_is_clear(tmp_path, monkeypatch):
    four = keys_by_rank(tmp_path, modules=4)
    monkeypatch.setenv("TOY_VIOLATED", ",".join(four[:12]))
    answer = toy_run(tmp_path / "run", modules=4)
    rows = table(tmp_path / "run")
    assert answer.best.key == four[12]
    assert {rows[key]["audit"] for key in four[:12]} == {"violated"}


def test_none_that_passes_is_status_one(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_VIOLATED", "*")
    answer = toy_run(tmp_path / "run")
    assert answer.exit_status == 1
    assert {row["audit"] for row in table(tmp_path / "run").values()} == {"violated"}
    assert not (tmp_path / "run" / "best.json").exists()
    assert toy_run(tmp_path / "run") == answer


def test_an_audit_that_crashes_passes_over_its_design_alone(tmp_path, monkeypatch):
    keys = keys_by_rank(tmp_path)
    monkeypatch.setenv("TOY_AUDIT_SEGFAULT", keys[0])
    answer = toy_run(tmp_path / "run", workers=1)
    assert answer.best.key == keys[1]
    assert table(tmp_path / "run")[keys[0]]["audit"] == ""
    assert any("its audit failed" in remark and "SIGSEGV" in remark for remark in answer.sizes[0].remarks)
    assert toy_run(tmp_path / "run", workers=1) == answer
    monkeypatch.delenv("TOY_AUDIT_SEGFAULT")
    assert toy_run(tmp_path / "run").best.key == keys[0]  # the next call tries it again


def test_a_margin_of_zero_is_raised_too():
    task = toy_task(3).with_fields("search", margin=0.0)
    assert margins(task.resolve(3)) == pytest.approx([0.0, 1e-4, 1e-3, 1e-2])


def test_the_base_row_of_a_design_keeps_its_own_audit(tmp_path, monkeypatch):
    keys = keys_by_rank(tmp_path)
    monkeypatch.setenv("TOY_VIOLATED", keys[0])
    monkeypatch.setenv("TOY_MARGIN", "1e-3")
    toy_run(tmp_path / "run")
    rows = solved(tmp_path / "run", keys[0], "margin, audit, standing")
    assert rows == [(1e-4, "violated", 0), (1e-3, "clear", 1)]


def test_after_the_time_limit_nothing_is_solved_again_but_audits_go_on(tmp_path, monkeypatch):
    toy_run(tmp_path / "run", modules=4)
    keys = list(table(tmp_path / "run"))
    monkeypatch.setenv("TOY_VIOLATED", ",".join(keys[:10]))
    altered(tmp_path / "run", "UPDATE candidates SET audit = NULL, audit_checksum = NULL")
    answer = toy_run(tmp_path / "run", modules=4, time_limit=1e-9)
    assert answer.best.key == keys[10]
    assert margins_of(tmp_path / "run", keys[0]) == [1e-4]
    assert not answer.sizes[0].complete
    answer = toy_run(tmp_path / "run", modules=4)
    assert margins_of(tmp_path / "run", keys[0]) == [1e-4, 1e-3, 1e-2, 1e-1]
    assert answer.sizes[0].complete


def tolerant(modules=3, **flight):
    task = toy_task(modules).model_dump()
    return Task.model_validate({**task, "flight": flight, "tolerances": {"hinge_angle_deg": 0.2}})


def test_tolerances_of_a_new_task_are_required_however_it_is_made():
    plain, tight = toy_task(3).model_dump(), Tolerances(position=1e-3)
    assert toy_task(3).flight.tolerances is None
    for flight in ({}, {"flight": {}}, {"flight": AskedFlight()}, {"flight": AskedFlight(force_reserve=0.1)}):
        for given in (tight, {"position": 1e-3}):
            task = Task.model_validate({**plain, **flight, "tolerances": given})
            assert task.flight.tolerances is True
            assert task.resolve(3).model_dump()["flight"]["tolerances"] is True
        assert Task.model_validate({**plain, **flight, "tolerances": Tolerances()}).flight.tolerances is None
    for flight in ({"tolerances": False}, AskedFlight(tolerances=False)):
        task = Task.model_validate({**plain, "flight": flight, "tolerances": tight})
        assert task.flight.tolerances is False
        assert task.resolve(3).model_dump()["flight"]["tolerances"] is False


def test_a_folder_keeps_whether_its_task_requires_tolerances(tmp_path):
    """Those of before they were required by default say nothing, and stay what they were."""
    data = {**toy_task(3).model_dump(), "tolerances": {"hinge_angle_deg": 0.2}}
    older = Task.model_validate(with_older_defaults(data))
    for name, task, stated in (
        ("older", older, None),
        ("new", tolerant(), True),
        ("no", tolerant(tolerances=False), False),
    ):
        toy_run(tmp_path / name, task=task)
        written = tomllib.loads((tmp_path / name / "task.toml").read_text())
        assert written.get("flight", {}).get("tolerances") is stated
        with RunFolder.load(tmp_path / name) as folder:
            assert folder.request.task == task
            assert len(folder.request.contexts(3)) == (len(margins(tolerant().resolve(3))) if stated else 4)
    with pytest.raises(BadInput, match="holds another task"):
        toy_run(tmp_path / "older", task=tolerant())


def test_the_last_lines_say_what_tolerances_that_are_only_measured_leave(tmp_path, monkeypatch, capsys):
    keys = keys_by_rank(tmp_path)
    monkeypatch.setenv("TOY_LOSS", "5e-5")
    answer = toy_run(tmp_path / "run", task=tolerant(tolerances=False))
    print(*answer_lines(answer), sep="\n")
    words = f"{keys[0]}: within the task's tolerances: clear, smallest clearance 5e-05 m or more"
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith(words)
    assert last.endswith("; measured, not required")


def test_a_task_that_must_survive_its_tolerances_has_margins_close_to_each_other():
    found = margins(tolerant(3).resolve(3))
    assert found[0] == 1e-4
    assert found == sorted(found)
    assert all(after / before < 1.25 * 1.001 for before, after in itertools.pairwise(found[1:]))
    assert found[1] < 1e-3 < 0.02 < found[-1]
    assert margins(toy_task(3).resolve(3)) == pytest.approx([1e-4, 1e-3, 1e-2, 1e-1])


def test_the_next_margin_makes_up_for_the_clearance_that_errors_cost(tmp_path, monkeypatch):
    keys = keys_by_rank(tmp_path)
    monkeypatch.setenv("TOY_LOSS", "5e-3")
    answer = toy_run(tmp_path / "run", task=tolerant())
    own, needed = margins_of(tmp_path / "run", keys[0])
    assert own == 1e-4
    assert 5e-3 <= needed < 5e-3 * 1.25
    assert answer.best.key == keys[0]
    assert answer.sizes[0].complete
    assert toy_run(tmp_path / "run", task=tolerant()) == answer


def test_one_topology_gets_the_margins_that_it_gets_in_a_run(tmp_path, monkeypatch):
    keys = keys_by_rank(tmp_path)
    monkeypatch.setenv("TOY_LOSS", "5e-3")
    toy_run(tmp_path / "run", task=tolerant())
    found = toy_solved(keys[0], tolerant(), starts=2)
    assert found.found
    assert found.design.task.search.margin == margins_of(tmp_path / "run", keys[0])[-1]
    assert found.notes == ("the audit of the design with margin 0.0001 m is undecided",)


def test_margins_are_raised_a_few_times_at_most(tmp_path, monkeypatch):
    keys = keys_by_rank(tmp_path)
    monkeypatch.setenv("TOY_VIOLATED", keys[0])
    answer = toy_run(tmp_path / "run", task=tolerant())
    assert len(margins_of(tmp_path / "run", keys[0])) == 1 + LARGER_MARGINS
    assert answer.best.key == keys[1]
    assert answer.sizes[0].complete

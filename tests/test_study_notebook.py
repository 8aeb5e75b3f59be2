"""What answers, designs and audits show in a notebook."""

import base64
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
from toy_problem import toy_run, toy_solved, toy_task
from verify_cases import changed, fan

import topo_search
from topo_search import Picture, figure, plot_candidates, plot_front, plot_history, read_answer
from topo_search.model import BadInput
from topo_search.model.proven import gap_percent, lower_text
from topo_search.study import Solved
from topo_search.study.columns import kind_of
from topo_search.study.ledger import FLIGHT
from verify import audit


def tables(value: Any) -> list[list[list[str]]]:
    """The rows of each table that a value shows; it must be well-formed."""
    page = ElementTree.fromstring(f"<div>{value._repr_html_()}</div>")
    return [[[cell.text or "" for cell in row] for row in shown.iter("tr")] for shown in page.iter("table")]


def cells(value: Any) -> list[list[str]]:
    """The rows of all tables that a value shows."""
    return [row for shown in tables(value) for row in shown]


def words(value: Any) -> str:
    return "".join(ElementTree.fromstring(f"<div>{value._repr_html_()}</div>").itertext())


def test_an_answer_shows_its_ranking_and_holds_its_best(tmp_path) -> None:
    answer = toy_run(tmp_path / "run", modules=(2, 3))
    (head, *rows), (near_head, *near) = tables(answer.sizes[1])
    assert head == ["key", "J [rad^4/s^4]", "gap", "symmetric copies", "audit"]
    assert near_head == ["key", "J [rad^4/s^4]", *FLIGHT]
    assert [row[0] for row in near] == [row.key for row in answer.sizes[1].near_ties]
    assert [row[0] for row in rows] == [row.key for row in answer.sizes[1].top]
    assert [row[2] for row in rows] == [gap_percent(row.gap) for row in answer.sizes[1].top]
    assert "modules: 2" in words(answer)
    assert "180 deg" in words(answer)
    assert str(tmp_path / "run") in words(answer)
    assert answer.design.topology.key == answer.best.key
    assert answer.audit.verdict == "clear"


def test_an_answer_without_a_design_says_why(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("TOY_NONE", "*")
    answer = toy_run(tmp_path / "run")
    assert cells(answer) == []
    assert "no start of 4 candidates led to a design" in words(answer)
    assert answer.design is None
    assert answer.audit is None


def test_the_kind_of_a_constraint_has_no_module_numbers():
    assert kind_of("airflow of modules 10 and 3") == "airflow of two modules"
    assert kind_of("rotors of module 1 and airflow of module 12") == "rotors of a module and airflow of a module"
    assert kind_of("load case 2, force") == "load case 2, force"


def test_an_answer_knows_what_its_candidates_miss_and_when_each_was_solved(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("TOY_NONE", "*")
    answer = toy_run(tmp_path / "run")
    rows = answer.candidates.set_index("key")
    missed = answer.shortfalls.groupby("key")
    assert missed.starts.sum().to_dict() == rows.starts.to_dict()
    closest = answer.shortfalls.loc[missed.violation.idxmin()].set_index("key")
    assert closest.violation.to_dict() == rows.violation.to_dict()
    assert closest.constraint.to_dict() == rows.worst_constraint.to_dict()
    assert [*answer.shortfalls.kind] == [*answer.shortfalls.constraint]  # load cases keep their numbers
    solves = answer.solves
    assert sorted(solves.key) == sorted(rows.index)
    assert solves["at"].is_monotonic_increasing
    assert solves.objective.isna().all()
    monkeypatch.delenv("TOY_NONE")
    found = toy_run(tmp_path / "other")
    assert found.shortfalls.empty
    assert set(found.solves.objective) == set(found.candidates.objective)


def test_a_solved_topology_shows_its_design_and_audit_or_the_reason(monkeypatch) -> None:
    solved = toy_solved("a10")
    assert solved.design is solved.outcome
    assert "audit: clear" in words(solved)
    monkeypatch.setenv("TOY_NONE", "a10")
    assert "the only start misses load case 0, torque by" in words(toy_solved("a10"))
    assert toy_solved("a10").design is None
    monkeypatch.setenv("TOY_NONE", "")
    monkeypatch.setenv("TOY_VIOLATED", "a10")
    assert "the audit of the design with margin 0.0001 m is violated" in words(toy_solved("a10"))


def test_a_design_shows_what_to_bolt_to_what() -> None:
    rows = cells(fan())
    assert rows[0] == ["module", "port", "child", "its port", "hinge angle [deg]"]
    assert rows[1:] == [["0", "+x", "1", "−x", "-34.3775"], ["0", "−x", "2", "+x", "34.3775"]]
    assert "case: 3 modules, a500" in words(fan())


def test_an_audit_shows_all_that_is_not_clear_and_the_tightest_of_the_rest() -> None:
    many = audit(fan())
    assert len(cells(many)) == 1 + min(10, len(many.pairs))
    assert [name[-3:] for name in cells(many)[0][2:]] == ["[m]"] * 3
    assert [row[-1] for row in cells(many)[1:]] == [
        lower_text(d) for d in sorted(pair.analytic_m for pair in many.pairs)[:10]
    ]
    broken = audit(changed(fan(), objective=1.0, hinge_angles_rad=(0.6, -0.6)))
    shown = cells(broken)
    assert shown[1][1] == "violated"
    assert "objective" in {row[0] for row in shown}
    assert "not met:" in words(broken)


def test_text_is_escaped(monkeypatch) -> None:
    solved = toy_solved("a10")
    assert "`a < b` & so on" in words(Solved(solved.outcome, solved.audit, ("`a < b` & so on",)))


def test_a_picture_is_a_png() -> None:
    bundles = [Picture(drawn)._repr_mimebundle_() for drawn in (fan(), toy_task(3))]
    assert all(f"base64,{bundle['image/png']}" in bundle["text/html"] for bundle, _ in bundles)
    assert all(metadata == {"needs_background": "light"} for _, metadata in bundles)
    pictures = {base64.b64decode(bundle["image/png"]) for bundle, _ in bundles}
    assert [picture[:4] for picture in pictures] == [b"\x89PNG"] * 2


def test_a_figure_turns_and_marks_the_closest_pair_of_its_audit() -> None:
    plain, marked = figure(fan()), figure(fan(), audit(fan()))
    assert "plotly" in marked._repr_html_()
    assert len(marked.data) > len(plain.data)


# ---- Plots of an answer show what its frames hold.


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("plots") / "run"
    toy_run(path, task=toy_task((3, 4)))
    return path


def points(figure, name):
    return [list(zip(trace.x, trace.y, strict=True)) for trace in figure.data if trace.name == name]


def test_candidates_of_every_size_are_drawn_by_two_columns(path):
    answer = read_answer(path)
    figure = plot_candidates(answer, x="gap", y="objective")
    for n, rows in answer.candidates.dropna(subset=["objective"]).groupby("modules"):
        assert points(figure, f"{n} modules") == [list(zip(rows["gap"], rows["objective"], strict=True))]
    with pytest.raises(BadInput, match=r"y: must be one of modules, .*, but got audit"):
        plot_candidates(answer, x="gap", y="audit")


@pytest.mark.parametrize("n", [3, 4])
def test_the_history_ends_with_the_best_of_its_size(path, n):
    answer = read_answer(path)
    rows = answer.candidates.query("modules == @n")
    ((*_, (solves, last)),) = points(plot_history(answer, n), "incumbent")
    assert solves == answer.solves["key"].isin(rows["key"]).sum()
    assert last == pytest.approx((rows["objective"] / rows["lower_bound"]).min())
    with pytest.raises(BadInput, match="modules: must be one of 3, 4, but got 5"):
        plot_history(answer, 5)


def test_a_run_without_goals_has_no_front_to_draw(path):
    with pytest.raises(BadInput, match="goal: must be one of none, but got None"):
        plot_front(read_answer(path))


def test_a_front_is_drawn_over_each_goal_that_it_has_figures_for(tmp_path):
    answer = toy_run(tmp_path / "run", task=toy_task().replace(goals={"peak_input": [1.0, 0.9]}))
    figure = plot_front(answer, "peak_input")
    least = answer.front["objective"].min()
    front = sorted(zip(answer.front["peak_input"], answer.front["objective"] / least, strict=True))
    assert np.array(sorted(*points(figure, "designs of the front"))) == pytest.approx(np.array(front))
    assert plot_front(answer).layout.xaxis.title.text
    with pytest.raises(BadInput, match=r"goal: must be one of .*, but got gain"):
        plot_front(answer, "gain")
    assert points(plot_history(answer), "incumbent")
    assert len(plot_candidates(answer, x="gap").data) == 1


def test_only_public_names_are_listed():
    assert sorted(topo_search.__all__) == dir(topo_search)
    assert all(getattr(topo_search, name) is not None for name in dir(topo_search))

"""Runs with goals: a front that nothing dominates, one ordinary search a level, all of it resumable."""

import csv
import itertools
import json
from dataclasses import replace
from operator import le

import pytest
import toy_problem
from commands import invoke
from hypothesis import given, settings
from hypothesis import strategies as st
from older import older_task
from report_cases import Reader
from toy_problem import solved_keys, toy_run, toy_task

from topo_search.cli.tables import answer_lines
from topo_search.compose import search
from topo_search.model import Audit, BadInput, Clearance, Design, LoadCase, Status, Wrench
from topo_search.model.files import read_json
from topo_search.model.goals import GOALS as STEPS
from topo_search.model.goals import Goals, Level
from topo_search.report.page import render
from topo_search.report.run_page import run_page
from topo_search.study import FrontPoint, Row, RunFolder, answer_of, front
from topo_search.study.pareto import FRONT_COLUMNS

LEVELS = (1e-4, 2e-3, 1e-2)
GOALS = Goals(clearance=LEVELS)


def audit(design: Design) -> Audit:
    """What the toy problem reaches: its margin, and for some trees a little more."""
    extra = 3e-3 * (int(design.topology.key, 36) % 3)
    values = {"airflow": design.task.search.margin + extra, "exclusion": 0.25, "body": -1.0}
    pairs = tuple(
        Clearance(kind=kind, a=0, b=1, status=Status.CLEAR, lower_m=0.0, upper_m=1.0, analytic_m=x, level=0)
        for kind, x in values.items()
    )
    return toy_problem.audit(design).model_copy(update={"pairs": pairs})


BACKENDS = replace(toy_problem.BACKENDS, audit=audit)


def goal_run(path, goals=GOALS, **options):
    return toy_run(path, task=toy_task().model_copy(update={"goals": goals}), backends=BACKENDS, **options)


def table(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


# ---- the front itself


def point(J, clearance=0.0, stand_off=0.0, peak=0.5, modules=3, number=0):
    row = Row(
        key="a", modules=modules, orbit=1, status="feasible", asked=1, lower_bound=1.0, objective=J, audit="clear"
    )
    return FrontPoint(row, clearance, stand_off, peak, number, Level(None, None, None))


points = st.lists(
    st.builds(
        lambda J, c, s, u, n: point(1 + J / 100, 0.01 * c, 0.1 * s, 0.1 + 0.1 * u, 1 + n), *[st.integers(0, 6)] * 5
    ),
    max_size=12,
)
names = st.sets(st.sampled_from(["clearance", "stand_off", "peak_input", "modules"])).map(sorted)


@settings(max_examples=40)
@given(points, names)
def test_the_front_is_what_no_other_point_equals_or_betters(given_points, goals):
    """By the definition, on values that differ by much or not at all."""

    def values(each):
        signed = {"clearance": -each.clearance, "stand_off": -each.stand_off}
        signed |= {"peak_input": each.peak_input, "modules": each.row.modules}
        return (each.row.objective, *(signed[name] for name in goals))

    found = front(given_points, goals)
    best = {
        values(p)
        for p in given_points
        if not any(q != p and values(q) != values(p) and all(map(le, values(q), values(p))) for q in given_points)
    }
    assert [values(p) for p in found] == sorted(best)
    assert set(found) <= set(given_points)


@settings(max_examples=60)
@given(st.lists(st.tuples(*[st.floats(0, 4)] * 4), max_size=30))
def test_differences_of_less_than_a_step_are_none(drawn):
    """None of the front covers another within a step, and all that is left out is covered within two."""
    goals = ["clearance", "stand_off", "peak_input"]
    noisy = [
        point(
            1 + 1e-6 * J,
            STEPS["clearance"].step * c,
            STEPS["stand_off"].step * s,
            0.5 + STEPS["peak_input"].step * u,
            number=number,
        )
        for number, (J, c, s, u) in enumerate(drawn)
    ]
    found = front(noisy, goals)
    costs = [p.costs(goals) for p in found]
    for one, other in itertools.permutations(costs, 2):
        assert any(x > y + 1 for x, y in zip(one, other, strict=True))
    for p in noisy:
        assert any(all(x <= y + 2 for x, y in zip(cost, p.costs(goals), strict=True)) for cost in costs)


def test_the_same_design_found_at_several_levels_is_there_once():
    noisy = [point(1 + 1e-9 * k, clearance=5e-3 + 1e-7 * k, number=k) for k in range(5)]
    (only,) = front(noisy[::-1], ["clearance"])
    assert only.number == 0


def test_what_has_nothing_to_keep_clear_of_is_clear_of_everything():
    alone, other = point(1.0, clearance=None), point(1.0, clearance=0.1)
    assert front([other, alone], ["clearance"]) == (alone,)


# ---- runs


def test_an_answer_is_read_at_the_level_of_its_best_design(tmp_path):
    answer = goal_run(tmp_path / "run")
    assert answer.at_level.sizes == answer.levels[answer.points[0].number].sizes
    tightest = answer.levels[-1]
    moved = replace(answer, points=(replace(answer.points[0], number=tightest.number),))
    assert (moved.level, moved.at_level.sizes) == (tightest.number, tightest.sizes)


def test_a_run_with_goals_leaves_a_front_and_a_folder_a_level(tmp_path, log):
    answer = goal_run(tmp_path / "run")
    path = tmp_path / "run"
    rows = table(path / "front.csv")
    assert tuple(rows[0]) == FRONT_COLUMNS
    assert [at.level.clearance for at in answer.levels] == sorted(LEVELS)
    keys = {row["key"] for row in table(path / "levels/0/candidates.csv")}
    assert len(solved_keys(log)) == 3 * len(keys)

    everything = []
    for number, margin in enumerate(sorted(LEVELS)):
        for row in table(path / f"levels/{number}/candidates.csv"):
            design = read_json(Design, path / f"levels/{number}/designs/{row['key']}.json")
            assert design.task.search.margin == margin
            assert float(row["objective"]) == design.objective
            if row["audit"] == "clear":
                everything.append((design.objective, -audit(design).pairs[0].analytic_m))
    best = {p for p in everything if not any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in everything)}
    assert [(float(row["objective"]), -float(row["clearance"])) for row in rows] == sorted(best)
    assert len(best) > 2
    for row in rows:
        design = read_json(Design, path / row["design"])
        assert (design.topology.key, design.objective) == (row["key"], float(row["objective"]))
        assert float(row["level_clearance"]) == design.task.search.margin == sorted(LEVELS)[int(row["level"])]
        assert (row["level_stand_off"], row["level_peak_input"], row["audit"]) == ("", "", "clear")
        assert float(row["stand_off"]) == pytest.approx(0.25 + 0.15)
        u_max = design.task.module.max_input(design.task.gravity)
        assert float(row["peak_input"]) == pytest.approx(design.inputs.max() / u_max)

    assert read_json(Design, path / "best.json").objective == float(rows[0]["objective"])
    assert (answer.exit_status, answer.best.key) == (0, rows[0]["key"])
    assert answer.design == read_json(Design, path / rows[0]["design"])
    assert answer.audit.verdict == "clear"
    frame = answer.front
    assert list(frame.columns) == list(FRONT_COLUMNS)
    assert frame.objective.tolist() == [float(row["objective"]) for row in rows]
    assert sorted(answer.candidates.level.unique()) == [0, 1, 2]
    shown = answer._repr_html_()
    assert f"front of {len(rows)} designs, found at 3 levels" in shown
    assert all(f">{row['key']}<" in shown for row in rows)
    assert len(answer.candidates) == 3 * len(keys)


def test_a_level_is_the_run_of_its_task(tmp_path):
    """The toy problem makes nothing of designs that are carried over, so that every level is a run of its own."""
    goal_run(tmp_path / "front")
    for number, margin in enumerate(LEVELS):
        toy_run(tmp_path / str(number), task=toy_task().at(Level(margin, None, None)), backends=BACKENDS)
        assert (tmp_path / f"front/levels/{number}/candidates.csv").read_text() == (
            tmp_path / f"{number}/candidates.csv"
        ).read_text()


def test_designs_are_carried_over_from_the_level_before(tmp_path, log):
    goal_run(tmp_path / "run")
    for line in log.read_text().splitlines():
        key, margin, _, *near = line.split()
        assert near == ([] if float(margin) == min(LEVELS) else [key])


def test_every_level_has_a_study_of_its_own(tmp_path, log):
    assert goal_run(tmp_path / "run", strategy="optuna", sampler="random", trials=3, starts=1).complete
    assert len(solved_keys(log)) == 3 * 3
    assert len(list((tmp_path / "run").glob("levels/*/study-n3.journal"))) == 3
    seen = set()
    for line in log.read_text().splitlines():
        key, margin, _, *near = line.split()
        level = LEVELS.index(float(margin))
        assert (key in near) == ((key, level - 1) in seen)
        seen.add((key, level))


def test_levels_that_are_ten_times_each_other_do_not_mix(tmp_path, monkeypatch):
    """A design that fails its audit is solved again with ten times the margin, which is another level's."""
    monkeypatch.setenv("TOY_VIOLATED", "*")
    monkeypatch.setenv("TOY_MARGIN", "1e-3")
    answer = goal_run(tmp_path / "run", Goals(clearance=(1e-4, 1e-3)))
    first, second = (table(tmp_path / f"run/levels/{k}/candidates.csv") for k in range(2))
    assert [row["key"] for row in first] == [row["key"] for row in second]
    assert all(at.sizes[0].complete for at in answer.levels)
    assert {row["audit"] for row in first} == {row["audit"] for row in second} == {"clear"}
    assert answer.levels[0].sizes[0].remarks
    assert not answer.levels[1].sizes[0].remarks


def test_the_same_again_solves_nothing_and_answers_the_same(tmp_path, log):
    first = goal_run(tmp_path / "run")
    solved, text = solved_keys(log), (tmp_path / "run/front.csv").read_text()
    assert goal_run(tmp_path / "run") == first
    assert solved_keys(log) == solved
    assert (tmp_path / "run/front.csv").read_text() == text
    with RunFolder.load(tmp_path / "run") as folder:
        assert answer_of(folder) == first


def test_a_run_that_was_cut_short_goes_on_to_the_same_front(tmp_path, log):
    short = goal_run(tmp_path / "run", time_limit=1e-9)
    assert short.exit_status == 3
    assert not short.complete
    assert table(tmp_path / "run/front.csv") == []
    assert not (tmp_path / "run/best.json").exists()
    goal_run(tmp_path / "whole")
    assert goal_run(tmp_path / "run").complete
    assert (tmp_path / "run/front.csv").read_text() == (tmp_path / "whole/front.csv").read_text()


def test_other_goals_are_another_run(tmp_path):
    goal_run(tmp_path / "run")
    for goals in (Goals(clearance=LEVELS[:2]), Goals(), Goals(peak_input=(0.9,))):
        with pytest.raises(BadInput, match="holds another task"):
            goal_run(tmp_path / "run", goals)


def test_a_level_without_a_design_is_told(tmp_path, monkeypatch):
    """Its reason stands beside the designs of the others."""

    def solve(job):
        told = "*" if job.task.search.margin == 1e-2 else ""
        monkeypatch.setenv("TOY_NONE", told)
        return toy_problem.solve(job)

    task = toy_task().model_copy(update={"goals": GOALS})
    answer = toy_run(tmp_path / "run", task=task, backends=replace(BACKENDS, solve=solve))
    assert answer.exit_status == 0
    assert [at.sizes[0].best is None for at in answer.levels] == [False, False, True]
    assert "no start of 4 candidates led to a design" in answer.levels[2].sizes[0].reason
    assert {p.number for p in answer.points} <= {0, 1}


def test_no_design_at_any_level_and_none_that_passes(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    assert goal_run(tmp_path / "none").exit_status == 3
    monkeypatch.setenv("TOY_NONE", "")
    monkeypatch.setenv("TOY_VIOLATED", "*")
    answer = goal_run(tmp_path / "violated")
    assert (answer.exit_status, answer.best, answer.points) == (1, None, ())


# ---- with the solver


@pytest.mark.usefixtures("in_process")
def test_fewer_modules_against_effort_of_a_hover(tmp_path):
    """One module, or two that share the force, splayed just so that their airflows clear (test_nlp_by_hand)."""
    case = LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, 5.0)))
    task = older_task(name="lift", modules=(1, 2), load_cases=(case,), goals=Goals(modules=True))
    answer = search(task, out=tmp_path / "run", starts=2)
    k_f = task.module.thrust_coefficient
    one, two = sorted(answer.points, key=lambda p: p.row.modules)
    assert one.row.objective == pytest.approx((5.0 / k_f) ** 2 / 4, rel=1e-6)
    assert (5.0 / k_f) ** 2 / 8 < two.row.objective < 1.1 * (5.0 / k_f) ** 2 / 8
    assert [p.row.modules for p in answer.points] == [2, 1]
    assert one.clearance is None
    assert 1e-4 <= two.clearance < 2e-4
    assert one.peak_input == pytest.approx(5.0 / (4 * k_f) / task.module.max_input(9.81), rel=1e-6)


def test_the_design_of_least_effort_is_not_called_the_smallest(tmp_path, capsys):
    """Both sizes are feasible, and the larger one takes less effort or has more clearance."""
    task = toy_task((2, 3)).model_copy(update={"goals": GOALS})
    print(*answer_lines(answer := toy_run(tmp_path / "run", task=task, backends=BACKENDS)), sep="\n")
    assert len(answer.sizes) == 2
    assert f"best design: {answer.best.key}, {answer.best.modules} modules, J = " in capsys.readouterr().out


@pytest.mark.usefixtures("in_process")
def test_the_command_tells_the_front(tmp_path):
    """One module hovers with 0.48 of u_max and an end-effector anywhere above or below it; 0.4 is impossible."""
    file = tmp_path / "task.toml"
    file.write_text(
        'name = "hover"\nmodules = 1\n[[load_cases]]\ncom = { force = [0.0, 0.0, 1.0] }\n'
        '[end_effector]\nrod = "none"\n'
        "[goals]\npeak_input = [1.0, 0.6, 0.4]\nstand_off = [0.2, 0.4]\n"
    )
    command = ["run", str(file), "--starts", "1", "--out", str(tmp_path / "run")]
    ran = invoke(*command)
    assert "level 0: end_effector.stand_off = 0.2, search.peak_input = 1" in ran.stdout
    assert ran.stdout.count("all rotors at full thrust give 2.355 N at most") == 2
    assert "front, " in ran.stdout
    told = json.loads(invoke(*command, "--json").stdout)
    assert [at["number"] for at in told["levels"]] == list(range(6))
    assert [at["sizes"][0]["best"] is None for at in told["levels"]] == [False, False, True] * 2
    assert told["front"][0]["key"] == told["best"]["key"] == "a0"
    assert max(row["stand_off"] for row in told["front"]) >= 0.4
    assert [float(row["objective"]) for row in table(tmp_path / "run/front.csv")] == [
        row["objective"] for row in told["front"]
    ]


# ---- the page


def test_the_page_draws_the_front_and_tells_every_level(tmp_path, monkeypatch):
    page = Reader(toy_front_page(tmp_path / "run"))
    rows = table(tmp_path / "run/front.csv")
    line, marks = json.loads(page.data["front-clearance-data"])["data"]
    assert marks["x"] == pytest.approx([1e3 * float(row["clearance"]) for row in rows])
    least = float(rows[0]["objective"])
    assert marks["y"] == pytest.approx([float(row["objective"]) / least for row in rows])
    assert [text.split(",")[0] for text in marks["text"]] == [row["key"] for row in rows]
    assert (line["x"], line["y"]) == (marks["x"], marks["y"])  # one goal: all of the front is the line
    assert "front-stand-off-data" not in page.data
    for number, margin in enumerate(sorted(LEVELS)):
        assert f"{number} search.margin = {margin:g} 3 4 feasible" in page.text
    assert f"on the front, {rows[0]['key']} needs the least control effort" in page.text
    ranking = json.loads(page.data["ranking-data"])["rows"]
    level = table(tmp_path / f"run/levels/{rows[0]['level']}/candidates.csv")
    assert [row[0] for row in ranking] == [row["key"] for row in level]
    assert "[goals]" in page.text


def toy_front_page(path):
    goal_run(path)
    with RunFolder.load(path) as folder:
        return render(run_page(folder))


def test_a_front_without_designs_has_a_page(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    page = Reader(toy_front_page(tmp_path / "run"))
    assert "No design was found for toy" in page.text
    assert page.text.count("no start of 4 candidates led to a design") >= 3


def test_reserves_failures_and_moments_are_weighed_as_the_rest():
    names = ("force_reserve", "rotor_out", "joint_moment")
    plain = replace(point(1.0), force_reserve=1.0, rotor_out="none", joint_moment=2.0)
    safe = replace(point(1.1), force_reserve=1.0, rotor_out="hover", joint_moment=2.0)
    light = replace(point(1.2), force_reserve=1.0, rotor_out="none", joint_moment=1.5)
    worse = replace(point(1.3), force_reserve=0.9, rotor_out="hover", joint_moment=2.0)
    assert [one.row.objective for one in front([plain, safe, light, worse], names)] == [1.0, 1.1, 1.2]
    loose, strict = replace(point(1.0), hinge_angle_deg=0.1), replace(point(1.1), hinge_angle_deg=0.2)
    assert front([loose, strict], ["hinge_angle_deg"]) == (loose, strict)
    assert front([replace(loose, hinge_angle_deg=0.2), strict], ["hinge_angle_deg"])[1:] == ()

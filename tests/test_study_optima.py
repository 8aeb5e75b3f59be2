"""Local optima of a run: which are kept, that nothing is solved twice, and that the best of all is the answer."""

import json
from dataclasses import replace
from itertools import pairwise

import pytest
import toy_problem
from commands import invoke
from nlp_cases import push, solved
from toy_problem import toy_run

from nlp import hinge_sets, local_optima, solve
from topo_search.model import Design, Status, Topology
from topo_search.model.files import read_json
from topo_search.study import RunFolder
from topo_search.study.optima import clear_designs


def kept(path) -> dict[str, list[float]]:
    """Return the efforts of the kept optima of each tree, as their files have them."""
    efforts: dict[str, list[float]] = {}
    for file in sorted((path / "optima").iterdir()):
        efforts.setdefault(file.name.split("-")[0], []).append(read_json(Design, file).objective)
    return efforts


def test_every_clear_optimum_within_so_much_is_kept_once(tmp_path):
    answer = toy_run(tmp_path / "run", keep_within=20.0, starts=3)
    limit = 1.2 * answer.best.objective
    efforts = kept(tmp_path / "run")
    rows = {row.key: row for row in answer.sizes[0].top}
    assert set(efforts) == {key for key, row in rows.items() if row.objective <= limit}
    for key, held in efforts.items():
        starts = sorted(toy_problem.value(key, s, 0, 1e-4) for s in range(3))
        assert held == [rows[key].objective, *(J for J in starts if limit >= J)]
    with RunFolder.load(tmp_path / "run") as folder:
        assert [one.objective for one in clear_designs(folder, answer.best)] == efforts[answer.best.key][1:]


def test_what_is_known_is_not_solved_again_and_more_is(tmp_path, monkeypatch):
    toy_run(tmp_path / "run", keep_within=5.0)
    first = kept(tmp_path / "run")
    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    toy_run(tmp_path / "run", keep_within=2.0)
    toy_run(tmp_path / "run")
    assert not (tmp_path / "log").exists()
    assert kept(tmp_path / "run") == first
    toy_run(tmp_path / "run", keep_within=40.0)
    assert (tmp_path / "log").read_text()
    assert sum(map(len, kept(tmp_path / "run").values())) > sum(map(len, first.values()))


def test_an_optimum_without_a_clear_audit_is_counted_but_not_kept(tmp_path):
    def audit(design):
        verdict = Status.VIOLATED if design.objective > 2.3 else Status.CLEAR
        return toy_problem.audit(design).model_copy(update={"verdict": verdict})

    backends = replace(toy_problem.BACKENDS, audit=audit)
    toy_run(tmp_path / "run", keep_within=50.0, starts=4, backends=backends)
    assert max(J for held in kept(tmp_path / "run").values() for J in held) <= 2.3
    record = json.loads((tmp_path / "run/optima.json").read_text())
    assert sum(tree["not_clear"] for tree in record["trees"].values()) > 0


def test_an_optimum_that_beats_the_best_becomes_the_answer(tmp_path):
    def better(job, max_effort):
        found = toy_problem.local_optima(job, max_effort)
        return [
            found[0].model_copy(update={"objective": 1.5, "rotor_speeds_squared": inputs(job.task, 1.5)}),
            *found,
        ]

    def inputs(task, J):
        return (((J / (4 * task.n)) ** 0.5,) * (4 * task.n),)

    before = toy_run(tmp_path / "plain")
    answer = toy_run(tmp_path / "run", keep_within=0.0, backends=replace(toy_problem.BACKENDS, local_optima=better))
    assert (answer.best.key, answer.best.objective, answer.best.audit) == (before.best.key, 1.5, "clear")
    assert read_json(Design, tmp_path / "run/best.json").objective == 1.5


def test_a_job_that_fails_is_tried_again_by_the_next_call(tmp_path):
    def failing(*_, **__):
        raise ValueError("no")

    toy_run(tmp_path / "run", keep_within=20.0, backends=replace(toy_problem.BACKENDS, local_optima=failing))
    assert not (tmp_path / "run/optima").exists()
    toy_run(tmp_path / "run", keep_within=20.0)
    assert kept(tmp_path / "run")


@pytest.mark.parametrize(
    "words", [["--keep-within", "2", "--prune"], ["--keep-within", "-1"], ["--keep-within", "nan"]]
)
def test_what_cannot_be_kept_is_refused(tmp_path, words):
    invoke("run", "push", *words, "--out", tmp_path / "run", status=2)
    assert not (tmp_path / "run").exists()


def test_local_optima_are_distinct_and_none_is_missed_that_solve_finds():
    task, tree = push(3), Topology.from_key("a300")
    best = solved(solve(task, tree, starts=range(4), seed=0))
    found = local_optima(task, tree, starts=range(4), seed=0, most_effort=1.05 * best.objective)
    efforts = [design.objective for design in found]
    assert len(found) > 1
    assert efforts[0] <= best.objective * (1 + 1e-6)  # more minima go on than where the best is sought
    assert all(after > before * (1 + 1e-4) for before, after in pairwise(efforts))
    assert efforts[-1] <= 1.05 * best.objective


@pytest.mark.slow
def test_local_optima_on_a_set_are_all_that_all_combinations_hold(monkeypatch):
    task, tree = push(4, search={"hinge_step_deg": 15.0}), Topology.from_key("a3200")
    best = solved(solve(task, tree, starts=range(4), seed=0))
    options = {"starts": range(4), "seed": 0, "near": (best,), "most_effort": 1.1 * best.objective}
    found = local_optima(task, tree, **options)
    monkeypatch.setattr(hinge_sets, "SEARCH", hinge_sets.SEARCH._replace(complete_up_to=10**4))
    every = local_optima(task, tree, **options)
    assert [design.objective for design in found] == pytest.approx([design.objective for design in every], rel=1e-6)
    assert len(found) > 4


def test_local_optima_on_a_set_are_of_the_set():
    task, tree = push(3, search={"hinge_angles_deg": (60.0, 65.0, 70.0)}), Topology.from_key("a300")
    best = solved(solve(task, tree, starts=range(2), seed=0))
    found = local_optima(task, tree, starts=range(2), seed=0, near=(best,), most_effort=1.05 * best.objective)
    turned = [tuple(round(abs(a) * 57.29577951308232) for a in design.hinge_angles_rad) for design in found]
    assert len(set(turned)) > 1
    assert {angle for angles in turned for angle in angles} <= {60, 65, 70}

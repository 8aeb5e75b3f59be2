"""Hinge angles from a set: what the search finds is what all combinations hold, and exactly of the set."""

import math

import pytest
from nlp_cases import PUSH, best_design, push, solved
from suites import few

from nlp import default_starts, hinge_sets, solve
from topo_search.model import Infeasible, Topology
from topo_search.model.files import read_task
from topo_search.topologies import candidates
from verify import audit


def best(key: str, **search: object):
    return solve(push(len(key) - 1, search=search), Topology.from_key(key), starts=range(4), seed=0)


@pytest.mark.parametrize(
    ("key", "search"),
    [("a300", {"hinge_step_deg": 10.0}), ("a3020", {"hinge_angles_deg": (15.0, 60.0, 75.0, 80.0)})],
)
def test_the_answer_is_of_the_set_and_clear_and_costs_more_than_any_angles(key, search):
    design = solved(best(key, **search))
    allowed = {math.radians(angle) for angle in design.task.search.hinge_set_deg or ()}
    assert set(design.hinge_angles_rad) <= allowed
    assert audit(design).verdict == "clear"
    free = solved(best(key))
    assert free.objective < design.objective < 1.03 * free.objective
    assert (design.solver or {})["starts"] == 4


@pytest.mark.parametrize("step", few([30.0, 15.0], 1))
def test_what_is_found_near_the_local_optima_is_what_all_combinations_hold(step, monkeypatch):
    found = solved(best("a3200", hinge_step_deg=step))
    monkeypatch.setattr(hinge_sets, "SEARCH", hinge_sets.SEARCH._replace(complete_up_to=10**6))
    assert solved(best("a3200", hinge_step_deg=step)).objective == pytest.approx(found.objective, rel=1e-6)


def test_a_task_costs_no_more_than_with_a_region_besides():
    """The best of push is three turns from the angles nearest to its local optima of free angles."""
    efforts = []
    for name in ("push", "push-local"):
        task = read_task(name, ("modules=4", "search.hinge_step_deg=10")).resolve(4)
        efforts.append(solved(solve(task, Topology.from_key("a3200"), starts=range(8), seed=0)).objective)
    alone, besides = efforts
    assert alone <= besides * (1 + 1e-6)


def test_a_set_without_a_design_says_what_stops_it():
    result = best("a300", hinge_angles_deg=(0.0,))
    assert isinstance(result, Infeasible)
    assert "hinge angle" in result.worst_constraint or "modules" in result.worst_constraint


def test_without_the_compiled_search_ipopt_solves_the_combinations(monkeypatch):
    compiled = solved(best("a3020", hinge_step_deg=15.0))
    monkeypatch.setattr(hinge_sets, "reason_against", lambda _: "a test")
    alone = solved(best("a3020", hinge_step_deg=15.0))
    assert alone.objective == pytest.approx(compiled.objective, rel=1e-5)
    assert alone.hinge_angles_rad == compiled.hinge_angles_rad


def test_reserves_and_several_cases_hold_on_the_set_too():
    cases = [{**case, "name": f"case {k}"} for k, case in enumerate(PUSH)]
    fields = {"load_cases": cases, "flight": {"force_reserve": 0.05}, "search": {"hinge_step_deg": 10.0}}
    assert audit(best_design(push(4, **fields), Topology.from_key("a3020"), 3)).verdict == "clear"


def test_a_design_of_the_set_is_carried_over():
    task, tree = push(3, search={"hinge_step_deg": 10.0}), Topology.from_key("a300")
    design = best_design(task, tree, 2)
    again = solved(solve(task, tree, starts=range(0), seed=0, near=(design,)))
    assert again.objective == pytest.approx(design.objective, rel=1e-6)
    assert again.hinge_angles_rad == design.hinge_angles_rad


def test_a_tree_and_its_mirror_image_cost_the_same_on_a_set():
    task = push(3, search={"hinge_step_deg": 10.0})
    trees = (Topology.from_key(key) for key in ("a300", "a600"))
    one, other = (solved(solve(task, tree, starts=range(default_starts(task)), seed=0)) for tree in trees)
    assert {c.topology.key: c.orbit for c in candidates(3, symmetry="task", task=one.task)}["a300"] == 2
    assert other.objective == pytest.approx(one.objective, rel=1e-6)

"""Reduced starts and their polish: designs, the same ones every time, and a reason where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from nlp_cases import GENTLE_PUSH, HOVER, PUSH, Table, best_design, placed, push

from nlp import lower_bound, multistart, solve
from nlp.evaluation import violations, worst
from nlp.multistart import DEEP, solve_starts
from nlp.reduced import REDUCED_UP_TO
from nlp.reduced.arrays import to_arrays
from nlp.reduced.search import local_minima, point_of
from nlp.start_result import StartResult
from nlp.starts.reduced_starts import draw_starts
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.study import progress
from verify import audit

SIDES = [
    {"carries_weight": True, "end_effector": {"force": [0.1 * x, 0.1 * y, 0.0]}, "weight": 0.0}
    for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))
]
"""A tenth of the weight to every side at the tip, while hovering."""
TREE = Topology.from_key("a3010")
"""Four modules."""


def searched(task, starts, *, seed=0, tree=TREE) -> list[StartResult]:
    return solve_starts(task, tree, starts=starts, seed=seed, carried={})


def best(found: list[StartResult]) -> StartResult:
    return min(found, key=lambda one: one.rank)


def test_ends_are_next_to_designs() -> None:
    task = push(4, load_cases=GENTLE_PUSH)
    stated = to_arrays(task, TREE)
    first, _ = local_minima(stated, draw_starts(task, TREE, stated, range(40), "0"))
    near = [end for end in first if end.violation < 1e-2]
    assert near
    for end in near:
        checks = [check for check in violations(point_of(task, TREE, stated, end)) if check.unit != "rad"]
        assert worst(checks).scaled <= 2 * end.violation + 1e-6


@pytest.mark.parametrize(
    ("task", "key"),
    [
        (push(4, load_cases=GENTLE_PUSH), TREE.key),
        (push(4, load_cases=[HOVER], end_effector={"position": [0.1, 0.1, 0.3]}), TREE.key),
        (push(5, load_cases=[*PUSH, *SIDES]), "a70200"),
        (push(5, module={"min_input": 0.1}), "a70200"),
    ],
    ids=["gentle", "fixed end-effector", "weightless cases", "least input"],
)
def test_a_polished_design_is_as_good_as_what_starts_of_ipopt_find(task, key) -> None:
    found, other = (
        best(searched(task, range(5), tree=Topology.from_key(key))),
        placed(task, Topology.from_key(key), 4),
    )
    assert found.worst.met
    assert other.worst.met
    assert found.objective <= (1 + 1e-4) * other.objective


def test_starts_that_end_at_one_place_share_their_design() -> None:
    found = searched(push(5), range(8), tree=Topology.from_key("a70010"))
    met = [outcome for outcome in found if outcome.worst.met]
    assert len({id(outcome.point) for outcome in met}) < len(met)


def test_a_deep_search_is_made_once_and_counts_as_its_start(monkeypatch) -> None:
    """Nothing that the first starts end at is a design; the deep search's starts are other ones."""
    drawn: list[tuple[str, bool]] = []

    def watched(task, topology, stated, starts, seed, *, random_signs=False):
        drawn.append((seed, random_signs))
        return draw_starts(task, topology, stated, starts, seed, random_signs=random_signs)

    monkeypatch.setattr(multistart, "draw_starts", watched)
    task, tree = push(2), Topology.from_key("a10")
    assert len(searched(task, range(3), tree=tree)) == 3
    assert drawn == [("0", False)]
    found = searched(task, range(3, 5), tree=tree)
    assert [outcome.start for outcome in found] == [3, 4]
    assert drawn[1] == ("0", False)
    assert set(drawn[2:]) == {("0 deep", True)}
    assert 1 < len(drawn[2:]) <= DEEP.max_starts / DEEP.batch


def test_a_plan_expects_the_reduced_search_of_the_sizes_that_take_it() -> None:
    """What a run is made of knows no solver, so the number stands in both."""
    assert progress.EXPECTED.reduced_modules == REDUCED_UP_TO


# ---- Load cases that weigh nothing: constraints without cost, in solver, bound and audit.

WEIGHTLESS_TREE = Topology.from_key("a70200")


def with_sides() -> ResolvedTask:
    return push(5, load_cases=[*PUSH, *SIDES])


def test_a_design_produces_them_and_pays_nothing_for_them():
    task = with_sides()
    design = best_design(task, WEIGHTLESS_TREE, 6)
    assert audit(design).verdict == "clear"
    u = design.inputs.reshape(7, -1)
    assert design.objective == pytest.approx(float(np.sum(u[:3] ** 2)), rel=1e-12)
    assert lower_bound(task) <= design.objective


def test_what_cannot_be_done_is_infeasible_though_it_costs_nothing():
    weightless: Table = {"carries_weight": True, "com": {"torque": [9.0, 0.0, 0.0]}, "weight": 0.0}
    far = solve(push(5, load_cases=[HOVER, weightless]), WEIGHTLESS_TREE, starts=range(2), seed=0)
    assert not isinstance(far, Design)
    strong: Table = {"com": {"force": [0.0, 0.0, 3.0]}, "weight": 0.0, "name": "too strong"}
    impossible = solve(push(5, load_cases=[HOVER, strong]), WEIGHTLESS_TREE, starts=range(1), seed=0)
    assert not isinstance(impossible, Design)
    assert impossible.status == "impossible"
    assert impossible.worst_constraint == "load case 1 (too strong), force"

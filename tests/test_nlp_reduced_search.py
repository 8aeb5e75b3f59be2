"""Reduced starts and their polish: designs, the same ones every time, and a reason where there is none."""

from __future__ import annotations

import pytest
from nlp_cases import GENTLE_PUSH, HOVER, PUSH, placed, push
from test_nlp_weightless import SIDES

from nlp import multistart
from nlp.evaluation import violations, worst
from nlp.multistart import DEEP, solve_starts
from nlp.reduced import REDUCED_UP_TO
from nlp.reduced.arrays import to_arrays
from nlp.reduced.search import local_minima, point_of
from nlp.start_result import StartResult
from nlp.starts.reduced_starts import draws
from topo_search.model import Topology
from topo_search.study import progress

TREE = Topology.from_key("a3010")
"""Four modules."""


def searched(task, starts, *, seed=0, tree=TREE, near=()) -> list[StartResult]:
    return solve_starts(task, tree, starts=starts, seed=seed, near=near)


def best(found: list[StartResult]) -> StartResult:
    return min(found, key=lambda one: one.rank)


def test_ends_are_next_to_designs() -> None:
    task = push(4, load_cases=GENTLE_PUSH)
    stated = to_arrays(task, TREE)
    first, _ = local_minima(stated, draws(task, TREE, stated, range(40), "0"))
    near = [end for end in first if end.missing < 1e-2]
    assert near
    for end in near:
        checks = [check for check in violations(point_of(task, TREE, stated, end)) if check.unit != "rad"]
        assert worst(checks).scaled <= 2 * end.missing + 1e-6


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


def test_every_start_has_an_outcome_and_the_best_of_parts_is_that_of_all() -> None:
    task = push(4, load_cases=GENTLE_PUSH)
    whole = searched(task, range(6), seed=1)
    parts = [searched(task, part, seed=1) for part in (range(3), range(3, 6))]
    assert [outcome.start for outcome in whole] == list(range(6))
    least = min(best(part).objective for part in parts)
    assert best(whole).objective == pytest.approx(least, rel=1e-7)


def test_starts_that_end_at_one_place_share_their_design() -> None:
    found = searched(push(5), range(8), tree=Topology.from_key("a70010"))
    met = [outcome for outcome in found if outcome.worst.met]
    assert len({id(outcome.point) for outcome in met}) < len(met)


def test_a_deep_search_is_made_once_and_counts_as_its_start(monkeypatch) -> None:
    """Nothing that the first starts end at is a design; the deep search's starts are other ones."""
    drawn: list[tuple[str, bool]] = []

    def watched(task, topology, stated, starts, seed, *, anyhow=False):
        drawn.append((seed, anyhow))
        return draws(task, topology, stated, starts, seed, anyhow=anyhow)

    monkeypatch.setattr(multistart, "draws", watched)
    task, tree = push(2), Topology.from_key("a10")
    assert len(searched(task, range(3), tree=tree)) == 3
    assert drawn == [("0", False)]
    found = searched(task, range(3, 5), tree=tree)
    assert [outcome.start for outcome in found] == [3, 4]
    assert drawn[1] == ("0", False)
    assert set(drawn[2:]) == {("0 deep", True)}
    assert 1 < len(drawn[2:]) <= DEEP.most_starts / DEEP.batch


def test_a_plan_expects_the_reduced_search_of_the_sizes_that_take_it() -> None:
    """What a run is made of knows no solver, so the number stands in both."""
    assert progress.EXPECTED.reduced_modules == REDUCED_UP_TO

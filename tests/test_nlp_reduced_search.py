"""Reduced starts and their polish: designs, the same ones every time, and a reason where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from nlp_cases import BOX, GENTLE_PUSH, HOVER, push

from nlp import solve
from nlp.evaluate import violations, worst
from nlp.reduced.draws import draws
from nlp.reduced.polish import Polished, polished, reason_against
from nlp.reduced.search import ends, point_of
from nlp.reduced.stated import state
from topo_search.model import Design, Topology

TREE = Topology.from_key("a3010")
"""Four modules."""


def best(found: list[Polished]) -> Polished:
    return min(found, key=lambda one: one.rank)


def test_ends_are_next_to_designs() -> None:
    task = push(4, load_cases=GENTLE_PUSH)
    stated = state(task, TREE)
    first, _ = ends(stated, draws(task, TREE, stated, range(40), "0"))
    near = [end for end in first if end.missing < 1e-2]
    assert near
    for end in near:
        checks = [check for check in violations(point_of(task, TREE, stated, end.x)) if check.unit != "rad"]
        assert worst(checks).scaled <= 2 * end.missing + 1e-6


@pytest.mark.parametrize(
    "task",
    [push(4, load_cases=GENTLE_PUSH), push(4, load_cases=[HOVER], end_effector={"position": [0.1, 0.1, 0.3]})],
)
def test_a_polished_design_is_as_good_as_what_starts_of_ipopt_find(task) -> None:
    found = best(polished(task, TREE, starts=range(40), seed=0))
    assert found.worst.met
    other = solve(task, TREE, starts=range(4), seed=0)
    assert isinstance(other, Design)
    assert found.point.objective <= 1.001 * other.objective


def test_the_same_seed_gives_the_same_points_to_the_last_bit() -> None:
    one, two = (polished(push(4, load_cases=GENTLE_PUSH), TREE, starts=range(10), seed=3) for _ in range(2))
    for first, second in zip(one, two, strict=True):
        assert np.array_equal(first.point.pack(), second.point.pack())
        assert first.starts == second.starts


def test_more_starts_are_no_worse() -> None:
    task = push(4, load_cases=GENTLE_PUSH)
    whole = best(polished(task, TREE, starts=range(20), seed=1))
    parts = [best(polished(task, TREE, starts=part, seed=1)) for part in (range(10), range(10, 20))]
    assert min(part.rank for part in parts)[1] <= (1 + 1e-3) * whole.rank[1]


def test_a_design_that_is_carried_over_is_one_more_start() -> None:
    task = push(4, load_cases=GENTLE_PUSH)
    donor = solve(task, TREE, starts=range(4), seed=0)
    assert isinstance(donor, Design)
    (found, *_) = sorted(polished(task, TREE, starts=range(0), seed=0, near=[donor]), key=lambda one: one.rank)
    assert found.worst.met
    assert found.starts == (-1,)
    assert found.point.objective <= 1.001 * donor.objective


def test_what_has_no_design_says_what_is_missed() -> None:
    found = best(polished(push(2), Topology.from_key("a10"), starts=range(5), seed=0))
    assert not found.worst.met
    assert found.worst.name
    assert found.worst.scaled > 0.0


def test_a_task_that_it_does_not_express_is_named() -> None:
    assert reason_against(push(4, load_cases=GENTLE_PUSH)) is None
    assert "convex" in str(reason_against(push(4, exposure=[BOX])))

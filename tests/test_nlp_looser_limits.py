"""A looser limit loses no tree and no effort: random tasks, each of whose limits is loosened after the other."""

import copy
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from nlp_cases import BESIDE_A_DECK
from older import older_task

from nlp import default_starts, solve
from topo_search.model import Design, Topology
from topo_search.topologies import candidates

WORSE = 5e-4
"""Relative difference of efforts that counts."""


def drawn(rng: np.random.Generator, *, flight: bool) -> dict[str, Any]:
    """A push in a random direction from a platform that need not have a design for every tree."""
    direction = rng.normal(size=3)
    push = rng.uniform(0.05, 0.3) * direction / np.linalg.norm(direction)
    at = {
        "largest_reach": rng.uniform(0.25, 0.8),
        "stand_off": rng.uniform(0.1, 0.4),
        "mass": rng.uniform(0.01, 0.1),
    }
    exposures: list[list[dict[str, Any]]] = [
        [],
        [{"kind": "local", "radius": rng.uniform(0.1, 0.4)}],
        [{"kind": "directional", "radius": rng.uniform(0.05, 0.2), "segments": [rng.normal(size=3).tolist()]}],
        [
            {"kind": "local", "radius": rng.uniform(0.1, 0.25)},
            {"kind": "allowed", "planes": [{"normal": [0, 0, 1]}]},
        ],
    ]
    table = {
        "name": "drawn",
        "modules": 3,
        "module": {"max_thrust_to_weight": rng.uniform(1.8, 3.5)},
        "end_effector": at,
        "load_cases": [
            {"carries_weight": True, "end_effector": {"force": push.tolist()}},
            {"carries_weight": True},
        ],
        "exposure": exposures[rng.integers(len(exposures))],
    }
    if flight:
        reserves = {"force_reserve": rng.uniform(0.05, 0.3), "torque_reserve": rng.uniform(0.02, 0.3)}
        table["flight"] = {**reserves, "directions": "horizontal"}
    return table


def loosened(table: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The task with one limit looser than before, then with one more."""
    factors = {
        "end_effector": {"largest_reach": 4.0, "stand_off": 0.6},
        "module": {"max_thrust_to_weight": 1.2},
        "flight": {"force_reserve": 0.6, "torque_reserve": 0.6},
    }
    table = copy.deepcopy(table)
    for part, limits in factors.items():
        for limit, factor in limits.items():
            if part in table:
                table[part][limit] *= factor
                yield f"{part}.{limit}", copy.deepcopy(table)
    if table["exposure"]:
        table["exposure"][0]["radius"] *= 0.7
        yield "exposure[0].radius", table


def efforts(table: dict[str, Any]) -> dict[str, float]:
    """J of every tree that has a design."""
    task = older_task(table)
    solved = {
        each.topology.key: solve(task.resolve(3), each.topology, starts=range(default_starts(task)), seed=0)
        for each in candidates(3)
    }
    return {key: outcome.objective for key, outcome in solved.items() if isinstance(outcome, Design)}


@pytest.mark.parametrize(
    ("seed", "flight"),
    [(0, False), *(pytest.param(seed, seed % 2 == 0, marks=pytest.mark.slow) for seed in range(1, 10))],
)
def test_a_looser_limit_loses_nothing(seed: int, flight: bool) -> None:
    table = drawn(np.random.default_rng(seed), flight=flight)
    before = efforts(table)
    for limit, looser in loosened(table):
        after = efforts(looser)
        assert before.keys() <= after.keys(), limit
        assert min(after.values(), default=math.inf) <= min(before.values(), default=math.inf) * (1 + WORSE), limit
        before = after


def test_a_tip_that_may_be_anywhere_comes_back() -> None:
    """All eight starts of this tree once left for a tip 200 m away, which pushing upwards alone does not forbid."""
    table = {**BESIDE_A_DECK, "end_effector": {"mass": 0.15, "largest_reach": False}}
    task, topology = older_task(table).resolve(5), Topology.from_key("a62020")
    outcome = solve(task, topology, starts=range(8), seed=0)
    assert isinstance(outcome, Design)
    assert outcome.objective < 1.58e15

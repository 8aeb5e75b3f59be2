"""A start that ends in NaN is the worst there is: never a design, and never the reason while others have one."""

import dataclasses
import math

import numpy as np
import pytest
from nlp_cases import push

from nlp import solve
from nlp.graph import GraphProgram
from nlp.ipopt import Answer
from topo_search.model import Design, Infeasible, Topology

FIVE = Topology.from_key("a11210")


def break_starts(monkeypatch, count):
    """Let the first starts of a solve end in NaN, under a word of success."""
    program_solve, calls = GraphProgram.solve, []

    def solve_badly(self, start):
        answer = program_solve(self, start)
        calls.append(answer)
        if len(calls) > count:
            return answer
        point = dataclasses.replace(answer.point, u=np.full_like(answer.point.u, math.nan))
        return Answer(point, "Solve_Succeeded", answer.iterations)

    monkeypatch.setattr(GraphProgram, "solve", solve_badly)


@pytest.fixture
def first_start_breaks(monkeypatch):
    break_starts(monkeypatch, 1)


@pytest.mark.usefixtures("first_start_breaks")
def test_a_start_that_is_not_a_number_loses_to_a_design():
    result = solve(push(5), FIVE, starts=range(4), seed=0)
    assert isinstance(result, Design)
    assert result.solver is not None
    assert result.solver["start"] > 0


@pytest.mark.usefixtures("first_start_breaks")
def test_a_start_that_is_not_a_number_loses_to_a_reason():
    result = solve(push(5, search={"body_clearance": 0.42}), FIVE, starts=range(2), seed=0)
    assert isinstance(result, Infeasible)
    assert result.solver is not None
    assert result.solver.start == 1
    assert result.violation > 0


def test_starts_that_all_end_in_no_number_are_judged_where_they_began(monkeypatch):
    break_starts(monkeypatch, 2)
    result = solve(push(5), FIVE, starts=range(2), seed=0)
    assert isinstance(result, Infeasible)
    assert math.isfinite(result.violation)
    assert result.violation > 0

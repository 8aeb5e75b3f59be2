"""A polish that ends in NaN leaves its start where it was: never a design, and a reason in numbers."""

import dataclasses
import math

import numpy as np
import pytest
from nlp_cases import push

from nlp import solve
from nlp.assembled import AssembledProgram
from nlp.ipopt import IpoptResult
from topo_search.model import Design, Infeasible, Topology

FIVE = Topology.from_key("a11210")


def break_polishes(monkeypatch, count):
    """Let the first polishes end in NaN, under a word of success."""
    polish, calls = AssembledProgram.polish, []

    def polish_badly(self, start):
        result = polish(self, start)
        calls.append(result)
        if len(calls) > count:
            return result
        point = dataclasses.replace(result.point, u=np.full_like(result.point.u, math.nan))
        return IpoptResult(point, "Solve_Succeeded", result.iterations)

    monkeypatch.setattr(AssembledProgram, "polish", polish_badly)


def test_a_polish_that_is_not_a_number_loses_to_a_design(monkeypatch):
    whole = solve(push(5), FIVE, starts=range(4), seed=0)
    break_polishes(monkeypatch, 1)
    result = solve(push(5), FIVE, starts=range(4), seed=0)
    assert isinstance(result, Design)
    assert isinstance(whole, Design)
    assert math.isfinite(result.objective)
    assert result.objective >= (1 - 1e-9) * whole.objective


@pytest.mark.parametrize("broken", [1, 1000])
def test_polishes_that_are_not_numbers_leave_a_reason_in_numbers(monkeypatch, broken):
    break_polishes(monkeypatch, broken)
    result = solve(push(5, search={"body_clearance": 0.42}), FIVE, starts=range(2), seed=0)
    assert isinstance(result, Infeasible)
    assert result.solver is not None
    assert math.isfinite(result.violation)
    assert result.violation > 0

import math

import pytest
import toy_problem
from toy_problem import follow, toy_task

from topo_search.engine import Candidates, Job, Tried
from topo_search.engine.strategy import ExhaustiveSearch
from topo_search.engine.workers import merge, scaled_violation
from topo_search.model import Design, Infeasible, Topology

SPACE = Candidates(toy_task(6).resolve(6), "c2")
KEYS = [candidate.key for candidate in SPACE.candidates()]


class Solver:
    """Answers every proposal with what `value(key, start)` is over its starts; None: a start finds no design."""

    def __init__(self, value, status):
        self.value, self.status = value, status
        self.stages, self.uncollected, self.reached = [], [], {}

    def begin_stage(self, candidates, starts, again):
        assert not self.uncollected
        self.stages.append([])

    def submit(self, proposal):
        self.uncollected.append((proposal.candidate.key, proposal.starts))
        self.stages[-1].append(self.uncollected[-1])

    def results(self, number):
        collected, self.uncollected = self.uncollected[:number], self.uncollected[number:]
        assert len(collected) == number
        return [self.result(*one) for one in collected]

    def result(self, key, starts):
        objectives = [J for start in range(starts) if (J := self.value(key, start)) is not None]
        status = "feasible" if objectives else self.status
        self.reached[key] = Tried(key, starts, status, min(objectives, default=None), None)
        return self.reached[key]


def search(value, *, starts=24, timed=False, status="infeasible", bound=-math.inf):
    """Run the search; return the proposals of each stage, and the last result of each candidate."""
    solver = Solver(value, status)
    follow(ExhaustiveSearch(SPACE, starts=starts, timed=timed, bound=bound), solver)
    assert not solver.uncollected
    return solver.stages, solver.reached


def place(key, start=0):
    """Objectives in the order of the keys, whatever the start."""
    return 1.0 + KEYS.index(key)


def test_every_candidate_gets_all_starts():
    stages, _ = search(place)
    assert stages == [[(key, 24) for key in KEYS]]


def test_under_a_time_limit_single_starts_come_first_and_the_results_are_the_same():
    late = {KEYS[-1]: 23, KEYS[-2]: 8}

    def value(key, start):
        return place(key) if start >= late.get(key, 0) else None

    timed, reached = search(value, timed=True)
    assert [[key for key, _ in proposals] for proposals in timed] == [KEYS] * len(timed)
    assert [proposals[0][1] for proposals in timed] == [1, 2, 4, 8, 12, 16, 20, 24]
    assert reached == search(value)[1]


@pytest.mark.parametrize("status", ["impossible", "failed"])
def test_what_cannot_get_a_design_is_left_alone(status):
    stages, reached = search(lambda key, start: place(key) if key == KEYS[0] else None, status=status, timed=True)
    assert [len(proposals) for proposals in stages] == [len(KEYS), 1, 1, 1, 1, 1, 1, 1]
    assert {scored.starts for scored in reached.values()} == {1, 24}


def test_a_design_that_meets_the_bound_ends_the_search_a_window_later():
    stages, reached = search(place, bound=1.0)
    assert [key for proposals in stages for key, _ in proposals] == KEYS[: ExhaustiveSearch.lookahead] == [*reached]


def test_a_bound_that_is_reached_ends_the_search_also_within_its_rounds_of_starts():
    stages, reached = search(lambda key, start: 1.0 if start else 1.1, bound=1.0, timed=True)
    assert len(reached) == len(KEYS)
    assert [len(proposals) for proposals in stages] == [len(KEYS), len(KEYS)]
    assert {scored.objective for scored in reached.values()} == {1.0}


@pytest.mark.parametrize("bound", [0.5, 0.999])
def test_bounds_that_rule_nothing_out_change_no_result(bound):
    stages, reached = search(place, bound=bound)
    assert reached == search(place)[1]
    assert sum(map(len, stages)) == len(KEYS)


# ---- what two ranges of starts are worth together

PAIR = Topology(((-1, -1, -1), (0, 0, 2)))
TASK = toy_problem.toy_task(2).resolve(2)


def solve(starts):
    return toy_problem.solve(Job(TASK, PAIR, starts=starts, seed=0))


def test_two_ranges_of_starts_are_worth_their_union():
    whole = solve(range(32))
    for cut in range(1, 32):
        assert merge(solve(range(cut)), solve(range(cut, 32)), TASK) == whole


def test_the_closest_start_speaks_for_what_is_infeasible(monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    whole = solve(range(32))
    assert isinstance(whole, Infeasible)
    for cut in range(1, 32):
        assert merge(solve(range(cut)), solve(range(cut, 32)), TASK) == whole
    assert [shortfall.starts for shortfall in whole.shortfalls] == [7, 7, 6, 6, 6]
    assert f"7 {whole.shortfalls[0].constraint}" in whole.message
    assert whole.message.endswith(", 12 another constraint")


def test_a_single_start_is_called_so(monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    result = solve(range(1))
    assert result.message == f"the only start misses load case 0, torque by {result.violation:.3g} N m"


def test_any_design_is_better_than_none(monkeypatch):
    design = solve(range(4))
    monkeypatch.setenv("TOY_NONE", "*")
    for earlier, later in ((design, solve(range(4, 8))), (solve(range(4, 8)), design)):
        merged = merge(earlier, later, TASK)
        assert isinstance(merged, Design)
        assert merged.objective == design.objective
        assert (merged.solver["starts"], merged.solver["starts_feasible"]) == (8, 4)


def test_shortfalls_are_compared_in_the_units_of_the_task():
    weight = TASK.force_unit(2)
    assert scaled_violation(weight, "N", TASK) == 1.0
    assert scaled_violation(0.1 * weight, "N m", TASK) == 1.0
    assert scaled_violation(0.1, "m", TASK) == 1.0
    assert scaled_violation(0.3, "rad", TASK) == 0.3

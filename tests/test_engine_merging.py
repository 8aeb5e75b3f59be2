import toy_problem

from topo_search.engine import merge, scaled_violation
from topo_search.model import Design, Infeasible, Topology

PAIR = Topology(((-1, -1, -1), (0, 0, 2)))
TASK = toy_problem.toy_task(2).resolve(2)


def solve(starts):
    return toy_problem.solve(TASK, PAIR, starts=starts, seed=0)


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
    assert f"7 `{whole.shortfalls[0].constraint}`" in whole.message
    assert whole.message.endswith(", 12 another constraint")


def test_a_single_start_is_called_so(monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    result = solve(range(1))
    assert result.message == f"the only start misses `load case 0, torque` by {result.violation:.3g} N m"


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

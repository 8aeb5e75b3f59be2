"""A rotor that may die: in model, solver, bounds, symmetries and audit."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nlp_cases import GENTLE_PUSH, HOVER, best_design, push, solved
from older import older_task
from scipy.optimize import linprog
from verify_cases import changed

from nlp import lower_bound, prove_impossible, solve
from nlp.evaluation import correct
from nlp.ipopt import IpoptResult
from nlp.lazy_solve import solve_lazily, with_all_corners, without_corners
from nlp.numbers.point import Point
from nlp.program import AssembledProgram
from nlp.requirements.balances import (
    WRENCH_TOLERANCE,
    required_wrenches,
    running_rotors,
    wrench_matrix,
    wrench_residuals,
)
from topo_search.model import BadInput, Design, Infeasible, Status, Task, Topology
from topo_search.model.corners import CorneredTask, to_corners
from topo_search.model.files import validate
from topo_search.model.task_file import read_task
from topo_search.topologies.task_symmetry import improper_isometry
from verify import audit

TREE = Topology.from_key("a300")


def asked(n: int = 3, cases: Any = None, **flight: Any) -> Any:
    return push(n, load_cases=cases or [HOVER], **({"flight": flight} if flight else {}))


def whole(task: Any) -> CorneredTask:
    found = to_corners(task)
    assert isinstance(found, CorneredTask)
    return found


def rows(design: Design) -> dict[str, Any]:
    return {row.name: row for row in audit(design).residuals if "dead" in row.name}


def test_each_rotor_is_dead_in_the_corners_of_its_own_set() -> None:
    task = whole(asked(rotor_out="hover"))
    assert task.dead_rotors[0] is None
    assert task.dead_rotors[1:] == tuple(rotor for rotor in range(12) for _ in range(14))
    assert len(set(task.groups)) == 12
    assert task.case_labels[1] == "hover, rotor 0 of module 0 dead, torque 0"
    assert whole(asked(rotor_out="hover", rotor_out_torque=0.0)).case_labels[6] == "hover, rotor 1 of module 1 dead"
    everywhere = asked(cases=[{"carries_weight": True, "com": {"force": [0.1, 0, 0]}}, HOVER], rotor_out="all")
    assert len(whole(everywhere).corners) == 3 * 168
    alive = running_rotors(task)
    assert alive[0].all()
    assert [row.tolist().index(0.0) for row in alive[1:]] == list(task.dead_rotors[1:])


def test_the_torque_that_is_left_has_units_and_a_default() -> None:
    task = asked(rotor_out="hover")
    assert task.flight.rotor_out_torque == pytest.approx(0.01 * task.torque_unit(3))
    assert asked(rotor_out="hover", units="SI").flight.rotor_out_torque == task.flight.rotor_out_torque
    assert asked(rotor_out="hover", units="SI", rotor_out_torque=0.25).flight.rotor_out_torque == 0.25
    assert "rotor_out" not in asked(torque_reserve=0.1).model_dump_json()


def test_contradictory_and_excessive_requests_are_refused_by_name() -> None:
    fields = {"name": "t", "modules": 3, "load_cases": [HOVER]}
    with pytest.raises(BadInput, match=r'flight.rotor_out_torque: must be left out if rotor_out = "none"'):
        validate(Task, {**fields, "flight": {"rotor_out_torque": 0.1}}, "t")
    with pytest.raises(BadInput, match=r'flight.rotor_out: must be "none", "hover" or "all", but got "any"'):
        validate(Task, {**fields, "flight": {"rotor_out": "any"}}, "t")
    many = [{"carries_weight": True, "com": {"torque": [1e-3 * k, 0.0, 0.0]}} for k in range(150)]
    with pytest.raises(BadInput, match=r"flight.rotor_out: must ask for at most 20,000 wrenches .* 25,368"):
        validate(Task, {**fields, "load_cases": many, "flight": {"rotor_out": "all"}}, "t")


def test_judged_corners_are_those_that_linear_programs_can_produce() -> None:
    """At platforms that were searched without them, some of which lose some rotors."""
    for start in range(3):
        design = solved(solve(asked(cases=GENTLE_PUSH), TREE, starts=range(start, start + 1), seed=0))
        task = whole(asked(cases=GENTLE_PUSH, rotor_out="hover", rotor_out_torque=0.05))
        root, alpha = np.array(design.root_orientation_rad), np.array(design.hinge_angles_rad)
        plain = without_corners(task)
        point = correct(Point(plain, TREE, root, alpha, np.array(design.end_effector_m), design.inputs))
        every = with_all_corners(point, task)
        units = np.repeat([task.force_unit(3), task.torque_unit(3)], 3)
        A, b = wrench_matrix(every) * task.max_input / units[:, None], required_wrenches(every) / units
        possible = [
            linprog(np.zeros(12), A_eq=A, b_eq=w, bounds=np.stack([0 * on, on], axis=1)).status == 0
            for w, on in zip(b, running_rotors(task), strict=True)
        ]
        met = wrench_residuals(every).max(axis=1) <= WRENCH_TOLERANCE
        assert met.tolist() == possible
        assert np.array_equal(every.u.reshape(len(b), -1)[running_rotors(task) == 0], np.zeros(168))


def test_a_design_survives_what_it_is_asked_to_and_few_corners_are_ever_stated() -> None:
    plain = best_design(asked(cases=GENTLE_PUSH), TREE, 4)
    design = best_design(asked(cases=GENTLE_PUSH, rotor_out="hover"), TREE, 4)
    assert audit(design).verdict == "clear"
    assert rows(design)["hover, any rotor dead"].derived == 12
    torque = rows(design)["hover, any rotor dead, torque reserve"]
    assert torque.derived >= torque.stated
    assert plain.objective <= design.objective * (1 + 1e-9)
    assert lower_bound(design.task) <= design.objective
    assert design.solver["corners"] == 168
    assert design.solver["corners_active"] < 40
    assert design.inputs.shape == (3, 3, 4)


def test_the_audit_judges_by_what_it_measures_itself() -> None:
    """From a little less than is left to a little more; and nothing of it where nothing is proven."""
    design = best_design(asked(rotor_out="hover"), TREE, 4)
    measured = audit(design).flight
    left = measured.rotors_out_asked.torque_reserve_Nm
    for share, status in ((0.999, Status.CLEAR), (1.001, Status.VIOLATED)):
        flight = {"units": "SI", "rotor_out": "hover", "rotor_out_torque": share * left}
        judged = changed(design, task={**design.task.model_dump(mode="json"), "flight": flight})
        assert rows(judged)["hover, any rotor dead, torque reserve"].status is status
        judgement = audit(judged)
        assert judgement.verdict is status
        assert (judgement.flight.rotors_out_asked.survive == 12) == (status is Status.CLEAR)


def test_a_design_that_loses_a_rotor_is_violated_and_one_without_proof_undecided(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    design = solved(solve(push(5), Topology.from_key("a70010"), starts=range(4), seed=0))
    flight = {"units": "SI", "rotor_out": "hover", "rotor_out_torque": 0.01}
    judged = changed(design, task={**design.task.model_dump(mode="json"), "flight": flight})
    found = audit(judged)
    assert found.flight.rotors_out_asked.lost == found.flight.rotors_out_hover.lost != ()
    assert {row.status for row in rows(judged).values()} == {Status.VIOLATED}
    monkeypatch.setattr("verify.flight.analysis.CapabilityAnalysis.in_range", False)
    assert {row.status for row in rows(judged).values()} == {Status.UNDECIDED}


def test_a_dead_rotor_is_exempt_from_the_least_input() -> None:
    task = push(3, load_cases=[HOVER], module={"min_input": 0.1}, flight={"rotor_out": "hover"})
    design = best_design(task, TREE, 4)
    assert audit(design).verdict == "clear"
    assert design.inputs.min() >= task.min_input


def test_platforms_that_cannot_survive_are_proven_impossible() -> None:
    weak = push(3, load_cases=[HOVER], module={"max_thrust_to_weight": 1.15}, flight={"rotor_out": "hover"})
    proof = prove_impossible(weak)
    assert proof.message.startswith("flight.rotor_out: 3 modules cannot hover with a rotor dead: all others at")
    assert prove_impossible(weak.model_copy(update={"flight": asked().flight})) is None
    alone = prove_impossible(asked(1, rotor_out="hover"))
    assert alone.message.startswith("flight.rotor_out: one module cannot hover with any of its rotors dead")
    assert prove_impossible(asked(2, rotor_out="hover", rotor_out_torque=0.0)) is None


def test_one_module_indeed_survives_no_set_of_failures_wherever_its_centre_of_mass_is() -> None:
    """A linear program over the place of the centre of mass too: thrust times lever is linear in it."""
    task = push(1, load_cases=[HOVER])
    k = task.module.torque_coefficient / (task.module.thrust_coefficient * task.module.arm_length)
    at = np.array([[1, -1], [-1, -1], [-1, 1], [1, 1]]) / np.sqrt(2)
    A, b = [], []
    for dead in range(4):  # unknowns: place (2), then shares of each failure (4 each), not of the dead
        for row, rest in ((np.ones(4), 1.0), (k * np.array([-1.0, 1.0, -1.0, 1.0]), 0.0)):
            A.append(np.concatenate([np.zeros(2 + 4 * dead), row, np.zeros(4 * (3 - dead))]))
            b.append(rest)
        for axis in range(2):
            line = np.concatenate([np.zeros(2 + 4 * dead), at[:, axis], np.zeros(4 * (3 - dead))])
            line[axis] = -1.0
            A.append(line)
            b.append(0.0)
    free = [(None, None)] * 2 + [(0.0, 0.0 if q == dead else 1.0) for dead in range(4) for q in range(4)]
    assert linprog(np.zeros(18), A_eq=np.array(A), b_eq=b, bounds=free).status == 2
    free[2:6], A, b = free[2:6], A[:4], b[:4]
    assert linprog(np.zeros(6), A_eq=np.array(A)[:, :6], b_eq=b, bounds=free[:6]).status == 0  # of one it does


def test_mirrored_trees_cost_the_same_with_failures() -> None:
    task = push(4, load_cases=GENTLE_PUSH, flight={"rotor_out": "hover"})
    assert improper_isometry(task) is not None  # the one that exchanges x and y
    tree = Topology(((-1, -1, -1), (0, 0, 2), (1, 1, 3), (2, 0, 2)))
    mirror = Topology(((-1, -1, -1), (0, 0, 2), (1, 3, 1), (2, 0, 2)))
    one, other = (best_design(task, each, 8).objective for each in (tree, mirror))
    assert one == pytest.approx(other, rel=1e-4)


def test_a_program_that_takes_in_corners_ends_where_one_with_all_of_them_does() -> None:
    task = whole(asked(cases=GENTLE_PUSH, force_reserve=0.15, directions="horizontal"))
    from nlp.starts.random_starts import draw, generator

    found = []
    for begun in (without_corners(task), task):
        best = []
        for s in range(6):
            origin = draw(begun, TREE, generator(begun, TREE, s, 0))
            best.append(solve_lazily(task, s, origin, far=True))
        found.append(min(best, key=lambda outcome: outcome.rank))
    assert found[0].worst.met
    assert found[1].worst.met
    assert found[0].objective == pytest.approx(found[1].objective, rel=1e-5)
    assert len(found[0].corners) < len(found[1].corners) == 8


@pytest.mark.slow
def test_a_task_that_asks_for_less_finds_no_worse_design() -> None:
    """Without ball, rod and exclusion few of the best ends of the descents become good designs."""
    text = read_task(Path(__file__).parent / "designs/survives-a-rotor.toml").model_dump(
        mode="json", exclude={"exposure"}
    )
    text["end_effector"].update(exclusion=False, rod="none", largest_reach=False)
    found = best_design(older_task(text).resolve(3), TREE, 8)
    assert found.objective < 8.63e13  # 8.784e13 where only the best ends go on


# ---- A polish that ends in NaN leaves its start where it was: never a design, and a reason in numbers.

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

"""What joints bear: the solver's loads against the audit's, derivatives, and limits that designs keep."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from nlp_cases import GENTLE_PUSH, HOVER, as_design, best_design, push, random_point, random_tree, solved
from suites import few

from nlp import joints, solve
from nlp.assembled.problem import AssembledProblem
from nlp.joints import LimitedLoads, holder, limit_rows, limited_loads, loads
from nlp.numbers.point import Point
from nlp.requirements import clearances
from nlp.requirements.balances import required_wrenches, wrench_matrix, wrench_residuals
from topo_search.model import BadInput, Design, Infeasible, Status, Task, Topology
from topo_search.model.files import read_json, validate
from verify import audit, choose_mount
from verify.flight.joints import joint_loads
from verify.kinematics import platform

TREE = Topology.from_key("a300")
TWISTED = [*GENTLE_PUSH, {"com": {"force": [0.0, 0.1, 0.9], "torque": [0.2, 0.1, -0.3]}}]


@pytest.fixture
def out_of_reach() -> Design:
    """Two modules with the end-effector at the centre of mass, where no straight rod ends."""
    return read_json(Design, Path(__file__).parent / "designs/tip-out-of-reach.json")


def balanced(point: Point) -> Point:
    """The point with inputs, of any sign, that produce its load cases."""

    u = np.linalg.lstsq(wrench_matrix(point), required_wrenches(point).T, rcond=None)[0].T
    return replace(point, u=u.reshape(point.u.shape))


@pytest.mark.parametrize("joint_mass", few([0.04, 0.0], 1))
@pytest.mark.parametrize("fields", [{}, {"position": [0.1, 0.1, 0.3]}, {"rod_radius": 0.005}])
def test_loads_are_those_of_the_audit_at_any_balanced_point(fields: Any, joint_mass: float) -> None:
    """The larger of both sides, where no rod reaches and where it is not sure from where the audit's rod comes."""
    rng, asked, known = np.random.default_rng(0), {"joint_moment": 1.0, "joint_force": 1.0}, list[bool]()
    for n in (4, 5, 6) * 3:
        module = {"joint_mass": joint_mass}
        task = push(n, load_cases=TWISTED, flight=asked, end_effector=fields, module=module)
        point = random_point(task, random_tree(n, rng), rng)
        if task.end_effector.fixed_position is None:
            point = replace(point, tip=rng.uniform(0.5, 4.0) * point.tip)
        point = balanced(point)
        if wrench_residuals(point).max() > 1e-9:
            continue  # a chain, which cannot produce every wrench
        design = as_design(point)
        found, mount, held, own = platform(design), choose_mount(design), holder(point), loads(point)
        assert held is None or (mount is not None and held == mount.module)
        bolted = None if mount is None else mount.module
        for carrier in {held, bolted}:
            rows = [
                load
                for k, case in enumerate(task.load_cases)
                for load in joint_loads(design, found, case, point.u[k], "", carrier)
            ]
            audited = np.array([r.force_N for r in rows] + [r.moment_Nm for r in rows])
            assert np.all(own >= audited * (1 - 1e-6))
            if carrier == held:
                assert own == pytest.approx(audited, rel=1e-6)
        known.append(held is not None)
    assert len(known) > 5
    assert any(known)
    assert not all(known)


@pytest.mark.parametrize("held", few([None, 0], 1))
def test_rows_and_derivatives_of_a_limited_problem_are_those_of_both(
    held: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(1)
    task, topology = push(4, load_cases=TWISTED, flight={"joint_moment": 1.0}), random_tree(4, rng)
    point = random_point(task, topology, rng)
    base = AssembledProblem(task, topology, clearances(task, topology), 50.0)
    listed = limited_loads(task, topology)[::3]
    both, x = AssembledProblem(task, topology, clearances(task, topology), 50.0), point.pack()
    both.append(limit_rows(task, topology, LimitedLoads(held, listed)))
    unit = task.module.arm_length * task.module.mass * task.gravity
    L = np.array([load.limit for load in listed]) / unit
    limited = both.constraints(x)[base.rows :].reshape(len(listed), -1).min(axis=1)
    monkeypatch.setattr(joints, "holder", lambda _: held)
    at = dict(zip(limited_loads(task, topology), loads(point), strict=True))
    sizes = np.array([at[load] for load in listed]) / unit
    assert limited == pytest.approx((L**2 - sizes**2) / (2 * L), rel=1e-9)

    def gradient(y: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        J = np.array(ca.DM(both.jacobian_pattern, both.jacobian(y)))
        return both.gradient(y) * 0.7 + J.T @ multipliers

    multipliers, step = rng.normal(size=both.rows), 1e-6
    H = np.array(ca.DM(both.hessian_pattern, both.hessian(x, 0.7, multipliers)))
    H = H + np.triu(H, 1).T
    J = np.array(ca.DM(both.jacobian_pattern, both.jacobian(x)))
    for j in range(0, len(x), 5):
        e = step * np.eye(len(x))[j]
        slope = (both.constraints(x + e) - both.constraints(x - e)) / (2 * step)
        assert slope == pytest.approx(J[:, j], rel=1e-5, abs=1e-6)
        bend = (gradient(x + e, multipliers) - gradient(x - e, multipliers)) / (2 * step)
        assert bend == pytest.approx(H[:, j], rel=1e-5, abs=1e-4)


def test_a_design_keeps_the_largest_moment_that_it_is_asked_to_and_the_audit_judges_it() -> None:
    plain = best_design(push(3, load_cases=GENTLE_PUSH), TREE, 4)
    flight = audit(plain).flight
    most = 0.9 * flight.joint_moment_Nm
    asked = push(3, load_cases=GENTLE_PUSH, flight={"joint_moment": most})
    design = best_design(asked, TREE, 4)
    judged = audit(design)
    assert judged.verdict == "clear"
    (row,) = (row for row in judged.residuals if row.name == "largest moment in a joint")
    assert row.derived <= row.stated * (1 + 1e-6)
    assert design.objective >= plain.objective
    again = audit(plain.model_copy(update={"task": asked}))
    (row,) = (row for row in again.residuals if row.name == "largest moment in a joint")
    assert row.status is Status.VIOLATED


def test_where_no_rod_reaches_either_side_of_a_joint_carries_the_end_effector(out_of_reach: Design) -> None:
    """The limit is between the forces of the two sides."""
    found = platform(out_of_reach)
    (case,), u = out_of_reach.task.load_cases[1:], out_of_reach.inputs[1]
    fields = ("force_N", "moment_Nm", "about_hinge_Nm", "across_hinge_Nm")
    one, other, either = (
        [
            getattr(load, field)
            for load in joint_loads(out_of_reach, found, case, u, "", carrier)
            for field in fields
        ]
        for carrier in (0, 1, None)
    )
    assert either == pytest.approx(np.maximum(one, other))
    assert either not in (pytest.approx(one), pytest.approx(other))
    judged = audit(out_of_reach)
    (row,) = (row for row in judged.residuals if row.name == "largest force in a joint")
    assert min(one[0], other[0]) < row.stated < max(one[0], other[0]) == pytest.approx(row.derived)
    assert row.status is Status.VIOLATED
    assert judged.verdict == "violated"


def test_a_limit_is_kept_whichever_side_carries_an_end_effector_out_of_reach(out_of_reach: Design) -> None:
    task, topology = out_of_reach.task, out_of_reach.topology
    for most, able in ((task.flight.joint_force, False), (3.8, True)):
        limited = task.model_copy(update={"flight": task.flight.model_copy(update={"joint_force": most})})
        found = solve(limited, topology, starts=range(2), seed=0)
        assert isinstance(found, Design) == able
        if isinstance(found, Design):
            assert audit(found).verdict == "clear"


def test_a_rating_is_that_of_the_module_and_must_be_given() -> None:
    fields = {"name": "t", "modules": 3, "load_cases": [HOVER], "flight": {"joint_moment": "rated"}}
    with pytest.raises(BadInput, match=r'module.joint_moment: must be given with flight.joint_moment = "rated"'):
        validate(Task, fields, "t")
    rated = validate(Task, {**fields, "module": {"joint_moment": 4.0}}, "t").resolve(3)
    assert rated.joint_limits == (None, 4.0)
    for wrong in ("high", True, 0.0):
        with pytest.raises(BadInput, match=r"flight.joint_moment: must be"):
            validate(Task, {**fields, "flight": {"joint_moment": wrong}}, "t")


def test_a_limit_of_joints_may_be_all_that_keeps_a_tree_from_a_design() -> None:
    """Without it, and with a larger one, there is a design, which uses the whole limit."""
    loose, tight = (
        solve(push(3, load_cases=GENTLE_PUSH, flight={"joint_moment": most}), TREE, starts=range(4), seed=0)
        for most in (0.21, 0.141)
    )
    assert isinstance(tight, Infeasible)
    assert "moment in the joint of module" in tight.worst_constraint
    assert tight.worst_constraint in tight.message
    judged = audit(solved(loose))
    assert judged.verdict == "clear"
    (row,) = (row for row in judged.residuals if row.name == "largest moment in a joint")
    assert row.derived == pytest.approx(0.21, rel=1e-3)

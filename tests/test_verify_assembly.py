"""The assembly sheet: joints in bolting order, the rod, and the table that goes to the workshop."""

import csv
import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from older import older_task
from verify_cases import FAN, design, fan
from wording import says

from topo_search.model import ResolvedTask, Status, Topology
from topo_search.model.files import to_toml
from topo_search.model.proven import upper_text
from verify import audit, poses
from verify.kinematics import quarter_turns, rotation

BRANCHED = Topology(((-1, -1, -1), (0, 1, 3), (1, 0, 2), (0, 2, 1), (2, 1, 3)))


def test_every_module_is_bolted_to_one_that_is_already_there():
    sheet = audit(design(BRANCHED, {}, hinges=(0.1, -0.2, 0.3, -0.4))).assembly
    there = {0}
    for joint in sheet.joints:
        assert joint.module in there
        assert joint.child not in there
        there.add(joint.child)
    assert there == set(range(5))
    found = [(joint.module, joint.port, joint.child, joint.child_port) for joint in sheet.joints]
    assert found == [(h, a, i, b) for h, i, a, b in BRANCHED.edges()]
    assert [joint.angle_deg for joint in sheet.joints] == pytest.approx(
        [math.degrees(alpha) for alpha in (0.1, -0.2, 0.3, -0.4)]
    )


def test_the_table_holds_the_same_joints_and_the_rod_as_its_last_step():
    result = audit(fan())
    rows = list(csv.DictReader(io.StringIO(result.assembly.csv())))
    assert [row["step"] for row in rows] == ["1", "2", "3"]
    for row, joint in zip(rows, result.assembly.joints, strict=False):
        assert (int(row["module"]), int(row["port"])) == (joint.module, joint.port)
        assert (int(row["child"]), int(row["child_port"])) == (joint.child, joint.child_port)
        assert float(row["angle_deg"]) == joint.angle_deg
    tip = result.assembly.end_effector
    last = rows[-1]
    assert (int(last["module"]), int(last["port"]), last["child"]) == (
        tip.mount.module,
        tip.mount.port,
        "end-effector",
    )
    assert float(last["rod_length_m"]) == tip.rod.length_m
    assert tuple(float(last[f"rod_{axis}"]) for axis in "xyz") == tip.rod.direction_in_module


def test_positions_beyond_all_digits_leave_the_mount_open():
    result = audit(fan(end_effector=(1e100, 0.0, 0.0)))
    tip = result.assembly.end_effector
    assert (tip.mount, tip.rod, tip.connectors) == (None, None, ())
    assert "too large" in tip.note


@pytest.mark.parametrize(("away", "told"), [(0.6, False), (20.0, True)])
def test_a_rod_far_longer_than_the_platform_is_wide_is_told(away, told):
    tip = audit(fan(end_effector=(0.0, 0.0, away))).assembly.end_effector
    assert (tip.note is not None) == told
    if told:
        assert tip.note.startswith(f"the rod is {tip.rod.length_m:.3g} m long, ")


@pytest.mark.parametrize(("reach", "told"), [(0.4, False), (False, True), (2.0, True)])
def test_a_rod_that_bends_too_far_is_told_unless_its_reach_is_limited(reach, told):
    """A position 0.9 m away, for rods that are stiff up to half a metre."""
    rod = {"rod": "straight", "rod_linear_density": 0.05, "largest_reach": reach}
    design = fan({"end_effector": rod}, end_effector=(0.0, 0.0, 0.9))
    note = audit(design).assembly.end_effector.note
    stiff = design.task.stiff_length(3)
    assert says(note or "", "rod_deflection", f"{stiff:.3g} m") == told


def test_a_rod_of_five_percent_of_the_mass_is_told_with_what_it_weighs():
    given = fan({"end_effector": {"rod_linear_density": 0.5}}, end_effector=(0.3, 0.4, 0.3))
    found = audit(given)
    rod, p_E = found.assembly.end_effector.rod, found.assembly.end_effector.from_com_m
    share = rod.mass_kg / (3 * 0.24 + 0.048)
    assert found.flight.rod_mass_share == share > 0.05
    middle = [x - rod.length_m / 2 * d for x, d in zip(p_E, rod.direction, strict=True)]
    weight = 9.81 * rod.mass_kg
    told = f"the rod, {100 * share:.3g} % of the platform's mass, is left out of the model: {weight:.3g} N"
    assert f"{told}, and {weight * math.hypot(*middle[:2]):.3g} N m about the centre of mass" in (
        found.assembly.end_effector.note
    )
    light = fan({"end_effector": {"rod_linear_density": 0.01}}, end_effector=(0.3, 0.4, 0.3))
    assert audit(light).assembly.end_effector.note is None


STEADY = {"module": {"max_thrust_to_weight": 4.0}, "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}]}
IGNORED = {"rod": "straight", "largest_reach": False, "rod_linear_density": 0.1}


def with_rod(flight, **end_effector):
    return fan(
        {**STEADY, "end_effector": {**IGNORED, **end_effector}, "flight": flight}, end_effector=(0.3, 0.4, 0.3)
    )


@pytest.mark.parametrize(
    "flight", [{"torque_reserve": 1.0}, {"rotor_out": "hover", "rotor_out_torque": 1.0, "torque_reserve": 2.0}]
)
def test_an_ignored_rod_may_not_take_all_of_a_required_torque_reserve(flight):
    found = audit(with_rod({}))
    tip = found.assembly.end_effector
    middle = [x - tip.rod.length_m / 2 * d for x, d in zip(tip.from_com_m, tip.rod.direction, strict=True)]
    moment = 9.81 * tip.rod.mass_kg * math.hypot(*middle[:2])
    assert found.flight.rod_moment_Nm == pytest.approx(moment, rel=1e-12)
    assert not any("rod whose" in row.name for row in found.residuals)
    assert f"takes {upper_text(moment, 3)} N m of" in found.flight.weakest_point
    for share, status in ((0.999, Status.VIOLATED), (1.001, Status.CLEAR)):
        sizes = {key: share * moment * x if "torque" in key else x for key, x in flight.items()}
        (row,) = [row for row in audit(with_rod({"units": "SI", **sizes})).residuals if "rod whose" in row.name]
        assert (row.status, row.derived) == (status, pytest.approx(moment))
        assert 'end_effector.rod_mass = "included"' in row.name


def test_a_rod_that_no_task_asks_for_takes_no_torque():
    for end_effector in ({"rod": "none"}, {"rod_linear_density": 0.0}):
        assert not audit(with_rod({"units": "SI", "torque_reserve": 1e-3}, **end_effector)).flight.rod_moment_Nm


# ---- The audit's own forward kinematics, by hand and against products of rotations.


def test_a_flat_row_is_a_row():
    found = poses(FAN, (0.0, 0.0, 0.0), (0.0, 0.0), 0.15)
    assert np.array_equal(found.R, np.broadcast_to(np.eye(3), (3, 3, 3)))
    assert found.p == pytest.approx(np.array([[0, 0, 0], [0.3, 0, 0], [-0.3, 0, 0]]))


def test_the_root_turns_about_z_then_x_then_y():
    psi, alpha_0, alpha_1 = 0.3, -0.4, 0.5
    (R,), _ = poses(Topology(((-1, -1, -1),)), (psi, alpha_0, alpha_1), (), 0.15)
    c, s = np.cos([psi, alpha_0, alpha_1]), np.sin([psi, alpha_0, alpha_1])
    expected_z = [c[0] * s[2] + s[0] * s[1] * c[2], s[0] * s[2] - c[0] * s[1] * c[2], c[1] * c[2]]
    assert R[:, 2] == pytest.approx(expected_z, abs=1e-15)


@given(st.integers(-4, 8))
def test_quarter_turns_are_exact(kappa):
    assert quarter_turns(kappa) == pytest.approx(rotation(2, kappa * math.pi / 2), abs=1e-14)
    assert set(np.unique(quarter_turns(kappa))) <= {-1.0, 0.0, 1.0}


# ---- A task may ask for a straight rod: then the audit judges what it otherwise tells.

ONE = Topology(((-1, -1, -1),))
WALLS = {"hub": [0.28, 0.28, 0.5], "rotor_radius": 0.005, "rotor_height": 0.001}
NAME = "straight rod to the end-effector"


def judged(rod, tip, **task):
    """The verdict, and what of the rod is not clear and counts."""
    end_effector = {**task.pop("end_effector", {}), "rod": rod}
    return audit(design(ONE, {"end_effector": end_effector, **task}, hinges=(), end_effector=tip))


def test_a_clear_rod_is_clear_either_way():
    for rod in ("none", "straight"):
        result = judged(rod, (0.0, 0.0, 0.36))
        assert result.verdict is Status.CLEAR
        assert [row.status for row in result.residuals if row.name == NAME] == [Status.CLEAR] * (rod == "straight")


def test_a_rod_in_airflow_violates_where_one_is_asked_for():
    """Below the module it passes through the airflow, on a task that gives everything else up."""
    loose = {"search": {"body_clearance": False}, "end_effector": {"exclusion": False}}
    plain, asked = (judged(rod, (0.0, 0.0, -0.6), **loose) for rod in ("none", "straight"))
    assert plain.verdict is Status.CLEAR
    assert asked.verdict is Status.VIOLATED
    assert [pair.kind for pair in asked.pairs if pair.status is not Status.CLEAR] == ["rod-airflow"]


@pytest.mark.parametrize("clearance", [False, None])
def test_where_no_straight_rod_reaches_a_row_says_so(clearance):
    blocked = {
        "module": {"body": WALLS},
        "end_effector": {"exclusion": False},
        "search": {} if clearance is None else {"body_clearance": clearance},
    }
    plain, asked = (judged(rod, (0.0, 0.0, 0.1), **blocked) for rod in ("none", "straight"))
    assert not [row for row in plain.residuals if row.name == NAME]
    (row,) = (row for row in asked.residuals if row.name == NAME)
    assert (row.status, row.value) == (Status.VIOLATED, 1.0)
    assert asked.verdict is Status.VIOLATED


def test_the_reach_of_its_rod_is_judged_where_it_is_limited():
    """The nearest connector is 0.15 m beside the centre: 0.39 m from a tip that is 0.36 m above it."""
    for reach, status in ((0.4, Status.CLEAR), (0.38, Status.VIOLATED)):
        result = judged("none", (0.0, 0.0, 0.36), end_effector={"largest_reach": reach})
        (row,) = (row for row in result.residuals if row.name == "reach of the end-effector's rod")
        assert (row.status, result.verdict) == (status, status)
        assert row.derived == pytest.approx(0.39)
        assert row.value == pytest.approx(max(0.0, 0.39 - reach))
    plain = judged("none", (0.0, 0.0, 0.36))
    assert not [row for row in plain.residuals if row.name == "reach of the end-effector's rod"]


def test_where_digits_are_lost_it_is_undecided():
    result = judged("straight", (0.0, 0.0, 1e12), end_effector={"exclusion": False})
    (row,) = (row for row in result.residuals if row.name == NAME)
    assert row.status is Status.UNDECIDED


def test_what_a_design_does_not_state_was_not_asked_for():
    """A task asks for a rod of some length by default; a design of before such tasks is judged as it was."""
    task = older_task(name="t", modules=1, load_cases=[{"carries_weight": True}])
    assert 'rod = "straight"' in to_toml(task)
    stated = task.resolve(1)
    assert (stated.end_effector.rod, stated.largest_reach(1)) == ("straight", task.largest_reach(1))
    assert stated.largest_reach(1) is not None
    plain = stated.model_dump(mode="json")
    del plain["end_effector"]["rod"], plain["end_effector"]["largest_reach"]
    older = ResolvedTask.model_validate(plain)
    assert (older.end_effector.rod, older.largest_reach(1)) == ("none", None)

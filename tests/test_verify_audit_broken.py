"""The audit of designs broken in every way that a design can be: each fault is caught and named."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from verify_cases import changed, design, failing, fan

from topo_search.model import Design, Status, Topology
from verify import audit
from verify.kinematics import platform
from verify.requirements import Scene
from verify.sensitivity import clearance_of


def _rows(given: Design) -> list[list[float]]:
    return [list(row) for row in given.rotor_speeds_squared]


# ---- clearances


@pytest.mark.parametrize(
    ("given", "kind", "modules"),
    [
        (fan(hinges=(0.1, -0.1)), "airflow", {0, 1, 2}),
        (fan({"exposure": [{"kind": "local", "radius": 0.55}]}), "local", {0, 1, 2}),
        (
            fan({"exposure": [{"kind": "directional", "segments": [[0, 0, 1], [0.1, 0, -2]]}]}),
            "directional",
            {0, 1},
        ),
        (fan({"exposure": [{"kind": "exterior", "axis": [0.0, 0.0, 1.0]}]}), "exterior", {0, 1, 2}),
        (fan({"exposure": [{"kind": "exterior", "half_angle_deg": 15.0}]}), "exterior", {1, 2}),
        (
            fan({"exposure": [{"kind": "exterior", "half_angle_deg": 90.0}]}, end_effector=(0, 0.2, 0)),
            "exterior",
            None,
        ),
        (fan(end_effector=(0.0, 0.0, 0.14999)), "exclusion", {0}),
        (fan({"search": {"body_clearance": 0.548}}), "separation", {1, 2}),
        (fan({"search": {"interference": "separation", "separation": 0.29}}), "separation", {0, 1, 2}),
    ],
)
def test_each_broken_requirement_is_caught_and_named(given, kind, modules):
    result = audit(given)
    assert result.verdict == Status.VIOLATED
    assert failing(result) == {kind}
    broken = [pair for pair in result.pairs if pair.status == Status.VIOLATED]
    touched = {pair.a for pair in broken} | {pair.b for pair in broken if kind in {"airflow", "separation"}}
    assert modules is None or modules <= touched
    for pair in broken:
        assert pair.lower_m is None
        assert pair.analytic_m <= pair.upper_m + 1e-12
        assert pair.upper_m < 0


LITTLE = 1e-7
"""A tenth of a micrometre."""

JUST_BROKEN = {
    "airflow": ({}, lambda less: {"module": {"airflow": {"start_radius": 0.1 + less / 2}}}),
    "local": (
        {"exposure": [{"kind": "local", "radius": 0.15}]},
        lambda less: {"exposure": [{"kind": "local", "radius": 0.15 + less}]},
    ),
    "directional": (
        {"exposure": [{"kind": "directional", "radius": 0.1, "segments": [[1.0, 0.0, 0.2]]}]},
        lambda less: {"exposure": [{"kind": "directional", "radius": 0.1 + less, "segments": [[1.0, 0.0, 0.2]]}]},
    ),
    "separation": (
        {"search": {"body_clearance": 0.3}},
        lambda less: {"search": {"body_clearance": 0.3 + less}},
    ),
    "ablation": (
        {"search": {"interference": "separation", "separation": 0.2}},
        lambda less: {"search": {"interference": "separation", "separation": 0.2 + less}},
    ),
}


@pytest.mark.parametrize("name", JUST_BROKEN)
def test_a_requirement_broken_by_a_tenth_of_a_micrometre_is_caught_and_named(name):
    task, tightened = JUST_BROKEN[name]
    kind = "separation" if name == "ablation" else name
    least = min(pair.analytic_m for pair in audit(fan(task)).pairs if pair.kind == kind)
    assert least > 1e-3
    just_met, just_broken = (audit(fan(tightened(least + by))) for by in (-LITTLE, LITTLE))
    assert just_met.verdict == Status.CLEAR, failing(just_met)
    assert just_broken.verdict == Status.VIOLATED
    assert failing(just_broken) == {kind}
    worst = min((pair for pair in just_broken.pairs if pair.kind == kind), key=lambda pair: pair.analytic_m)
    assert worst.status == Status.VIOLATED
    assert worst.analytic_m == pytest.approx(-LITTLE, rel=1e-6)
    assert worst.upper_m == pytest.approx(-LITTLE, rel=1e-3)


def test_a_cone_too_narrow_by_a_millionth_of_a_degree_is_caught_and_named():
    def held(half_angle_deg):
        return fan({"exposure": [{"kind": "exterior", "half_angle_deg": half_angle_deg}]})

    def least(half_angle_deg):
        given = held(half_angle_deg)
        return min(clearance_of(r) for r in Scene(given, platform(given)).requirements() if r.kind == "exterior")

    edge = brentq(least, 15.0, 60.0, xtol=1e-10)
    narrow = audit(held(edge - 1e-6))
    assert audit(held(edge + 1e-6)).verdict == Status.CLEAR
    assert failing(narrow) == {"exterior"}
    assert max(pair.analytic_m for pair in narrow.pairs if pair.status != Status.CLEAR) > -1e-7


def test_an_exclusion_broken_by_a_tenth_of_a_micrometre_is_caught_and_named():
    for by, expected in ((LITTLE, set()), (-LITTLE, {"exclusion"})):
        assert failing(audit(fan(end_effector=(0.0, 0.0, 0.15 + by)))) == expected


def test_the_broken_segment_is_named():
    result = audit(fan({"exposure": [{"kind": "directional", "segments": [[0, 0, 1], [0.1, 0, -2]]}]}))
    assert {pair.segment for pair in result.pairs if pair.status == Status.VIOLATED} == {1}


# ---- numbers and their limits


BROKEN_NUMBERS = {
    "largest input by 1e-4": (
        lambda d: {"rotor_speeds_squared": [[u * (1 + 1e-4 * (u == max(row))) for u in row] for row in _rows(d)]},
        {"load case 0, force", "load case 0, torque", "objective"},
    ),
    "angle by 1e-3": (lambda d: {"hinge_angles_rad": [-0.6, 0.601]}, {"load case 0, force", "load case 0, torque"}),
    "root by 1e-3": (lambda d: {"root_orientation_rad": [0.0, 1e-3, 0.0]}, {"load case 0, force"}),
    "objective by 1e-5": (lambda d: {"objective": d.objective * (1 + 1e-5)}, {"objective"}),
    "end-effector by 1e-4 m": (lambda d: {"end_effector_m": [1e-4, 0.0, 0.6]}, {"load case 0, torque"}),
}


@pytest.mark.parametrize("name", BROKEN_NUMBERS)
def test_numbers_off_by_little_are_caught_and_named(name):
    change, expected = BROKEN_NUMBERS[name]
    given = fan()
    assert audit(given).verdict == Status.CLEAR
    result = audit(changed(given, **change(given)))
    assert result.verdict == Status.VIOLATED
    assert failing(result) >= expected
    assert not failing(result) & {"airflow", "exclusion", "separation"}


def test_an_objective_that_disagrees_is_shown_beside_the_true_one():
    given = fan()
    (row,) = (row for row in audit(changed(given, objective=1.0)).residuals if row.name == "objective")
    assert (row.stated, row.status) == (1.0, Status.VIOLATED)
    assert row.derived == pytest.approx(given.objective, rel=1e-14)


@pytest.mark.parametrize("name", ["largest", "smallest"])
def test_an_input_beyond_its_limit_by_little_is_caught_and_named(name):
    given = fan()
    u = np.array(_rows(given))
    if name == "largest":
        limit = given.task.module.max_thrust_to_weight * u.max() / given.task.module.max_input(given.task.gravity)

        def beyond(by):
            return fan({"module": {"max_thrust_to_weight": limit / (1 + by)}})
    else:
        u_max = given.task.module.max_input(given.task.gravity)

        def beyond(by):
            return changed(given, rotor_speeds_squared=[[-by * u_max, *u[0, 1:].tolist()]])

    row = f"load case 0, {name} rotor input"
    assert row not in failing(audit(beyond(1e-7)))
    assert row in failing(audit(beyond(1e-5)))


@pytest.mark.parametrize(("beyond", "status"), [(1e-7, Status.CLEAR), (1e-5, Status.VIOLATED)])
def test_hinges_bend_to_a_right_angle_and_no_farther(beyond, status):
    given = fan(hinges=(-math.pi / 2 - beyond, 0.6))
    rows = {row.name: row.status for row in audit(given).residuals}
    assert rows["hinge angle of module 1"] == status


@pytest.mark.parametrize(
    ("root", "names"),
    [
        ((0.0, 0.5, -0.5), set()),
        ((1e-3, 0.0, 0.0), {"root orientation, psi"}),
        ((0.0, 1.6, 0.0), {"root orientation, alpha_0"}),
        ((0.0, 0.0, -1.6), {"root orientation, alpha_1"}),
    ],
)
def test_the_papers_root_keeps_to_its_angles(root, names):
    for mode, expected in (("paper", names), ("free", set())):
        result = audit(fan({"search": {"root": mode}}, root=root))
        assert {name for name in failing(result) if name.startswith("root")} == expected


def test_a_given_root_is_kept_to_in_every_angle():
    for axis, name in enumerate(("psi", "alpha_0", "alpha_1")):
        given = [0.1, 0.5, -0.5]
        task = {"search": {"root_orientation_deg": np.degrees(given).tolist()}}
        for change, expected in ((0.0, set()), (1e-4, {f"root orientation, {name}"})):
            given[axis] += change
            result = audit(fan(task, root=tuple(given)))
            assert {name for name in failing(result) if name.startswith("root")} == expected


@pytest.mark.parametrize(("child_port", "broken"), [(2, False), (0, False), (1, True), (3, True)])
def test_ports_against_the_connector_family(child_port, broken):
    turned = Topology(((-1, -1, -1), (0, 0, child_port), (0, 2, 0)))
    for family in ("aligned", "any"):
        result = audit(design(turned, {"search": {"connectors": family}}, hinges=(-0.6, 0.6)))
        name = f'joints against connectors = "{family}"'
        assert (name in failing(result)) == (broken and family == "aligned")


def test_a_fixed_end_effector_stays_where_the_task_puts_it():
    m_E, m_t = 0.048, 3 * 0.24 + 0.048
    above = 0.5 * m_t / (m_t - m_E)  # of the modules' mean, so that it is 0.5 above the COM
    mean_z = float(np.mean([0.0, 0.15 * math.sin(0.6), 0.15 * math.sin(0.6)]))
    position = (0.0, 0.0, mean_z + above)
    fixed = {"end_effector": {"position": [0.0, 0.0, 0.5]}}
    assert "end-effector position" not in failing(audit(fan(fixed, end_effector=position)))
    off = audit(fan(fixed, end_effector=(0.0, 0.0, position[2] + 1e-5)))
    assert "end-effector position" in failing(off)


@pytest.mark.parametrize("offset", [0.0, 1e-300, 0.005])
def test_a_direction_taken_from_p_e_needs_a_p_e(offset):
    mean_z = float(np.mean([0.0, 0.15 * math.sin(0.6), 0.15 * math.sin(0.6)]))
    task = {"exposure": [{"kind": "exterior"}, {"kind": "directional", "along": "end_effector", "length": 1.0}]}
    result = audit(fan(task, end_effector=(0.0, 0.0, mean_z + offset)))
    assert "end-effector's distance from the COM" in failing(result)
    assert result.verdict == Status.VIOLATED


# ---- a set of hinge angles


def test_a_hinge_angle_beside_the_set_of_the_task_is_violated_by_one_bit():
    angle, asked = math.radians(30), {"search": {"hinge_step_deg": 15.0}}
    assert audit(fan(asked, hinges=(-angle, angle))).verdict == audit(fan(hinges=(-angle, angle))).verdict
    beside = audit(fan(asked, hinges=(-angle, math.nextafter(angle, 1.0))))
    row = "hinge angle of module 2 against the task's set"
    assert failing(beside) == {row}
    (found,) = (each for each in beside.residuals if each.name == row)
    assert found.derived == angle
    assert 0 < found.value < 1e-15

"""The audit of whole designs: by hand, what the task asks to judge, through files, with evidence of its faults."""

import json
import math

import numpy as np
import pytest
from pydantic import ValidationError
from verify_cases import FAN, FREE_ABOVE, HOVER, changed, design, failing, fan

from topo_search.model import Audit, Design, Status, Topology
from topo_search.model.clearance import counts
from topo_search.model.files import read_json, to_json
from verify import audit
from verify.kinematics import objective, platform
from verify.meshes import FclPolytope

ONE = Topology(((-1, -1, -1),))
BELOW = (0.0, 0.0, -0.3)


# ---- by hand


@pytest.mark.parametrize("interference", ["airflow", "parts", "separation"])
@pytest.mark.parametrize("rod", ["straight", "none"])
@pytest.mark.parametrize("clearance", [0.3, False])
def test_the_failure_that_is_named_is_one_that_the_verdict_counts(interference, rod, clearance):
    search = {"interference": interference, "body_clearance": interference != "separation" and clearance}
    task = {"search": search, "end_effector": {"rod": rod, "exclusion": False}}
    for hinges, tip in (
        ((0.6, -0.6), (0.1, 0.0, -0.4)),
        ((0.0, 0.0), (0.0, 0.0, -1.0)),
        ((1.5, 1.5), (0.1, 0.0, 0.3)),
    ):
        folded = fan(task, hinges=hinges, end_effector=tip)
        result = audit(folded)
        judged = [pair for pair in result.pairs if counts(pair.kind, folded.task)]
        assert result.verdict == Status.worst(
            [*(p.status for p in judged), *(row.status for row in result.residuals)]
        )
        bad = [pair.name for pair in judged if pair.status is not Status.CLEAR]
        failure = result.failure(folded.task) or ""
        assert any(failure.startswith(name) for name in bad) == bool(bad)
        assert bool(failure) == (result.verdict is not Status.CLEAR)


def test_one_module_hovers_at_a_quarter_of_the_weight_a_rotor():
    given = design(ONE, {}, hinges=(), end_effector=BELOW)
    weight = (0.24 + 0.048) * 9.81
    u = weight / (4 * 3.87e-7)
    assert np.array(given.rotor_speeds_squared) == pytest.approx(np.full((1, 4), u), rel=1e-12)
    by_hand = changed(given, rotor_speeds_squared=[[u] * 4], objective=4 * u * u)
    result = audit(by_hand)
    assert result.verdict == Status.CLEAR
    exclusion, *rod = result.pairs
    assert [(pair.kind, pair.a, pair.b) for pair in rod] == [("rod", 0, -1), ("rod-airflow", 0, 0)]
    assert (exclusion.kind, exclusion.a, exclusion.b, exclusion.segment) == ("exclusion", 0, -1, None)
    assert exclusion.analytic_m == pytest.approx(0.15)
    assert 0 < exclusion.lower_m <= exclusion.analytic_m <= exclusion.upper_m + 1e-12


def test_a_force_at_the_end_effector_turns_about_the_centre_of_mass():
    # f_E = [0, 0, F] at x_E from the COM asks for the torque [0, -x_E F, 0] besides.
    given = design(
        ONE, {"load_cases": [{"end_effector": {"force": [0.0, 0.0, 0.5]}}]}, hinges=(), end_effector=BELOW
    )
    F = 0.5 * (0.24 + 0.048) * 9.81
    moved = changed(given, end_effector_m=[0.2, 0.0, -0.3])
    rows = {row.name: row for row in audit(moved).residuals}
    # The COM moves by 0.2 m_E / m_t; the torque of equal thrusts at the module's centre moves with it.
    x_com = 0.2 * 0.048 / 0.288
    expected = abs(-(0.2 - x_com) * F - x_com * F)
    assert rows["load case 0, torque"].value == pytest.approx(expected, rel=1e-12)
    assert rows["load case 0, torque"].scaled == pytest.approx(0.2 * 0.5 / 0.1, rel=1e-12)
    assert rows["load case 0, torque"].status == Status.VIOLATED
    assert rows["load case 0, force"].status == Status.CLEAR


def test_two_modules_tilted_apart():
    tilt = 0.25
    chain = Topology(((-1, -1, -1), (0, 0, 2)))
    given = design(chain, {}, hinges=(-2 * tilt,), root=(0.0, 0.0, tilt), end_effector=(0.145, 0.0, 0.5))
    u = np.array(given.rotor_speeds_squared).reshape(2, 4)
    assert u.sum(axis=1) * 3.87e-7 * math.cos(tilt) == pytest.approx(2 * [(0.48 + 0.048) * 9.81 / 2], rel=1e-2)
    result = audit(given)
    assert result.verdict == Status.CLEAR
    airflow = next(pair for pair in result.pairs if pair.kind == "airflow")
    # Diverging axes: the start balls are nearest, 2 l_c cos(tilt) apart, unless growth outruns the divergence.
    assert airflow.analytic_m == pytest.approx(0.3 * math.cos(tilt) - 0.2, abs=5e-3)


def test_the_objective_weighs_its_cases():
    given = fan({"load_cases": [HOVER, {**HOVER, "weight": 3.0}]})
    one = fan()
    assert objective(given) == pytest.approx(4 * one.objective)
    assert FAN.n == one.topology.n


# ---- what the task asks to judge


def test_every_kind_of_requirement_clear_at_once():
    given = fan(
        {"exposure": FREE_ABOVE, "load_cases": [HOVER, {"com": {"force": [0.05, 0.0, 0.9]}, "weight": 2.0}]}
    )
    result = audit(given)
    assert result.verdict == Status.CLEAR, failing(result)
    count = {kind: sum(pair.kind == kind for pair in result.pairs) for kind in {pair.kind for pair in result.pairs}}
    parts = {"separation": 1, "body": 3, "rod": 3, "rotor-airflow": 30, "rod-airflow": 3}
    assert count == {"airflow": 3, "local": 3, "directional": 9, "exterior": 6, "exclusion": 3, **parts}
    places = {(pair.kind, pair.b, pair.segment) for pair in result.pairs if pair.a == 2}
    assert {("directional", 1, 0), ("directional", 1, 1), ("directional", 2, 0), ("exterior", 3, None)} <= places
    assert {(pair.a, pair.b) for pair in result.pairs if pair.kind == "separation"} == {(1, 2)}
    for pair in result.pairs:
        assert 0 < pair.lower_m <= pair.analytic_m + 1e-12 <= pair.upper_m + 2e-12
    names = [row.name for row in result.residuals]
    assert len(set(names)) == len(names)
    assert {"load case 1, force", "hinge angle of module 2", "objective"} <= set(names)


def test_the_ablation_measures_airflow_but_judges_separation():
    overlapping = {"hinges": (0.5, -0.5)}
    task = {"search": {"interference": "separation"}}
    result = audit(fan(task, **overlapping))
    assert failing(result) == {"airflow"}
    assert result.verdict == Status.CLEAR
    assert {(pair.a, pair.b) for pair in result.pairs if pair.kind == "separation"} == {(0, 1), (0, 2), (1, 2)}
    assert result.interference.colliding_pairs == 3
    assert audit(fan(**overlapping)).verdict == Status.VIOLATED


def test_without_body_clearance_no_separation_is_judged():
    assert not any(p.kind == "separation" for p in audit(fan({"search": {"body_clearance": False}})).pairs)


def test_a_stand_off_is_the_distance_of_the_exclusion():
    """p_E is 0.3 m from the only module."""
    for asked, spare, verdict in ((0.1, 0.15, "clear"), (0.25, 0.05, "clear"), (0.3001, -0.0001, "violated")):
        result = audit(design(ONE, {"end_effector": {"stand_off": asked}}, hinges=(), end_effector=BELOW))
        (exclusion,) = (pair for pair in result.pairs if pair.kind == "exclusion")
        assert exclusion.analytic_m == pytest.approx(spare, abs=1e-12)
        assert (exclusion.status, result.verdict) == (verdict, verdict)


@pytest.mark.parametrize(("away", "torque"), [(7e6, 3.0), (100.0, 4e-5)])
def test_a_long_lever_hides_no_torque(away: float, torque: float):
    """The end-effector takes the COM along: far from rotors a force within the tolerance is a torque beyond it."""
    asked = {"units": "SI", "end_effector": {"torque": [0.0, torque, 0.0]}}
    given = fan({"load_cases": [asked]}, end_effector=(away, 0.0, 0.6))
    found = platform(given)
    force = torque / -float(found.o[0, 0])  # of the root, straight up, by its lever about the COM
    u = np.zeros(12)
    u[:4] = force / (4 * given.task.module.thrust_coefficient)
    given = changed(given, rotor_speeds_squared=[u.tolist()])
    given = changed(given, objective=objective(given))
    rows = {row.name: row.status for row in audit(given).residuals}
    assert rows["load case 0, force"] == rows["load case 0, torque"] == Status.CLEAR
    assert rows["load case 0, torque about the end-effector"] == Status.VIOLATED
    assert (rows["end-effector's reach"] == Status.VIOLATED) == (away > 1e6)


@pytest.mark.parametrize("field", ["position", "stand_off"])
def test_a_task_with_an_absurd_position_is_bad_input(field: str):
    with pytest.raises(ValidationError, match=r"must hold, but got"):
        fan({"end_effector": {field: [7e6, 0.0, 0.0] if field == "position" else 7e6}})


def test_a_small_share_of_the_inputs_is_held_as_exactly_as_all():
    """A thousandth of the largest input, exceeded by a thousandth of itself."""
    hover = [{"units": "SI", "com": {"force": [0.0, 0.0, 0.0025 * 0.24 * 9.81]}}]
    given = design(
        ONE, {"search": {"peak_input": 0.001 / 1.001}, "load_cases": hover}, hinges=(), end_effector=BELOW
    )
    (row,) = (row for row in audit(given).residuals if row.name == "load case 0, largest rotor input")
    assert row.scaled == pytest.approx(1e-3, rel=1e-6)
    assert row.status == Status.VIOLATED


def test_rotor_inputs_are_held_against_the_share_that_the_task_allows():
    """Hovering needs m_t / m of 1 / 2.5 of u_max, 0.48."""
    for share, missed in ((0.49, 0.0), (0.48, 0.0), (0.47, 0.01 / 0.47)):
        given = design(ONE, {"search": {"peak_input": share}}, hinges=(), end_effector=BELOW)
        result = audit(given)
        (row,) = (row for row in result.residuals if row.name == "load case 0, largest rotor input")
        assert row.scaled == pytest.approx(missed, abs=1e-9)
        assert row.derived == pytest.approx(share * given.task.module.max_input(9.81), rel=1e-12)
        assert (row.status == "violated") == (missed > 0)


def test_contacts_and_versions_are_listed():
    result = audit(fan())
    assert [(contact.kind, contact.a, contact.b) for contact in result.allowed_contacts] == [
        ("body", 0, 1),
        ("body", 0, 2),
        ("rod", 1, -1),
    ]
    assert set(result.versions) >= {"python-fcl", "numpy"}


# ---- files


def test_an_audit_goes_through_its_file_and_repeats_itself(tmp_path):
    result = audit(fan({"exposure": FREE_ABOVE}))
    path = tmp_path / "audit.json"
    path.write_text(to_json(result), encoding="utf-8")
    assert read_json(Audit, path) == result
    again = audit(fan({"exposure": FREE_ABOVE}))
    assert (again.pairs, again.residuals) == (result.pairs, result.residuals)


@pytest.mark.parametrize("broken", [{}, {"hinge_angles_rad": [0.1, -0.1]}, {"objective": 1.0}])
def test_a_file_of_another_program_is_judged_like_our_own(broken, tmp_path):
    free = {"rod": "none", "largest_reach": False}  # as in files that say nothing of rods
    ours = changed(fan({"exposure": FREE_ABOVE, "end_effector": free}), **broken)
    told = json.loads(to_json(ours))
    foreign = {name: told[name] for name in sorted(told, reverse=True) if told[name] is not None}
    for name in ("topology_key", "lower_bound", "gap", "solver", "root_module"):
        foreign.pop(name, None)
    foreign["task"] = {"name": "theirs", "modules": 3, "load_cases": [HOVER], "exposure": FREE_ABOVE}
    foreign["made_by"] = {"program": "another", "version": [1, 2]}
    path = tmp_path / "theirs.json"
    path.write_text("\ufeff" + json.dumps(foreign, indent=7).replace("0.0,", "0,"), encoding="utf-8")
    theirs = audit(read_json(Design, path))
    mine = audit(ours)
    assert mine.verdict == (Status.VIOLATED if broken else Status.CLEAR)
    assert (theirs.verdict, theirs.pairs, theirs.residuals) == (mine.verdict, mine.pairs, mine.residuals)
    assert (theirs.interference, theirs.assembly) == (mine.interference, mine.assembly)


# ---- the program itself


def test_a_fault_of_the_audit_itself_comes_with_its_evidence(monkeypatch):
    given = fan({"exposure": FREE_ABOVE[3:4]})
    assert not any(pair.evidence for pair in audit(given).pairs)
    monkeypatch.setattr(FclPolytope, "overlaps", lambda self, other: True)
    result = audit(given)
    assert result.verdict == Status.INCONSISTENT
    assert {pair.status for pair in result.pairs} == {Status.INCONSISTENT}
    for pair in result.pairs:
        assert pair.evidence[0].startswith("body: ")
        assert any("not confirmed by FCL" in line for line in pair.evidence)
    assert Audit.model_validate_json(to_json(result)) == result


def test_a_load_case_is_told_by_its_name() -> None:
    result = audit(design(FAN, {"load_cases": [{**HOVER, "name": "hold"}]}, hinges=(0.0, 0.0)))
    assert {"load case 0 (hold), force", "load case 0 (hold), largest rotor input"} <= {
        row.name for row in result.residuals
    }
    assert [case.name for case in result.flight.cases] == ["hover", "load case 0 (hold)"]

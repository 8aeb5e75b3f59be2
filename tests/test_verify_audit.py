"""The audit of whole designs: clear ones by hand, and one broken in every way that a design can be."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest
from verify_cases import FAN, HOVER, changed, design, fan

from topo_search.model import Audit, Design, Status, Topology
from topo_search.model.files import read_json, to_json
from verify import audit
from verify.fcl_queries import Shape
from verify.wrench import objective

ONE = Topology(((-1, -1, -1),))
BELOW = (0.0, 0.0, -0.3)
FREE_ABOVE = [
    {"kind": "local", "radius": 0.15},
    {"kind": "directional", "radius": 0.1, "segments": [[0.0, 0.0, 1.0], [1.0, 0.0, 0.2]]},
    {"kind": "directional", "radius": 0.1, "along": "end_effector", "length": 2.0},
    {"kind": "exterior", "half_angle_deg": 60.0},
    {"kind": "exterior", "half_angle_deg": 90.0, "axis": [0.0, 0.1, -1.0]},
]


def failing(result: Audit) -> set[str]:
    """The kinds and names of everything that is not clear."""
    kinds = {pair.kind for pair in result.pairs if pair.status != Status.CLEAR}
    return kinds | {row.name for row in result.residuals if row.status != Status.CLEAR}


# ---- by hand


def test_one_module_hovers_at_a_quarter_of_the_weight_a_rotor():
    given = design(ONE, {}, hinges=(), end_effector=BELOW)
    weight = (0.24 + 0.048) * 9.81
    u = weight / (4 * 3.87e-7)
    assert np.array(given.rotor_speeds_squared) == pytest.approx(np.full((1, 4), u), rel=1e-12)
    by_hand = changed(given, rotor_speeds_squared=[[u] * 4], objective=4 * u * u)
    result = audit(by_hand)
    assert result.verdict == Status.CLEAR
    exclusion, *rod = result.pairs
    assert [(pair.kind, pair.a, pair.b) for pair in rod] == [("rod", 0, -1)]
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


def test_every_kind_of_requirement_clear_at_once():
    given = fan(
        {"exposure": FREE_ABOVE, "load_cases": [HOVER, {"com": {"force": [0.05, 0.0, 0.9]}, "weight": 2.0}]}
    )
    result = audit(given)
    assert result.verdict == Status.CLEAR, failing(result)
    count = {kind: sum(pair.kind == kind for pair in result.pairs) for kind in {pair.kind for pair in result.pairs}}
    parts = {"separation": 1, "body": 3, "rod": 3}
    assert count == {"airflow": 3, "local": 3, "directional": 9, "exterior": 6, "exclusion": 3, **parts}
    places = {(pair.kind, pair.b, pair.segment) for pair in result.pairs if pair.a == 2}
    assert {("directional", 1, 0), ("directional", 1, 1), ("directional", 2, 0), ("exterior", 3, None)} <= places
    assert {(pair.a, pair.b) for pair in result.pairs if pair.kind == "separation"} == {(1, 2)}
    for pair in result.pairs:
        assert pair.lower_m is not None
        assert pair.upper_m is not None
        assert 0 < pair.lower_m <= pair.analytic_m + 1e-12 <= pair.upper_m + 2e-12
    names = [row.name for row in result.residuals]
    assert len(set(names)) == len(names)
    assert {"load case 1, force", "hinge angle of module 2", "objective"} <= set(names)


def test_the_joints_are_listed_in_bolting_order():
    result = audit(fan())
    assert [joint.model_dump() for joint in result.assembly.joints] == [
        {"module": 0, "port": 0, "child": 1, "child_port": 2, "angle_deg": pytest.approx(math.degrees(-0.6))},
        {"module": 0, "port": 2, "child": 2, "child_port": 0, "angle_deg": pytest.approx(math.degrees(0.6))},
    ]
    assert [(contact.kind, contact.a, contact.b) for contact in result.allowed_contacts] == [
        ("body", 0, 1),
        ("body", 0, 2),
        ("rod", 1, -1),
    ]
    assert set(result.versions) >= {"python-fcl", "numpy"}


def test_an_audit_goes_through_its_file_and_repeats_itself(tmp_path):
    result = audit(fan({"exposure": FREE_ABOVE}))
    path = tmp_path / "audit.json"
    path.write_text(to_json(result), encoding="utf-8")
    assert read_json(Audit, path) == result
    again = audit(fan({"exposure": FREE_ABOVE}))
    assert (again.pairs, again.residuals) == (result.pairs, result.residuals)


def test_a_file_of_another_program_is_audited(tmp_path):
    given = fan({"exposure": FREE_ABOVE})
    file = {
        "format": "topo-search/design",
        "version": 1,
        "task": {"name": "foreign", "modules": 3, "load_cases": [HOVER], "exposure": FREE_ABOVE},
        "topology": [[-1, -1, -1], [0, 0, 2], [0, 2, 0]],
        "root_orientation_rad": [0, 0, 0],
        "hinge_angles_rad": [-0.6, 0.6],
        "end_effector_m": [0, 0, 0.6],
        "rotor_speeds_squared": [list(row) for row in given.rotor_speeds_squared],
        "objective": given.objective,
        "lower_bound": "unknown",
        "topology_key": "mine",
    }
    path = tmp_path / "foreign.json"
    path.write_text(json.dumps(file), encoding="utf-8")
    assert audit(read_json(Design, path)).verdict == Status.CLEAR


@pytest.mark.parametrize("broken", [{}, {"hinge_angles_rad": [0.1, -0.1]}, {"objective": 1.0}])
def test_a_file_of_another_program_is_judged_like_our_own(broken, tmp_path):
    ours = changed(fan({"exposure": FREE_ABOVE}), **broken)
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


# ---- broken


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
    def of(half_angle_deg):
        return audit(fan({"exposure": [{"kind": "exterior", "half_angle_deg": half_angle_deg}]}))

    low, high = 15.0, 60.0
    assert (of(low).verdict, of(high).verdict) == (Status.VIOLATED, Status.CLEAR)
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (low, middle) if of(middle).verdict == Status.CLEAR else (middle, high)
    assert failing(of(low)) == {"exterior"}
    assert max(pair.analytic_m for pair in of(low).pairs if pair.status != Status.CLEAR) > -1e-7


def test_an_exclusion_broken_by_a_tenth_of_a_micrometre_is_caught_and_named():
    for by, expected in ((LITTLE, set()), (-LITTLE, {"exclusion"})):
        assert failing(audit(fan(end_effector=(0.0, 0.0, 0.15 + by)))) == expected


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


def test_the_broken_segment_is_named():
    result = audit(fan({"exposure": [{"kind": "directional", "segments": [[0, 0, 1], [0.1, 0, -2]]}]}))
    assert {pair.segment for pair in result.pairs if pair.status == Status.VIOLATED} == {1}


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


def _rows(given: Design) -> list[list[float]]:
    return [list(row) for row in given.rotor_speeds_squared]


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


def test_inputs_beyond_their_limits_are_named():
    given = fan({"module": {"max_thrust_to_weight": 1.05}})
    assert "load case 0, largest rotor input" in failing(audit(given))
    u = np.array(_rows(given))
    balanced = changed(fan(), rotor_speeds_squared=[[-1e5, *u[0, 1:].tolist()]])
    assert "load case 0, smallest rotor input" in failing(audit(balanced))


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


def test_a_fault_of_the_audit_itself_comes_with_its_evidence(monkeypatch):
    given = fan({"exposure": FREE_ABOVE[3:4]})
    assert not any(pair.evidence for pair in audit(given).pairs)
    monkeypatch.setattr(Shape, "overlaps", lambda self, other: True)
    result = audit(given)
    assert result.verdict == Status.INCONSISTENT
    assert {pair.status for pair in result.pairs} == {Status.INCONSISTENT}
    for pair in result.pairs:
        assert any("FCL: overlap" in line or "not off it" in line for line in pair.evidence)
    assert Audit.model_validate_json(to_json(result)) == result


# ---- the ablation, symmetries, hostile numbers


def test_the_ablation_measures_airflow_but_judges_separation():
    overlapping = {"hinges": (0.5, -0.5)}
    task = {"search": {"interference": "separation"}}
    result = audit(fan(task, **overlapping))
    assert failing(result) == {"airflow"}
    assert result.verdict == Status.CLEAR
    assert {(pair.a, pair.b) for pair in result.pairs if pair.kind == "separation"} == {(0, 1), (0, 2), (1, 2)}
    assert audit(fan(**overlapping)).verdict == Status.VIOLATED


def test_without_body_clearance_no_separation_is_judged():
    assert not any(p.kind == "separation" for p in audit(fan({"search": {"body_clearance": False}})).pairs)


def test_turning_the_world_changes_no_clearance():
    psi = 0.8
    c, s = math.cos(psi), math.sin(psi)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def turned(vectors):
        return [(turn @ vector).tolist() for vector in np.array(vectors, dtype=float)]

    segments = [[0.5, 0.2, 1.0], [1.0, 0.0, 0.3]]
    still = audit(fan({"exposure": [{"kind": "directional", "segments": segments}]}, end_effector=(0.1, 0.0, 0.6)))
    moved = audit(
        fan(
            {"exposure": [{"kind": "directional", "segments": turned(segments)}]},
            root=(psi, 0.0, 0.0),
            end_effector=tuple(turn @ (0.1, 0.0, 0.6)),
        )
    )
    assert [p.analytic_m for p in moved.pairs] == pytest.approx([p.analytic_m for p in still.pairs], abs=1e-12)
    assert moved.verdict == still.verdict


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("hinges", [(-0.6, 0.6), (0.3, 0.6)])
def test_a_platform_of_another_size_is_judged_alike(scale, hinges):
    def sized(k):
        module = {
            "arm_length": 0.1 * k,
            "connector_distance": 0.15 * k,
            "torque_coefficient": 1.06e-8 * k,
            "body": {
                "rotor_radius": 0.05 * k,
                "rotor_height": 0.02 * k,
                "arm_width": 0.02 * k,
                "hub": [0.08 * k, 0.08 * k, 0.04 * k],
            },
        }
        exposure = [{"kind": "local", "radius": 0.15 * k}, {"kind": "exterior", "half_angle_deg": 70.0}]
        task = {"module": module, "exposure": exposure, "end_effector": {"rod_radius": 0.005 * k}}
        return fan(task, hinges=hinges, end_effector=(0.0, 0.0, 0.6 * k))

    one, other = audit(sized(1.0)), audit(sized(scale))
    assert other.verdict == one.verdict
    assert [p.status for p in other.pairs] == [p.status for p in one.pairs]
    assert [p.analytic_m / scale for p in other.pairs] == pytest.approx([p.analytic_m for p in one.pairs], rel=1e-9)
    assert [r.status for r in other.residuals] == [r.status for r in one.residuals]


def test_modules_in_one_place_are_judged():
    # Four right angles close a square: the fifth module is where the first is.
    ring = Topology(((-1, -1, -1), (0, 0, 2), (1, 1, 3), (2, 2, 0), (3, 3, 1)))
    result = audit(design(ring, {}, hinges=(0.0, 0.0, 0.0, 0.0)))
    assert result.verdict == Status.VIOLATED
    (same,) = (pair for pair in result.pairs if (pair.kind, pair.a, pair.b) == ("airflow", 0, 4))
    assert same.analytic_m == pytest.approx(-2 * given_end_radius(), rel=1e-9)


def given_end_radius() -> float:
    return fan().task.module.envelope.end_radius


def test_an_end_effector_in_a_module_is_judged():
    result = audit(fan({"exposure": FREE_ABOVE[:1]}, end_effector=(0.0, 0.0, 0.0)))
    assert result.verdict == Status.VIOLATED
    (inside,) = (pair for pair in result.pairs if pair.kind == "exclusion" and pair.a == 0)
    assert inside.analytic_m == pytest.approx(-0.15)


@pytest.mark.parametrize("huge", [1e7, 1e100, 1e200, 1.7e308])
@pytest.mark.parametrize("field", ["end_effector_m", "rotor_speeds_squared", "hinge_angles_rad", "objective"])
def test_absurd_numbers_are_judged_and_written(field, huge):
    given = fan({"exposure": FREE_ABOVE})
    value = {
        "end_effector_m": [huge, -huge, huge],
        "rotor_speeds_squared": [[huge] * 12],
        "hinge_angles_rad": [huge, -huge],
        "objective": huge,
    }[field]
    result = audit(changed(given, **{field: value}))
    assert result.verdict in {Status.VIOLATED, Status.UNDECIDED}
    assert json.loads(to_json(result))["verdict"] == result.verdict


def test_a_flat_platform_overlaps_with_its_neighbours_only_at_the_far_end():
    # Parallel neighbours 0.3 m apart with end radii 0.2128 m overlap by 0.126 m at the far end.
    result = audit(fan(hinges=(0.0, 0.0)))
    airflow = {(p.a, p.b): p for p in result.pairs if p.kind == "airflow"}
    assert airflow[0, 1].analytic_m == pytest.approx(0.3 - 2 * given_end_radius(), abs=1e-12)
    assert airflow[1, 2].analytic_m == pytest.approx(0.6 - 2 * given_end_radius(), abs=1e-12)
    assert (airflow[0, 1].status, airflow[1, 2].status) == (Status.VIOLATED, Status.CLEAR)


def test_importing_the_audit_loads_neither_solver_nor_search():
    code = (
        "import sys, verify; light = 'numpy' not in sys.modules; verify.audit; import topo_search.model;"
        "heavy = {'casadi', 'nlp', 'optuna', 'pandas'} & set(sys.modules);"
        "print(light, sorted(heavy), callable(verify.audit))"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.split("\n")[0] == "True [] True"


def test_the_objective_weighs_its_cases():
    given = fan({"load_cases": [HOVER, {**HOVER, "weight": 3.0}]})
    one = fan()
    assert objective(given) == pytest.approx(4 * one.objective)
    assert FAN.n == one.topology.n


def test_a_stand_off_is_the_distance_of_the_exclusion():
    """p_E is 0.3 m from the only module."""
    for asked, spare, verdict in ((0.1, 0.15, "clear"), (0.25, 0.05, "clear"), (0.3001, -0.0001, "violated")):
        result = audit(design(ONE, {"end_effector": {"stand_off": asked}}, hinges=(), end_effector=BELOW))
        (exclusion,) = (pair for pair in result.pairs if pair.kind == "exclusion")
        assert exclusion.analytic_m == pytest.approx(spare, abs=1e-12)
        assert (exclusion.status, result.verdict) == (verdict, verdict)


def test_rotor_inputs_are_held_against_the_share_that_the_task_allows():
    """Hovering needs m_t / m of 1 / 2.5 of u_max, 0.48."""
    for share, missed in ((0.49, 0.0), (0.48, 0.0), (0.47, 0.01)):
        given = design(ONE, {"search": {"peak_input": share}}, hinges=(), end_effector=BELOW)
        result = audit(given)
        (row,) = (row for row in result.residuals if row.name == "load case 0, largest rotor input")
        assert row.scaled == pytest.approx(missed, abs=1e-9)
        assert row.derived == pytest.approx(share * given.task.module.max_input(9.81), rel=1e-12)
        assert (row.status == "violated") == (missed > 0)

"""The stated constraints, the check that decides what a design is, and the audit: one list, one set of numbers."""

import dataclasses
import math
from functools import cache

import casadi as ca
import numpy as np
import pytest
from nlp_cases import DISTINCT, FEATURES, HOVER, as_design, hover, push, random_point, random_tree
from suites import few

from nlp import names
from nlp.evaluation import violations, worst
from nlp.ipopt import BETA
from nlp.numbers.point import Point
from nlp.problem import problem
from nlp.requirements import clearances
from nlp.units import Units
from topo_search.model import Topology
from verify import audit
from verify.bodies import AllowedCone
from verify.kinematics import platform
from verify.requirements import Scene
from verify.residuals import residuals
from verify.sensitivity import clearance_of

BOUNDS = ("end-effector's reach", "rotor input", "hinge angle", "root orientation", "end-effector position")
"""Not constraints of the problem but bounds of its variables, or met by construction."""


@cache
def cases(name):
    """Random points of the push task with a feature, and the checks of each."""
    fields, rng = FEATURES[name], np.random.default_rng(23)
    topology = random_tree(3, rng, aligned=name != "any port")
    task = push(3, **fields)
    points = [random_point(task, topology, rng) for _ in range(8)]
    return task, topology, points, [violations(point) for point in points]


def smooth_values(task, stated, points):
    """Each constraint's name and, for every point, its least value in SI."""
    f = ca.Function("g", [stated.variables.vector(), stated.beta], [c.expression for c in stated.constraints])
    values = [f(point.pack(), BETA) for point in points]
    values = [rows if isinstance(rows, tuple) else (rows,) for rows in values]
    least = np.array([[np.array(row).min() for row in rows] for rows in values])
    return dict(zip((c.name for c in stated.constraints), least.T * Units.of(task).length, strict=True))


@pytest.mark.parametrize("name", few(FEATURES, DISTINCT))
def test_every_stated_constraint_is_checked_with_its_sign_and_nothing_else(name):
    """A stated clearance may ask for log(9) / beta more; from 1e-4 m on it hides nothing (test_nlp_clearance)."""
    task, topology, points, found = cases(name)
    printed = problem(task, topology)
    stated = [c.name for c in printed.constraints]
    judged = [check.name for check in found[0]]
    checked = set(judged)
    assert len(set(stated)) == len(stated)
    assert sorted(name for name in checked if not any(bound in name for bound in BOUNDS)) == sorted(stated)
    assert judged[: len(stated)] == stated
    assert stated[2 * len(task.load_cases) :] == [
        row for requirement in clearances(task, topology) for row, *_ in requirement.rows()
    ]
    assert ("end-effector position" in checked) == (task.end_effector.fixed_position is not None)
    values, compared = smooth_values(task, printed, points), 0
    for at, checks in enumerate(found):
        for check in checks:
            if check.unit != "m" or check.name in BOUNDS:
                continue
            smooth = values[check.name][at]
            assert check.amount < 0 or smooth < 1e-4
            # the smooth one shrinks with r / s of an envelope (1.03 arms more at the far end) and by log(9) / beta
            assert check.amount > -0.02 * task.module.arm_length or smooth > 0
            compared += 1
    assert compared >= len(points) * topology.n or name == "no exclusion"


@pytest.mark.parametrize("name", few(FEATURES, DISTINCT))
def test_checked_clearances_are_the_audits(name):
    """Equal where both measure a distance; for two envelopes the check promises the sign alone.

    The audit asks for the body clearance alone: it has the rigid parts themselves, for which the solver keeps more.
    """
    _, _, points, found = cases(name)
    for point, checks in zip(points, found, strict=True):
        design = as_design(point)
        checked = {check.name: -check.amount for check in checks if check.unit == "m"}
        audited = audited_clearances(design)
        unaudited = {
            names.POSITION,
            names.OFFSET,
            names.REACH,
            names.ROD,
            names.ROD_AXIS,  # audited in degrees
            *(name for name in checked if "solid" in name),
        }
        assert set(audited) == set(checked) - beside_airflow(point) - unaudited
        for key, c in audited.items():
            exact = not key.startswith("airflow") and "directional" not in key and "local" not in key
            if exact:
                assert checked[key] == pytest.approx(c, abs=1e-12)
            assert math.copysign(1, checked[key]) == math.copysign(1, c) or abs(c) < 1e-10


def beside_airflow(point):
    """The names of what the solver keeps out of the airflow: balls around the parts that the audit has exactly."""
    modules = range(point.topology.n)
    rotors = {names.rotor_airflow(i, j) for i in modules for j in modules}
    return rotors | {f"end-effector and airflow of module {i}" for i in modules}


def audited_clearances(design):
    """The audit's exact clearances beyond what the solver keeps [m], by its names; without what sets no verdict."""
    found = {}
    task = design.task
    for r in Scene(design, platform(design)).requirements():
        if not r.counts:
            continue
        more = 0.0
        if r.kind in ("airflow", "separation"):
            name = f"{r.kind} of modules {r.a} and {r.b}"
            if r.kind == "separation" and task.centre_distance is not None:
                more = task.centre_distance - task.body_clearance
        elif r.kind == "exclusion":
            name = f"end-effector exclusion of module {r.a}"
        else:
            name = names.exposure(r.b, task.exposure[r.b], r.rotor, r.a, r.a, r.segment)
        assert isinstance(r.against, AllowedCone) == (r.kind in ("exterior", "allowed"))
        found[name] = clearance_of(r) * task.module.arm_length - more
    return found


def test_bounds_are_checked_in_their_units():
    task = push(2, search={"root": "paper"})
    topology = Topology.from_key("a10")
    u_max = task.module.max_input(task.gravity)
    inside = random_point(task, topology, np.random.default_rng(0))

    def check(name, **changes):
        point = dataclasses.replace(inside, **changes)
        (found,) = [c for c in violations(point) if c.name == name]
        return found

    for bound, value, excess in (("largest", 1.25 * u_max, 0.25 * u_max), ("smallest", -0.5 * u_max, 0.5 * u_max)):
        u = inside.u.copy()
        u[0, 0, 2] = value
        found = check(f"load case 0, {bound} rotor input", u=u)
        assert (found.met, found.unit) == (False, "rad^2/s^2")
        assert (found.amount, found.scaled) == pytest.approx((excess, excess / u_max))
        assert check(f"load case 0, {bound} rotor input").met
    assert check("hinge angle of module 1").met
    assert not check("hinge angle of module 1", alpha=np.array([math.pi / 2 + 1e-9])).met
    long = dataclasses.replace(inside, task=push(2, module={"arm_length": 0.135}), alpha=np.array([-0.9]))
    (found,) = [c for c in violations(long) if c.name == "hinge angle of module 1"]
    rim = 0.15 - 0.135 / math.sqrt(2) - 0.05
    assert found.amount == pytest.approx(0.9 - (math.pi - 2 * math.atan2(0.01, rim)))
    for name, root in (("alpha_0", [0.0, 1.6, 0.0]), ("alpha_1", [0.0, 0.0, -1.6])):
        found = check(f"root orientation, {name}", root=np.array(root))
        assert not found.met
        assert found.amount == pytest.approx(1.6 - math.pi / 2)
    assert not check("root orientation, psi", root=np.array([1e-3, 0.0, 0.0])).met
    loose = dataclasses.replace(inside, task=push(2), root=np.array([3.0, 1.5, -3.0]))
    assert not any(c.name.startswith("root") for c in violations(loose))


@pytest.mark.parametrize("name", few(FEATURES, DISTINCT[::2]))
def test_solver_and_audit_use_the_same_words(name):
    task, _, (point, *_), (checks, *_) = cases(name)
    found = audit(as_design(point))
    measured_only = {"body", "rod", "rotor-airflow", "rod-airflow", "rod-region"}  # the audit alone
    if task.search.interference == "separation":
        measured_only.add("airflow")
    # the solver counts the larger of both torques under one name
    told = {row.name for row in found.residuals if not row.name.endswith("torque about the end-effector")}
    told = {names.ROD_AXIS if name == "rod-axis" else name for name in told}  # audited in degrees
    told |= {pair.name for pair in found.pairs if pair.kind not in measured_only}
    only_told_of_files = {"objective", f'joints against connectors = "{task.search.connectors}"'}
    checked = {check.name for check in checks} - beside_airflow(point)
    of_rod = {name for name in checked if name.startswith("the end-effector's rod")}
    assert told - only_told_of_files - {"straight rod to the end-effector"} == checked - of_rod
    if task.end_effector.rod == "straight" and found.assembly.end_effector.mount is not None:
        assert of_rod == {pair.name for pair in found.pairs if pair.kind == "rod-region"}


@pytest.mark.parametrize("name", few([name for name in FEATURES if name.startswith("solid")], DISTINCT[-5:]))
def test_balls_around_parts_are_never_farther_from_a_solid_region_than_the_parts(name):
    _, _, points, found = cases(name)
    for point, checks in zip(points[:3], found[:3], strict=True):
        checked = {check.name: -check.amount for check in checks}
        rows = [pair for pair in audit(as_design(point)).pairs if pair.kind == "part-region"]
        assert {row.name for row in rows} == {name for name in checked if "solid" in name}
        for row in rows:
            most = row.upper_m if row.upper_m is not None else math.inf
            assert checked[row.name] <= most + 1e-9 or checked[row.name] < 0 > most


def test_a_moved_end_effector_breaks_a_fixed_position():
    task = push(2, end_effector={"position": [0.1, 0.0, 0.3]})
    point = random_point(task, Topology.from_key("a10"), np.random.default_rng(0))
    # p_COM follows the end-effector by m_E / m_t
    moved = dataclasses.replace(point, tip=point.tip + np.array([0.0, 0.01, 0.0]))
    before, after = (
        next(check for check in violations(p) if check.name == "end-effector position") for p in (point, moved)
    )
    assert before.met
    assert not after.met
    assert after.amount == pytest.approx(0.01 * (1 - 0.048 / task.total_mass(2)))


def test_nothing_that_is_not_a_number_meets_a_constraint():
    task, topology = push(2, load_cases=[HOVER], exposure=[{"kind": "local"}]), Topology.from_key("a10")
    good = random_point(task, topology, np.random.default_rng(0))
    for name in ("root", "alpha", "tip", "u"):
        values = getattr(good, name).copy()
        values.flat[0] = math.nan
        bad = dataclasses.replace(good, **{name: values})
        with np.errstate(invalid="ignore"):
            checks = violations(bad)
        assert not worst(checks).met
        assert math.isnan(worst(checks).scaled)


def test_equal_and_opposite_errors_do_not_cancel_in_the_check():
    """A missing force at one module shows as force; about the COM its moment shows as torque, not the origin's."""
    task, topology = hover(1), Topology(((-1, -1, -1),))
    u = np.full((1, 1, 4), task.total_mass(1) * task.gravity / (4 * task.module.thrust_coefficient))
    p_E = np.array([0.0, 0.0, 0.4])
    point = Point(task, topology, np.zeros(3), np.empty(0), p_E, u)
    checks = {c.name: c for c in violations(point)}
    assert checks["load case 0, force"].met
    assert checks["load case 0, torque"].met
    short = {c.name: c for c in violations(dataclasses.replace(point, u=0.75 * u))}
    assert short["load case 0, force"].amount == pytest.approx(task.force_unit(1) / 4)
    assert short["load case 0, force"].scaled == pytest.approx(1 / 4)
    assert short["load case 0, torque"].amount == pytest.approx(0.0, abs=1e-12)
    rows = {r.name: r for r in residuals(as_design(point), platform(as_design(point)))}
    assert rows["load case 0, force"].scaled < 1e-12

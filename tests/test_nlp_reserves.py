"""Reserves in solver, bounds and audit."""

from typing import Any

import numpy as np
import pytest
from nlp_cases import HOVER, best_design, push, solved
from suites import few
from verify_cases import changed

from nlp import lower_bound, prove_impossible, solve
from nlp.bounds.effort import closed_form
from nlp.numbers.point import Point
from nlp.pseudo_inverse import pseudo_inverse_constraints
from nlp.user_constraints.rows import rows_of
from topo_search.model import Infeasible, Status, Topology
from topo_search.model.reserves import AskedFlight
from verify import audit

LOW, HIGH = Topology.from_key("a300"), Topology.from_key("aa00")
GENTLE = {"carries_weight": True, "end_effector": {"force": [0.1, 0.0, 0.0]}}


def asked(n: int = 3, **flight: Any) -> Any:
    return push(n, load_cases=[HOVER], **({"flight": flight} if flight else {}))


def rows(judged: Any) -> dict[str, Any]:
    return {row.name: row for row in judged.residuals if "reserve" in row.name}


def test_a_design_keeps_a_reserve_that_it_would_not_keep_unasked() -> None:
    plain = best_design(asked(), LOW, 3)
    more = best_design(asked(force_reserve=0.1, directions="horizontal"), LOW, 6)
    without = audit(plain).flight
    assert without.hover.horizontal_reserve_N < 0.02 * plain.task.force_unit(3)
    judged = audit(more)
    assert judged.verdict == "clear"
    (row,) = rows(judged).values()
    assert row.name == "hover, horizontal force reserve"
    assert row.derived >= row.stated == pytest.approx(0.1 * more.task.force_unit(3))
    assert more.objective >= plain.objective
    assert lower_bound(more.task) <= more.objective
    assert more.inputs.shape == (1, 3, 4)


def test_a_reserve_at_the_centre_of_mass_is_another_than_at_the_tip() -> None:
    tip, com = (
        best_design(asked(force_reserve=0.1, directions="horizontal", at=at), LOW, 6) for at in ("tip", "com")
    )
    judged = audit(com)
    (row,) = rows(judged).values()
    assert (row.name, row.status) == ("hover, horizontal force reserve at the centre of mass", Status.CLEAR)
    assert judged.verdict == "clear"
    demand = {"units": "SI", "force_reserve": row.stated, "directions": "horizontal", "at": "both"}
    both = [audit(changed(one, task={**one.task.model_dump(mode="json"), "flight": demand})) for one in (tip, com)]
    (at_tip, _), (_, at_com) = ([one.status for one in rows(each).values()] for each in both)
    assert (at_tip, at_com) == (Status.CLEAR, Status.CLEAR)
    assert both[0].verdict == "violated"  # what is kept at the tip is not kept at the centre of mass


def test_a_design_holds_the_tilt_that_is_asked_for() -> None:
    plain = best_design(asked(), LOW, 3)
    tilted = best_design(asked(tilt_deg=5.0), LOW, 6)
    assert audit(plain).flight.hover.tilt_deg < 1.0
    judged = audit(tilted)
    assert judged.verdict == "clear"
    assert 5.0 - 1e-4 <= judged.flight.hover.tilt_deg < 15.0


@pytest.mark.parametrize("allocator", few(["pseudo-inverse", "optimal"], 1))
def test_a_design_has_the_angular_accelerations_that_are_asked_for(allocator: str) -> None:
    axes = (15.0, 15.0, 8.0)
    turned = solved(solve(asked(angular_acceleration=axes, allocator=allocator), LOW, starts=range(1), seed=0))
    judged = audit(turned)
    rows = [row for row in judged.residuals if "angular acceleration" in row.name]
    assert (judged.verdict, [row.stated for row in rows]) == ("clear", [*axes])
    assert min(row.derived / row.stated for row in rows) == pytest.approx(1.0, abs=1e-4)  # more costs effort


@pytest.mark.parametrize(
    ("allocator", "force", "error"), few([("optimal", 0.15, 0.015), ("pseudo-inverse", 0.06, 0.01)], 1)
)
def test_a_design_keeps_what_is_asked_for_wherever_its_centre_of_mass_may_be(
    allocator: str, force: float, error: float
) -> None:
    demand = {"force_reserve": force, "directions": "horizontal", "at": "com", "allocator": allocator}
    exact, off = (solved(solve(asked(**demand, com_error=e), LOW, starts=range(1), seed=0)) for e in (0.0, error))
    judged = audit(off)
    assert judged.verdict == "clear"
    assert {row.name for row in judged.residuals if row.name.startswith("hover, ")} == {
        "hover, error of the centre of mass",
        "hover, horizontal force reserve at the centre of mass",
    }
    assert off.objective > 1.001 * exact.objective
    task = {**exact.task.model_dump(mode="json"), "flight": off.task.flight.model_dump(mode="json")}
    assert audit(changed(exact, task=task)).verdict == "violated"


@pytest.mark.parametrize("key", few(["a300", "a1300"], 1))
def test_a_design_keeps_by_the_pseudo_inverse_what_is_asked_of_it(key: str) -> None:
    tree, demand = Topology.from_key(key), {"at": "both", "torque_reserve": 0.02, "tilt_deg": 4.0}
    demand |= {"force_reserve": 0.1, "directions": "horizontal", "angular_acceleration": (3.0, 3.0, 3.0)}
    task = asked(tree.n, **demand, allocator="pseudo-inverse")
    design = solved(solve(task, tree, starts=range(1), seed=0))
    judged = audit(design)
    assert judged.verdict == "clear"
    names = {one.name for one in pseudo_inverse_constraints(task)}
    rows = [row for row in judged.residuals if row.name in names]
    assert len(rows) == len(names) == 7
    assert min(row.derived / row.stated for row in rows) == pytest.approx(1.0, abs=1e-5)
    assert design.stated == ()  # no constraint of the user's


def test_two_modules_cannot_hover_at_a_tilt_about_their_only_hinge_by_the_pseudo_inverse() -> None:
    """All thrusts are perpendicular to the hinge, so the map of inputs to wrenches has rank five."""
    task = asked(2, tilt_deg=1.0, allocator="pseudo-inverse")
    assert isinstance(solve(task, Topology.from_key("a10"), starts=range(1), seed=0), Infeasible)


@pytest.mark.parametrize("directions", few(["horizontal", "all"], 1))
def test_rows_of_the_pseudo_inverse_are_zero_at_what_the_audit_measures(directions: str) -> None:
    """Each at its largest size, on a design that does not know of them."""
    design = solved(solve(asked(4, torque_reserve=0.1), Topology.from_key("a1300"), starts=range(1), seed=0))
    hover = audit(design).flight.hover
    force = (
        hover.force_reserve_N_pseudo_inverse if directions == "all" else hover.horizontal_reserve_N_pseudo_inverse
    )
    flight = AskedFlight(
        units="SI",
        allocator="pseudo-inverse",
        directions=directions,
        force_reserve=force,
        torque_reserve=hover.torque_reserve_Nm_pseudo_inverse,
        tilt_deg=hover.tilt_deg_pseudo_inverse,
        angular_acceleration=hover.angular_acceleration_rad_s2_pseudo_inverse,
    )
    root, alpha, p_E = (
        np.array(getattr(design, name)) for name in ("root_orientation_rad", "hinge_angles_rad", "end_effector_m")
    )
    task = design.task.model_copy(update={"flight": flight})
    rows = rows_of(pseudo_inverse_constraints(task), task, design.topology)
    left = [one.amount for one in rows.violations(Point(task, design.topology, root, alpha, p_E, design.inputs))]
    assert left == pytest.approx([0.0] * 6, abs=1e-7)


def test_the_audit_judges_what_is_asked_against_what_it_measured() -> None:
    """By reserves between none and more than there is; a design that does not know of them is judged the same."""
    design = best_design(asked(force_reserve=0.1, directions="horizontal"), LOW, 6)
    found = audit(design).flight
    most = {
        "force": found.hover.force_reserve_N,
        "horizontal force": found.hover.horizontal_reserve_N,
        "torque": found.hover.torque_reserve_Nm,
    }
    for name, size in most.items():
        field = "torque_reserve" if name == "torque" else "force_reserve"
        directions = "horizontal" if name == "horizontal force" else "all"
        for share, status in ((0.9, Status.CLEAR), (1.1, Status.VIOLATED)):
            reserve = share * size + 1e-4 * (share > 1)
            flight = {"units": "SI", "directions": directions, field: reserve}
            judged = audit(changed(design, task={**design.task.model_dump(mode="json"), "flight": flight}))
            (row,) = (row for row in judged.residuals if row.name == f"hover, {name} reserve")
            assert row.status is status
            assert judged.verdict is status


def test_around_all_the_cases_that_carry_the_weight_count_too() -> None:
    task = push(3, load_cases=[GENTLE, HOVER], flight={"torque_reserve": 0.01, "around": "all"})
    design = best_design(task, LOW, 6)
    judged = audit(design)
    assert set(rows(judged)) == {f"{name}, torque reserve" for name in ("hover", "load case 0", "load case 1")}
    assert judged.verdict == "clear"


def test_bounds_count_on_points_of_the_ball_alone() -> None:
    """Hover costs the closed form whatever reserve is asked for, and a bound with it is no less, nor above it here.

    With a horizontal reserve as large as the weight the axes must lean, which the bound knows.
    """
    assert lower_bound(asked(force_reserve=0.05)) == pytest.approx(closed_form(asked()), rel=2e-3)
    wide = asked(force_reserve=1.0, directions="horizontal")
    assert lower_bound(wide) > 1.02 * closed_form(asked())
    assert closed_form(wide) == pytest.approx(closed_form(asked()))


def test_more_reserve_than_all_rotors_have_is_impossible_by_proof_and_a_little_less_is_not() -> None:
    """All rotors pull with 2.5 weights of the modules: what the weight leaves of it can be added upwards."""
    left = 3 * 0.24 * 2.5 / (3 * 0.24 + 0.048) - 1
    proof = prove_impossible(asked(force_reserve=1.2 * left))
    assert proof.worst_constraint.startswith("hover, force reserve")
    assert proof.message.startswith("flight.force_reserve: no platform of 3 modules has so much reserve: hover, ")
    alone = prove_impossible(asked(1, force_reserve=0.01, torque_reserve=0.001))
    assert alone.message.startswith("flight.force_reserve: no platform of one module")  # it has one axis
    turned = prove_impossible(asked(torque_reserve=1e3))
    assert turned.message.startswith("flight.torque_reserve: no platform of 3 modules has so much reserve: hover, ")
    heavy = {"com": {"force": [0.0, 0.0, 9.0]}}
    falls = prove_impossible(push(3, load_cases=[heavy], flight={"force_reserve": 0.1}))
    assert falls.message.startswith("load case 0 needs")  # with or without a reserve
    within = asked(force_reserve=left / 1.291 * 1.1)  # its corners are beyond, the ball is not
    assert prove_impossible(within) is None or "corner" not in str(prove_impossible(within))

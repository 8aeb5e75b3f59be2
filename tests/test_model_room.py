"""The room that rigid parts need: what the search keeps, against the audit's exact parts."""

import math
import re

import numpy as np
import pytest
import trimesh
from nlp_cases import as_point, best_design, hover, random_tree
from older import older_task
from suites import few
from verify_cases import design
from wording import says

from nlp import prove_impossible
from nlp.numbers.geometry import fold_excess
from nlp.starts.random_starts import draw, generator
from nlp.starts.untangling import untangle
from topo_search.model import Module, Status, Topology
from topo_search.model.folds import FOLD, folds_text, nearest_fold
from topo_search.model.room import (
    airflow_folds,
    body_radius,
    clear_folds,
    largest_hinge_angle,
    part_cover,
    whole_cover,
)
from verify import audit
from verify.beside_airflow import beside_airflow, certify_beside
from verify.compounds import certify_compounds
from verify.convex import Cylinder
from verify.kinematics import platform
from verify.parts import module_parts
from verify.requirements import Scene

HOVER = {"com": {"force": [0.0, 0.0, 1.0]}}


def both_sides(of, module, margin=0.0):
    """Return what holds for a module bolted to another of its kind."""
    return of(module, module, margin)


def frame(rng, reach):
    """A few convex pieces of a module's own, as far from the centre as `reach` at most [m]."""
    pieces = []
    for _ in range(3):
        points = rng.normal(size=(12, 3))
        points *= reach * rng.uniform(0.2, 1.0, 3) / np.abs(points).max(axis=0)
        hull = trimesh.convex.convex_hull(points)
        pieces.append({"vertices": hull.vertices.tolist(), "triangles": hull.faces.tolist()})
    return {"frame": pieces, "inertia": [1e-3, 1e-3, 2e-3]}


def random_body(rng, own_frame):
    """Rotors that end inside the connectors of the default module, and frames that may reach beyond."""
    body = {
        "rotor_radius": rng.uniform(0.01, 0.0785),
        "rotor_height": rng.uniform(0.002, 0.12),
        "hub": [*rng.uniform(0.02, 0.4, 2).tolist(), rng.uniform(0.02, 0.2)],
        "arm_width": rng.uniform(0.01, 0.06),
    }
    return body | frame(rng, rng.uniform(0.05, 0.2)) if own_frame else body


def bolted(body, angle, a=0, b=2):
    """The clearance of two bolted modules' parts, frames against frames left out."""
    given = design(Topology(((-1, -1, -1), (0, a, b))), {"module": {"body": body}}, hinges=(angle,))
    (found,) = certify_compounds([Scene(given).modules], [True])
    return found


def test_the_default_module_needs_a_ball_of_its_farthest_rims_and_any_hinge_angle():
    task = older_task(name="plain", modules=5, load_cases=[HOVER])
    assert body_radius(task.module) == pytest.approx(math.hypot(0.15, 0.01), rel=1e-15)
    assert task.centre_distance == pytest.approx(2 * math.hypot(0.15, 0.01), rel=1e-15)
    assert task.folds(1e-4) == ((-math.pi / 2, math.pi / 2),)


def test_what_a_user_asks_for_is_kept_where_it_is_more():
    def asked(**search):
        task = older_task(name="asked", modules=5, load_cases=[HOVER], search=search)
        assert task.resolve(5).centre_distance == task.centre_distance
        assert task.resolve(5).search.body_clearance == (task.body_clearance or False)
        return task

    assert asked(body_clearance=0.36).centre_distance == 0.36
    assert asked(body_clearance=0.2).centre_distance == pytest.approx(0.3006659, rel=1e-6)
    for airflow_alone in ({"body_clearance": False}, {"interference": "separation"}):
        assert asked(**airflow_alone).centre_distance is None


def test_without_body_clearance_hinges_turn_as_in_the_paper():
    stated = {"name": "long", "modules": 5, "load_cases": [HOVER], "module": {"arm_length": 0.135}}
    assert older_task(stated).folds()[0][1] < 0.9
    airflow_alone = older_task({**stated, "search": {"body_clearance": False}})
    assert airflow_alone.folds() == ((-math.pi / 2, math.pi / 2),)


@pytest.mark.parametrize("own_frame", [False, True])
def test_the_ball_is_the_least_one_around_the_parts_of_the_audit(own_frame):
    rng = np.random.default_rng(3)
    for _ in range(20):
        module = Module.model_validate({"body": random_body(rng, own_frame)})
        frame_parts, rotors = module_parts(module)
        reach = max(part.reach for part in frame_parts + rotors)
        assert body_radius(module) == pytest.approx(reach * module.arm_length, rel=1e-12)


@pytest.mark.parametrize(("a", "b"), few([(0, 2), (1, 1), (1, 3), (2, 0), (3, 1), (0, 1)], 2))
def test_rotors_touch_where_the_angle_ends(a, b):
    """Long rotors alone: the bound is exact, on either side and at every port."""
    rng = np.random.default_rng([a, b])
    for _ in range(8):
        body = {"rotor_radius": rng.uniform(0.07, 0.078), "rotor_height": rng.uniform(0.01, 0.1), "hub": [0.02] * 3}
        module = Module.model_validate({"body": body})
        limit = both_sides(largest_hinge_angle, module)
        beta = math.atan2(module.body.rotor_height / 2, 0.15 - 0.1 / math.sqrt(2) - module.body.rotor_radius)
        assert limit == pytest.approx(min(math.pi / 2, math.pi - 2 * beta), rel=1e-12)
        if limit == math.pi / 2:
            continue
        for side in (-1, 1):
            assert abs(bolted(body, side * limit, a, b).analytic) < 1e-9
            assert bolted(body, side * (limit - 1e-3), a, b).status == Status.CLEAR
            assert bolted(body, side * (limit + 1e-3), a, b).status == Status.VIOLATED


@pytest.mark.parametrize("own_frame", [False, True])
def test_within_the_angle_no_rotor_touches_anything(own_frame):
    rng, limited, near = np.random.default_rng(11), 0, 0
    for _ in range(50):
        body = random_body(rng, own_frame)
        margin = rng.choice([0.0, 1e-4, 2e-3])
        limit = both_sides(largest_hinge_angle, Module.model_validate({"body": body}), margin)
        if limit < 0:
            continue
        side = rng.choice([-1.0, 1.0])
        angle = side * limit * rng.choice([1.0, rng.random()])
        a, b = rng.integers(4, size=2).tolist()
        assert bolted(body, angle, a, b).analytic * 0.1 >= margin - 1e-9
        if limit < math.pi / 2:
            limited += 1
            near += bolted(body, side * (limit + 0.1), a, b).analytic * 0.1 < margin
    assert limited > 8
    assert near > limited / 3  # the bound is not far from where parts touch


def test_a_frame_that_ends_at_its_connectors_does_not_hold_hinges_back():
    """Struts as high as the rotors, to the connectors: rotors are nowhere as near to the hinge's axis."""
    struts = [trimesh.creation.box([0.3, 0.02, 0.02]), trimesh.creation.box([0.02, 0.3, 0.02])]
    pieces = [{"vertices": box.vertices.tolist(), "triangles": box.faces.tolist()} for box in struts]
    body = {"frame": pieces, "inertia": [1e-3, 1e-3, 2e-3]}
    assert both_sides(largest_hinge_angle, Module.model_validate({"body": body}), 1e-4) == math.pi / 2
    assert bolted(body, math.pi / 2).status == Status.CLEAR


def test_a_frame_that_reaches_among_the_neighbours_rotors_leaves_no_angle():
    assert both_sides(largest_hinge_angle, Module.model_validate({"body": {"hub": [0.37, 0.37, 0.04]}})) < 0
    assert bolted({"hub": [0.37, 0.37, 0.04]}, 0.0).status == Status.VIOLATED


# ---- Room beside the airflow: what the search keeps, against the parts and the clearances of the audit.

RIGHT = math.pi / 2


def points_of(part, rng, count=400):
    """Random points of a part, its corners or rim included [l_arm]."""
    if isinstance(part, Cylinder):
        turn, height = rng.uniform(0, math.tau, count), rng.uniform(-1, 1, count) * part.half
        rho = part.disc * np.sqrt(rng.uniform(0, 1, count))
        rho[: count // 2] = part.disc
        return part.centre + np.stack([rho * np.cos(turn), rho * np.sin(turn), height], axis=1)
    weights = rng.dirichlet(np.full(len(part.vertices), 0.2), count)
    return np.concatenate([part.vertices, weights @ part.vertices])


def test_the_default_module_needs_balls_around_its_rotors_alone_and_any_hinge_angle():
    balls = part_cover(Module())
    assert balls.radii == pytest.approx([math.hypot(0.05, 0.01)] * 4)
    assert np.linalg.norm(balls.centres, axis=1) == pytest.approx([0.1] * 4)
    for margin in (0.0, 1e-4, 1e-2):
        assert both_sides(airflow_folds, Module(), margin) == ((-RIGHT, RIGHT),)


@pytest.mark.parametrize("own_frame", [False, True])
def test_balls_and_the_own_airflow_hold_all_parts(own_frame):
    rng = np.random.default_rng(11)
    for k in range(12):
        stated = {"body": random_body(rng, own_frame), "airflow": {"start_radius": [0.02, 0.06, 0.1][k % 3]}}
        module = Module.model_validate(stated)
        balls, air = part_cover(module), module.envelope
        for part in (p for parts in module_parts(module) for p in parts):
            x = points_of(part, rng) * module.arm_length
            held = np.any(np.linalg.norm(x[:, None] - balls.centres, axis=2) <= balls.radii + 1e-12, axis=1)
            left = x[~held]
            eta = np.linspace(0.0, 1.0, 2001)
            axis = np.stack([0 * eta, 0 * eta, -air.length * eta], axis=1)
            apart = np.linalg.norm(left[:, None] - axis, axis=2) - air.start_radius - eta * air.growth
            assert np.all(apart.min(axis=1) <= 1e-6)
            whole = whole_cover(module)
            off = np.linalg.norm(x[:, None] - whole.centres, axis=2) - whole.radii
            assert np.all(off.min(axis=1) <= 1e-12)


def test_where_airflow_may_merge_the_default_module_needs_one_ball_more_around_its_hub():
    balls = whole_cover(Module())
    assert balls.radii == pytest.approx([*[math.hypot(0.05, 0.01)] * 4, math.hypot(0.04, 0.04, 0.02)])
    np.testing.assert_array_equal(balls.centres[4], np.zeros(3))


@pytest.mark.parametrize(
    "stated",
    [
        {"body": {"rotor_height": 0.12}},
        {"airflow": {"start_radius": 0.16}},
        {"airflow": {"spread_angle_deg": 40.0}},
        {"body": {"hub": [0.24, 0.12, 0.1]}, "airflow": {"start_radius": 0.14}},
    ],
)
def test_within_the_folds_the_audit_finds_bolted_parts_clear_and_beyond_them_not(stated):
    """At every port, and with the child's ports turned; the ends are where the audit has its margin."""
    module = Module.model_validate(stated)
    folds = both_sides(airflow_folds, module, 1e-3)
    assert folds
    for low, high in folds:
        for phi, inside in (
            (low, True),
            (high, True),
            ((low + high) / 2, True),
            (low - 0.05, False),
            (high + 0.05, False),
        ):
            least = math.inf
            for a in range(4):
                tree = Topology(((-1, -1, -1), (0, a, (a + 2) % 4)))
                given = design(tree, {"module": stated}, hinges=(FOLD[a] * float(np.clip(phi, -RIGHT, RIGHT)),))
                found = platform(given)
                parts = Scene(given, found)
                asked = list(beside_airflow(parts.modules, parts.envelopes, counts=True))
                assert len(asked) == 10
                certified = certify_beside(asked)
                assert {row.status for row in certified} <= {Status.CLEAR, Status.VIOLATED}
                least = min(least, *(row.analytic * module.arm_length for row in certified))
            if inside:
                assert least >= 1e-3 - 1e-9
            elif -RIGHT < phi < RIGHT:
                assert least < 1e-3


def test_folds_follow_the_margin_and_are_none_where_airflow_is_too_wide():
    module = Module.model_validate({"airflow": {"start_radius": 0.16}})
    (wide,), (narrow,) = both_sides(airflow_folds, module), both_sides(airflow_folds, module, 5e-3)
    assert wide[0] < narrow[0] < 0 < narrow[1] < wide[1] < RIGHT
    assert both_sides(airflow_folds, Module.model_validate({"airflow": {"start_radius": 0.3}})) == ()


def test_a_rotor_in_a_bolted_neighbours_airflow_is_violated():
    stated = {"module": {"airflow": {"start_radius": 0.16}}}
    (fold,) = both_sides(airflow_folds, Module.model_validate(stated["module"]))
    given = design(Topology(((-1, -1, -1), (0, 0, 2))), stated, hinges=(FOLD[0] * (fold[1] + 0.05),))
    rows = [pair for pair in audit(given).pairs if pair.kind == "rotor-airflow" and pair.status != Status.CLEAR]
    assert rows
    assert {pair.status for pair in rows} == {Status.VIOLATED}


# ---- Rotors that reach in among the arms of a bolted module: clear folds, against the audit's parts.

PAIR = Topology.from_key("a20")


def module(l_c, body=None, **fields):
    """Long arms and short connectors."""
    given = {
        "arm_length": 0.3,
        "connector_distance": l_c,
        "airflow": {"start_radius": 0.01, "reach": 1.5},
        **fields,
    }
    return {**given, "body": {"rotor_radius": 0.05, **(body or {})}}


FLAT = module(0.1)
"""Rotors pass each other at any angle."""
FOLDED = module(0.05, {"rotor_height": 0.1, "hub": [0.02, 0.02, 0.02], "arm_width": 0.01})
"""Lying flat each module's rotors are in the other's: some 27 degrees, either way, take them over and under."""


def clearance_of_parts(given, phi, a=0, b=2):
    """The clearance of two bolted modules' parts, frames against frames left out [m]."""
    hinge = phi * FOLD[a]
    told = design(Topology(((-1, -1, -1), (0, a, b))), {"module": given}, hinges=(hinge,))
    (found,) = certify_compounds([Scene(told).modules], [True])
    return found.analytic * Module.model_validate(given).arm_length


def random_module(rng, own_frame):
    """Rotors beyond the hinge, or across it."""
    body = {
        "rotor_radius": rng.uniform(0.02, 0.1),
        "rotor_height": rng.uniform(0.005, 0.1),
        "hub": [*rng.uniform(0.02, 0.3, 2).tolist(), rng.uniform(0.02, 0.2)],
        "arm_width": rng.uniform(0.01, 0.06),
    }
    return module(rng.uniform(0.01, 0.2), body | (frame(rng, rng.uniform(0.05, 0.25)) if own_frame else {}))


@pytest.mark.parametrize("own_frame", [False, True])
def test_no_rotor_touches_anything_at_a_clear_fold(own_frame):
    rng, some, whole = np.random.default_rng(5), 0, 0
    for _ in range(6):
        given, margin = random_module(rng, own_frame), rng.choice([0.0, 1e-4, 5e-3])
        folds = both_sides(clear_folds, Module.model_validate(given), margin)
        some, whole = some + bool(folds), whole + (folds == ((-RIGHT, RIGHT),))
        for low, high in folds:
            for phi in (low, high, rng.uniform(low, high)):
                a, b = rng.integers(4, size=2).tolist()
                assert clearance_of_parts(given, phi, a, b) >= margin - 1e-9
    assert some > whole > 0  # and some are left with a part of the angles


@pytest.mark.parametrize(
    "given", [FLAT, FOLDED, module(0.05, {"rotor_height": 0.1}), module(0.08, {"rotor_radius": 0.12})]
)
def test_no_angle_is_left_out_that_is_clear_by_two_millimetres(given):
    """The modules are the same from all ports and upside down: what one pair of ports shows, all do."""
    folds = both_sides(clear_folds, Module.model_validate(given), 1e-4)
    assert folds == tuple((-high, -low) for low, high in reversed(folds))
    for phi in np.linspace(-RIGHT, RIGHT, 13):
        inside = any(low <= phi <= high for low, high in folds)
        gap = clearance_of_parts(given, phi)
        assert inside == (gap > 1e-4) or abs(gap) < 2e-3


def test_folds_are_told_in_degrees_and_kept_to():
    flat, folded = (Module.model_validate(given) for given in (FLAT, FOLDED))
    assert folds_text(both_sides(clear_folds, flat), " deg") == "at most 90 deg"
    assert folds_text(both_sides(clear_folds, folded), " deg") == "26.6 to 90 deg"
    assert says(folds_text(((-1.0, 0.5),), " deg"), "-57.2 to 28.6 deg", "positive")
    for low, high in ((0.1, 0.2), (0.30001, 0.30002), (-0.2, 0.31), (-0.44, 0.44)):
        folds = ((-high, -low), (low, high)) if low > 0 else ((low, high),)
        *first, last = (math.radians(float(number)) for number in re.findall(r"-?\d[\d.]*", folds_text(folds, "")))
        assert last <= high
        assert [low <= number < last for number in first] == [True] * (low != -high)
    ((_, under), (over, _)) = both_sides(clear_folds, folded)
    assert nearest_fold(both_sides(clear_folds, folded), np.array([-0.01, 0.02, 1.0])).tolist() == [
        under,
        over,
        1.0,
    ]


def test_rotors_wholly_beyond_the_hinge_are_no_proof_and_designs_have_them():
    """The proof knew only of rotors that end before the hinge; solved, the parts are clear by 74 mm at least.

    Straight arms would cross the neighbour's beside the connector; a small frame stands in for arms that do not.
    """
    task = hover(2, module=module(0.1, frame(np.random.default_rng(0), 0.05)))
    assert prove_impossible(task) is None
    found = best_design(task, PAIR, 3)
    report = audit(found)
    assert report.verdict == Status.CLEAR
    assert min(pair.analytic_m for pair in report.pairs if pair.kind == "body") > 0.07


@pytest.mark.parametrize("across", [-0.049, 0.0, 0.049])
def test_rotors_across_the_hinge_touch_at_any_angle(across):
    given = module(0.3 / math.sqrt(2) + across)
    proof = prove_impossible(hover(2, module=given))
    assert proof.violation == pytest.approx(0.05 - abs(across))
    assert both_sides(clear_folds, Module.model_validate(given)) == ()
    assert all(clearance_of_parts(given, phi) < 0 for phi in np.linspace(-RIGHT, RIGHT, 5))


def test_hinges_keep_to_the_side_that_they_start_on():
    """A small frame stands in for arms that do not cross the neighbour's."""
    task = hover(2, module=module(0.05, {"rotor_height": 0.1} | frame(np.random.default_rng(0), 0.02)))
    for number in range(4):
        start = draw(task, PAIR, generator(task, PAIR, number, 0))
        assert np.all(fold_excess(task, PAIR, start.alpha) <= 0)
    found = best_design(task, PAIR, 4)
    assert abs(found.hinge_angles_rad[0]) > 0.12
    assert np.all(fold_excess(task, PAIR, as_point(found).alpha) <= 1e-9)
    assert audit(found).verdict == Status.CLEAR


def test_hinges_are_placed_at_clear_folds():
    task, tree = hover(9, module=FOLDED), random_tree(9, np.random.default_rng(2))
    alpha = untangle(task, tree, np.full(8, 0.3), np.random.default_rng(0))
    assert np.all(fold_excess(task, tree, alpha) <= 0)

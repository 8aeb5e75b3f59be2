"""Room beside the airflow: what the search keeps, against the parts and the clearances of the audit."""

import math

import numpy as np
import pytest
from test_model_room import random_body
from verify_cases import design

from topo_search.model import Module, Status, Topology
from topo_search.model.room import FOLD, airflow_folds, part_cover, whole_cover
from verify import audit
from verify.beside_airflow import beside_airflow, certify_beside
from verify.convex import Cylinder
from verify.kinematics import platform
from verify.parts import module_parts
from verify.requirements import Scene

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
        assert airflow_folds(Module(), margin) == ((-RIGHT, RIGHT),)


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
    folds = airflow_folds(module, 1e-3)
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
    (wide,), (narrow,) = airflow_folds(module), airflow_folds(module, 5e-3)
    assert wide[0] < narrow[0] < 0 < narrow[1] < wide[1] < RIGHT
    assert airflow_folds(Module.model_validate({"airflow": {"start_radius": 0.3}})) == ()


def test_a_rotor_in_a_bolted_neighbours_airflow_is_violated():
    stated = {"module": {"airflow": {"start_radius": 0.16}}}
    (fold,) = airflow_folds(Module.model_validate(stated["module"]))
    given = design(Topology(((-1, -1, -1), (0, 0, 2))), stated, hinges=(FOLD[0] * (fold[1] + 0.05),))
    rows = [pair for pair in audit(given).pairs if pair.kind == "rotor-airflow" and pair.status != Status.CLEAR]
    assert rows
    assert {pair.status for pair in rows} == {Status.VIOLATED}

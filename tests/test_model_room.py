"""The room that rigid parts need: what the search keeps, against the audit's exact parts."""

import itertools
import math

import numpy as np
import pytest
import trimesh
from suites import few
from verify_cases import design

from topo_search.model import Module, Status, Task, Topology
from topo_search.model.room import FOLD, body_radius, clear_folds
from verify.compounds import certify_compounds
from verify.parts import module_parts
from verify.requirements import Scene

HOVER = {"com": {"force": [0.0, 0.0, 1.0]}}


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
    task = Task.model_validate({"name": "plain", "modules": 5, "load_cases": [HOVER]})
    assert body_radius(task.module) == pytest.approx(math.hypot(0.15, 0.01), rel=1e-15)
    assert task.centre_distance == pytest.approx(2 * math.hypot(0.15, 0.01), rel=1e-15)
    assert task.folds(1e-4) == ((-math.pi / 2, math.pi / 2),)


def test_what_a_user_asks_for_is_kept_where_it_is_more():
    def asked(**search):
        task = Task.model_validate({"name": "asked", "modules": 5, "load_cases": [HOVER], "search": search})
        assert task.resolve(5).centre_distance == task.centre_distance
        assert task.resolve(5).search.body_clearance == (task.body_clearance or False)
        return task

    assert asked(body_clearance=0.36).centre_distance == 0.36
    assert asked(body_clearance=0.2).centre_distance == pytest.approx(0.3006659, rel=1e-6)
    for airflow_alone in ({"body_clearance": False}, {"interference": "separation"}):
        assert asked(**airflow_alone).centre_distance is None


def test_without_body_clearance_hinges_turn_as_in_the_paper():
    stated = {"name": "long", "modules": 5, "load_cases": [HOVER], "module": {"arm_length": 0.135}}
    assert Task.model_validate(stated).folds()[0][1] < 0.9
    airflow_alone = Task.model_validate({**stated, "search": {"body_clearance": False}})
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
    """Long rotors alone: they touch at an angle that is known, on either side and at every port."""
    rng = np.random.default_rng([a, b])
    for _ in range(8):
        body = {"rotor_radius": rng.uniform(0.07, 0.078), "rotor_height": rng.uniform(0.01, 0.1), "hub": [0.02] * 3}
        module = Module.model_validate({"body": body})
        ((low, high),) = clear_folds(module)
        beta = math.atan2(module.body.rotor_height / 2, 0.15 - 0.1 / math.sqrt(2) - module.body.rotor_radius)
        limit = min(math.pi / 2, math.pi - 2 * beta)
        assert low == -high
        assert limit - 5e-3 <= high <= limit
        if limit == math.pi / 2:
            continue
        for side in (-1, 1):
            assert abs(bolted(body, side * limit, a, b).analytic) < 1e-9
            assert bolted(body, side * high, a, b).status == Status.CLEAR
            assert bolted(body, side * (limit + 1e-3), a, b).status == Status.VIOLATED


@pytest.mark.parametrize("own_frame", [False, True])
def test_within_the_angle_no_rotor_touches_anything(own_frame):
    rng, limited, near = np.random.default_rng(11), 0, 0
    for _ in range(12):
        body = random_body(rng, own_frame)
        margin = rng.choice([0.0, 1e-4, 2e-3])
        for low, high in clear_folds(Module.model_validate({"body": body}), margin):
            fold = rng.choice([low, high, rng.uniform(low, high)])
            a, b = rng.integers(4, size=2).tolist()
            assert bolted(body, FOLD[a] * fold, a, b).analytic * 0.1 >= margin - 1e-9
            if high < math.pi / 2:
                limited += 1
                ports = itertools.product(range(4), repeat=2)
                near += any(bolted(body, FOLD[a] * (high + 2e-3), a, b).analytic * 0.1 < margin for a, b in ports)
    assert limited > 2
    assert near == limited  # at some port parts touch beyond


def test_a_frame_that_ends_at_its_connectors_does_not_hold_hinges_back():
    """Struts as high as the rotors, to the connectors: rotors are nowhere as near to the hinge's axis."""
    struts = [trimesh.creation.box([0.3, 0.02, 0.02]), trimesh.creation.box([0.02, 0.3, 0.02])]
    pieces = [{"vertices": box.vertices.tolist(), "triangles": box.faces.tolist()} for box in struts]
    body = {"frame": pieces, "inertia": [1e-3, 1e-3, 2e-3]}
    assert clear_folds(Module.model_validate({"body": body}), 1e-4) == ((-math.pi / 2, math.pi / 2),)
    assert bolted(body, math.pi / 2).status == Status.CLEAR


def test_a_frame_that_reaches_among_the_neighbours_rotors_leaves_steep_angles_alone():
    body = {"hub": [0.37, 0.37, 0.04]}
    (_, under), (over, _) = clear_folds(Module.model_validate({"body": body}))
    assert under == -over
    assert bolted(body, 0.0).status == bolted(body, over - 2e-3).status == Status.VIOLATED
    assert bolted(body, over).status == bolted(body, under).status == Status.CLEAR

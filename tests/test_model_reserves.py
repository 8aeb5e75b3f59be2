"""Reserves that a task asks for: corners around balls and discs, units, and what is wrong with them."""

import math
from collections import defaultdict
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from topo_search.model import BadInput, ResolvedTask, Task
from topo_search.model.corners import to_corners
from topo_search.model.files import to_toml, validate
from topo_search.model.flying import with_older_defaults
from topo_search.model.reserves import AUDIT_TOLERANCE, centres, reserve_corners

HOVER = {"carries_weight": True}
PUSH = {"name": "push", "carries_weight": True, "units": "SI", "end_effector": {"force": [2.0, 0.0, 0.0]}}
FREE = {"com": {"force": [0.2, 0.0, 0.5]}}


def task(flight: dict[str, Any], *cases: dict[str, Any], **fields: Any) -> Task:
    data = {"name": "t", "modules": 4, "load_cases": list(cases) or [HOVER], "flight": flight, **fields}
    return validate(Task, with_older_defaults(data), "t")


def inradius(points: np.ndarray) -> float:
    return float(-ConvexHull(points).equations[:, -1].max())


@pytest.mark.parametrize("inner", [False, True])
def test_corners_are_around_the_ball_and_points_for_proofs_within_it(inner: bool) -> None:
    resolved = task({"force_reserve": 0.3, "torque_reserve": 0.2}).resolve(4)
    F, T = resolved.force_unit(4), resolved.torque_unit(4)
    corners = [corner.case for corners in reserve_corners(resolved, inner=inner) for corner in corners]
    assert {corner.at_com.force for corner in corners} == {(0.0, 0.0, F)}
    assert {corner.weight for corner in corners} == {0.0}
    force = np.array([c.at_end_effector.force for c in corners[:14]]) / F
    torque = np.array([c.at_end_effector.torque for c in corners[14:]]) / T
    assert not np.any([c.at_end_effector.torque for c in corners[:14]])
    assert len(torque) == 14
    for points, r in ((force, 0.3), (torque, 0.2)):
        if inner:
            assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(14, r - AUDIT_TOLERANCE), rel=1e-12)
        else:
            assert inradius(points) == pytest.approx(r, rel=1e-9)
            assert np.linalg.norm(points, axis=1).max() == pytest.approx(1.291 * r, rel=1e-4)


def test_corners_of_a_disc_are_level() -> None:
    resolved = task({"force_reserve": 0.5, "units": "SI", "directions": "horizontal"}).resolve(4)
    (corners,) = reserve_corners(resolved, inner=False)
    force = np.array([corner.case.at_end_effector.force for corner in corners])
    assert len(force) == 8
    assert not force[:, 2].any()
    assert inradius(force[:, :2]) == pytest.approx(0.5, rel=1e-9)
    assert np.hypot(*force[:, :2].T) == pytest.approx(np.full(8, 0.5 / math.cos(math.pi / 8)))


def test_reserves_at_the_centre_of_mass_leave_the_torque_about_it() -> None:
    stated = {"force_reserve": 0.5, "units": "SI", "directions": "horizontal"}
    for at, places in (("tip", 1), ("com", 1), ("both", 2)):
        resolved = task({**stated, "at": at}).resolve(4)
        groups = reserve_corners(resolved, inner=False)
        assert len(groups) == places
        labels = [corner.label for corners in groups for corner in corners]
        assert len({*labels}) == 8 * places
        at_com = np.array([c.case.at_com.force for c in groups[-1]]) - [0.0, 0.0, resolved.force_unit(4)]
        at_tip = np.array([c.case.at_end_effector.force for c in groups[0]])
        assert inradius(at_com[:, :2] if at != "tip" else at_tip[:, :2]) == pytest.approx(0.5, rel=1e-9)
        assert at_tip.any() == (at != "com")
        assert ('"at"' in resolved.model_dump_json()) == (at != "tip")
    assert "flight" not in task({"at": "com"}).resolve(4).model_dump_json()


def test_the_corners_of_a_tilt_hold_its_cap_and_lift_no_more_than_the_weight() -> None:
    resolved = task({"tilt_deg": 25.0}).resolve(4)
    (corners,) = reserve_corners(resolved, inner=False)
    f = np.array([corner.case.at_com.force for corner in corners]) / resolved.force_unit(4)
    assert f[:, 2].max() == pytest.approx(1.0)
    assert not any(corner.case.end_effector for corner in corners if corner.case.at_end_effector.force != (0, 0, 0))
    sides, rng = ConvexHull(f).equations, np.random.default_rng(0)
    for t in np.radians(rng.uniform(0.0, 25.0, 500)):
        e = rng.uniform(0.0, 2 * math.pi)
        on_cap = np.array([math.sin(t) * math.cos(e), math.sin(t) * math.sin(e), math.cos(t)])
        assert np.all(sides[:, :3] @ on_cap + sides[:, 3] <= 1e-9)
    ((*points,),) = reserve_corners(resolved, inner=True)
    inner = np.array([corner.case.at_com.force for corner in points]) / resolved.force_unit(4)
    assert np.linalg.norm(inner, axis=1) == pytest.approx(np.ones(8), rel=1e-12)
    assert np.arccos(inner[:, 2]) == pytest.approx(np.full(8, math.radians(25.0) - AUDIT_TOLERANCE), rel=1e-12)
    assert '"tilt_deg":25.0' in resolved.model_dump_json()
    assert "tilt_deg" not in task({"torque_reserve": 0.1}).resolve(4).model_dump_json()


@pytest.mark.parametrize("inner", [False, True])
def test_errors_of_the_centre_of_mass_are_as_few_corners_as_hold_all_of_their_torques(inner: bool) -> None:
    stated = {"force_reserve": 0.2, "at": "com", "tilt_deg": 20.0, "com_error": 0.01}
    resolved = task(stated).resolve(4)
    half = 0.01 - AUDIT_TOLERANCE * resolved.module.arm_length * inner
    box = np.array(list(product((half, -half), repeat=3)))
    counts = set[int]()
    for corners in reserve_corners(resolved, inner=inner):
        torques = defaultdict[tuple[float, ...], list[tuple[float, ...]]](list)
        for corner in corners:
            torques[corner.case.at_com.force].append(corner.case.at_com.torque)
        for force, kept in torques.items():
            every = np.cross(box, force)
            first, second = np.linalg.svd(np.array([force]))[2][1:]  # torques are across the force
            plane = np.stack([first, second], axis=1)
            hull = ConvexHull(np.array(kept) @ plane)
            assert len(hull.vertices) == len(kept)
            sides = hull.equations
            assert np.max(every @ plane @ sides[:, :2].T + sides[:, 2]) <= 1e-12
            counts.add(len(kept))
    assert counts == {4, 6}


def test_reserves_are_around_hover_or_all_cases_that_carry_the_weight() -> None:
    for around, names in (("hover", ["hover"]), ("all", ["hover", "load case 0 (push)", "load case 2"])):
        resolved = task({"force_reserve": 0.1, "around": around}, PUSH, FREE, HOVER).resolve(4)
        assert [label for _, label, _ in centres(resolved)] == names
    labels = to_corners(resolved).case_labels
    assert labels[3] == "hover, force reserve 0"
    assert labels[17] == "load case 0 (push), force reserve 0"
    assert len(labels) == 3 + 42
    (_, _, push) = centres(resolved)[1]
    assert push.at_end_effector.force == (2.0, 0.0, 0.0)


def test_proofs_leave_reserves_out_that_inputs_beyond_the_peak_may_keep() -> None:
    resolved = task({"force_reserve": 0.1}, search={"peak_input": 0.9}).resolve(4)
    assert to_corners(resolved, inner=True) is resolved
    assert len(to_corners(resolved).load_cases) == 15


def test_reserves_in_weights_grow_with_the_platform_and_a_design_has_newtons() -> None:
    stated = task({"force_reserve": 0.1, "torque_reserve": 0.05}, modules=[3, 6])
    for n in (3, 6):
        asked = stated.resolve(n).flight
        assert asked.units == "SI"
        assert asked.force_reserve == pytest.approx(0.1 * stated.force_unit(n))
        assert asked.torque_reserve == pytest.approx(0.05 * stated.torque_unit(n))
    resolved = stated.resolve(3)
    assert Task.model_validate(with_older_defaults(resolved.model_dump(mode="json"))).resolve(3) == resolved
    assert "[flight]" in to_toml(stated)
    assert "flight" not in task({}).resolve(4).model_dump_json()
    assert "flight" not in task({"units": "weight", "around": "all"}).resolve(4).model_dump_json()
    with pytest.raises(BadInput, match=r'flight.units: must be "SI" in a design'):
        validate(ResolvedTask, {**resolved.model_dump(mode="json"), "flight": {"force_reserve": 0.1}}, "design")


def test_too_many_corners_are_refused() -> None:
    cases = [{"carries_weight": True, "com": {"torque": [1e-3 * k, 0.0, 0.0]}} for k in range(16)]
    with pytest.raises(BadInput, match=r"flight: must ask for at most 200 wrenches with all load cases, .* 254"):
        task({"force_reserve": 0.1, "around": "all"}, *cases)
    with pytest.raises(BadInput, match=r"at most 200 wrenches with all load cases, .* 260"):
        task({"force_reserve": 0.1, "around": "all", "at": "both"}, *cases[:8])

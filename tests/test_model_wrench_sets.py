"""Load cases that stand for a set of wrenches: the corners that decide, and what is wrong with a set."""

import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from topo_search.model import BadInput, ResolvedTask, Task
from topo_search.model.corners import corners_of, to_corners
from topo_search.model.files import to_toml, validate
from topo_search.model.load_case import ForceCone

CONE = {"axis": [1.0, 0.0, 0.0], "half_angle_deg": 20.0, "force": 0.2}


def task(*cases: dict[str, Any], modules: int = 5) -> Task:
    return validate(Task, {"name": "t", "modules": modules, "load_cases": list(cases)}, "t")


def faults(*cases: dict[str, Any]) -> list[str]:
    with pytest.raises(BadInput) as told:
        task(*cases)
    return [str(fault) for fault in told.value.faults]


@given(st.integers(0, 2**32), st.floats(0.5, 60.0), st.floats(0.01, 100.0))
def test_corners_of_a_cone_hold_all_of_its_forces_and_little_more(seed: int, angle: float, force: float) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    cone = ForceCone(axis=tuple(axis.tolist()), half_angle_deg=angle, force=force)
    corners = np.array(cone.corners) / force
    assert not corners[0].any()
    assert len(corners) == 9
    assert corners[1:] @ axis == pytest.approx(np.ones(8))
    theta = math.radians(angle)
    tilt, turn = theta * np.append(rng.random(3), 1.0), rng.uniform(0, 2 * np.pi, 4)
    across = np.linalg.svd(axis[None])[2][1:]
    inside = np.cos(tilt)[:, None] * axis + np.sin(tilt)[:, None] * (
        np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1]
    )
    for f in inside:
        held = linprog(np.zeros(9), A_eq=np.vstack([corners.T, np.ones(9)]), b_eq=[*f, 1.0])
        assert held.status == 0
    size = math.hypot(1.0, math.tan(theta) / math.cos(math.pi / 8))
    assert np.linalg.norm(corners[1:], axis=1) == pytest.approx(np.full(8, size))


def test_a_set_is_scaled_with_the_platform_and_keeps_torque_and_weight_of_its_case() -> None:
    stated = task(
        {
            "end_effector": {"force": [0.1, 0.0, 0.0], "torque": [0.2, 0.0, 0.0]},
            "carries_weight": True,
            "cone": CONE,
        },
        {"end_effector": {"force": [0.0, 0.0, 0.1]}, "vertices": [{"torque": [0.0, 0.5, 0.0]}]},
    )
    for n in (3, 6):
        resolved = stated.resolve(n)
        F, T = stated.force_unit(n), stated.torque_unit(n)
        (zero, first), (last,) = resolved.load_cases[0].corners[:2], resolved.load_cases[1].corners
        assert zero.at_end_effector.force == (0.0, 0.0, 0.0)
        assert zero.at_end_effector.torque == first.at_end_effector.torque == (pytest.approx(0.2 * T), 0.0, 0.0)
        assert first.at_end_effector.force[0] == pytest.approx(0.2 * F)
        assert zero.at_com.force == (0.0, 0.0, pytest.approx(F))
        assert last.at_end_effector.torque == (0.0, pytest.approx(0.5 * T), 0.0)
        assert last.at_end_effector.force == (0.0, 0.0, 0.0)
        assert {case.weight for _, case in corners_of(resolved)} == {0.0}


def test_own_wrench_and_equal_vertices_are_no_corners_twice() -> None:
    own = {"force": [0.1, 0.0, 0.0]}
    (case,) = (
        task({"end_effector": own, "vertices": [own, {"force": [0.2, 0.0, 0.0]}, {"force": [0.2, 0.0, 0.0]}]})
        .resolve(5)
        .load_cases
    )
    assert [corner.at_end_effector.force[0] / (5 * 0.24 + 0.048) / 9.81 for corner in case.corners] == [
        pytest.approx(0.2)
    ]


def test_written_out_its_own_cases_come_first_and_all_are_called_by_name() -> None:
    stated = task({"name": "wipe", "carries_weight": True, "cone": CONE}, {"carries_weight": True, "weight": 2.0})
    resolved = stated.resolve(5)
    single = to_corners(resolved)
    assert [case.weight for case in single.load_cases] == [1.0, 2.0, *[0.0] * 8]
    assert single.case_labels[:3] == ("load case 0 (wipe)", "load case 1", "load case 0 (wipe), corner 0")
    assert single.declared == resolved
    assert to_corners(single) is single
    assert pickle.loads(pickle.dumps(single)) == single
    plain = task({"carries_weight": True}).resolve(5)
    assert to_corners(plain) is plain
    assert plain.declared is plain


def test_a_set_comes_back_from_a_file_and_from_a_design() -> None:
    stated = task({"carries_weight": True, "cone": CONE, "vertices": [{"force": [0.0, 0.1, 0.0]}]})
    assert "half_angle_deg = 20.0" in to_toml(stated)
    resolved = stated.resolve(5)
    again = Task.model_validate_json(resolved.model_dump_json()).resolve(5)
    assert again == resolved
    assert isinstance(again, ResolvedTask)
    assert "cone" not in task({"carries_weight": True}).resolve(5).model_dump_json()


@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        ({"cone": {**CONE, "axis": [0, 0, 0]}}, "load_cases[0].cone.axis: must have a direction, but got"),
        ({"cone": {**CONE, "half_angle_deg": 0}}, "load_cases[0].cone.half_angle_deg: must be greater than"),
        ({"cone": {**CONE, "half_angle_deg": 61}}, "load_cases[0].cone.half_angle_deg: must be at most 60"),
        ({"cone": {**CONE, "force": -1}}, "load_cases[0].cone.force: must be greater than 0, but got -1"),
        ({"cone": {**CONE, "size": 1}}, "load_cases[0].cone.size: unknown field; valid names are"),
        ({"cone": {"axis": [1, 0, 0], "force": 1}}, "load_cases[0].cone.half_angle_deg: is required, but missing"),
        ({"cone": 3}, "load_cases[0].cone: must be a table of named fields, but got 3"),
        ({"vertices": [{"forces": [1, 0, 0]}]}, "load_cases[0].vertices[0].forces: unknown field; did you"),
        ({"vertices": {"force": [1, 0, 0]}}, "load_cases[0].vertices: must be a list, but got"),
        ({"vertices": [{}] * 201}, "load_cases[0].vertices: must have at most 200 vertices, but got 201"),
        (
            {"vertices": [{"force": [1e-3 * k, 0, 0]} for k in range(1, 201)]},
            "load_cases: must have at most 200 entries, corners of sets included, but got 201",
        ),
        ({"vertices": [{"force": [1e300, 0, 0]}]}, "load_cases[0]: must be at most 1e+15 N and N m, but"),
        ({"cone": {**CONE, "force": 1e15}}, "load_cases[0]: must be at most 1e+15 N and N m, but got"),
    ],
)
def test_what_is_wrong_with_a_set_is_told(fields: dict[str, Any], fault: str) -> None:
    (told,) = faults({"carries_weight": True, **fields})
    assert told.startswith(fault)

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
from topo_search.model.flying import with_older_defaults
from topo_search.model.load_case import ForceCone
from topo_search.report.task_warnings import task_warnings

CONE = {"axis": [1.0, 0.0, 0.0], "half_angle_deg": 20.0, "force": 0.2}


def task(*cases: dict[str, Any], modules: Any = 5, **fields: Any) -> Task:
    """Return a task without oddities beside its load cases."""
    fields = {"module": {"torque_coefficient": 3.1e-9}, **fields}
    return validate(
        Task, with_older_defaults({"name": "t", "modules": modules, "load_cases": list(cases), **fields}), "t"
    )


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
        assert linprog(np.zeros(9), A_eq=np.vstack([corners.T, np.ones(9)]), b_eq=[*f, 1.0]).status == 0
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
    other = {"force": [0.2, 0.0, 0.0]}
    (case,) = task({"end_effector": own, "vertices": [own, other, other]}).resolve(5).load_cases
    (corner,) = case.corners
    assert corner.at_end_effector.force[0] / (5 * 0.24 + 0.048) / 9.81 == pytest.approx(0.2)


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
    assert Task.model_validate(with_older_defaults(resolved.model_dump(mode="json"))).resolve(5) == resolved
    assert "cone" not in task({"carries_weight": True}).resolve(5).model_dump_json()


# ---- Load cases: what they come to in N and N m for a number of modules.

TORQUE = {"torque": [0.1, 0.0, 0.0]}


@pytest.mark.parametrize("n", [1, 3, 40])
def test_the_weight_is_the_platforms_whatever_its_size_and_the_units(n: int) -> None:
    """m_t g by hand: n modules of 0.24 kg and an end-effector of 0.1 kg."""
    stated = task(
        {"carries_weight": True},
        {"carries_weight": True, "units": "SI", "end_effector": {"force": [2.0, 0.0, 0.0], **TORQUE}},
        {"carries_weight": True, "units": "SI", "com": {"force": [0.5, 0.0, -1.0], **TORQUE}},
        {"carries_weight": True, "com": {"force": [0.0, 0.2, 0.5]}},
        modules=[n, n + 3],
        end_effector={"mass": 0.1},
    )
    weight = (n * 0.24 + 0.1) * 9.81
    cases = stated.resolve(n).load_cases
    assert [case.at_com.force for case in cases] == [
        (0.0, 0.0, pytest.approx(weight)),
        (0.0, 0.0, pytest.approx(weight)),
        (0.5, 0.0, pytest.approx(weight - 1.0)),
        (0.0, pytest.approx(0.2 * weight), pytest.approx(1.5 * weight)),
    ]
    assert cases[1].at_end_effector.force == (2.0, 0.0, 0.0)
    assert cases[2].at_com.torque == (0.1, 0.0, 0.0)
    assert not any(case.carries_weight for case in cases)


def test_it_is_the_same_task_as_with_the_weight_written_out() -> None:
    push = {"force": [0.2, 0.0, 0.0]}
    said = task({"carries_weight": True, "end_effector": push}, {"carries_weight": True})
    hover = {"com": {"force": [0.0, 0.0, 1.0]}}
    assert said.resolve(5) == task({"end_effector": push, **hover}, hover).resolve(5)


def test_a_task_is_written_with_it_and_a_design_without() -> None:
    said = task({"carries_weight": True, "units": "SI", "end_effector": {"force": [2.0, 0.0, 0.0]}})
    assert "carries_weight = true" in to_toml(said)
    resolved = said.resolve(5)
    assert "carries_weight" not in resolved.model_dump_json()
    assert Task.model_validate(with_older_defaults(resolved.model_dump(mode="json"))).resolve(5) == resolved
    also = {"units": "SI", "carries_weight": True}
    with pytest.raises(BadInput) as told:
        validate(ResolvedTask, {**resolved.model_dump(mode="json"), "load_cases": [also]}, "d")
    assert [fault.path for fault in told.value.faults] == ["load_cases[0].carries_weight"]


def test_a_name_is_told_with_the_number_and_does_not_hide_that_two_are_the_same() -> None:
    named = task({"name": "Wand Süd +x", "carries_weight": True}, {"carries_weight": True, "weight": 0.0})
    assert named.resolve(5).case_labels == ("load case 0 (Wand Süd +x)", "load case 1")
    assert named.resolve(5).load_cases[0].name == "Wand Süd +x"
    same = task({"name": "a", "carries_weight": True}, {"name": "b", "carries_weight": True})
    assert [str(one) for one in task_warnings(same)] == ["load_cases[1]: is the same as load_cases[0]"]


def test_weights_far_apart_are_odd_and_none_at_all_is_not() -> None:
    hover, light = {"carries_weight": True}, {"carries_weight": True, "com": {"force": [0.1, 0.0, 0.0]}}
    assert task_warnings(task(hover, {**light, "weight": 0.0})) == ()
    assert "by a factor of 1e+05" in str(task_warnings(task(hover, {**light, "weight": 1e-5}))[0])


def test_sizes_compare_where_only_the_weight_grows() -> None:
    push = {"carries_weight": True, "units": "SI", "end_effector": {"force": [2.0, 0.0, 0.0]}}
    asked = task(push, {"carries_weight": True}, modules=[3, 6], goals={"modules": True})
    assert asked.goals.names == ("modules",)
    with pytest.raises(BadInput, match=r"load_cases\[1\]\.units: must be \"SI\" to compare.*carries_weight = true"):
        task(push, {"com": {"force": [0.0, 0.0, 1.0]}}, modules=[3, 6], goals={"modules": True})

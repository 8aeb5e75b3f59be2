"""Sets of wrenches in solver, bounds and audit: the corners decide, and a design has inputs for its cases alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from nlp_cases import HOVER, best_design, push
from scipy.optimize import linprog
from verify_cases import design

from nlp import lower_bound, prove_impossible
from nlp.program import AssembledProgram
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, Status, Topology
from topo_search.model.corners import to_corners
from topo_search.topologies import sample
from verify import audit
from verify.kinematics import platform, wrench_map

UP = np.array([0.0, 0.0, 1.0])
TREE = Topology.from_key("a70200")
CONE = {"axis": [1.0, 0.0, 0.0], "half_angle_deg": 20.0, "force": 0.15}
WIPE: dict[str, Any] = {
    "name": "wipe",
    "carries_weight": True,
    "end_effector": {"force": [0.1, 0.0, 0.0]},
    "cone": CONE,
}


def test_a_design_can_exert_all_of_a_cone_and_has_inputs_for_its_cases_alone() -> None:
    task = push(5, load_cases=[WIPE, HOVER])
    found = best_design(task, TREE, 4)
    assert found.task == task
    assert found.inputs.shape == (2, 5, 4)
    judged = audit(found)
    assert judged.verdict == "clear"
    rows = [row for row in judged.residuals if "corner" in row.name]
    assert [row.name for row in rows] == [f"load case 0 (wipe), corner {k}" for k in range(9)]
    assert lower_bound(task) <= found.objective
    at = platform(found)
    unit = np.repeat([task.force_unit(5), task.torque_unit(5)], 3)
    A = wrench_map(at, task.module) * task.max_input / unit[:, None]
    rng = np.random.default_rng(0)
    for _ in range(20):  # forces of the cone, not corners
        f = rng.normal(size=3) * [1.0, 0.3, 0.3] + [2.0, 0.0, 0.0]
        f *= 0.15 * rng.random() / np.linalg.norm(f) * (abs(np.arctan2(np.hypot(*f[1:]), f[0])) < np.radians(20))
        asked = np.concatenate([f + UP, np.cross(at.p_e / task.module.arm_length, f)])
        assert linprog(np.zeros(20), A_eq=A, b_eq=asked, bounds=(0, 1)).status == 0


def test_it_is_the_task_whose_corners_are_load_cases_without_weight() -> None:
    task = push(5, load_cases=[WIPE, HOVER])
    plain = {"carries_weight": True}
    f = to_corners(task).load_cases[2:]
    listed = [{**plain, "units": "SI", "end_effector": c.at_end_effector.model_dump(), "weight": 0.0} for c in f]
    one = {name: value for name, value in WIPE.items() if name != "cone"}
    written = push(5, load_cases=[one, HOVER, *listed])
    assert lower_bound(task) == pytest.approx(lower_bound(written), rel=1e-12)
    start = draw(written, TREE, generator(written, TREE, 0, seed=0))
    ends = [AssembledProgram(t, TREE).solve(replace(start, task=t)).point for t in (to_corners(task), written)]
    assert ends[0].pack() == pytest.approx(ends[1].pack(), abs=1e-9)


def test_what_no_platform_can_exert_is_proven_by_its_corner() -> None:
    strong = {**WIPE, "cone": {**CONE, "force": 4.0}}
    proof = prove_impossible(push(5, load_cases=[strong, HOVER]))
    assert proof.worst_constraint == "load case 0 (wipe), corner 1, force"
    assert "load case 0 (wipe), corner 1" in proof.message


def drawn(seed: int, **fields: Any) -> Design:
    """Any platform; whether it can do what it is asked for is for the audit to say."""
    rng = np.random.default_rng(seed)
    (tree,) = sample(5, 1, seed)
    vertices = [{"force": f.tolist(), "torque": t.tolist()} for f, t in rng.uniform(-0.15, 0.15, (6, 2, 3))]
    task = {
        "load_cases": [{"carries_weight": True, "vertices": vertices}],
        "module": {"max_thrust_to_weight": 4.0, "min_input": 0.02},
        **fields,
    }
    tip = tuple(rng.uniform(-0.5, 0.5, 3).tolist())
    return design(tree, task, hinges=tuple(rng.uniform(-0.7, 0.7, 4).tolist()), end_effector=tip)


def test_the_audit_says_of_every_corner_what_another_program_says() -> None:
    """Random platforms and corners; between the least input and the peak that the task allows."""
    seen = set()
    for seed in range(12):
        given = drawn(seed, search={"peak_input": 0.8})
        task, at = given.task, platform(given)
        unit = np.repeat([task.force_unit(5), task.torque_unit(5)], 3)
        A = wrench_map(at, task.module) * task.module.max_input(task.gravity) / unit[:, None]
        rows = [row for row in audit(given).residuals if "corner" in row.name]
        assert len(rows) == 6
        for row, vertex in zip(rows, task.load_cases[0].vertices, strict=True):
            f, tau = np.array(vertex.force), np.array(vertex.torque)
            b = np.concatenate([f + task.force_unit(5) * UP, tau + np.cross(at.p_e, f)]) / unit
            able = linprog(np.zeros(20), A_eq=A, b_eq=b, bounds=(0.02, 0.8)).status == 0
            assert row.status is (Status.CLEAR if able else Status.VIOLATED)
            assert (row.scaled <= row.tolerance) is able
            seen.add(able)
    assert seen == {True, False}


def test_a_corner_out_of_reach_violates_whatever_the_inputs_of_the_design() -> None:
    found = best_design(push(5, load_cases=[WIPE, HOVER]), TREE, 4)
    cases = [case.model_dump(mode="json") for case in found.task.load_cases]
    cases[0]["cone"]["force"] *= 20
    task = found.task.model_copy(update={"load_cases": push(5, load_cases=cases).load_cases})
    assert audit(found.model_copy(update={"task": task})).verdict == "violated"


def test_what_programs_cannot_tell_is_undecided() -> None:
    """Torques of 1e9 weights: beyond the digits."""
    far = drawn(0, load_cases=[{"carries_weight": True, "vertices": [{"torque": [1e9, 0.0, 0.0]}]}])
    (row,) = (row for row in audit(far).residuals if "corner" in row.name)
    assert row.status is Status.UNDECIDED

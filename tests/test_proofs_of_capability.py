"""Proofs that no platform holds a value, attacked: by platforms that hold it, and by changed records and tasks."""

import numpy as np
import pytest
from capability_cases import QUANTITIES, drawn, held, platform_at, task_of
from nlp_cases import push
from suites import few
from test_nlp_bounds_branch import bound_of, multipliers_for
from test_verify_proof import any_multipliers
from test_verify_proof import bound_of as checked_bound

from nlp import proof_root, prove_chunk
from nlp.bounds.branch.arrays import centre, is_symmetric, reroot, to_arrays, whole_box
from topo_search.model import Proof, Topology
from topo_search.model.maximized import provable_at, ring, task_at
from topo_search.model.proof import most_effort
from topo_search.study.proofs import concerns
from verify import check_chunk
from verify.proof.check import chunk_box
from verify.proof.platform import to_arrays as check_arrays
from verify.proof.platform import turns_about_vertical

BENT = Topology.from_key("a300")
THETA = np.array([0.0, -0.39908848, 0.59423876, -1.31552372, 1.27624649])
TIP = np.array([0.25551696, -0.32336688, 0.78384849])
"""Angles and end-effector of a platform that holds 0.28 W in every horizontal direction."""
DISC = task_of("force_reserve", 3, cases="hover").with_fields("search", interference="separation", separation=1e-3)
"""Airflow of that platform overlaps, which is allowed here."""
WEIGHT = DISC.force_unit(3)
LEFT = [number for number in range(64) if np.all(chunk_box(DISC, 3, number)[0] <= THETA)
        and np.all(chunk_box(DISC, 3, number)[1] >= THETA)]  # fmt: skip


def proven(value, number, most_boxes=4000):
    task = provable_at(DISC, value * WEIGHT)
    return task, prove_chunk(task, BENT, number, most_effort(task), most_boxes=most_boxes)


def fault_of(task, chunk):
    return check_chunk(task, BENT, proof_root(task, BENT), most_effort(task), chunk).fault


@pytest.fixture(scope="module")
def impossible():
    """The chunk with that platform, at a value that none of its platforms holds."""
    return proven(0.42, LEFT[0])


def test_what_a_platform_holds_is_not_proven_impossible():
    size = held(DISC, platform_at(DISC, BENT, THETA, TIP), ring(32)) / WEIGHT
    assert 0.275 < size < 0.285
    assert len(LEFT) == 1
    assert proven(0.999 * size, LEFT[0])[1].outcome == "many"


def test_a_value_that_none_holds_is_proven_and_checked(impossible):
    task, chunk = impossible
    assert chunk.outcome == "closed"
    assert fault_of(task, chunk) is None


def test_the_record_of_another_value_or_a_changed_one_is_refused(impossible):
    task, chunk = impossible
    assert "no bound excludes it" in fault_of(provable_at(DISC, 0.28 * WEIGHT), chunk)
    changed = type(chunk).of(chunk.number, "closed", chunk.record[:-1], corners=chunk.corners)
    assert "ends before" in fault_of(task, changed)
    turned = type(chunk).of(chunk.number, "closed", bytes([2]) + 2 * chunk.record, corners=chunk.corners)
    assert "unknown angle" in fault_of(task, turned)  # a half of psi = 0


@pytest.mark.parametrize("towards", [(1.1, 0.0, 0.0), (0.8, 0.0, 0.6)])
def test_a_reserve_beyond_its_disc_is_refused(impossible, towards):
    task, chunk = impossible
    beyond = task.with_fields("search", towards=(*task.search.towards[1:], towards))
    assert "beyond its ball or disc" in fault_of(beyond, chunk)


def test_only_what_is_symmetric_about_the_vertical_is_proven_at_one_angle():
    symmetric = [
        DISC,
        task_of("torque_reserve", 3, cases="hover"),
        task_of("payload", 3, cases="hover"),
        DISC.with_fields("end_effector", position=(0.0, 0.0, -0.2)),
    ]
    others = [
        task_of("force_reserve", 3),
        DISC.with_fields("flight", com_error=0.01),
        DISC.with_fields("search", root="paper"),
        DISC.with_fields("end_effector", position=(0.1, 0.0, -0.2)),
        push(3, load_cases=[{"carries_weight": True, "com": {"torque": [0.0, 0.1, 0.0]}}]),
        push(3, load_cases=[{"carries_weight": True, "vertices": [{"force": [0.0, 0.1, 0.0]}]}]),
        push(
            3,
            load_cases=[{"carries_weight": True}],
            exposure=[{"kind": "allowed", "planes": [{"normal": [1.0, 0.0, 0.0]}]}],
        ),
    ]
    for turns in (is_symmetric, turns_about_vertical):
        assert [turns(task, "task") for task in symmetric] == [True] * len(symmetric)
        assert [turns(task, "task") for task in others] == [False] * len(others)
        assert not turns(DISC, "solver")


def test_platforms_turned_about_the_vertical_hold_the_same():
    rng = np.random.default_rng(71)
    at_0 = held(DISC, platform_at(DISC, BENT, THETA, TIP), ring(90))
    for psi in rng.uniform(-np.pi, np.pi, size=2):
        turn = np.array([[np.cos(psi), -np.sin(psi), 0.0], [np.sin(psi), np.cos(psi), 0.0], [0.0, 0.0, 1.0]])
        turned = platform_at(DISC, BENT, THETA + psi * np.eye(5)[0], turn @ TIP)
        assert held(DISC, turned, ring(90)) == pytest.approx(at_0, rel=2e-3)


@pytest.mark.parametrize(
    ("quantity", "seed"),
    few([(q, seed) for q in QUANTITIES for seed in range(10)], [(q, 0) for q in QUANTITIES]),
)
def test_no_multipliers_exclude_what_a_platform_holds(quantity, seed):
    rng = np.random.default_rng([72, seed, QUANTITIES.index(quantity)])
    task, size = task_of(quantity, 3), None
    while not size:
        tree, theta, tip = drawn(task, rng)
        tree = reroot(tree, centre(task, tree))
        size = held(task, platform_at(task, tree, theta, tip))
    least, most = whole_box(task, 3)
    for share in (1.0, 0.5):
        stated = task_at(task, share * size)
        half = 10 ** rng.uniform(-6, -1) * rng.random(len(theta))
        lower, upper = np.maximum(theta - half, least), np.minimum(theta + half, most)
        ours, checked = to_arrays(stated, tree, weighted=False), check_arrays(stated, tree, weighted=False)
        for _ in range(10):
            assert bound_of(ours, *multipliers_for(ours, rng), lower, upper) <= 0.0
            assert checked_bound(checked, *any_multipliers(checked, rng), lower, upper) <= 0.0


def test_no_inputs_cost_more_than_the_cut_of_such_a_proof():
    task = task_of("load", 2)
    assert most_effort(task) > 2 * 4 * 2 * (task.max_input * (1 + 1e-6)) ** 2


def test_a_proof_of_another_theorem_is_none_of_the_run():
    """About effort under a cut, about a task for another value than it says, about other points of a ball."""
    stated = provable_at(DISC, 0.4 * WEIGHT)
    scope = {"topology_key": "a300", "root_module": 0, "aim": "within", "gap": 0.05}
    proof = Proof(task=stated, cut=most_effort(stated), **scope)
    assert concerns(proof, DISC)
    assert proof.bound == -proof.level == 0.4 * WEIGHT
    others = [
        {"cut": 0.5 * proof.cut},
        {"task": stated.with_fields("search", reached=0.3 * WEIGHT)},
        {"task": stated.with_fields("search", towards=((1.0, 0.0, 0.0),))},
        {"task": DISC},
    ]
    assert not any(concerns(proof.model_copy(update=other), DISC) for other in others)

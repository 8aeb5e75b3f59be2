"""Proofs over a set of hinge angles: against all combinations, and attacked with sets that hold a better one."""

import math
from itertools import product

import numpy as np
import pytest
from nlp_cases import HOVER, push

from nlp import proof_root, prove_chunk, solve
from nlp.bounds.branch.search import halves
from topo_search.model import Design, Topology
from topo_search.model.proof import chunk_count
from topo_search.study.proofs import problem
from verify import check_chunk
from verify.proof.check import chunk_box
from verify.proof.platform import angles_around, angles_of_hinges

CASES = [{"end_effector": {"force": [0.25, 0.0, 0.75]}}, HOVER]
JOINTS = ((-1, -1, -1), (0, 0, 2), (0, 1, 3))


def task_of(n: int, *angles: float):
    return push(n, load_cases=CASES, search={"hinge_angles_deg": angles})


def best_of_all(n: int, tree: Topology, *angles: float) -> float:
    """Return the least effort of all combinations of angles, each solved alone, with any turns."""
    efforts = []
    for chosen in product(angles, repeat=n - 1):
        outcome = solve(task_of(n, *sorted(set(chosen))), tree, starts=range(2), seed=0)
        efforts.append(outcome.objective if isinstance(outcome, Design) else math.inf)
    return min(efforts)


@pytest.fixture(scope="module", params=[(2, (0.0, 20.0, 45.0, 75.0)), (3, (30.0, 60.0))], ids=["two", "three"])
def case(request):
    n, angles = request.param
    task, tree = task_of(n, *angles), Topology(JOINTS[:n])
    least = best_of_all(n, tree, *angles)
    cut = 0.995 * least
    return task, tree, least, cut, [prove_chunk(task, tree, k, cut) for k in range(chunk_count(n))]


def test_a_cut_under_the_best_of_all_combinations_is_proven_and_checked(case):
    task, tree, _, cut, chunks = case
    assert {chunk.outcome for chunk in chunks} == {"closed"}
    checked = [check_chunk(task, tree, proof_root(task, tree), cut, chunk) for chunk in chunks]
    assert [each.fault for each in checked] == [None] * len(chunks)


def test_a_cut_above_the_best_is_neither_proven_nor_accepted(case):
    task, tree, least, _, chunks = case
    above = 1.002 * least
    faults = [check_chunk(task, tree, proof_root(task, tree), above, chunk).fault for chunk in chunks]
    refused = [chunk.number for chunk, fault in zip(chunks, faults, strict=True) if fault is not None]
    assert refused
    outcomes = {prove_chunk(task, tree, k, above, most_boxes=20_000).outcome for k in refused}
    assert outcomes - {"closed"}


def test_a_record_of_a_poorer_set_is_refused_for_a_richer_one():
    tree, poor, rich = Topology(JOINTS[:2]), task_of(2, 0.0), task_of(2, 0.0, 20.0, 45.0, 75.0)
    cut = 1.002 * best_of_all(2, tree, 0.0, 20.0, 45.0, 75.0)
    chunks = [prove_chunk(poor, tree, k, cut) for k in range(chunk_count(2))]
    assert {chunk.outcome for chunk in chunks} == {"closed"}  # two that lie flat are worse, or not clear
    assert any(check_chunk(rich, tree, 0, cut, chunk).fault for chunk in chunks)


def test_every_combination_is_in_one_chunk():
    task, n = push(4, search={"hinge_step_deg": 30.0}), 4
    angles = angles_of_hinges(task)
    boxes = [chunk_box(task, n, number) for number in range(chunk_count(n))]
    for chosen in product(angles, repeat=n - 1):
        inside = [np.all(lower[3:] <= chosen) and np.all(chosen <= upper[3:]) for lower, upper in boxes]
        assert sum(inside) == 1


@pytest.mark.parametrize("seed", range(5))
def test_prover_and_checker_part_intervals_alike_and_lose_no_angle(seed):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(-1.5, 1.5, 9))
    lower, upper = np.sort(rng.choice(angles, 2, replace=False))
    end, begin = halves(angles, lower, upper)
    assert (end, begin) == angles_around(angles, (lower + upper) / 2)
    within = angles[(lower <= angles) & (angles <= upper)]
    assert np.array_equal(
        within, angles[((lower <= angles) & (angles <= end)) | ((begin <= angles) & (angles <= upper))]
    )
    assert halves(angles, lower, lower) == (lower, math.inf)
    assert halves(np.zeros(0), -1.0, 2.0) == angles_around(np.zeros(0), 0.5) == (0.5, 0.5)


def test_the_scope_of_a_proof_names_the_set():
    assert "hinge angles of the task's set" in problem(task_of(2, 30.0), "task")
    assert "hinge angles within 90 deg either way" in problem(push(2), "task")

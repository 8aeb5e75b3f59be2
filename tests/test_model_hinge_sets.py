"""Sets of hinge angles in a task: what they mean, what is refused, and that tasks without one stay as they are."""

import math
from itertools import product

import numpy as np
import pytest
from nlp_cases import HOVER, PUSH, best_design, push, solved
from suites import few

from nlp import default_starts, hinge_sets, proof_root, prove_chunk, solve
from nlp.bounds.branch.search import halves
from nlp.numbers.geometry import allowed_folds, fold_excess, nearest_angles, ranges
from topo_search.model import BadInput, Design, Infeasible, Topology
from topo_search.model.files import to_toml
from topo_search.model.proof import chunk_count
from topo_search.model.task_file import read_task
from topo_search.report.task_warnings import task_warnings
from topo_search.study.relaxable_limits import relaxable
from topo_search.topologies import candidates
from verify import audit, check_chunk
from verify.proof.check import chunk_box
from verify.proof.platform import angles_around, hinge_angles

TREE = Topology.from_key("a300")


def of(*settings: str):
    return read_task("push", ("modules=3", *(f"search.{each}" for each in settings)))


def test_a_step_means_its_multiples_and_a_list_is_turned_either_way():
    assert of("hinge_step_deg=30").search.hinge_set_deg == (-90, -60, -30, 0, 30, 60, 90)
    assert of("hinge_step_deg=35").search.hinge_set_deg == (-70, -35, 0, 35, 70)
    assert max(of("hinge_step_deg=0.9").search.hinge_set_deg or ()) == 90
    assert of("hinge_angles_deg=[45, 0, 30]").search.hinge_set_deg == (-45, -30, 0, 30, 45)
    assert of("hinge_angles_deg=[90]").search.hinge_set_deg == (-90, 90)
    assert to_toml(of("hinge_angles_deg=[-0.0]")) == to_toml(of("hinge_angles_deg=[0]"))


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("hinge_step_deg=0", "hinge_step_deg: must be at least 0.1"),
        ("hinge_angles_deg=[0, 180]", r"hinge_angles_deg\[1\]: must be at most 90, but got 180"),
        ("hinge_angles_deg=[30, 30]", "must differ by 0.1 deg or more"),
        ("hinge_angles_deg=[]", "must have at least one entry"),
    ],
)
def test_a_set_that_no_drawer_holds_is_refused(setting, words):
    with pytest.raises(BadInput, match=words):
        of(setting)


def test_a_set_beside_a_step_or_outside_what_rotors_leave_is_refused():
    with pytest.raises(BadInput, match="must be left out if hinge_angles_deg is given, but got 15"):
        of("hinge_step_deg=15", "hinge_angles_deg=[0]")
    tall = "module.body.rotor_radius=0.075"
    assert math.degrees(read_task("push", (tall,)).folds(1e-4)[0][1]) < 85
    with pytest.raises(BadInput, match="must have an angle that keeps rotors clear of a neighbour, at most"):
        read_task("push", (tall, "search.hinge_angles_deg=[85, 90]"))
    task = read_task("push", (tall, "search.hinge_angles_deg=[20, 90]")).resolve(3)
    assert allowed_folds(task, 1e-4) == ((-math.radians(20),) * 2, (math.radians(20),) * 2)
    warned = {
        each.path: each.words for each in task_warnings(read_task("push", (tall, "search.hinge_step_deg=15")))
    }
    assert "6 of 13 angles, -90, -75, -60, 60, ... deg, are beyond" in warned["search.hinge_step_deg"]
    assert "search.hinge_step_deg" not in {each.path for each in task_warnings(of("hinge_step_deg=15"))}


def test_a_step_is_written_and_any_angle_is_a_task_without_it():
    assert "hinge_step_deg = 15" in to_toml(of("hinge_step_deg=15"))
    assert of("hinge_step_deg=15").search.any_angle == read_task("push").search


def test_a_task_without_a_design_is_told_to_leave_the_set_out():
    for setting in ("hinge_step_deg=15", "hinge_angles_deg=[0]"):
        limits = {each.limit: each for each in relaxable(of(setting), 3)}
        freed = limits["set of hinge angles"]
        assert freed.field == f"search.{setting.partition('=')[0]} left out"
        assert freed.relax(freed.largest_share) == read_task("push", ("modules=3",))
    assert "set of hinge angles" not in {each.limit for each in relaxable(read_task("push"), 3)}


def test_the_solver_holds_hinges_to_the_nearest_angle_bit_by_bit():
    task = of("hinge_step_deg=10").resolve(3)
    near = nearest_angles(task, TREE, [0.52, -1.6])
    assert near.tolist() == [math.radians(30), -math.radians(90)]
    assert ranges(task, TREE, near) == (near.tolist(), near.tolist())
    assert fold_excess(task, TREE, near).tolist() == [0.0, 0.0]
    assert fold_excess(task, TREE, np.nextafter(near, 2.0)).max() > 0


# ---- Hinge angles from a set: what the search finds is what all combinations hold, and exactly of the set.


def best(key: str, **search: object):
    return solve(push(len(key) - 1, search=search), Topology.from_key(key), starts=range(4), seed=0)


@pytest.mark.parametrize(
    ("key", "search"),
    [("a300", {"hinge_step_deg": 10.0}), ("a3020", {"hinge_angles_deg": (15.0, 60.0, 75.0, 80.0)})],
)
def test_the_answer_is_of_the_set_and_clear_and_costs_more_than_any_angles(key, search):
    design = solved(best(key, **search))
    allowed = {math.radians(angle) for angle in design.task.search.hinge_set_deg or ()}
    assert set(design.hinge_angles_rad) <= allowed
    assert audit(design).verdict == "clear"
    free = solved(best(key))
    assert free.objective < design.objective < 1.03 * free.objective
    assert (design.solver or {})["starts"] == 4


@pytest.mark.parametrize("step", few([30.0, 15.0], 1))
def test_what_is_found_near_the_local_optima_is_what_all_combinations_hold(step, monkeypatch):
    found = solved(best("a3200", hinge_step_deg=step))
    monkeypatch.setattr(hinge_sets, "SEARCH", hinge_sets.SEARCH._replace(complete_up_to=10**6))
    assert solved(best("a3200", hinge_step_deg=step)).objective == pytest.approx(found.objective, rel=1e-6)


def test_a_task_costs_no_more_than_with_a_region_besides():
    """The best of push is three turns from the angles nearest to its local optima of free angles."""
    efforts = []
    for name in ("push", "push-local"):
        task = read_task(name, ("modules=4", "search.hinge_step_deg=10")).resolve(4)
        efforts.append(solved(solve(task, Topology.from_key("a3200"), starts=range(8), seed=0)).objective)
    alone, besides = efforts
    assert alone <= besides * (1 + 1e-6)


def test_a_set_without_a_design_says_what_stops_it():
    result = best("a300", hinge_angles_deg=(0.0,))
    assert isinstance(result, Infeasible)
    assert "hinge angle" in result.worst_constraint or "modules" in result.worst_constraint


def test_without_the_compiled_search_ipopt_solves_the_combinations(monkeypatch):
    compiled = solved(best("a3020", hinge_step_deg=15.0))
    monkeypatch.setattr(hinge_sets, "reason_against", lambda _: "a test")
    alone = solved(best("a3020", hinge_step_deg=15.0))
    assert alone.objective == pytest.approx(compiled.objective, rel=1e-5)
    assert alone.hinge_angles_rad == compiled.hinge_angles_rad


def test_reserves_and_several_cases_hold_on_the_set_too():
    cases = [{**case, "name": f"case {k}"} for k, case in enumerate(PUSH)]
    fields = {"load_cases": cases, "flight": {"force_reserve": 0.05}, "search": {"hinge_step_deg": 10.0}}
    assert audit(best_design(push(4, **fields), Topology.from_key("a3020"), 3)).verdict == "clear"


def test_a_design_of_the_set_is_carried_over():
    task, tree = push(3, search={"hinge_step_deg": 10.0}), Topology.from_key("a300")
    design = best_design(task, tree, 2)
    again = solved(solve(task, tree, starts=range(0), seed=0, near=(design,)))
    assert again.objective == pytest.approx(design.objective, rel=1e-6)
    assert again.hinge_angles_rad == design.hinge_angles_rad


def test_a_tree_and_its_mirror_image_cost_the_same_on_a_set():
    task = push(3, search={"hinge_step_deg": 10.0})
    trees = (Topology.from_key(key) for key in ("a300", "a600"))
    one, other = (solved(solve(task, tree, starts=range(default_starts(task)), seed=0)) for tree in trees)
    assert {c.topology.key: c.orbit for c in candidates(3, symmetry="task", task=one.task)}["a300"] == 2
    assert other.objective == pytest.approx(one.objective, rel=1e-6)


# ---- Proofs over a set of hinge angles: against all combinations, and attacked with sets that hold a better one.

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
    angles = hinge_angles(task)
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

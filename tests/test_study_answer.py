"""What an answer says in words: what is proven, and what was only not found."""

from dataclasses import replace

import pytest
import toy_problem
from older import older_task
from toy_problem import toy_run
from wording import says

from topo_search.engine import Failed
from topo_search.model import Topology
from topo_search.model.stated import Stated
from topo_search.model.task_file import read_task
from topo_search.study import Request, UserInputs
from topo_search.topologies import candidates


def toy_verbs(impossible):
    """The toy problem, with a proof for the trees that `impossible` says so of; each misses next to nothing."""

    def solve(job):
        if not impossible(job.topology):
            return toy_problem.solve(job)
        return toy_problem.infeasible(job.topology, "impossible", violation=1e-9)

    return replace(toy_problem.BACKENDS, solve=solve)


def test_a_tree_that_is_proven_impossible_is_not_the_one_that_came_closest(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    backends = toy_verbs(lambda topology: topology.key == "a500")
    size = toy_run(tmp_path / "run", backends=backends).sizes[0]
    assert size.statuses == {"infeasible": 3, "impossible": 1}
    assert says(size.reason, "no start of 4 candidates", "1 proven impossible", "shortfall", "not a proof")
    assert "a500" not in size.reason
    assert not size.impossible


def test_trees_that_are_all_proven_impossible_are_a_proof_for_their_size(tmp_path):
    (size,) = toy_run(tmp_path / "run", backends=toy_verbs(lambda _: True)).sizes
    assert says(size.reason, "each of 4 candidates", "proven impossible", "candidates.csv")
    assert size.impossible
    (size,) = toy_run(tmp_path / "lossy", backends=toy_verbs(lambda _: True), symmetry="d4").sizes
    assert not size.impossible  # of trees that can differ one was looked at
    proposed = {"strategy": "optuna", "sampler": "random", "trials": 3}
    (size,) = toy_run(tmp_path / "some", backends=toy_verbs(lambda _: True), **proposed).sizes
    assert not size.impossible
    assert any("1 of 4 candidates" in remark and "never proposed" in remark for remark in size.remarks)


def test_what_is_proven_of_some_trees_is_no_proof_of_their_size(tmp_path, monkeypatch):
    """One tree of three that is impossible, in a list or for all that a lossy symmetry merges with it."""
    backends = toy_verbs(lambda topology: topology.key == "a500")
    answer = toy_run(tmp_path / "listed", modules=(3, 4), backends=backends, listed=("a500", "a6040", "a9020"))
    assert answer.sizes[0].statuses == {"impossible": 1}
    assert not answer.sizes[0].impossible
    assert answer.smallest == "the smallest size with a design (not proven that fewer, down to 3, have none)"
    all_of_3 = ("a300", "a500", "a600", "aa00")
    answer = toy_run(tmp_path / "all", backends=toy_verbs(lambda _: True), listed=all_of_3)
    assert answer.sizes[0].impossible  # the list leaves out none
    monkeypatch.setenv("TOY_IMPOSSIBLE", "3")
    answer = toy_run(tmp_path / "size", listed=("a500",))
    assert answer.sizes[0].impossible  # proven without a look at any tree


def space_options(task):
    return {"connectors": task.search.connectors, "root": task.search.root}


@pytest.mark.parametrize("fields", [(), ("search.root=paper",), ("search.connectors=any",)])
def test_listed_trees_cover_a_size_if_none_is_left_out(fields):
    task = read_task("push", ("modules=3", *fields))
    whole = Request(task, "task", starts=1, seed=0)
    assert whole.covers(3)
    space = whole.space(3)
    images = [tree.key for tree in candidates(3, symmetry="none", **space_options(task))]
    for left_out in sorted({space.key_of(Topology.from_key(key)) for key in images}):
        kept = [key for key in images if space.key_of(Topology.from_key(key)) != left_out]
        assert not replace(whole, user_inputs=UserInputs(topologies=tuple(kept))).covers(3)
        assert replace(whole, user_inputs=UserInputs(topologies=(*kept, left_out))).covers(3)


@pytest.mark.parametrize("symmetry", ["none", "c2", "d2", "c4", "d4"])
def test_a_lossy_symmetry_covers_no_size(symmetry):
    tilted = {"end_effector": {"force": [0.3, 0.2, 0.1], "torque": [0.1, 0.2, 0.3]}}
    task = older_task(name="tilted", modules=4, load_cases=[tilted])
    assert Request(task, symmetry, starts=1, seed=0).covers(4) == (symmetry in ("none", "c2"))
    by_number = Stated(name="own", invariant="none", lower=0.0)
    assert not Request(task, "c2", starts=1, seed=0, user_inputs=UserInputs(constraints=(by_number,))).covers(4)


def test_merged_trees_that_were_not_solved_do_not_count_as_feasible(tmp_path):
    exact, lossy = (toy_run(tmp_path / name, symmetry=name).sizes[0] for name in ("c2", "d4"))
    assert exact.feasible == sum(row.orbit for row in exact.top)
    assert lossy.feasible == len(lossy.top) < sum(row.orbit for row in lossy.top)


def test_failed_candidates_are_not_among_those_of_which_a_design_is_the_best(tmp_path):
    def solve(job):
        return Failed("error", "gone") if job.topology.key == "a500" else toy_problem.solve(job)

    (size,) = toy_run(tmp_path / "run", backends=replace(toy_problem.BACKENDS, solve=solve)).sizes
    assert size.statuses == {"feasible": 3, "failed": 1}
    assert size.statement.startswith("the best found of 3 of 4 candidates; ")


@pytest.mark.parametrize(
    ("sizes", "proven", "told"),
    [
        (3, (), ""),
        ((3, 4), (), "the smallest requested size"),
        ((1, 4), (1, 2), "the smallest size with a design (proven that fewer, down to 1, have none)"),
        ((1, 4), (1,), "the smallest size with a design (not proven that fewer, down to 1, have none)"),
    ],
)
def test_whether_fewer_modules_are_excluded_is_told(tmp_path, monkeypatch, sizes, proven, told):
    monkeypatch.setenv("TOY_NONE", "a0,a10,a20")
    answer = toy_run(tmp_path / "run", modules=sizes, backends=toy_verbs(lambda topology: topology.n in proven))
    assert answer.best.modules == 3
    assert answer.smallest == told


def test_the_only_candidate_is_no_plural(tmp_path):
    statement = toy_run(tmp_path / "run", modules=1).sizes[0].statement
    assert statement.startswith("the best found of the only candidate; proven: no 1-module topology is ")

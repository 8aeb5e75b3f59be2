"""What an answer says in words: what is proven, and what was only not found."""

from dataclasses import replace

import pytest
import toy_problem
from toy_problem import toy_run
from wording import says

from topo_search.model import Infeasible


def toy_verbs(impossible):
    """The toy problem, with a proof for the trees that `impossible` says so of; each misses next to nothing."""

    def solve(task, topology, **options):
        if not impossible(topology):
            return toy_problem.solve(task, topology, **options)
        return Infeasible(
            topology=topology,
            topology_key=topology.key,
            status="impossible",
            worst_constraint="clearances of 2 modules in a row",
            violation=1e-9,
            unit="N m",
            message="too close",
        )

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


@pytest.mark.parametrize(
    ("sizes", "proven", "told"),
    [
        (3, (), ""),
        ((3, 4), (), "the smallest size asked for"),
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

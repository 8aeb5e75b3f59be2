"""The reduced search, proofs and their check are compiled before the first job, and that is said once."""

import pytest
from nlp_cases import push

import nlp
from nlp import multistart
from nlp.bounds.branch.search import search
from topo_search.model import Task
from topo_search.model.topology import straight_chain
from verify.proof import check


def told(task: Task) -> list[str]:
    found: list[str] = []
    nlp.prepare(task, found.append)
    return found


def test_it_is_told_once_that_code_is_compiled(monkeypatch):
    monkeypatch.setattr(multistart, "is_cached", lambda function: False)
    (first,) = told(push(3))
    assert "compiling the solver" in first
    monkeypatch.undo()
    assert told(push(3)) == []


def test_nothing_is_compiled_for_a_task_that_the_reduced_search_does_not_express(monkeypatch):
    monkeypatch.setattr(multistart, "compile_reduced", None)
    (reason,) = told(push(21))
    assert "without the reduced search: more than 20 modules" in reason


@pytest.mark.compiles
def test_the_solver_is_compiled_before_its_first_job(monkeypatch):
    task = push(3)
    monkeypatch.setattr(multistart, "is_cached", lambda function: False)
    nlp.prepare(task, print)
    before = multistart.descend.signatures
    nlp.solve(task, straight_chain(3), starts=range(1), seed=0)
    assert len(before) > 0
    assert multistart.descend.signatures == before


@pytest.mark.compiles
@pytest.mark.parametrize(
    ("module", "prepare"),
    [("topo_search.compiled_code", nlp.prepare_proof), ("verify.proof.check", check.prepare_check)],
)
def test_proofs_and_their_check_tell_that_they_are_compiled(module, prepare, monkeypatch):
    found: list[str] = []
    monkeypatch.setattr(f"{module}.is_cached", lambda function: False)
    prepare(push(3), found.append)
    assert ["compiling" in text for text in found] == [True]
    monkeypatch.setattr(f"{module}.is_cached", lambda function: True)
    prepare(push(3), found.append)
    assert len(found) == 1


def test_all_that_a_proof_takes_is_compiled_before():
    """Other types of arguments would be compiled in every worker."""
    task = push(4)
    nlp.prepare_proof(push(3), print)
    check.prepare_check(push(3), print)
    before = search.signatures, check.replay.replay.signatures
    tree = straight_chain(4)
    chunk = nlp.prove_chunk(task, tree, 0, 1e9)
    check.check_chunk(task, tree, nlp.proof_root(task, tree), 1e9, chunk)
    assert (search.signatures, check.replay.replay.signatures) == before

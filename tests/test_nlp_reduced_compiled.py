"""The reduced search, proofs and their check are compiled before the first job, and that is said once."""

import hashlib
from types import SimpleNamespace

import pytest
from nlp_cases import push

import nlp
from nlp import multistart
from nlp.bounds.branch import proof
from topo_search.model import Task
from topo_search.model.topology import straight_chain
from verify.proof import check


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A folder for what is kept, in the place of the installation's."""
    stats = SimpleNamespace(cache_path=str(tmp_path))
    function = SimpleNamespace(__module__="nlp.reduced.search", __qualname__="descend_all", stats=stats)
    monkeypatch.setattr(multistart, "descend_all", function)
    return tmp_path


def told(task: Task) -> list[str]:
    found: list[str] = []
    nlp.prepare(task, found.append)
    return found


def test_it_is_told_once_that_code_is_compiled(kept):
    (kept / "other.function-1.py311.nbc").touch()
    (first,) = told(push(3))
    assert "compiling the solver" in first
    file = kept / "search.descend_all-1.py311.1.nbc"
    file.write_bytes(b"code" + hashlib.sha256(b"code").digest())
    assert told(push(3)) == []
    file.write_bytes(b"c0de" + hashlib.sha256(b"code").digest())
    assert told(push(3)) == [first]
    assert (kept / "other.function-1.py311.nbc").exists()


def test_nothing_is_compiled_for_a_task_that_the_reduced_search_does_not_express(kept):
    (reason,) = told(push(21))
    assert "without the reduced search: more than 20 modules" in reason
    assert list(kept.iterdir()) == []


@pytest.mark.compiles
def test_the_solver_is_compiled_before_its_first_job():
    task = push(3)
    nlp.prepare(task, print)
    before = multistart.descend_all.signatures
    nlp.solve(task, straight_chain(3), starts=range(1), seed=0)
    assert len(before) > 0
    assert multistart.descend_all.signatures == before


@pytest.mark.compiles
@pytest.mark.parametrize(("module", "prepare"), [(proof, nlp.prepare_proof), (check, check.prepare_check)])
def test_proofs_and_their_check_tell_that_they_are_compiled(module, prepare, monkeypatch):
    found: list[str] = []
    monkeypatch.setattr(module, "is_kept", lambda function: False)
    prepare(push(3), found.append)
    assert ["compiling" in text for text in found] == [True]
    monkeypatch.setattr(module, "is_kept", lambda function: True)
    prepare(push(3), found.append)
    assert len(found) == 1


def test_all_that_a_proof_takes_is_compiled_before():
    """Other types of arguments would be compiled in every worker."""
    task = push(4)
    nlp.prepare_proof(push(3), print)
    check.prepare_check(push(3), print)
    before = proof.search.signatures, check.replay.replay.signatures
    tree = straight_chain(4)
    chunk = nlp.prove_chunk(task, tree, 0, 1e9)
    check.check_chunk(task, tree, nlp.proof_root(task, tree), 1e9, chunk)
    assert (proof.search.signatures, check.replay.replay.signatures) == before

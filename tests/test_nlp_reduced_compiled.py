"""The reduced search is compiled before the first solve, and says so once."""

from types import SimpleNamespace

import pytest
from nlp_cases import push

import nlp
from nlp.reduced import compiled
from topo_search.model import Task


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A folder for what is kept, in the place of the installation's."""
    monkeypatch.setattr(compiled, "descend_all", SimpleNamespace(stats=SimpleNamespace(cache_path=str(tmp_path))))
    return tmp_path


def told(task: Task) -> list[str]:
    found: list[str] = []
    nlp.prepare(task, found.append)
    return found


def test_it_is_told_once_that_code_is_compiled(kept):
    (kept / "other.function-1.py311.nbc").touch()
    (first,) = told(push(3))
    assert "compiling the solver" in first
    (kept / "search.descend_all-1.py311.1.nbc").touch()  # as numba would
    assert told(push(3)) == []
    assert (kept / "other.function-1.py311.nbc").exists()


def test_nothing_is_compiled_for_a_task_that_the_reduced_search_does_not_express(kept):
    (reason,) = told(push(21))
    assert "without the reduced search: more than 20 modules" in reason
    assert list(kept.iterdir()) == []

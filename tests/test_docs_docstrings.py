"""Examples in docstrings run and print what they say; each function of the reference has one."""

import doctest
import re
from importlib import import_module
from pathlib import Path

import pytest
import toy_problem
from documented import PAGES

import topo_search
from topo_search import read_task, search
from topo_search.export import formats

MODULES = (
    "topo_search.compose.designs",
    "topo_search.compose.searching",
    "topo_search.export.audits",
    "topo_search.export.formats",
    "topo_search.model.files",
    "topo_search.model.proven",
    "topo_search.model.topology",
    "topo_search.report.charts",
    "topo_search.report.progress",
    "topo_search.study.summary",
    "topo_search.topologies.candidates",
)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the run that examples read: that of the example of `search`."""
    folder = tmp_path_factory.mktemp("examples")
    task = read_task("push", ("modules=2", "load_cases=[{com={force=[0.0,0.0,1.0]}}]"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("topo_search.compose.binding.Workers", toy_problem.InProcess)
        search(task, out=folder / "hover-2", starts=1)
    return folder


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name, run_folder, in_process, monkeypatch):
    monkeypatch.chdir(run_folder)
    monkeypatch.setattr(formats, "_registered", dict(formats._registered))
    result = doctest.testmod(import_module(name))
    assert result.attempted
    assert not result.failed


def test_each_function_of_the_reference_has_an_example():
    names = re.findall(r"^::: topo_search\.([a-z_]+)$", (PAGES / "reference/python.md").read_text(), re.MULTILINE)
    assert len(names) > 10
    assert [name for name in names if ">>>" not in (getattr(topo_search, name).__doc__ or "")] == []

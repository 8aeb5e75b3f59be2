"""Examples in docstrings run and print what they say."""

import doctest
from importlib import import_module

import pytest

MODULES = (
    "topo_search.model.files",
    "topo_search.model.proven",
    "topo_search.model.topology",
    "topo_search.topologies.candidates",
)


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name):
    result = doctest.testmod(import_module(name))
    assert result.attempted
    assert not result.failed

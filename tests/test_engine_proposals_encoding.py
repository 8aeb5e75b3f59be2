"""The encoding of trees: every row of numbers is a tree, every candidate has a row."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from topo_search.engine.proposals.trials import decode, encode, ranges
from topo_search.topologies import Connectors, Root, candidate_of, candidates, sample


@pytest.mark.parametrize(("n", "connectors"), [(1, "any"), (2, "any"), (3, "any"), (4, "aligned")])
@pytest.mark.parametrize("root", ["free", "paper"])
def test_the_rows_are_all_candidates_and_nothing_else(n: int, connectors: Connectors, root: Root) -> None:
    names = ranges(n, connectors)
    rows = [dict(zip(names, values, strict=True)) for values in product(*map(range, names.values()))]
    keys = {candidate_of(decode(row, n), connectors=connectors, root=root).key for row in rows}
    assert keys == {candidate.key for candidate in candidates(n, connectors=connectors, root=root)}


@given(st.integers(1, 40), st.integers(0, 10**6), st.sampled_from(["aligned", "any"]))
def test_a_tree_is_read_back_from_its_row(n: int, seed: int, connectors: Connectors) -> None:
    (tree,) = sample(n, 1, seed, symmetry="none", connectors=connectors)
    row = encode(tree, connectors)
    assert row.keys() == ranges(n, connectors).keys()
    assert all(0 <= row[name] < values for name, values in ranges(n, connectors).items())
    assert decode(row, n).key == tree.key

"""Samples are uniform over the candidates, for every quotient, family and root."""

from collections import Counter
from math import sqrt

import networkx as nx
import pytest

from topo_search.model.files import read_task
from topo_search.topologies import Connectors, Root, Symmetry, candidate_of, candidates, count, sample

DRAWS_EACH = 25


def chi_square(drawn: Counter[str], classes: int) -> float:
    """Pearson's statistic of a uniform distribution, in standard deviations above its mean."""
    expected = drawn.total() / classes
    statistic = sum((times - expected) ** 2 for times in drawn.values()) / expected
    statistic += (classes - len(drawn)) * expected
    freedom = classes - 1
    return (statistic - freedom) / sqrt(2 * freedom)


NAMED: tuple[Symmetry, ...] = ("none", "c2", "d2", "c4", "d4")
SPACES: list[tuple[int, Symmetry, Connectors, Root]] = [
    *((n, symmetry, "aligned", "free") for n in range(1, 6) for symmetry in NAMED),
    *((n, symmetry, "aligned", "paper") for n in (2, 3, 4) for symmetry in NAMED),
    *((n, symmetry, "any", "free") for n in (2, 3, 4) for symmetry in ("none", "c2", "task")),
    *((n, symmetry, "any", "paper") for n in (2, 3) for symmetry in ("none", "c2", "task")),
    *((6, "d4", "aligned", "free"), (5, "task", "any", "free")),
]


@pytest.mark.parametrize(("n", "symmetry", "connectors", "root"), SPACES)
def test_samples_are_uniform(n: int, symmetry: Symmetry, connectors: Connectors, root: Root) -> None:
    task = read_task("push").resolve(n) if symmetry == "task" else None
    keys = [c.key for c in candidates(n, symmetry=symmetry, connectors=connectors, root=root, task=task)]
    trees = sample(n, DRAWS_EACH * len(keys), n, symmetry=symmetry, connectors=connectors, root=root, task=task)
    drawn = Counter(tree.key for tree in trees)
    assert drawn.keys() <= set(keys)
    if len(keys) > 1:
        assert abs(chi_square(drawn, len(keys))) < 4


def test_the_test_of_uniformity_can_fail() -> None:
    # fixed trees, each put into its class: large classes come too often
    trees = sample(5, DRAWS_EACH * 49, 5, symmetry="none")
    drawn = Counter(candidate_of(tree).key for tree in trees)
    assert chi_square(drawn, count(5)) > 4


@pytest.mark.parametrize("connectors", ["aligned", "any"])
@pytest.mark.parametrize("symmetry", ["none", "c2", "d2", "d4"])
def test_trees_of_a_hundred_modules(connectors: Connectors, symmetry: Symmetry) -> None:
    trees = sample(100, 5, 3, symmetry=symmetry, connectors=connectors)
    assert len({tree.key for tree in trees}) == 5
    for tree in trees:
        assert tree.n == 100
        assert nx.is_tree(tree.graph())
        assert candidate_of(tree, symmetry=symmetry, connectors=connectors).key == tree.key
        if connectors == "any":
            assert 25 < sum(kappa % 2 for kappa in tree.kappas) < 75


def test_one_seed_one_sample() -> None:
    assert sample(40, 3, 11) == sample(40, 3, 11)
    assert sample(40, 3, 11) != sample(40, 3, 12)
    assert sample(40, 5, 11)[:3] == sample(40, 3, 11)

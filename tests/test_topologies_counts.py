"""Enumeration, closed forms and published numbers agree."""

from collections import Counter
from itertools import islice
from math import comb, factorial, sqrt
from typing import get_args

import networkx as nx
import pytest

from topo_search.model import Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import Connectors, Root, Symmetry, candidate_of, candidates, count, sample

NAMED: tuple[Symmetry, ...] = ("none", "c2", "d2", "c4", "d4")


@pytest.mark.parametrize("n", range(1, 41))
def test_burnside_sums_have_their_closed_forms(n: int) -> None:
    fixed = 2 * factorial(3 * n) // (factorial(2 * n + 1) * factorial(n + 1))
    m, odd = divmod(n, 2)
    half_turn = 2 * comb(3 * m + 2, m) // (3 * m + 2) if odd else 2 * comb(3 * m, m) // (2 * m + 1)
    k, rest = divmod(n, 4)
    quarter = comb(3 * k, k) // (2 * k + 1) if rest == 1 else 0
    a047749 = comb(3 * m + 1, m + 1) // (2 * m + 1) if odd else comb(3 * m, m) // (2 * m + 1)
    c4 = (fixed + half_turn + 2 * quarter) // 4
    assert count(n, symmetry="none") == fixed
    assert count(n, symmetry="c2") == (fixed + half_turn) // 2
    assert count(n, symmetry="d2") == (fixed + 3 * half_turn) // 4
    assert count(n, symmetry="c4") == c4
    assert count(n, symmetry="d4") == (c4 + a047749) // 2
    assert count(n, connectors="any") == (2**n * fixed + 2 ** (n - n // 2) * half_turn) // 4
    assert count(n, connectors="any", symmetry="none") == 2 ** (n - 1) * fixed
    assert count(n, root="paper", symmetry="none") == n * fixed == 4 * comb(3 * n + 1, n - 1) // (3 * n + 1)


SPACES: list[tuple[int, Symmetry, Connectors, Root]] = [
    *((n, symmetry, "aligned", "free") for n in range(1, 9) for symmetry in NAMED),
    *((n, symmetry, "aligned", "paper") for n in range(1, 7) for symmetry in NAMED),
    *((n, symmetry, "any", root) for n in range(1, 6) for symmetry in NAMED[:2] for root in get_args(Root)),
    (6, "c2", "any", "free"),
]
LARGE: list[tuple[int, Symmetry, Connectors, Root]] = [
    *((9, symmetry, "aligned", "free") for symmetry in NAMED),
    *((n, "c2", "any", "free") for n in (7, 8)),
    (11, "none", "aligned", "free"),
]


@pytest.mark.parametrize(
    ("n", "symmetry", "connectors", "root"),
    [*SPACES, *(pytest.param(*space, marks=pytest.mark.slow) for space in LARGE)],
)
def test_enumeration_agrees_with_the_closed_forms(
    n: int, symmetry: Symmetry, connectors: Connectors, root: Root
) -> None:
    """Every listed key is a tree of n modules, ascending, its own representative; numbers and orbits add up."""
    keys = orbits = 0
    before = ""
    for candidate in candidates(n, symmetry=symmetry, connectors=connectors, root=root):
        assert before < candidate.key
        before = candidate.key
        keys += 1
        orbits += candidate.orbit
        if keys % 37 == 1:
            topology = candidate.topology
            assert topology.n == n
            assert topology.key == candidate.key
            assert candidate_of(topology, symmetry=symmetry, connectors=connectors, root=root) == candidate
    assert keys == count(n, symmetry=symmetry, connectors=connectors, root=root)
    exact: Symmetry = "none" if symmetry == "none" or root == "paper" else "c2"
    assert orbits == count(n, symmetry=exact, connectors=connectors, root=root)


@pytest.mark.parametrize("connectors", get_args(Connectors))
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_a_quotient_is_a_part_of_what_it_divides(n: int, connectors: Connectors) -> None:
    none, c2, d2, c4, d4 = (
        {candidate.key for candidate in candidates(n, symmetry=symmetry, connectors=connectors)}
        for symmetry in NAMED
    )
    assert d4 <= c4 <= c2 <= none
    assert d4 <= d2 <= c2


def test_large_sizes_begin_at_once_and_keep_the_keys_short() -> None:
    for n in (100, 101):
        first = [candidate.key for candidate in islice(candidates(n, connectors="any"), 20)]
        assert first == sorted(set(first))
        assert all(len(key) == n + 1 < 200 for key in first)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"n": 0}, "`n >= 1` must hold, but got n = 0"),
        ({"symmetry": "d3"}, "symmetry must be one of task, none, c2, d2, c4, d4, but got 'd3'"),
        ({"connectors": "some"}, "connectors must be one of aligned, any, but got 'some'"),
        ({"root": "tree"}, "root must be one of free, paper, but got 'tree'"),
        ({"symmetry": "task"}, 'symmetry "task" requires a task, but none was given'),
    ],
)
def test_wrong_arguments_are_refused_before_the_first_tree(wrong: dict[str, object], words: str) -> None:
    arguments = {"n": 3, **wrong}
    for function in (candidates, count, lambda n, **more: sample(n, 1, 0, **more)):
        with pytest.raises(ValueError, match=words):
            function(**arguments)  # type: ignore[arg-type]


def test_an_aligned_family_refuses_an_odd_kappa() -> None:
    with pytest.raises(ValueError, match="even kappas"):
        candidate_of(Topology.from_key("p18"))


# ---- Samples are uniform over the candidates, for every quotient, family and root.

DRAWS_EACH = 25


def chi_square(drawn: Counter[str], classes: int) -> float:
    """Pearson's statistic of a uniform distribution, in standard deviations above its mean."""
    expected = drawn.total() / classes
    statistic = sum((times - expected) ** 2 for times in drawn.values()) / expected
    statistic += (classes - len(drawn)) * expected
    freedom = classes - 1
    return (statistic - freedom) / sqrt(2 * freedom)


SAMPLED: list[tuple[int, Symmetry, Connectors, Root]] = [
    *((n, symmetry, "aligned", "free") for n in range(1, 6) for symmetry in NAMED),
    *((n, symmetry, "aligned", "paper") for n in (2, 3, 4) for symmetry in NAMED),
    *((n, symmetry, "any", "free") for n in (2, 3, 4) for symmetry in ("none", "c2", "task")),
    *((n, symmetry, "any", "paper") for n in (2, 3) for symmetry in ("none", "c2", "task")),
    *((6, "d4", "aligned", "free"), (5, "task", "any", "free")),
]


@pytest.mark.parametrize(("n", "symmetry", "connectors", "root"), SAMPLED)
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

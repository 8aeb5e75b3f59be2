"""Trees of several types of module against trees grown module by module, of every type, in every position."""

from collections import Counter
from itertools import permutations
from math import factorial, prod
from typing import Any

import networkx as nx
import numpy as np
import pytest
from commands import invoke
from nlp_cases import random_tree
from scipy.stats import chisquare
from test_topologies_brute_force import TURNS, Grid, grid_of

from topo_search.model import BadInput, ResolvedTask, Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import (
    Connectors,
    Root,
    Symmetry,
    candidate_of,
    candidates,
    count,
    exact_group,
    resolve_symmetry,
    sample,
)
from topo_search.topologies.own_topologies import own_candidates


def grown(counts: tuple[int, ...], turns: list[tuple[int, bool]], spins: tuple[int, ...]) -> set[tuple[Any, ...]]:
    """All classes of platforms, each grown by a leaf of each type in each free direction; none has too many."""
    flip, kinds = len(spins) > 1, [(k,) for k in range(len(counts))]
    found = [Grid(({},), (0,), kind) for kind in kinds]
    for _ in range(1, sum(counts)):
        leaves = (leaf for tree in found for leaf in tree.leaves_added(spins, kinds))
        allowed = (leaf for leaf in leaves if all(leaf.types.count(k) <= count for k, count in enumerate(counts)))
        found = [*{leaf.canonical(turns, flip): leaf for leaf in allowed}.values()]
    return {tree.canonical(turns, flip) for tree in found}


COUNTS = [(1, 1), (2, 1), (1, 1, 1), (3, 1), (2, 2), (2, 1, 1)]
FIVE = [(4, 1), (3, 2), (2, 2, 1)]


@pytest.mark.parametrize("symmetry", TURNS)
@pytest.mark.parametrize("counts", [*COUNTS, *FIVE])
def test_aligned_candidates_are_the_classes_of_grown_platforms(counts: tuple[int, ...], symmetry: Symmetry) -> None:
    listed = list(candidates(sum(counts), counts=counts, symmetry=symmetry))
    found = [grid_of(candidate.topology).canonical(TURNS[symmetry], False) for candidate in listed]
    assert len(set(found)) == len(found) == count(sum(counts), counts=counts, symmetry=symmetry)
    assert set(found) == grown(counts, TURNS[symmetry], (0,))


@pytest.mark.parametrize(
    "counts", [*COUNTS, *(pytest.param(counts, marks=pytest.mark.slow) for counts in (*FIVE, (3, 1, 1)))]
)
def test_any_port_candidates_are_the_classes_of_grown_platforms(counts: tuple[int, ...]) -> None:
    listed = list(candidates(sum(counts), counts=counts, connectors="any"))
    found = [grid_of(candidate.topology).canonical(TURNS["c4"], True) for candidate in listed]
    assert len(set(found)) == len(found) == count(sum(counts), counts=counts, connectors="any")
    assert set(found) == grown(counts, TURNS["c4"], (0, 1))


SPACES: list[tuple[Connectors, Root, Symmetry]] = [
    *(("aligned", root, symmetry) for root in ("free", "paper") for symmetry in TURNS),
    *(("any", root, symmetry) for root in ("free", "paper") for symmetry in ("none", "c2")),
]


@pytest.mark.parametrize(("connectors", "root", "symmetry"), SPACES)
@pytest.mark.parametrize("counts", [(1, 1), (2, 1, 1), (3, 2)])
def test_listed_keys_ascend_build_their_trees_and_add_up(
    counts: tuple[int, ...], connectors: Connectors, root: Root, symmetry: Symmetry
) -> None:
    n = sum(counts)
    options: dict[str, Any] = {"counts": counts, "connectors": connectors, "root": root}
    listed = list(candidates(n, symmetry=symmetry, **options))
    keys = [candidate.key for candidate in listed]
    assert keys == sorted(set(keys))
    assert len(keys) == count(n, symmetry=symmetry, **options)
    for candidate in listed[::7]:
        assert candidate.topology.key == candidate.key
        assert Counter(candidate.topology.types) == dict(enumerate(counts))
        assert candidate_of(candidate.topology, symmetry=symmetry, **options) == candidate
    exact = "none" if symmetry == "none" or root == "paper" else "c2"
    assert sum(candidate.orbit for candidate in listed) == count(n, symmetry=exact, **options)
    if symmetry == "none":
        colourings = factorial(n) // prod(map(factorial, counts))
        assert len(keys) == colourings * count(n, symmetry="none", connectors=connectors, root=root)


@pytest.mark.parametrize(("connectors", "root", "symmetry"), SPACES)
def test_all_of_one_type_are_the_trees_without_types(
    connectors: Connectors, root: Root, symmetry: Symmetry
) -> None:
    options: dict[str, Any] = {"connectors": connectors, "root": root, "symmetry": symmetry}
    for n in (1, 4, 5):
        plain = [(f"{candidate.key}-{'a' * n}", candidate.orbit) for candidate in candidates(n, **options)]
        assert [(each.key, each.orbit) for each in candidates(n, counts=(n,), **options)] == plain
    assert count(60, counts=(60,), **options) == count(60, **options)


@pytest.mark.parametrize("connectors", ["aligned", "any"])
def test_every_tree_finds_the_candidate_of_its_class(connectors: Connectors) -> None:
    aligned = connectors == "aligned"
    rng = np.random.default_rng(7)
    for _ in range(100):
        plain = random_tree(int(rng.integers(3, 13)), rng, aligned=aligned)
        types = (0, 1, 2, *rng.integers(3, size=plain.n - 3).tolist())
        topology = Topology(plain.joints, types=tuple(rng.permutation(types).tolist()))
        for symmetry in TURNS if aligned else ("c2",):
            candidate = candidate_of(topology, symmetry=symmetry, connectors=connectors)
            turns = TURNS[symmetry if aligned else "c4"]
            found = grid_of(candidate.topology).canonical(turns, not aligned)
            assert found == grid_of(topology).canonical(turns, not aligned)
            assert candidate_of(candidate.topology, symmetry=symmetry, connectors=connectors) == candidate


@pytest.mark.parametrize(
    ("counts", "connectors", "root", "symmetry"),
    [
        ((3, 1), "aligned", "free", "d4"),
        ((2, 2), "aligned", "free", "d2"),
        ((2, 2), "aligned", "paper", "d2"),
        ((3, 2), "aligned", "free", "d4"),
        ((2, 1, 1), "aligned", "free", "c2"),
        ((2, 2), "any", "free", "c2"),
        ((2, 1), "any", "free", "none"),
    ],
)
def test_draws_are_uniform(counts: tuple[int, ...], connectors: Connectors, root: Root, symmetry: Symmetry) -> None:
    options: dict[str, Any] = {"counts": counts, "connectors": connectors, "root": root, "symmetry": symmetry}
    n = sum(counts)
    keys = [candidate.key for candidate in candidates(n, **options)]
    drawn = Counter(topology.key for topology in sample(n, 30 * len(keys), 5, **options))
    assert drawn.keys() <= set(keys)
    assert 1e-3 < chisquare([drawn[key] for key in keys]).pvalue < 1 - 1e-3


def test_large_numbers_are_counted_and_drawn() -> None:
    """About 1/2 of the trees with one other module, each of which has 200 places for it."""
    fixed = count(200, symmetry="none")
    assert count(200, counts=(199, 1), symmetry="none") == 200 * fixed
    assert count(200, counts=(199, 1)) == 100 * fixed  # no tree of an even number has a module in its middle
    assert count(201, counts=(200, 1), symmetry="c2") > 201 * count(201, symmetry="none") // 2
    (topology,) = sample(200, 1, 0, counts=(150, 40, 10), symmetry="d4")
    assert Counter(topology.types) == {0: 150, 1: 40, 2: 10}


# ---- Tasks with types of module.


def typed_task(*types: str, connectors: str = "aligned") -> ResolvedTask:
    """The push task with three modules as they are, and one of each of other types."""
    tables = ["{name='X',count=3}", *(f"{{name='other {k}',count=1,{fields}}}" for k, fields in enumerate(types))]
    n = 3 + len(types)
    changes = (f"modules={n}", f"module_types=[{','.join(tables)}]", f"search.connectors={connectors}")
    return read_task("push", changes).resolve(n)


def test_a_task_gives_the_candidates_that_its_types_allow() -> None:
    battery = typed_task("rotors=[]")
    assert exact_group(battery) == "d2"
    assert count(4, task=battery, symmetry="task") == count(4, counts=(3, 1), symmetry="d2") == 26
    assert count(4, task=battery) == len({candidate.key for candidate in candidates(4, task=battery)}) == 44
    assert "mirror images are merged too" in resolve_symmetry(battery).reason


@pytest.mark.parametrize(
    ("spins", "group", "words"),
    [
        ((1, -1), "c1", "half a turn changes a type of module"),
        ((1, 1), "c2", "a type of module has no mirror symmetry"),
    ],
)
def test_a_symmetry_holds_only_if_all_types_have_it(spins: tuple[int, int], group: str, words: str) -> None:
    rotors = [f"{{position=[{x},0.0,0.0],spin={spin}}}" for x, spin in zip((-0.07, 0.07), spins, strict=True)]
    task = typed_task("rotors=[]", f"rotors=[{','.join(rotors)}]")
    assert exact_group(task) == group
    assert words in resolve_symmetry(task).reason
    named: Symmetry = "none" if group == "c1" else "c2"
    assert count(5, task=task, symmetry="task") == count(5, counts=(3, 1, 1), symmetry=named)


def test_topologies_lists_and_counts_types() -> None:
    keys = invoke("topologies", "3", "--types", "2,1").stdout.split()
    assert keys == [candidate.key for candidate in candidates(3, counts=(2, 1))]
    assert int(invoke("topologies", "6", "--types", "5,1", "--count").stdout) == count(6, counts=(5, 1)) == 1224
    many = invoke("topologies", "4", "--types", "2,1,1", "--connectors", "any", "--count")
    assert int(many.stdout) == count(4, counts=(2, 1, 1), connectors="any")
    drawn = invoke("topologies", "9", "--types", "6,3", "--sample", "4", "--seed", "7").stdout.split()
    assert drawn == [topology.key for topology in sample(9, 4, 7, counts=(6, 3))]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["3", "--types", "2,2"], "--types: must add up to N = 3, but got 2 + 2 = 4"),
        (["3", "--types", "3,0"], "must be 1 to 26 numbers of modules, each at least 1, separated by commas"),
        (["3", "--types", "2,1", "--lattice", "flat"], "of one type and with aligned connectors"),
    ],
)
def test_topologies_refuses_counts_that_do_not_fit(words: list[str], message: str) -> None:
    assert message in invoke("topologies", *words, status=2).output


# ---- A user's own trees.


def test_a_graph_has_types_by_number_or_by_name() -> None:
    task = typed_task("rotors=[]")
    tree = Topology.from_key("a7000-aaba")
    graph = tree.graph()
    assert Topology.from_graph(graph) == tree
    nx.set_node_attributes(graph, {i: ("X", "other 0")[kind] for i, kind in enumerate(tree.types)}, "type")
    assert own_candidates([nx.freeze(graph), "ab000-baaa"], task) == (tree.key, "ab000-baaa")
    assert own_candidates([graph], read_task("push", ("modules=4",))) == (
        "a7000",
    )  # without types, data of the user


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("a7000", "must be of 3 X (a), 1 other 0 (b), but got a7000"),
        ("a7000-aabb", "must be of 3 X (a), 1 other 0 (b), but got a7000-aabb"),
        ("a7000-aaac", "must be of 3 X (a), 1 other 0 (b), but got a7000-aaac"),
        ("a7000-aab", "types must name 4, one for each module, but got 3"),
        ("a300-aab", "must have 4 modules, as the task asks, but a300-aab has 3"),
        (Topology.from_key("a7000").graph(), 'the node 0 must have a `type`, one of "X", "other 0" or its number'),
    ],
)
def test_trees_of_other_types_are_refused(given: Any, message: str) -> None:
    with pytest.raises(BadInput) as refused:
        own_candidates([given], typed_task("rotors=[]"))
    assert message in str(refused.value)


def test_a_task_without_types_refuses_trees_with_types() -> None:
    with pytest.raises(BadInput, match="must be of one type of module, but got a300-aab"):
        own_candidates(["a300-aab"], read_task("push", ("modules=3",)))
    with pytest.raises(ValueError, match="must be of 2 a, 1 b, but got a300-abb"):
        candidate_of(Topology.from_key("a300-abb"), counts=(2, 1))


def test_the_order_of_children_does_not_change_a_typed_key() -> None:
    """Modules in another order, with their types, have the same key."""
    joints, types = ((-1, -1, -1), (0, 0, 2), (0, 1, 3), (0, 2, 0)), (0, 0, 1, 2)
    for order in permutations((1, 2, 3)):
        moved = Topology((joints[0], *(joints[i] for i in order)), types=(0, *(types[i] for i in order)))
        assert moved.key == "a7000-aabc"

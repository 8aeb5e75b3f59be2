"""A topology's key is one text for one rooted tree, whatever the order of its modules and their half turns."""

import random

import networkx as nx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nlp_cases import ROOT, trees

from topo_search.model import Topology

TREES = st.one_of(trees(), trees(aligned=True))


def rooted_at(topology: Topology, root: int) -> Topology:
    """The same tree, listed breadth first from another module, by way of its graph."""
    graph = topology.graph()
    number, joints = {root: 0}, [ROOT]
    for parent, child in nx.bfs_edges(graph, root):
        ports = graph.edges[parent, child]["ports"]
        number[child] = len(joints)
        joints.append((number[parent], ports[parent], ports[child]))
    return Topology(tuple(joints))


@given(TREES)
def test_a_key_decodes_to_the_tree_it_was_made_of(topology: Topology) -> None:
    again = Topology.from_key(topology.key)
    assert again.key == topology.key
    assert again.n == topology.n
    assert again.aligned == topology.aligned
    assert again.key[0] == ("a" if topology.aligned else "p")
    assert len(again.key) == topology.n + 1
    assert again.key == again.key.lower()
    assert nx.is_isomorphic(again.graph(), topology.graph())


@given(TREES, st.randoms(use_true_random=False))
def test_the_order_of_the_modules_does_not_change_the_key(topology: Topology, rng: random.Random) -> None:
    order = [0]
    while len(order) < topology.n:  # any order with parents first
        order.append(rng.choice([i for h, i, _, _ in topology.edges() if h in order and i not in order]))
    place = {module: new for new, module in enumerate(order)}
    joints = [ROOT]
    joints += [(place[h], a, b) for h, a, b in (topology.joints[module] for module in order[1:])]
    assert Topology(tuple(joints)).key == topology.key


@given(TREES, st.data())
def test_a_half_turn_of_one_module_keeps_the_key_and_a_quarter_turn_does_not(
    topology: Topology, data: st.DataObject
) -> None:
    if topology.n == 1:
        return
    turned = data.draw(st.integers(1, topology.n - 1))
    for turns, is_kept in ((1, False), (2, True)):
        joints = [
            (h, (a + turns) % 4 if h == turned else a, (b + turns) % 4 if i == turned else b)
            for i, (h, a, b) in enumerate(topology.joints)
        ]
        other = Topology((ROOT, *joints[1:]))
        assert other != topology
        assert (other.key == topology.key) is is_kept


@given(TREES, st.data())
def test_moving_the_root_away_and_back_keeps_the_key(topology: Topology, data: st.DataObject) -> None:
    module = data.draw(st.integers(0, topology.n - 1))
    away = rooted_at(topology, module)
    distances = nx.single_source_shortest_path_length(topology.graph(), module)
    assert sorted(nx.single_source_shortest_path_length(away.graph(), 0).values()) == sorted(distances.values())
    home = [rooted_at(away, i).key for i in range(topology.n)]
    assert topology.key in home
    assert sorted(home) == sorted(rooted_at(topology, i).key for i in range(topology.n))


@given(trees())
def test_ways_and_distances_are_those_of_the_graph(topology: Topology) -> None:
    ways = dict(nx.all_pairs_shortest_path(topology.graph()))
    for i in range(topology.n):
        assert [topology.path(i, j) for j in range(topology.n)] == [ways[i][j] for j in range(topology.n)]
        assert topology.distances[i].tolist() == [len(ways[i][j]) - 1 for j in range(topology.n)]


def test_a_hand_made_key() -> None:
    # a chain along +x with a module at the +y port of its middle: right of west is north in the slots of module 1
    assert Topology((ROOT, (0, 0, 2), (1, 0, 2), (1, 1, 3))).key == "a1600"
    assert Topology((ROOT, (0, 0, 1))).key == "p18"
    assert Topology.from_key("p18").joints == (ROOT, (0, 0, 1))
    assert Topology((ROOT,)).key == "a0"


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("", "starts with `a`, `p` or `f`"),
        ("a", "ends before 1 of its modules"),
        ("a00", "describes 1 modules but has 2 digits"),
        ("a18", "must be under 8"),
        ("a1x", "hexadecimal"),
        ("p10", "not canonical"),
        ("a\u0661\u0660", "not canonical"),
    ],
)
def test_a_wrong_key_is_refused_with_the_reason(key: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Topology.from_key(key)

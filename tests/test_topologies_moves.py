"""Tree moves: nothing is lost, a move can be taken back, and moves lead everywhere."""

from itertools import product
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from topo_search.engine import Candidates
from topo_search.engine.proposals.moves import draw_move, graft, part_of
from topo_search.engine.proposals.trials import decode, encode, ranges
from topo_search.model import Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import Connectors, Root, Symmetry, candidate_of, candidates, sample
from topo_search.topologies.family import with_spins_reversed


def spins(topology: Topology) -> list[int]:
    """Whether each module's rotors turn as the root's do (0) or not (1)."""
    found = [0]
    for parent, kappa in zip(topology.parents[1:], topology.kappas[1:], strict=True):
        found.append((found[parent] + kappa) % 2)
    return found


@st.composite
def trees(draw: st.DrawFn, connectors: Connectors) -> Topology:
    n, seed = draw(st.integers(2, 12)), draw(st.integers(0, 10**6))
    (topology,) = sample(n, 1, seed, symmetry="none", connectors=connectors)
    return topology


@given(trees("aligned"), st.randoms(use_true_random=False))
def test_a_move_of_an_aligned_tree_is_an_aligned_tree_of_the_same_size(tree: Topology, random: Random) -> None:
    other = graft(tree, *draw_move(tree, random, "aligned"))
    assert other.aligned
    assert other.n == tree.n


@given(trees("any"), st.data())
def test_a_graft_can_be_taken_back(tree: Topology, data: st.DataObject) -> None:
    i = data.draw(st.integers(1, tree.n - 1))
    part = part_of(tree, i)
    own = tree.joints[i][:2]
    ports = [port for port in (*tree.free_connectors, own) if port[0] not in part]
    at, turns = data.draw(st.sampled_from(ports)), data.draw(st.integers(0, 3))
    moved = graft(tree, i, at, turns)

    order = [h for h in range(tree.n) if h not in part] + sorted(part)
    place = {old: new for new, old in enumerate(order)}
    assert part_of(moved, place[i]) == {place[j] for j in part}
    flipped = [
        (a - b) % 2 for a, b in zip((spins(moved)[place[j]] for j in range(tree.n)), spins(tree), strict=True)
    ]
    changed = (moved.kappas[place[i]] - tree.kappas[i]) % 4
    assert changed == turns
    above = (spins(moved)[place[at[0]]] - spins(tree)[own[0]]) % 2
    assert flipped == [(turns + above) % 2 if j in part else 0 for j in range(tree.n)]
    assert graft(moved, place[i], (place[own[0]], own[1]), -turns).key == tree.key


@pytest.mark.parametrize("root", ["free", "paper"])
@pytest.mark.parametrize(("n", "connectors"), [(4, "aligned"), (5, "aligned"), (4, "any")])
def test_moves_lead_from_any_candidate_to_all(n: int, connectors: Connectors, root: Root) -> None:
    listed = {candidate.key for candidate in candidates(n, connectors=connectors, root=root)}
    random = Random(n)
    reached, waiting = set(), [min(listed)]
    while waiting:
        tree = Topology.from_key(waiting.pop())
        reached.add(tree.key)
        keys = {
            candidate_of(graft(tree, *draw_move(tree, random, connectors)), connectors=connectors, root=root).key
            for _ in range(60)
        }
        assert keys <= listed
        waiting.extend(keys - reached - set(waiting))
    assert reached == listed


@given(trees("any"))
def test_spins_reversed_twice_are_a_half_turn(tree: Topology) -> None:
    other = with_spins_reversed(tree)
    assert spins(other) == spins(tree)  # relative to the root's
    assert candidate_of(with_spins_reversed(other), connectors="any") == candidate_of(tree, connectors="any")


@given(trees("aligned"))
def test_reversed_spins_are_a_quarter_turn_of_an_aligned_tree(tree: Topology) -> None:
    other = with_spins_reversed(tree)
    assert other.kappas == tree.kappas
    assert candidate_of(other, symmetry="c4") == candidate_of(tree, symmetry="c4")


@pytest.mark.parametrize("connectors", ["aligned", "any"])
@pytest.mark.parametrize("symmetry", ["task", "none", "c2", "d2", "c4"])
def test_the_twin_of_a_twin_is_the_candidate_itself(symmetry: Symmetry, connectors: Connectors) -> None:
    task = read_task("push", ("modules=4", f"search.connectors={connectors}")).resolve(4)
    space = Candidates(task, symmetry)
    twins = {candidate: space.twin_of(candidate.topology) for candidate in space.candidates()}
    assert all(twins[twin] == candidate for candidate, twin in twins.items())
    if symmetry == "none":
        assert all(twin == candidate for candidate, twin in twins.items())


# ---- The encoding of trees: every row of numbers is a tree, every candidate has a row.


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

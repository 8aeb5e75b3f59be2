"""The listed keys against trees grown module by module and compared from every root, turned and mirrored."""

from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from nlp_cases import random_tree

from topo_search.model import Topology
from topo_search.topologies import Connectors, Symmetry, candidate_of, candidates

TURNS = {
    "none": [(0, False)],
    "c2": [(0, False), (2, False)],
    "d2": [(q, mirror) for q in (0, 2) for mirror in (False, True)],
    "c4": [(q, False) for q in range(4)],
    "d4": [(q, mirror) for q in range(4) for mirror in (False, True)],
}
"""Quarter turns after an optional mirror in the x axis."""


class Grid(NamedTuple):
    """A tree on the grid: which module lies in which of four directions of which; spin and type of each."""

    neighbours: tuple[dict[int, int], ...]
    spins: tuple[int, ...]
    types: tuple[int, ...] = ()

    def leaves_added(self, spins: tuple[int, ...], types: Iterable[tuple[int, ...]] = ((),)) -> Iterator["Grid"]:
        n = len(self.spins)
        for module in range(n):
            for direction in {0, 1, 2, 3} - self.neighbours[module].keys():
                for spin, own in product(spins, types):
                    grown = [dict(around) for around in self.neighbours] + [{(direction + 2) % 4: module}]
                    grown[module][direction] = n
                    yield Grid(tuple(grown), (*self.spins, spin), (*self.types, *own))

    def seen_from(self, module: int, came: int | None, quarters: int, mirror: bool, flip: bool) -> tuple[Any, ...]:
        around: list[Any] = [()] * 4
        for direction, other in self.neighbours[module].items():
            if other != came:
                image = ((-direction if mirror else direction) + quarters) % 4
                around[image] = self.seen_from(other, module, quarters, mirror, flip)
        spin = self.spins[module] ^ (quarters % 2 if flip else 0)
        return (*self.types[module : module + 1], spin, *around)

    def canonical(self, turns: list[tuple[int, bool]], flip: bool) -> tuple[Any, ...]:
        """The same value for every root and every turn; with `flip` a quarter turn reverses the spins."""
        roots = range(len(self.spins))
        return min(self.seen_from(root, None, q, mirror, flip) for root in roots for q, mirror in turns)


def grid_of(topology: Topology) -> Grid:
    """Place a topology on the grid, its root in standard position and spin 0, all hinges flat."""
    neighbours: list[dict[int, int]] = [{} for _ in range(topology.n)]
    frames = [0] * topology.n
    for (h, i, a, _), kappa in zip(topology.edges(), topology.kappas[1:], strict=True):
        direction = (frames[h] + a) % 4
        frames[i] = frames[h] + kappa
        neighbours[h][direction] = i
        neighbours[i][(direction + 2) % 4] = h
    return Grid(tuple(neighbours), tuple(frame % 2 for frame in frames), topology.types)


def grown(n: int, turns: list[tuple[int, bool]], spins: tuple[int, ...], flip: bool) -> set[tuple[Any, ...]]:
    """All classes of trees of n modules, each grown from all classes of one module less."""
    trees = {None: Grid(({},), (0,))}
    for _ in range(n - 1):
        leaves = (leaf for tree in trees.values() for leaf in tree.leaves_added(spins))
        trees = {leaf.canonical(turns, flip): leaf for leaf in leaves}  # type: ignore[misc]
    return {tree.canonical(turns, flip) for tree in trees.values()}


@pytest.mark.parametrize("symmetry", ["none", "c2", "d2", "c4", "d4"])
@pytest.mark.parametrize("n", range(1, 7))
def test_aligned_candidates_are_the_classes_of_grown_trees(n: int, symmetry: Symmetry) -> None:
    turns = TURNS[symmetry]
    found = [grid_of(candidate.topology).canonical(turns, False) for candidate in candidates(n, symmetry=symmetry)]
    assert len(set(found)) == len(found)
    assert set(found) == grown(n, turns, (0,), False)


@pytest.mark.parametrize("n", range(1, 6))
def test_any_port_candidates_are_the_classes_of_grown_spin_labelled_trees(n: int) -> None:
    found = [
        grid_of(candidate.topology).canonical(TURNS["c4"], True) for candidate in candidates(n, connectors="any")
    ]
    assert len(set(found)) == len(found)
    assert set(found) == grown(n, TURNS["c4"], (0, 1), True)


@pytest.mark.parametrize("connectors", ["aligned", "any"])
def test_every_tree_finds_the_candidate_of_its_class(connectors: Connectors) -> None:
    aligned = connectors == "aligned"
    rng = np.random.default_rng(7)
    for _ in range(200):
        topology = random_tree(int(rng.integers(1, 15)), rng, aligned=aligned)
        for symmetry in ("c2", "d2", "c4", "d4") if aligned else ("c2",):
            candidate = candidate_of(topology, symmetry=symmetry, connectors=connectors)
            turns = TURNS[symmetry if aligned else "c4"]
            assert grid_of(topology).canonical(turns, not aligned) == grid_of(candidate.topology).canonical(
                turns, not aligned
            )
            assert candidate_of(candidate.topology, symmetry=symmetry, connectors=connectors) == candidate

"""Flat lattices: polyominoes as candidates, with all neighbours bolted together.

All modules of a lattice have one attitude, so any could be the root: it is the one nearest to the others. Of
several, and of the polyominoes that a group maps onto each other, the smallest key names the candidate.

| symmetry | candidates | OEIS |
|---|---|---|
| none | fixed polyominoes | A001168 |
| c4 | one-sided: up to turns | A000988 |
| d4 | free: up to turns and mirrors | A000105 |
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from random import Random

from topo_search.limits import LIMITS
from topo_search.model import Topology
from topo_search.model.topology import ROOT, STEPS
from topo_search.topologies.family import Candidate, Family
from topo_search.topologies.rooted import GROUPS, Element, Group

Cell = tuple[int, int]
Cells = frozenset[Cell]


class Lattices(Family):
    """All flat lattices of a number of modules, and their classes under a symmetry."""

    @property
    def _listed(self) -> tuple[Candidate, ...]:
        return lattices(self.n, self.group)

    def candidates(self) -> Iterator[Candidate]:
        """Yield all candidates in ascending order of keys."""
        return iter(self._listed)

    def count(self) -> int:
        """Return the number of candidates, which has no closed form."""
        return len(self._listed)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate of a lattice, whatever its spanning tree; ValueError if neighbours lack joints."""
        if topology.neighbours != topology.closures:
            raise ValueError(f"a flat lattice has all neighbours bolted together, but {topology.key} has not")
        images = _images(frozenset(topology.cells), self.group)
        return Candidate(min(map(_key, images)), len(images))

    def key_of(self, topology: Topology) -> str:
        """Return the key of a lattice's candidate."""
        return self.candidate_of(topology).key

    def draws(self, seed: int) -> Iterator[Topology]:
        """Yield an endless sequence of candidates, drawn independently and uniformly."""
        random = Random(seed)
        while True:
            yield random.choice(self._listed).topology


@lru_cache(maxsize=16)
def lattices(n: int, group: Group) -> tuple[Candidate, ...]:
    """Return a candidate for each class of lattices of n modules, in ascending order of keys.

    Raises:
        ValueError: n is out of range (`limits`).

    >>> [len(lattices(4, group)) for group in ("c1", "c4", "d4")]
    [19, 7, 5]
    """
    if not 1 <= n <= LIMITS.lattice_modules:
        raise ValueError(f"`1 <= n <= {LIMITS.lattice_modules}` must hold for flat lattices, but got n = {n}")
    found, seen = list[Candidate](), set[Cells]()
    for cells in _polyominoes(n):
        if cells not in seen:
            images = _images(cells, group)
            seen |= images
            found.append(Candidate(min(map(_key, images)), len(images)))
    return tuple(sorted(found, key=lambda candidate: candidate.key))


@lru_cache(maxsize=LIMITS.lattice_modules)
def _polyominoes(n: int) -> frozenset[Cells]:
    """Return the fixed polyominoes of n cells, each with 0 as its smallest coordinates."""
    if n == 1:
        return frozenset({frozenset({(0, 0)})})
    return frozenset(
        _shift(cells | {(x + dx, y + dy)})
        for cells in _polyominoes(n - 1)
        for x, y in cells
        for dx, dy in STEPS
        if (x + dx, y + dy) not in cells
    )


def _shift(cells: Cells) -> Cells:
    """Return a polyomino with 0 as its smallest coordinates."""
    left, low = min(x for x, _ in cells), min(y for _, y in cells)
    return cells if left == low == 0 else frozenset((x - left, y - low) for x, y in cells)


def _images(cells: Cells, group: Group) -> frozenset[Cells]:
    return frozenset(_shift(frozenset(_image(cell, element) for cell in cells)) for element in GROUPS[group])


def _image(cell: Cell, element: Element) -> Cell:
    """Return the image of a cell: mirrored in the x axis, then turned."""
    (x, y), (quarters, mirror) = cell, element
    y = -y if mirror else y
    for _ in range(quarters):
        x, y = -y, x
    return x, y


def _key(cells: Cells) -> str:
    spread = {(x, y): sum((x - u) ** 2 + (y - v) ** 2 for u, v in cells) for x, y in cells}
    return min(_span(cells, root).key for root in cells if spread[root] == min(spread.values()))


def _span(cells: Cells, root: Cell) -> Topology:
    """Return the lattice with a root, spanned breadth first."""
    numbers, joints, queue = {root: 0}, [ROOT], [root]
    for x, y in queue:
        for a, (dx, dy) in enumerate(STEPS):
            cell = x + dx, y + dy
            if cell in cells and cell not in numbers:
                joints.append((numbers[x, y], a, (a + 2) % 4))
                numbers[cell] = len(numbers)
                queue.append(cell)
    return Topology(tuple(joints)).closed

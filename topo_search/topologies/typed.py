"""Trees of several types of module: candidates that say which type sits where.

| symbol | meaning |
|---|---|
| counts | number of modules of each type; their sum is n |
| types | number of each module's type, in the order of the text |
| reading | text of a tree, turned or mirrored, from one of its modules, and the modules in the order of this text |

A turn, a mirror and another root move the modules of a tree, and the types with them. The key of a class has its
smallest text, and the smallest types among the readings with that text. So the candidates with one text are its
colourings, up to the readings that leave the text as it is.

An element of a group leaves f modules of a tree that it fixes in place, and moves the others in cycles of c. It
fixes a colouring if every cycle has one type: the coefficient of prod x_k^counts[k] in
(sum x_k)^f (sum x_k^c)^((n - f) / c) of them. Classes are counted and drawn by Burnside's lemma, as without types.

With connectors of any port, a quarter turn of a module without rotors changes only its body and the key: such trees
are listed apart.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from math import comb
from random import Random
from typing import Any

from topo_search.model import ResolvedTask, Topology
from topo_search.model.topology import LETTERS
from topo_search.topologies.family import Candidate, Family, TreeShape, draw_index, shapes
from topo_search.topologies.rooted import DIGITS, GROUPS, Element, key_of, text_of

Types = tuple[int, ...]
Reading = tuple[str, tuple[int, ...]]
"""Text of a tree, and its modules in the order of the text."""
Coloured = tuple[str, Types]
"""Text of a tree, and the types of its modules in the order of the text."""
Port = tuple[int, int, int]
"""Neighbour at a port: module, its own port, and parity of the joint."""


class TypedTrees(Family):
    """All trees of a number of modules of each type, and their classes under a symmetry."""

    def __init__(
        self, n: int, *, counts: Sequence[int] = (), task: ResolvedTask | None = None, **options: Any
    ) -> None:
        """Define the family.

        Args:
            n: number of modules.
            counts: number of modules of each type; default: those of the task.
            task: task with types of module, required without `counts` and by the symmetry `task`.
            options: the other arguments of `Family`.

        Raises:
            ValueError: as for `Family`, or the counts are negative, too many, or do not add up to n.
        """
        super().__init__(n, task=task, **options)
        of_task = () if task is None else task.module_types
        self.counts = tuple(counts) or tuple(kind.count for kind in of_task)
        if sum(self.counts) != n or min(self.counts) < 0 or len(self.counts) > len(LETTERS):
            rule = f"counts of types must be at most {len(LETTERS)} whole numbers with the sum n = {n}"
            raise ValueError(f"{rule}, but got {list(self.counts)}")

    def candidates(self) -> Iterator[Candidate]:
        """Yield all candidates in ascending order of keys."""
        for plain in super().candidates():
            tree, text = plain.topology, plain.key[1:]
            least, orbit = self._least_of(tree), self._orbit_of(tree)
            for types in _arrangements(self.counts):
                if least(types) == (text, types):
                    yield Candidate(_key((text, types)), orbit(types))

    def count(self) -> int:
        """Return the number of candidates in closed form."""
        return sum(number for *_, number in self._parts) // len(GROUPS[self.group])

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate of a topology; ValueError if it has other connectors or types."""
        tree = Topology.from_key(self.own_key(topology))
        return Candidate(_key(self._least_of(tree)(tree.types)), self._orbit_of(tree)(tree.types))

    def key_of(self, topology: Topology) -> str:
        """Return the key of a topology's candidate, without computing its orbit."""
        tree = Topology.from_key(self.own_key(topology))
        return _key(self._least_of(tree)(tree.types))

    def draws(self, seed: int) -> Iterator[Topology]:
        """Yield an endless sequence of candidates, drawn independently and uniformly."""
        random, parts = Random(int(seed)), self._parts
        weights = [number for *_, number in parts]
        while True:
            element, shape, _ = parts[draw_index(random, weights)]
            tree = Topology.from_key(key_of(text_of(shape.draw(random, element, self.connectors))))
            types = _draw_types(random, _cycles(tree, element), _length(element), self.counts)
            yield Topology.from_key(self.key_of(replace(tree, types=types)))

    @cached_property
    def _parts(self) -> list[tuple[Element, TreeShape, int]]:
        """Shapes that each element of the group fixes, with the number of coloured trees of this shape it fixes."""
        return [
            (element, shape, shape.number * colourings(shape.fixed, _length(element), self.counts))
            for element in GROUPS[self.group]
            for shape in shapes(*element, self.n, self.connectors, self.root)
        ]

    def _least_of(self, tree: Topology) -> Callable[[Types], Coloured]:
        """Return the function from the types of a tree's modules to the text and types of its class."""
        roots = self._roots(tree)
        if len(roots) == 2 and self.group == "c1" and tree.kappas[roots[1]]:
            # as for `Family`: the centroid with the smaller text up to a half turn is the root
            views = [_readings(tree, [root], GROUPS["c2"]) for root in roots]
            return lambda types: _paint(min(views, key=lambda view: min(_paint(r, types) for r in view))[0], types)
        readings = _readings(tree, roots, GROUPS[self.group])
        least = min(text for text, _ in readings)
        symmetric = [reading for reading in readings if reading[0] == least]
        return lambda types: min(_paint(reading, types) for reading in symmetric)

    def _roots(self, tree: Topology) -> list[int]:
        """Return the modules from which a tree is read: its own root, or its centroids."""
        if self.root == "paper":
            return [0]
        parts = [1] * tree.n
        for i in range(tree.n - 1, 0, -1):
            parts[tree.parents[i]] += parts[i]
        heaviest = [tree.n - part for part in parts]
        for i in range(1, tree.n):
            heaviest[tree.parents[i]] = max(heaviest[tree.parents[i]], parts[i])
        return [i for i in range(tree.n) if 2 * heaviest[i] <= tree.n]

    def _orbit_of(self, tree: Topology) -> Callable[[Types], int]:
        """Return the function from the types of a tree's modules to the orbit of its class."""
        if self._exact == self.group:
            return lambda _: 1
        cosets: dict[tuple[int, bool], list[Element]] = {}
        for quarters, mirror in GROUPS[self.group]:
            distinct = quarters % (2 if self._exact == "c2" else 4)
            cosets.setdefault((distinct, mirror), []).append((quarters, mirror))
        views = [_readings(tree, self._roots(tree), elements) for elements in cosets.values()]
        return lambda types: len({min(_paint(reading, types) for reading in view) for view in views})


def _key(coloured: Coloured) -> str:
    text, types = coloured
    return f"{key_of(text)}-{''.join(LETTERS[k] for k in types)}"


def _paint(reading: Reading, types: Types) -> Coloured:
    text, modules = reading
    return text, tuple(types[i] for i in modules)


def _readings(tree: Topology, roots: Iterable[int], elements: Iterable[Element]) -> list[Reading]:
    """Return the images of a tree, which is as its key says, from each root and under each element of a group."""
    around: list[dict[int, Port]] = [{} for _ in range(tree.n)]
    for h, i, a, b in tree.edges():
        odd = tree.kappas[i] % 2
        around[h][a], around[i][b] = (i, b, odd), (h, a, odd)
    return [_read(around, root, *element) for root in roots for element in elements]


def _read(around: Sequence[Mapping[int, Port]], root: int, quarters: int, mirror: bool) -> Reading:
    """Return the image under an element (q, mirror) of a tree that is seen from a root, by its joints."""
    sense = -1 if mirror else 1
    text, modules, stack = "", list[int](), [(root, -sense * quarters, 0)]
    while stack:
        i, entry, odd = stack.pop()
        slots = range(4) if not modules else range(1, 4)
        met = [around[i].get((entry + sense * slot) % 4) for slot in slots]
        text += DIGITS[sum(1 << bit for bit, other in enumerate(met) if other) | odd << 3]
        modules.append(i)
        stack.extend(other for other in reversed(met) if other)
    return text, tuple(modules)


def _length(element: Element) -> int:
    """Return the length of the cycles in which an element of a group moves modules."""
    quarters, mirror = element
    return 2 if mirror else (1, 4, 2, 4)[quarters]


@lru_cache(maxsize=1 << 16)
def colourings(fixed: int, length: int, counts: Types) -> int:
    """Return the number of colourings of modules and cycles of modules, each of one type.

    Args:
        fixed: number of modules that are no part of a cycle.
        length: number of modules of a cycle.
        counts: number of modules of each type, in cycles or not.

    >>> colourings(1, 2, (3, 2))
    2
    """
    return sum(number for _, number in _splits(fixed, length, counts)) if counts else 1


def _splits(fixed: int, length: int, counts: Types) -> list[tuple[int, int]]:
    """Return what number of modules outside of cycles may be of the last type, and the colourings of each."""
    *others, last = counts
    total, rest = sum(counts), sum(others)
    cycles = (total - fixed) // length
    least = max(0, fixed - rest)
    return [
        (f, colourings(fixed - f, length, (*others,)) * comb(fixed, f) * comb(cycles, (last - f) // length))
        for f in range(least + (last - least) % length, min(last, fixed) + 1, length)
    ]


def _cycles(tree: Topology, element: Element) -> list[list[int]]:
    """Return the cycles in which an element that fixes a tree moves its modules."""
    centres = [0, *(i for h, i, _, _ in tree.edges() if h == 0 and not tree.kappas[i])]
    images = (modules for text, modules in _readings(tree, centres, [element]) if text == tree.key[1:])
    onto, cycles, left = next(images), list[list[int]](), set(range(tree.n))
    while left:
        cycle = [left.pop()]
        while (image := onto[cycle[-1]]) != cycle[0]:
            cycle.append(image)
        left -= {*cycle}
        cycles.append(cycle)
    return cycles


def _draw_types(random: Random, cycles: Sequence[Sequence[int]], length: int, counts: Types) -> Types:
    """Draw the types of modules uniformly from those with one type in each cycle, of one module or of `length`."""
    alone = [cycle for cycle in cycles if len(cycle) == 1]
    moved = [cycle for cycle in cycles if len(cycle) > 1]
    fixed, types = len(alone), [0] * sum(counts)
    random.shuffle(alone)
    random.shuffle(moved)
    for k in reversed(range(len(counts))):
        splits = _splits(fixed, length, counts[: k + 1])
        f, _ = splits[draw_index(random, [number for _, number in splits])]
        fixed -= f
        for cycle in (*(alone.pop() for _ in range(f)), *(moved.pop() for _ in range((counts[k] - f) // length))):
            for i in cycle:
                types[i] = k
    return tuple(types)


def _arrangements(counts: Types) -> Iterator[Types]:
    """Yield all rows with counts[k] times each number k, in ascending order."""
    row = [k for k, count in enumerate(counts) for _ in range(count)]
    while True:
        yield tuple(row)
        i = next((i for i in range(len(row) - 2, -1, -1) if row[i] < row[i + 1]), None)
        if i is None:
            return
        j = next(j for j in range(len(row) - 1, i, -1) if row[j] > row[i])
        row[i], row[j] = row[j], row[i]
        row[i + 1 :] = reversed(row[i + 1 :])

"""Exact uniform sampling of trees, and of their classes under a group.

Draw an element of the group with probability proportional to the number of trees that it leaves as they are, then
one of these trees uniformly: its class is uniform, because each class is met in |G| ways (the stabiliser of a tree
times the size of its class; Burnside). All numbers are integers.

Forests of ternary trees are drawn by the cycle lemma (Dvoretzky and Motzkin 1947): of the 3m + s rotations of a
word with m modules and 2m + s free slots exactly s are the preorder text of a forest of s trees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from random import Random

from topo_search.topologies.codes import mirror_code, plant
from topo_search.topologies.counts import count_fixed, mirror_bridges, mirror_paths
from topo_search.topologies.quotient import Quotient
from topo_search.topologies.rooted import Rooted, turn
from topo_search.topologies.symmetry import GROUPS, Connectors, Root


def draw_tree(random: Random, n: int, quotient: Quotient, connectors: Connectors) -> Rooted:
    """Return the representative of a class of n modules, drawn uniformly from all classes."""
    weights = _weights(n, quotient, connectors)
    quarters, mirror = GROUPS[quotient.group][_pick(random, weights)]
    return quotient.representative(_Draw(random, n, connectors, quotient.root).draw_fixed(quarters, mirror))


@lru_cache(maxsize=64)
def _weights(n: int, quotient: Quotient, connectors: Connectors) -> tuple[int, ...]:
    elements = GROUPS[quotient.group]
    return tuple(count_fixed(q, mirror, n, connectors=connectors, root=quotient.root) for q, mirror in elements)


@lru_cache(maxsize=64)
def _mirror_weights(n: int, connectors: Connectors, root: Root) -> tuple[int, ...]:
    """Return the numbers of trees by what lies on the mirror's axis: nothing, or 1..n modules."""
    paths = mirror_paths(n, connectors=connectors, root=root)
    return (mirror_bridges(n, connectors=connectors, root=root), *paths)


def _pick(random: Random, weights: Sequence[int]) -> int:
    """Return an index with probability proportional to its weight, of any size."""
    left = random.randrange(sum(weights))
    for index, weight in enumerate(weights):
        left -= weight
        if left < 0:
            return index
    raise AssertionError("a number under the sum of the weights lies within one of them")


@dataclass(frozen=True)
class _Draw:
    """Uniform draws of trees that an element of a group leaves as they are."""

    random: Random
    n: int
    connectors: Connectors
    root: Root

    def draw_fixed(self, quarters: int, mirror: bool) -> Rooted:
        """Return a tree that an element (q, mirror) leaves as it is."""
        n = self.n
        if mirror and quarters % 2 == 0:
            return turn(self._mirror_image(), quarters // 2)  # the mirrors in the x and in the y axis
        if mirror:
            first, third = self._forest(2, n // 2)
            return turn((first, mirror_code(first), third, mirror_code(third)), quarters // 2)
        if quarters == 0:
            east, north, west, south = self._forest(4, n - 1)
            return east, north, west, south
        if quarters % 2:
            (code,) = self._forest(1, n // 4)
            return code, code, code, code
        if n % 2:
            first, second = self._forest(2, n // 2)
            return first, second, first, second
        right, ahead, left = self._forest(3, n // 2 - 1)
        half = plant((right, ahead, left))
        return turn((half, right, ahead, left), self.random.randrange(2))

    def _mirror_image(self) -> Rooted:
        """Return a tree that is its own mirror image in the x axis."""
        on_axis = _pick(self.random, _mirror_weights(self.n, self.connectors, self.root))
        if on_axis == 0:
            right, ahead, left = self._forest(3, self.n // 2 - 1)
            return left, mirror_code(plant((right, ahead, left))), right, ahead
        sides = self._forest(on_axis, (self.n - on_axis) // 2)
        at = self.random.randrange(on_axis)
        east = west = ""
        for side in reversed(sides[at + 1 :]):
            east = plant((mirror_code(side), east, side), self._odd())
        for side in sides[:at]:
            west = plant((side, west, mirror_code(side)), self._odd())
        return east, sides[at], west, mirror_code(sides[at])

    def _odd(self) -> int:
        """Return the parity of a joint's kappa."""
        return self.random.randrange(2) if self.connectors == "any" else 0

    def _forest(self, trees: int, modules: int) -> list[str]:
        """Return the codes of `trees` ternary trees with `modules` modules in all; empty trees have empty codes."""
        length = 3 * modules + trees
        word = [-1] * length
        for place in self.random.sample(range(length), modules):
            word[place] = 2
        waiting: list[str] = []
        for step in reversed(self._rotate(word, trees)):
            if step < 0:
                waiting.append("")
            else:
                right, ahead, left = waiting.pop(), waiting.pop(), waiting.pop()
                waiting.append(plant((right, ahead, left), self._odd()))
        return waiting[::-1]

    def _rotate(self, word: list[int], trees: int) -> list[int]:
        """Return one of the `trees` rotations of a word that only end when as many trees are complete."""
        height, heights = 0, []
        for step in word:
            height += step
            heights.append(height)
        # each begins behind the first place of one of the lowest heights
        start = heights.index(min(heights) + self.random.randrange(trees)) + 1
        return word[start:] + word[:start]

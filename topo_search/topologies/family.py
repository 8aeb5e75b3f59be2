"""Candidates of a search: enumerated, counted, looked up and sampled.

Numbers of candidates have closed forms, and sampling is exactly uniform:

| symbol | meaning |
|---|---|
| n | number of modules |
| T(x) = 1 + x T(x)^3 | generating function of ternary trees: a slot is free or has a module with three slots |
| F(n) | fixed trees: equal up to the choice of the root; OEIS A000139 |
| n F(n) | rooted trees, a forest at the four ports of the root: x T(x)^4; OEIS A006629 (offset 1) |
| L, k | number of modules on a mirror axis, and of pairs beside it; n = L + 2k |

A quotient by a group has (1/|G|) sum over g of Fix(g) classes (Burnside's lemma). For aligned connectors OEIS has
C4 as A005034, and D4 as A005036 = (A005034 + A047749) / 2.

With connectors of any port every joint has a parity: a tree counts 2^e times, where e is the number of joints whose
parity is free. As the root's own spin is fixed, c2 then means all quarter turns with the spin flip: with the free
root (2^n F(n) + 2^ceil(n/2) Fix180(n)) / 4 classes.

To sample a class, draw an element of the group with probability proportional to the number of trees that it fixes,
then one of these trees uniformly. The class is uniform, because each is drawn in |G| ways (the order of a tree's
stabilizer times the size of its class; Burnside). All numbers are integers.

Forests of ternary trees are sampled by the cycle lemma (Dvoretzky and Motzkin 1947): of the 3m + s rotations of a
word with m modules and 2m + s free slots, exactly s are the preorder text of a forest of s trees.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, islice
from math import comb
from random import Random
from typing import NamedTuple

from topo_search.model import ResolvedTask, Topology
from topo_search.model.topology import LETTERS
from topo_search.topologies.rooted import (
    GROUPS,
    Connectors,
    Element,
    Group,
    Root,
    Rooted,
    Symmetry,
    centre,
    group_of,
    image,
    key_of,
    mirror_code,
    other_centroid,
    plant,
    reroot,
    rooted_at,
    rooted_of,
    stabilizers,
    text_of,
    turn,
)
from topo_search.topologies.task_symmetry import exact_group


def forests(trees: int, modules: int) -> int:
    """Return the number of forests of `trees` >= 1 ternary trees, possibly empty ones: [x^modules] T(x)^trees."""
    return trees * comb(3 * modules + trees, modules) // (3 * modules + trees)


Build = Callable[[Sequence[str], Random, Connectors], Rooted]


class TreeShape(NamedTuple):
    """Family of trees that an element leaves as they are, each built from a forest of ternary trees."""

    trees: int
    """Number of trees of the forest."""
    modules: int
    """Number of modules of the forest."""
    number: int
    """Number of trees of this shape."""
    fixed: int
    """Number of modules that the element leaves in place."""
    build: Build
    """Function that builds a tree from the codes of a forest and draws the remaining choices."""

    def draw(self, random: Random, element: Element, connectors: Connectors) -> Rooted:
        """Draw one of the trees uniformly."""
        tree = self.build(_draw_forest(random, self.trees, self.modules, connectors), random, connectors)
        return turn(tree, element[0] // 2) if element[1] else tree


@lru_cache(maxsize=512)
def shapes(quarters: int, mirror: bool, n: int, connectors: Connectors, root: Root) -> list[TreeShape]:
    """Return the shapes of the trees that are invariant under an element (q, mirror) of a group.

    Mirrors are represented by those in the x axis and in the diagonal between x and y.
    """
    half, odd = divmod(n, 2)

    def shape(
        trees: int, modules: int, build: Build, *, times: int = 1, same: int = 1, joints: int = 0, fixed: int = odd
    ) -> TreeShape:
        # times: trees per forest; same: forests per tree; joints: those outside of the forest
        number = times * forests(trees, modules) // same
        return TreeShape(trees, modules, number << (modules + joints if connectors == "any" else 0), fixed, build)

    free = root == "free"
    if mirror and quarters % 2 == 0:
        rows = [
            shape(L, (n - L) // 2, _row_on_axis, times=1 if free else L, joints=L - 1, fixed=L)
            for L in range(2 - odd, n + 1, 2)
        ]
        return rows if odd or not free else [shape(3, half - 1, _joint_across_axis), *rows]
    if quarters == 0:
        return [shape(4, n - 1, lambda p, *_: (p[0], p[1], p[2], p[3]), same=n if free else 1, fixed=n)]
    if mirror:
        return [shape(2, half, lambda ports, *_: _beside_diagonal(*ports))] if odd else []
    if quarters % 2:  # one tree at all four ports of a centre
        return [shape(1, n // 4, lambda ports, *_: (*ports, *ports, *ports, *ports))] if n % 4 == 1 else []
    if odd:
        return [shape(2, half, lambda ports, *_: (*ports, *ports))]
    return [shape(3, half - 1, _equal_halves, times=2)] if free else []


def _row_on_axis(sides: Sequence[str], random: Random, connectors: Connectors) -> Rooted:
    """Return a tree with a row of modules on the x axis, each with a subtree and its mirror image beside it."""
    root = random.randrange(len(sides))
    east = west = ""
    for side in reversed(sides[root + 1 :]):
        east = plant((mirror_code(side), east, side), _draw_parity(random, connectors))
    for side in sides[:root]:
        west = plant((side, west, mirror_code(side)), _draw_parity(random, connectors))
    return east, sides[root], west, mirror_code(sides[root])


def _joint_across_axis(slots: Sequence[str], *_: object) -> Rooted:
    right, ahead, left = slots
    return left, mirror_code(plant((right, ahead, left))), right, ahead


def _beside_diagonal(first: str, third: str) -> Rooted:
    return first, mirror_code(first), third, mirror_code(third)


def _equal_halves(slots: Sequence[str], random: Random, _: Connectors) -> Rooted:
    """Return a tree of two equal halves, related by a half turn about the joint between them along x or y."""
    right, ahead, left = slots
    return turn((plant((right, ahead, left)), right, ahead, left), random.randrange(2))


def classes(n: int, group: Group, connectors: Connectors, root: Root) -> int:
    """Return the number of classes of trees of n modules under a group."""
    return sum(_weights(n, group, connectors, root)) // len(GROUPS[group])


def _draw_tree(random: Random, n: int, group: Group, connectors: Connectors, root: Root) -> Rooted:
    """Draw a tree of n modules whose class under a group is uniformly distributed."""
    quarters, mirror = GROUPS[group][draw_index(random, _weights(n, group, connectors, root))]
    several = shapes(quarters, mirror, n, connectors, root)
    on_axis = mirror and quarters % 2 == 0  # the only elements with several shapes
    shape = several[draw_index(random, [shape.number for shape in several])] if on_axis else several[0]
    return shape.draw(random, (quarters, mirror), connectors)


@lru_cache(maxsize=64)
def _weights(n: int, group: Group, connectors: Connectors, root: Root) -> tuple[int, ...]:
    return tuple(sum(shape.number for shape in shapes(*element, n, connectors, root)) for element in GROUPS[group])


def draw_index(random: Random, weights: Sequence[int]) -> int:
    """Draw an index with probability proportional to its integer weight."""
    remainder = random.randrange(sum(weights))
    for index, weight in enumerate(weights):
        remainder -= weight
        if remainder < 0:
            return index
    raise AssertionError("a number under the sum of the weights lies within one of them")


def _draw_parity(random: Random, connectors: Connectors) -> int:
    """Draw the parity of a joint's kappa."""
    return random.randrange(2) if connectors == "any" else 0


def _draw_forest(random: Random, trees: int, modules: int, connectors: Connectors) -> list[str]:
    """Draw the codes of `trees` ternary trees with `modules` modules in total; empty trees have empty codes."""
    word = [-1] * (3 * modules + trees)
    for position in random.sample(range(len(word)), modules):
        word[position] = 2
    # a valid rotation starts behind the first position of one of the lowest heights
    heights = list(accumulate(word))
    start = heights.index(min(heights) + random.randrange(trees)) + 1
    stack: list[str] = []
    for step in reversed(word[start:] + word[:start]):
        if step < 0:
            stack.append("")
        else:
            right, ahead, left = stack.pop(), stack.pop(), stack.pop()
            stack.append(plant((right, ahead, left), _draw_parity(random, connectors)))
    return stack[::-1]


@dataclass(frozen=True, slots=True)
class Candidate:
    """Representative of a class of trees."""

    key: str
    """Smallest key of the class."""
    orbit: int
    """Number of classes of the exact quotient in it; 1 without a symmetry."""

    @property
    def topology(self) -> Topology:
        """Tree of the key."""
        return Topology.from_key(self.key)


class Family:
    """All trees of a number of modules, and their classes under a symmetry.

    With the paper's root, rooted trees are distinct. With the free root a tree is represented by its rootings at
    its centroids: one, or two adjacent ones for even n.
    """

    counts: tuple[int, ...] = ()
    """Number of modules of each type, of trees with types."""

    def __init__(
        self,
        n: int,
        *,
        symmetry: Symmetry = "c2",
        connectors: Connectors = "aligned",
        root: Root = "free",
        task: ResolvedTask | None = None,
    ) -> None:
        """Define the family.

        Args:
            n: number of modules.
            symmetry: trees that are one candidate. `none`: those that differ only in their root; `c2` to `d4`: also
                turned or mirrored ones; `task`: the coarsest quotient that is exact for the task. With connectors
                of any port, all names except `none` and `task` mean the quarter turn with spin flip.
            connectors: `aligned`, or `any` port of the child; then trees differ by the parity of kappa.
            root: `free`, or `paper`: trees with different roots are distinct.
            task: task, required by the symmetry `task`.

        Raises:
            ValueError: n < 1, an unknown name, or `task` without a task.
        """
        if n < 1:
            raise ValueError(f"`n >= 1` must hold, but got n = {n}")
        exact = None if task is None else exact_group(task)
        if (symmetry, exact, connectors) == ("task", "c1", "any"):
            root = "paper"  # seen from a module of the other spin, frames are half a turn off
        self.n, self.symmetry, self.connectors, self.root = n, symmetry, connectors, root
        self.group = group_of(symmetry, connectors=connectors, root=root, exact=exact)
        """Turns and mirrors under which trees are equivalent."""
        # half turns are exact, and for any port quarter turns with spin flip
        self._exact: Group = "c1" if "c1" in (self.group, exact) or root == "paper" else "c2"

    def candidates(self) -> Iterator[Candidate]:
        """Yield all candidates in ascending order of keys."""
        # aligned trees, keys `a...`, then (for any port) those with an odd kappa, keys `p...`
        families: tuple[Connectors, ...] = ("aligned",) if self.connectors == "aligned" else ("aligned", "any")
        for family in families:
            for tree in rooted_at(self.root, self.n, family, stabilizers(self.group)):
                if self._is_representative(tree):
                    key = key_of(text_of(tree))
                    if (key[0] == "a") == (family == "aligned"):
                        yield Candidate(key, self._orbit(tree))

    def count(self) -> int:
        """Return the number of candidates in closed form."""
        return classes(self.n, self.group, self.connectors, self.root)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate of a topology; ValueError if its connectors are not allowed."""
        tree = self._representative(topology)
        return Candidate(key_of(text_of(tree)), self._orbit(tree))

    def key_of(self, topology: Topology) -> str:
        """Return the key of a topology's candidate, without computing its orbit."""
        return key_of(text_of(self._representative(topology)))

    def twin_of(self, topology: Topology) -> Candidate:
        """Return the candidate with all rotor spins reversed; it may be the topology's own.

        Its optimum is similar, because rotor drag torques are small. With the paper's root its orientation would
        differ, and without symmetry half turns are distinct candidates: then the result is the topology's own.
        """
        turned = self.root != "paper" and self.symmetry != "none"
        return self.candidate_of(with_spins_reversed(topology) if turned else topology)

    def draws(self, seed: int) -> Iterator[Topology]:
        """Yield an endless sequence of candidates, drawn independently and uniformly."""
        random = Random(int(seed))  # of NumPy, too
        while True:
            tree = _draw_tree(random, self.n, self.group, self.connectors, self.root)
            yield Topology.from_key(key_of(text_of(self._least(tree))))

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m candidates, drawn independently and uniformly, with repetition.

        A longer sample starts with the shorter one of the same seed.
        """
        return list(islice(self.draws(seed), m))

    def _representative(self, topology: Topology) -> Rooted:
        return self._least(rooted_of(self.own_key(topology)))

    def own_key(self, topology: Topology) -> str:
        """Return the key of a topology with its own root; ValueError if it has other connectors or types."""
        if self.connectors == "aligned" and not topology.aligned:
            raise ValueError(f"an aligned topology has only even kappas, but got {list(topology.kappas)}")
        if sorted(topology.types) != [k for k, count in enumerate(self.counts) for _ in range(count)]:
            counts = [f"{count} {letter}" for count, letter in zip(self.counts, LETTERS, strict=False)]
            raise ValueError(f"must be of {', '.join(counts) or 'one type of module'}, but got {topology.key}")
        return topology.key

    def _least(self, rooted: Rooted) -> Rooted:
        return min(self._equivalents(rooted if self.root == "paper" else centre(rooted), self.group), key=text_of)

    def _is_representative(self, rooted: Rooted) -> bool:
        """True if a tree (free root: rooted at a centroid) has the smallest text of its class."""
        text = text_of(rooted)
        stabilizer = stabilizers(self.group).get(int(text[0], 16))
        # the root's digit comes first in a text: all elements outside of the stabilizer lead to a larger one
        if stabilizer is None or any(text_of(image(rooted, element)) < text for element in stabilizer):
            return False
        first, *second = self._rootings(rooted)
        return first == rooted and all(
            text <= text_of(image(other, element)) for other in second for element in GROUPS[self.group]
        )

    def _orbit(self, rooted: Rooted) -> int:
        """Return the number of exact classes in the class of a tree (free root: rooted at a centroid)."""
        if self._exact == self.group:
            return 1
        remaining, classes = set(self._equivalents(rooted, self.group)), 0
        while remaining:
            remaining.difference_update(self._equivalents(remaining.pop(), self._exact))
            classes += 1
        return classes

    def _equivalents(self, rooted: Rooted, group: Group) -> Iterator[Rooted]:
        """Yield the rooted trees equivalent to a tree under a group (free root: rooted at centroids)."""
        for tree in self._rootings(rooted):
            for element in GROUPS[group]:
                yield image(tree, element)

    def _rootings(self, rooted: Rooted) -> tuple[Rooted, ...]:
        """Return the tree rooted at each of its centroids."""
        port = None if self.root == "paper" else other_centroid(rooted)
        if port is None:
            return (rooted,)
        other = reroot(rooted, port)
        if self.group == "c1" and rooted[port] >= "8":
            # The frames of centroids with different spins differ by a quarter turn, so neither can represent both.
            # The centroid with the smaller text up to a half turn is the root, and both its half turns are listed.
            return (min(rooted, other, key=lambda tree: min(text_of(tree), text_of(turn(tree, 2)))),)
        return (rooted, other)


def with_spins_reversed(topology: Topology) -> Topology:
    """Return the tree with all rotor spins reversed: every joint moves to the next port."""
    first, *joints = topology.joints
    return Topology((first, *((h, (a + 1) % 4, (b + 1) % 4) for h, a, b in joints)), types=topology.types)

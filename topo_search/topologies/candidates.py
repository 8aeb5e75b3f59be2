"""The candidates of a search: enumerated, counted, looked up and drawn, or listed by a user.

A user's list holds keys, trees or graphs; it is checked against the task before anything is solved.

Their numbers have closed forms, and draws are exactly uniform:

| symbol | meaning |
|---|---|
| n | number of modules |
| T(x) = 1 + x T(x)^3 | generating function of ternary trees: a slot is free or holds a module with three slots |
| F(n) | fixed trees: nothing but the choice of the root is the same; OEIS A000139 |
| n F(n) | rooted trees, a forest at the four ports of the root: x T(x)^4; OEIS A006629 (offset 1) |
| L, k | modules on the axis of a mirror; pairs of modules beside it, n = L + 2k |

A quotient by a group has (1/|G|) sum over g of Fix(g) classes (Burnside's lemma). For one family there are OEIS
sequences to compare with: C4 is A005034 and D4 is A005036 = (A005034 + A047749) / 2.

With connectors of any port every joint has a parity: a tree counts 2^e times, e the number of joints that can be
chosen freely. As the root's own spin is fixed, c2 then stands for all quarter turns with the spin flip: with the
free root (2^n F(n) + 2^ceil(n/2) Fix180(n)) / 4 classes.

To sample a class, draw an element of the group with probability proportional to the number of trees that it leaves
as they are, then one of these trees uniformly: its class is uniform, because each class is met in |G| ways (the
stabiliser of a tree times the size of its class; Burnside). All numbers are integers.

Forests of ternary trees are drawn by the cycle lemma (Dvoretzky and Motzkin 1947): of the 3m + s rotations of a
word with m modules and 2m + s free slots exactly s are the preorder text of a forest of s trees.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, islice
from math import comb
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Fault, ResolvedTask, Task, Topology
from topo_search.model.value import show
from topo_search.topologies.rooted import (
    GROUPS,
    Connectors,
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
from topo_search.topologies.task_symmetry import improper_isometry

if TYPE_CHECKING:
    import networkx as nx


def forests(trees: int, modules: int) -> int:
    """Return the number of sequences of `trees` >= 1 ternary trees, some perhaps empty: [x^modules] T(x)^trees."""
    return trees * comb(3 * modules + trees, modules) // (3 * modules + trees)


Build = Callable[[Sequence[str], Random, Connectors], Rooted]


class _Shape(NamedTuple):
    """Trees that are each made of a forest of ternary trees."""

    trees: int
    """Trees of the forest."""
    modules: int
    """Modules of the forest."""
    number: int
    """Trees of this shape."""
    build: Build
    """Makes a tree from the codes of a forest; draws what the forest leaves open."""


@lru_cache(maxsize=512)
def _shapes(quarters: int, mirror: bool, n: int, connectors: Connectors, root: Root) -> list[_Shape]:
    """Return the shapes of the trees that an element (q, mirror) of a group leaves as they are.

    Those of a mirror are as in the x axis, or the diagonal between x and y.
    """

    def shape(trees: int, modules: int, build: Build, *, times: int = 1, same: int = 1, joints: int = 0) -> _Shape:
        # times: trees that a forest makes; same: forests that make one tree; joints: others than a forest's
        number = times * forests(trees, modules) // same
        return _Shape(trees, modules, number << (modules + joints if connectors == "any" else 0), build)

    half, odd = divmod(n, 2)
    free = root == "free"
    if mirror and quarters % 2 == 0:
        rows = [
            shape(L, (n - L) // 2, _row_on_axis, times=1 if free else L, joints=L - 1)
            for L in range(2 - odd, n + 1, 2)
        ]
        return rows if odd or not free else [shape(3, half - 1, _joint_across_axis), *rows]
    if quarters == 0:
        return [shape(4, n - 1, lambda ports, *_: (ports[0], ports[1], ports[2], ports[3]), same=n if free else 1)]
    if mirror:
        return [shape(2, half, lambda ports, *_: _beside_diagonal(*ports))] if odd else []
    if quarters % 2:  # one tree at all four ports of a centre
        return [shape(1, n // 4, lambda ports, *_: (*ports, *ports, *ports, *ports))] if n % 4 == 1 else []
    if odd:
        return [shape(2, half, lambda ports, *_: (*ports, *ports))]
    return [shape(3, half - 1, _equal_halves, times=2)] if free else []


def _row_on_axis(sides: Sequence[str], random: Random, connectors: Connectors) -> Rooted:
    """Return a tree with a row of modules on the x axis, each between a tree and its mirror image."""
    root = random.randrange(len(sides))
    east = west = ""
    for side in reversed(sides[root + 1 :]):
        east = plant((mirror_code(side), east, side), _draw_parity(random, connectors))
    for side in sides[:root]:
        west = plant((side, west, mirror_code(side)), _draw_parity(random, connectors))
    return east, sides[root], west, mirror_code(sides[root])


def _joint_across_axis(slots: Sequence[str], *_: object) -> Rooted:
    """Return a tree of two mirror images in the x axis that a joint across it holds together."""
    right, ahead, left = slots
    return left, mirror_code(plant((right, ahead, left))), right, ahead


def _beside_diagonal(first: str, third: str) -> Rooted:
    return first, mirror_code(first), third, mirror_code(third)


def _equal_halves(slots: Sequence[str], random: Random, _: Connectors) -> Rooted:
    """Return a tree of two halves, the same as seen from the joint between them along x or y."""
    right, ahead, left = slots
    return turn((plant((right, ahead, left)), right, ahead, left), random.randrange(2))


def classes(n: int, group: Group, connectors: Connectors, root: Root) -> int:
    """Return the number of trees of n modules up to a group."""
    return sum(_weights(n, group, connectors, root)) // len(GROUPS[group])


def _draw_tree(random: Random, n: int, group: Group, connectors: Connectors, root: Root) -> Rooted:
    """Return a tree of n modules; its class up to a group is drawn uniformly from all classes."""
    quarters, mirror = GROUPS[group][_pick(random, _weights(n, group, connectors, root))]
    shapes = _shapes(quarters, mirror, n, connectors, root)
    on_axis = mirror and quarters % 2 == 0  # the only elements with several shapes
    shape = shapes[_pick(random, [shape.number for shape in shapes])] if on_axis else shapes[0]
    tree = shape.build(_draw_forest(random, shape.trees, shape.modules, connectors), random, connectors)
    return turn(tree, quarters // 2) if mirror else tree


@lru_cache(maxsize=64)
def _weights(n: int, group: Group, connectors: Connectors, root: Root) -> tuple[int, ...]:
    """Return how many trees each element of a group leaves as they are."""
    return tuple(sum(shape.number for shape in _shapes(*of, n, connectors, root)) for of in GROUPS[group])


def _pick(random: Random, weights: Sequence[int]) -> int:
    """Return an index with probability proportional to its weight, of any size."""
    left = random.randrange(sum(weights))
    for index, weight in enumerate(weights):
        left -= weight
        if left < 0:
            return index
    raise AssertionError("a number under the sum of the weights lies within one of them")


def _draw_parity(random: Random, connectors: Connectors) -> int:
    """Return the parity of a joint's kappa."""
    return random.randrange(2) if connectors == "any" else 0


def _draw_forest(random: Random, trees: int, modules: int, connectors: Connectors) -> list[str]:
    """Return the codes of `trees` ternary trees with `modules` modules in all; empty trees have empty codes."""
    word = [-1] * (3 * modules + trees)
    for position in random.sample(range(len(word)), modules):
        word[position] = 2
    # one of the rotations that only end when all trees do: each begins behind the first place of a lowest height
    heights = list(accumulate(word))
    start = heights.index(min(heights) + random.randrange(trees)) + 1
    waiting: list[str] = []
    for step in reversed(word[start:] + word[:start]):
        if step < 0:
            waiting.append("")
        else:
            right, ahead, left = waiting.pop(), waiting.pop(), waiting.pop()
            waiting.append(plant((right, ahead, left), _draw_parity(random, connectors)))
    return waiting[::-1]


@dataclass(frozen=True, slots=True)
class Candidate:
    """One tree that stands for all those that a quotient takes for the same."""

    key: str
    """The least key among them."""
    orbit: int
    """Number of classes of the exact quotient that it stands for; 1 without a symmetry."""

    @property
    def topology(self) -> Topology:
        """The tree that the key names."""
        return Topology.from_key(self.key)


class Family:
    """The trees of one number of modules that are candidates, and which of them are one.

    With the paper's root a tree is its rooted tree. With the free root a tree is represented by the trees rooted at
    its centroids, of which there are one or (next to each other, for even n) two.
    """

    def __init__(
        self,
        n: int,
        *,
        symmetry: Symmetry = "c2",
        connectors: Connectors = "aligned",
        root: Root = "free",
        task: ResolvedTask | None = None,
    ) -> None:
        """Choose the trees.

        Args:
            n: number of modules.
            symmetry: trees that are one candidate. `none`: those that differ in their root alone; `c2` to `d4`:
                also turned or mirrored ones; `task`: the coarsest quotient exact for the task. With connectors of
                any port every name but `none` and `task` means the quarter turn with spin flip.
            connectors: `aligned`, or `any` port of the child, which counts by its parity.
            root: `free`, or `paper`: trees with different roots differ.
            task: needed by the symmetry `task`.

        Raises:
            ValueError: n < 1, an unknown name, or `task` without a task.
        """
        if n < 1:
            raise ValueError(f"`n >= 1` must hold, but got n = {n}")
        mirrors = None if task is None or symmetry != "task" else improper_isometry(task) is not None
        self.n, self.symmetry, self.connectors, self.root = n, symmetry, connectors, root
        self.group = group_of(symmetry, connectors=connectors, root=root, mirrors=mirrors)
        """The turns and mirrors under which trees are one."""
        self._exact: Group = "c1" if root == "paper" or self.group == "c1" else "c2"

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate, in ascending order of keys.

        Their number is `count`; the orbits add up to `classes`, with `none` to the number of candidates.
        """
        # the aligned ones, keys `a...`, then (for any port) those with an odd kappa, keys `p...`
        families: tuple[Connectors, ...] = ("aligned",) if self.connectors == "aligned" else ("aligned", "any")
        for family in families:
            for tree in rooted_at(self.root, self.n, family, stabilizers(self.group)):
                if self._lists(tree):
                    key = key_of(text_of(tree))
                    if (key[0] == "a") == (family == "aligned"):
                        yield Candidate(key, self._orbit(tree))

    def count(self) -> int:
        """Return the number of candidates, by closed form."""
        return classes(self.n, self.group, self.connectors, self.root)

    @property
    def classes(self) -> int:
        """The number of classes of the exact quotient, which the orbits of all candidates add up to.

        Exact are half turns; for any port quarter turns with spin flip; with the paper's root nothing.
        """
        return classes(self.n, self._exact, self.connectors, self.root)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate that stands for a topology; ValueError if its connectors are not allowed."""
        listed = self._representative(topology)
        return Candidate(key_of(text_of(listed)), self._orbit(listed))

    def key_of(self, topology: Topology) -> str:
        """Return the key of the candidate that stands for a topology, sooner than the candidate."""
        return key_of(text_of(self._representative(topology)))

    def twin_of(self, topology: Topology) -> Candidate:
        """Return the candidate that differs in the sense of all rotors alone, which may be the topology's own.

        Rotor drag torques are small, and so is what its optimum differs by. With the paper's root it stands
        otherwise in the world, and there is only itself; nor is there without symmetry, where half turns are
        candidates of their own.
        """
        turned = self.root != "paper" and self.symmetry != "none"
        return self.candidate_of(with_spins_reversed(topology) if turned else topology)

    def draws(self, seed: int) -> Iterator[Topology]:
        """Yield candidates, drawn independently and uniformly, without end."""
        random = Random(seed)
        while True:
            tree = _draw_tree(random, self.n, self.group, self.connectors, self.root)
            yield Topology.from_key(key_of(text_of(self._least(tree))))

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m candidates, drawn independently and uniformly, so that one may come twice.

        The first draws of a longer sample are those of a shorter one.
        """
        return list(islice(self.draws(seed), m))

    def _representative(self, topology: Topology) -> Rooted:
        if self.connectors == "aligned" and not topology.aligned:
            raise ValueError(f"an aligned topology has only even kappas, but got {list(topology.kappas)}")
        return self._least(rooted_of(topology.key))

    def _least(self, rooted: Rooted) -> Rooted:
        """Return the tree with the least text among those that are one candidate with a given one."""
        return min(self._equivalents(rooted if self.root == "paper" else centre(rooted), self.group), key=text_of)

    def _lists(self, rooted: Rooted) -> bool:
        """True if a tree (free root: one rooted at a centroid) has the least text of its candidate."""
        text = text_of(rooted)
        stabilizer = stabilizers(self.group).get(int(text[0], 16))
        # the root's digit comes first in a text: all other elements lead to a greater one
        if stabilizer is None or any(text_of(image(rooted, element)) < text for element in stabilizer):
            return False
        first, *second = self._rootings(rooted)
        return first == rooted and all(
            text <= text_of(image(other, element)) for other in second for element in GROUPS[self.group]
        )

    def _orbit(self, rooted: Rooted) -> int:
        """Return the number of exact classes that are one candidate with a tree (free root: one at a centroid)."""
        if self._exact == self.group:
            return 1
        rest, classes = set(self._equivalents(rooted, self.group)), 0
        while rest:
            rest.difference_update(self._equivalents(rest.pop(), self._exact))
            classes += 1
        return classes

    def _equivalents(self, rooted: Rooted, group: Group) -> Iterator[Rooted]:
        """Yield the rooted trees that a group takes for one with a given one (free root: rooted at a centroid)."""
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
            # Centroids of unlike spins see the tree a quarter turn apart, so no frame is common to both. The one
            # with the lesser key up to a half turn is the root, and its two half turns are listed.
            return (min(rooted, other, key=lambda tree: min(text_of(tree), text_of(turn(tree, 2)))),)
        return (rooted, other)


def with_spins_reversed(topology: Topology) -> Topology:
    """Return the tree whose rotors all turn the other way: every joint sits one port further on."""
    first, *joints = topology.joints
    return Topology((first, *((h, (a + 1) % 4, (b + 1) % 4) for h, a, b in joints)))


def candidate_of(topology: Topology, **family: Any) -> Candidate:
    """Return the candidate that stands for a topology; arguments as of `Family`."""
    return Family(topology.n, **family).candidate_of(topology)


def candidates(n: int, **family: Any) -> Iterator[Candidate]:
    """Return the candidates of n modules one by one, in ascending order of their keys; arguments as of `Family`.

    >>> [topology.key for topology in candidates(3)]
    ['a300', 'a500', 'a600', 'aa00']
    """
    return Family(n, **family).candidates()


def count(n: int, **family: Any) -> int:
    """Return the number of candidates, by closed form; arguments as of `Family`.

    >>> [count(n) for n in range(1, 7)]
    [1, 2, 4, 14, 49, 216]
    >>> count(5, symmetry="none")
    91
    """
    return Family(n, **family).count()


def sample(n: int, m: int, seed: int, **family: Any) -> list[Topology]:
    """Return m candidates of n modules, drawn independently and uniformly; arguments as of `Family`.

    >>> [topology.key for topology in sample(4, 3, seed=0)]
    ['a5020', 'a3010', 'a7000']
    """
    return Family(n, **family).sample(m, seed)


OwnTopology: TypeAlias = "Topology | str | nx.Graph[Any]"
"""A tree, its key, or a graph with `ports = {module: port}` at every edge, as `Topology.graph` returns it."""


def own_candidates(
    topologies: Iterable[OwnTopology],
    task: Task,
    *,
    source: str = "topologies",
    places: Mapping[int, str] | None = None,
) -> tuple[str, ...]:
    """Return the keys of listed topologies in ascending order.

    Args:
        topologies: the list.
        task: fixes the sizes, and the connectors that are allowed.
        source: name of the list in a message.
        places: position of each topology, for a message; default: `[0]`, `[1]`, ...

    Raises:
        BadInput: one fault for each that is no tree, of another size, not allowed by the task, or listed before; or
            for a size without any. None, or too many, are a fault as well.
    """
    import networkx as nx

    if isinstance(topologies, str | nx.Graph | Topology) or not isinstance(topologies, Iterable):
        got = show(topologies) if isinstance(topologies, str) else type(topologies).__name__
        raise BadInput(source, f"must be a list of topologies, but got {got}")
    faults, first = list[Fault](), dict[str, str]()
    for number, item in enumerate(topologies):
        if number >= LIMITS.own_topologies:
            raise BadInput(source, f"must list at most {LIMITS.own_topologies:,} topologies, but has more")
        position = f"[{number}]" if places is None else places[number]
        try:
            key = _require_allowed(own_topology(item), task).key
            if key in first:
                raise ValueError(f"must be listed once, but {key} is in {first[key]} already")
            first[key] = position
        except ValueError as error:
            faults.append(Fault(position, str(error)))
    missing = [n for n in task.sizes if n not in {len(key) - 1 for key in first}]
    if not faults and missing:
        rule = f"a topology of each size of the task, but none has {missing[0]} modules"
        faults.append(Fault("", f"must list {rule if first else 'at least one topology, but has none'}"))
    if faults:
        shown = 20  # named one by one
        left = [Fault("", f"has {len(faults) - shown:,} more faults")] if len(faults) > shown else []
        raise BadInput(source, [*faults[:shown], *left])
    return tuple(sorted(first))


def own_topology(given: OwnTopology) -> Topology:
    """Return a tree that a user gave; ValueError says what is wrong with it."""
    if isinstance(given, Topology):
        return given
    if isinstance(given, str):
        if len(given) > LIMITS.modules + 1:
            raise ValueError(
                f"must be a key of at most {LIMITS.modules} modules, but got a text of {len(given):,} characters"
            )
        return Topology.from_key(given)
    import networkx as nx

    if isinstance(given, nx.Graph):
        return Topology.from_graph(given)
    raise ValueError(f"must be a Topology, a key or a networkx graph, but got {type(given).__name__}")


def _require_allowed(topology: Topology, task: Task) -> Topology:
    """Return a tree that may be a candidate for a task; ValueError for another."""
    if topology.n not in task.sizes:
        sizes = " or ".join(map(str, task.sizes))
        raise ValueError(f"must have {sizes} modules, as the task asks, but {topology.key} has {topology.n}")
    if task.search.connectors == "aligned" and not topology.aligned:
        raise ValueError(f'{topology.key} needs search.connectors = "any", but the task has "aligned"')
    return topology

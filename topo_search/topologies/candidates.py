"""The candidates of a search: enumerated, counted, looked up and drawn, or listed by a user.

A user's list holds keys, trees or graphs; it is checked against the task before anything is solved.

Their numbers have closed forms, and draws are exactly uniform:

| symbol | meaning |
|---|---|
| n | number of modules |
| T(x) = 1 + x T(x)^3 | generating function of ternary trees: a slot is free or holds a module with three slots |
| F(n) | fixed trees: nothing but the choice of the root is the same; OEIS A000139 |
| n F(n) | rooted trees: x T(x)^4; OEIS A006629 (offset 1) |
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

from collections import Counter
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
    Quotient,
    Root,
    Rooted,
    Symmetry,
    group_of,
    key_of,
    mirror_code,
    plant,
    rooted_at,
    rooted_of,
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


def classes(n: int, group: Group, *, connectors: Connectors = "aligned", root: Root = "free") -> int:
    """Return the number of trees of n modules up to a group."""
    return sum(_weights(n, group, connectors, root)) // len(GROUPS[group])


def draw_tree(random: Random, n: int, quotient: Quotient, connectors: Connectors) -> Rooted:
    """Return the representative of a class of n modules, drawn uniformly from all classes."""
    weights = _weights(n, quotient.group, connectors, quotient.root)
    quarters, mirror = GROUPS[quotient.group][_pick(random, weights)]
    shapes = _shapes(quarters, mirror, n, connectors, quotient.root)
    on_axis = mirror and quarters % 2 == 0  # the only elements with several shapes
    shape = shapes[_pick(random, [shape.number for shape in shapes])] if on_axis else shapes[0]
    tree = shape.build(_draw_forest(random, shape.trees, shape.modules, connectors), random, connectors)
    return quotient.representative(turn(tree, quarters // 2) if mirror else tree)


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


@dataclass(frozen=True)
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
    """The trees of one number of modules that are candidates, and which of them are one."""

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
        self.n, self.symmetry, self.connectors = n, symmetry, connectors
        self._quotient = Quotient(group_of(symmetry, connectors=connectors, root=root, mirrors=mirrors), root)

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate, in ascending order of keys.

        Their number is `count`; the orbits add up to `classes`, with `none` to the number of candidates.
        """
        # the aligned ones, keys `a...`, then (for any port) those with an odd kappa, keys `p...`
        families: tuple[Connectors, ...] = ("aligned",) if self.connectors == "aligned" else ("aligned", "any")
        for family in families:
            for tree in rooted_at(self._quotient.root, self.n, family, self._quotient.masks):
                if self._quotient.lists(tree):
                    key = key_of(text_of(tree))
                    if (key[0] == "a") == (family == "aligned"):
                        yield Candidate(key, self._quotient.orbit(tree))

    def count(self) -> int:
        """Return the number of candidates, by closed form."""
        return classes(self.n, self._quotient.group, connectors=self.connectors, root=self._quotient.root)

    @property
    def classes(self) -> int:
        """The number of classes of the exact quotient, which the orbits of all candidates add up to.

        Exact are half turns; for any port quarter turns with spin flip; with the paper's root nothing.
        """
        exact: Group = "c1" if self.symmetry == "none" or self._quotient.root == "paper" else "c2"
        return classes(self.n, exact, connectors=self.connectors, root=self._quotient.root)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate that stands for a topology; ValueError if its connectors are not allowed."""
        listed = self._representative(topology)
        return Candidate(key_of(text_of(listed)), self._quotient.orbit(listed))

    def key_of(self, topology: Topology) -> str:
        """Return the key of the candidate that stands for a topology, sooner than the candidate."""
        return key_of(text_of(self._representative(topology)))

    def twin_of(self, topology: Topology) -> Candidate:
        """Return the candidate that differs in the sense of all rotors alone, which may be the topology's own.

        Rotor drag torques are small, and so is what its optimum differs by. With the paper's root it stands
        otherwise in the world, and there is only itself; nor is there without symmetry, where half turns are
        candidates of their own.
        """
        turned = self._quotient.root != "paper" and self.symmetry != "none"
        return self.candidate_of(with_spins_reversed(topology) if turned else topology)

    def draws(self, seed: int) -> Iterator[Topology]:
        """Yield candidates, drawn independently and uniformly, without end."""
        random = Random(seed)
        while True:
            tree = draw_tree(random, self.n, self._quotient, self.connectors)
            yield Topology.from_key(key_of(text_of(tree)))

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m candidates, drawn independently and uniformly, so that one may come twice.

        The first draws of a longer sample are those of a shorter one.
        """
        return list(islice(self.draws(seed), m))

    def _representative(self, topology: Topology) -> Rooted:
        if self.connectors == "aligned" and not topology.aligned:
            raise ValueError(f"an aligned topology has only even kappas, but got {list(topology.kappas)}")
        return self._quotient.representative(rooted_of(topology.key))


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
            topology = own_topology(item)
            _require_allowed(topology, task)
        except ValueError as error:
            faults.append(Fault(position, str(error)))
            continue
        if (key := topology.key) in first:
            faults.append(Fault(position, f"must be listed once, but {key} is in {first[key]} already"))
        else:
            first[key] = position
    if not faults and not first:
        faults.append(Fault("", "must list at least one topology, but has none"))
    sizes = Counter(len(key) - 1 for key in first)
    if not faults and (missing := [n for n in task.sizes if not sizes[n]]):
        faults.append(
            Fault("", f"must list a topology of each size of the task, but none has {missing[0]} modules")
        )
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


def _require_allowed(topology: Topology, task: Task) -> None:
    if topology.n not in task.sizes:
        sizes = " or ".join(map(str, task.sizes))
        raise ValueError(f"must have {sizes} modules, as the task asks, but {topology.key} has {topology.n}")
    if task.search.connectors == "aligned" and not topology.aligned:
        raise ValueError(f'{topology.key} needs search.connectors = "any", but the task has "aligned"')

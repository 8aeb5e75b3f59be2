"""The candidates of a search: enumerated, counted, looked up and drawn, or listed by a user.

A user's list holds keys, trees or graphs; it is checked against the task before anything is solved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice, repeat
from random import Random
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict, Unpack

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Fault, ResolvedTask, Task, Topology
from topo_search.model.bad_input import show
from topo_search.topologies.rooted import Connectors, Root, Rooted, key_of, rooted_at, rooted_of, text_of
from topo_search.topologies.sampling import classes, draw_tree
from topo_search.topologies.symmetry import Quotient, Symmetry, group_of
from topo_search.topologies.task_symmetry import improper_isometry

if TYPE_CHECKING:
    import networkx as nx


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


class Family(TypedDict, total=False):
    """The trees that are candidates, and which of them are one."""

    symmetry: Symmetry
    """Trees that are one candidate, by default `c2`. `none`: those that differ in their root alone; `c2` to `d4`:
    also turned or mirrored ones; `task`: the coarsest quotient exact for the task. With connectors of any port
    every name but `none` and `task` means the quarter turn with spin flip."""
    connectors: Connectors
    """`aligned`, the default, or `any` port of the child, which counts by its parity."""
    root: Root
    """`free`, the default, or `paper`: trees with different roots differ."""
    task: ResolvedTask | None
    """Needed by the symmetry `task`."""


def candidates(n: int, **family: Unpack[Family]) -> Iterator[Candidate]:
    """Return the candidates of n modules one by one, in ascending order of their keys.

    Their number is `count`; the orbits add up to the number of exact classes (half turns; for any port quarter
    turns with spin flip; the paper's root: rooted trees), with `none` to the number of candidates.

    Args:
        n: number of modules.
        family: see `Family`.

    Raises:
        ValueError: n < 1, an unknown name, or `task` without a task.

    >>> [topology.key for topology in candidates(3)]
    ['a300', 'a500', 'a600', 'aa00']
    """
    return _enumerate(n, quotient_of(n, **family), _connectors(family))


def count(n: int, **family: Unpack[Family]) -> int:
    """Return the number of candidates, by closed form; arguments and errors as `candidates`.

    >>> [count(n) for n in range(1, 7)]
    [1, 2, 4, 14, 49, 216]
    >>> count(5, symmetry="none")
    91
    """
    quotient = quotient_of(n, **family)
    return classes(n, quotient.group, connectors=_connectors(family), root=quotient.root)


def sample(n: int, m: int, seed: int, **family: Unpack[Family]) -> list[Topology]:
    """Return m candidates, drawn independently and uniformly, so that one may come twice.

    The first draws of a longer sample are those of a shorter one. Arguments and errors as `candidates`, and:

    >>> [topology.key for topology in sample(4, 3, seed=0)]
    ['a5020', 'a3010', 'a7000']

    Args:
        n: number of modules.
        m: number of draws.
        seed: draws them.
        family: see `Family`.
    """
    return list(islice(draws(n, seed, **family), m))


def draws(n: int, seed: int, **family: Unpack[Family]) -> Iterator[Topology]:
    """Return the draws of `sample` one by one, without end; arguments and errors as there."""
    quotient, connectors, random = quotient_of(n, **family), _connectors(family), Random(seed)
    trees = (draw_tree(random, n, quotient, connectors) for _ in repeat(None))
    return (Topology.from_key(key_of(text_of(tree))) for tree in trees)


def candidate_of(topology: Topology, **family: Unpack[Family]) -> Candidate:
    """Return the candidate that stands for a topology; arguments and errors as `candidates`.

    Raises:
        ValueError: also if the family is aligned and the topology is not.
    """
    quotient = quotient_of(topology.n, **family)
    listed = _representative(topology, quotient, _connectors(family))
    return Candidate(key_of(text_of(listed)), quotient.orbit(listed))


def candidate_key(topology: Topology, *, quotient: Quotient, connectors: Connectors) -> str:
    """Return the key of the candidate that stands for a topology in a quotient, sooner than the candidate."""
    return key_of(text_of(_representative(topology, quotient, connectors)))


def quotient_of(
    n: int,
    *,
    symmetry: Symmetry = "c2",
    connectors: Connectors = "aligned",
    root: Root = "free",
    task: ResolvedTask | None = None,
) -> Quotient:
    """Return which trees are one candidate; arguments and errors as `candidates`."""
    if n < 1:
        raise ValueError(f"`n >= 1` must hold, but got n = {n}")
    mirrors = None if task is None or symmetry != "task" else improper_isometry(task) is not None
    return Quotient(group_of(symmetry, connectors=connectors, root=root, mirrors=mirrors), root)


def _connectors(family: Family) -> Connectors:
    return family.get("connectors", "aligned")


def _representative(topology: Topology, quotient: Quotient, connectors: Connectors) -> Rooted:
    if connectors == "aligned" and not topology.aligned:
        raise ValueError(f"an aligned topology has only even kappas, but got {list(topology.kappas)}")
    return quotient.representative(rooted_of(topology.key))


def _enumerate(n: int, quotient: Quotient, connectors: Connectors) -> Iterator[Candidate]:
    """Yield the aligned candidates, keys `a...`, then (for any port) those with an odd kappa, keys `p...`."""
    families: tuple[Connectors, ...] = ("aligned",) if connectors == "aligned" else ("aligned", "any")
    for family in families:
        for tree in rooted_at(quotient.root, n, family, quotient.masks):
            if quotient.lists(tree):
                key = key_of(text_of(tree))
                if (key[0] == "a") == (family == "aligned"):
                    yield Candidate(key, quotient.orbit(tree))


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

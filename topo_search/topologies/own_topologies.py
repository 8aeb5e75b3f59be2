"""A user's list of candidates: keys, trees or graphs, checked against the task before anything is solved."""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Fault, ResolvedTask, Task, Topology
from topo_search.model.value import show

if TYPE_CHECKING:
    import networkx as nx

OwnTopology: TypeAlias = "Topology | str | nx.Graph[Any]"
"""Tree, key, or graph as returned by `Topology.graph`; its nodes may name their `type` instead of its number."""


def own_candidates(
    topologies: Iterable[OwnTopology],
    task: Task,
    *,
    source: str = "topologies",
    places: Mapping[int, str] | None = None,
) -> tuple[str, ...]:
    """Return the keys of listed topologies in ascending order.

    Args:
        topologies: list of topologies.
        task: task that determines the sizes and the allowed connectors.
        source: name of the list in messages.
        places: position of each topology in messages; default: `[0]`, `[1]`, ...

    Raises:
        BadInput: one fault per topology that is invalid, of another size, not allowed by the task or a
            duplicate, or for a size without topologies; or the list is empty or too long.
    """
    import networkx as nx

    resolve = cache(task.resolve)
    if isinstance(topologies, str | nx.Graph | Topology) or not isinstance(topologies, Iterable):
        actual = show(topologies) if isinstance(topologies, str) else type(topologies).__name__
        raise BadInput(source, f"must be a list of topologies, but got {actual}")
    faults, positions = list[Fault](), dict[str, str]()
    for number, item in enumerate(topologies):
        if number >= LIMITS.own_topologies:
            raise BadInput(source, f"must list at most {LIMITS.own_topologies:,} topologies, but has more")
        position = f"[{number}]" if places is None else places[number]
        try:
            topology = own_topology(item, task)
            if topology.n not in task.sizes:
                sizes = " or ".join(map(str, task.sizes))
                raise ValueError(
                    f"must have {sizes} modules, as the task asks, but {topology.key} has {topology.n}"
                )
            refuse_unlike(topology, resolve(topology.n))
            key = topology.key
            if key in positions:
                raise ValueError(f"must be listed once, but {key} is in {positions[key]} already")
            positions[key] = position
        except ValueError as error:
            faults.append(Fault(position, str(error)))
    missing = [n for n in task.sizes if n not in {len(key.partition("-")[0]) - 1 for key in positions}]
    if not faults and missing:
        rule = f"a topology of each size of the task, but none has {missing[0]} modules"
        faults.append(Fault("", f"must list {rule if positions else 'at least one topology, but has none'}"))
    if faults:
        shown = 20  # faults listed one by one
        more = [Fault("", f"has {len(faults) - shown:,} more faults")] if len(faults) > shown else []
        raise BadInput(source, [*faults[:shown], *more])
    return tuple(sorted(positions))


def own_topology(given: OwnTopology, task: Task) -> Topology:
    """Return the tree of a user's input for a task; ValueError if it is invalid."""
    if isinstance(given, Topology):
        return given
    if isinstance(given, str):
        if len(given) > 2 * LIMITS.modules + 2:
            raise ValueError(
                f"must be a key of at most {LIMITS.modules} modules, but got a text of {len(given):,} characters"
            )
        return Topology.from_key(given)
    import networkx as nx

    if isinstance(given, nx.Graph):
        return Topology.from_graph(_with_numbers(given, task) if task.module_types else given)
    raise ValueError(f"must be a Topology, a key or a networkx graph, but got {type(given).__name__}")


def _with_numbers(graph: "nx.Graph[Any]", task: Task) -> "nx.Graph[Any]":
    """Return a graph whose nodes have the number of their type, for the name of a type or this number."""
    numbered, names = graph.copy(), [kind.name for kind in task.module_types]
    for node, data in numbered.nodes(data=True):
        kind = data.get("type")
        if kind not in names and kind not in range(len(names)):
            rule = f"must have a `type`, one of {', '.join(map(show, names))} or its number from 0"
            raise ValueError(f"the node {node!r} {rule}, but got {kind!r}")
        data["type"] = names.index(kind) if kind in names else kind
    return numbered


def refuse_unlike(topology: Topology, task: ResolvedTask) -> None:
    """Raise ValueError if a task has other connectors or types of module than a topology."""
    if task.search.connectors == "aligned" and not topology.aligned:
        raise ValueError(f'{topology.key} needs search.connectors = "any", but the task has "aligned"')
    if topology.closures != (topology.neighbours if task.search.lattice else ()):
        rule = "must have all neighbours bolted together" if task.search.lattice else "needs search.lattice"
        raise ValueError(f"{topology.key} {rule}")
    task.on(topology)

"""A user's list of candidates: keys, trees or graphs, checked against the task before anything is solved."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Fault, Task, Topology
from topo_search.model.value import show

if TYPE_CHECKING:
    import networkx as nx

OwnTopology: TypeAlias = "Topology | str | nx.Graph[Any]"
"""Tree, key, or graph whose edges have `ports = {module: port}`, as returned by `Topology.graph`."""


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

    if isinstance(topologies, str | nx.Graph | Topology) or not isinstance(topologies, Iterable):
        actual = show(topologies) if isinstance(topologies, str) else type(topologies).__name__
        raise BadInput(source, f"must be a list of topologies, but got {actual}")
    faults, positions = list[Fault](), dict[str, str]()
    for number, item in enumerate(topologies):
        if number >= LIMITS.own_topologies:
            raise BadInput(source, f"must list at most {LIMITS.own_topologies:,} topologies, but has more")
        position = f"[{number}]" if places is None else places[number]
        try:
            key = _require_allowed(own_topology(item), task).key
            if key in positions:
                raise ValueError(f"must be listed once, but {key} is in {positions[key]} already")
            positions[key] = position
        except ValueError as error:
            faults.append(Fault(position, str(error)))
    missing = [n for n in task.sizes if n not in {len(key) - 1 for key in positions}]
    if not faults and missing:
        rule = f"a topology of each size of the task, but none has {missing[0]} modules"
        faults.append(Fault("", f"must list {rule if positions else 'at least one topology, but has none'}"))
    if faults:
        shown = 20  # faults listed one by one
        more = [Fault("", f"has {len(faults) - shown:,} more faults")] if len(faults) > shown else []
        raise BadInput(source, [*faults[:shown], *more])
    return tuple(sorted(positions))


def own_topology(given: OwnTopology) -> Topology:
    """Return the tree of a user's input; ValueError if it is invalid."""
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
    """Return a tree if it can be a candidate for a task; ValueError otherwise."""
    if topology.n not in task.sizes:
        sizes = " or ".join(map(str, task.sizes))
        raise ValueError(f"must have {sizes} modules, as the task asks, but {topology.key} has {topology.n}")
    refuse_joints(topology, task)
    return topology


def refuse_joints(topology: Topology, task: Task) -> None:
    """Raise ValueError if a task allows no joints as those of a topology."""
    if task.search.connectors == "aligned" and not topology.aligned:
        raise ValueError(f'{topology.key} needs search.connectors = "any", but the task has "aligned"')
    if topology.closures != (topology.neighbours if task.search.lattice else ()):
        rule = "must have all neighbours bolted together" if task.search.lattice else "needs search.lattice"
        raise ValueError(f"{topology.key} {rule}")

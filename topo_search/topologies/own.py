"""Candidates that a user lists: keys, trees or graphs, checked against the task before anything is solved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import networkx as nx

from topo_search.limits import MODULES, OWN_TOPOLOGIES
from topo_search.model import BadInput, Fault, Task, Topology
from topo_search.model.bad_input import show

OwnTopology: TypeAlias = "Topology | str | nx.Graph[Any]"
"""A tree, its key, or a graph with `ports = {module: port}` at every edge, as `Topology.graph` returns it."""

TOLD = 20
"""Faults of a list that are told one by one."""


def own_candidates(
    topologies: Iterable[OwnTopology],
    task: Task,
    *,
    source: str = "topologies",
    places: Mapping[int, str] | None = None,
) -> tuple[str, ...]:
    """Return the keys of listed topologies in ascending order.

    Args:
        topologies: what was listed.
        task: fixes the sizes, and the connectors that are allowed.
        source: what the list is called in a message.
        places: where each of them stands, for a message; default: `[0]`, `[1]`, ...

    Raises:
        BadInput: one fault for each that is no tree, of another size, not allowed by the task, or listed before; or
            for a size without any. None, or too many, are a fault as well.
    """
    if isinstance(topologies, str | nx.Graph | Topology) or not isinstance(topologies, Iterable):
        got = show(topologies) if isinstance(topologies, str) else type(topologies).__name__
        raise BadInput(source, [Fault("", f"must be a list of topologies, but got {got}")])
    faults, first = list[Fault](), dict[str, str]()
    for number, given in enumerate(topologies):
        if number >= OWN_TOPOLOGIES:
            raise BadInput(source, [Fault("", f"must list at most {OWN_TOPOLOGIES:,} topologies, but has more")])
        place = f"[{number}]" if places is None else places[number]
        try:
            topology = own_topology(given)
            _require_allowed(topology, task)
        except ValueError as error:
            faults.append(Fault(place, str(error)))
            continue
        if (key := topology.key) in first:
            faults.append(Fault(place, f"must be listed once, but {key} is in {first[key]} already"))
        else:
            first[key] = place
    if not faults and not first:
        faults.append(Fault("", "must list at least one topology, but has none"))
    sizes = Counter(len(key) - 1 for key in first)
    if not faults and (missing := [n for n in task.sizes if not sizes[n]]):
        faults.append(
            Fault("", f"must list a topology of each size of the task, but none has {missing[0]} modules")
        )
    if faults:
        left = [Fault("", f"has {len(faults) - TOLD:,} more faults")] if len(faults) > TOLD else []
        raise BadInput(source, [*faults[:TOLD], *left])
    return tuple(sorted(first))


def own_topology(given: OwnTopology) -> Topology:
    """Return a tree that a user gave; ValueError says what is wrong with it."""
    if isinstance(given, Topology):
        return given
    if isinstance(given, str):
        if len(given) > MODULES + 1:
            raise ValueError(
                f"must be a key of at most {MODULES} modules, but got a text of {len(given):,} characters"
            )
        return Topology.from_key(given)
    if isinstance(given, nx.Graph):
        return Topology.from_graph(given)
    raise ValueError(f"must be a Topology, a key or a networkx graph, but got {type(given).__name__}")


def _require_allowed(topology: Topology, task: Task) -> None:
    if topology.n not in task.sizes:
        sizes = " or ".join(map(str, task.sizes))
        raise ValueError(f"must have {sizes} modules, as the task asks, but {topology.key} has {topology.n}")
    if task.search.connectors == "aligned" and not topology.aligned:
        raise ValueError(f'{topology.key} needs search.connectors = "any", but the task has "aligned"')

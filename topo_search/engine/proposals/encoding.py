"""Trees as rows of whole numbers of fixed length: every row is a tree, and every tree is a row.

| symbol | meaning | range |
|---|---|---|
| k | module, in the order of growth; module 0 is the root | 1..n-1 |
| free ports | those of the k modules so far, oldest first, each one's from its port of entry on | 2k + 2 |
| port k | which free port module k is joined to | 0..2k+1 |
| spin k | parity of kappa[k]; only with connectors of any port | 0, 1 |

Nothing has to be repaired, for there are 2k + 2 free ports whatever was chosen before. Many rows are one candidate.
"""

from __future__ import annotations

from collections.abc import Mapping

from topo_search.model import Topology
from topo_search.model.topology import ROOT, Joint
from topo_search.topologies import Connectors


def ranges(n: int, connectors: Connectors) -> dict[str, int]:
    """Return the names of the numbers that make a tree of n modules, and how many values each can have."""
    numbers = {_port(k): 2 * k + 2 for k in range(1, n)}
    if connectors == "any":
        numbers |= {_spin(k): 2 for k in range(1, n)}
    return numbers


def decode(numbers: Mapping[str, int], n: int) -> Topology:
    """Return the tree that a row of numbers makes."""
    joints: list[Joint] = [ROOT]
    free = [(0, port) for port in range(4)]
    for k in range(1, n):
        h, a = free.pop(numbers[_port(k)])
        b = (a + 2 - numbers.get(_spin(k), 0)) % 4
        joints.append((h, a, b))
        free.extend((k, (b + slot) % 4) for slot in (1, 2, 3))
    return Topology(tuple(joints))


def encode(topology: Topology, connectors: Connectors) -> dict[str, int]:
    """Return a row of numbers that makes a tree with the same key."""
    joints = Topology.from_key(topology.key).joints
    numbers: dict[str, int] = {}
    free = [(0, port) for port in range(4)]
    for k, (h, a, b) in enumerate(joints[1:], start=1):
        numbers[_port(k)] = free.index((h, a))
        if connectors == "any":
            numbers[_spin(k)] = (a + 2 - b) % 2
        free.remove((h, a))
        free.extend((k, (b + slot) % 4) for slot in (1, 2, 3))
    return numbers


def _port(k: int) -> str:
    return f"port {k}"


def _spin(k: int) -> str:
    return f"spin {k}"

"""Trees of modules: which module is bolted to which, and by which ports.

| symbol | meaning | range |
|---|---|---|
| n | number of modules | >= 1 |
| parent[i] | parent of module i | -1 for the root (module 0), else < i |
| parent_port[i] = a | port of the parent | 0..3 = +x, +y, -x, -y of the parent's frame; -1 for the root |
| child_port[i] = b | port of module i | 0..3; -1 for the root |
| kappa[i] | (a + 2 - b) mod 4, quarter turns of the child about its z axis | 0..3; 0 = aligned |

A key is the canonical text of a tree. It lists the modules in preorder, one digit each. A digit is the set of ports
with a child: bits 0..3 for the ports 0..3 of the root, bits 0..2 for the ports b+1, b+2, b+3 of a module with the
child port b. Children follow in that order. Keys of aligned trees start with `a`. If any kappa is odd the key
starts with `p`, and bit 3 of a non-root digit is the parity of kappa. A half turn of one module (kappa + 2) gives
the same platform and the same key. Keys of flat lattices with cycles start with `f`: an aligned spanning tree, in
which all neighbours on the square grid are bolted together. With several types of module a dash and a letter per
module follow, in the same order: `a300-aab` has the first type at the root and at its first child, and the second
type at the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import permutations
from numbers import Integral
from typing import TYPE_CHECKING, Any

import numpy as np

from topo_search.model.arrays import Indices

if TYPE_CHECKING:
    import networkx as nx


Joint = tuple[int, int, int]
"""(parent, parent_port, child_port) of one module; (-1, -1, -1) for the root."""

Bolt = tuple[int, int, int, int]
"""(module, port, other module, its port) of two modules that are bolted together."""

ROOT: Joint = (-1, -1, -1)
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cells beside a module of a flat lattice, at its ports 0..3."""
LETTERS = "abcdefghijklmnopqrstuvwxyz"
"""Letters of the types in keys."""
PORT_NAMES = ("+x", "+y", "−x", "−y")
"""Displayed names of the ports 0..3."""


@dataclass(frozen=True)
class Topology:
    """Rooted tree of modules with the ports of every joint, or the spanning tree of a flat lattice with cycles."""

    joints: tuple[Joint, ...]
    """One (parent, parent_port, child_port) per module, parents before children."""
    closures: tuple[Bolt, ...] = ()
    """Joints of a flat lattice beyond those of the tree: the rest of its pairs of neighbours, in order."""
    types: tuple[int, ...] = ()
    """Number of each module's type; empty: all are of one."""

    __pydantic_config__ = {"use_attribute_docstrings": True}  # noqa: RUF012 (pydantic wants a dictionary)

    def __post_init__(self) -> None:
        """Check that it is a tree of modules joined at distinct ports; ValueError otherwise."""
        joints = tuple((int(h), int(a), int(b)) for h, a, b in self.joints)
        object.__setattr__(self, "joints", joints)
        if not joints:
            raise ValueError("a topology must have at least one module, but got none")
        if joints[0] != ROOT:
            raise ValueError(f"joint 0 must be the root's [-1, -1, -1], but got {list(joints[0])}")
        joint_at: dict[tuple[int, int], int] = {}
        for i, (h, a, b) in enumerate(joints[1:], start=1):
            if not 0 <= h < i:
                raise ValueError(f"`0 <= parent < {i}` must hold in joint {i}, but got parent {h}")
            for name, port, module in (("parent", a, h), ("child", b, i)):
                if not 0 <= port <= 3:
                    raise ValueError(f"the {name} port must be 0, 1, 2 or 3 in joint {i}, but got {port}")
                if (module, port) in joint_at:
                    users = f"joints {joint_at[module, port]} and {i} use it"
                    raise ValueError(f"port {port} of module {module} carries one joint, but {users}")
                joint_at[module, port] = i
        if self.types and len(self.types) != len(joints):
            raise ValueError(f"types must name {len(joints)}, one for each module, but got {len(self.types)}")
        if self.closures and self.closures != self.neighbours:
            rule = f"must be all pairs of neighbours without a joint, {list(map(list, self.neighbours))}"
            raise ValueError(f"closures {rule}, but got {list(map(list, self.closures))}")

    @cached_property
    def cells(self) -> tuple[tuple[int, int], ...]:
        """Cells of the modules on a square grid if all hinges are 0; ValueError if the tree is no flat lattice."""
        cells = [(0, 0)]
        for h, i, a, b in self.edges():
            cells.append((cells[h][0] + STEPS[a][0], cells[h][1] + STEPS[a][1]))
            if b != (a + 2) % 4:
                raise ValueError(f"a flat lattice joins opposite ports, but joint {i} has {a} and {b}")
            if cells[i] in cells[:i]:
                raise ValueError(f"modules of a flat lattice must be apart, but {i} is in the cell of another")
        return tuple(cells)

    @cached_property
    def neighbours(self) -> tuple[Bolt, ...]:
        """Pairs of neighbours on that grid without a joint in the tree."""
        at = {cell: i for i, cell in enumerate(self.cells)}
        pairs = (
            (i, a, at.get((x + dx, y + dy), -1), (a + 2) % 4)
            for (x, y), i in at.items()
            for a, (dx, dy) in enumerate(STEPS)
        )
        return tuple((i, a, j, b) for i, a, j, b in pairs if i < j and self.parents[j] != i)

    @property
    def closed(self) -> Topology:
        """The flat lattice of this spanning tree; ValueError as for `cells`."""
        return Topology(self.joints, self.neighbours)

    @property
    def n(self) -> int:
        """Number of modules."""
        return len(self.joints)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """Parent of every module; -1 for the root."""
        return tuple(h for h, _, _ in self.joints)

    def edges(self) -> Iterator[tuple[int, int, int, int]]:
        """Yield (parent h, child i, parent port a, child port b) of every joint, in module order."""
        for i, (h, a, b) in enumerate(self.joints[1:], start=1):
            yield h, i, a, b

    @cached_property
    def kappas(self) -> tuple[int, ...]:
        """Quarter turns of every module relative to the aligned joint; 0 for the root."""
        return (0, *((a + 2 - b) % 4 for _, a, b in self.joints[1:]))

    @property
    def aligned(self) -> bool:
        """True if every kappa is even, so that all rotors spin as in the aligned family."""
        return all(kappa % 2 == 0 for kappa in self.kappas)

    @cached_property
    def key(self) -> str:
        """Canonical text of this rooted tree (see the docstring of this file)."""
        children = {(h, a): i for h, i, a, _ in self.edges()}
        kappas = self.kappas
        letter, parity_bit = ("a", 0) if self.aligned else ("p", 8)
        letter = "f" if self.closures else letter
        digits: list[str] = []
        order: list[int] = []
        stack = [0]
        while stack:
            i = stack.pop()
            b = self.joints[i][2]
            slots = (0, 1, 2, 3) if i == 0 else ((b + 1) % 4, (b + 2) % 4, (b + 3) % 4)
            mask, next_modules = parity_bit * (kappas[i] % 2), list[int]()
            for bit, port in enumerate(slots):
                if (i, port) in children:
                    mask |= 1 << bit
                    next_modules.append(children[i, port])
            digits.append(f"{mask:x}")
            order.append(i)
            stack.extend(reversed(next_modules))
        types = "".join(LETTERS[self.types[i]] for i in order) if self.types else ""
        return letter + "".join(digits) + (f"-{types}" if types else "")

    @classmethod
    def from_key(cls, key: str) -> Topology:
        """Return the rooted tree of a key; ValueError if the key is invalid.

        >>> Topology.from_key("a300").parents
        (-1, 0, 0)
        """
        return _from_key(key)

    @classmethod
    def from_graph(cls, graph: nx.Graph[Any]) -> Topology:
        """Return the tree of a networkx graph, the inverse of `graph`; its first node is the root.

        Every edge has `ports = {node: port}`: the port, 0 to 3, of each of its two modules. Its direction does not
        matter; several edges between two nodes are one joint if their ports agree. With several types of module
        every node has the number of its `type`, from 0.

        Raises:
            ValueError: the graph is not a tree, an edge lacks ports, or the ports are invalid.

        >>> import networkx as nx
        >>> chain = nx.Graph()
        >>> chain.add_edge("root", "arm", ports={"root": 0, "arm": 2})
        >>> Topology.from_graph(chain).key
        'a10'
        """
        import networkx as nx

        tree: nx.Graph[Any] = nx.Graph(graph)
        if not len(tree) or not nx.is_tree(tree):
            nodes, edges = len(tree), tree.number_of_edges()
            raise ValueError(f"must be a tree, but got a graph of {nodes} nodes and {edges} edges that is not one")
        ports_of: dict[frozenset[Any], dict[Any, int]] = {}
        for first, second, data in graph.edges(data=True):
            value, subject = data.get("ports"), f"the edge of {first!r} and {second!r} must carry"
            if not isinstance(value, Mapping) or {first, second} - set(value):
                raise ValueError(f"{subject} `ports = {{node: port}}` with both of its nodes, but got {value!r}")
            ports = {first: value[first], second: value[second]}
            if not all(isinstance(port, Integral) for port in ports.values()):
                raise ValueError(f"{subject} ports that are whole numbers, but got {ports!r}")
            if (previous := ports_of.setdefault(frozenset(ports), ports)) != ports:
                raise ValueError(f"{subject} one pair of ports, but got {previous!r} and {ports!r}")
        root = next(iter(tree))
        numbers, joints = {root: 0}, [ROOT]
        for parent, child in nx.bfs_edges(tree, root):
            ports = ports_of[frozenset((parent, child))]
            numbers[child] = len(numbers)
            joints.append((numbers[parent], ports[parent], ports[child]))
        types: list[Any] = [tree.nodes[node].get("type") for node in numbers]
        typed = all(kind in range(len(LETTERS)) for kind in types)
        return cls(tuple(joints), types=tuple(int(kind) for kind in types if typed))

    @cached_property
    def bolts(self) -> tuple[Bolt, ...]:
        """All pairs of connectors that are bolted together: the joints of modules 1..n-1, then the closures."""
        return (*((h, a, i, b) for h, i, a, b in self.edges()), *self.closures)

    @property
    def bolted(self) -> frozenset[tuple[int, int]]:
        """Pairs (h, i), h < i, of modules that share a joint."""
        return frozenset((h, i) for h, _, i, _ in self.bolts)

    @cached_property
    def unbolted(self) -> tuple[tuple[int, int], ...]:
        """Ordered pairs (i, j) of distinct modules that share no joint."""
        return tuple((i, j) for i, j in permutations(range(self.n), 2) if (min(i, j), max(i, j)) not in self.bolted)

    @cached_property
    def free_connectors(self) -> tuple[tuple[int, int], ...]:
        """All (module, port) without a joint, in order."""
        occupied = {connector for h, a, i, b in self.bolts for connector in ((h, a), (i, b))}
        return tuple((i, port) for i in range(self.n) for port in range(4) if (i, port) not in occupied)

    @cached_property
    def distances(self) -> Indices:
        """Number of joints between any two modules in the tree, shape (n, n)."""
        distances = np.zeros((self.n, self.n), dtype=int)
        for i in range(1, self.n):
            distances[i, :i] = distances[:i, i] = distances[self.parents[i], :i] + 1
        return distances

    def path(self, i: int, j: int) -> list[int]:
        """Return the modules on the way from module i to module j, both included."""
        start, end = [i], [j]
        while start[-1] != end[-1]:  # a parent has a lower number than its children
            later = start if start[-1] > end[-1] else end
            later.append(self.parents[later[-1]])
        return start + end[-2::-1]

    def graph(self) -> nx.Graph[int]:
        """Return the tree as a networkx graph whose edges have `ports = {module: port}`, and nodes any `type`.

        >>> list(Topology.from_key("a300").graph().edges)
        [(0, 1), (0, 2)]
        """
        import networkx as nx

        graph: nx.Graph[int] = nx.Graph()
        graph.add_nodes_from(range(self.n))
        for h, i, a, b in self.edges():
            graph.add_edge(h, i, ports={h: a, i: b})
        nx.set_node_attributes(graph, dict(enumerate(self.types)), "type")
        return graph


@lru_cache(maxsize=1 << 12)
def _from_key(key: str) -> Topology:
    """Return the tree of a key; cached, because the same keys recur."""
    if not key or key[0] not in "apf":
        raise ValueError(f"a topology key starts with `a`, `p` or `f`, but got {key!r}")
    try:
        tree, dash, letters = key.partition("-")
        masks, types = [int(digit, 16) for digit in tree[1:]], tuple(map(LETTERS.index, letters))
    except ValueError:
        rule = "a topology key has hexadecimal digits after its letter, and letters of types after a dash"
        raise ValueError(f"{rule}, but got {key!r}") from None
    any_port = key[0] == "p"
    joints: list[Joint] = []
    open_slots: list[tuple[int, int]] = [(-1, -1)]
    for i, mask in enumerate(masks):
        if not open_slots:
            raise ValueError(f"key {key!r} describes {i} modules but has {len(masks)} digits")
        h, a = open_slots.pop()
        if h < 0:
            joints.append(ROOT)
            ports = [port for port in range(4) if mask >> port & 1]
        else:
            if mask >= (16 if any_port else 8):
                raise ValueError(f"digit {i} of an aligned key must be under 8, but got {key!r}")
            b = (a + 2 - (mask >> 3)) % 4
            joints.append((h, a, b))
            ports = [(b + turn) % 4 for bit, turn in enumerate((1, 2, 3)) if mask >> bit & 1]
        open_slots.extend((i, port) for port in reversed(ports))
    if open_slots:
        raise ValueError(f"key {key!r} ends before {len(open_slots)} of its modules are described")
    topology = Topology(tuple(joints))
    topology = topology.closed if key[0] == "f" else topology
    if dash:
        topology = replace(topology, types=types)
    if topology.key != key:
        raise ValueError(f"{key!r} is not canonical: the same tree has the key {topology.key!r}")
    return topology


def straight_chain(n: int) -> Topology:
    """Return the tree of n modules that follow each other along +x."""
    return Topology((ROOT, *((i, 0, 2) for i in range(n - 1))))

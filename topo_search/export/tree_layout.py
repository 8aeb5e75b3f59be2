"""Where the modules of a tree are drawn: on a flat grid, or in layers where the grid would overlap."""

from __future__ import annotations

import itertools

import networkx as nx
import numpy as np

from topo_search.export.poses import PORTS
from topo_search.model.arrays import Array
from topo_search.model.topology import Topology

LAYER = 1.3
"""Height of a layer of the layered tree, in cells."""


def flat_layout(topology: Topology) -> tuple[Array, list[int]]:
    """Lay the tree on a square grid as if every hinge were flat.

    Returns:
        The cell of every module, (n, 2), and the quarter turns by which each is rotated.
    """
    cells, turns = [np.zeros(2)], [0]
    for h, _, a, b in topology.edges():
        cells.append(cells[h] + PORTS[(a + turns[h]) % 4, :2])
        turns.append((turns[h] + a + 2 - b) % 4)
    return np.array(cells), turns


def layered_layout(topology: Topology) -> Array:
    """Lay the tree in layers: leaves side by side, every parent over the middle of its children; (n, 2)."""
    tree = topology.graph()
    depth = nx.shortest_path_length(tree, 0)
    leaves = itertools.count()
    x: dict[int, float] = {}
    for i in nx.dfs_postorder_nodes(tree, 0):
        below = [x[j] for j in tree[i] if topology.parents[j] == i]
        x[i] = (min(below) + max(below)) / 2 if below else next(leaves)
    return np.array([[x[i], -LAYER * depth[i]] for i in range(topology.n)])


def layout(topology: Topology) -> tuple[Array, list[int] | None]:
    """Return the cell of every module, (n, 2), and its quarter turns; None if the tree had to be laid in layers."""
    cells, turns = flat_layout(topology)
    if len(np.unique(cells, axis=0)) == topology.n:
        return cells, turns
    return layered_layout(topology), None

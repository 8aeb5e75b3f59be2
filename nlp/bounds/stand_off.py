"""End-effectors whose fixed place is too near to the platform, whatever its shape.

| symbol | meaning | shape | unit |
|---|---|---|---|
| q | end-effector position from the centroid of the modules' centres | (3,) | m |
| d_ij | joints between the modules i and j | | |

The least squared distance of p_E from a centre is at most their mean, |q|^2 + (1 / n^2) sum_{i<j} |p_i - p_j|^2,
and two centres are at most 2 l_c d_ij apart. From the centre of mass of modules and joints the end-effector is
m_t / (m_t - m_E) p_E; joints shift that from the centroid a little.
"""

from __future__ import annotations

import math

from nlp.bounds.refutation import Refutation, bodies_mass, modules, off_centre
from topo_search.model import ResolvedTask, Topology
from topo_search.model.proven import excess_texts, upper_text
from topo_search.model.tolerances import TOLERANCE

ROUNDING = 1e-9
"""Share of a length by which it must be missed."""


def stand_off(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Some module is nearer to a fixed end-effector than its stand-off, in every shape of the platform.

    Of all trees a straight chain has the largest sum of squared distances, sum_{i<j} d_ij^2 = n^2 (n^2 - 1) / 12.
    """
    n, position, asked = task.n, task.end_effector.fixed_position, task.end_effector.stand_off
    if position is None:
        return None
    squares = n**2 * (n**2 - 1) / 12 if topology is None else _squared_distances(topology)
    share = task.total_mass(n) / bodies_mass(task)
    q = share * math.hypot(*position) + off_centre(task)
    farthest = math.hypot(q, 2 * task.module.connector_distance / n * math.sqrt(squares))
    unseen = TOLERANCE * task.module.arm_length * (1 + share)  # of the distance, and of the place
    if asked <= farthest * (1 + ROUNDING) + unseen:
        return None
    needed, reached = excess_texts(asked, farthest)
    return Refutation(
        "end-effector exclusion",
        asked - farthest,
        "m",
        f"end_effector.stand_off = {needed} m is out of reach of {modules(task)}: with the end-effector fixed "
        f"{upper_text(math.hypot(*position))} m from the centre of mass, some module centre is within {reached} m "
        "of it in any shape",
    )


def _squared_distances(topology: Topology) -> int:
    """Return sum_{i<j} d_ij^2."""
    import networkx as nx

    lengths: dict[int, dict[int, int]] = dict(nx.all_pairs_shortest_path_length(topology.graph()))
    return sum(d**2 for of_one in lengths.values() for d in of_one.values()) // 2

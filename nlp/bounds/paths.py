"""Paths of few modules that get into each other's way at every combination of their hinge angles.

The angles of a path, a box of +-pi/2 each and what the audit lets pass beyond, are halved again and again. In a box
with half widths h about its middle, with one module between i and j held still, every hinge t between it and j
moves the points of j by h_t times their distance from the hinge at most, and so for i. Where i and j are too close
by more than all of that at the middle, no angle of the box is any good. The path is impossible when no box is left.

| symbol | meaning | shape | unit |
|---|---|---|---|
| turns | quarter turns from port to port at every inner module: 1, 2 (straight on), 3 | | |
| alpha, h | middles and half widths of boxes; all boxes of a round are alike | (m, hinges), (hinges,) | rad |
| R, p, z | frame of a module (x towards the next one), centre, thrust axis | (m,3,3), (m,3) | -, m |
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from nlp.bounds.refutation import Refutation
from nlp.numbers.geometry import Swept, clearance, rotation
from topo_search.model import AirflowEnvelope, ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.tolerances import TOLERANCE


class PathSearch(NamedTuple):
    """How far paths are searched."""

    longest: int = 5
    """Modules of the longest path that is looked at."""
    most_boxes: int = 4000
    """Boxes in one round beyond which a path is given up as not proven."""
    least_width: float = 0.01
    """Half width of a box that is not halved any more [rad]."""
    depth: float = 1e-3
    """Least amount by which a clearance is missed in every box [l_arm]: far above rounding."""
    parts: tuple[float, ...] = (0.0, 0.1, 0.3, 1.0)
    """Shares of an envelope's length: a part of it that overlaps is proof enough, and moves less."""


SEARCH = PathSearch()


Turns = tuple[int, ...]


def crowded_path(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Some path of the tree is in its own way at any hinge angles; without a tree, two bolted modules are."""
    module, air = task.module, task.module.envelope if task.search.interference == "airflow" else None
    # what is asked of a design, not the more that the search keeps: a proof is to hold for every design
    apart, first = task.body_clearance or 0.0, 2
    if task.search.interference == "separation":
        apart, first = task.separation, 1
    l_c = module.connector_distance
    paths = _paths(topology) if topology is not None else {()} if task.n > 1 else set()
    for turns in sorted(paths, key=lambda turns: (len(turns), turns)):
        depth = SEARCH.depth * module.arm_length
        if _is_crowded(turns, air, apart, first, l_c, depth):
            row = f"{len(turns) + 2} modules in a row"
            way = ", ".join({1: "right", 2: "straight on", 3: "left"}[turn] for turn in turns)
            return Refutation(
                f"clearances of {row}",
                depth,
                "m",
                f"{row}{way and f' that go {way} (or the mirror image)'} come too close to each other at any hinge "
                f"angles: module.connector_distance = {l_c:.15g} m is too short",
            )
    return None


def _paths(topology: Topology) -> set[Turns]:
    """Return the turns of all paths that are looked at; a path, its way back and its mirror image are one."""
    import networkx as nx

    graph, found = topology.graph(), set[Turns]()
    for _, ways in nx.all_pairs_shortest_path(graph, SEARCH.longest - 1):
        for way in ways.values():
            if len(way) == 1:
                continue
            ports = [(graph[i][j]["ports"][i], graph[i][j]["ports"][j]) for i, j in pairwise(way)]
            turns = [(out - entry) % 4 for (_, entry), (out, _) in pairwise(ports)]
            mirror = [(-turn) % 4 for turn in turns]
            found.add(min(tuple(t) for t in (turns, turns[::-1], mirror, mirror[::-1])))
    return found


@lru_cache(maxsize=256)
def _is_crowded(
    turns: Turns, air: AirflowEnvelope | None, apart: float, first: int, l_c: float, depth: float
) -> bool:
    """Return whether it is proven that modules in a row miss some clearance by `depth` [m] at any hinge angles.

    Centres keep `apart` [m] from the `first` one after each other on.
    """
    hinges = len(turns) + 1
    alpha, h = np.zeros((1, hinges)), np.full(hinges, math.pi / 2 + TOLERANCE)
    while len(alpha) <= SEARCH.most_boxes and h.max() > SEARCH.least_width:
        R, p = _poses(turns, alpha, l_c)
        open_, clear = np.ones(len(alpha), dtype=bool), np.ones(len(alpha), dtype=bool)
        for i, j in combinations(range(hinges + 1), 2):
            if j - i >= first:
                distance = np.linalg.norm(p[j] - p[i], axis=-1)
                open_ &= distance + _displacement(i, j, h, l_c) >= apart - depth
                clear &= distance >= apart
            if air is None:
                continue
            for part in SEARCH.parts:
                length = part * air.length
                radius = air.start_radius - (_displacement(i, j, h, l_c, length) + depth) / 2
                if radius > 0:
                    open_ &= _gaps(R, p, i, j, length, radius, part * air.growth) >= 0
            clear &= _gaps(R, p, i, j, air.length, air.start_radius, air.growth) >= 0
        if clear.any():
            return False
        alpha = alpha[open_]
        if not len(alpha):
            return True
        t = int(np.argmax(h))
        h[t] /= 2
        step = h[t] * np.eye(hinges)[t]
        alpha = np.concatenate([alpha - step, alpha + step])
    return False


def _displacement(i: int, j: int, h: Array, l_c: float, length: float = 0.0) -> float:
    """Return how far points of the axes of i and j move to or from each other in a box [m].

    Hinge t, between the modules t and t + 1, is l_c from their centres and 2 l_c farther from every next one.
    """
    middle = (i + j) // 2
    steps = [(t, j - t - 1) for t in range(middle, j)] + [(t, t - i) for t in range(i, middle)]
    return float(sum(h[t] * (math.hypot(l_c, length) if k == 0 else l_c * (1 + 2 * k) + length) for t, k in steps))


def _gaps(R: list[Array], p: list[Array], i: int, j: int, length: float, radius: float, growth: float) -> Array:
    """Return the clearance of the first `length` of two envelopes with another start radius [m]."""
    one, other = (Swept(p[k], -length * R[k][:, :, 2], radius, growth) for k in (i, j))
    return clearance(one, other)


def _poses(turns: Turns, alpha: Array, l_c: float) -> tuple[list[Array], list[Array]]:
    """Return R and p of all modules of a path: hinges turn about the y axis between them."""
    c, s, zero, one = np.cos(alpha), np.sin(alpha), np.zeros_like(alpha), np.ones_like(alpha)
    hinge = np.stack([c, zero, s, zero, one, zero, -s, zero, c], axis=-1).reshape(*alpha.shape, 3, 3)
    R, p = [np.broadcast_to(np.eye(3), (len(alpha), 3, 3))], [np.zeros((len(alpha), 3))]
    for t, turn in enumerate((*turns, 2)):
        R_hinge = R[-1] @ hinge[:, t]
        p.append(p[-1] + l_c * (R[-1][:, :, 0] + R_hinge[:, :, 0]))
        R.append(R_hinge @ rotation([0.0, 0.0, 1.0], (turn - 2) * math.pi / 2))
    return R, p

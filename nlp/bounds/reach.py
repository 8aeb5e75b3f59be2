"""Lengths that rule out a platform: a rod's reach, an end-effector's place, rotors across a hinge.

| symbol | meaning | unit |
|---|---|---|
| L | largest reach of the rod | m |
| d | what every module's centre keeps from p_E at least | m |
| B | centre of mass of modules and joints; a fixed end-effector is at m_t / (m_t - m_E) p_E from it | |
| q | its least distance from the centroid of the modules' centres, from which joints shift B a little | m |
| d_ij | joints between the modules i and j | |

A connector is l_c from a centre: no nearer to p_E than d - l_c. A centre is (1/n) sum_j 2 l_c d_ij <= (n - 1) l_c
from the centroid at most, so a connector is no nearer to a fixed p_E than q - n l_c.

The least squared distance of p_E from a centre is at most their mean, |q|^2 + (1 / n^2) sum_{i<j} |p_i - p_j|^2,
and two centres are at most 2 l_c d_ij apart.

A path of few modules may get into its own way at every combination of its hinge angles. These angles, a box of
+-pi/2 each and what the audit lets pass beyond, are halved again and again. In a box with half widths h about its
middle, with one module between i and j held still, every hinge t between it and j moves the points of j by h_t
times their distance from the hinge at most, and so for i. Where i and j are too close by more than all of that at
the middle, no angle of the box is any good. The path is impossible when no box is left.

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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp.bounds.refutation import Refutation, bodies_mass, modules, off_centre
from nlp.numbers.geometry import Swept, clearance, rotation
from topo_search.model import AirflowEnvelope, ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.exposure import Local
from topo_search.model.proven import TOLERANCE, excess_texts, lower_text, upper_text


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

    graph, paths = topology.graph(), set[Turns]()
    for _, ways in nx.all_pairs_shortest_path(graph, SEARCH.longest - 1):
        for way in ways.values():
            if len(way) == 1:
                continue
            ports = [(graph[i][j]["ports"][i], graph[i][j]["ports"][j]) for i, j in pairwise(way)]
            turns = [(out - entry) % 4 for (_, entry), (out, _) in pairwise(ports)]
            mirror = [(-turn) % 4 for turn in turns]
            paths.add(min(tuple(t) for t in (turns, turns[::-1], mirror, mirror[::-1])))
    return paths


@lru_cache(maxsize=256)
def _is_crowded(
    turns: Turns, air: AirflowEnvelope | None, apart: float, first: int, l_c: float, depth: float
) -> bool:
    """Return whether it is proven that modules in a row miss some clearance by `depth` [m] at any hinge angles.

    Centres keep `apart` [m] from the `first` one after each other on.
    """
    hinges = len(turns) + 1
    pairs = np.array(list(combinations(range(hinges + 1), 2))).T
    far = pairs[1] - pairs[0] >= first
    alpha, h = np.zeros((1, hinges)), np.full(hinges, math.pi / 2 + TOLERANCE)
    while len(alpha) <= SEARCH.most_boxes and h.max() > SEARCH.least_width:
        z, p = _poses(turns, alpha, l_c)
        distance = np.linalg.norm(p[pairs[1]] - p[pairs[0]], axis=-1)[far]
        clear = (distance >= apart).all(axis=0)
        if air is not None:
            clear &= (_gaps(z, p, pairs, air.length, air.start_radius, air.growth) >= 0).all(axis=0)
        if clear.any():
            return False
        open_ = (distance + _displacements(pairs, h, l_c)[far] >= apart - depth).all(axis=0)
        for part in SEARCH.parts:
            if air is not None:
                length = part * air.length
                radius = air.start_radius - (_displacements(pairs, h, l_c, length) + depth) / 2
                gaps = _gaps(z, p, pairs, length, radius, part * air.growth)
                open_ &= ((radius <= 0) | (gaps >= 0)).all(axis=0)
        alpha = alpha[open_]
        if not len(alpha):
            return True
        t = int(np.argmax(h))
        h[t] /= 2
        step = h[t] * np.eye(hinges)[t]
        alpha = np.concatenate([alpha - step, alpha + step])
    return False


def _displacements(pairs: NDArray[np.intp], h: Array, l_c: float, length: float = 0.0) -> Array:
    """Return how far points of the axes of each pair move to or from each other in a box, shape (pairs, 1) [m].

    Hinge t, between the modules t and t + 1, is l_c from their centres and 2 l_c farther from every next one.
    """

    def displacement(i: int, j: int) -> float:
        middle = (i + j) // 2
        steps = [(t, j - t - 1) for t in range(middle, j)] + [(t, t - i) for t in range(i, middle)]
        return sum(
            float(h[t]) * (math.hypot(l_c, length) if k == 0 else l_c * (1 + 2 * k) + length) for t, k in steps
        )

    return np.array([[displacement(i, j)] for i, j in pairs.T.tolist()])


def _gaps(z: Array, p: Array, pairs: NDArray[np.intp], length: float, radius: Any, growth: float) -> Array:
    """Return the clearance of the first `length` of two envelopes with another start radius, a row a pair [m]."""
    one, other = (Swept(p[side], -length * z[side], radius, growth) for side in pairs)
    return clearance(one, other)


def _poses(turns: Turns, alpha: Array, l_c: float) -> tuple[Array, Array]:
    """Return z and p of all modules of a path, shape (modules, m, 3): hinges turn about the y axis between them."""
    c, s, zero, one = np.cos(alpha), np.sin(alpha), np.zeros_like(alpha), np.ones_like(alpha)
    hinge = np.stack([c, zero, s, zero, one, zero, -s, zero, c], axis=-1).reshape(*alpha.shape, 3, 3)
    R, p = [np.broadcast_to(np.eye(3), (len(alpha), 3, 3))], [np.zeros((len(alpha), 3))]
    for t, turn in enumerate((*turns, 2)):
        R_hinge = R[-1] @ hinge[:, t]
        p.append(p[-1] + l_c * (R[-1][:, :, 0] + R_hinge[:, :, 0]))
        R.append(R_hinge @ rotation([0.0, 0.0, 1.0], (turn - 2) * math.pi / 2))
    return np.array(R)[..., 2], np.array(p)


LEAST_MISS = 1e-9
"""Share of a length by which it must be missed."""


def out_of_reach(task: ResolvedTask) -> Refutation | None:
    """Return why no connector is within reach of the end-effector, if none can be."""
    n, module, largest = task.n, task.module, task.largest_reach(task.n)
    if largest is None:
        return None
    farthest, why = max(_distances(task), default=(0.0, ""))
    unseen = TOLERANCE * module.arm_length * (2 + task.total_mass(n) / bodies_mass(task))
    if farthest <= largest + unseen:
        return None
    shown, limit = excess_texts(farthest, largest)
    return Refutation(
        "reach of the end-effector's rod",
        farthest - largest,
        "m",
        f"end_effector.largest_reach = {limit} m is too short for {modules(task)}: {why}, so that the "
        f"nearest free connector is {shown} m from the end-effector at least",
    )


def _distances(task: ResolvedTask) -> list[tuple[float, str]]:
    """Return how far the nearest connector is at least [m], each with its reason."""
    n, l_c = task.n, task.module.connector_distance
    distances = []
    if task.exclusion_radius is not None:
        apart = task.exclusion_radius
        distances.append((apart - l_c, f"every module's centre keeps {lower_text(apart)} m from the end-effector"))
    blown = task.module.region_envelope.start_radius
    for e, exposure in enumerate(task.exposure):
        if isinstance(exposure, Local) and exposure.radius is not None and exposure.geometry:
            reason = f"exposure[{e}].radius = {lower_text(exposure.radius)} m keeps every module's airflow off"
            distances.append((exposure.radius + blown - l_c, reason))
    if task.end_effector.fixed_position is not None:
        p_E = math.hypot(*task.end_effector.fixed_position)
        q = task.total_mass(n) / bodies_mass(task) * p_E - off_centre(task)
        distances.append((q - n * l_c, f"end_effector.position is {lower_text(p_E)} m from the centre of mass"))
    return distances


def stand_off(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Some module is nearer to a fixed end-effector than its stand-off, in every shape of the platform.

    Of all trees a straight chain has the largest sum of squared distances, sum_{i<j} d_ij^2 = n^2 (n^2 - 1) / 12.
    """
    n, position, required = task.n, task.end_effector.fixed_position, task.end_effector.stand_off
    if position is None:
        return None
    squares = n**2 * (n**2 - 1) / 12 if topology is None else _squared_distances(topology)
    share = task.total_mass(n) / bodies_mass(task)
    q = share * math.hypot(*position) + off_centre(task)
    farthest = math.hypot(q, 2 * task.module.connector_distance / n * math.sqrt(squares))
    unseen = TOLERANCE * task.module.arm_length * (1 + share)  # of the distance, and of the place
    if required <= farthest * (1 + LEAST_MISS) + unseen:
        return None
    needed, reached = excess_texts(required, farthest)
    return Refutation(
        "end-effector exclusion",
        required - farthest,
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


def rotors_overlap(task: ResolvedTask) -> Refutation | None:
    """Each of two bolted modules has a rotor across their hinge's axis, at one place, at any angle.

    The axis passes l_c from the centres of both, their rotors from l_arm / sqrt 2 - r to l_arm / sqrt 2 + r. Only a
    rotor that ends before the axis, or begins beyond it, can be clear of the other one there.
    """
    module = task.module
    middle, r, l_c = module.arm_length / math.sqrt(2), module.body.rotor_radius, module.connector_distance
    across = r - abs(middle - l_c)
    if task.n == 1 or task.body_clearance is None or across <= LEAST_MISS * (middle + r):
        return None
    inner, outer = excess_texts(l_c, middle - r)[1], excess_texts(middle + r, l_c)[0]
    return Refutation(
        "rotors of bolted modules",
        across,
        "m",
        "rotors of two modules that are bolted together overlap at any hinge angle: they reach from "
        f"{inner} to {outer} m towards a connector, across the hinge at module.connector_distance = {l_c:.15g} m",
    )

r"""A start from a design of another topology: what both trees have in common stands as it stood there.

A half turn of a module changes nothing, and a quarter turn nothing but its rotors' spins, so a module of the one
tree can stand for one of the other in four ways. The pairs of modules that follow from such a choice along equal
ports are a common subtree. Every choice belongs to exactly one of them, so the largest is found by going through
all 4 n^2 choices once.

| symbol | meaning | shape | unit |
|---|---|---|---|
| i, j, t | module, the source design's module in its place, quarter turns from the one's ports to the other's | | |
| R_i, p_i | pose of module i in W | (3,3), (3,) | -, m |
| Q_i, q_i | pose that the source design's module gives to module i, in the source design's W | (3,3), (3,) | -, m |

.. math::

    e_a \text{ of } i \mathrel{\widehat=} e_{a+t} \text{ of } j, \qquad
    Q_i = R_j R_z(t \pi/2), \qquad
    H_a(\alpha_i) = Q_h^T Q_i R_z(-\kappa \pi/2)
"""

from __future__ import annotations

from collections.abc import Set
from itertools import product
from typing import NamedTuple

import numpy as np

from nlp.evaluation import violations, worst
from nlp.numbers.geometry import nearest_angles, poses, root_rotation, rotation
from nlp.numbers.point import Point, fixed_end_effector
from nlp.starts.random_starts import DRAWING, root_of, splay, with_inputs
from topo_search.model import Design, ResolvedTask, Topology


class Place(NamedTuple):
    """Place of one of the source design's modules, which a module takes over."""

    module: int
    turns: int
    """Quarter turns t: port a is where the source design's module has port a + t."""


Common = dict[int, Place]
"""A common subtree: the places of its modules."""


def warm_start(task: ResolvedTask, topology: Topology, source: Design, rng: np.random.Generator) -> Point:
    """Return a start from a design of another topology, or of the same one for another task.

    Hinges within common subtrees keep their angles; those between them are splayed at random, and with many modules
    turned, with their neighbours if need be, until nothing overlaps. The largest common subtree keeps its
    orientation in the world. The end-effector keeps its place beside it or, where that violates less, from the
    modules' centroid: the lever of the load cases' forces, which a large subtree takes with it when it moves.
    """
    l_c = task.module.connector_distance
    R_source, p_source = poses(
        source.topology,
        root_rotation(source.root_orientation_rad),
        np.array(source.hinge_angles_rad),
        source.task.module.connector_distance,
    )
    parts = common_subtrees(topology, source.topology)
    part_of = {i: number for number, part in enumerate(parts) for i in part}
    match_of = {i: match for part in parts for i, match in part.items()}
    Q = {i: R_source[j] @ rotation([0, 0, 1], t * np.pi / 2) for i, (j, t) in match_of.items()}

    alpha = splay(task, topology, rng)
    for (h, i, a, _), kappa in zip(topology.edges(), topology.kappas[1:], strict=True):
        if h in part_of and part_of[h] == part_of.get(i):
            H = Q[h].T @ Q[i] @ rotation([0, 0, 1], -kappa * np.pi / 2)
            sine = H[0, 2] if a % 2 == 0 else H[2, 1]
            alpha[i - 1] = np.arctan2(sine, H[2, 2])
    alpha = nearest_angles(task, topology, alpha)
    if len(parts[0]) < topology.n >= DRAWING.untangled_from:
        from nlp.starts.untangling import untangle  # compiled code, which small platforms need not load

        alpha = untangle(task, topology, alpha, rng, leeway=False)

    R, _ = poses(topology, np.eye(3), alpha, l_c)
    p_E_source = np.array(source.end_effector_m)
    nearest = min(parts[0], key=lambda i: float(np.linalg.norm(p_source[match_of[i].module] - p_E_source)))
    root = root_of(task, Q[nearest] @ R[nearest].T)
    _, p = poses(topology, root_rotation(root), alpha, l_c)
    beside = p[nearest] + p_E_source - p_source[match_of[nearest].module]
    places = [beside, p.mean(axis=0) + p_E_source - p_source.mean(axis=0)]
    if task.end_effector.fixed_position is not None:
        places = [fixed_end_effector(task, topology, root, alpha)]
    no_inputs = np.empty((len(task.load_cases), topology.n, 4))
    points = [with_inputs(Point(task, topology, root, alpha, p_E, no_inputs)) for p_E in places]
    return min(points, key=lambda point: worst(violations(point)).rank)


def common_subtrees(topology: Topology, source: Topology) -> list[Common]:
    """Return disjoint common subtrees of two trees: always the largest of those that are left, down to pairs.

    The first is there in any case, if only as a single module. Of subtrees of one size half turns come first: they
    keep the spins of all rotors.
    """
    joints, others = _neighbours(topology), _neighbours(source)
    subtrees: list[Common] = []
    while True:
        used = {i for part in subtrees for i in part}
        used_there = {match.module for part in subtrees for match in part.values()}
        part = _largest(joints, others, used, used_there)
        if subtrees and len(part) < 2:
            return subtrees
        subtrees.append(part)


_Neighbours = list[dict[int, tuple[int, int]]]
"""Neighbour at every occupied port of every module: a module, and its own port."""


def _neighbours(topology: Topology) -> _Neighbours:
    joints: _Neighbours = [{} for _ in range(topology.n)]
    for h, i, a, b in topology.edges():
        joints[h][a], joints[i][b] = (i, b), (h, a)
    return joints


def _largest(joints: _Neighbours, others: _Neighbours, used: Set[int], used_there: Set[int]) -> Common:
    """Return the largest common subtree of modules that are not used yet; empty if all are."""
    best: Common = {}
    seen: set[tuple[int, Place]] = set()
    for t, i, j in product((0, 2, 1, 3), range(len(joints)), range(len(others))):
        if i in used or j in used_there or (i, Place(j, t)) in seen:
            continue
        part = {i: Place(j, t)}
        stack = [i]
        while stack:
            h = stack.pop()
            module, turns = part[h]
            for a, (child, b) in joints[h].items():
                there, b_there = others[module].get((a + turns) % 4, (-1, -1))
                if child not in part and child not in used and there >= 0 and there not in used_there:
                    part[child] = Place(there, (b_there - b) % 4)
                    stack.append(child)
        seen.update(part.items())
        if len(part) > len(best):
            best = part
    return best

r"""A start from a design of another topology: the subtrees that both trees share keep their poses.

A half turn of a module changes nothing, and a quarter turn only its rotors' spins, so two modules can match in four
ways. Following equal ports from such a match gives a common subtree. Every match belongs to exactly one of them, so
the largest is found by going through all 4 n^2 matches once.

| symbol | meaning | shape | unit |
|---|---|---|---|
| i, j, t | module, matched module of the source design, quarter turns from the ports of i to those of j | | |
| R_i, p_i | pose of module i in W | (3,3), (3,) | -, m |
| Q_i, q_i | pose of module i as matched, in the source design's W | (3,3), (3,) | -, m |

.. math::

    e_a \text{ of } i \mathrel{\widehat=} e_{a+t} \text{ of } j, \qquad
    Q_i = R_j R_z(t \pi/2), \qquad
    H_a(\alpha_i) = Q_h^T Q_i R_z(-\kappa \pi/2)
"""

from collections.abc import Set
from itertools import product
from typing import NamedTuple

import numpy as np

from nlp.evaluation import violations, worst
from nlp.numbers.geometry import nearest_angles, poses, root_rotation, rotation
from nlp.numbers.point import Point, fixed_end_effector
from nlp.starts.random_starts import DRAWING, root_of, splay, with_inputs
from topo_search.model import Design, ResolvedTask, Topology


class ModuleMatch(NamedTuple):
    """Module of the source design that matches a module."""

    module: int
    turns: int
    """Quarter turns t: port a matches port a + t of the source design's module."""


CommonSubtree = dict[int, ModuleMatch]
"""A common subtree: the matches of its modules."""


def warm_start(task: ResolvedTask, topology: Topology, source: Design, rng: np.random.Generator) -> Point:
    """Return a start from a design of another topology, or of the same one for another task.

    Hinges within common subtrees keep their angles. Hinges between them are splayed at random, and with many
    modules untangled. The largest common subtree keeps its orientation in the world. The end-effector keeps its
    position from that subtree or from the modules' centroid, whichever has the smaller violation; the latter keeps
    the lever of the load cases' forces.
    """
    l_c = task.connector_distances
    R_source, p_source = poses(
        source.topology,
        root_rotation(source.root_orientation_rad),
        np.array(source.hinge_angles_rad),
        source.task.connector_distances,
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
    tip_source = np.array(source.end_effector_m)
    nearest = min(parts[0], key=lambda i: float(np.linalg.norm(p_source[match_of[i].module] - tip_source)))
    root = root_of(task, Q[nearest] @ R[nearest].T)
    _, p = poses(topology, root_rotation(root), alpha, l_c)
    from_subtree = p[nearest] + tip_source - p_source[match_of[nearest].module]
    positions = [from_subtree, p.mean(axis=0) + tip_source - p_source.mean(axis=0)]
    if task.end_effector.fixed_position is not None:
        positions = [fixed_end_effector(task, topology, root, alpha)]
    no_inputs = np.empty((len(task.load_cases), topology.n, task.rotors_per_module))
    points = [with_inputs(Point(task, topology, root, alpha, tip, no_inputs)) for tip in positions]
    return min(points, key=lambda point: worst(violations(point)).rank)


def common_subtrees(topology: Topology, source: Topology) -> list[CommonSubtree]:
    """Return disjoint common subtrees of two trees, each the largest of the remaining modules, down to pairs.

    There is at least one, even if it is a single module. Among subtrees of equal size, half turns come first since
    they keep the spins of all rotors.
    """
    joints, source_joints = _neighbours(topology), _neighbours(source)
    subtrees: list[CommonSubtree] = []
    while True:
        used = {i for part in subtrees for i in part}
        used_source = {match.module for part in subtrees for match in part.values()}
        part = _largest(joints, source_joints, used, used_source)
        if subtrees and len(part) < 2:
            return subtrees
        subtrees.append(part)


_Neighbours = list[dict[int, tuple[int, int]]]
"""Neighbour at every occupied port of every module: the other module and its port."""


def _neighbours(topology: Topology) -> _Neighbours:
    joints: _Neighbours = [{} for _ in range(topology.n)]
    for h, i, a, b in topology.edges():
        joints[h][a], joints[i][b] = (i, b), (h, a)
    return joints


def _largest(joints: _Neighbours, source: _Neighbours, used: Set[int], used_source: Set[int]) -> CommonSubtree:
    """Return the largest common subtree of unused modules; empty if all are used."""
    best: CommonSubtree = {}
    visited: set[tuple[int, ModuleMatch]] = set()
    for t, i, j in product((0, 2, 1, 3), range(len(joints)), range(len(source))):
        if i in used or j in used_source or (i, ModuleMatch(j, t)) in visited:
            continue
        part = {i: ModuleMatch(j, t)}
        stack = [i]
        while stack:
            h = stack.pop()
            module, turns = part[h]
            for a, (child, b) in joints[h].items():
                source_child, b_source = source[module].get((a + turns) % 4, (-1, -1))
                free = source_child >= 0 and source_child not in used_source
                if free and child not in part and child not in used:
                    part[child] = ModuleMatch(source_child, (b_source - b) % 4)
                    stack.append(child)
        visited.update(part.items())
        if len(part) > len(best):
            best = part
    return best

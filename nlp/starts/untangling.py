r"""Untangling: hinge angles at which modules are clear of each other, without regard to wrenches.

The search is compiled (`nlp.starts.tabu_search`); this module converts a task and a topology to its arrays.

Among such angles, those with aligned thrusts are better, especially if a cone must contain all airflow: the farther
its apex, the end-effector, the longer is the lever of forces there, and diverging thrusts balance it poorly. The
measure is

.. math::  \ell = \frac{\text{reach}}{\text{lift}}, \qquad
           \text{lift} = \tfrac{1}{n} \left\| \sum\nolimits_i z_i \right\|,

| symbol | meaning | unit |
|---|---|---|
| reach | distance of the nearest apex upstream of the centroid whose cone contains all envelopes; else l_c | m |
| lift | net share of the thrust at equal inputs; 1 if all axes are parallel | |
"""

import math
from typing import NamedTuple

import numpy as np

from nlp.numbers.geometry import allowed_folds, cone_reach, envelopes, largest_turn, nearest_angles, poses, signs
from nlp.requirements.modules import module_clearances
from nlp.requirements.statement import Distance
from nlp.starts.tabu_search import PreorderTree, Rules, TreePoses, straighten, tabu_search
from nlp.units import Units
from topo_search.model import PORT_DIRECTIONS, Array, ResolvedTask, Topology

CLEAR = 0.02
"""Clearance at which a pair counts as clear [l_arm]."""


class UntanglingSettings(NamedTuple):
    """Settings of untangling."""

    leeway: float = 0.1
    """Clearance to reach where there is room [l_arm], so that a solve can turn hinges."""
    turns: int = 100
    """Largest number of hinge turns per module."""
    sweeps: int = 3
    """Number of passes that turn every hinge back towards zero, once nothing overlaps."""
    kicks: int = 15
    """Number of random hinge turns per module, to shorten the lever."""
    repairs: int = 20
    """Largest number of hinge turns after each of them, to remove its overlaps."""
    patience: float = 1 / 6
    """Share of the kicks after which a platform with overlaps is given up: each of its kicks takes all repairs."""


UNTANGLING = UntanglingSettings()


def untangle(
    task: ResolvedTask, topology: Topology, alpha: Array, rng: np.random.Generator, *, leeway: bool = True
) -> Array:
    """Return hinge angles near alpha without overlaps, or with the fewest overlaps that were found.

    Without leeway pairs may touch, and angles without overlaps are returned unchanged.
    """
    order = _preorder(topology)
    l_c = task.connector_distances / task.module.arm_length
    tree, rules = _tree(topology, order), _rules(task, topology, CLEAR if leeway else 0.0)
    angles = np.concatenate([[0.0], alpha])[order]
    platform = _platform(topology, alpha, l_c, order)
    if tabu_search(tree, platform, angles, rules, UNTANGLING.turns * topology.n, rng) == 0.0 and leeway:
        straighten(tree, platform, angles, rules._replace(required=UNTANGLING.leeway), UNTANGLING.sweeps, rng)
        # once more, in case leeway for some pairs made others overlap
        tabu_search(tree, platform, angles, rules, UNTANGLING.turns * topology.n, rng)
    return _by_module(angles, order)


def shorten_lever(
    task: ResolvedTask, topology: Topology, alpha: Array, half_angle: float | None, rng: np.random.Generator
) -> Array:
    """Return hinge angles near alpha with a shorter lever l, and with no more overlaps.

    An iterated local search: a random hinge is turned, its overlaps are removed, and the result is accepted if it
    has fewer overlaps, or equally many and a smaller l.

    Args:
        task: the task.
        topology: the tree.
        alpha: hinge angles, preferably those of `untangle`, shape (n-1,) [rad].
        half_angle: half-angle of the cone [rad]; None without a cone.
        rng: random generator.
    """
    order = _preorder(topology)
    l_c = task.connector_distances / task.module.arm_length
    tree, rules = _tree(topology, order), _rules(task, topology, CLEAR)

    def repair(alpha: Array) -> tuple[float, Array]:
        angles = np.concatenate([[0.0], alpha])[order]
        overlap = tabu_search(tree, _platform(topology, alpha, l_c, order), angles, rules, UNTANGLING.repairs, rng)
        return overlap, _by_module(angles, order)

    min_overlap, best = repair(alpha)
    min_lever, kicks = lever(task, topology, best, half_angle), UNTANGLING.kicks * topology.n
    for kick in range(kicks):
        if min_overlap > 0.0 and kick >= UNTANGLING.patience * kicks:
            break
        kicked = best.copy()
        kicked[rng.integers(topology.n - 1)] = rng.uniform(-rules.turn, rules.turn)
        kicked = nearest_angles(task, topology, kicked)
        if min_overlap == 0.0 and lever(task, topology, kicked, half_angle) >= min_lever:
            continue
        overlap, kicked = repair(kicked)
        new_lever = lever(task, topology, kicked, half_angle)
        if (overlap, new_lever) < (min_overlap, min_lever):
            min_overlap, min_lever, best = overlap, new_lever, kicked
    return best


def lever(task: ResolvedTask, topology: Topology, alpha: Array, half_angle: float | None) -> float:
    """Return the lever l of hinge angles [m]."""
    R, p = poses(topology, np.eye(3), alpha, task.connector_distances)
    thrust = R[:, :, 2].sum(axis=0)
    lift = max(float(np.linalg.norm(thrust)), 1e-9)
    reach = task.longest_connector
    if half_angle is not None:
        airs = [module.region_envelopes for module in task.modules_of_nodes]
        reach = cone_reach(envelopes(airs, R, p), p.mean(axis=0), thrust / lift, half_angle)
    return topology.n * reach / lift


def _by_module(angles: Array, order: list[int]) -> Array:
    """Return the hinge angles of the modules 1..n-1, from angles in preorder."""
    alpha = np.empty_like(angles)
    alpha[order] = angles
    return np.asarray(alpha[1:])


def _preorder(topology: Topology) -> list[int]:
    """Return the modules in preorder: each is followed by all outward of it."""
    children: list[list[int]] = [[] for _ in range(topology.n)]
    for h, i, _, _ in topology.edges():
        children[h].append(i)
    order, stack = [], [0]
    while stack:
        i = stack.pop()
        order.append(i)
        stack.extend(reversed(children[i]))
    return order


def _tree(topology: Topology, order: list[int]) -> PreorderTree:
    """Return the tree in preorder."""
    n, rank = topology.n, np.argsort(order)
    parent = np.array([-1, *(rank[topology.parents[i]] for i in order[1:])])
    end = np.arange(1, n + 1)
    for i in range(n - 1, 0, -1):
        end[parent[i]] = max(end[parent[i]], end[i])
    return PreorderTree(parent, end, np.concatenate([[0.0], signs(topology)])[order])


def _platform(topology: Topology, alpha: Array, l_c: Array, order: list[int]) -> TreePoses:
    """Return the poses of modules and hinges, in preorder; lengths in the unit of l_c."""
    R, p = poses(topology, np.eye(3), alpha, l_c)
    c, omega = np.zeros_like(p), R[:, :, 0].copy()
    for h, i, a, _ in topology.edges():
        c[i] = p[h] + l_c[h] * R[h] @ PORT_DIRECTIONS[a]
        omega[i] = R[h][:, 1 - a % 2]
    return TreePoses(*(np.ascontiguousarray(array[order]) for array in (p, R[:, :, 2], c, omega)))


def _rules(task: ResolvedTask, topology: Topology, required: float) -> Rules:
    """Return the clearances between modules that untangling enforces [l_arm].

    If envelopes must not merge, parts in airflow are left to Ipopt: few platforms that are clear otherwise have
    any. All modules count as the one with the longest airflow.
    """
    largest = max((kind for kind in task.types if kind.rotor_table.count), key=lambda kind: kind.envelope.length)
    kind, unit = task.search.interference, Units.of(task).length
    formulas = (formula for requirement in module_clearances(task, topology) for formula in requirement.formulas)
    min_distance = max((f.minimum for f in formulas if isinstance(f, Distance)), default=-math.inf)
    air = largest.envelope
    balls = np.column_stack(task.part_cover(largest)) / unit
    return Rules(
        required=required,
        airflow=kind == "airflow",
        balls=balls if kind == "parts" else balls[:0],
        length=air.length / unit,
        start_radius=air.start_radius / unit,
        growth=air.growth / unit,
        min_distance=min_distance,
        bolted_pairs=kind == "separation",
        turn=largest_turn(task),
        folds=np.array(allowed_folds(task, task.search.margin) or ((0.0, 0.0),)),
    )

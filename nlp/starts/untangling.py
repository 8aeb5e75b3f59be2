r"""Geometry first: hinge angles at which modules are clear of each other, before any wrench is considered.

The search itself is compiled (`nlp.starts.tabu_search`); here a task and a topology become its numbers.

Of such angles those are better where thrusts do not point apart; and a cone that must hold all airflow asks for
more still. The farther its apex, the end-effector, has to be, the longer is the lever of the forces there, and
thrusts that point apart do little against it. What counts is

.. math::  \ell = \frac{\text{reach}}{\text{lift}}, \qquad
           \text{lift} = \tfrac{1}{n} \left\| \sum\nolimits_i z_i \right\|,

| symbol | meaning | unit |
|---|---|---|
| reach | distance of the nearest apex upstream of the centroid whose cone holds all envelopes; else l_c | m |
| lift | share of the thrust that is left of equal inputs; 1 if all axes are parallel | |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.numbers.geometry import cone_reach, envelopes, largest_turn, nearest_angles, poses, signs, turns
from nlp.requirements.bodies import Air
from nlp.requirements.modules import module_clearances
from nlp.requirements.statement import Distance
from nlp.starts.tabu_search import Poses, Rules, Tree, straighten, tabu_search
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import PORT_DIRECTIONS, Array

CLEAR = 0.02
"""Clearance at which a pair counts as free [l_arm]."""


class Effort(NamedTuple):
    """Effort of untangling a platform."""

    enough: float = 0.1
    """Clearance that is given where there is room [l_arm]: leeway for the angles that the wrenches will want."""
    turns: int = 100
    """Largest number of hinge turns per module."""
    sweeps: int = 3
    """Passes that turn every hinge back towards zero, once no envelopes overlap."""
    kicks: int = 15
    """Hinges turned at random for the lever's sake, a module."""
    repairs: int = 20
    """Largest number of hinge turns after each pass, to undo the overlaps that it makes."""
    patience: float = 1 / 6
    """Share of the kicks after which a platform with overlaps is let be: there each takes all its repairs."""


EFFORT = Effort()


def untangle(
    task: ResolvedTask, topology: Topology, alpha: Array, rng: np.random.Generator, *, leeway: bool = True
) -> Array:
    """Return hinge angles, found from alpha, without overlaps; those with the fewest if there are none.

    Without leeway pairs may be as close as they like, and angles at which none overlap are returned as they are.
    """
    order = _preorder(topology)
    l_c = task.module.connector_distance / task.module.arm_length
    tree, rules = _tree(topology, order), _rules(task, topology, CLEAR if leeway else 0.0)
    angles = np.concatenate([[0.0], alpha])[order]
    at = _platform(topology, alpha, l_c, order)
    if tabu_search(tree, at, angles, rules, EFFORT.turns * topology.n, rng) == 0.0 and leeway:
        straighten(tree, at, angles, rules._replace(enough=EFFORT.enough), EFFORT.sweeps, rng)
        # again, if room for some cost others all theirs
        tabu_search(tree, at, angles, rules, EFFORT.turns * topology.n, rng)
    return _by_module(angles, order)


def shorten_lever(
    task: ResolvedTask, topology: Topology, alpha: Array, half_angle: float | None, rng: np.random.Generator
) -> Array:
    """Return hinge angles, found from alpha, with no more overlaps and, with as many, no longer a lever l.

    An iterated local search: a hinge is turned anywhere, what then overlaps is turned free, and the angles that
    this leads to are kept if there are fewer overlaps or, with as many, if l is less.

    Args:
        task: the task.
        topology: the tree.
        alpha: hinge angles, best those of `untangle`, shape (n-1,) [rad].
        half_angle: of the cone [rad]; None without one.
        rng: random numbers.
    """
    order = _preorder(topology)
    l_c = task.module.connector_distance / task.module.arm_length
    tree, rules = _tree(topology, order), _rules(task, topology, CLEAR)

    def repair(alpha: Array) -> tuple[float, Array]:
        angles = np.concatenate([[0.0], alpha])[order]
        overlap = tabu_search(tree, _platform(topology, alpha, l_c, order), angles, rules, EFFORT.repairs, rng)
        return overlap, _by_module(angles, order)

    least, best = repair(alpha)
    shortest, kicks = lever(task, topology, best, half_angle), EFFORT.kicks * topology.n
    for kick in range(kicks):
        if least > 0.0 and kick >= EFFORT.patience * kicks:
            break
        kicked = best.copy()
        kicked[rng.integers(topology.n - 1)] = rng.uniform(-rules.turn, rules.turn)
        kicked = nearest_angles(task, topology, kicked)
        if least == 0.0 and lever(task, topology, kicked, half_angle) >= shortest:
            continue
        overlap, kicked = repair(kicked)
        length = lever(task, topology, kicked, half_angle)
        if (overlap, length) < (least, shortest):
            least, shortest, best = overlap, length, kicked
    return best


def lever(task: ResolvedTask, topology: Topology, alpha: Array, half_angle: float | None) -> float:
    """Return the lever l of hinge angles [m]."""
    R, p = poses(topology, np.eye(3), alpha, task.module.connector_distance)
    thrust = R[:, :, 2].sum(axis=0)
    lift = max(float(np.linalg.norm(thrust)), 1e-9)
    reach = task.module.connector_distance
    if half_angle is not None:
        reach = cone_reach(envelopes(task.module.region_envelope, R, p), p.mean(axis=0), thrust / lift, half_angle)
    return topology.n * reach / lift


def _by_module(angles: Array, order: list[int]) -> Array:
    """Return the hinge angles of the modules 1..n-1, given those of all in preorder."""
    alpha = np.empty_like(angles)
    alpha[order] = angles
    return np.asarray(alpha[1:])


def _preorder(topology: Topology) -> list[int]:
    """Return the modules so that all that hangs on a module follows it at once."""
    children: list[list[int]] = [[] for _ in range(topology.n)]
    for h, i, _, _ in topology.edges():
        children[h].append(i)
    order, stack = [], [0]
    while stack:
        i = stack.pop()
        order.append(i)
        stack.extend(reversed(children[i]))
    return order


def _tree(topology: Topology, order: list[int]) -> Tree:
    """Return who hangs on whom, in preorder."""
    n, rank = topology.n, np.argsort(order)
    parent = np.array([-1, *(rank[topology.parents[i]] for i in order[1:])])
    end = np.arange(1, n + 1)
    for i in range(n - 1, 0, -1):
        end[parent[i]] = max(end[parent[i]], end[i])
    return Tree(parent, end, np.concatenate([[0.0], signs(topology)])[order])


def _platform(topology: Topology, alpha: Array, l_c: float, order: list[int]) -> Poses:
    """Return where modules and hinges are, in preorder; lengths in the unit of l_c."""
    R, p = poses(topology, np.eye(3), alpha, l_c)
    c, omega = np.zeros_like(p), R[:, :, 0].copy()
    for h, i, a, _ in topology.edges():
        c[i] = p[h] + l_c * R[h] @ PORT_DIRECTIONS[a]
        omega[i] = R[h][:, 1 - a % 2]
    return Poses(*(np.ascontiguousarray(each[order]) for each in (p, R[:, :, 2], c, omega)))


def _rules(task: ResolvedTask, topology: Topology, enough: float) -> Rules:
    """Return what modules must be clear of, and by how much, of what the problem states between them [l_arm].

    Where envelopes keep apart, parts beside airflow are left to Ipopt: few platforms that are clear of all else
    have any in there.
    """
    kind, unit = task.search.interference, Units.of(task).length
    formulas = (formula for requirement in module_clearances(task, topology) for formula in requirement.formulas)
    apart = max((formula.least for formula in formulas if isinstance(formula, Distance)), default=-math.inf)
    length, start_radius, growth = Air.of(task)
    balls = np.column_stack(task.part_cover) / unit
    return Rules(
        enough=enough,
        airflow=kind == "airflow",
        balls=balls if kind == "parts" else balls[:0],
        length=length,
        start_radius=start_radius,
        growth=growth,
        apart=apart,
        of_all=kind == "separation",
        turn=largest_turn(task),
        folds=np.array(turns(task, task.search.margin) or ((0.0, 0.0),)),
    )

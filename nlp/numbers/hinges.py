"""Hinge ranges: the clear folds of a task as angles of a topology's hinges.

A fold has the sign that its hinge's angle has at the parent's port (`topo_search.model.room`).

| symbol | meaning | shape | unit |
|---|---|---|---|
| alpha | hinge angles of the modules 1..n-1 | (n-1,) | rad |
| phi | their folds, SPLAY alpha | (n-1,) | rad |

Where a task has a set of angles, each that is in a clear fold counts as a fold of its own, of no width. A set has
both signs of each angle, so it is the same for hinges and folds.
"""

from __future__ import annotations

import math

import numpy as np

from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.room import FOLD, Folds, nearest_fold

SPLAY = np.array(FOLD)
"""Sign of the hinge angle that turns the airflow of a child on port +x, +y, -x, -y away from its parent's."""


def signs(topology: Topology) -> Array:
    """Return the sign of every hinge's fold at a positive angle, shape (n-1,)."""
    return np.asarray(SPLAY[[a for _, _, a, _ in topology.edges()]])


def turns(task: ResolvedTask, margin: float = 0.0) -> Folds:
    """Return the folds that a task lets hinges turn to: the clear ones, or the angles of its set in them [rad].

    Args:
        task: the task.
        margin: what rotors keep clear of a neighbour's parts and airflow by at least [m].
    """
    clear, angles = task.folds(margin), task.search.hinge_set_deg
    if angles is None:
        return clear
    single = map(math.radians, angles)
    return tuple((angle, angle) for angle in single if any(low <= angle <= high for low, high in clear))


def nearest_angles(task: ResolvedTask, topology: Topology, alpha: Array) -> Array:
    """Return the nearest angles that the search turns hinges to; 0 where there are none."""
    sign = signs(topology)
    return sign * nearest_fold(turns(task, task.search.margin), sign * alpha)


def ranges(task: ResolvedTask, topology: Topology, alpha: Array | None = None) -> tuple[list[float], list[float]]:
    """Return the least and the largest angle of every hinge, of the clear folds nearest to alpha or of all [rad].

    Where there is no clear fold both are 0; the check of the result then finds that.
    """
    sign, folds = signs(topology), turns(task, task.search.margin) or ((0.0, 0.0),)
    low, high = np.full_like(sign, folds[0][0]), np.full_like(sign, folds[-1][1])
    if alpha is not None:
        phi = sign * nearest_angles(task, topology, alpha)
        for least, largest in folds:
            inside = (least <= phi) & (phi <= largest)
            low[inside], high[inside] = least, largest
    return np.minimum(sign * low, sign * high).tolist(), np.maximum(sign * low, sign * high).tolist()


def largest_turn(task: ResolvedTask) -> float:
    """Return the largest angle that the search turns a hinge to, either way [rad]; 0 where there is none."""
    return max((max(-low, high) for low, high in turns(task, task.search.margin)), default=0.0)


def fold_excess(task: ResolvedTask, topology: Topology, alpha: Array) -> Array:
    """Return how far every hinge is beyond its folds, without any margin: negative inside, 0 in a set [rad]."""
    phi, folds = signs(topology) * alpha, turns(task)
    if not folds:
        return np.full_like(phi, np.pi)
    low, high = np.array(folds).T[:, :, None]
    return np.asarray(np.min(np.maximum(low - phi, phi - high), axis=0))

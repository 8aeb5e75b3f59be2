"""How far hinges may turn: the clear folds of a task as angles of a topology's hinges.

A fold has the sign that its hinge's angle has at the parent's port (`topo_search.model.room`).

| symbol | meaning | shape | unit |
|---|---|---|---|
| alpha | hinge angles of the modules 1..n-1 | (n-1,) | rad |
| phi | their folds, SPLAY alpha | (n-1,) | rad |
"""

from __future__ import annotations

import numpy as np

from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.room import FOLD, nearest_fold

SPLAY = np.array(FOLD)
"""Sign of the hinge angle that turns the airflow of a child on port +x, +y, -x, -y away from its parent's."""


def signs(topology: Topology) -> Array:
    """Return the sign of every hinge's fold at a positive angle, shape (n-1,)."""
    result: Array = SPLAY[[a for _, _, a, _ in topology.edges()]]
    return result


def nearest_angles(task: ResolvedTask, topology: Topology, alpha: Array) -> Array:
    """Return the nearest angles that the search turns hinges to; 0 where there are none."""
    sign = signs(topology)
    return sign * nearest_fold(task.folds(task.search.margin), sign * alpha)


def ranges(task: ResolvedTask, topology: Topology, alpha: Array | None = None) -> tuple[list[float], list[float]]:
    """Return the least and the largest angle of every hinge, of the clear folds nearest to alpha or of all [rad].

    Where there is no clear fold both are 0; the check of the result then finds that.
    """
    sign, folds = signs(topology), task.folds(task.search.margin) or ((0.0, 0.0),)
    low, high = np.full_like(sign, folds[0][0]), np.full_like(sign, folds[-1][1])
    if alpha is not None:
        phi = sign * nearest_angles(task, topology, alpha)
        for least, largest in folds:
            inside = (least <= phi) & (phi <= largest)
            low[inside], high[inside] = least, largest
    return np.minimum(sign * low, sign * high).tolist(), np.maximum(sign * low, sign * high).tolist()


def largest_turn(task: ResolvedTask) -> float:
    """Return the largest angle that the search turns a hinge to, either way [rad]; 0 where there is none."""
    return max((max(-low, high) for low, high in task.folds(task.search.margin)), default=0.0)


def fold_excess(task: ResolvedTask, topology: Topology, alpha: Array) -> Array:
    """Return how far every hinge is beyond its clear folds, without any margin: negative inside them [rad]."""
    phi, folds = signs(topology) * alpha, task.folds()
    if not folds:
        return np.full_like(phi, np.pi)
    result: Array = np.min([np.maximum(low - phi, phi - high) for low, high in folds], axis=0)
    return result

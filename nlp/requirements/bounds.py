"""Bounds on the unknowns; (10) of the printed problem."""

from __future__ import annotations

import math

import numpy as np

from nlp.numbers.geometry import ranges
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array

PAPER_ROOT = {"psi": 0.0, "alpha_0": math.pi / 2, "alpha_1": math.pi / 2}
"""Largest root angles of the paper, either way [rad]; otherwise they are free."""


def variable_bounds(
    task: ResolvedTask, topology: Topology, alpha: Array | None = None
) -> tuple[list[float], list[float]]:
    """Return lower and upper bounds on the unknowns, dimensionless, in the order of `Variables.vector()`.

    Hinges keep to the ranges nearest to alpha (n-1,) [rad]; without, to what holds all of their ranges.
    """
    free, paper = (-math.inf, math.inf), task.search.root == "paper"
    bounds = [(-limit, limit) for limit in PAPER_ROOT.values()] if paper else [free] * 3
    bounds += zip(*ranges(task, topology, alpha), strict=True)
    bounds += [free] * (3 if task.end_effector.fixed_position is None else 0)
    alive = running_rotors(task).ravel()
    bounds += zip(task.min_thrust_to_weight * alive, task.max_thrust_to_weight * alive, strict=True)
    lower, upper = (list(side) for side in zip(*bounds, strict=True))
    return lower, upper


def running_rotors(task: ResolvedTask) -> Array:
    """Return 1 for each rotor that runs in a load case and 0 for one that is dead, shape (K, 4n).

    Limits of inputs times it are those of each rotor: a dead one is exempt from the least input.
    """
    alive = np.ones((len(task.load_cases), 4 * task.n))
    for k, dead in enumerate(task.dead_rotors):
        if dead is not None:
            alive[k, dead] = 0.0
    return alive

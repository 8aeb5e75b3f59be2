"""Bounds on the unknowns, and on what follows from them; (10) of the printed problem."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from nlp import names
from nlp.numbers.geometry import fold_excess, ranges
from nlp.numbers.point import Point
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array

PAPER_ROOT = {"psi": 0.0, "alpha_0": math.pi / 2, "alpha_1": math.pi / 2}
"""Largest root angles of the paper, either way [rad]; otherwise they are free."""
PLACE_TOLERANCE = 1e-9
"""Largest error of a fixed end-effector's place [l_arm]."""


class Bound(NamedTuple):
    """A bound, and how far a point is beyond it."""

    name: str
    beyond: float
    """Negative inside, in `unit`."""
    unit: str
    one: float
    """u_max, 1 rad or l_arm, in `unit`."""
    tolerance: float = 0.0
    """Largest excess of a design, over `one`."""


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


def bounds(point: Point) -> Iterator[Bound]:
    """Yield every bound with how far the point is beyond it: inputs, hinges, root, and p_E where it is bounded.

    The printed problem has no row for the end-effector's reach, and none for its place where a task fixes that: it
    is no unknown then.
    """
    task, l_arm = point.task, point.task.module.arm_length
    u, alive = point.u.reshape(len(task.load_cases), -1), running_rotors(task)
    above = (u - task.max_input * alive).max(axis=1).tolist()
    below = (task.min_input * alive - u).max(axis=1).tolist()
    for label, over, under in zip(task.case_labels, above, below, strict=True):
        yield Bound(f"{label}, largest rotor input", over, "rad^2/s^2", task.max_input)
        yield Bound(f"{label}, smallest rotor input", under, "rad^2/s^2", task.max_input)
    for i, excess in enumerate(fold_excess(task, point.topology, point.alpha).tolist(), start=1):
        yield Bound(f"hinge angle of module {i}", excess, "rad", 1.0)
    if task.search.root == "paper":
        for (name, limit), angle in zip(PAPER_ROOT.items(), point.root.tolist(), strict=True):
            yield Bound(f"root orientation, {name}", abs(angle) - limit, "rad", 1.0)
    offset, position = point.p_E - point.p_COM, task.end_effector.fixed_position
    too_far = float(np.linalg.norm(offset)) - task.farthest_end_effector(point.topology.n)
    yield Bound(names.REACH, too_far, "m", l_arm)
    if position is not None:
        yield Bound(names.POSITION, float(np.linalg.norm(offset - position)), "m", l_arm, PLACE_TOLERANCE)


def running_rotors(task: ResolvedTask) -> Array:
    """Return 1 for each rotor that runs in a load case and 0 for one that is dead, shape (K, 4n).

    Limits of inputs times it are those of each rotor: a dead one is exempt from the least input.
    """
    alive = np.ones((len(task.load_cases), 4 * task.n))
    for k, dead in enumerate(task.dead_rotors):
        if dead is not None:
            alive[k, dead] = 0.0
    return alive

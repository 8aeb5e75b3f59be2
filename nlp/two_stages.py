"""A cone that all airflow must stay in can come last: first a design without it, then the cone around that.

From a random start Ipopt has to find angles that do the wrenches, keep airflows apart and fit into the cone all at
once, while the end-effector is still far from where the cone is wide enough. A start that fails is tried again in
two stages, a homotopy of two steps: without the exterior requirements, and from that design with them, the
end-effector moved outwards until all airflow is in the cone. What the first try solves is left as it is.
`tests/benchmarks/staging.py` measures what that brings.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np

from nlp.evaluate import exposure_gaps, violations, worst
from nlp.finish import finish
from nlp.ipopt import Answer
from nlp.one_stage import Program, one_stage
from nlp.point import Point
from nlp.starts import with_inputs
from topo_search.model import Exterior, ResolvedTask, Topology
from topo_search.model.arrays import Array

DIRECTIONS = 100
"""Directions in which the end-effector is moved outwards."""
DISTANCES = np.geomspace(0.3, 300.0, 73)
"""Distances from the centroid, each a tenth more than the one before [l_arm]."""


class TwoStages:
    """The nonlinear program of a task with exterior requirements, solved in two stages where one does not do."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        """Make the whole program ready; the one of the first stage is when a start needs it."""
        self._task, self._topology = task, topology
        self._whole = one_stage(task, topology)

    @cached_property
    def _relaxed(self) -> Program:
        return one_stage(self._relaxed_task, self._topology)

    @cached_property
    def _relaxed_task(self) -> ResolvedTask:
        others = tuple(asked for asked in self._task.exposure if not isinstance(asked, Exterior))
        return self._task.model_copy(update={"exposure": others})

    def solve(self, start: Point) -> Answer:
        """Return the point that is reached in one stage, or else in two, with the iterations of all."""
        answer = self._whole.solve(start)
        if _is_design(answer.point):
            return answer
        first = self._relaxed.solve(replace(start, task=self._relaxed_task))
        iterations = answer.iterations + first.iterations
        moved = moved_out(replace(first.point, task=self._task)) if _is_design(first.point) else None
        if moved is not None:
            second = self._whole.solve(with_inputs(moved))
            iterations += second.iterations
            if _is_design(second.point):
                answer = second
        return replace(answer, iterations=iterations)


def moved_out(point: Point) -> Point | None:
    """Return the point with the end-effector as near to the centroid as its exposure requirements let it be.

    Only so many directions and distances are looked at; None if all of them are too near.
    """
    centroid, unit = point.poses[1].mean(axis=0), point.task.module.arm_length
    outwards = directions(DIRECTIONS)
    for distance in DISTANCES * unit:
        for p_E in centroid + distance * outwards:
            moved = replace(point, p_E=p_E)
            if all(np.all(gaps >= 0.0) for *_, gaps in exposure_gaps(moved)):
                return moved
    return None


def directions(count: int) -> Array:
    """Return unit vectors that are spread evenly over the sphere (a Fibonacci lattice), shape (count, 3)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, math.pi * (3.0 - math.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def _is_design(point: Point) -> bool:
    return bool(np.all(np.isfinite(point.pack()))) and worst(violations(finish(point))).met

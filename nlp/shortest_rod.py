"""The shortest rod: where the effort is flat in the rod's length, a start ends with any length.

The design is solved again from where it is, with less and less reach, as long as that adds no effort. The first
reach that adds some says what a shorter rod costs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlp.assembled import polish_with
from nlp.corners import take_in_corners, with_some
from nlp.joints import rod_of
from nlp.numbers.point import Point
from nlp.start_result import StartResult
from nlp.user_constraints import UserConstraints
from topo_search.model import ShorterRod
from topo_search.model.corners import to_corners

SAME_EFFORT = 1e-6
"""Relative difference of efforts that counts as none: the audit's tolerance."""
STEP = 0.9
"""Length of a shorter rod relative to the present one, in the first step and in the last."""


def shorten_rod(design: StartResult, constraints: UserConstraints) -> tuple[StartResult, ShorterRod | None]:
    """Return a design of the same effort with the shortest rod, to a tenth, and what a shorter one costs.

    Rods up to the length of an arm are short enough: for them, nothing is said of shorter ones.
    """
    shortest, step = design, STEP
    while (length := rod_length(shortest.point)) > design.point.task.module.arm_length:
        shorter = _solve_within(shortest, step * length, constraints)
        cost = shorter.objective / design.objective - 1 if shorter.worst.met else None
        if cost is not None and cost <= SAME_EFFORT:
            shortest, step = shorter, step**2
        elif step < STEP:
            step = STEP
        else:
            return shortest, ShorterRod(length_m=step * length, cost=cost)
    return shortest, None


def rod_length(point: Point) -> float:
    """Return the length of a design's rod [m]; zero where no rod meets its limits."""
    rod = rod_of(point)
    return 0.0 if rod is None else float(np.linalg.norm(point.p_E - rod[1]))


def _solve_within(design: StartResult, reach: float, constraints: UserConstraints) -> StartResult:
    """Return where a design leads with less reach, judged by its own task; it need not become a design again."""
    task = design.point.task
    shorter = {"end_effector": task.end_effector.model_copy(update={"largest_reach": reach})}
    narrow = to_corners(task.declared.model_copy(update=shorter))
    origin = with_some(replace(design.point, task=narrow), design.corners)
    solved = take_in_corners(narrow, design.start, origin, polish_with(constraints), constraints)
    return StartResult.at(
        design.start, replace(solved.point, task=task), solved.result, solved.corners, constraints
    )

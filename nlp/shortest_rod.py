"""The rod: its mass, and its length.

A rod that counts weighs what follows from where it ends, which is known once a design is: it is solved again from
there with that mass, until both agree. Where the effort is flat in the rod's length, a start ends with any: the
design is solved again with less and less reach, as long as that adds no effort. The first reach that adds some says
what a shorter rod costs.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nlp.corners import take_in_corners, with_some
from nlp.joints import rod_of
from nlp.numbers.point import Connector, Point, rod_path, weigh_rod, with_rod
from nlp.start_result import StartResult
from nlp.user_constraints import UserConstraints, correct_point
from topo_search.model import ShorterRod
from topo_search.model.corners import to_corners


class RodSearch(NamedTuple):
    """The search for the shortest rod of as good a design."""

    same_effort: float = 1e-6
    """Relative difference of efforts that counts as none: the audit's tolerance."""
    step: float = 0.9
    """Length of a shorter rod relative to the present one, in the first step and in the last."""
    agreed_length: float = 1e-5
    """Difference of the rod's mass before and after a solve that no solve needs to make up [m_t]."""
    most_solves: int = 8
    """Largest number of solves until a design agrees with its rod's mass."""


SEARCH = RodSearch()


def count_rods(
    results: Iterable[StartResult], constraints: UserConstraints, most_effort: float | None = None
) -> list[StartResult]:
    """Return the results of starts, those that may be the best with the mass of their rods, or all up to an effort.

    Starts that ended at the same minimum share the rod. Results that cost more without its mass than that effort,
    or than the best with it, are left as they are.
    """
    counted, listed = dict[int, StartResult](), list(results)
    for one in sorted(listed, key=lambda one: one.rank):
        best = min((other.objective for other in counted.values() if other.worst.met), default=np.inf)
        if not one.worst.met or one.objective > (most_effort or np.nextafter(best, 0)):
            break
        if id(one.point) not in counted:
            counted[id(one.point)] = count_rod(one, constraints)
    weighed = [(one, counted.get(id(one.point))) for one in listed]
    return [one if other is None else replace(other, start=one.start) for one, other in weighed]


def count_rod(design: StartResult, constraints: UserConstraints, connector: Connector | None = None) -> StartResult:
    """Solve again with the mass of the rod until design and mass agree; return the best with a rod that was tried.

    Args:
        design: the result of a start.
        constraints: constraints of the user.
        connector: where the rod starts; None: at the nearest one whose rod meets its limits, as long as that is
            another one after the solves.
    """
    if connector is not None:
        return _count_at(connector, design, constraints)
    tried, nearest = dict[Connector | None, StartResult](), rod_of(design.point)
    while nearest not in tried:  # with a rod of its own each, the solves for two connectors need not agree
        tried[nearest] = design = _count_at(nearest, design, constraints)
        nearest = rod_of(replace(design.point, task=with_rod(design.point.task, None)))
    return min(tried.values(), key=lambda one: one.rank)


def _count_at(connector: Connector | None, design: StartResult, constraints: UserConstraints) -> StartResult:
    n = design.point.topology.n
    for _ in range(SEARCH.most_solves):
        before, weighed = design.point.task.total_mass(n), _weigh(design, constraints, connector)
        agreed = abs(weighed.point.task.total_mass(n) - before) <= SEARCH.agreed_length * before
        if agreed and (weighed.worst.met or not design.worst.met):  # rotors at their limits make up for nothing
            return weighed
        origin = with_some(weighed.point, design.corners)
        design = take_in_corners(weighed.point.task, design.start, origin, constraints)
    return _weigh(design, constraints, connector)


def _weigh(design: StartResult, constraints: UserConstraints, connector: Connector | None = None) -> StartResult:
    """Return a design of the same angles with the mass that its rod has there, and inputs for it."""
    point = correct_point(weigh_rod(design.point, connector or rod_of(design.point)), constraints)
    return StartResult.at(design.start, point, design.result, design.corners, constraints)


def shorten_rod(design: StartResult, constraints: UserConstraints) -> tuple[StartResult, ShorterRod | None]:
    """Return a design of the same effort with the shortest rod, to a tenth, and what a shorter one costs.

    Rods up to the length of an arm are short enough: for them, nothing is said of shorter ones.
    """
    shortest, step = design, SEARCH.step
    while (length := rod_length(shortest.point)) > design.point.task.module.arm_length:
        shorter = _solve_within(shortest, step * length, constraints)
        least = min(design.objective, shortest.objective)  # a shorter rod that counts is a lighter one
        cost = shorter.objective / least - 1 if shorter.worst.met else None
        if cost is not None and cost <= SEARCH.same_effort:
            shortest, step = shorter, step**2
        elif step < SEARCH.step:
            step = SEARCH.step
        else:
            return shortest, ShorterRod(length_m=step * length, cost=cost)
    return shortest, None


def rod_length(point: Point) -> float:
    """Return the length of a design's rod [m]; zero where no rod meets its limits."""
    rod = rod_of(point)
    return 0.0 if rod is None else float(np.linalg.norm(rod_path(point, rod)))


def _solve_within(design: StartResult, reach: float, constraints: UserConstraints) -> StartResult:
    """Return where a design leads with less reach, judged by its own task; it need not become a design again."""
    task = design.point.task
    shorter = {"end_effector": task.end_effector.model_copy(update={"largest_reach": reach})}
    narrower = task.declared.model_copy(update=shorter)
    if (rod := task.end_effector.counted_rod) is not None:
        mass = task.end_effector.rod_linear_density * reach
        narrower = narrower.with_rod(rod.model_copy(update={"mass": mass}))
    narrow = to_corners(narrower)
    origin = with_some(replace(design.point, task=narrow), design.corners)
    solved = take_in_corners(narrow, design.start, origin, constraints)
    judged = StartResult.at(
        design.start, replace(solved.point, task=task), solved.result, solved.corners, constraints
    )
    return judged if rod is None else _weigh(judged, constraints)

"""Mass and length of the rod of a design.

The mass of a rod follows from its length, which is known only after a solve: the design is solved again with that
mass until both agree. If the effort is flat in the rod's length, a solve returns any length: the design is solved
again with less and less reach as long as that adds no effort. The first reach that adds some gives the cost of a
shorter rod.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nlp.evaluation import correct_point
from nlp.lazy_solve import solve_lazily, with_some_corners
from nlp.numbers.point import Connector, Point, rod_path, weigh_rod, with_rod
from nlp.requirements.rod import rod_of
from nlp.rows import UserConstraints
from nlp.start_result import StartResult
from topo_search.model import ShorterRod
from topo_search.model.corners import to_corners


class RodSearch(NamedTuple):
    """Settings of the search for the shortest rod at equal effort."""

    same_effort: float = 1e-6
    """Relative difference in effort that is neglected: the audit's tolerance."""
    step: float = 0.9
    """Length of a shorter rod relative to the current one, in the first and in the last step."""
    mass_tolerance: float = 1e-5
    """Largest difference of the rod's mass before and after a solve of a consistent design [m_t]."""
    max_solves: int = 8
    """Largest number of solves until a design is consistent with its rod's mass."""


SEARCH = RodSearch()


def count_rods(
    results: Iterable[StartResult], constraints: UserConstraints, most_effort: float | None = None
) -> list[StartResult]:
    """Return the results of starts; those that may be best, or all up to an effort, with the mass of their rods.

    Starts that reached the same minimum share the rod. Results that without the rod's mass already cost more than
    `most_effort`, or than the best with it, are returned unchanged.
    """
    weighed, original = dict[int, StartResult](), list(results)
    for result in sorted(original, key=lambda result: result.rank):
        best = min((other.objective for other in weighed.values() if other.worst.met), default=np.inf)
        if not result.worst.met or result.objective > (most_effort or np.nextafter(best, 0)):
            break
        if id(result.point) not in weighed:
            weighed[id(result.point)] = count_rod(result, constraints)
    return [replace(weighed.get(id(result.point), result), start=result.start) for result in original]


def count_rod(design: StartResult, constraints: UserConstraints, connector: Connector | None = None) -> StartResult:
    """Solve again with the mass of the rod until design and mass agree; return the best result.

    Args:
        design: the result of a start.
        constraints: the user's constraints.
        connector: connector of the rod; None: the nearest one whose rod meets its limits, updated until it repeats.
    """
    if connector is not None:
        return _count_at(connector, design, constraints)
    by_connector, nearest = dict[Connector | None, StartResult](), rod_of(design.point)
    while nearest not in by_connector:  # solves with the rods of two connectors need not agree
        by_connector[nearest] = design = _count_at(nearest, design, constraints)
        nearest = rod_of(replace(design.point, task=with_rod(design.point.task, None)))
    return min(by_connector.values(), key=lambda result: result.rank)


def _count_at(connector: Connector | None, design: StartResult, constraints: UserConstraints) -> StartResult:
    n = design.point.topology.n
    for _ in range(SEARCH.max_solves):
        mass, weighed = design.point.task.total_mass(n), _weigh(design, constraints, connector)
        consistent = abs(weighed.point.task.total_mass(n) - mass) <= SEARCH.mass_tolerance * mass
        lost = design.worst.met and not weighed.worst.met  # a small difference matters to rotors at their limits
        if consistent and not lost:
            return weighed
        origin = with_some_corners(weighed.point, design.corners)
        design = solve_lazily(weighed.point.task, design.start, origin, constraints)
    return _weigh(design, constraints, connector)


def _weigh(design: StartResult, constraints: UserConstraints, connector: Connector | None = None) -> StartResult:
    point = correct_point(weigh_rod(design.point, connector or rod_of(design.point)), constraints)
    return StartResult.from_point(design.start, point, design.result, design.corners, constraints)


def shorten_rod(design: StartResult, constraints: UserConstraints) -> tuple[StartResult, ShorterRod | None]:
    """Return a design of equal effort with the shortest rod, to a tenth, and the cost of a shorter one.

    Rods up to the length of an arm are not shortened, and no cost is returned for them.
    """
    shortest, step = design, SEARCH.step
    while (length := rod_length(shortest.point)) > design.point.task.module.arm_length:
        shorter = _solve_within(shortest, step * length, constraints)
        effort = min(design.objective, shortest.objective)  # a shorter rod may weigh less
        cost = shorter.objective / effort - 1 if shorter.worst.met else None
        if cost is not None and cost <= SEARCH.same_effort:
            shortest, step = shorter, step**2
        elif step < SEARCH.step:
            step = SEARCH.step
        else:
            return shortest, ShorterRod(length_m=step * length, cost=cost)
    return shortest, None


def rod_length(point: Point) -> float:
    """Return the length of a design's rod [m]; zero if no rod meets its limits."""
    rod = rod_of(point)
    return 0.0 if rod is None else float(np.linalg.norm(rod_path(point, rod)))


def _solve_within(design: StartResult, reach: float, constraints: UserConstraints) -> StartResult:
    """Return the result of a solve from a design with less reach, judged by its own task; it may be infeasible."""
    task = design.point.task
    shorter = {"end_effector": task.end_effector.model_copy(update={"largest_reach": reach})}
    narrower = task.declared.model_copy(update=shorter)
    if (rod := task.end_effector.counted_rod) is not None:
        mass = task.end_effector.rod_linear_density * reach
        narrower = narrower.with_rod(rod.model_copy(update={"mass": mass}))
    narrow = to_corners(narrower)
    origin = with_some_corners(replace(design.point, task=narrow), design.corners)
    solved = solve_lazily(narrow, design.start, origin, constraints)
    judged = StartResult.from_point(
        design.start, replace(solved.point, task=task), solved.result, solved.corners, constraints
    )
    return judged if rod is None else _weigh(judged, constraints)

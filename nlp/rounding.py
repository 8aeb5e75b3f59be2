"""Designs moved to a set of hinge angles: root, end-effector and inputs are solved again.

The design itself is the optimum near which combinations of the set are tried, not what a descent from it reaches,
which may be another optimum. For the same reason Ipopt also solves the nearest combinations from the design.
"""

from collections.abc import Iterator
from dataclasses import replace

from nlp.lazy_solve import judge
from nlp.numbers.point import Point
from nlp.solving import Solve
from nlp.start_result import StartResult
from topo_search.model import Design, Infeasible, ResolvedTask
from topo_search.model.corners import to_corners


def solve_near(design: Design, task: ResolvedTask) -> Design | Infeasible | None:
    """Return the design of least effort on a task's set of hinge angles, near a design.

    None: all combinations of angles tried bring modules too close to each other.

    Args:
        design: the design.
        task: its task, with a set of hinge angles.
    """
    from nlp.hinge_sets import near_optima, solve_nearest  # compiled code, which other commands need not load

    request = Solve(task, design.topology, range(1), 0, (), ())
    topology, constraints, results = design.topology, request.constraints, list[StartResult]()
    for limited in (task, *_within_its_rod(design, task)):
        any_angle = to_corners(limited.model_copy(update={"search": limited.search.any_angle}))
        unmoved, on_set = judge(any_angle, 0, Point.of(design), "given", constraints), to_corners(limited)
        found, _ = near_optima(on_set, topology, [unmoved], constraints)
        for one in found + solve_nearest(on_set, topology, unmoved, constraints):
            point = replace(one.point, task=to_corners(task))
            results.append(StartResult.from_point(one.start, point, one.result, one.corners, constraints))
    results = request.count_rods(results)
    if not results:
        return None
    return request.outcome(min(results, key=lambda result: result.rank), results)


def _within_its_rod(design: Design, task: ResolvedTask) -> Iterator[ResolvedTask]:
    """Yield the task with no more reach than the rod of a design, if its mass counts.

    Until results are weighed, its mass is that of the design's rod, whatever its length, so the tip moves away.
    """
    from nlp.shortest_rod import rod_length  # compiled code

    length = rod_length(Point.of(design))
    if length and task.end_effector.counted_rod is not None:
        within = task.end_effector.model_copy(update={"largest_reach": length})
        yield task.model_copy(update={"end_effector": within})

"""Designs moved to a set of hinge angles: root, end-effector and inputs are solved again.

The design itself is the optimum near which combinations of the set are tried, not what a descent from it reaches,
which may be another optimum. For the same reason Ipopt also solves the nearest combinations from the design.
"""

from __future__ import annotations

from nlp.lazy_solve import judge
from nlp.numbers.point import Point
from nlp.solving import Solve
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
    any_angle = to_corners(task.model_copy(update={"search": task.search.any_angle}))
    unmoved = judge(any_angle, 0, Point.of(design), "given", request.constraints)
    on_set, topology, constraints = to_corners(task), design.topology, request.constraints
    results, _ = near_optima(on_set, topology, [unmoved], constraints)
    results = request.count_rods(results + solve_nearest(on_set, topology, unmoved, constraints))
    if not results:
        return None
    return request.outcome(min(results, key=lambda result: result.rank), results)

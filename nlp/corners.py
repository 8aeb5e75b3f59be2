"""Solves whose corners, joint loads and air speeds are added to the program once a result violates them.

A corner is a load case that must be possible and costs nothing (`topo_search.model.corners`); few of them are
active. Whether a platform with given angles produces one is a small convex problem, so checking all of them after a
solve is cheap.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nlp.airspeed import fastest
from nlp.evaluation import worst
from nlp.ipopt import IpoptResult
from nlp.joints import LimitedLoads, holder, limited_loads, loads
from nlp.numbers.point import Point
from nlp.requirements.balances import WRENCH_TOLERANCE, wrench_residuals
from nlp.start_result import StartResult
from nlp.user_constraints import UserConstraints, correct_point, violations_of
from topo_search.model import ResolvedTask
from topo_search.model.corners import CorneredTask


class LazyConstraints(NamedTuple):
    """Settings of adding corners, joint loads and air speeds to a program."""

    load_share: float = 0.6
    """Share of its limit above which a joint load gets a row."""
    speed_share: float = 0.9
    """Share of its limit above which an air speed gets a row in the first solve."""
    rounds: int = 10
    """Largest number of solves, each with more rows than the one before."""
    at_once: int = 8
    """Largest number of corners added at once, no two of one set."""


LAZY = LazyConstraints()


def without_corners(task: ResolvedTask) -> ResolvedTask:
    """Return a task without its corners."""
    return task.with_corners(()) if isinstance(task, CorneredTask) else task


def solve_with_corners(
    task: ResolvedTask, start: int, origin: Point, constraints: UserConstraints = (), *, rounds: bool = False
) -> StartResult:
    """Solve from a point, adding corners, joint loads and air speeds until none is violated.

    Args:
        task: the task with all corners.
        start: index of the start.
        origin: initial point, of the task with some of its corners.
        constraints: the user's constraints.
        rounds: True if the origin is far from a minimum, so that rounds are needed; else one polish is enough.
    """
    from nlp.assembled import AssembledProgram  # compiled code, which other commands need not load

    near_limits = [maximum for maximum in fastest(origin) if maximum.speed > LAZY.speed_share * maximum.limit]
    speed_points = tuple(sorted({point for maximum in near_limits for point in maximum.points}))
    point, iterations, limits = origin, 0, LimitedLoads(None, (), speed_points) if speed_points else None
    for _ in range(LAZY.rounds):
        program = AssembledProgram(point.task, point.topology, constraints, limits)
        result = program.solve(point) if rounds else program.polish(point)
        iterations += result.iterations
        result = replace(result, iterations=iterations)
        reached = correct_point(result.point if result.finite else point, constraints)
        whole = with_all_corners(reached, task, constraints)
        violations = violations_of(whole, constraints)
        start_result = StartResult(start, result, whole, worst(violations), _labels(point.task))
        if start_result.worst.met:
            return start_result
        more, next_limits = _most_violated(whole, point.task), limits
        if whole is not reached:
            violations = violations_of(reached, constraints)
        violated_air = {check.name: set(check.air) for check in violations if check.air and not check.met}
        violated = {check.name for check in violations if not check.met} - violated_air.keys()
        overloaded = violated & {load.name for load in limited_loads(task, origin.topology)}
        if overloaded and (limits is None or not limits.loads or limits.tip_module not in (None, holder(reached))):
            # no loads had rows, or another module carries the end-effector now: then it may be on either side
            next_limits, violated = _near_limits(reached, limits), violated - overloaded
        if too_fast := set().union(*violated_air.values()).difference(next_limits.air if next_limits else ()):
            next_limits = next_limits or LimitedLoads(None, ())
            next_limits = next_limits._replace(air=tuple(sorted({*next_limits.air, *too_fast})))
        if violated or (not more and next_limits is limits):
            return start_result
        point, limits = with_some_corners(whole, _labels(point.task) | more) if more else reached, next_limits
    return start_result


def judge(task: ResolvedTask, start: int, point: Point, status: str, constraints: UserConstraints) -> StartResult:
    """Return a point as the result of a start without a solve, judged by the task with all corners."""
    whole = with_all_corners(point, task, constraints)
    return StartResult.from_point(start, whole, IpoptResult(point, status, 0), constraints=constraints)


def _near_limits(point: Point, previous: LimitedLoads | None) -> LimitedLoads:
    """Return rows for loads near their limits, with the end-effector on either side if there were any before."""
    either_side = previous is not None and bool(previous.loads)
    task = point.task.declared
    all_loads = limited_loads(task, point.topology)
    sizes = zip(all_loads, loads(point).tolist(), strict=True)
    near_loads = tuple(load for load, size in sizes if size > LAZY.load_share * load.limit)
    return LimitedLoads(None if either_side else holder(point), near_loads, previous.air if previous else ())


def with_all_corners(point: Point, task: ResolvedTask, constraints: UserConstraints = ()) -> Point:
    """Return a point with some corners as a corrected point with all, each with inputs of its own."""
    if len(point.task.load_cases) == len(task.load_cases):
        return point
    u = np.zeros((len(task.load_cases), *point.u.shape[1:]))
    u[_case_indices(point.task, task)] = point.u
    return correct_point(replace(point, task=task, u=u), constraints)


def _most_violated(whole: Point, solved: ResolvedTask) -> set[str]:
    """Return the labels of the most violated corners outside `solved`, at most one per set."""
    task, labels = whole.task, dict[int, str]()
    if not isinstance(task, CorneredTask):
        return set()
    declared = len(task.base.load_cases)
    residuals = wrench_residuals(whole).max(axis=1)[declared:]
    residuals[_case_indices(solved, task)[declared:] - declared] = 0.0
    for c in np.argsort(-residuals, kind="stable").tolist():
        if residuals[c] <= WRENCH_TOLERANCE or len(labels) == LAZY.at_once:
            break
        labels.setdefault(task.groups[c], task.corners[c].label)
    return set(labels.values())


def with_some_corners(whole: Point, labels: Set[str]) -> Point:
    """Return a point with all corners as one with only those of some labels."""
    task = whole.task
    if not isinstance(task, CorneredTask):
        return whole
    indices, declared = [c for c, corner in enumerate(task.corners) if corner.label in labels], task.base.load_cases
    cases = [*range(len(declared)), *(len(declared) + c for c in indices)]
    return replace(whole, task=task.with_corners(indices), u=whole.u[cases])


def _case_indices(some: ResolvedTask, task: ResolvedTask) -> np.ndarray:
    """Return the indices of the load cases of `some`, in the task with all corners, shape (K,)."""
    index = {label: k for k, label in enumerate(task.case_labels)}
    return np.array([index[label] for label in some.case_labels], dtype=np.intp)


def _labels(task: ResolvedTask) -> frozenset[str]:
    return frozenset(corner.label for corner in task.corners) if isinstance(task, CorneredTask) else frozenset()

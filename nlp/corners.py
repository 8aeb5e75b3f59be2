"""Corners in a program: taken in as they are found missed, for few of them bind.

A corner is a load case that must be possible and costs nothing (`topo_search.model.corners`). Whether a platform of
given angles produces it is a small convex problem of its own, so that all are judged after a solve at little cost.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nlp.airspeed import fastest
from nlp.evaluation import worst
from nlp.ipopt import IpoptResult
from nlp.joints import Limits, holder, limited_loads, loads
from nlp.numbers.point import Point
from nlp.requirements.balances import WRENCH_TOLERANCE, missed_wrenches
from nlp.start_result import StartResult
from nlp.user_constraints import UserConstraints, correct_point, violations_of
from topo_search.model import ResolvedTask
from topo_search.model.corners import CorneredTask


class TakingIn(NamedTuple):
    """How corners, loads in joints and air speeds are taken in."""

    near_limit: float = 0.6
    """Share of its limit from which a load in a joint is stated."""
    near_speed: float = 0.9
    """Share of its limit from which an air speed is stated from the start."""
    rounds: int = 10
    """Largest number of solves, each with more corners than the one before."""
    at_once: int = 8
    """Largest number of corners taken in at once, no two of one set."""


TAKING_IN = TakingIn()


def without_corners(task: ResolvedTask) -> ResolvedTask:
    """Return a task with its own load cases alone."""
    return task.with_corners(()) if isinstance(task, CorneredTask) else task


def take_in_corners(
    task: ResolvedTask,
    start: int,
    origin: Point,
    constraints: UserConstraints = (),
    *,
    rounds: bool = False,
) -> StartResult:
    """Return the result of a start whose program takes in corners, and loads in joints, until none is missed.

    Args:
        task: the task with all corners.
        start: index of the start.
        origin: of a task with some of them.
        constraints: constraints of the user, to which the point is held as well.
        rounds: whether the origin is any point, from which rounds lead; else a polish is enough.
    """
    from nlp.assembled import AssembledProgram  # compiled code, which other commands need not load

    near_limits = [at for at in fastest(origin) if at.speed > TAKING_IN.near_speed * at.limit]
    first = tuple(sorted({point for at in near_limits for point in at.points}))
    point, iterations, limits = origin, 0, Limits(None, (), first) if first else None
    for _ in range(TAKING_IN.rounds):
        program = AssembledProgram(point.task, point.topology, constraints, limits)
        result = program.solve(point) if rounds else program.polish(point)
        iterations += result.iterations
        result = replace(result, iterations=iterations)
        reached = correct_point(result.point if result.finite else point, constraints)
        whole = with_all(reached, task, constraints)
        checks = violations_of(whole, constraints)
        outcome = StartResult(start, result, whole, worst(checks), _labels(point.task))
        if outcome.worst.met:
            return outcome
        more, near = _most_missed(whole, point.task), limits
        if whole is not reached:
            checks = violations_of(reached, constraints)
        air = {check.name: set(check.air) for check in checks if check.air and not check.met}
        lacking = {check.name for check in checks if not check.met} - air.keys()
        overloaded = lacking & {load.name for load in limited_loads(task, origin.topology)}
        if overloaded and (limits is None or not limits.loads or limits.held not in (None, holder(reached))):
            # another holder than the limits are of: of both sides they hold whichever it is
            near, lacking = _near(reached, limits), lacking - overloaded
        if faster := set().union(*air.values()).difference(near.air if near else ()):
            near = near or Limits(None, ())
            near = near._replace(air=tuple(sorted({*near.air, *faster})))
        if lacking or (not more and near is limits):
            return outcome
        point, limits = with_some(whole, _labels(point.task) | more) if more else reached, near
    return outcome


def judge(task: ResolvedTask, start: int, point: Point, status: str, constraints: UserConstraints) -> StartResult:
    """Return the outcome of a start at a point where no solver went on, judged by the task with all corners."""
    whole = with_all(point, task, constraints)
    return StartResult.at(start, whole, IpoptResult(point, status, 0), constraints=constraints)


def _near(point: Point, before: Limits | None) -> Limits:
    """Return the loads that are not far below their limits, if need be of either side of their joints."""
    either = before is not None and bool(before.loads)
    task = point.task.declared
    listed = limited_loads(task, point.topology)
    sizes = zip(listed, loads(point).tolist(), strict=True)
    near = tuple(load for load, size in sizes if size > TAKING_IN.near_limit * load.limit)
    return Limits(None if either else holder(point), near, before.air if before else ())


def with_all(point: Point, task: ResolvedTask, constraints: UserConstraints = ()) -> Point:
    """Return a corrected point of a task with some corners as one of all, those with inputs of their own."""
    if len(point.task.load_cases) == len(task.load_cases):
        return point
    u = np.zeros((len(task.load_cases), *point.u.shape[1:]))
    u[_places(point.task, task)] = point.u
    return correct_point(replace(point, task=task, u=u), constraints)


def _most_missed(whole: Point, had: ResolvedTask) -> set[str]:
    """Return the labels of the corners that are missed most and were not had, one of a set."""
    task, taken = whole.task, dict[int, str]()
    if not isinstance(task, CorneredTask):
        return set()
    declared = len(task.base.load_cases)
    missed = missed_wrenches(whole).max(axis=1)[declared:]
    missed[_places(had, task)[declared:] - declared] = 0.0
    for c in np.argsort(-missed, kind="stable").tolist():
        if missed[c] <= WRENCH_TOLERANCE or len(taken) == TAKING_IN.at_once:
            break
        taken.setdefault(task.groups[c], task.corners[c].label)
    return set(taken.values())


def with_some(whole: Point, named: Set[str]) -> Point:
    """Return a point of all corners as one of those with some labels alone."""
    task = whole.task
    if not isinstance(task, CorneredTask):
        return whole
    kept, declared = [c for c, corner in enumerate(task.corners) if corner.label in named], task.base.load_cases
    cases = [*range(len(declared)), *(len(declared) + c for c in kept)]
    return replace(whole, task=task.with_corners(kept), u=whole.u[cases])


def _places(some: ResolvedTask, task: ResolvedTask) -> np.ndarray:
    """Return where the load cases of a task with some corners are in that with all, shape (K,)."""
    where = {label: k for k, label in enumerate(task.case_labels)}
    return np.array([where[label] for label in some.case_labels], dtype=np.intp)


def _labels(task: ResolvedTask) -> frozenset[str]:
    return frozenset(corner.label for corner in task.corners) if isinstance(task, CorneredTask) else frozenset()

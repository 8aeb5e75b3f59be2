"""Solves whose corners and lazy rows (`nlp.rows`) are added to the program once a result violates them.

A corner is a load case that must be possible and costs nothing (`topo_search.model.corners`); few of them are
active. Whether a platform with given angles produces one is a small convex problem, so checking all of them after a
solve is cheap.
"""

from collections.abc import Set
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nlp.evaluation import correct_point, violations, worst
from nlp.features import LAZY_ROWS
from nlp.ipopt import IpoptResult
from nlp.numbers.point import Point
from nlp.requirements.balances import WRENCH_TOLERANCE, wrench_residuals
from nlp.rows import Selections, UserConstraints
from nlp.start_result import StartResult
from topo_search.model import CorneredTask, ResolvedTask


class LazyConstraints(NamedTuple):
    """Settings of adding corners and lazy rows to a program."""

    solves: int = 10
    """Largest number of solves, each with more rows than the one before."""
    at_once: int = 8
    """Largest number of corners added at once, no two of one set."""


LAZY = LazyConstraints()


def without_corners(task: ResolvedTask) -> ResolvedTask:
    """Return a task without its corners."""
    return task.with_corners(()) if isinstance(task, CorneredTask) else task


def solve_lazily(
    task: ResolvedTask, start: int, origin: Point, constraints: UserConstraints = (), *, far: bool = False
) -> StartResult:
    """Solve from a point, adding corners and lazy rows until none is violated.

    Args:
        task: the task with all corners.
        start: index of the start.
        origin: initial point, of the task with some of its corners.
        constraints: the user's constraints.
        far: True if the origin is far from a minimum, so that Ipopt runs in rounds; else one polish is enough.
    """
    from nlp.program import AssembledProgram  # compiled code, which other commands need not load

    point, iterations = origin, 0
    selections: Selections = {kind: kind.select(origin) for kind in LAZY_ROWS}
    for _ in range(LAZY.solves):
        program = AssembledProgram(point.task, point.topology, constraints, selections)
        result = program.solve(point) if far else program.polish(point)
        iterations += result.iterations
        result = replace(result, iterations=iterations)
        reached = correct_point(result.point if result.finite else point, constraints)
        whole = with_all_corners(reached, task, constraints)
        checks = violations(whole, constraints)
        start_result = StartResult(start, result, whole, worst(checks), _labels(point.task))
        if start_result.worst.met:
            return start_result
        corners = most_violated(whole, point.task)
        if whole is not reached:
            checks = violations(reached, constraints)
        violated = [check for check in checks if not check.met]
        extended = {kind: kind.extend(reached, violated, selection) for kind, selection in selections.items()}
        may_end = set[str]().union(*(names for _, names in extended.values()))
        next_selections = {kind: selection for kind, (selection, _) in extended.items()}
        if any(check.name not in may_end for check in violated) or (not corners and next_selections == selections):
            return start_result
        point = with_some_corners(whole, _labels(point.task) | corners) if corners else reached
        selections = next_selections
    return start_result


def judge(task: ResolvedTask, start: int, point: Point, status: str, constraints: UserConstraints) -> StartResult:
    """Return a point as the result of a start without a solve, judged by the task with all corners."""
    whole = with_all_corners(point, task, constraints)
    return StartResult.from_point(start, whole, IpoptResult(point, status, 0), constraints=constraints)


def with_all_corners(point: Point, task: ResolvedTask, constraints: UserConstraints = ()) -> Point:
    """Return a point with some corners as a corrected point with all, each with inputs of its own."""
    if len(point.task.load_cases) == len(task.load_cases):
        return point
    u = np.zeros((len(task.load_cases), *point.u.shape[1:]))
    u[_case_indices(point.task, task)] = point.u
    return correct_point(replace(point, task=task, u=u), constraints)


def most_violated(whole: Point, solved: ResolvedTask) -> set[str]:
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

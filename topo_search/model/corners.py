"""Sets of wrenches, reserves and rotor failures as single wrenches: corners.

For fixed angles the feasible inputs are a convex set and wrenches are linear in them: if all corners of a set of
wrenches can be produced, so can the whole set. A corner is a load case that must be possible and adds no effort.
Few corners are active, so a solver may start without any and add those that it violates.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from topo_search.model.features import CORNER_SETS, AskedFlight
from topo_search.model.kinds import Vector
from topo_search.model.load_case import Corner, LoadCase
from topo_search.model.task import ResolvedTask


class CorneredTask(ResolvedTask):
    """Task whose sets of wrenches are expanded: its own load cases, then the corners of all sets."""

    base: ResolvedTask
    """Task without expansion, as in a design file."""
    corners: tuple[Corner, ...]
    """Corners, after the task's own load cases."""
    groups: tuple[int, ...]
    """Number of the set of each corner."""

    @property
    def case_labels(self) -> tuple[str, ...]:
        """Names of the load cases and corners."""
        return (*self.base.case_labels, *(corner.label for corner in self.corners))

    @property
    def dead_rotors(self) -> tuple[int | None, ...]:
        """Number of the dead rotor in each load case and corner, or None."""
        return (*self.base.dead_rotors, *(corner.dead for corner in self.corners))

    @property
    def accelerations(self) -> tuple[Vector, ...]:
        """Angular acceleration of the platform in each load case and corner [rad/s^2]."""
        return (*self.base.accelerations, *(corner.acceleration for corner in self.corners))

    @property
    def declared(self) -> ResolvedTask:
        """Task without expansion, as in a design file."""
        return self.base

    def with_corners(self, corners: Iterable[int]) -> CorneredTask:
        """Return the task with only these corners."""
        numbers = sorted(corners)
        return _with_corners(self.base, [self.corners[c] for c in numbers], [self.groups[c] for c in numbers])


@lru_cache(maxsize=32)
def to_corners(task: ResolvedTask, *, inner: bool = False) -> ResolvedTask:
    """Return the task with sets of wrenches, reserves and failures expanded to corners; itself if there are none.

    Args:
        task: the task.
        inner: True for only those wrenches that every clear design can produce, for proofs: points of the balls of
            reserves, and the bare load cases after a failure. Both are dropped if `search.peak_input` is less than
            1, because that limit does not apply to them.
    """
    if isinstance(task, CorneredTask):
        return task
    sets = [[Corner(*corner)] for corner in corners_of(task)]
    if not inner or task.search.peak_input == 1:
        sets += [corners for expand in CORNER_SETS for corners in expand(task, inner=inner)]
    if not sets:
        return task
    groups = [number for number, corners in enumerate(sets) for _ in corners]
    return _with_corners(task, [corner for corners in sets for corner in corners], groups)


def corners_of(task: ResolvedTask) -> list[tuple[str, LoadCase]]:
    """Return the labelled corners of all sets of wrenches."""
    return [
        (f"{label}, corner {number}", corner)
        for label, case in zip(task.case_labels, task.load_cases, strict=True)
        for number, corner in enumerate(case.corners)
    ]


def _with_corners(task: ResolvedTask, corners: list[Corner], groups: list[int]) -> CorneredTask:
    """Return a task with corners as load cases, unvalidated: there may be more than in any file."""
    single = (case.model_copy(update={"cone": None, "vertices": ()}) for case in task.load_cases)
    cases = (*single, *(corner.case for corner in corners))
    fields = {**dict(task), "load_cases": cases, "flight": AskedFlight()}
    return CorneredTask.model_construct(**fields, base=task, corners=tuple(corners), groups=tuple(groups))

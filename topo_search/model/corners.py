"""Load cases that stand for a set of wrenches, as the single wrenches that decide about it.

For fixed angles the inputs of a load case are a convex set and wrenches are linear in them: if the corners of a set
of wrenches can be produced, so can all of it. A corner is a load case that must be possible and costs nothing. Few
of them bind, so that a solver may begin without any and take in those that it finds missed.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from topo_search.model.load_case import AskedFlight, Corner, LoadCase, failure_corners, reserve_corners
from topo_search.model.task import ResolvedTask
from topo_search.model.value import Vector


class CorneredTask(ResolvedTask):
    """A task whose sets of wrenches are written out: its own load cases first, then the corners of sets."""

    base: ResolvedTask
    """The task as it stands in a design."""
    corners: tuple[Corner, ...]
    """Corners that follow its own load cases."""
    groups: tuple[int, ...]
    """Number of the set that each corner belongs to."""

    @property
    def case_labels(self) -> tuple[str, ...]:
        """Names of the load cases and corners."""
        return (*self.base.case_labels, *(corner.label for corner in self.corners))

    @property
    def dead_rotors(self) -> tuple[int | None, ...]:
        """The rotor that does not run in each load case and corner."""
        return (*self.base.dead_rotors, *(corner.dead for corner in self.corners))

    @property
    def accelerations(self) -> tuple[Vector, ...]:
        """Angular acceleration of the platform in each load case and corner [rad/s^2]."""
        return (*self.base.accelerations, *(corner.acceleration for corner in self.corners))

    @property
    def declared(self) -> ResolvedTask:
        """The task as it stands in a design."""
        return self.base

    def with_corners(self, corners: Iterable[int]) -> CorneredTask:
        """Return the task with these of its corners alone."""
        kept = sorted(corners)
        return _with_corners(self.base, [self.corners[c] for c in kept], [self.groups[c] for c in kept])


@lru_cache(maxsize=32)
def to_corners(task: ResolvedTask, *, inner: bool = False) -> ResolvedTask:
    """Return the task with every set of wrenches, reserve and failure as corners; the task itself without any.

    Args:
        task: the task.
        inner: whether only what every clear design must be able to do is stated, for proofs: of reserves points of
            the balls themselves, with a rotor dead the case alone; neither where `search.peak_input` is less than
            1, a limit that they do not obey.
    """
    if isinstance(task, CorneredTask):
        return task
    sets = [[Corner(*corner)] for corner in corners_of(task)]
    if not inner or task.search.peak_input == 1:
        sets += reserve_corners(task, inner=inner)
        sets += failure_corners(task, inner=inner)
    if not sets:
        return task
    groups = [number for number, corners in enumerate(sets) for _ in corners]
    return _with_corners(task, [corner for corners in sets for corner in corners], groups)


def corners_of(task: ResolvedTask) -> list[tuple[str, LoadCase]]:
    """Return the corners of all sets of wrenches with what they are called."""
    return [
        (f"{label}, corner {number}", corner)
        for label, case in zip(task.case_labels, task.load_cases, strict=True)
        for number, corner in enumerate(case.corners)
    ]


def _with_corners(task: ResolvedTask, corners: list[Corner], groups: list[int]) -> CorneredTask:
    """Return a task that was checked before with corners written out, maybe more than a file may have."""
    single = (case.model_copy(update={"cone": None, "vertices": ()}) for case in task.load_cases)
    cases = (*single, *(corner.case for corner in corners))
    fields = {**dict(task), "load_cases": cases, "flight": AskedFlight()}
    return CorneredTask.model_construct(**fields, base=task, corners=tuple(corners), groups=tuple(groups))

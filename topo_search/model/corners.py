"""Load cases that stand for a set of wrenches, as the single wrenches that decide about it.

For fixed angles the inputs of a load case are a convex set and wrenches are linear in them: if the corners of a set
of wrenches can be produced, so can all of it. A corner is a load case that must be possible and costs nothing.
"""

from __future__ import annotations

from functools import lru_cache

from topo_search.model.load_case import LoadCase
from topo_search.model.reserves import AskedFlight, reserve_corners
from topo_search.model.task import ResolvedTask


class CorneredTask(ResolvedTask):
    """A task whose sets of wrenches are written out: its own load cases first, then the corners of all sets."""

    stated: ResolvedTask
    """The task as it stands in a design."""
    corner_labels: tuple[str, ...]
    """What the corners are called."""

    @property
    def case_labels(self) -> tuple[str, ...]:
        """What the load cases and corners are called."""
        return (*self.stated.case_labels, *self.corner_labels)

    @property
    def declared(self) -> ResolvedTask:
        """The task as it stands in a design."""
        return self.stated


@lru_cache(maxsize=32)
def cornered(task: ResolvedTask, *, inner: bool = False) -> ResolvedTask:
    """Return the task with every set of wrenches, and every reserve, as corners; the task itself if there is none.

    Args:
        task: the task.
        inner: whether only what every clear design must be able to do is stated, for proofs: of reserves points of
            the balls themselves, and none where `search.peak_input` is less than 1, which does not bind them.
    """
    if isinstance(task, CorneredTask):
        return task
    corners = corners_of(task)
    if not inner or task.search.peak_input == 1:
        corners += reserve_corners(task, inner=inner)
    if not corners:
        return task
    single = tuple(case.model_copy(update={"cone": None, "vertices": ()}) for case in task.load_cases)
    fields = {**dict(task), "load_cases": (*single, *(case for _, case in corners)), "flight": AskedFlight()}
    return CorneredTask(**fields, stated=task, corner_labels=tuple(label for label, _ in corners))


def corners_of(task: ResolvedTask) -> list[tuple[str, LoadCase]]:
    """Return the corners of all sets of wrenches with what they are called."""
    return [
        (f"{label}, corner {number}", corner)
        for label, case in zip(task.case_labels, task.load_cases, strict=True)
        for number, corner in enumerate(case.corners)
    ]

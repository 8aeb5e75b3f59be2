"""Limits on air speed as lazy rows, for the points of regions where air is fast."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from nlp.air.fastest import ALLOWED_SHARE, SpeedPoint, fastest
from nlp.numbers.point import Point
from nlp.rows import Violation
from topo_search.model import ResolvedTask, Topology

if TYPE_CHECKING:
    from nlp.air.program_rows import SpeedRows
    from nlp.assembled.problem import AssembledProblem

FIRST_SHARE = 0.9
"""Share of its limit above which an air speed gets a row in the first program."""
SpeedPoints = tuple[SpeedPoint, ...]


class SpeedLimits:
    """Rows of air speeds; a selection consists of the points that have some."""

    one_round = True  # more rounds would discard results with faster air between points

    def functions(self, task: ResolvedTask) -> Sequence[Any]:
        """Return the search for the fastest air and the derivatives of rows, if the task limits a speed."""
        if all(exposure.speed is None for exposure in task.exposure):
            return ()
        from nlp.air.jets import climb
        from nlp.air.program_rows import derive_speeds

        return climb, derive_speeds

    def violations(self, point: Point) -> Iterator[Violation]:
        """Yield the violation of every limit in every load case, named as in the audit."""
        for maximum in fastest(point):
            exposure = point.task.exposure[maximum.exposure]
            name = f"air over exposure {maximum.exposure} ({exposure.kind}), {point.task.case_labels[maximum.case]}"
            excess = maximum.speed - ALLOWED_SHARE * maximum.limit
            yield Violation(name, excess, "m/s", excess / maximum.limit, to_add=maximum.points)

    def select(self, origin: Point, *, everything: bool = False) -> SpeedPoints | None:
        """Return the points of all speeds near their limits."""
        share = 0.0 if everything else FIRST_SHARE
        near_limits = [maximum for maximum in fastest(origin) if maximum.speed > share * maximum.limit]
        return tuple(sorted({point for maximum in near_limits for point in maximum.points})) or None

    def extend(
        self, point: Point, violated: Sequence[Violation], selection: SpeedPoints | None
    ) -> tuple[SpeedPoints | None, set[str]]:
        """Return the points with those of violated limits added, and the names of these limits."""
        too_fast = [
            violation for violation in violated if isinstance(next(iter(violation.to_add), None), SpeedPoint)
        ]
        points = set(selection or ()).union(*(violation.to_add for violation in too_fast))
        return tuple(sorted(points)) or None, {violation.name for violation in too_fast}

    def rows(
        self, program: AssembledProblem, task: ResolvedTask, topology: Topology, selection: SpeedPoints
    ) -> SpeedRows:
        """Return the rows of points."""
        from nlp.air.program_rows import SpeedRows  # compiled code, which most tasks need not load

        return SpeedRows(program, task, selection)

"""Result of one start of a solve, with its worst violation."""

from __future__ import annotations

from dataclasses import dataclass

from nlp.evaluation import violations, worst
from nlp.ipopt import IpoptResult
from nlp.numbers.point import Point
from nlp.rows import UserConstraints, Violation


@dataclass(frozen=True)
class StartResult:
    """Result of one start."""

    start: int
    """Index of the start; -1, -2, ... for the first, second, ... design carried over."""
    result: IpoptResult
    """Result of Ipopt."""
    point: Point
    """The corrected result."""
    worst: Violation
    corners: frozenset[str] = frozenset()
    """Labels of the corners in the last program."""

    @classmethod
    def from_point(
        cls,
        start: int,
        point: Point,
        result: IpoptResult,
        corners: frozenset[str] = frozenset(),
        constraints: UserConstraints = (),
    ) -> StartResult:
        """Return the result of a start at a point, with the corners of its last program."""
        return cls(start, result, point, worst(violations(point, constraints)), corners)

    @property
    def objective(self) -> float:
        """J [rad^4/s^4]."""
        return self.point.objective

    @property
    def rank(self) -> tuple[bool, float, int]:
        """Sort key: feasible first, then by objective or violation; ties by index of the start."""
        met = self.worst.met
        return not met, self.objective if met else self.worst.rank, self.start

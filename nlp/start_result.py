"""End of one start of a solve, judged."""

from __future__ import annotations

from dataclasses import dataclass

from nlp.evaluation import Violation, worst
from nlp.ipopt import IpoptResult
from nlp.numbers.point import Point
from nlp.user_constraints import UserConstraints, violations_of


@dataclass(frozen=True)
class StartResult:
    """One start's outcome."""

    start: int
    """Its index; -1, -2, ... for the first, second, ... design carried over."""
    result: IpoptResult
    """Result of Ipopt."""
    point: Point
    """Point that was reached, as a file can hold it."""
    worst: Violation
    corners: frozenset[str] = frozenset()
    """Names of the corners in its last program."""

    @classmethod
    def at(
        cls,
        start: int,
        point: Point,
        result: IpoptResult,
        corners: frozenset[str] = frozenset(),
        constraints: UserConstraints = (),
    ) -> StartResult:
        """Return the outcome of a start that reached a point, whose program had some corners."""
        return cls(start, result, point, worst(violations_of(point, constraints)), corners)

    @property
    def objective(self) -> float:
        """J [rad^4/s^4]."""
        return self.point.objective

    @property
    def rank(self) -> tuple[bool, float, int]:
        """Feasible first, then the least objective or the least violation; the earlier start breaks ties."""
        met = self.worst.met
        return not met, self.objective if met else self.worst.rank, self.start

"""Where one start of a solve ended, judged."""

from __future__ import annotations

from dataclasses import dataclass

from nlp.evaluate import Violation, violations, worst
from nlp.finish import finish
from nlp.ipopt import Answer
from nlp.point import Point


@dataclass(frozen=True)
class Trial:
    """One start's outcome."""

    start: int
    """Its index; -1, -2, ... for the first, second, ... design carried over."""
    answer: Answer
    """What Ipopt said."""
    point: Point
    """What was reached, as a file can hold it."""
    worst: Violation

    @classmethod
    def at(cls, start: int, point: Point, answer: Answer) -> Trial:
        """Return the outcome of a start that reached a point."""
        return cls(start, answer, point, worst(violations(point)))

    @classmethod
    def of(cls, start: int, origin: Point, answer: Answer) -> Trial:
        """Return the outcome of Ipopt's answer from an origin.

        An evaluation that failed leaves no numbers behind: then the origin is what was reached.
        """
        return cls.at(start, finish(answer.point if answer.finite else origin), answer)

    @property
    def objective(self) -> float:
        """J [rad^4/s^4]."""
        return self.point.objective

    @property
    def rank(self) -> tuple[bool, float, int]:
        """Feasible first, then the least objective or the least violation; the earlier start breaks ties."""
        met = self.worst.met
        return not met, self.objective if met else self.worst.rank, self.start

"""Every constraint of a point evaluated again in numpy, exactly: no smoothing, no margin, no word of Ipopt's.

A point is a design when nothing here is violated by more than the tolerances; else the worst violation is the
reason that a user reads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from nlp import airspeed
from nlp.joints import limit_of, limited_loads, loads, name_of
from nlp.numbers.point import Point
from nlp.requirements import balances, bounds, clearances
from nlp.requirements.balances import missed_wrenches

LOAD_TOLERANCE = 1e-7
"""Tolerance of a joint's load above the largest [m_t g, l_arm m_t g]; the audit allows TOLERANCE."""


@dataclass(frozen=True)
class Violation:
    """Violation of one constraint at a point."""

    name: str
    amount: float
    """Positive when violated, zero or negative when met, in `unit`."""
    unit: str
    scaled: float
    """The same in l_arm, m_t g, l_arm m_t g or rad, so that different kinds compare."""
    tolerance: float = 0.0
    """Largest `scaled` of a met constraint."""
    air: tuple[airspeed.SpeedPoint, ...] = ()
    """Points at which a program states an air speed; empty for other constraints."""

    @property
    def met(self) -> bool:
        """True if the constraint holds; NaN never does."""
        return bool(self.scaled <= self.tolerance)

    @property
    def rank(self) -> float:
        """Excess over its tolerance; NaN is the largest."""
        return math.inf if math.isnan(self.scaled) else self.scaled - self.tolerance


def violations(point: Point) -> list[Violation]:
    """Return every constraint of the problem with its violation."""
    return [*_balances(point), *_clearances(point), *_joints(point), *_air(point), *_bounds(point)]


def worst(checks: list[Violation]) -> Violation:
    """Return the constraint that is furthest from being met."""
    return max(checks, key=lambda check: check.rank)


def _balances(point: Point) -> Iterator[Violation]:
    for stated, missed in zip(balances(point.task), missed_wrenches(point).ravel().tolist(), strict=True):
        yield Violation(stated.name, missed * stated.one, stated.unit, missed, stated.tolerance)


def _joints(point: Point) -> Iterator[Violation]:
    task, n = point.task, point.topology.n
    for load, size in zip(limited_loads(task, point.topology), loads(point).tolist(), strict=True):
        excess, unit = size - limit_of(task, load), task.torque_unit(n) if load.moment else task.force_unit(n)
        yield Violation(name_of(task, load), excess, "N m" if load.moment else "N", excess / unit, LOAD_TOLERANCE)


def _air(point: Point) -> Iterator[Violation]:
    for at in airspeed.fastest(point):
        excess = at.speed - airspeed.ALLOWED * at.limit
        yield Violation(airspeed.name_of(point.task, at), excess, "m/s", excess / at.limit, air=at.points)


def _clearances(point: Point) -> Iterator[Violation]:
    l_arm = point.task.module.arm_length
    for requirement in clearances(point.task, point.topology):
        gaps = requirement.gaps(point.vectors).ravel().tolist()
        for (name, _, _), gap in zip(requirement.rows(), gaps, strict=True):
            yield Violation(name, -gap * l_arm, "m", -gap)


def _bounds(point: Point) -> Iterator[Violation]:
    for bound in bounds(point):
        yield Violation(bound.name, bound.beyond, bound.unit, bound.beyond / bound.one, bound.tolerance)

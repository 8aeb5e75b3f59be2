"""The most capable design of one topology: the largest value of the task's maximised quantity.

From every local optimum of the task without the quantity the solver climbs to a largest value (`nlp.climbing`).
Then all starts are asked for a design of a larger value, until none has one. A reserve is a ball, of which the
solver sees some directions; those in which the audit finds a design weakest are added until both agree. A design
that fails its audit is solved with a larger margin, as in every run.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import verify
from topo_search.engine import Job
from topo_search.engine.workers import AuditDesign
from topo_search.model import Design, Infeasible, ResolvedTask, Status
from topo_search.model.kinds import Vector
from topo_search.model.maximized import RESERVES, measure, sample_directions, step_of, task_at
from topo_search.own_constraint import OwnConstraint
from topo_search.study.request import Margins


class Maximizing(NamedTuple):
    """Settings of the search for the largest value."""

    asks: int = 10
    """Largest number of times that all starts are asked for a larger value."""
    rounds: int = 10
    """Largest number of rounds of a climb, each with the directions that the one before violates."""


MAXIMIZING = Maximizing()


@dataclass
class MostCapable:
    """The search for the most capable design of one job."""

    job: Job
    solve: Callable[[Job], Design | Infeasible]
    local_optima: Callable[[Job, float], list[Design]]
    audit: AuditDesign
    constraints: tuple[OwnConstraint, ...] = ()
    towards: list[Vector] = field(default_factory=list)
    """Directions of a reserve that the solver sees."""

    def __post_init__(self) -> None:
        """Begin with the task's own margin, and with directions all around."""
        task = self.job.task
        self.margins = Margins.of(task)
        if task.search.maximize in RESERVES:
            disc = task.search.maximize == "force_reserve" and task.flight.directions == "horizontal"
            self.towards += sample_directions(disc=disc)

    def best(self) -> Design | Infeasible:
        """Return the most capable design, or why none reaches the job's value."""
        best, goal = None, self.job.reach
        if not goal:
            optima = self.local_optima(self._job(goal), math.inf)
            best = self._clear(max(map(self._climb, optima), key=_value)) if optima else None
        for _ in range(MAXIMIZING.asks):
            goal = goal if best is None else _value(best) + step_of(self.job.task, _value(best))
            outcome = self.solve(self._job(goal))
            if isinstance(outcome, Infeasible):
                return best or outcome
            climbed = self._clear(self._climb(outcome))
            if best is not None and _value(climbed) < goal:
                break
            best = climbed if _value(climbed) >= goal else best
        return best or climbed

    @property
    def _base(self) -> ResolvedTask:
        """The task with the current margin, and the directions that the solver sees."""
        return self.margins.task.with_fields("search", towards=tuple(self.towards))

    def _job(self, value: float) -> Job:
        """Return the job that asks for a value in the directions that the solver sees."""
        return replace(self.job, task=task_at(self._base, value))

    def _climb(self, design: Design) -> Design:
        """Return the largest value near a design, as the audit measures it."""
        from nlp.climbing import climb  # compiled code, which other commands need not load

        reached = list[Design]()
        for _ in range(MAXIMIZING.rounds):
            design = climb(self._base, design, self.constraints)
            measured, weakest = self._measure(design)
            reached.append(measured)
            new = [v for v in weakest if v not in self.towards]
            if _value(design) - _value(measured) <= step_of(self.job.task, _value(design)) or not new:
                break
            self.towards += new
        return max(reached, key=_value)

    def _clear(self, design: Design) -> Design:
        """Return a design of almost the same value with a clear audit; if margins do not help, one without."""
        design = self._settle(design)
        while (audit := self.audit(design)).verdict is not Status.CLEAR and self.margins.raise_after(audit):
            design = self._settle(self._climb(design))
        return design

    def _settle(self, best: Design) -> Design:
        """Return the design of least effort near one, with almost its value and the rod of the task."""
        value = max(0.0, _value(best) - step_of(self.job.task, _value(best)) / 2)
        cheapest = self.solve(replace(self._job(value), starts=range(0), near=(best,)))
        return self._measure(cheapest)[0] if isinstance(cheapest, Design) else best

    def _measure(self, design: Design) -> tuple[Design, tuple[Vector, ...]]:
        """Return a design for the task of the value that it holds, and the directions in which it is weakest."""
        if design.task.search.maximize not in RESERVES:
            return design, ()
        value, weakest = measure(design.task, verify.case_reserves(design))
        task = task_at(self.margins.task.with_rod(design.task.end_effector.counted_rod), value)
        return design.model_copy(update={"task": task}), weakest


def _value(design: Design) -> float:
    return design.value or 0.0

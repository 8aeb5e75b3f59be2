"""The most capable design of one topology: the largest value of the task's maximised quantity.

From every local optimum of the task without the quantity the solver climbs to a largest value (`nlp.climbing`).
Then all starts are asked for a design of a larger value, until none has one. A reserve is a ball, of which the
solver sees some directions, few when all starts are asked; those in which the audit finds a design weakest are
added until both agree. Meanwhile the platform keeps its angle about the vertical; else, in hover, it would turn its
weakest directions out of sight. A design that fails its audit is solved with a larger margin, as in every run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import verify
from topo_search.engine import Job
from topo_search.engine.workers import AuditDesign
from topo_search.model import Audit, Design, Infeasible, ResolvedTask, Status, Vector
from topo_search.model.maximized import RESERVES, growing_cases, measure, sample_directions, step_of, task_at
from topo_search.own_constraint import OwnConstraint
from topo_search.study.request import Margins


class Maximizing(NamedTuple):
    """Settings of the search for the largest value."""

    asks: int = 10
    """Largest number of times that all starts are asked for a larger value."""
    rounds: int = 10
    """Largest number of rounds of a climb, each with the directions that the one before violates."""
    shares: tuple[float, ...] = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
    """Shares of a load or payload at which air speeds are audited too."""


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
    coarse: tuple[Vector, ...] = ()
    """Directions for which all starts are asked."""

    def __post_init__(self) -> None:
        """Begin with the task's own margin, and with directions all around."""
        task = self.job.task
        self.margins = Margins.of(task)
        if task.search.maximize in RESERVES:
            self.towards += sample_directions(task)
            self.coarse = sample_directions(task, coarse=True)

    def best(self) -> Design | Infeasible:
        """Return the most capable design, or why none reaches the job's value."""
        best, goal = None, self.job.reach
        if not goal:
            optima = self.local_optima(self._job(goal, ()), math.inf)
            summits = [self._climb(design, rounds=1) for design in optima]
            best = self._clear(self._climb(max(summits, key=_value))) if summits else None
        for _ in range(MAXIMIZING.asks):
            goal = goal if best is None else _value(best) + step_of(self.job.task, _value(best))
            outcome = self.solve(self._job(goal, self.coarse))
            if isinstance(outcome, Infeasible):
                return best or outcome
            climbed = self._clear(self._climb(outcome))
            if _value(climbed) < goal:
                return best or climbed
            best = climbed
        return best or climbed

    @property
    def _base(self) -> ResolvedTask:
        """The task with the current margin, and the directions that the solver sees."""
        return self.margins.task.with_fields("search", towards=tuple(self.towards))

    def _job(self, value: float, towards: Sequence[Vector]) -> Job:
        """Return the job that asks for a value in some directions."""
        return replace(self.job, task=task_at(self._base, value).with_fields("search", towards=tuple(towards)))

    def _climb(self, design: Design, rounds: int = MAXIMIZING.rounds) -> Design:
        """Return the largest value near a design, as the audit measures it."""
        from nlp.climbing import climb  # compiled code, which other commands need not load

        reached = list[Design]()
        for turn in range(rounds):
            design = climb(self._base, design, self.constraints, turns=not turn)
            measured, weakest = self._measure(design)
            reached.append(measured)
            short = _value(design) - _value(measured)
            if short <= step_of(self.job.task, _value(design)) or not self._see(weakest):
                break
        return max(reached, key=_value)

    def _see(self, directions: Sequence[Vector]) -> bool:
        """Add directions to those that the solver sees, and return whether any is new."""
        new = [v for v in directions if v not in self.towards]
        self.towards += new
        return bool(new)

    def _clear(self, design: Design) -> Design:
        """Return a design of almost the same value with a clear audit; if margins do not help, one without."""
        design = self._settle(design)
        while (audit := self._audit(design)).verdict is not Status.CLEAR and self.margins.raise_after(audit):
            design = self._settle(self._climb(design))
        return design

    def _audit(self, design: Design) -> Audit:
        """Return the audit of a design, or the first that is not clear with a smaller load or payload.

        Between 0 and a value that is clear, only air speeds can break a limit: all else is linear in it.
        """
        growing, audit = growing_cases(self.margins.task), self.audit(design)
        limited = growing and any(exposure.speed is not None for exposure in design.task.exposure)
        for share in MAXIMIZING.shares if limited else ():
            if audit.verdict is Status.CLEAR:
                audit = self.audit(self._smaller(design, share, growing))
        return audit

    def _smaller(self, design: Design, share: float, growing: Sequence[int]) -> Design:
        """Return a design with a share of its load or payload, by inputs between those with and without it."""
        inputs, rod = design.inputs.copy(), design.task.end_effector.counted_rod
        bare = inputs[-len(growing) :]
        inputs[growing] = bare + share * (inputs[growing] - bare)
        weights = [case.weight for case in design.task.load_cases]
        smaller = {
            "task": task_at(self.margins.task.with_rod(rod), share * _value(design)),
            "rotor_speeds_squared": tuple(map(tuple, inputs.reshape(len(weights), -1).tolist())),
            "objective": sum(w * float((u**2).sum()) for w, u in zip(weights, inputs, strict=True)),
        }
        return design.model_copy(update=smaller)

    def _settle(self, best: Design) -> Design:
        """Return the design of least effort near one, with almost its value and the rod of the task."""
        from nlp.climbing import climb  # compiled code, which other commands need not load

        step = step_of(self.job.task, _value(best)) / 2
        value = max(0.0, _value(best) - step)
        cheapest = self.solve(replace(self._job(value, self.towards), starts=range(0), near=(best,)))
        for _ in range(MAXIMIZING.rounds):
            if isinstance(cheapest, Design):
                measured, weakest = self._measure(cheapest)
                if _value(measured) >= value - step or not self._see(weakest):
                    return measured
            cheapest = climb(self._base, best, self.constraints, value=value, turns=False)
        return best

    def _measure(self, design: Design) -> tuple[Design, tuple[Vector, ...]]:
        """Return a design for the task of the value that it holds, and the directions in which it is weakest."""
        return measure_reserve(design, self.margins.task.with_rod(design.task.end_effector.counted_rod))


def measure_reserve(design: Design, task: ResolvedTask) -> tuple[Design, tuple[Vector, ...]]:
    """Return a design for T(s) of a task, s being the reserve that it holds, and where it is weakest.

    A design without a maximised reserve is returned as it is.
    """
    if design.task.search.maximize not in RESERVES:
        return design, ()
    value, weakest = measure(design.task, verify.case_reserves(design))
    return design.model_copy(update={"task": task_at(task, value)}), weakest


def _value(design: Design) -> float:
    return design.value or 0.0

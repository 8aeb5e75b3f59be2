"""How long a run still takes: what its phases were expected to take, corrected by what their steps took.

| symbol | meaning | unit |
|---|---|---|
| E | time since the phase began | s |
| d | steps done in it; one that runs counts half | |
| s | expected time of a step on all workers together | s |
| c | correction of all expectations: time taken over time expected, T seconds of each added | |
| T | how much the expectations are trusted | s |

A step of the present phase is taken to need (E + c T) / (d + T / s) seconds: what was seen, and T seconds of what
was expected. Phases that are yet to come are expected to take c times what they were planned with. How long workers
load what they compute with counts for c as well; but until the first step is done, nothing was seen of the steps.
A time limit ends what is solved; audits come after it.
`tests/benchmarks/time_left.py` measures the error over recorded runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from topo_search.study.phases import WAKING, Phase, Plan, duration

TRUSTED = 2.0
"""T [s]."""


class TimeLeft:
    """Follows a run, and says how long it still takes."""

    def __init__(self) -> None:
        self._planned: list[Phase] = []
        self._workers = 1
        self._end = math.inf
        self._phase: Phase | None = None
        self._began = self._since = 0.0
        self._done = self._known = 0
        self._taken = self._expected = 0.0
        self._woken = False

    def plan(self, plan: Plan, now: float) -> None:
        """Take up what is going to be done.

        Args:
            plan: of the run.
            now: any clock [s]; so of the other methods.
        """
        self._planned, self._workers = list(plan.phases), plan.workers or 1
        self._end = now + plan.time_limit

    def begin(self, phase: Phase, now: float) -> None:
        """Begin a phase, whether it was planned or not."""
        self._close(now)
        places = [place for place, planned in enumerate(self._planned) if planned.same == phase.same]
        if places:
            del self._planned[: places[0] + 1]
        self._phase, self._began, self._done, self._known = phase, now, 0, 0

    def step(self, now: float, *, known: bool) -> None:
        """Count a step; one whose result was known took no time."""
        if self._waking and not known and self._phase is not None:
            self._taken += max(0.0, now - self._phase.seconds - self._began)
            self._expected += WAKING
            self._woken, self._began = True, now - self._phase.seconds
        self._done += not known
        self._known += known

    def __call__(self, now: float) -> float:
        """Return how long it still takes [s]."""
        taken, expected = self._seconds_spent(now)
        correction = (self._taken + taken + TRUSTED) / (self._expected + expected + TRUSTED)
        solving = other = 0.0
        for phase in self._planned:
            left = correction * duration(phase, self._workers)
            solving, other = (solving + left, other) if phase.starts else (solving, other + left)
        present = self._present(now, correction)
        if self._phase is not None and self._phase.starts:
            solving += present
        else:
            other += present
        return min(solving, max(0.0, self._end - now)) + other

    def _present(self, now: float, correction: float) -> float:
        """Return how long the present phase still takes [s]."""
        phase = self._phase
        if phase is None or not phase.steps:
            return 0.0
        due, step = phase.steps - self._known, duration(phase, self._workers) / phase.steps
        if self._waking:
            return max(0.0, self._began + WAKING - now) + correction * step * due
        done = self._done + self._half(due)
        taken = now - self._began
        weight = TRUSTED if step else 0.0  # where nothing is expected only what is seen counts
        seen = (taken + correction * weight) / (done + (weight / step if step else 0.0))
        return seen * max(0.0, due - done)

    def _half(self, due: int) -> float:
        """Return what runs, in steps, each taken to be half done."""
        alone = self._phase is not None and self._phase.alone
        return 0.5 * max(0, min(1 if alone else self._workers, due - self._done))

    @property
    def _waking(self) -> bool:
        """Whether no worker has done a step yet."""
        return self._phase is not None and not self._phase.alone and not self._woken

    def _seconds_spent(self, now: float) -> tuple[float, float]:
        """Return what was spent on the present phase, and what was expected of as much [s]."""
        phase = self._phase
        if phase is None or not phase.steps or self._waking:
            return 0.0, 0.0
        share = (self._done + self._half(phase.steps - self._known)) / phase.steps
        return now - self._began, share * duration(phase, self._workers)

    def _close(self, now: float) -> None:
        """Add up the phase that is over."""
        taken, expected = self._seconds_spent(now)
        self._taken += taken
        self._expected += expected


def errors(clocked: Iterable[tuple[float, float]], end: float) -> list[float]:
    """Return by which factor each estimate (time, time left) was off; it ended at `end` [s]."""
    return [max(left, end - at) / max(min(left, end - at), 1e-9) for at, left in clocked]

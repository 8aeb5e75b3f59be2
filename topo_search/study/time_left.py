"""The remaining time of a run: rough estimates, corrected by measured steps.

| symbol | meaning | unit |
|---|---|---|
| E | time since the phase began | s |
| d | finished steps of the phase; a running one counts half | |
| s | expected time of a step on all workers together | s |
| c | correction: measured over expected time, each with that of T expected steps | |
| T | number of steps for which the expectation is trusted | |

The estimate for a step of the current phase is (E + c T s) / (d + T) seconds: the measured time and T steps as
expected. T counts steps, not seconds, so a few steps correct an expectation that is wrong by a factor of hundreds.
While steps run, the phase needs at least as long again as the time since its last step.

Future phases are expected to take c times their planned time. Solves and audits have separate corrections, since a
slow solve says nothing about audits. Time counts only after each worker's first step, which loads and compiles the
solver. A time limit ends solving; audits follow it.

`tests/benchmarks/time_left.py` measures the error over recorded runs.
"""

import math
from itertools import pairwise

from topo_search.engine.workers import start_ranges
from topo_search.study import progress
from topo_search.study.folder import RunFolder


def remaining_plan(folder: RunFolder, workers: int | None, time_limit: float) -> progress.Plan:
    """Return the plan of what a run has not done yet.

    Args:
        folder: the run's folder.
        workers: number of jobs that run at a time; None if unknown.
        time_limit: time limit of solving [s].
    """
    timed, phases = math.isfinite(time_limit), list[progress.Phase]()
    sizes = ((level.request, level.ledger, n) for level in folder.levels for n in level.request.task.sizes)
    for request, ledger, n in sizes:
        context = request.contexts(n)[0]
        bound = ledger.bound(context)
        if bound is None:
            phases.append(progress.proof_phase(n))
        elif bound[1] is not None:
            continue  # proven impossible
        count = request.space(n).count()
        candidates = count if request.trials is None else min(count, request.trials)
        if ledger.has_failures(context) or not ledger.is_complete(context, request.starts, request.trials):
            stops = [0, *(part.stop for part in start_ranges(request.starts, request.starts, timed=timed))]
            for before, stop in pairwise(stops):
                unsolved = candidates - ledger.count_solved(context, stop)
                name: progress.PhaseName = "polishing" if before else "searching"
                if unsolved > 0:
                    phases.append(progress.solving_phase(name, context.task, unsolved, stop, before))
            phases.append(progress.audit_phase(n, min(progress.AUDIT_BATCH, candidates)))
    return progress.Plan((*phases, progress.WRITING), workers, time_limit)


class TimeLeft:
    """Follows a run and estimates its remaining time."""

    def __init__(self) -> None:
        self._planned: list[progress.Phase] = []
        self._workers = 1
        self._deadline = math.inf
        self._phase = progress.Phase("writing", 0, 0, is_serial=True)
        self._phase_start = self._last_step = 0.0
        self._solved = self._known = 0
        self._measured: dict[bool, tuple[float, float]] = {}
        """Measured and expected time of all phases that solve, and of all others [s]."""
        self._starting_workers = 0

    def plan(self, plan: progress.Plan, now: float) -> None:
        """Begin a run.

        Args:
            plan: the run's plan.
            now: time of any clock, the same one as for the other methods [s].
        """
        self._planned, self._workers = list(plan.phases), plan.workers or 1
        self._starting_workers = self._workers
        self._deadline = now + plan.time_limit

    def begin(self, phase: progress.Phase, now: float) -> None:
        """Begin a phase, planned or not."""
        self._measured = self._measure(now)
        indices = [index for index, planned in enumerate(self._planned) if planned.plan_key == phase.plan_key]
        if indices:
            del self._planned[: indices[0] + 1]
        self._phase, self._solved, self._known = phase, 0, 0
        self._phase_start = self._last_step = now

    def step(self, now: float, *, known: bool) -> None:
        """Count a step; one with a known result took no time."""
        if self._is_starting and not known:
            self._phase_start = max(self._phase_start, now - self._phase.seconds)
            self._starting_workers -= 1
        self._last_step = now
        self._solved += not known
        self._known += known

    def __call__(self, now: float) -> float:
        """Return the remaining time [s]."""
        measured = self._measure(now)
        times = [(phase, self._correct_duration(phase, measured)) for phase in self._planned]
        times.append((self._phase, self._current_phase(now)))
        solving, remainder = (
            sum(t for phase, t in times if bool(phase.starts) is solves) for solves in (True, False)
        )
        return min(solving, max(0.0, self._deadline - now)) + remainder

    def _current_phase(self, now: float) -> float:
        """Return the remaining time of the current phase [s]."""
        phase = self._phase
        if not phase.steps:
            return 0.0
        steps = phase.steps - self._known
        step = self._correct_duration(phase, self._measured) / phase.steps
        if self._is_starting:
            return max(0.0, self._phase_start + progress.EXPECTED.startup_s - now) + step * steps
        d = self._solved + self._running_steps(steps)
        T = progress.EXPECTED.trusted_steps if step else 0.0  # without an expectation only the measurement counts
        remaining = (now - self._phase_start + T * step) / (d + T) * max(0.0, steps - d)
        return max(remaining, now - self._last_step) if self._solved < steps else remaining

    def _running_steps(self, steps: int) -> float:
        return 0.5 * max(0, min(1 if self._phase.is_serial else self._workers, steps - self._solved))

    @property
    def _is_starting(self) -> bool:
        return not self._phase.is_serial and self._starting_workers > 0

    def _correct_duration(self, phase: progress.Phase, measured: dict[bool, tuple[float, float]]) -> float:
        """Return the expected duration of a phase, times c [s]."""
        planned = progress.duration(phase, self._workers)
        trusted = progress.EXPECTED.trusted_steps * planned / max(1, phase.steps)
        seconds, expected = measured.get(bool(phase.starts), (0.0, 0.0))
        return planned * (seconds + trusted) / (expected + trusted) if planned else 0.0

    def _measure(self, now: float) -> dict[bool, tuple[float, float]]:
        """Return measured and expected times including those of the current phase so far."""
        phase = self._phase
        if phase.is_serial or not phase.steps or self._is_starting:
            return self._measured
        step = progress.duration(phase, self._workers) / phase.steps
        steps = self._solved + self._running_steps(phase.steps - self._known)
        seconds, expected = self._measured.get(bool(phase.starts), (0.0, 0.0))
        total = seconds + now - self._phase_start, expected + steps * step
        return {**self._measured, bool(phase.starts): total}

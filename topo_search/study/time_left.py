"""The remaining time of a run: rough estimates, corrected by measured steps.

Steps that are left take their expected time, times a correction: the measured time of all steps so far over their
expected time, each with that of a few expected steps, so that a few measured ones correct an expectation that is
wrong by a factor of hundreds. Solves and audits have separate corrections, since a slow solve says nothing about
audits. While steps run, the phase needs at least as long again as the time since its last step. A time limit ends
solving; audits follow it.

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
        self._workers, self._deadline = 1, math.inf
        self._starting_workers = 0
        self._phase = progress.WRITING
        self._steps_left, self._last_step = 0, 0.0
        self._spent = dict.fromkeys((True, False), (0.0, 0.0))
        """Measured and expected time of all finished steps that solve, and of all others [s]."""

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
        indices = [index for index, planned in enumerate(self._planned) if planned.plan_key == phase.plan_key]
        if indices:
            del self._planned[: indices[0] + 1]
        self._phase, self._steps_left, self._last_step = phase, phase.steps, now

    def step(self, now: float, *, known: bool) -> None:
        """Count a step; one with a known result took no time."""
        if self._starting_workers and not known and not self._phase.is_serial:
            self._starting_workers -= 1  # it loads and compiles the solver
        elif not known:
            measured, expected = self._spent[bool(self._phase.starts)]
            step = progress.duration(self._phase, self._workers) / self._phase.steps
            self._spent[bool(self._phase.starts)] = measured + now - self._last_step, expected + step
        self._steps_left, self._last_step = self._steps_left - 1, now

    def __call__(self, now: float) -> float:
        """Return the remaining time [s]."""
        left = {True: 0.0, False: 0.0}
        for phase in self._planned:
            left[bool(phase.starts)] += self._correct(phase, phase.steps)
        since = now - self._last_step
        current = self._correct(self._phase, self._steps_left) - since
        left[bool(self._phase.starts)] += max(current, since) if self._steps_left > 0 else 0.0
        return min(left[True], max(0.0, self._deadline - now)) + left[False]

    def _correct(self, phase: progress.Phase, steps: int) -> float:
        """Return the expected time of some steps of a phase, times its correction [s]."""
        step = progress.duration(phase, self._workers) / max(1, phase.steps)
        measured, expected = self._spent[bool(phase.starts)]
        trusted = progress.EXPECTED.trusted_steps * step
        return steps * step * (measured + trusted) / (expected + trusted) if step else 0.0

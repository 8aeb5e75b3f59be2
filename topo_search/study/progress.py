"""The phases of a run, the plan of them, and the time that is left: expectations, corrected by what steps took.

The expected processor times are rough: they say how long a run is about to take, and how its parts compare.

| symbol | meaning | unit |
|---|---|---|
| E | time since the phase began | s |
| d | steps done in it; one that runs counts half | |
| s | expected time of a step on all workers together | s |
| c(n) | correction of what is expected of n modules: time taken over time expected, of steps done and T more | |
| T | number of steps for which the expectations are trusted | |

A step of the present phase is taken to need (E + c T s) / (d + T) seconds: what was seen, and T steps as they were
expected. T counts steps, not seconds: where an expectation is wrong by a factor of hundreds, a few steps show it.
While steps run, the phase needs at least as long again as no step has ended.
Phases that are yet to come are expected to take c times what they were planned with; solves and audits have each
their own c, since a slow solve says nothing of audits. Between sizes, and beyond
those seen, log c is a line over log n, so that large sizes that cost more than expected are foreseen from the small
ones. Until each worker has ended a step, time is not counted: the first one loads and compiles the solver.
A time limit ends what is solved; audits come after it.
`tests/benchmarks/time_left.py` measures the error over recorded runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

from topo_search.engine import rounds
from topo_search.model import ResolvedTask
from topo_search.study.ledger import Row

if TYPE_CHECKING:
    from topo_search.study.folder import RunFolder

Kind = tuple[bool, int]
PhaseName = Literal["proving", "searching", "polishing", "auditing", "relaxing", "writing"]

AUDITED = 10
"""Number of designs that are audited at a time, best first."""


@dataclass(frozen=True)
class Expected:
    """Expectations that are corrected by what steps took."""

    waking_s: float = 2.5
    """Time until the first worker has loaded what it computes with."""
    reduced_modules: int = 20
    """Modules up to which a start is a few cheap descents, and Ipopt takes up the best local minima of all."""
    chunk_s: float = 0.4
    """Processor time of a chunk of a proof by branch and bound, three and five modules."""
    trusted_steps: float = 2.0
    """T."""


EXPECTED = Expected()


@dataclass(frozen=True)
class Phase:
    """A part of a run, made of steps of about the same length."""

    name: PhaseName
    n: int
    """Modules."""
    steps: int
    """Number of candidates, or designs."""
    starts: int = 0
    """Starts of each candidate when the phase is over; 0 where nothing is solved."""
    seconds: float = 0.0
    """Expected processor time of a step [s]."""
    alone: bool = False
    """True if the steps follow each other in one process."""

    @property
    def kind(self) -> Kind:
        """Key of the time spent on its like: True if it solves, and its number of modules."""
        return bool(self.starts), self.n

    @property
    def same(self) -> tuple[PhaseName, int, int]:
        """Key that a planned phase shares with the one that comes."""
        return self.name, self.n, self.starts


@dataclass(frozen=True)
class Plan:
    """Planned work of a run."""

    phases: tuple[Phase, ...]
    workers: int | None
    """Number of steps taken at a time; None where that is not known."""
    time_limit: float = math.inf
    """Time limit of the solves [s]; audits come after it."""

    @property
    def solves(self) -> bool:
        """True if any candidate is solved."""
        return any(phase.starts for phase in self.phases)

    @property
    def seconds(self) -> float:
        """About how long it takes [s]."""
        waking = EXPECTED.waking_s if any(not phase.alone for phase in self.phases) else 0.0
        solving, other = (
            sum(duration(phase, self.workers or 1) for phase in self.phases if bool(phase.starts) is solves)
            for solves in (True, False)
        )
        return min(self.time_limit, waking + solving) + other


def duration(phase: Phase, workers: int) -> float:
    """Return how long a phase is expected to take [s]."""
    return phase.seconds * phase.steps / (1 if phase.alone else max(1, min(workers, phase.steps)))


def solving_seconds(task: ResolvedTask, starts: int) -> float:
    """Return the expected processor time of one candidate from so many starts [s]."""
    cases = (1 + len(task.load_cases)) / 4
    if task.n <= EXPECTED.reduced_modules:
        candidate, start = 0.08, 0.012  # of twelve modules at most, and three load cases
        return cases * max(1.0, task.n / 12) * (candidate + starts * start)
    growth: float = (task.n / 12) ** 2
    return cases * starts * 0.135 * growth


def solving_phase(name: PhaseName, task: ResolvedTask, candidates: int, starts: int, before: int = 0) -> Phase:
    """Return the phase that solves candidates of a task from a number of starts, some of them solved before."""
    return Phase(name, task.n, candidates, starts, solving_seconds(task, starts - before))


def audit_phase(n: int, designs: int) -> Phase:
    """Return the phase that audits designs of n modules."""
    return Phase("auditing", n, designs, seconds=0.6 * (n / 5) ** 1.5)


def proof_phase(n: int) -> Phase:
    """Return the phase that bounds the effort of a size, or proves it impossible."""
    return Phase("proving", n, 1, seconds=0.5, alone=True)


WRITING = Phase("writing", 0, 1, seconds=5.0, alone=True)
"""The phase that writes all files, and the page."""


def remaining_plan(folder: RunFolder, workers: int | None, time_limit: float) -> Plan:
    """Return what is left to do of a run.

    Args:
        folder: of the run.
        workers: how many jobs run at a time; None where that is not known.
        time_limit: [s]
    """
    timed, phases = math.isfinite(time_limit), list[Phase]()
    sizes = ((level.request, level.ledger, n) for level in folder.levels for n in level.request.task.sizes)
    for request, ledger, n in sizes:
        context = request.contexts(n)[0]
        bound = ledger.bound(context)
        if bound is None:
            phases.append(proof_phase(n))
        elif bound[1] is not None:
            continue  # it is proven impossible
        count = request.space(n).count()
        candidates = count if request.trials is None else min(count, request.trials)
        if ledger.has_failures(context) or not ledger.has_ended(context, request.starts, request.trials):
            stops = [0, *(part.stop for part in rounds(request.starts, request.starts, timed=timed))]
            for before, stop in pairwise(stops):
                left = candidates - ledger.count_solved(context, stop)
                name: PhaseName = "polishing" if before else "searching"
                if left > 0:
                    phases.append(solving_phase(name, context.task, left, stop, before))
            phases.append(audit_phase(n, min(AUDITED, candidates)))
    return Plan((*phases, WRITING), workers, time_limit)


class Observer(Protocol):
    """Shows the progress of a run."""

    def plan(self, plan: Plan) -> None:
        """All of this is going to be done."""
        return

    def phase(self, phase: Phase) -> None:
        """A part of the run begins."""
        return

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """One more step of it is done; `incumbent` is the best design so far.

        Args:
            incumbent: None while there is none.
            known: whether the result was there before.
        """
        return

    def note(self, text: str) -> None:
        """Something that the user should see happened."""
        return


class Silent(Observer):
    """Shows nothing."""


class TimeLeft:
    """Follows a run, and says how long it still takes."""

    def __init__(self) -> None:
        self._planned: list[Phase] = []
        self._workers = 1
        self._end = math.inf
        self._phase = Phase("writing", 0, 0, alone=True)
        self._began = self._last = 0.0
        self._done = self._known = 0
        self._spent: dict[Kind, Spent] = {}
        self._waking_workers = 0

    def plan(self, plan: Plan, now: float) -> None:
        """Take up what is going to be done.

        Args:
            plan: of the run.
            now: any clock [s]; so of the other methods.
        """
        self._planned, self._workers = list(plan.phases), plan.workers or 1
        self._waking_workers = self._workers
        self._end = now + plan.time_limit

    def begin(self, phase: Phase, now: float) -> None:
        """Begin a phase, whether it was planned or not."""
        self._spent = self._spent_until(now)
        indices = [index for index, planned in enumerate(self._planned) if planned.same == phase.same]
        if indices:
            del self._planned[: indices[0] + 1]
        self._phase, self._done, self._known = phase, 0, 0
        self._began = self._last = now

    def step(self, now: float, *, known: bool) -> None:
        """Count a step; one whose result was known took no time."""
        if self._waking and not known:
            self._began = max(self._began, now - self._phase.seconds)
            self._waking_workers -= 1
        self._last = now
        self._done += not known
        self._known += known

    def __call__(self, now: float) -> float:
        """Return how long it still takes [s]."""
        spent = self._spent_until(now)
        left = [(phase, correction(spent, phase) * duration(phase, self._workers)) for phase in self._planned]
        left.append((self._phase, self._present(now)))
        solving, other = (sum(t for phase, t in left if bool(phase.starts) is solves) for solves in (True, False))
        return min(solving, max(0.0, self._end - now)) + other

    def _present(self, now: float) -> float:
        """Return how long the present phase still takes [s]."""
        phase = self._phase
        if not phase.steps:
            return 0.0
        due = phase.steps - self._known
        step = correction(self._spent, phase) * duration(phase, self._workers) / phase.steps
        if self._waking:
            return max(0.0, self._began + EXPECTED.waking_s - now) + step * due
        done = self._done + self._half(due)
        weight = EXPECTED.trusted_steps if step else 0.0  # without expectation, what is seen
        left = (now - self._began + weight * step) / (done + weight) * max(0.0, due - done)
        return max(left, now - self._last) if self._done < due else left

    def _half(self, due: int) -> float:
        return 0.5 * max(0, min(1 if self._phase.alone else self._workers, due - self._done))

    @property
    def _waking(self) -> bool:
        return not self._phase.alone and self._waking_workers > 0

    def _spent_until(self, now: float) -> dict[Kind, Spent]:
        """Return what was spent on each size, apart for solves and the rest, the present phase included."""
        phase = self._phase
        if phase.alone or not phase.steps or self._waking:
            return self._spent
        step = duration(phase, self._workers) / phase.steps
        steps = self._done + self._half(phase.steps - self._known)
        before = self._spent.get(phase.kind, Spent(0.0, 0.0, 0.0))
        more = Spent(before.taken + now - self._began, before.expected + steps * step, before.steps + steps)
        return {**self._spent, phase.kind: more}


class Spent(NamedTuple):
    """Time spent on platforms of one size."""

    taken: float
    """[s]"""
    expected: float
    """Expected for the same steps [s]."""
    steps: float


def correction(spent: Mapping[Kind, Spent], phase: Phase) -> float:
    """Return c(n), by a line through log c over log n of the sizes seen, each weighed by its steps."""
    solves, n = phase.kind
    alike = [(m, one) for (kind, m), one in spent.items() if kind is solves]
    seen = [(math.log(m), *one) for m, one in alike if one.steps and one.expected and one.taken > 0]
    steps = sum(weight for *_, weight in seen)
    if not steps:
        return 1.0
    T = EXPECTED.trusted_steps
    points = [
        (x, math.log((taken / expected * weight + T) / (weight + T)), weight) for x, taken, expected, weight in seen
    ]
    middle = sum(weight * x for x, _, weight in points) / steps
    level = sum(weight * y for _, y, weight in points) / steps
    spread = sum(weight * (x - middle) ** 2 for x, _, weight in points)
    slope = sum(weight * (x - middle) * (y - level) for x, y, weight in points) / (spread + T)
    return math.exp(level + slope * (math.log(n or 1) - middle) * bool(n))

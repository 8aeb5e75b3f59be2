"""Solves the proposals of a strategy: known results come from the ledger, new ones are recorded as they end.

Candidates that a bound rules out are skipped and counted, unless the design that ruled them out fails its audit.
"""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace

from topo_search.engine import (
    CandidateSolver,
    Engine,
    Failed,
    Job,
    Outcome,
    Proposal,
    Scored,
    Solve,
    Space,
    TimeUp,
    may_beat,
    merge,
    solve_jobs,
)
from topo_search.model import Design, Infeasible
from topo_search.study.ledger import Ledger
from topo_search.study.progress import Observer, Phase, PhaseName, solving_seconds
from topo_search.study.request import Context
from topo_search.study.row import FLIGHT, Row, row_of, score


def record(ledger: Ledger, context: Context, job: Job, outcome: Outcome, *, lower_bound: float) -> Row:
    """Write what became of a job, and return the candidate's row.

    More starts of a candidate extend its row. A failure leaves what the earlier ones found, and is tried again by
    the next call.
    """
    key, asked = job.topology.key, job.starts.stop
    before, earlier = ledger.row(context, key), ledger.result(context, key)
    if before is not None and earlier is not None and isinstance(outcome, Failed):
        row = replace(before, asked=asked)
        ledger.record(context, [(row, earlier)], failed=True)
        return row
    result = None if isinstance(outcome, Failed) else outcome
    if result is not None and earlier is not None:
        outcome = result = merge(earlier, result, context.task)
    row = row_of(outcome, key=key, modules=context.task.n, orbit=job.orbit, asked=asked, lower_bound=lower_bound)
    row = replace(row, margin=context.margin, step=context.step)
    if before is not None and _same_platform(earlier, result):
        kept = ("audit", "audit_failure", *FLIGHT)
        row = replace(row, **{name: getattr(before, name) for name in kept})
    ledger.record(context, [(row, result)])
    return row


def rests_on_an_audited_design(ledger: Ledger, n: int, lower_bound: float) -> bool:
    """Return whether the best design whose audit is clear meets the bound, so that no other can be better."""
    best = ledger.best_clear(n)
    return best is not None and best.objective is not None and not may_beat(best.objective, lower_bound)


def record_pruned(ledger: Ledger, context: Context, space: Space, lower_bound: float) -> None:
    """Write a row for every candidate that was not solved."""
    known = {row.key for row in ledger.ranking(space.n)}
    rows = [
        Row(candidate.key, space.n, candidate.orbit, status="pruned", asked=0, lower_bound=lower_bound)
        for candidate in space.candidates()
        if candidate.key not in known
    ]
    ledger.record(context, [(row, None) for row in rows])


def _same_platform(earlier: Design | Infeasible | None, later: Design | Infeasible | None) -> bool:
    """Whether an audit of the one is an audit of the other: they differ in how they were found, if at all."""
    if not isinstance(earlier, Design) or not isinstance(later, Design):
        return False
    return earlier.model_copy(update={"solver": None}) == later.model_copy(update={"solver": None})


MAX_QUEUED = 1000
"""Jobs that may wait for a worker; more proposals wait for results, so that millions need no memory."""


class RecordedSolver(CandidateSolver):
    """Solves candidates of one context on an engine, and records every result in the ledger."""

    def __init__(
        self,
        ledger: Ledger,
        context: Context,
        lower_bound: float,
        solve: Solve,
        engine: Engine,
        observer: Observer,
        previous: Context | None = None,
        near: Sequence[Design] = (),
        until: float = math.inf,
    ) -> None:
        """Read what is known of a context.

        Designs of `previous` are carried over to the same trees, those of `near` to all. Solving stops when
        time.monotonic() reaches `until`.
        """
        self._ledger = ledger
        self._context = context
        self._lower_bound = lower_bound
        self._solve = solve
        self._engine = engine
        self._observer = observer
        self._previous = previous
        self._near = near
        self._until = until
        self._incumbent: Row | None = next(iter(ledger.best_designs(context, 0, 1)), None)
        self._settled: set[str] = set()
        """Candidates of the present stage that the observer has seen."""
        self._stage_starts = 0
        """Starts of the present stage."""
        self._queue = deque[Job]()
        """Jobs that no worker has taken yet."""
        self._uncollected = deque[Proposal]()
        """Proposals whose results were not collected."""
        self._outcomes = self._start()
        self._scores = defaultdict[str, list[Scored]](list)
        for scored in ledger.scores(context):
            self._scores[scored.key].append(scored)

    def begin_stage(self, candidates: int, starts: int, *, again: bool = False) -> None:
        """Report the stage to the observer."""
        task = self._context.task
        name: PhaseName = "polishing" if again else "searching"
        new = (starts - self._stage_starts if again else starts) or starts
        self._observer.phase(Phase(name, task.n, candidates, starts, solving_seconds(task, new)))
        self._settled.clear()
        self._stage_starts = starts

    def submit(self, proposal: Proposal) -> None:
        """Queue a proposal, unless its result is known."""
        self._uncollected.append(proposal)
        if self._result(proposal) is not None:
            self._report(proposal.candidate.key, known=True)
            return
        self._queue.append(self._job(proposal))
        while len(self._queue) > MAX_QUEUED:
            self._record_next()

    def results(self, number: int) -> list[Scored]:
        """Return the results of the earliest proposals that were not collected, in order."""
        return [self._wait_for(self._uncollected.popleft()) for _ in range(number)]

    def close(self) -> None:
        """Drop the jobs that are running."""
        self._outcomes.close()

    def _wait_for(self, proposal: Proposal) -> Scored:
        while (scored := self._result(proposal)) is None:
            self._record_next()
        return scored

    def _record_next(self) -> None:
        """Record the next outcome of a job."""
        ended = next(self._outcomes, None)
        if ended is None:
            if time.monotonic() >= self._until:
                raise TimeUp
            self._outcomes = self._start()  # the engine had nothing left to do
            return
        row = record(self._ledger, self._context, *ended, lower_bound=self._lower_bound)
        self._scores[row.key].append(score(row, self._context.task))
        self._incumbent = _better_of(self._incumbent, row)
        self._report(row.key)

    def _start(self) -> Generator[tuple[Job, Outcome], None, None]:
        yield from solve_jobs(self._jobs(), solve=self._solve, engine=self._engine, until=self._until)

    def _jobs(self) -> Iterator[Job | None]:
        while True:
            yield self._queue.popleft() if self._queue else None

    def _job(self, proposal: Proposal) -> Job:
        """Return what is left to solve of a proposal."""
        candidate = proposal.candidate
        before = self._scores[candidate.key]
        first = before[-1].starts if before else 0
        known = [self._ledger.result(self._context, key) for key in proposal.near]
        carried_over = sum(isinstance(result, Design) for result in known)
        if first == 0 and self._previous is not None:
            known.append(self._ledger.result(self._previous, candidate.key))
        if first == 0:
            known += self._near
        return Job(
            self._context.task,
            candidate.topology,
            candidate.orbit,
            range(first + carried_over, proposal.starts),
            self._context.seed,
            tuple(near for near in known if isinstance(near, Design)),
        )

    def _report(self, key: str, *, known: bool = False) -> None:
        """Show the observer each candidate once a stage; more starts of it are no news."""
        if key not in self._settled:
            self._settled.add(key)
            self._observer.settled(self._incumbent, known=known)

    def _result(self, proposal: Proposal) -> Scored | None:
        """Return what is known of a candidate after as many starts as proposed, or the next known number."""
        known = self._scores[proposal.candidate.key]
        after = bisect_left(known, proposal.starts, key=lambda scored: scored.starts)
        return known[after] if after < len(known) else None


def _better_of(incumbent: Row | None, row: Row) -> Row | None:
    """Return the better of two rows, the first in a tie; one without a design is none."""
    if row.objective is None:
        return incumbent
    if incumbent is None or incumbent.objective is None:
        return row
    return min(incumbent, row, key=lambda row: (row.objective, row.key))

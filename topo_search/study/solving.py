"""Solves the proposals of a strategy: known results come from the ledger, new ones are recorded as they end."""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Generator, Iterator, Sequence

from topo_search.engine import CandidateSolver, Engine, Job, Outcome, Proposal, Scored, Solve, TimeUp, solve_jobs
from topo_search.model import Design
from topo_search.study.identity import Context
from topo_search.study.ledger import Ledger
from topo_search.study.observer import Observer
from topo_search.study.phases import Phase, PhaseName, solving_seconds
from topo_search.study.recording import record
from topo_search.study.row import Row, score

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

"""A run follows a strategy: what the ledger knows is answered from it, the rest is solved and recorded."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Iterator, Sequence

from topo_search.engine import Engine, Job, Proposal, Results, Scored, Solve, Stage, Strategy, solve_jobs
from topo_search.model import Design
from topo_search.study.identity import Context
from topo_search.study.ledger import Ledger
from topo_search.study.observer import Observer
from topo_search.study.phases import Phase, PhaseName, solving_seconds
from topo_search.study.recording import record
from topo_search.study.row import Row, score


class Replay:
    """The search of one context: which of its candidates had reached what after how many starts."""

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
    ) -> None:
        """Take up the search of a context.

        Designs of `previous` are carried over to the same trees, those of `near` to all.
        """
        self._ledger = ledger
        self._context = context
        self._lower_bound = lower_bound
        self._solve = solve
        self._engine = engine
        self._observer = observer
        self._previous = previous
        self._near = near
        self._incumbent: Row | None = next(iter(ledger.best_designs(context, 0, 1)), None)
        self._settled: set[str] = set()
        """Candidates of the present stage that the observer was told of."""
        self._reached = 0
        """Starts of the present stage."""
        self._ended = False
        """Whether the strategy came to its end."""
        self._scores: dict[str, list[Scored]] = {}
        for scored in ledger.scores(context):
            self._add(scored)

    def run(self, strategy: Strategy, until: float = math.inf) -> bool:
        """Carry out what a strategy proposes, and return whether it came to its end.

        Args:
            strategy: is replayed as far as the ledger knows the results.
            until: time.monotonic() at which to stop.
        """
        self._ended = False
        jobs = self._jobs(strategy)
        for job, outcome in solve_jobs(jobs, solve=self._solve, engine=self._engine, until=until):
            row = record(self._ledger, self._context, job, outcome, lower_bound=self._lower_bound)
            self._add(score(row, self._context.task))
            self._incumbent = _better_of(self._incumbent, row)
            self._settle(row.key)
        strategy.close()
        return self._ended

    def _jobs(self, strategy: Strategy) -> Iterator[Job | None]:
        """Yield what is left to solve; None while the strategy waits for what is being solved."""
        waiting = deque[Proposal]()
        """Whose results were not asked for yet."""
        try:
            step = next(strategy)
            while True:
                if isinstance(step, Results):
                    results = list[Scored]()
                    for proposal in [waiting.popleft() for _ in range(step.number)]:
                        while (result := self._look_up(proposal)) is None:
                            yield None
                        results.append(result)
                    step = strategy.send(results)
                    continue
                if isinstance(step, Stage):
                    self._announce(step)
                else:
                    waiting.append(step)
                    if self._look_up(step) is None:
                        yield self._job(step)
                    else:
                        self._settle(step.candidate.key, known=True)
                step = next(strategy)
        except StopIteration:
            while waiting:
                if self._look_up(waiting[0]) is None:
                    yield None
                else:
                    waiting.popleft()
            self._ended = True

    def _job(self, proposal: Proposal) -> Job:
        """Return what is left to solve of a proposal."""
        candidate = proposal.candidate
        before = self._scores.get(candidate.key)
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

    def _announce(self, stage: Stage) -> None:
        """Tell the observer of the candidates to come."""
        task = self._context.task
        name: PhaseName = "polishing" if stage.again else "searching"
        new = (stage.starts - self._reached if stage.again else stage.starts) or stage.starts
        self._observer.phase(Phase(name, task.n, stage.candidates, stage.starts, solving_seconds(task, new)))
        self._settled.clear()
        self._reached = stage.starts

    def _settle(self, key: str, *, known: bool = False) -> None:
        """Tell the observer of a candidate, once a stage; more starts of it are no news."""
        if key not in self._settled:
            self._settled.add(key)
            self._observer.settled(self._incumbent, known=known)

    def _add(self, scored: Scored) -> None:
        self._scores.setdefault(scored.key, []).append(scored)

    def _look_up(self, proposal: Proposal) -> Scored | None:
        """Return what is known of a candidate after as many starts as proposed, or the next known number."""
        known = self._scores.get(proposal.candidate.key, [])
        place = bisect_left(known, proposal.starts, key=lambda scored: scored.starts)
        return known[place] if place < len(known) else None


def _better_of(incumbent: Row | None, row: Row) -> Row | None:
    """Return the better of two rows, the first in a tie; one without a design is none."""
    if row.objective is None:
        return incumbent
    if incumbent is None or incumbent.objective is None:
        return row
    return min(incumbent, row, key=lambda row: (row.objective, row.key))

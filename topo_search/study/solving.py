"""Solving what a strategy proposes, and auditing the best of it.

Known results come from the ledger, new ones are recorded as their jobs end. The best designs are audited; one that
does not pass is solved again with a larger margin, or passed over.

The first ten designs of a ranking are audited, then ten more, until the best clear one is at least as good as
all that were not looked at. What happens to a design depends on itself alone, not on the order of events.
"""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, islice

from topo_search.engine import (
    Backends,
    Engine,
    ExhaustiveSearch,
    Failed,
    Job,
    Outcome,
    Proposal,
    Strategy,
    Tried,
    audit_deadline,
    audit_job,
    may_beat,
    merge,
    solve_job,
)
from topo_search.model import Design, Infeasible, Topology
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import FLIGHT, Ledger, Row, row_of, score
from topo_search.study.progress import AUDITED, Observer, PhaseName, audit_phase, solving_phase
from topo_search.study.request import Context, Margins, Request


@dataclass(frozen=True)
class Tools:
    """Solver and audit of a run, with its engine, observer and time limit."""

    backends: Backends
    engine: Engine
    observer: Observer
    until: float = math.inf
    """time.monotonic() after which nothing more is solved; designs are audited all the same."""

    def solve(self, jobs: Iterable[Job | None]) -> Generator[tuple[Job, Outcome], None, None]:
        """Yield every job with its outcome as it ends, in any order; jobs are drawn as workers become free."""
        solve = partial(solve_job, self.backends.solve)
        return self.engine.run(solve, jobs, deadline=lambda job: job.deadline, until=self.until)


def strategy_of(folder: RunFolder, n: int, *, bound: float = -math.inf, timed: bool) -> Strategy:
    """Return what proposes the trees of n modules.

    Args:
        folder: of the run.
        n: number of modules.
        bound: of all objectives, with which candidates are pruned.
        timed: whether there is a time limit.
    """
    request, space = folder.request, folder.request.space(n)
    if request.strategy == "exhaustive":
        return ExhaustiveSearch(space, starts=request.starts, timed=timed, bound=bound)
    from topo_search.engine.proposals import OptunaSearch  # loads Optuna

    return OptunaSearch(
        space,
        sampler=request.propose or request.sampler,
        trials=space.count() if request.trials is None else request.trials,
        round_size=request.round_size,
        starts=request.starts,
        seed=request.seed,
        journal=folder.journal(f"study-n{n}.journal"),
        timed=timed,
    )


class Proposals:
    """The candidates of one context that a strategy proposes: what is to be solved, and its outcome."""

    def __init__(
        self, strategy: Strategy, folder: RunFolder, n: int, lower_bound: float, observer: Observer
    ) -> None:
        """Read what is known of the candidates of n modules."""
        request, ledger = folder.request, folder.ledger
        self._strategy = strategy
        self._ledger = ledger
        self._context = context = request.contexts(n)[0]
        self._lower_bound = lower_bound
        self._observer = observer
        self._previous = None if request.previous is None else request.previous.contexts(n)[0]
        """The context of the level before, whose designs are carried over to the same trees."""
        self._near = request.near
        """Designs that are carried over to all trees."""
        self._incumbent: Row | None = next(iter(ledger.best_designs(context, 0, 1)), None)
        self._shown: set[str] = set()
        """Candidates of the present stage that the observer has seen."""
        self._scores = defaultdict[str, list[Tried]](list)
        for scored in ledger.scores(context):
            self._scores[scored.key].append(scored)

    def jobs(self) -> Iterator[Job | None]:
        """Yield what is to be solved; None while that depends on what is being solved."""
        stage = None
        for proposal in self._strategy.propose(self._result):
            if self._strategy.stage is not stage:
                self._begin_stage(stage.starts if stage else 0)
                stage = self._strategy.stage
            if proposal is None:
                yield None
            elif self._result(proposal) is None:
                yield self._job(proposal)
            else:
                self._report(proposal.candidate.key, known=True)

    def record(self, job: Job, outcome: Outcome) -> None:
        """Write the outcome of a job, which the strategy takes from here."""
        row = record(self._ledger, self._context, job, outcome, lower_bound=self._lower_bound)
        self._scores[row.key].append(score(row, self._context.task))
        designs = [one for one in (self._incumbent, row) if one is not None and one.objective is not None]
        self._incumbent = min(designs, key=lambda one: (one.objective, one.key), default=None)
        self._report(row.key)

    def _begin_stage(self, starts_before: int) -> None:
        if (stage := self._strategy.stage) is None:
            return
        name: PhaseName = "polishing" if stage.again else "searching"
        before = starts_before if stage.again and starts_before != stage.starts else 0
        self._observer.phase(solving_phase(name, self._context.task, stage.candidates, stage.starts, before))
        self._shown.clear()

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
        if key not in self._shown:
            self._shown.add(key)
            self._observer.settled(self._incumbent, known=known)

    def _result(self, proposal: Proposal) -> Tried | None:
        """Return what is known of a candidate after as many starts as proposed, or the next known number."""
        known = self._scores[proposal.candidate.key]
        after = bisect_left(known, proposal.starts, key=lambda scored: scored.starts)
        return known[after] if after < len(known) else None


def record(ledger: Ledger, context: Context, job: Job, outcome: Outcome, *, lower_bound: float) -> Row:
    """Write the outcome of a job, and return the candidate's row.

    More starts of a candidate extend its row. A failure leaves what the earlier ones found, and is tried again by
    the next call.
    """
    key, starts = job.topology.key, job.starts.stop
    before, earlier = ledger.row(context, key), ledger.result(context, key)
    if before is not None and earlier is not None and isinstance(outcome, Failed):
        row = replace(before, asked=starts)
        ledger.record(context, [(row, earlier)], failed=True)
        return row
    result = None if isinstance(outcome, Failed) else outcome
    if result is not None and earlier is not None:
        outcome = result = merge(earlier, result, context.task)
    row = row_of(outcome, key=key, modules=context.task.n, orbit=job.orbit, starts=starts, lower_bound=lower_bound)
    row = replace(row, margin=context.margin, step=context.step)
    if before is not None and _same_platform(earlier, result):
        kept = ("audit", "audit_failure", *FLIGHT)
        row = replace(row, **{name: getattr(before, name) for name in kept})
    ledger.record(context, [(row, result)])
    return row


def record_proof(folder: RunFolder, n: int, proof: Infeasible, lower_bound: float) -> None:
    """Write a row for every candidate that a proof of impossibility rules out."""
    request, space = folder.request, folder.request.space(n)
    if space.count() > 100_000:  # the proof holds for every candidate all the same
        return
    candidates = space.candidates()
    while batch := list(islice(candidates, 1000)):
        rows = [
            row_of(proof, key=one.key, modules=n, orbit=one.orbit, starts=request.starts, lower_bound=lower_bound)
            for one in batch
        ]
        folder.ledger.record(request.contexts(n)[0], [(row, None) for row in rows])


def record_pruned(folder: RunFolder, n: int, lower_bound: float) -> bool:
    """Write a row for every candidate that was not solved; False if the design that ruled them out is not clear."""
    ledger, space = folder.ledger, folder.request.space(n)
    best = ledger.best_clear(n)
    if best is None or best.objective is None or may_beat(best.objective, lower_bound):
        return False
    known = {row.key for row in ledger.ranking(n)}
    rows = [
        Row(candidate.key, n, candidate.orbit, status="pruned", asked=0, lower_bound=lower_bound)
        for candidate in space.candidates()
        if candidate.key not in known
    ]
    ledger.record(folder.request.contexts(n)[0], [(row, None) for row in rows])
    return True


def _same_platform(earlier: Design | Infeasible | None, later: Design | Infeasible | None) -> bool:
    """True if an audit of the one is an audit of the other: they differ in how they were found, if at all."""
    if not isinstance(earlier, Design) or not isinstance(later, Design):
        return False
    return earlier.model_copy(update={"solver": None}) == later.model_copy(update={"solver": None})


def audit_best(folder: RunFolder, n: int, lower_bound: float, tools: Tools) -> None:
    """Audit the best designs of n modules until one is clear that nothing unaudited can beat.

    Args:
        folder: of the run.
        n: number of modules.
        lower_bound: of this size [rad^4/s^4].
        tools: what solves and audits.
    """
    ledger, request = folder.ledger, folder.request
    contexts = request.contexts(n)
    tasks = [context.task for context in contexts]
    for batch in _batches(ledger, contexts[0]):
        margins, best = {row.key: Margins(tasks) for row in batch}, ledger.best_clear(n) or batch[0]
        for step, context in enumerate(contexts):
            due = [row for row in batch if margins[row.key].step == step]
            if step and (jobs := _jobs(ledger, context, due, request)):
                if time.monotonic() >= tools.until:
                    break
                ledger.begin(context, lower_bound, None)
                tools.observer.phase(solving_phase("polishing", context.task, len(jobs), request.starts))
                for job, outcome in tools.solve(jobs):
                    record(ledger, context, job, outcome, lower_bound=lower_bound)
                    tools.observer.settled(best)
            _audit(ledger, context, _rows(ledger, context, due), tools)
            for row in _rows(ledger, context, due):
                if not row.clear and (audit := ledger.audit(context, row.key)) is not None:
                    words = f"the audit of the design with margin {row.margin:g} m is {row.audit}"
                    tools.observer.note(f"{row.key}: {words}")
                    margins[row.key].raise_after(audit)


def audits_left(ledger: Ledger, contexts: Sequence[Context], starts: int) -> bool:
    """Return whether a design that may be the best is still to be audited, or solved again after its audit."""
    best = ledger.best_clear(contexts[0].task.n)
    for batch in _batches(ledger, contexts[0]):
        for row in batch:
            if best is not None and _objective(best) <= _objective(row):
                return False
            if _is_left(ledger, contexts, row.key, starts):
                return True
    return False


def _batches(ledger: Ledger, context: Context) -> Iterator[list[Row]]:
    """Yield designs, the best first, until one that is clear is at least as good as all that follow."""
    for first in count(0, AUDITED):
        batch, best = ledger.best_designs(context, first, AUDITED), ledger.best_clear(context.task.n)
        if not batch or (first and best is not None and _objective(best) <= _objective(batch[0])):
            return
        yield batch


def _is_left(ledger: Ledger, contexts: Sequence[Context], key: str, starts: int) -> bool:
    """Return whether one candidate is not yet clear, nor passed over."""
    margins = Margins([context.task for context in contexts])
    while True:
        context = contexts[margins.step]
        row = ledger.row(context, key)
        if row is None or (margins.step and row.asked < starts) or (row.feasible and not row.audit_ended):
            return True
        audit = ledger.audit(context, key) if row.feasible and not row.clear else None
        if audit is None or not margins.raise_after(audit):
            return False


def _jobs(ledger: Ledger, context: Context, rows: Sequence[Row], request: Request) -> list[Job]:
    """Return what is to be solved in a context with a larger margin."""
    jobs, reached = [], {scored.key: scored.starts for scored in ledger.scores(context)}
    for row in rows:
        starts = range(reached.get(row.key, 0), request.starts)
        if starts:
            near = () if starts.start else request.near
            jobs.append(Job(context.task, Topology.from_key(row.key), row.orbit, starts, context.seed, near))
    return jobs


def _rows(ledger: Ledger, context: Context, rows: Sequence[Row]) -> list[Row]:
    candidates = (ledger.row(context, row.key) for row in rows)
    return [row for row in candidates if row is not None and row.feasible]


def _audit(ledger: Ledger, context: Context, rows: Sequence[Row], tools: Tools) -> None:
    """Audit the designs that were not, and write their verdicts."""
    keys = [row.key for row in rows if not row.audit_ended]
    if keys:
        tools.observer.phase(audit_phase(context.task.n, len(keys)))
    results = tools.engine.run(
        partial(audit_job, tools.backends.audit),
        ((key, ledger.result(context, key)) for key in keys),
        deadline=lambda _: audit_deadline(context.task.n),
    )
    for (key, _), verdict in results:
        if isinstance(verdict, Failed):
            ledger.record_audit_failure(context, key, verdict.reason)
        else:
            ledger.record_audit(context, key, verdict)
        tools.observer.settled(rows[0])


def _objective(row: Row) -> float:
    return math.inf if row.objective is None else row.objective

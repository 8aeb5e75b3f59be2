"""Solving the candidates that a strategy proposes, and auditing the best designs.

Results that the ledger already holds are reused; new ones are recorded as their jobs end. The best designs are
audited. One that does not pass is solved again with a larger margin, or skipped.

Designs are audited in batches of ten, best first, until the best clear one is at least as good as every design
outside the batches. What happens to a design depends only on that design, not on the order of events.
"""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, islice

from topo_search.engine import Backends, Engine, Failed, Job, Outcome, Proposal, Stage, Strategy, Tried
from topo_search.engine.strategy import may_beat
from topo_search.engine.workers import audit_deadline, audit_job, merge
from topo_search.model import Design, Infeasible, Topology
from topo_search.model.features import objective_of
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import FLIGHT, Ledger, Row, row_of, score_of
from topo_search.study.progress import AUDIT_BATCH, Observer, PhaseName, audit_phase, solving_phase
from topo_search.study.request import Context, Margins, Request


@dataclass(frozen=True)
class Tools:
    """Solver, audit, engine, observer and time limit of a run."""

    backends: Backends
    engine: Engine
    observer: Observer
    until: float = math.inf
    """time.monotonic() at which solving stops; audits continue."""

    def solve(self, jobs: Iterable[Job | None]) -> Generator[tuple[Job, Outcome], None, None]:
        """Yield each job with its outcome as it ends, in any order; jobs are drawn as workers become free."""
        return self.engine.run(self.backends.solve, jobs, deadline=lambda job: job.deadline, until=self.until)

    def share(self, parts: int) -> Tools:
        """Return the same tools with 1/parts of the remaining time."""
        now = time.monotonic()
        return self if parts == 1 else replace(self, until=now + (self.until - now) / parts)


class ProposedJobs(Iterator[Job | None]):
    """The jobs of a strategy's proposals; None while the next one depends on jobs that are running.

    Results that the ledger already holds are told to the strategy at once, those of jobs once they are recorded.
    """

    is_finished = False
    """True once the strategy was told the results of all its proposals."""

    def __init__(self, strategy: Strategy, folder: RunFolder, n: int, bound: float, observer: Observer) -> None:
        """Read the earlier results of all candidates of n modules, and ask for the first job."""
        request, ledger = folder.request, folder.ledger
        self._strategy = strategy
        self._ledger = ledger
        self._context = context = request.contexts(n)[0]
        self._bound = bound
        self._observer = observer
        self._previous = None if request.previous is None else request.previous.contexts(n)[0]
        """The context of the previous level, whose designs warm-start the same trees."""
        self._user_designs = request.near
        """Designs that warm-start every tree."""
        self._incumbent: Row | None = next(iter(ledger.best_designs(context, 0, 1)), None)
        self._reported: set[str] = set()
        """Candidates of the current stage that were reported to the observer."""
        self._scores = defaultdict[str, list[Tried]](list)
        for score in ledger.scores(context):
            self._scores[score.key].append(score)
        self._stage: Stage | None = None
        self._open = deque[Proposal]()
        """Proposals whose results were not told yet."""
        self._next = self._ask()

    def __next__(self) -> Job | None:
        """Return the next job, and ask for the one after it."""
        if self.is_finished:
            raise StopIteration
        job = self._next
        if job is not None:
            self._next = self._ask()
        return job

    def record(self, job: Job, outcome: Outcome) -> None:
        """Record the outcome of a job, for the ledger and for the strategy."""
        row = record(self._ledger, self._context, job, outcome, bound=self._bound)
        self._scores[row.key].append(score_of(row, self._context.task))
        designs = [r for r in (self._incumbent, row) if r is not None and r.objective is not None]
        self._incumbent = min(designs, key=lambda r: r.rank, default=None)
        self._report(row.key)
        self._tell()
        if self._next is None:
            self._next = self._ask()

    def _ask(self) -> Job | None:
        """Return a job for the next proposal whose result is not known."""
        while isinstance(proposal := self._strategy.ask(), Proposal):
            if self._strategy.stage is not self._stage:
                self._begin_stage(self._strategy.stage)
            self._open.append(proposal)
            if self._result(proposal) is None:
                return self._job(proposal)
            self._report(proposal.candidate.key, known=True)
            self._tell()
        self.is_finished = proposal is None
        return None

    def _tell(self) -> None:
        """Tell the strategy the results that are known, in the order of its proposals."""
        while self._open and (result := self._result(self._open[0])) is not None:
            self._open.popleft()
            self._strategy.tell(result)

    def _begin_stage(self, stage: Stage | None) -> None:
        before, self._stage = self._stage, stage
        if stage is not None:
            name: PhaseName = "polishing" if stage.is_repeat else "searching"
            solved = before.starts if before and stage.is_repeat and before.starts != stage.starts else 0
            self._observer.phase(solving_phase(name, self._context.task, stage.candidates, stage.starts, solved))
            self._reported.clear()

    def _job(self, proposal: Proposal) -> Job:
        """Return the job for the starts of a proposal that were not solved before."""
        candidate, context, result = proposal.candidate, self._context, self._ledger.result
        scores = self._scores[candidate.key]
        first = scores[-1].starts if scores else 0
        near = [result(context, key) for key in proposal.warm_starts]
        starts = range(first + sum(isinstance(design, Design) for design in near), proposal.starts)
        if first == 0 and self._previous is not None:
            near.append(result(self._previous, candidate.key))
        near += self._user_designs if first == 0 else ()
        designs = tuple(design for design in near if isinstance(design, Design))
        return Job(context.task, candidate.topology, starts, context.seed, designs, candidate.orbit, proposal.reach)

    def _report(self, key: str, *, known: bool = False) -> None:
        """Report each candidate to the observer once per stage, not again for more starts."""
        if key not in self._reported:
            self._reported.add(key)
            self._observer.settled(self._incumbent, known=known)

    def _result(self, proposal: Proposal) -> Tried | None:
        """Return a candidate's first result from at least the proposed number of starts, if there is one."""
        scores = self._scores[proposal.candidate.key]
        index = bisect_left(scores, proposal.starts, key=lambda score: score.starts)
        return scores[index] if index < len(scores) else None


def record(ledger: Ledger, context: Context, job: Job, outcome: Outcome, *, bound: float) -> Row:
    """Write the outcome of a job to the ledger, and return the candidate's row.

    More starts of a candidate extend its row. A failure keeps the result of earlier starts; the next run tries
    again.
    """
    key, starts = job.topology.key, job.starts.stop
    old_row, old_result = ledger.row(context, key), ledger.result(context, key)
    if old_row is not None and old_result is not None and isinstance(outcome, Failed):
        row = replace(old_row, asked=starts)
        ledger.record(context, [(row, old_result)], failed=True)
        return row
    result = None if isinstance(outcome, Failed) else outcome
    if result is not None and old_result is not None:
        outcome = result = merge(old_result, result, context.task)
    row = row_of(outcome, key, context.task.n, job.orbit, starts, bound, objective_of(context.task))
    margin = result.task.search.margin if isinstance(result, Design) else context.margin
    row = replace(row, margin=margin, step=context.step, reach=job.reach or None)
    if old_row is not None and _is_same_platform(old_result, result):
        audit_fields = ("audit", "audit_failure", *FLIGHT)
        row = replace(row, **{name: getattr(old_row, name) for name in audit_fields})
    ledger.record(context, [(row, result)])
    return row


def record_proof(folder: RunFolder, n: int, proof: Infeasible, bound: float) -> None:
    """Write a row for every candidate that a proof of impossibility rules out."""
    request, space, objective = folder.request, folder.request.space(n), objective_of(folder.request.task)
    if space.count() > 100_000:  # too many rows; the proof holds for every candidate without them
        return
    candidates = space.candidates()
    while batch := list(islice(candidates, 1000)):
        rows = [row_of(proof, c.key, n, c.orbit, request.starts, bound, objective) for c in batch]
        folder.ledger.record(request.contexts(n)[0], [(row, None) for row in rows])


def record_pruned(folder: RunFolder, n: int, lower_bound: float) -> bool:
    """Write a row for every pruned candidate; return False if the design that pruned them is not clear."""
    ledger, space = folder.ledger, folder.request.space(n)
    best = ledger.best_clear(n)
    if best is None or best.objective is None or may_beat(best.objective, lower_bound):
        return False
    solved = {row.key for row in ledger.ranking(n)}
    rows = [
        Row(candidate.key, n, candidate.orbit, status="pruned", asked=0, lower_bound=lower_bound)
        for candidate in space.candidates()
        if candidate.key not in solved
    ]
    ledger.record(folder.request.contexts(n)[0], [(row, None) for row in rows])
    return True


def _is_same_platform(old: Design | Infeasible | None, new: Design | Infeasible | None) -> bool:
    """True if two designs are equal but for the record of the solver, so that one audit holds for both."""
    if not isinstance(old, Design) or not isinstance(new, Design):
        return False
    return old.model_copy(update={"solver": None}) == new.model_copy(update={"solver": None})


def audit_best(folder: RunFolder, n: int, bound: float, tools: Tools) -> None:
    """Audit the best designs of n modules until no unaudited design can beat the best clear one.

    Args:
        folder: the run's folder.
        n: number of modules.
        bound: bound of the objective for this size.
        tools: solver, audit, engine and observer.
    """
    ledger, request = folder.ledger, folder.request
    contexts = request.contexts(n)
    tasks = [context.task for context in contexts]
    for batch in _batches(ledger, contexts[0]):
        margins, best = {row.key: Margins(tasks) for row in batch}, ledger.best_clear(n) or batch[0]
        for step, context in enumerate(contexts):
            pending = [row for row in batch if margins[row.key].step == step]
            if step and (jobs := _jobs(ledger, context, pending, request)):
                if time.monotonic() >= tools.until:
                    break
                ledger.add_context(context, bound, None)
                tools.observer.phase(solving_phase("polishing", context.task, len(jobs), request.starts))
                for job, outcome in tools.solve(jobs):
                    record(ledger, context, job, outcome, bound=bound)
                    tools.observer.settled(best)
            _audit(ledger, context, _rows(ledger, context, pending), tools)
            for row in _rows(ledger, context, pending):
                if not row.clear and (audit := ledger.audit(context, row.key)) is not None:
                    margins[row.key].raise_after(audit)


def needs_audit(ledger: Ledger, contexts: Sequence[Context], starts: int) -> bool:
    """Return whether a design that may be the best must still be audited, or solved again after its audit."""
    best = ledger.best_clear(contexts[0].task.n)
    for batch in _batches(ledger, contexts[0]):
        for row in batch:
            if best is not None and best.rank[:2] <= row.rank[:2]:
                return False
            if _is_pending(ledger, contexts, row.key, starts):
                return True
    return False


def _batches(ledger: Ledger, context: Context) -> Iterator[list[Row]]:
    """Yield batches of designs, best first, until a clear one is at least as good as all that follow."""
    for first in count(0, AUDIT_BATCH):
        batch, best = ledger.best_designs(context, first, AUDIT_BATCH), ledger.best_clear(context.task.n)
        if not batch or (first and best is not None and best.rank[:2] <= batch[0].rank[:2]):
            return
        yield batch


def _is_pending(ledger: Ledger, contexts: Sequence[Context], key: str, starts: int) -> bool:
    """Return whether a candidate is neither clear nor skipped yet."""
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
    """Return the jobs for candidates that are not solved from all starts in a context with a larger margin."""
    jobs, solved_starts = [], {score.key: score.starts for score in ledger.scores(context)}
    for row in rows:
        starts = range(solved_starts.get(row.key, 0), request.starts)
        if starts:
            warm_starts = () if starts.start else request.near
            topology = Topology.from_key(row.key)
            jobs.append(Job(context.task, topology, starts, context.seed, warm_starts, row.orbit))
    return jobs


def _rows(ledger: Ledger, context: Context, rows: Sequence[Row]) -> list[Row]:
    candidates = (ledger.row(context, row.key) for row in rows)
    return [row for row in candidates if row is not None and row.feasible]


def _audit(ledger: Ledger, context: Context, rows: Sequence[Row], tools: Tools) -> None:
    """Audit designs that have no audit yet, and record their verdicts."""
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

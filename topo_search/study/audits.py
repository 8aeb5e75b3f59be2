"""The best designs are audited; one that does not pass is solved again with a larger margin, or passed over.

The first ten designs of a ranking are audited, then ten more, until the best clear one is at least as good as
all that were not looked at. What happens to a design depends on itself alone, not on the order of events.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import partial

from topo_search.engine import AuditDesign, Engine, Failed, Job, Verbs, audit_deadline, solved
from topo_search.model import Audit, Design, Topology
from topo_search.study.identity import Context
from topo_search.study.ledger import Ledger
from topo_search.study.observer import Observer
from topo_search.study.recording import record
from topo_search.study.row import Row

AUDITED = 10
"""Number of designs that are audited at a time, best first."""


def audit_best(
    ledger: Ledger,
    contexts: Sequence[Context],
    verbs: Verbs,
    engine: Engine,
    *,
    starts: int,
    lower_bound: float,
    observer: Observer,
    until: float = math.inf,
) -> None:
    """Audit the best designs of one size until one is clear that nothing unaudited can beat.

    Args:
        ledger: where designs are read and verdicts written.
        contexts: of this size: the task's own margin, then each larger one.
        verbs: solver and audit.
        engine: where they run.
        starts: number of starts when a design is solved again.
        lower_bound: of this size [rad^4/s^4].
        observer: is told what does not pass.
        until: time.monotonic() after which nothing is solved again.
    """
    place = 0
    while batch := ledger.best_designs(contexts[0], place, AUDITED):
        best = ledger.best_clear(contexts[0].task.n)
        if place and best is not None and _objective(best) <= _objective(batch[0]):
            return
        rows = batch
        for context in contexts:
            if context.step:
                jobs = _jobs(ledger, context, rows, starts)
                if jobs and time.monotonic() >= until:
                    break
                ledger.begin(context, lower_bound, None)
                for job, outcome in solved(iter(jobs), solve=verbs.solve, engine=engine, until=until):
                    record(ledger, context, job, outcome, lower_bound=lower_bound)
                rows = _rows(ledger, context, rows)
            _audit(ledger, context, rows, verbs.audit, engine)
            rows = [row for row in _rows(ledger, context, rows) if not row.clear and row.audit_failure is None]
            for row in rows:
                observer.note(f"{row.key}: the audit of the design with margin {row.margin:g} m is {row.audit}")
        place += AUDITED


def audits_left(ledger: Ledger, contexts: Sequence[Context], starts: int) -> bool:
    """Return whether a design that may be the best is still to be audited, or solved again after its audit."""
    best = ledger.best_clear(contexts[0].task.n)
    place = 0
    while batch := ledger.best_designs(contexts[0], place, AUDITED):
        for row in batch:
            if best is not None and _objective(best) <= _objective(row):
                return False
            if _left(ledger, contexts, row.key, starts):
                return True
        place += AUDITED
    return False


def _left(ledger: Ledger, contexts: Sequence[Context], key: str, starts: int) -> bool:
    """Return whether one candidate is not yet clear, nor passed over."""
    for context in contexts:
        row = ledger.row(context, key)
        if row is None or (context.step and row.asked < starts):
            return True
        if not row.feasible:
            return False
        if not row.audit_ended:
            return True
        if row.clear or row.audit_failure is not None:
            return False
    return False


def _jobs(ledger: Ledger, context: Context, rows: Sequence[Row], starts: int) -> list[Job]:
    """Return what is to be solved in a context with a larger margin."""
    jobs = []
    for row in rows:
        before = ledger.row(context, row.key)
        first = 0 if before is None else before.asked
        if first < starts:
            topology = Topology.from_key(row.key)
            jobs.append(Job(context.task, topology, row.orbit, range(first, starts), context.seed))
    return jobs


def _rows(ledger: Ledger, context: Context, rows: Sequence[Row]) -> list[Row]:
    """Return the rows of the same candidates that have a design in a context."""
    found = (ledger.row(context, row.key) for row in rows)
    return [row for row in found if row is not None and row.feasible]


def _audit(ledger: Ledger, context: Context, rows: Sequence[Row], audit: AuditDesign, engine: Engine) -> None:
    """Audit the designs that were not, and write their verdicts."""
    keys = [row.key for row in rows if not row.audit_ended]
    results = engine.run(
        partial(_audit_named, audit),
        ((key, ledger.result(context, key)) for key in keys),
        deadline=lambda _: audit_deadline(context.task.n),
    )
    for (key, _), verdict in results:
        if isinstance(verdict, Failed):
            ledger.record_audit_failure(context, key, verdict.reason)
        else:
            ledger.record_audit(context, key, verdict)


def _audit_named(audit: AuditDesign, named: tuple[str, Design]) -> Audit:
    """Audit a design that comes with its key (in a worker)."""
    return audit(named[1])


def _objective(row: Row) -> float:
    return math.inf if row.objective is None else row.objective

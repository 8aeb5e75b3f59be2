"""The best designs are audited; one that does not pass is solved again with a larger margin, or passed over.

The first ten designs of a ranking are audited, then ten more, until the best clear one is at least as good as
all that were not looked at. What happens to a design depends on itself alone, not on the order of events.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import count

from topo_search.engine import Failed, Job, audit_deadline, audit_job
from topo_search.model import Topology
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Ledger
from topo_search.study.progress import AUDITED, Phase, audit_phase, solving_seconds
from topo_search.study.request import Context, Margins, Request
from topo_search.study.row import Row
from topo_search.study.solving import Tools, record


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
                seconds = solving_seconds(context.task, request.starts)
                tools.observer.phase(Phase("polishing", n, len(jobs), request.starts, seconds))
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

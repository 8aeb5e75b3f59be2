"""Rows in the ledger: of the outcome of a job, and of candidates that a bound rules out.

The latter are skipped and counted, unless the design that ruled them out fails its audit.
"""

from __future__ import annotations

from dataclasses import replace

from topo_search.engine import Failed, Job, Outcome, Space, may_beat, merge
from topo_search.model import Design, Infeasible
from topo_search.study.identity import Context
from topo_search.study.ledger import Ledger
from topo_search.study.row import FLIGHT, Row, row_of


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

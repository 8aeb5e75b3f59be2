"""From the outcome of a job to its row in the ledger."""

from __future__ import annotations

from dataclasses import replace

from topo_search.engine import Failed, Job, Outcome, merge
from topo_search.model import Design, Infeasible
from topo_search.study.identity import Context
from topo_search.study.ledger import Ledger
from topo_search.study.row import FLIGHT, Row, row_of


def record(ledger: Ledger, context: Context, job: Job, outcome: Outcome, *, lower_bound: float) -> Row:
    """Write what became of a job, and return the candidate's row.

    More starts of a candidate extend its row; giving them up leaves what the earlier ones found.
    """
    key, asked = job.topology.key, job.starts.stop
    before, earlier = ledger.row(context, key), ledger.result(context, key)
    if before is not None and earlier is not None and isinstance(outcome, Failed):
        row = replace(before, asked=asked)
        ledger.record(context, [(row, earlier)])
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


def _same_platform(earlier: Design | Infeasible | None, later: Design | Infeasible | None) -> bool:
    """Whether an audit of the one is an audit of the other: they differ in how they were found, if at all."""
    if not isinstance(earlier, Design) or not isinstance(later, Design):
        return False
    return earlier.model_copy(update={"solver": None}) == later.model_copy(update={"solver": None})

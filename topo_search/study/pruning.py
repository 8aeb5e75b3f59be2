"""Candidates that a bound rules out: skipped and counted, unless the design that ruled them out fails its audit."""

from __future__ import annotations

from topo_search.engine import Space, may_beat
from topo_search.study.identity import Context
from topo_search.study.ledger import Ledger
from topo_search.study.row import Row


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

"""What a run is going to do, from its request and from what its ledger already holds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from topo_search.engine import rounds
from topo_search.study.audits import AUDITED
from topo_search.study.folder import RunFolder
from topo_search.study.phases import WRITING, Phase, PhaseName, Plan, audit_phase, proof_phase, solving_seconds


def remaining_plan(folder: RunFolder, workers: int | None, time_limit: float) -> Plan:
    """Return what is left to do of a run.

    Args:
        folder: of the run.
        workers: how many jobs run at a time; None where that is not known.
        time_limit: [s]
    """
    timed = math.isfinite(time_limit)
    phases = [phase for level in folder.levels() for phase in _level(level, timed=timed)]
    return Plan((*phases, WRITING), workers, time_limit)


def _level(folder: RunFolder, *, timed: bool) -> Iterator[Phase]:
    """Yield what is left to do of all sizes."""
    request, ledger = folder.request, folder.ledger
    for n in request.task.sizes:
        context = request.contexts(n)[0]
        bound = ledger.bound(context)
        if bound is None:
            yield proof_phase(n)
        elif bound[1] is not None:
            continue  # it is proven impossible
        count = request.space(n).count()
        candidates = count if request.trials is None else min(count, request.trials)
        if ledger.has_failures(context) or not ledger.has_ended(context, request.starts, request.trials):
            stops = [0, *(part.stop for part in rounds(request.starts, request.starts, timed=timed))]
            for before, stop in pairwise(stops):
                left = candidates - ledger.count_solved(context, stop)
                name: PhaseName = "polishing" if before else "searching"
                if left > 0:
                    yield Phase(name, n, left, stop, solving_seconds(context.task, stop - before))
            yield audit_phase(n, min(AUDITED, candidates))

"""The causes of a run without a design: which limits, relaxed alone, give its closest trees one."""

from __future__ import annotations

from heapq import nsmallest
from itertools import islice

from topo_search.engine import Backends, Engine, scaled_violation
from topo_search.model import Relaxed, Topology
from topo_search.model.files import to_json
from topo_search.study.folder import RunFolder
from topo_search.study.observer import Observer
from topo_search.study.relaxing import TREES, relax

RELAXED = "relaxed"
"""The folder of what gives the closest trees a design, one file per size without any."""
SIZES = 2
"""Most sizes that causes are sought for, the largest."""


def find_causes(folder: RunFolder, backends: Backends, engine: Engine, observer: Observer, until: float) -> None:
    """Keep what gives the closest trees a design, of sizes that were searched to the end, if no size has any.

    Where every candidate failed nothing is known to bind. Limits that could not be tried are tried again.

    Args:
        folder: of a run without goals, or of its loosest level.
        backends: solver and proofs.
        engine: where it runs.
        observer: is told of the progress.
        until: time.monotonic() at which to stop.
    """
    request, ledger = folder.request, folder.ledger
    sizes = list(request.task.sizes)
    if any(row.feasible for n in sizes for row in ledger.ranking(n)):
        folder.drop_within(RELAXED)
        return
    for n in sizes[-SIZES:]:
        context, kept = request.contexts(n)[0], causes(folder, n)
        bound = ledger.bound(context)
        proven = bound is not None and bound[1] is not None
        ended = proven or ledger.has_ended(context, request.starts, request.trials)
        tried = kept is not None and kept.starts >= request.starts and not kept.untried
        if not ended or tried or not (trees := _closest(folder, n, proven=proven)):
            continue
        found = relax(
            request.task,
            trees,
            starts=request.starts,
            seed=request.seed,
            backends=backends,
            engine=engine,
            observer=observer,
            until=until,
        )
        if found is not None:
            folder.keep_within(RELAXED, _name(n), to_json(found))


def causes(folder: RunFolder, n: int) -> Relaxed | None:
    """Return what gives the closest trees of n modules a design; None where that was not tried.

    Raises:
        BadInput: what was written of it is damaged.
    """
    return folder.read_within(RELAXED, Relaxed).get(_name(n))


def _name(n: int) -> str:
    return f"n{n}.json"


def _closest(folder: RunFolder, n: int, *, proven: bool) -> list[Topology]:
    """Return the trees that came closest to a design; of those that are proven impossible, any."""
    request, rows = folder.request, list(folder.ledger.ranking(n))
    task = request.contexts(n)[0].task
    missed = [
        (scaled_violation(row.violation, row.unit or "", task), row.key)
        for row in rows
        if row.status == "infeasible" and row.violation is not None
    ]
    if missed:
        return [Topology.from_key(key) for _, key in nsmallest(TREES, missed)]
    if proven:
        return list(dict.fromkeys(request.space(n).sample(TREES, request.seed)))
    impossible = (row.key for row in rows if row.status == "impossible")
    return [Topology.from_key(key) for key in islice(impossible, TREES)]

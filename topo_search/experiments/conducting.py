"""An experiment, and how its cells are measured: solved, audited and timed in worker processes."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import nlp
from topo_search.compose import BACKENDS, available_cores
from topo_search.engine import Backends, Failed, Workers, audit_deadline, merge, record_of, solve_deadline
from topo_search.experiments.folder import Measured, Results, identify, results
from topo_search.experiments.plan import Cell, Settings
from topo_search.model import Audit, Design, Infeasible, Status, Topology
from topo_search.model.files import read_task
from topo_search.study import Observer, Phase, Silent
from topo_search.study.ledger_file import KEPT
from topo_search.supervisor import Clock, peak_mb
from topo_search.topologies import sample
from verify.kinematics import platform

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Experiment:
    """A question, the cells that answer it, and how their rows are read."""

    name: str
    question: str
    full: Settings
    """The settings without options."""
    small: Settings
    """Settings that finish in seconds."""
    cells: Callable[[Settings], list[Cell]]
    """The plan, by ascending size."""
    summary: Callable[[pd.DataFrame], pd.DataFrame]
    """The rows summed up."""
    findings: Callable[[pd.DataFrame], list[str]]
    """Findings from the rows, in sentences."""
    figure: Callable[[pd.DataFrame], Figure]
    """The rows drawn; needs matplotlib."""


def conduct(
    experiment: Experiment,
    settings: Settings,
    out: str | Path,
    *,
    workers: int | None = None,
    observer: Observer | None = None,
    backends: Backends = BACKENDS,
) -> pd.DataFrame:
    """Measure the cells that have no row yet, and return all rows.

    Args:
        experiment: what to measure.
        settings: its conditions.
        out: its folder; resumed if it holds the same experiment with the same settings.
        workers: worker processes; default: the cores available. Times are CPU times, but cores share caches.
        observer: receives the progress.
        backends: solver and audit.

    Raises:
        BadInput: settings or folder cannot be used.
        KeyboardInterrupt: after Ctrl-C; all rows are kept, and a note (PEP 678) says so.
        ResultsLost: the folder or its rows vanished meanwhile.
    """
    observer = observer or Silent()
    cells = experiment.cells(settings)
    for cell in {(cell.task, cell.variant, cell.distance_m): cell for cell in cells}.values():
        cell.resolve()  # what does not fit together is refused before any work is done
    command = f"topo-search experiment {experiment.name} {settings.as_options()}"
    about = identify(experiment.name, settings.as_json(), command)
    with Results.open(Path(out), about) as rows, Workers(workers or available_cores()) as pool:
        for n, size in groupby(cells, key=lambda cell: cell.n):
            todo = [cell for cell in size if not rows.has(cell)]
            if not todo:
                continue
            nlp.prepare(todo[0].resolve(), observer.note)
            observer.phase(Phase("searching", n, len(todo), settings.starts))
            try:
                for cell, row in pool.run(functools.partial(measure, backends), todo, deadline=_deadline):
                    rows.add(failure_row(cell, row) if isinstance(row, Failed) else row)
                    observer.settled(None)
            except KeyboardInterrupt as stop:
                rows.require()
                stop.add_note(KEPT)
                raise
        rows.require()
    return results(out)


def _deadline(cell: Cell) -> float:
    return cell.settings.time_limit + solve_deadline(cell.n, len(cell.rounds[0])) + audit_deadline(cell.n)


def measure(backends: Backends, cell: Cell) -> Measured:
    """Solve and audit one cell (in a worker)."""
    _load(backends, cell.task, cell.distance_m, min(cell.n, 8))  # with eight all of the compiled code is used
    task, topology = cell.resolve(), Topology.from_key(cell.key)
    clock, spent, iterations = Clock(), 0.0, 0
    best: Design | Infeasible | None = None
    for starts in cell.rounds:
        outcome = backends.solve(task, topology, starts=starts, seed=cell.settings.seed)
        best = outcome if best is None else merge(best, outcome, task)
        spent += clock.lap()
        record = record_of(outcome)
        iterations += 0 if record is None else record.iterations
        if isinstance(outcome, Design) or outcome.status == "impossible" or spent > cell.settings.time_limit:
            break
    assert best is not None  # as `Settings` has a start
    record = record_of(best)
    row = Measured(
        **cell.identity,
        status="feasible" if isinstance(best, Design) else best.status,
        starts=0 if record is None else record.starts,
        solve_s=round(spent, 4),
        iterations=iterations,
        peak_mb=round(peak_mb(), 1),
    )
    if not isinstance(best, Design):
        return replace(row, worst_constraint=best.worst_constraint, violation=best.violation, unit=best.unit)
    offset = round(math.hypot(*platform(best).p_e), 6)
    row = replace(row, objective=best.objective, lower_bound=best.lower_bound, gap=best.gap, offset_m=offset)
    audit = backends.audit(best)
    return replace(row, audit_s=round(clock.lap(), 4), peak_mb=round(peak_mb(), 1), **_audit_columns(audit))


def failure_row(cell: Cell, failure: Failed) -> Measured:
    """Return the row of a cell whose process ended without an answer."""
    return Measured(**cell.identity, status="failed", worst_constraint=failure.reason)


def _audit_columns(audit: Audit) -> dict[str, Any]:
    """Return the columns that an audit fills."""
    overlaps = audit.interference
    if overlaps is None:
        return {"verdict": str(audit.verdict)}
    depths = [
        -pair.percent
        for pair in audit.pairs
        if pair.kind == "airflow" and pair.status == Status.VIOLATED and pair.percent is not None
    ]
    return {
        "verdict": str(audit.verdict),
        "colliding_pairs": overlaps.colliding_pairs,
        "largest_cluster": len(overlaps.clusters[0]) if overlaps.clusters else 0,
        "deepest_percent": overlaps.deepest_percent,
        "depths_percent": " ".join(f"{depth:.1f}" for depth in sorted(depths, reverse=True)) or None,
    }


@functools.cache
def _load(backends: Backends, task: str, distance_m: float, n: int) -> None:
    """Solve and audit a small platform once per process: it loads compiled code, which no row should count."""
    resolved = read_task(task, (f"modules={n}", f"module.connector_distance={distance_m}")).resolve(n)
    design = backends.solve(resolved, sample(n, 1, 0)[0], starts=range(1), seed=0)
    if isinstance(design, Design):
        backends.audit(design)

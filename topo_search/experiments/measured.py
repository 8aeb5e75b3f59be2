"""What is measured of a cell: solved, audited and timed in a worker process."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, fields, replace
from typing import Any

from topo_search.engine import Backends, Failed, merge, record_of
from topo_search.engine.usage import Clock, peak_mb
from topo_search.experiments.cell import Cell
from topo_search.export.poses import poses
from topo_search.model import Audit, Design, Infeasible, Status, Topology
from topo_search.model.files import read_task
from topo_search.topologies import sample

METHOD = "topo-search"
"""Rows of the formulation written directly, made by `tests/benchmarks/direct_scaling.py`, say `direct`."""
COMPILED = 8
"""A size at which the solver uses all of its compiled code."""


@dataclass(frozen=True)
class Measured:
    """A row of `results.csv`; a value that there is none of is left empty."""

    variant: str
    """The problem, where an experiment compares several."""
    task: str
    distance_m: float
    """Connector distance [m]."""
    n: int
    key: str
    task_seed: int | None
    """Draws the ten wrenches."""
    status: str
    """feasible, infeasible, impossible (proven) or failed."""
    method: str = METHOD
    starts: int = 0
    """Starts that were solved."""
    solve_s: float = 0.0
    """CPU seconds of all starts, building included unless `build_s` has it."""
    build_s: float | None = None
    """CPU seconds of building the program before the first start, for a method that does."""
    audit_s: float | None = None
    """CPU seconds of the audit."""
    iterations: int = 0
    """Ipopt iterations; of the best start alone where all starts are solved at once."""
    peak_mb: float | None = None
    """Most memory of the worker process so far [MB]. It solves small platforms before large ones."""
    objective: float | None = None
    """J [rad^4/s^4]."""
    lower_bound: float | None = None
    """[rad^4/s^4]"""
    gap: float | None = None
    offset_m: float | None = None
    """Distance of the end-effector from the centre of mass [m]."""
    verdict: str | None = None
    """Of the audit; `failed` with the reason in `worst_constraint` if there is none."""
    colliding_pairs: int | None = None
    """Pairs of airflow envelopes proven to overlap."""
    largest_cluster: int | None = None
    """Modules in the largest cluster of overlapping envelopes; 0 without overlap."""
    deepest_percent: float | None = None
    """Deepest overlap in percent of the deepest possible."""
    depths_percent: str | None = None
    """Depths of all colliding pairs in the same percent, deepest first, with spaces in between."""
    worst_constraint: str | None = None
    """What was missed by the start that came closest; what happened if the cell failed."""
    violation: float | None = None
    unit: str | None = None


COLUMNS = tuple(field.name for field in fields(Measured))


def measure(backends: Backends, cell: Cell) -> Measured:
    """Solve and audit one cell (in a worker)."""
    _load(backends, cell.task, cell.distance_m, min(cell.n, COMPILED))
    task, topology = cell.resolve(), Topology.from_key(cell.key)
    clock, spent, iterations = Clock(), 0.0, 0
    best: Design | Infeasible | None = None
    for starts in cell.rounds:
        outcome = backends.solve(task, topology, starts=starts, seed=cell.seed)
        best = outcome if best is None else merge(best, outcome, task)
        spent += clock.lap()
        record = record_of(outcome)
        iterations += 0 if record is None else record.iterations
        if isinstance(outcome, Design) or outcome.status == "impossible" or spent > cell.time_limit:
            break
    if best is None:
        raise ValueError(f"`starts >= 1` must hold, but got {cell.starts}")
    row = _outcome(cell, best, spent, iterations)
    if not isinstance(best, Design):
        return row
    audit = backends.audit(best)
    return replace(row, audit_s=round(clock.lap(), 4), peak_mb=round(peak_mb(), 1), **_audit_columns(audit))


def failure_row(cell: Cell, failure: Failed) -> Measured:
    """Return the row of a cell whose process ended without an answer."""
    return Measured(**cell.identity, status="failed", worst_constraint=failure.reason)


def _outcome(cell: Cell, best: Design | Infeasible, spent: float, iterations: int) -> Measured:
    """Return what the solver alone tells of a cell."""
    record = record_of(best)
    row = Measured(
        **cell.identity,
        status="feasible" if isinstance(best, Design) else best.status,
        starts=0 if record is None else record.starts,
        solve_s=round(spent, 4),
        iterations=iterations,
        peak_mb=round(peak_mb(), 1),
    )
    if isinstance(best, Design):
        offset = math.hypot(*poses(best).p_E)
        return replace(
            row, objective=best.objective, lower_bound=best.lower_bound, gap=best.gap, offset_m=round(offset, 6)
        )
    return replace(row, worst_constraint=best.worst_constraint, violation=best.violation, unit=best.unit)


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
    """Solve and audit a small platform once a process: it loads compiled code, which no row should count."""
    resolved = read_task(task, (f"modules={n}", f"module.connector_distance={distance_m}")).resolve(n)
    design = backends.solve(resolved, sample(n, 1, 0)[0], starts=range(1), seed=0)
    if isinstance(design, Design):
        backends.audit(design)

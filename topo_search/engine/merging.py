"""More starts of a candidate: the best of two ranges of starts is the best of their union."""

from __future__ import annotations

from topo_search.engine.shortfall import scaled_violation
from topo_search.model import Design, Infeasible, ResolvedTask, SolverRecord


def record_of(result: Design | Infeasible) -> SolverRecord | None:
    """Return how a result came about, if it says so."""
    if isinstance(result, Infeasible) or result.solver is None:
        return result.solver if isinstance(result, Infeasible) else None
    return SolverRecord.model_validate(result.solver)


def merge(earlier: Design | Infeasible, later: Design | Infeasible, task: ResolvedTask) -> Design | Infeasible:
    """Return the better of two results of one candidate, with the starts of both counted; `earlier` wins a tie."""
    best = min(earlier, later, key=lambda result: _standing(result, task))
    records = [record for record in (record_of(earlier), record_of(later)) if record is not None]
    kept = record_of(best)
    if kept is None:
        return best
    record = kept.model_copy(
        update={
            "starts": sum(record.starts for record in records),
            "starts_feasible": sum(record.starts_feasible for record in records),
            "objectives": tuple(J for record in records for J in record.objectives),
            "seconds": sum(record.seconds for record in records),
        }
    )
    if isinstance(best, Design):
        return best.model_copy(update={"solver": record.model_dump(mode="json")})
    both = [result for result in (earlier, later) if isinstance(result, Infeasible)]
    return best.with_starts((shortfall for result in both for shortfall in result.shortfalls), record)


def _standing(result: Design | Infeasible, task: ResolvedTask) -> tuple[bool, float]:
    """Order designs by objective, before all that is infeasible, by violation."""
    if isinstance(result, Design):
        return False, result.objective
    return True, scaled_violation(result.violation, result.unit, task)

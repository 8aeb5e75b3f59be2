"""The starts of a candidate: ranges that follow each other, and the better of the results of two.

The best of two ranges of starts is the best of their union. Infeasible ends are compared by their violation, scaled
so that units do not matter.
"""

from __future__ import annotations

from collections.abc import Iterator

from topo_search.model import Design, Infeasible, ResolvedTask, SolverRecord

LARGEST_TIMED_ROUND = 4
"""Starts a round under a time limit: what runs when it comes is lost."""


def rounds(starts: int | None, size: int, *, timed: bool) -> Iterator[range]:
    """Yield the ranges of starts that are solved one after the other, short ones first where time may end.

    Args:
        starts: how many there are; None: without end.
        size: of a round without a time limit; with one, rounds grow from a single start.
        timed: whether there is a time limit.
    """
    first = 0
    while starts is None or first < starts:
        length = min(max(1, first), LARGEST_TIMED_ROUND) if timed else size
        stop = first + length if starts is None else min(first + length, starts)
        yield range(first, stop)
        first = stop


def record_of(result: Design | Infeasible) -> SolverRecord | None:
    """Return how a result came about, if it says so."""
    if isinstance(result, Infeasible) or result.solver is None:
        return result.solver if isinstance(result, Infeasible) else None
    return SolverRecord.model_validate(result.solver)


def merge(earlier: Design | Infeasible, later: Design | Infeasible, task: ResolvedTask) -> Design | Infeasible:
    """Return the better of two results of one candidate, with the starts of both counted; `earlier` wins a tie."""
    best = min(earlier, later, key=lambda result: _rank(result, task))
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


def _rank(result: Design | Infeasible, task: ResolvedTask) -> tuple[bool, float]:
    """Order designs by objective, before all that is infeasible, by violation."""
    if isinstance(result, Design):
        return False, result.objective
    return True, scaled_violation(result.violation, result.unit, task)


def scaled_violation(violation: float, unit: str, task: ResolvedTask) -> float:
    """Return a violation in the task's own units: m_t g, l_arm m_t g, l_arm, u_max, rad."""
    scales = {
        "N": task.force_unit(task.n),
        "N m": task.torque_unit(task.n),
        "m": task.module.arm_length,
        "rad^2/s^2": task.module.max_input(task.gravity),
    }
    return violation / scales.get(unit, 1.0)

"""The answer of a run, read from its ledger."""

import math
import os
import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import count
from pathlib import Path

from topo_search.engine.workers import scaled_violation
from topo_search.limits import quantity
from topo_search.model import LEAST_EFFORT, BadInput, Design, Infeasible, Objective
from topo_search.model.features import objective_of
from topo_search.study.answer import SHOWN, Answer, LevelAnswer, SizeAnswer, quotient_remark
from topo_search.study.directory import RunFile
from topo_search.study.features import ADD_TO_ANSWER, ADD_TO_SIZE
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import NEAR_BEST, Row
from topo_search.study.ledger_file import LedgerLost, damage
from topo_search.study.request import Request
from topo_search.study.solving import needs_audit


@contextmanager
def detect_loss(folder: RunFolder) -> Iterator[None]:
    """Turn an error into LedgerLost if the folder or its ledger is gone, with what can still be read of them."""
    try:
        yield
    except (LedgerLost, OSError, sqlite3.Error, BadInput) as error:
        try:
            folder.ledger.require()
        except LedgerLost as lost:
            with suppress(OSError, sqlite3.Error, BadInput):  # the file is open, but may be empty
                lost.answer = answer_of(folder)
                lost.design = lost.answer.design or _best_unaudited(folder)
            raise lost from error
        raise


def complete_answer(path: Path, request: Request) -> Answer | None:
    """Return the answer of a complete run from a read-only folder; None if the run is not complete."""
    if not os.access(path / RunFile.LEDGER, os.R_OK):
        return None
    with RunFolder.load(path, request) as folder:
        answer = answer_of(folder)
    return answer if answer.complete else None


def answer_of(folder: RunFolder) -> Answer:
    """Return the answer of a run so far, from its ledger."""
    goals = folder.request.task.goals
    sizes = [tuple(_size_answer(level, n) for n in level.request.task.sizes) for level in folder.levels]
    answer = Answer(folder.path, sizes[0])
    if goals.names:
        levels = tuple(map(LevelAnswer, count(), goals.levels, sizes))
        answer = replace(answer, levels=levels)
    for add in ADD_TO_ANSWER:
        answer = add(folder, answer)
    if answer.best is None:
        return answer
    design, audit = folder.levels[answer.level].result_of(answer.best)
    return replace(answer, design=design, audit=audit)


def read_answer(path: str | Path) -> Answer:
    """Return the answer in a run's folder so far.

    Raises:
        BadInput: it is not a run folder.

    Example:
        >>> from topo_search import read_answer
        >>> answer = read_answer("hover-2")
        >>> answer.best.key, answer.complete
        ('a10', True)
    """
    with RunFolder.load(Path(path)) as folder:
        return answer_of(folder)


def _best_unaudited(folder: RunFolder) -> Design | None:
    """Return the best design of the smallest size that has one, regardless of its audit."""
    for level in folder.levels:
        for n in level.request.task.sizes:
            row = next(level.ledger.ranking(n), None)
            if row is not None and (design := level.result_of(row)[0]) is not None:
                return design
    return None


def _size_answer(folder: RunFolder, n: int) -> SizeAnswer:
    """Return the answer of one size of a task, or of one level of its goals."""
    ledger, request = folder.ledger, folder.request
    contexts, space, quotient = request.contexts(n), request.space(n), request.quotient(n)
    candidates, covers, task = space.count(), request.covers(n), contexts[0].task
    objective = objective_of(task)
    bound, impossible = ledger.bound(contexts[0]) or (0.0, None)
    lower_bound, value_bound = objective.bounds(bound)
    is_complete = impossible is not None or ledger.is_complete(contexts[0], request.starts, request.trials)
    statuses = Counter[str]()
    fewest_starts, feasible, repeated = request.starts, 0, 0
    best, closest, smallest_violation = None, None, math.inf
    top, near_best, remarks = list[Row](), list[Row](), list[str]()
    for row in ledger.ranking(n):  # one pass: there may be millions
        if objective.breaks(row, bound):  # a false bound would void all that is proven
            number = objective.number(row)
            raise damage(ledger.path, f"{row.key} has an objective of {number}, beyond the bound {bound}")
        statuses[row.status] += 1
        if row.status in ("feasible", "infeasible"):
            fewest_starts = min(fewest_starts, row.asked)
        if row.feasible:
            feasible += row.orbit if quotient.exact else 1
            repeated += bool(row.step)
            if best is None and row.clear:
                best = row
            if best and objective.excess(row, best) <= NEAR_BEST:
                near_best.append(row)
            if len(top) < SHOWN:
                top.append(row)
            remarks.extend(remark(row))
        elif row.status == "infeasible" and row.violation is not None:
            violation = scaled_violation(row.violation, row.unit or "", task)
            if violation < smallest_violation:
                closest, smallest_violation = row, violation
        elif row.status == "failed" and statuses["failed"] <= SHOWN:
            remarks.append(f"{row.key}: failed, {row.worst_constraint}")
    if repeated:
        again = quantity(repeated, "design")
        remarks.append(f"{again} solved again with a larger margin, as the audit was not clear")
    if statuses["failed"]:
        remarks.append("some candidates failed for reasons that may not recur; the same command solves them again")
    settled = candidates if impossible else statuses.total()
    if is_complete and settled < candidates:
        unknown = f"{candidates - settled} of {candidates} candidates"
        none_better = "" if best is None or not bound else f"; none of them {objective.bound_words(best)}"
        remarks.append(f"{unknown} were never proposed{none_better}")
    failure = None
    if best is None and top and (audit := folder.result_of(top[0])[1]) is not None:
        failure = audit.failure(task)
    solved = settled - statuses["failed"]
    answer = SizeAnswer(
        modules=n,
        rotors=task.number_of_rotors,
        candidates=candidates,
        quotient=quotient_remark(quotient),
        settled=settled,
        starts=fewest_starts if settled >= candidates else 0,
        complete=is_complete and not needs_audit(ledger, contexts, request.starts),
        statuses=dict(statuses),
        feasible=feasible,
        objective=objective,
        lower_bound=lower_bound or 0.0,
        value_bound=value_bound,
        best=best,
        top=tuple(top),
        near_ties=tuple(sorted((row for row in near_best if row.clear), key=_reserve_order)),
        near_ties_unaudited=sum(row.audit is None for row in near_best),
        remarks=tuple(remarks),
        reason=None if feasible else reason(impossible, closest, statuses, task.attitude),
        failure=failure,
        covers_size=covers,
        impossible=impossible is not None or (covers and statuses["impossible"] == candidates),
        statement=None if best is None else statement(best, solved, candidates, objective, task.attitude),
    )
    for add in ADD_TO_SIZE:
        answer = add(folder, answer)
    return answer


def statement(
    best: Row, solved: int, candidates: int, objective: Objective = LEAST_EFFORT, attitude: str = ""
) -> str:
    """State how good the best design is: the best found, and proven by the bound of the size.

    `attitude`: see `ResolvedTask.attitude`.
    """
    number = f"all {candidates}" if solved == candidates else f"{solved} of {candidates}"
    words = "the best found of the only candidate" if candidates == 1 else f"the best found of {number} candidates"
    if best.gap is None:
        return words
    return f"{words}; proven{attitude}: no {best.modules}-module topology {objective.bound_words(best)}"


def reason(proof: Infeasible | None, closest: Row | None, statuses: Counter[str], attitude: str) -> str:
    """Say why there is no design: a proof, or else the smallest shortfall of all starts, which proves nothing.

    Args:
        proof: proof that no topology can do the task, if there is one.
        closest: the candidate with the smallest shortfall among those not proven impossible.
        statuses: number of candidates with each status.
        attitude: see `ResolvedTask.attitude`.
    """
    if proof is not None:
        return proof.message
    number, impossible = statuses.total(), statuses["impossible"]
    if number == 0:
        return "time limit reached before the first candidate was solved; nothing is known yet"
    if impossible == number:
        which = "the only candidate" if number == 1 else f"each of {number} candidates"
        return f"{which} is proven impossible{attitude}; candidates.csv names what it cannot meet"

    def candidates(count: int) -> str:
        return "the only candidate" if number == 1 else quantity(count, "candidate")

    parts, failed = list[str](), statuses["failed"]
    if number > impossible + failed:
        solved = f"no start of {candidates(number - failed)} led to a design"
        parts.append(f"{solved} ({impossible} proven impossible)" if impossible else solved)
    elif impossible:
        parts.append(f"{candidates(impossible)} proven impossible")
    if failed:
        parts.append(f"{candidates(failed)} failed, so nothing is known of {'it' if failed == 1 else 'them'}")
    if closest is not None:
        shortfall = f"{closest.key} misses {closest.worst_constraint} by {closest.violation:.3g} {closest.unit}"
        parts.append(f"smallest shortfall (not a proof): {shortfall}".rstrip())
    return "; ".join(parts)


def remark(row: Row) -> list[str]:
    """Return the remark on a design whose last audit is not clear."""
    if row.audit_failure is not None:
        return [f"{row.key}: skipped, its audit failed: {row.audit_failure}"]
    return [] if row.audit is None or row.clear else [f"{row.key}: skipped, its audit is {row.audit}"]


def _reserve_order(row: Row) -> tuple[float, float, float]:
    reserves = (row.force_reserve_N, row.torque_reserve_Nm)
    force, torque = (-math.inf if reserve is None else reserve for reserve in reserves)
    return -force, -torque, row.objective or 0.0

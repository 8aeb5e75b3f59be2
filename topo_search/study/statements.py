"""What an answer says in words: what is proven, and what was only found or not found."""

from __future__ import annotations

import re
from collections import Counter

from topo_search.engine import may_beat
from topo_search.model import Infeasible
from topo_search.model.proven import gap_percent
from topo_search.study.row import Row


def statement(best: Row, solved: int, candidates: int) -> str:
    """Say what is known of the best design: starts are no proof; the bound is, of every tree of the size."""
    number = f"all {candidates}" if solved == candidates else f"{solved} of {candidates}"
    found = "the best found of the only candidate" if candidates == 1 else f"the best found of {number} candidates"
    if best.gap is None or best.objective is None or best.lower_bound is None:
        return found
    limit = f"more than {gap_percent(best.gap)} " if may_beat(best.objective, best.lower_bound) else ""
    return f"{found}; proven: no {best.modules}-module topology is {limit}better"


def proven_statement(candidates: int, gap: float) -> str:
    """Say that the best design is proven to be the best, but for a share of its effort."""
    number = "the only candidate" if candidates == 1 else f"all {candidates} candidates"
    return f"the best of {number}, proven" + (f" to within {gap_percent(gap)}" if gap > 0 else "")


def reason(proof: Infeasible | None, closest: Row | None, statuses: Counter[str]) -> str:
    """Say why there is no design: what is proven, or the smallest shortfall of all starts, which proves nothing.

    Args:
        proof: that no topology can do it.
        closest: the candidate of the start that came closest, of those that are not proven to be impossible.
        statuses: how many candidates ended with which status.
    """
    if proof is not None:
        return proof.message
    number, impossible = statuses.total(), statuses["impossible"]
    if number == 0:
        return "time limit reached before the first candidate was solved; nothing is known yet"
    if impossible == number:
        which = "the only candidate" if number == 1 else f"each of {number} candidates"
        return f"{which} is proven impossible; candidates.csv names what it cannot meet"

    def candidates(some: int) -> str:
        return "the only candidate" if number == 1 else f"{some} candidate{'s' * (some > 1)}"

    parts, failed = list[str](), statuses["failed"]
    if number > impossible + failed:
        tried = f"no start of {candidates(number - failed)} led to a design"
        parts.append(f"{tried} ({impossible} proven impossible)" if impossible else tried)
    elif impossible:
        parts.append(f"{candidates(impossible)} proven impossible")
    if failed:
        parts.append(f"{candidates(failed)} failed, so nothing is known of {'it' if failed == 1 else 'them'}")
    if closest is not None:
        miss = f"{closest.key} misses `{closest.worst_constraint}` by {closest.violation:.3g} {closest.unit}"
        parts.append(f"smallest shortfall (not a proof): {miss}".rstrip())
    return "; ".join(parts)


def kind_of(constraint: str) -> str:
    """Return the name of a constraint without the numbers of its modules."""
    return re.sub(r"\bmodule \d+", "a module", re.sub(r"\bmodules \d+ and \d+", "two modules", constraint))


def remark(row: Row) -> list[str]:
    """Say what an audit led to, if it was not clear at once."""
    again = f"solved again with margin {row.margin:g} m because its audit was not clear" if row.step else ""
    if row.audit_failure is not None:
        over = f"skipped, its audit failed: {row.audit_failure}"
    elif row.audit is not None and not row.clear:
        over = f"skipped, its audit is {row.audit}"
    else:
        over = ""
    text = "; ".join(part for part in (again, over) if part)
    return [f"{row.key}: {text}"] if text else []

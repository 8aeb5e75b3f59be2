"""An answer is held against everything that it was made from before it is given.

| symbol | meaning | unit |
|---|---|---|
| J | objective: of the row, of the design, and of the design's inputs again | rad^4/s^4 |
| bound | of all topologies of the size: no J lies below it | rad^4/s^4 |
| orbit | number of classes of the exact quotient that a candidate stands for; all add up to that of all | |

Checksums find what changed by accident; this finds what cannot be true, whoever wrote it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

from topo_search.engine import Space
from topo_search.model import Audit, BadInput, Design, Topology
from topo_search.study.ledger import Ledger
from topo_search.study.ledger_file import damage, parse
from topo_search.study.request import Context
from topo_search.study.row import Row, flight_of

BELOW_BOUND = 3.0e-6
"""Share of the bound by which J may lie below it: tolerances of solver and audit (1e-6 each), and rounding."""
SAME = 1.0e-6
"""Relative difference of J and what the inputs cost: the audit's tolerance."""
STATUSES = ("feasible", "infeasible", "impossible", "pruned", "failed")


def check_rows(rows: Iterable[Row], space: Space, lower_bound: float, path: Path) -> Iterator[Row]:
    """Yield the ranked rows of one size, none of which may contradict the bound, the ranking or their number.

    Raises:
        BadInput: one does; names the candidate.
    """
    last, number, orbits, classes = -math.inf, 0, 0, space.classes
    for row in rows:
        number, orbits = number + 1, orbits + row.orbit
        if row.status not in STATUSES or row.orbit < 1 or orbits > classes:
            raise damage(path, f"{row.key} is {row.status!r} and stands for {row.orbit} of {classes} trees")
        if row.feasible != (row.objective is not None):
            raise damage(path, f"{row.key} is {row.status} with the objective {row.objective}")
        if row.objective is not None:
            least = max(lower_bound, row.lower_bound or 0.0)
            if not (math.isfinite(row.objective) and row.objective >= least * (1 - BELOW_BOUND)):
                raise damage(path, f"{row.key} has the objective {row.objective!r}, under the bound of {least!r}")
            if row.objective < last:
                raise damage(path, f"{row.key} is not where its objective ranks it")
            last = row.objective
        yield row
    if number == space.count() and orbits != classes:
        raise damage(path, f"its {number} candidates stand for {orbits} trees, but there are {classes}")


def check_designs(ledger: Ledger, contexts: list[Context], space: Space, rows: Iterable[Row]) -> None:
    """Make sure that rows, designs, audits and trees say the same of each other.

    Raises:
        BadInput: they do not; names the candidate.
    """
    for row in rows:
        if not 0 <= row.step < len(contexts):
            raise _differs(ledger, row, f"margin has place {row.step} of {len(contexts)}")
        context = contexts[row.step]
        design = ledger.result(context, row.key)
        if not isinstance(design, Design):
            raise _differs(ledger, row, "design is none")
        _check_tree(ledger, row, design, space)
        cost = sum(
            case.weight * sum(u * u for u in inputs)
            for case, inputs in zip(design.task.load_cases, design.rotor_speeds_squared, strict=True)
        )
        told = {
            "objective": (row.objective, design.objective),
            "margin": (row.margin, context.margin),
            "task": (design.task, context.task),
            "gap": (row.gap, Design.gap_of(design.objective, row.lower_bound or 0.0)),
        }
        for name, (held, due) in told.items():
            if held != due:
                raise _differs(ledger, row, f"{name} is not that of its design")
        if abs(cost - design.objective) > SAME * abs(design.objective):
            raise _differs(ledger, row, f"objective is {design.objective!r}, but its inputs cost {cost!r}")
        _check_audit(ledger, row, context)


def _check_tree(ledger: Ledger, row: Row, design: Design, space: Space) -> None:
    """Compare the key with the tree, and both with the candidates that there are."""
    try:
        candidate = space.candidate_of(Topology.from_key(row.key))
    except ValueError as error:
        raise _differs(ledger, row, f"key names no tree: {error}") from None
    stated = design.topology_key or row.key
    if not row.key == stated == design.topology.key == candidate.key or design.topology.n != row.modules:
        raise _differs(ledger, row, "key is not that of its tree")
    if row.orbit != candidate.orbit:
        raise _differs(ledger, row, f"tree stands for {candidate.orbit}, not {row.orbit}")


def _check_audit(ledger: Ledger, row: Row, context: Context) -> None:
    """Compare the verdict with the audit."""
    text = ledger.audit(context, row.key)
    if (text is None) != (row.audit is None):
        raise _differs(ledger, row, "audit is gone")
    if text is None:
        return
    audit = parse(ledger.path, Audit, "texts", text, strict=False)
    stated = [one.stated for one in audit.residuals if one.name == "objective"]
    if audit.verdict != row.audit or any(J not in (None, row.objective) for J in stated):
        raise _differs(ledger, row, "audit is not that of its design")
    if any(getattr(row, name) != value for name, value in flight_of(audit).items()):
        raise _differs(ledger, row, "figures are not those of its audit")


def _differs(ledger: Ledger, row: Row, what: str) -> BadInput:
    return damage(ledger.path, f"{row.key}: its {what}")

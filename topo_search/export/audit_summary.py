"""Audits as a Markdown summary: what was decided about each design, and what is not clear, to hand on."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

from topo_search.model import Audit, Clearance, Design, Flight, Residual, RotorsOut, Status
from topo_search.model.flight import direction
from topo_search.model.proven import lower_text, upper_text

LISTED = 50
"""Rows of a design that are listed when they are not clear; the tables hold all."""
DIGITS = 9
"""Of bounds and of numbers that are compared."""


class Judged(NamedTuple):
    """A design with its audit."""

    name: str
    """What the summary calls it: its file."""
    design: Design
    audit: Audit


def markdown(judged: Sequence[Judged], others: Sequence[tuple[str, str]]) -> str:
    """Return the summary of some audits.

    Args:
        judged: the designs.
        others: the names of files that were not audited, each with the reason.
    """
    lines = ["# Audit of designs", "", *_overview(judged)]
    if others:
        lines += ["", "## Not audited", "", *(f"- {escape(name)}: {escape(reason)}" for name, reason in others)]
    for each in judged:
        lines += ["", *_section(each)]
    return "\n".join(lines) + "\n"


def escape(text: str) -> str:
    """Return a text in which nothing is Markdown or HTML; it stays on one line."""
    line = re.sub(r"([\\`*_\[\]<>|&~])", r"\\\1", " ".join(text.split()))
    return re.sub(r"^(\d*)([=+@#-]|(?<=\d)[.)](?= |$))", r"\1\\\2", line)  # no list, no heading, no formula


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows)]


def _overview(judged: Sequence[Judged]) -> list[str]:
    rows = []
    for name, design, audit in judged:
        nearest = _nearest(audit.pairs)
        rows.append(
            [
                escape(name),
                audit.verdict,
                str(design.topology.n),
                "" if nearest is None else lower_text(nearest.analytic_m),
                "" if nearest is None else escape(nearest.name),
                *_overlaps(audit),
            ]
        )
    head = ["design", "verdict", "modules", "least clearance [m]", "of", "overlapping pairs", "deepest", "clusters"]
    return _table(head, rows)


def _overlaps(audit: Audit) -> list[str]:
    found = audit.interference
    if found is None:
        return ["", "", ""]
    deepest = f"{upper_text(found.deepest_percent, 3)} %" if found.colliding_pairs else ""
    return [str(found.colliding_pairs), deepest, ", ".join(str(len(cluster)) for cluster in found.clusters)]


def _section(each: Judged) -> Iterator[str]:
    name, _, audit = each
    yield f"## {escape(name)}"
    yield ""
    yield f"Verdict: **{audit.verdict}**. Versions: {', '.join(' '.join(item) for item in audit.versions.items())}."
    yield ""
    rows = []
    for kind, group in groupby(sorted(audit.pairs, key=lambda pair: pair.kind), key=lambda pair: pair.kind):
        pairs = list(group)
        least = min(pairs, key=lambda pair: pair.analytic_m)
        counts = [str(sum(pair.status == status for pair in pairs)) for status in Status]
        rows.append([kind, *counts, lower_text(least.analytic_m), escape(least.name)])
    yield from _table(["kind", *Status, "least clearance [m]", "of"], rows)
    wrong = [pair for pair in audit.pairs if pair.status != Status.CLEAR]
    if wrong:
        yield ""
        head = ["clearance", "status", "closed form [m]", "at least [m]", "at most [m]", "of the deepest"]
        yield from _table(head, [_clearance_row(pair) for pair in wrong[:LISTED]])
        if len(wrong) > LISTED:
            yield ""
            yield f"{len(wrong) - LISTED} more clearances are not clear."
    off = [row for row in audit.residuals if row.status != Status.CLEAR]
    if off:
        yield ""
        head = ["number", "status", "off by", "unit", "stated", "derived"]
        yield from _table(head, [_residual_row(row) for row in off[:LISTED]])
        if len(off) > LISTED:
            yield ""
            yield f"{len(off) - LISTED} more numbers are off."
    if audit.sensitivity is not None:
        yield ""
        yield from (f"- {line}" for line in tolerance_lines(audit))
    if audit.flight is not None:
        yield ""
        yield from (f"- {line}" for line in flight_lines(audit.flight))
    for larger in audit.mesh_excess:
        yield ""
        yield f"Note: {escape(larger.words)}."
    sheet = audit.assembly.end_effector
    if sheet is not None and sheet.note is not None:
        yield ""
        yield f"Note: {escape(sheet.note)}."
    for pair in wrong[:LISTED]:
        if pair.evidence:
            yield ""
            yield f"Evidence on the {escape(pair.name)}:"
            yield ""
            yield from (f"    {finding}" for finding in pair.evidence)


def tolerance_lines(audit: Audit) -> Iterator[str]:
    """Yield how much error a design tolerates, each kind alone and all of the task's at once, a line each."""
    if (found := audit.sensitivity) is None:
        return
    errors = (
        ("hinge angles may be off", found.hinge_angle_deg, "deg"),
        ("positions may be off", found.position_m, "m"),
        ("airflow may reach farther", found.envelope_m, "m"),
    )
    for name, limit, unit in errors:
        if limit is not None:
            known = "" if limit.violated_at is None else f" (too much: {upper_text(limit.violated_at, 3)} {unit})"
            yield f"{name} by {lower_text(limit.tolerated, 3)} {unit}{known}; first to break: {limit.name}"
    if (words := audit.tolerances_words) is not None:
        yield words


def _clearance_row(pair: Clearance) -> list[str]:
    share = "" if pair.percent is None else f"{lower_text(pair.percent, 3)} %"
    return [escape(pair.name), pair.status, lower_text(pair.analytic_m), *_bounds(pair), share]


def _bounds(pair: Clearance) -> list[str]:
    """Return what a clearance is at least and at most."""
    return [
        "" if pair.lower_m is None else lower_text(pair.lower_m, DIGITS),
        "" if pair.upper_m is None else upper_text(pair.upper_m, DIGITS),
    ]


def _residual_row(row: Residual) -> list[str]:
    stated, derived = _number(row.stated), _number(row.derived)
    return [escape(row.name), row.status, upper_text(row.value), row.unit, stated, derived]


def _nearest(pairs: Sequence[Clearance]) -> Clearance | None:
    return min(pairs, key=lambda pair: pair.analytic_m, default=None)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.{DIGITS}g}"


NAMED = 8
"""Most rotors that are named one by one."""


def flight_lines(found: Flight) -> Iterator[str]:
    """Yield the lines, the weakest point first; what is proven is rounded to the safe side."""
    yield found.weakest_point
    hover = found.hover
    if hover.torque_reserve_Nm is not None and hover.torque_weakest is not None:
        least = f"{lower_text(hover.torque_reserve_Nm, 3)} N m about {direction(hover.torque_weakest)}"
        yield f"least torque that can be added in hover: {least}"
    factors = [(case.load_factor, case.name) for case in found.cases if case.load_factor is not None]
    if factors:
        factor, name = min(factors)
        yield f"load factor until a rotor saturates: {lower_text(factor, 4)}, in {name}"
    yield f"hover with one rotor dead: {_rotors_out(found.rotors_out_hover)}"
    yield f"hover and all load cases with one rotor dead: {_rotors_out(found.rotors_out_all)}"
    stated = [load for load in found.joints if load.case != hover.name]
    if stated:
        worst = max(stated, key=lambda load: load.moment_Nm)
        size = f"{upper_text(worst.moment_Nm, 3)} N m and {upper_text(worst.force_N, 3)} N"
        yield f"largest moment in a joint: {size}, between modules {worst.module} and {worst.child} in {worst.case}"
    if found.hover_input is not None and found.hover_power_ratio is not None:
        yield (
            f"hover takes {100 * found.hover_input:.3g} % of the largest input on average, and "
            f"{found.hover_power_ratio:.3g} times the power of rotors that all pull straight up"
        )
    yield f"the platform spans {found.span_m:.3g} m"


def _rotors_out(out: RotorsOut) -> str:
    told = f"survives {out.survive} of {out.of}"
    if 0 < len(out.lost) <= NAMED:
        told += f", not {_rotors(out.lost)}"
    return f"{told}, undecided {_rotors(out.undecided)}" if out.undecided else told


def _rotors(which: tuple[tuple[int, int], ...]) -> str:
    """Name rotors by module and number."""
    if len(which) > NAMED:
        return f"{len(which)} rotors"
    return ", ".join(f"rotor {rotor} of module {module}" for module, rotor in which)

"""HTML of texts and tables, and of designs and audits in notebooks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

from topo_search.limits import quantity
from topo_search.model.clearance import Status
from topo_search.model.proven import NOT_CERTIFIED, gap_percent, lower_text, upper_text
from topo_search.model.topology import PORT_NAMES
from topo_search.model.value import SHORT

if TYPE_CHECKING:
    from topo_search.model.audit import Audit
    from topo_search.model.design import Design
    from topo_search.model.task import Task


def heading(text: str) -> str:
    """Return a bold line of HTML."""
    return f"<p><b>{escape(text)}</b></p>"


def paragraph(text: str) -> str:
    """Return a line of HTML."""
    return f"<p>{escape(text)}</p>"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return an HTML table; None is an empty cell, floats have six digits."""
    lines = ["".join(f"<td>{escape(_cell(value))}</td>" for value in row) for row in rows]
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def html_page(title: str, style: str, lines: Iterable[str]) -> str:
    """Return a self-contained HTML page with its title as the first heading."""
    head = f'<html lang="en"><head><meta charset="utf-8"/><title>{escape(title)}</title>'
    body = (f"<style>{style}</style></head><body>", f"<h1>{escape(title)}</h1>", *lines, "</body></html>")
    return "\n".join(("<!doctype html>", head, *body)) + "\n"


def design_html(design: Design) -> str:
    """Show joints, angles and effort in a notebook."""
    gap = "" if design.gap is None else f", gap to the lower bound {gap_percent(design.gap)}"
    title = heading(f"{design.task.name}: {quantity(design.topology.n, 'module')}, {design.topology.key}")
    effort = paragraph(f"J = {design.objective:.6g} rad^4/s^4{gap}")
    names = [f"{i} ({name})" for i, name in enumerate(design.types)] or range(design.topology.n)
    rows = [
        (names[h], PORT_NAMES[a], names[i], PORT_NAMES[b], math.degrees(alpha))
        for (h, a, i, b), alpha in design.bolts
    ]
    psi, alpha_0, alpha_1 = (f"{math.degrees(angle):.6g}" for angle in design.root_orientation_rad)
    position = ", ".join(f"{x:.6g}" for x in design.end_effector_m)
    return (
        title
        + effort
        + table(("module", "port", "child", "its port", "hinge angle [deg]"), rows)
        + paragraph(f"root module: psi = {psi}, alpha_0 = {alpha_0}, alpha_1 = {alpha_1} deg")
        + paragraph(f"end-effector at [{position}] m from the root module's centre")
    )


def task_html(task: Task) -> str:
    """Show the fields that differ from their defaults in a notebook, with their meaning; long values are cut."""
    given = [
        (name, field) for name, field in type(task).model_fields.items() if getattr(task, name) != field.default
    ]
    rows = [(name, SHORT.repr(getattr(task, name)), field.description) for name, field in given]
    return heading(f"{task.name}: fields that differ from their defaults") + table(
        ("field", "value", "meaning"), rows
    )


def audit_html(audit: Audit) -> str:
    """Show the verdict, the smallest clearances and all failures in a notebook."""
    nearest = sorted(audit.pairs, key=lambda pair: (pair.status is Status.CLEAR, pair.analytic_m))
    not_clear = sum(pair.status is not Status.CLEAR for pair in audit.pairs)

    def bound(value: float | None, text: Callable[[float], str]) -> str | None:
        return None if value is None else text(value)

    pairs = [
        (p.name, p.status, bound(p.lower_m, lower_text), bound(p.upper_m, upper_text), lower_text(p.analytic_m))
        for p in nearest[: max(not_clear, 10)]  # at least ten
    ]
    html = heading(f"audit: {audit.verdict}, {len(audit.pairs)} clearances, the least of them:")
    html += paragraph(audit.inputs_words) if audit.inputs_words is not None else ""
    head = ("clearance of", "audit", "proven at least [m]", "proven at most [m]", "closed form [m]")
    html += table(head, pairs)
    if failures := [residual for residual in audit.residuals if residual.status is not Status.CLEAR]:
        rows = [
            (r.name, upper_text(r.value), r.unit, upper_text(r.scaled), lower_text(r.tolerance), r.status)
            for r in failures
        ]
        html += heading("not met:") + table(("name", "value", "unit", "scaled", "tolerance", "status"), rows)
    if audit.stated:
        checks = [(row.name, row.bounds, row.words) for row in audit.stated]
        html += heading(f"{NOT_CERTIFIED}:") + table(("constraint", "bounds", "result"), checks)
    return html

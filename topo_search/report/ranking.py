"""All candidates of a run: the ranking, and the plot to choose a design by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

from topo_search.export import palette
from topo_search.model import Audit
from topo_search.model.proven import at_least, at_most, gap_percent
from topo_search.report import Figure
from topo_search.report.headline import fragile
from topo_search.report.scene import closest
from topo_search.study import Row
from topo_search.study.ledger import figures_of
from topo_search.study.proofs import ProofState

Candidate = tuple[Row, ProofState, Audit | None]


class Column(NamedTuple):
    """A column of the ranking."""

    name: str
    value: Callable[[Row, ProofState, Audit | None], str | float | None]
    """Cell of a candidate, proven figures rounded to the safe side; None where there is nothing."""
    kind: Literal["number", "text"] = "number"
    better: Literal["less", "more"] | None = None
    """The better side of a figure to choose by."""


def ranking(candidates: Sequence[Candidate], *, proofs: bool) -> dict[str, Any]:
    """Return the table of candidates, and the plot where there are audited designs to choose from.

    Args:
        candidates: all candidates with their proofs and audits, in the order of the ranking.
        proofs: whether the table shows what branch and bound has proven.
    """
    columns = COLUMNS if proofs else COLUMNS[:-3]
    return {
        "candidates": {
            "columns": [(column.name, column.kind, column.better) for column in columns],
            "rows": [[column.value(*candidate) for column in columns] for candidate in candidates],
        },
        "choice": _choice() if sum(audit is not None for *_, audit in candidates) > 1 else None,
    }


def _choice() -> tuple[str, str, Figure]:
    """Return the plot without its points, which the page draws from the ranking as it is filtered."""
    layout = {"hovermode": "closest", "legend": {"orientation": "h", "y": -0.2}, "colorway": palette.SERIES}
    return "choice", "Audited designs; click a point to see its design", {"data": [], "layout": layout}


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None else float(f"{value:.{digits}g}")


def _least(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else at_least(value, digits)


def _most(value: float | None) -> float | None:
    return None if value is None else at_most(value, 3)


def _percent(gap: float | None) -> float | None:
    return None if gap is None else float(gap_percent(gap).removesuffix(" %"))


def _verdict(row: Row, audit: Audit | None) -> str | None:
    if fragile(audit):
        return "clear, fragile"
    return row.audit or ("failed" if row.audit_failure else None)


def _over_bound(row: Row) -> float | None:
    return at_most(row.objective / row.lower_bound, 5) if row.objective is not None and row.lower_bound else None


def _clearance_mm(audit: Audit | None) -> float | None:
    nearest = closest(audit)
    return None if nearest is None else at_least(1000 * nearest.analytic_m, 3)


def _air(audit: Audit | None) -> float | None:
    return None if audit is None else _most(figures_of(audit)["air_tip_m_s"])


COLUMNS = (
    Column("tree", lambda row, proven, audit: row.key, "text"),
    Column("modules", lambda row, proven, audit: row.modules),
    Column("J / bound", lambda row, proven, audit: _over_bound(row), better="less"),
    Column("J [rad⁴/s⁴]", lambda row, proven, audit: _round(row.objective, 6), better="less"),
    Column("gap [%]", lambda row, proven, audit: _percent(row.gap), better="less"),
    Column("audit", lambda row, proven, audit: _verdict(row, audit), "text"),
    Column("status", lambda row, proven, audit: row.status, "text"),
    Column("any force [N]", lambda row, proven, audit: _least(row.force_reserve_N), better="more"),
    Column("any torque [N m]", lambda row, proven, audit: _least(row.torque_reserve_Nm), better="more"),
    Column("clearance [mm]", lambda row, proven, audit: _clearance_mm(audit), better="more"),
    Column("hinge error [°]", lambda row, proven, audit: _least(row.hinge_tolerance_deg), better="more"),
    Column("rod [m]", lambda row, proven, audit: _most(row.rod_length_m), better="less"),
    Column("air at the tip [m/s]", lambda row, proven, audit: _air(audit), better="less"),
    Column("symmetric copies", lambda row, proven, audit: row.orbit),
    Column("hits", lambda row, proven, audit: row.starts_at_best),
    Column("feasible starts", lambda row, proven, audit: row.starts_feasible),
    Column("starts", lambda row, proven, audit: row.starts),
    Column("time [s]", lambda row, proven, audit: _round(row.seconds, 3)),
    Column("missed constraint", lambda row, proven, audit: row.worst_constraint, "text"),
    Column("by", lambda row, proven, audit: _round(row.violation, 3)),
    Column("unit", lambda row, proven, audit: row.unit, "text"),
    Column("proof", lambda row, proven, audit: proven.proof, "text"),
    Column("proven J at least", lambda row, proven, audit: _least(proven.proven_bound, 6)),
    Column("proven gap [%]", lambda row, proven, audit: _percent(proven.proven_gap)),
)
"""Columns of the ranking; the last three are those of branch and bound."""

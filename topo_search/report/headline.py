"""Designs in short: a tile for each figure that a reader wants first, a card for each design beside the winner.

All candidates of a run: a row of the ranking each, and the plot to choose a design by.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Literal, NamedTuple

from markupsafe import Markup

from topo_search.export import palette
from topo_search.export.poses import poses_to_draw
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Audit, BadInput, Clearance, Design, Flight
from topo_search.model.flight import direction
from topo_search.model.proven import at_least, at_most, gap_percent, upper_text
from topo_search.model.topology import PORT_NAMES
from topo_search.report import Figure, Tile, json_in_script
from topo_search.report.scene import closest
from topo_search.report.view import view
from topo_search.report.wording import clearance, figures, least, length, modules, most
from topo_search.study import Answer, Row, RunFolder
from topo_search.study.ledger import figures_of
from topo_search.study.proofs import ProofState


def tally(audit: Audit) -> str:
    """Return what the audit checked, and how much of it is not clear."""
    if audit.verdict == "clear":
        return f"all {len(audit.pairs)} clearances are proven, all {len(audit.residuals)} other numbers hold"
    statuses = [*(pair.status for pair in audit.pairs), *(row.status for row in audit.residuals)]
    return f"{sum(status != 'clear' for status in statuses)} of {len(statuses)} checks are not clear"


FRAGILE_M, FRAGILE_DEG = 1.0e-3, 0.1
"""A clearance [m] and an error of every hinge angle [deg] under which a clear design is called fragile."""


def fragile(audit: Audit | None) -> tuple[str, ...]:
    """Return the proven margins of a clear design that are too small to build it safely, in figures."""
    if audit is None or audit.verdict != "clear":
        return ()
    hinge = None if audit.flight is None else audit.flight.hinge_tolerance_deg
    margins = []
    if (nearest := closest(audit)) is not None and _lower_bound(nearest) < FRAGILE_M:
        margins.append(f"least clearance {clearance(nearest)}")
    if hinge is not None and hinge < FRAGILE_DEG:
        margins.append(f"no hinge angle may be off by more than {least(hinge, '°')}")
    return tuple(margins)


def _lower_bound(pair: Clearance) -> float:
    return pair.analytic_m if pair.lower_m is None else pair.lower_m  # older files have the closed form alone


def headline(
    design: Design, audit: Audit | None, gap: float | None, compared: str, *, scoped: bool = False
) -> Iterator[Tile]:
    """Yield the tiles of a design; without an audit only those that its own numbers tell.

    Args:
        design: the design.
        audit: its audit.
        gap: the share of its effort that another platform of its size can save at most, if that is known.
        compared: what it was compared with, in a few words.
        scoped: whether branch and bound proves the gap, within its scope; the lower bound holds without any.
    """
    n = design.topology.n
    flight = None if audit is None else audit.flight
    if gap is not None:
        within = ", in the scope of the proofs" if scoped else ""
        explanation = f"no platform of {modules(n)} can save more control effort{within}"
        yield Tile("Proven gap", gap_percent(gap), explanation)
    nearest = closest(audit)
    if nearest is not None:
        status = str(nearest.status)
        if status == "clear":
            status = "fragile" * (_lower_bound(nearest) < FRAGILE_M)
        yield Tile("Least clearance", clearance(nearest), nearest.name, status)
    if flight is not None:
        yield from _side_force(flight)
    if audit is not None and (air := audit.air) is not None:
        over = "" if air.region_m_s is None else f"over the regions at most {upper_text(air.region_m_s, 3)} m/s, "
        yield Tile("Air at the tip", f"{upper_text(air.tip_m_s, 3)} m/s", f"{over}by the jet model")
    yield Tile("Modules", str(n), compared)
    throttle = design.inputs / design.task.module.max_input(design.task.gravity)
    mean = f"mean {figures(100 * float(throttle.mean()), 3)} % over all load cases"
    yield Tile("Peak throttle", most(100 * float(throttle.max()), " %"), mean)
    if flight is None:
        return
    if flight.hover_input is not None and flight.hover_power_excess is not None:
        power = f"{figures(flight.hover_power_excess, 3)} % more power than with all rotors pointing straight up"
        yield Tile("Throttle in hover", f"{figures(100 * flight.hover_input, 3)} %", power)
    if (hinge := flight.hinge_tolerance_deg) is not None:
        survived = "error of every hinge angle at which all clearances last"
        yield Tile("Hinge tolerance", least(hinge, "°"), survived, "fragile" * (hinge < FRAGILE_DEG))
    out = flight.rotors_out_hover
    open_ = f" ({len(out.undecided)} undecided)" if out.undecided else ""
    survived = f"single rotor failures survived in hover, once known{open_}"
    yield Tile("Rotor failures", f"{out.survive} of {out.of}", survived)
    if design.task.end_effector.rod != "none":
        yield _rod(flight, audit)


def _side_force(flight: Flight) -> Iterator[Tile]:
    """Yield the least side force that can be added in hover; older files have none."""
    hover = flight.hover
    if hover.possible is not True:
        why = "cannot hover" if hover.possible is False else "hover is undecided"
        yield Tile("Side force reserve", "none", why)
    elif hover.horizontal_reserve_N is not None:
        weakest = hover.horizontal_weakest
        towards = "" if weakest is None else f", least towards {direction(weakest)}"
        size = least(hover.horizontal_reserve_N, " N")
        yield Tile("Side force reserve", size, f"at the tip in hover{towards}")


def _rod(flight: Flight, audit: Audit | None) -> Tile:
    mount = None if audit is None else audit.assembly.mount
    if flight.rod_length_m is None or mount is None:
        return Tile("Rod", "none", "no straight rod carries the end-effector")
    route = f"from port {PORT_NAMES[mount.port]} of module {mount.module} to the end-effector"
    return Tile("Rod", length(flight.rod_length_m), route)


LARGEST = 2_500_000
"""Characters that all cards may take: what would lead beyond is left out, the least effort first to stay."""


def rows_to_show(answer: Answer, shown: Row) -> list[Row]:
    """Return which designs get a card: the winner, the best of its size and those near it, some of other sizes."""
    shown_size = next(size for size in answer.sizes if size.modules == shown.modules)
    others = (row for size in answer.sizes if size is not shown_size for row in size.top[:3])
    rows = {row.key: row for row in itertools.chain([shown], shown_size.top, shown_size.near_ties, others)}
    return list(rows.values())


class Compared(NamedTuple):
    """A design with the name that tells it from the others."""

    name: str
    design: Design
    audit: Audit | None
    gap: float | None
    """Largest share of its effort that another platform of its size can save."""
    scoped: bool = False
    """True if branch and bound proves the gap, within its scope."""


def compared_designs(folder: RunFolder, answer: Answer, prefix: str = "") -> Iterator[Compared]:
    """Yield the designs of `rows_to_show` that are kept, the winner first, named by their keys after a prefix."""
    sizes = {size.modules: size for size in answer.sizes}
    for row in () if answer.shown is None else rows_to_show(answer, answer.shown):
        design, audit = folder.result_of(row)
        if design is not None:
            size = sizes[row.modules]
            yield Compared(prefix + row.key, design, audit, size.gap_of(row), size.proven_gap is not None)


def cards(shown: Iterable[Compared], best: Row) -> Iterator[dict[str, Any]]:
    """Yield a card for each design that can be drawn, the winner's first, until they take too much."""
    taken = 0
    for one in shown:
        try:
            made = card(one, _effort(one.design, best))
        except BadInput:  # its end-effector is too far away to be drawn: the ranking still has its row
            continue
        if one.name != best.key:
            taken += len(json_in_script(made["view"])) + len(made["tree"])
        if taken > LARGEST:
            return
        yield made


def card(one: Compared, effort: Tile) -> dict[str, Any]:
    """Return what a page shows of a design, with its control effort, beside another."""
    design, audit = one.design, one.audit
    verdict = "none" if audit is None else str(audit.verdict)
    return {
        "key": one.name,
        "design": design,
        "audit": audit,
        "view": view(design, poses_to_draw(design), audit),
        "tree": Markup(tree_svg(design, None if audit is None else audit.assembly)),
        "figures": (
            Tile("Audit", verdict, "", "fragile" if fragile(audit) else verdict),
            effort,
            *headline(design, audit, one.gap, "", scoped=one.scoped),
        ),
    }


def _effort(design: Design, best: Row) -> Tile:
    """Return the effort of a design over that of the winner."""
    is_best = design.topology.key == best.key
    if is_best or not design.objective or not best.objective or design.topology.n != best.modules:
        return Tile("Control effort", "least found" if is_best else "of another size", "")
    return Tile(
        "Control effort", f"+{100 * (design.objective / best.objective - 1):.2f} %", "over that of the best"
    )


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

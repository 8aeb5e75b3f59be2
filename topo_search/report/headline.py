"""Key figures of designs: the tiles of the headline, and a card for each design to compare with the best.

Also the candidates of a run: the ranking with a row for each, and the plot to choose a design by.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Literal, NamedTuple

from markupsafe import Markup

from topo_search.export import palette
from topo_search.export.poses import poses_to_draw, throttles
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Audit, BadInput, Design, Flight, Objective
from topo_search.model.flight import direction
from topo_search.model.largest_value import LargestValue, ability, objective_of
from topo_search.model.proven import at_least, at_most, gap_percent, upper_text
from topo_search.model.topology import PORT_NAMES
from topo_search.report import Tile, json_in_script
from topo_search.report.view import view
from topo_search.report.wording import (
    FRAGILE_DEG,
    FRAGILE_M,
    clearance,
    closest,
    figures,
    fragile_margins,
    length,
    modules,
    proven_clearance,
    rounded_down,
    rounded_up,
)
from topo_search.study import Answer, Row, RunFolder
from topo_search.study.columns import figures_of
from topo_search.study.proofs import ProofState


def audit_summary(audit: Audit) -> str:
    """Return a summary of the audit: what is proven, or how many checks are not clear."""
    if audit.verdict == "clear":
        return f"all {len(audit.pairs)} clearances proven, all {len(audit.residuals)} other checks passed"
    statuses = [*(pair.status for pair in audit.pairs), *(row.status for row in audit.residuals)]
    return f"{sum(status != 'clear' for status in statuses)} of {len(statuses)} checks are not clear"


def headline(
    design: Design, audit: Audit | None, gap: float | None, compared: str, *, scoped: bool = False
) -> Iterator[Tile]:
    """Yield the tiles of a design; without an audit, only those that follow from the design itself.

    Args:
        design: the design.
        audit: its audit.
        gap: by what share another platform of its size can be better; None if unknown.
        compared: explanation of the number of modules: what the design was compared with.
        scoped: whether the gap is proven by branch and bound, within its scope; the lower bound has no scope.
    """
    n = design.topology.n
    flight = None if audit is None else audit.flight
    objective = objective_of(design.task)
    if isinstance(objective, LargestValue):
        size = f"{rounded_down(design.value, digits=4)} {objective.quantity.unit}"
        yield Tile(f"Largest {objective.number_words}", size, f"it {ability(design.task)}")
    if gap is not None:
        within = ", in the scope of the proofs" if scoped else ""
        explanation = (
            f"no platform of {modules(n)} {objective.improvement(design, gap)}{design.task.attitude}{within}"
        )
        yield Tile("Proven gap", gap_percent(gap), explanation)
    nearest = closest(audit)
    if nearest is not None:
        status = str(nearest.status)
        if status == "clear":
            status = "fragile" * (proven_clearance(nearest) < FRAGILE_M)
        yield Tile("Smallest clearance", clearance(nearest), nearest.name, status)
    if flight is not None:
        yield from _side_force(flight)
    if audit is not None and (air := audit.air) is not None:
        over = "" if air.region_m_s is None else f"in the regions at most {upper_text(air.region_m_s, 3)} m/s, "
        over += "not limited there, " * bool(air.fast)
        status = "fragile" * bool(air.fast)
        yield Tile("Air at the tip", f"{upper_text(air.tip_m_s, 3)} m/s", f"{over}by the jet model", status)
    yield Tile("Modules", str(n), compared)
    throttle = throttles(design)
    mean = f"mean {figures(100 * float(throttle.mean()), 3)} % over all load cases"
    yield Tile("Peak throttle", rounded_up(100 * float(throttle.max()), " %"), mean)
    if flight is None:
        return
    if flight.hover_input is not None and flight.hover_power_excess is not None:
        power = f"{figures(flight.hover_power_excess, 3)} % more power than with all rotors pointing straight up"
        yield Tile("Hover throttle", f"{figures(100 * flight.hover_input, 3)} %", power)
    if (hinge := flight.hinge_tolerance_deg) is not None:
        meaning = "all clearances hold if no hinge angle is off by more"
        yield Tile("Hinge tolerance", rounded_down(hinge, "°"), meaning, "fragile" * (hinge < FRAGILE_DEG))
    out = flight.rotors_out_hover
    open_ = f" ({len(out.undecided)} undecided)" if out.undecided else ""
    meaning = f"single rotor failures survived in hover, once known{open_}"
    meaning += f"; can only hover: {out.hover_only}" if out.hover_only else ""
    yield Tile("Rotor failures", f"{out.survive} of {out.of}", meaning)
    if design.task.end_effector.rod != "none":
        yield _rod(flight, audit)


def _side_force(flight: Flight) -> Iterator[Tile]:
    """Yield the tile of the side force in hover; older files have none."""
    hover = flight.hover
    if hover.possible is not True:
        why = "cannot hover" if hover.possible is False else "hover is undecided"
        yield Tile("Side force", "none", why)
    elif hover.horizontal_reserve_N is not None:
        weakest = hover.horizontal_weakest
        towards = "" if weakest is None else f", weakest towards {direction(weakest)}"
        size = rounded_down(hover.horizontal_reserve_N, " N")
        yield Tile("Side force", size, f"at the tip in hover{towards}")


def _rod(flight: Flight, audit: Audit | None) -> Tile:
    mount = None if audit is None else audit.assembly.mount
    if flight.rod_length_m is None or mount is None:
        return Tile("Rod", "none", "no straight rod can hold the end-effector")
    route = f"from port {PORT_NAMES[mount.port]} of module {mount.module} to the end-effector"
    return Tile("Rod", length(flight.rod_length_m), route)


MAX_CARD_CHARACTERS = 2_500_000
"""Largest total size of all cards in characters; the worst designs are dropped first."""


def rows_with_cards(answer: Answer, shown: Row) -> list[Row]:
    """Return the designs that get a card: the winner, the best and near ties of its size, three per other size."""
    shown_size = next(size for size in answer.sizes if size.modules == shown.modules)
    others = (row for size in answer.sizes if size is not shown_size for row in size.top[:3])
    rows = {row.key: row for row in itertools.chain([shown], shown_size.top, shown_size.near_ties, others)}
    return list(rows.values())


class Compared(NamedTuple):
    """A design under a name that is unique on its page."""

    name: str
    design: Design
    audit: Audit | None
    gap: float | None
    """By what share another platform of its size can be better."""
    scoped: bool = False
    """True if branch and bound proves the gap, within its scope."""


def compared_designs(folder: RunFolder, answer: Answer, prefix: str = "") -> Iterator[Compared]:
    """Yield the stored designs of `rows_with_cards`, the winner first, named by prefix and key."""
    sizes = {size.modules: size for size in answer.sizes}
    for row in () if answer.shown is None else rows_with_cards(answer, answer.shown):
        design, audit = folder.result_of(row)
        if design is not None:
            size = sizes[row.modules]
            yield Compared(prefix + row.key, design, audit, size.gap_of(row), size.proven_gap is not None)


def cards(shown: Iterable[Compared], best: Row) -> Iterator[dict[str, Any]]:
    """Yield a card for each design that can be drawn, the winner's first, up to the largest total size."""
    characters = 0
    for compared_design in shown:
        try:
            made_card = card(compared_design, _merit(compared_design.design, best))
        except BadInput:  # the end-effector is too far away to be drawn; the ranking still has the row
            continue
        if compared_design.name != best.key:
            characters += len(json_in_script(made_card["view"])) + len(made_card["tree"])
        if characters > MAX_CARD_CHARACTERS:
            return
        yield made_card


def card(compared: Compared, merit: Tile) -> dict[str, Any]:
    """Return the card of a design, which a page shows next to another."""
    design, audit = compared.design, compared.audit
    verdict = "none" if audit is None else str(audit.verdict)
    return {
        "key": compared.name,
        "design": design,
        "audit": audit,
        "view": view(design, poses_to_draw(design), audit),
        "tree": Markup(tree_svg(design, None if audit is None else audit.assembly)),
        "figures": (
            Tile("Audit", verdict, "", "fragile" if fragile_margins(audit) else verdict),
            merit,
            *headline(design, audit, compared.gap, "", scoped=compared.scoped),
        ),
    }


def _merit(design: Design, best: Row) -> Tile:
    """Return the tile of a design's effort, or of its value of a maximised quantity, relative to the winner's."""
    objective, is_best = objective_of(design.task), design.topology.key == best.key
    is_effort = objective.better == "less"
    name = "Control effort" if is_effort else objective.least.capitalize()
    if is_best or not objective.number(design) or not objective.number(best):
        return Tile(name, f"{'lowest' if is_effort else 'largest'} found", "")
    if is_effort and design.topology.n != best.modules:
        return Tile(name, "different size", "")
    return Tile(name, objective.difference(design, best), f"{'more' if is_effort else 'less'} than the best")


Candidate = tuple[Row, ProofState, Audit | None]


class Column(NamedTuple):
    """A column of the ranking."""

    name: str
    value: Callable[[Row, ProofState, Audit | None], str | float | None]
    """Cell of a candidate, proven figures rounded to the safe side; None for an empty cell."""
    kind: Literal["number", "text"] = "number"
    better: Literal["less", "more"] | None = None
    """Which values are better; None if the plot of designs does not offer the column."""


def ranking(candidates: Sequence[Candidate], objective: Objective, *, proofs: bool) -> dict[str, Any]:
    """Return the table of candidates, and the plot if there are audited designs to choose from.

    Args:
        candidates: all candidates with their proofs and audits, in the order of the ranking.
        objective: objective of the search.
        proofs: whether the table has the columns of branch and bound.
    """
    columns, merit = COLUMNS if proofs else COLUMNS[:-3], "J [rad⁴/s⁴]"
    if isinstance(objective, LargestValue):
        merit, unit = objective.column, objective.quantity.unit
        value = Column(merit, lambda row, proven, audit: _round_down(row.value, 6), better="more")
        reach = Column(f"asked for more than [{unit}]", lambda row, proven, audit: _significant(row.reach, 6))
        bounds = Column(f"proven bound [{unit}]", lambda row, proven, audit: _round_up(proven.proven_bound, 6))
        proven = (COLUMNS[-3], bounds, COLUMNS[-1]) if proofs else ()
        columns = (*COLUMNS[:2], value, *COLUMNS[2:-3], reach, *proven)
    # the page draws the points, from the filtered ranking
    layout = {"hovermode": "closest", "legend": {"orientation": "h", "y": -0.2}, "colorway": palette.SERIES}
    plot = "choice", "Audited designs; click a point to see its design", {"data": [], "layout": layout}
    return {
        "candidates": {
            "columns": [(column.name, column.kind, column.better) for column in columns],
            "merit": merit,
            "rows": [[column.value(*candidate) for column in columns] for candidate in candidates],
        },
        "choice": plot if sum(audit is not None for *_, audit in candidates) > 1 else None,
    }


def _significant(value: float | None, digits: int) -> float | None:
    return None if value is None else float(f"{value:.{digits}g}")


def _round_down(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else at_least(value, digits)


def _round_up(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else at_most(value, digits)


def _percent(gap: float | None) -> float | None:
    return None if gap is None else float(gap_percent(gap).removesuffix(" %"))


def _verdict(row: Row, audit: Audit | None) -> str | None:
    if fragile_margins(audit):
        return "clear, fragile"
    return row.audit or ("failed" if row.audit_failure else None)


def _ratio_to_bound(row: Row) -> float | None:
    return at_most(row.objective / row.lower_bound, 5) if row.objective is not None and row.lower_bound else None


def _clearance_mm(audit: Audit | None) -> float | None:
    nearest = closest(audit)
    return None if nearest is None else at_least(1000 * nearest.analytic_m, 3)


def _air(audit: Audit | None) -> float | None:
    return None if audit is None else _round_up(figures_of(audit)["air_tip_m_s"])


COLUMNS = (
    Column("tree", lambda row, proven, audit: row.key, "text"),
    Column("modules", lambda row, proven, audit: row.modules),
    Column("J over bound", lambda row, proven, audit: _ratio_to_bound(row), better="less"),
    Column("J [rad⁴/s⁴]", lambda row, proven, audit: _significant(row.objective, 6), better="less"),
    Column("gap [%]", lambda row, proven, audit: _percent(row.gap), better="less"),
    Column("audit", lambda row, proven, audit: _verdict(row, audit), "text"),
    Column("status", lambda row, proven, audit: row.status, "text"),
    Column(
        "force reserve, any direction [N]",
        lambda row, proven, audit: _round_down(row.force_reserve_N),
        better="more",
    ),
    Column(
        "torque reserve, any axis [N m]",
        lambda row, proven, audit: _round_down(row.torque_reserve_Nm),
        better="more",
    ),
    Column("clearance [mm]", lambda row, proven, audit: _clearance_mm(audit), better="more"),
    Column("hinge error [°]", lambda row, proven, audit: _round_down(row.hinge_tolerance_deg), better="more"),
    Column("rod [m]", lambda row, proven, audit: _round_up(row.rod_length_m), better="less"),
    Column("air at the tip [m/s]", lambda row, proven, audit: _air(audit), better="less"),
    Column("symmetric copies", lambda row, proven, audit: row.orbit),
    Column("hits", lambda row, proven, audit: row.starts_at_best),
    Column("feasible starts", lambda row, proven, audit: row.starts_feasible),
    Column("starts", lambda row, proven, audit: row.starts),
    Column("time [s]", lambda row, proven, audit: _significant(row.seconds, 3)),
    Column("worst constraint", lambda row, proven, audit: row.worst_constraint, "text"),
    Column("violation", lambda row, proven, audit: _significant(row.violation, 3)),
    Column("unit", lambda row, proven, audit: row.unit, "text"),
    Column("proof", lambda row, proven, audit: proven.proof, "text"),
    Column("proven bound on J", lambda row, proven, audit: _round_down(proven.proven_bound, 6)),
    Column("proven gap [%]", lambda row, proven, audit: _percent(proven.proven_gap)),
)
"""Columns of the ranking; the last three are for branch and bound."""

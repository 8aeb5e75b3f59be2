"""Designs in short: a tile for each figure that a reader wants first, a card for each design beside the winner."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator
from typing import Any

from markupsafe import Markup

from topo_search.export.poses import poses_to_draw
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Audit, BadInput, Clearance, Design, Flight
from topo_search.model.flight import direction
from topo_search.model.proven import at_least, at_most, gap_percent, upper_text
from topo_search.model.topology import PORT_NAMES
from topo_search.report import Tile, json_in_script
from topo_search.report.design_part import nearest, reserves
from topo_search.report.scene import closest
from topo_search.report.view import thumbnail, view
from topo_search.report.wording import clearance, figures, length, modules
from topo_search.study import Answer, Row


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
        margins.append(f"no hinge angle may be off by more than {figures(at_least(hinge, 3), 3)}°")
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
    peak = f"{figures(at_most(100 * float(throttle.max()), 3), 3)} %"
    yield Tile("Peak throttle", peak, f"mean {figures(100 * float(throttle.mean()), 3)} % over all load cases")
    if flight is None:
        return
    if flight.hover_input is not None and flight.hover_power_excess is not None:
        power = f"{figures(flight.hover_power_excess, 3)} % more power than with all rotors pointing straight up"
        yield Tile("Throttle in hover", f"{figures(100 * flight.hover_input, 3)} %", power)
    if (hinge := flight.hinge_tolerance_deg) is not None:
        survived = "error of every hinge angle at which all clearances last"
        size = f"{figures(at_least(hinge, 3), 3)}°"
        yield Tile("Hinge tolerance", size, survived, "fragile" * (hinge < FRAGILE_DEG))
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
        size = f"{figures(at_least(hover.horizontal_reserve_N, 3), 3)} N"
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


def cards(
    entries: Iterable[tuple[Row, Design | None, Audit | None]], best: Row, *, scoped: Collection[int] = ()
) -> Iterator[dict[str, Any]]:
    """Yield a card for each design that can be drawn, the winner's first, until they take too much.

    Args:
        entries: rows with their designs, where they are kept, and audits, the winner first.
        best: the winner.
        scoped: the sizes whose gaps branch and bound proves.
    """
    taken = 0
    for row, design, audit in entries:
        if design is None:
            continue
        try:
            shown = card(row.key, design, audit, _effort(row, best), row.gap, scoped=row.modules in scoped)
        except BadInput:  # its end-effector is too far away to be drawn: the ranking still has its row
            continue
        if row.key != best.key:
            taken += len(json_in_script(shown["view"]["value"])) + len(shown["tree"])
        if taken > LARGEST:
            return
        yield shown


def card(
    name: str, design: Design, audit: Audit | None, effort: Tile, gap: float | None, *, scoped: bool = False
) -> dict[str, Any]:
    """Return what a page shows of a design beside another.

    Args:
        name: of the design, once on the page.
        design: the design.
        audit: its audit.
        effort: its control effort.
        gap: as for the headline.
        scoped: as for the headline.
    """
    at = poses_to_draw(design)
    assembly = None if audit is None else audit.assembly
    verdict = "none" if audit is None else str(audit.verdict)
    return {
        "key": name,
        "heading": f"{name}, {modules(design.topology.n)}",
        "view": view(f"view-{name}", design, at, audit),
        "tree": Markup(tree_svg(design, assembly)),
        "thumbnail": thumbnail(design, at),
        "figures": (
            Tile("Audit", verdict, "", "fragile" if fragile(audit) else verdict),
            effort,
            *headline(design, audit, gap, "", scoped=scoped),
        ),
        "nearest": nearest(audit.pairs) if audit is not None and audit.pairs else None,
        "cases": None if audit is None or audit.flight is None else reserves(audit.flight),
    }


def _effort(row: Row, best: Row) -> Tile:
    """Return the effort of a design over that of the winner."""
    if row.key == best.key or not row.objective or not best.objective or row.modules != best.modules:
        return Tile("Control effort", "least found" if row.key == best.key else "of another size", "")
    return Tile("Control effort", f"+{100 * (row.objective / best.objective - 1):.2f} %", "over that of the best")

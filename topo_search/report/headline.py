"""The head of the page: what a reader wants to know first of a design, a tile each."""

from __future__ import annotations

from collections.abc import Iterator

from topo_search.model import Audit, Clearance, Design, Flight
from topo_search.model.flight import direction
from topo_search.model.proven import at_least, at_most, gap_percent
from topo_search.model.topology import PORT_NAMES
from topo_search.report.clearances import clearance
from topo_search.report.page import Tile
from topo_search.report.wording import figures, length, modules


def headline(
    design: Design, audit: Audit | None, gap: float | None, compared: str, *, scoped: bool = False
) -> tuple[Tile, ...]:
    """Return the tiles of a design; without an audit only those that its own numbers tell.

    Args:
        design: the design.
        audit: its audit.
        gap: the share of its effort that another platform of its size can save at most, if that is known.
        compared: what it was compared with, in a few words.
        scoped: whether branch and bound proves the gap, within its scope; the lower bound holds without any.
    """
    return tuple(_tiles(design, audit, gap, compared, scoped))


def closest(audit: Audit | None) -> Clearance | None:
    """Return the least clearance of an audit; None without any."""
    return None if audit is None else min(audit.pairs, key=lambda pair: pair.analytic_m, default=None)


def tally(audit: Audit) -> str:
    """Return what the audit checked, and how much of it is not clear."""
    wrong = sum(pair.status != "clear" for pair in audit.pairs) + sum(
        row.status != "clear" for row in audit.residuals
    )
    if audit.verdict == "clear":
        return f"all {len(audit.pairs)} clearances are proven, all {len(audit.residuals)} other numbers hold"
    return f"{wrong} of {len(audit.pairs) + len(audit.residuals)} checks are not clear"


def _tiles(design: Design, audit: Audit | None, gap: float | None, compared: str, scoped: bool) -> Iterator[Tile]:
    n = design.topology.n
    yield Tile("Modules", str(n), compared)
    throttle = design.inputs / design.task.module.max_input(design.task.gravity)
    peak = f"{figures(at_most(100 * float(throttle.max()), 3), 3)} %"
    yield Tile("Peak throttle", peak, f"mean {figures(100 * float(throttle.mean()), 3)} % over all load cases")
    flight = None if audit is None else audit.flight
    if flight is not None and flight.hover_input is not None and flight.hover_power_ratio is not None:
        power = f"{figures(flight.hover_power_ratio, 3)} times the power of rotors that all pull straight up"
        yield Tile("Throttle in hover", f"{figures(100 * flight.hover_input, 3)} %", power)
    if gap is not None:
        told = f"no platform of {modules(n)} can save more effort{', in the scope of the proofs' if scoped else ''}"
        yield Tile("Proven gap", gap_percent(gap), told)
    nearest = closest(audit)
    if nearest is not None:
        status = "" if nearest.status == "clear" else str(nearest.status)
        yield Tile("Least clearance", clearance(nearest), nearest.name, status)
    if flight is not None:
        yield from _reserves(flight)
        yield _rod(flight, audit)


def _reserves(flight: Flight) -> Iterator[Tile]:
    """Yield what is least left in hover, and how many rotors may fail."""
    hover, out = flight.hover, flight.rotors_out_hover
    if hover.possible is not True:
        yield Tile("Weakest reserve", "none", "cannot hover" if hover.possible is False else "hover is undecided")
    elif hover.horizontal_reserve_N is not None:
        towards = "" if hover.horizontal_weakest is None else f", towards {direction(hover.horizontal_weakest)}"
        size = f"{figures(at_least(hover.horizontal_reserve_N, 3), 3)} N"
        yield Tile("Weakest reserve", size, f"side force at the tip in hover{towards}")
    open_ = f" ({len(out.undecided)} undecided)" if out.undecided else ""
    yield Tile("Rotor failures", f"{out.survive} of {out.of}", f"single rotor failures survived in hover{open_}")


def _rod(flight: Flight, audit: Audit | None) -> Tile:
    mount = None if audit is None else audit.assembly.mount
    if flight.rod_length_m is None or mount is None:
        return Tile("Rod", "none", "no straight rod carries the end-effector")
    place = f"from port {PORT_NAMES[mount.port]} of module {mount.module} to the end-effector"
    return Tile("Rod", length(flight.rod_length_m), place)

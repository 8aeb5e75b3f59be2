"""Numbers, counts, clearances, fragile margins and near ties as text, the same on pages and in the terminal.

`--help` imports this module, so it must not import numerical libraries at the top.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from topo_search.limits import figures as figures
from topo_search.limits import length as length
from topo_search.limits import quantity as quantity

if TYPE_CHECKING:
    from topo_search.model import Audit, Clearance, Design
    from topo_search.model.objective import Objective
    from topo_search.study import Row

FRAGILE_M, FRAGILE_DEG = 1.0e-3, 0.1
"""A clear design with a smaller clearance [m] or a smaller hinge tolerance [deg] is called fragile."""
EFFORT = "J = Σ_k λ_k ‖u_k‖²"


def modules(n: int) -> str:
    """Return a number of modules in words."""
    return quantity(n, "module")


def sentence(words: str) -> str:
    """Return words as a sentence, with a capital and a full stop."""
    return f"{words[0].upper()}{words[1:]}."


def rounded_down(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Return a proven lower bound, rounded down, with its unit; an empty text for None."""
    from topo_search.model.proven import at_least

    return "" if value is None else f"{figures(at_least(value, digits), digits)}{unit}"


def rounded_up(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Return a proven upper bound, rounded up, with its unit; an empty text for None."""
    from topo_search.model.proven import at_most

    return "" if value is None else f"{figures(at_most(value, digits), digits)}{unit}"


def clearance(pair: Clearance) -> str:
    """Return a clearance with its unit, rounded down."""
    from topo_search.model.proven import at_least

    return length(at_least(pair.analytic_m, 3))


def closest(audit: Audit | None) -> Clearance | None:
    """Return the smallest clearance of an audit, if it has any."""
    return None if audit is None else min(audit.pairs, key=lambda pair: pair.analytic_m, default=None)


def fragile_margins(audit: Audit | None, design: Design | None = None) -> tuple[str, ...]:
    """Return why a clear design is fragile: defaults that it misses, and margins too small to build it safely."""
    from topo_search.model.flying import find_missed

    if audit is None or audit.verdict != "clear":
        return ()
    hinge = None if audit.flight is None else audit.flight.hinge_tolerance_deg
    missed = () if design is None else find_missed(design, audit)
    margins = [entry.words for entry in missed]
    if (nearest := closest(audit)) is not None and proven_clearance(nearest) < FRAGILE_M:
        margins.append(f"smallest clearance {clearance(nearest)}")
    is_told = any(entry.field == "tolerances.hinge_angle_deg" for entry in missed)
    if hinge is not None and hinge < FRAGILE_DEG and not is_told:
        margins.append(f"hinge tolerance {rounded_down(hinge, '°')}")
    return tuple(margins)


def proven_clearance(pair: Clearance) -> float:
    """Return the lower bound of a clearance [m]."""
    return pair.analytic_m if pair.lower_m is None else pair.lower_m  # older files only have the closed form


def near_tie_columns(objective: Objective) -> tuple[str, ...]:
    """Return the column headings of the table of near ties."""
    reserves = (
        "force, any direction",
        "torque, any axis",
        "rotors",
        "load factor",
        "joint moment",
        "hinge error",
        "rod",
    )
    return "key", objective.number_words, *reserves


def near_tie_cells(row: Row, difference: str, rotors: int) -> tuple[str, ...]:
    """Return a design's cells of the table of near ties; proven figures are rounded to the safe side.

    Args:
        row: the design.
        difference: relative difference from the best, in words.
        rotors: number of rotors of the design.
    """
    from topo_search.model.proven import at_most

    return (
        row.key,
        difference,
        rounded_down(row.force_reserve_N, " N"),
        rounded_down(row.torque_reserve_Nm, " N m"),
        rounded_down(row.rotors_out_hover, f" of {rotors}"),
        rounded_down(row.load_factor, digits=4),
        rounded_up(row.joint_moment_Nm, " N m"),
        rounded_down(row.hinge_tolerance_deg, "°"),
        "none" if row.rod_length_m is None else length(at_most(row.rod_length_m, 3)),
    )

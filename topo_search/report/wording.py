"""Numbers, counts, clearances and near ties in words, the same wherever a person reads them.

`--help` loads this file too: it must load no numerics at its top.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from topo_search.limits import quantity as quantity

if TYPE_CHECKING:
    from topo_search.model import Clearance
    from topo_search.study import Row

EFFORT = "J = Σ_k λ_k ‖u_k‖²"
NEAR_TIES = ("key", "J", "force", "torque", "rotors", "load factor", "joint moment", "hinge error", "rod")
"""Headings of near ties."""


def modules(n: int) -> str:
    """Return a number of modules."""
    return quantity(n, "module")


def sentence(words: str) -> str:
    """Return words as a sentence."""
    return f"{words[0].upper()}{words[1:]}."


def figures(value: float, digits: int = 4) -> str:
    """Return a number with so many significant digits, a large or small one with a power of ten."""
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text.replace("-", "−")
    mantissa, exponent = text.split("e")
    superscripts = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return f"{mantissa} × 10{str(int(exponent)).translate(superscripts)}".replace("-", "−")


def length(metres: float) -> str:
    """Return a length in the unit that suits it."""
    if abs(metres) < 0.01:
        return f"{figures(1000 * metres, 3)} mm"
    return f"{figures(100 * metres, 3)} cm" if abs(metres) < 1 else f"{figures(metres, 3)} m"


def least(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Return a figure that is proven from below, rounded down, with its unit; nothing for None."""
    from topo_search.model.proven import at_least

    return "" if value is None else f"{figures(at_least(value, digits), digits)}{unit}"


def most(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Return a figure that is proven from above, rounded up, with its unit; nothing for None."""
    from topo_search.model.proven import at_most

    return "" if value is None else f"{figures(at_most(value, digits), digits)}{unit}"


def clearance(pair: Clearance) -> str:
    """Return a clearance in figures with its unit, rounded down."""
    from topo_search.model.proven import at_least

    return length(at_least(pair.analytic_m, 3))


def millimetres(pair: Clearance) -> str:
    """Return the same figures in millimetres, without the unit."""
    from topo_search.model.proven import lower_text

    return lower_text(1000 * pair.analytic_m, 3).replace("-", "−")


def near_tie_cells(row: Row, best: Row) -> tuple[str, ...]:
    """Return the cells of a design; its effort over that of the best, what is proven rounded to the safe side."""
    from topo_search.model.proven import at_most

    more = 100 * ((row.objective or 0.0) / best.objective - 1) if best.objective else 0.0
    return (
        row.key,
        f"+{more:.2f} %",
        least(row.force_reserve_N, " N"),
        least(row.torque_reserve_Nm, " N m"),
        least(row.rotors_out_hover, f" of {4 * row.modules}"),
        least(row.load_factor, digits=4),
        most(row.joint_moment_Nm, " N m"),
        least(row.hinge_tolerance_deg, "°"),
        "none" if row.rod_length_m is None else length(at_most(row.rod_length_m, 3)),
    )

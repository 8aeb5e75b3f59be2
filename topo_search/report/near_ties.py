"""Designs that cost about the same, side by side: what each leaves beyond its task."""

from __future__ import annotations

from topo_search.model.proven import at_least, at_most
from topo_search.report.wording import figures, length
from topo_search.study import Row


def near_tie_columns() -> tuple[str, ...]:
    """Return the headings."""
    return ("key", "effort", "force", "torque", "rotors", "load factor", "joint moment", "hinge error", "rod")


def near_tie_cells(row: Row, best: Row) -> tuple[str, ...]:
    """Return the cells of a design; its effort over that of the best, what is proven rounded to the safe side."""
    proven = (
        (row.force_reserve_N, 3, " N"),
        (row.torque_reserve_Nm, 3, " N m"),
        (row.rotors_out_hover, 3, f" of {4 * row.modules}"),
        (row.load_factor, 4, ""),
    )
    more = 100 * ((row.objective or 0.0) / best.objective - 1) if best.objective else 0.0
    return (
        row.key,
        f"+{more:.2f} %",
        *(
            "" if value is None else f"{figures(at_least(value, digits), digits)}{unit}"
            for value, digits, unit in proven
        ),
        "" if row.joint_moment_Nm is None else f"{figures(at_most(row.joint_moment_Nm, 3), 3)} N m",
        "" if row.hinge_tolerance_deg is None else f"{figures(at_least(row.hinge_tolerance_deg, 3), 3)}°",
        "none" if row.rod_length_m is None else length(row.rod_length_m),
    )

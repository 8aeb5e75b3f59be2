"""What a design can do beyond its task, as tables and sentences."""

from __future__ import annotations

from topo_search.export.audit_summary import flight_lines
from topo_search.model import CaseFlight, Flight
from topo_search.model.flight import direction
from topo_search.model.proven import at_least, at_most, lower_text, upper_text
from topo_search.model.topology import PORT_NAMES
from topo_search.model.value import Vector
from topo_search.report.page import FlightPart, Table
from topo_search.report.wording import figures


def flight_part(found: Flight) -> FlightPart:
    """Return all that is shown of it."""
    first, *others = (f"{line[0].upper()}{line[1:]}." for line in flight_lines(found))
    return FlightPart(first, cases(found), tuple(others), _joints(found))


def cases(found: Flight) -> Table:
    """Return a row for hover and each load case: what can be added to it, and where least."""
    columns = (
        "case",
        "possible",
        "any force at the tip",
        "least towards",
        "any side force",
        "least towards",
        "any torque",
        "least towards",
        "load factor",
        "inputs / u_max",
        "at a limit",
    )
    return Table(columns, [_case(case) for case in found.cases], frozenset({2, 4, 6, 8, 9, 10}))


def reserves(found: Flight) -> Table:
    """Return the same in brief, for two designs side by side."""
    chosen = (0, 2, 4, 6, 8)
    whole = cases(found)
    rows = [[row[column] for column in chosen] for row in whole.rows]
    return Table(tuple(whole.columns[column] for column in chosen), rows, frozenset({1, 2, 3, 4}))


def _case(case: CaseFlight) -> list[str]:
    inputs = ""
    if case.least_input is not None and case.largest_input is not None:
        inputs = f"{lower_text(case.least_input, 3)} to {upper_text(case.largest_input, 3)}"
    return [
        case.name,
        {True: "yes", False: "no", None: "undecided"}[case.possible],
        _size(case.force_reserve_N, " N"),
        _direction(case.force_weakest),
        _size(case.horizontal_reserve_N, " N"),
        _direction(case.horizontal_weakest),
        _size(case.torque_reserve_Nm, " N m"),
        _direction(case.torque_weakest),
        _size(case.load_factor, "", 4),
        inputs,
        "" if case.inputs_at_limit is None else str(case.inputs_at_limit),
    ]


def _joints(found: Flight) -> Table | None:
    """Return the case with the largest moment of each joint."""
    worst = {load.child: load for load in sorted(found.joints, key=lambda load: load.moment_Nm)}
    rows = [
        [
            f"port {PORT_NAMES[load.port]} of module {load.module} to module {load.child}",
            load.case,
            *(
                f"{figures(at_most(size, 3), 3)} {unit}"
                for size, unit in (
                    (load.force_N, "N"),
                    (load.moment_Nm, "N m"),
                    (load.about_hinge_Nm, "N m"),
                    (load.across_hinge_Nm, "N m"),
                )
            ),
        ]
        for _, load in sorted(worst.items())
    ]
    columns = ("joint", "case", "force", "moment", "about the hinge", "across it")
    return Table(columns, rows, frozenset({2, 3, 4, 5})) if rows else None


def _size(value: float | None, unit: str, digits: int = 3) -> str:
    return "" if value is None else f"{figures(at_least(value, digits), digits)}{unit}"


def _direction(v: Vector | None) -> str:
    return "" if v is None else direction(v)

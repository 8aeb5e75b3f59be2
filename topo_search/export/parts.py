"""The parts list of a kit: what to buy, cut and print, with masses and their totals."""

from __future__ import annotations

import math
from collections.abc import Sequence

from topo_search.export.brackets import MILLIMETRES, SLOT, Part, grip_of, has_clamp
from topo_search.export.poses import poses, rod_of
from topo_search.model.design import Design
from topo_search.model.tables import csv_text

COLUMNS = ("part", "count", "size", "mass_kg", "total_kg", "file")
Row = tuple[str, int | str, str, str, str, str]
"""Cells in the order of `COLUMNS`."""
PLASTIC, STEEL = 1240.0, 7850.0
"""Densities of printed PLA and of bolts [kg/m^3]."""
THREADS = (1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
"""Diameters of metric bolts [mm]."""
LENGTHS = (4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90, 100)
"""Lengths of metric bolts [mm]."""
ABOUT_PARTS = (
    "Printed parts weigh what solid PLA does, bolts with nuts what steel does. A bolt is long enough for a flange, "
    "a face of the module as thick as that, and a nut. The last row is the mass that search and audit count with."
)


def parts_list(design: Design, joints: Sequence[Part], mount: Part | None, held: Sequence[Part] = ()) -> list[Row]:
    """Return a row for every kind of part, then the total, and the mass of the model."""
    task, bracket = design.task, design.task.module.bracket_sizes
    rows = [_row("module", design.topology.n, "", task.module.mass)]
    rows += [_part_row("bracket", part) for part in joints]
    rows += [_part_row("strut", part) for part in held]
    flanges = 2 * len(joints) + sum(part.count for part in held)
    rod = rod_of(design, poses(design))
    if mount is not None and rod is not None:
        flanges += 1
        rows.append(_part_row("rod mount", mount))
        size = f"{MILLIMETRES * rod.length:.1f} mm long, {2 * MILLIMETRES * rod.radius:g} mm thick"
        rows.append(_row("rod", 1, size, task.end_effector.rod_linear_density * rod.length))
    rows.append(_row("end-effector", 1, "", task.end_effector.mass))
    hole = bracket.bolt_diameter
    if flanges:
        rows.append(_bolt_row("bolt with nut", 4 * flanges, *bolt_of(hole, 2 * bracket.thickness)))
    if mount is not None and rod is not None and has_clamp(bracket, grip_of(rod)):
        rows.append(_bolt_row("clamp bolt with nut", 1, *bolt_of(hole, 2 * bracket.wall + SLOT)))
    total = sum(float(row[4]) for row in rows)
    rows.append(("all parts", "", "", "", f"{total:.4f}", ""))
    rows.append(("model of the search", "", "", "", f"{task.total_mass(task.n):.4f}", ""))
    return rows


def mass_note(rows: Sequence[Row]) -> str:
    """Return what all parts weigh beside the model, and the mass of a joint with which both agree."""
    *parts, whole, model = rows
    note = f"all parts weigh {whole[4]} kg, the model of the search {model[4]} kg"
    joints = sum(int(row[1]) for row in parts if row[0] == "bracket")
    if not joints:
        return note
    joined = sum(float(row[4]) for row in parts if row[0] not in ("module", "rod", "end-effector"))
    return (
        f"{note}; with module.joint_mass={joined / joints:.3g} and "
        'end_effector.rod_mass="included" a search counts what joins the modules'
    )


def parts_csv(rows: Sequence[Row]) -> str:
    """Return the list as the text of a CSV file."""
    return csv_text(COLUMNS, rows)


def bolt_of(hole: float, grip: float) -> tuple[float, float]:
    """Return diameter and length of a bolt [mm], for a hole and what it holds together [m]."""
    d = max((thread for thread in THREADS if thread <= MILLIMETRES * hole), default=MILLIMETRES * hole)
    least = MILLIMETRES * grip + 0.8 * d + 1  # a nut is 0.8 d high, and a millimetre looks out of it
    return d, next((length for length in LENGTHS if length >= least), math.ceil(least))


def _bolt_row(name: str, count: int, d: float, length: float) -> Row:
    volume = math.pi / 4 * (d**2 * length + (1.8 * d) ** 2 * d + ((1.7 * d) ** 2 - d**2) * 0.8 * d)
    return _row(name, count, f"M{d:g} x {length:g}", STEEL * volume / MILLIMETRES**3)


def _part_row(name: str, part: Part) -> Row:
    mass = PLASTIC * part.volume_cm3 / 100.0**3
    return _row(name, part.count, f"{part.volume_cm3:.1f} cm^3", mass, f"brackets/{part.file}")


def _row(name: str, count: int, size: str, mass: float, file: str = "") -> Row:
    return name, count, size, f"{mass:.4g}", f"{count * mass:.4g}", file

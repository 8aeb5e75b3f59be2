"""The parts of a kit: what to buy, to cut and to print."""

from __future__ import annotations

from collections.abc import Sequence

from topo_search.export.kit.brackets import Part
from topo_search.export.poses import poses
from topo_search.export.rod import rod_of
from topo_search.model.design import Design
from topo_search.model.tables import csv_text

HEAD = ("part", "count", "size", "mass_kg", "file")
BOLTS_A_FLANGE = 4
Row = tuple[str, int, str, str, str]
"""What `HEAD` names."""


def parts_list(design: Design, joints: Sequence[Part], mount: Part | None) -> list[Row]:
    """Return a row for every kind of part; masses are those of the model, empty where it has none."""
    task, bracket = design.task, design.task.module.bracket_sizes
    rows = [("module", design.topology.n, "", f"{task.module.mass:g}", "")]
    rows += [("bracket", 1, f"{part.volume_cm3:.1f} cm^3", "", f"brackets/{part.file}") for part in joints]
    flanges = 2 * len(joints)
    rod = rod_of(design, poses(design))
    if mount is not None and rod is not None:
        flanges += 1
        radius, mass = 1000 * rod.radius, task.end_effector.rod_linear_density * rod.length
        rows.append(("rod mount", 1, f"{mount.volume_cm3:.1f} cm^3", "", f"brackets/{mount.file}"))
        size = f"{1000 * rod.length:.1f} mm long, {2 * radius:g} mm thick"
        rows.append(("rod", 1, size, f"{mass:.4g} (left out of the model)", ""))
    rows.append(("end-effector", 1, "", f"{task.end_effector.mass:g}", ""))
    bolt = f"hole {1000 * bracket.bolt_diameter:g} mm, through {1000 * bracket.thickness:g} mm and the module"
    rows.append(("bolt with nut", BOLTS_A_FLANGE * flanges, bolt, "", ""))
    return rows


def parts_csv(rows: Sequence[Row]) -> str:
    """Return the list as the text of a CSV file."""
    return csv_text(HEAD, rows)

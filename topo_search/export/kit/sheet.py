"""The assembly sheet as a page that prints: the convention, the parts, one step a joint."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape

from topo_search.export.kit.brackets import DIGITS, Part, connector_turn
from topo_search.export.kit.drawing import joint, ports, tips
from topo_search.export.kit.parts_list import HEAD, Row
from topo_search.export.poses import poses
from topo_search.export.rod import rod_of
from topo_search.model.design import Design
from topo_search.model.tables import paragraph, table
from topo_search.model.topology import PORT_NAMES

STYLE = """
body { font: 11pt/1.35 sans-serif; max-width: 180mm; margin: 10mm auto; color: #111; background: #fff }
table { border-collapse: collapse; font-size: 9.5pt } th, td { border: 0.3mm solid #999; padding: 1mm 2mm }
section { display: flex; gap: 6mm; align-items: center; break-inside: avoid; border-top: 0.3mm solid #999 }
section svg { width: 48mm; flex: none } .convention svg { width: 70mm } h2 { break-after: avoid }
@media print { body { margin: 0 } }
"""
CONVENTION = """\
Lay the parent before you, its rotors pulling up. The arrow from its centre to the port is x of the joint,
up is z. A hinge angle turns the child about the parent's y axis at ports 0 and 2, about its x axis at ports
1 and 3, by the right-hand rule; at zero parent and child lie in one plane. So a positive angle takes the
child's far end down at ports 0 and 3, and up at ports 1 and 2. The drawing of a step shows the joint from
its side: parent on the left, its upper side up. Each bracket has one mark hole on the parent's flange and
two on the child's: towards the upper side of either module."""


def sheet(
    design: Design, joints: Sequence[Part], mount: Part | None, rows: Sequence[Row], notes: Sequence[str]
) -> str:
    """Return the sheet.

    Args:
        design: what is built.
        joints: its brackets, in the order of assembly.
        mount: the rod's.
        rows: the parts list.
        notes: what else is to be said of the kit, a sentence each.
    """
    title = f"Assembly of {design.task.name}, {design.topology.key}"
    lines = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"/><title>{escape(title)}</title>',
        f"<style>{STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1>",
        *(paragraph(text) for text in notes),
        "<h2>Convention</h2>",
        f'<section class="convention">{ports()}{paragraph(CONVENTION)}</section>',
        paragraph(f"Angles are stated to {10**-DIGITS:g} deg. {_faces(design)}"),
        "<h2>Parts</h2>",
        table(HEAD, rows),
        "<h2>Steps</h2>",
        *_steps(design, joints),
        *_rod(design, len(joints) + 1, mount),
        "</body></html>",
    ]
    return "\n".join(lines) + "\n"


def _faces(design: Design) -> str:
    module = design.task.module
    at = 1000 * (module.connector_distance - module.bracket_sizes.set_back)
    return f"A bracket's flange bolts to a module's face {at:.2f} mm from the module's centre."


def _steps(design: Design, joints: Sequence[Part]) -> Iterator[str]:
    edges = zip(joints, design.topology.edges(), design.hinge_angles_rad, strict=True)
    for step, (part, (h, i, a, b), alpha) in enumerate(edges, start=1):
        text = (
            f"Step {step}: module {i} by its port {b} ({PORT_NAMES[b]}) to port {a} ({PORT_NAMES[a]}) "
            f"of module {h}, at {math.degrees(alpha):+.{DIGITS}f} deg: {tips(a, alpha)}. Bracket: {part.file}"
        )
        yield f"<section>{joint(design.task.module.bracket_sizes, a, alpha)}{paragraph(text)}</section>"


def _rod(design: Design, step: int, mount: Part | None) -> Iterator[str]:
    """Yield the step of the end-effector."""
    at = poses(design)
    rod = rod_of(design, at)
    if mount is None or rod is None or design.mount is None:
        yield paragraph("No connector is named for a straight rod to the end-effector: it is not part of this kit.")
        return
    i, a = design.mount.module, design.mount.port
    x, y, z = (at.R[i] @ connector_turn(a)).T @ (rod.end - rod.start) / rod.length
    yield paragraph(
        f"Step {step}: the rod's mount, {mount.file}, to port {a} ({PORT_NAMES[a]}) of module {i}, its mark hole "
        f"up; the rod, cut to {1000 * rod.length:.1f} mm, into it to the end of the bore, which is the connector. "
        f"Checked with a square: from there the end-effector is {1000 * rod.length * x:.1f} mm outwards, "
        f"{1000 * rod.length * y:.1f} mm to the left seen outwards, and {1000 * rod.length * z:.1f} mm up."
    )

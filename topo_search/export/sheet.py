"""The assembly sheet as a page that prints: the convention, the parts, one step a joint."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from topo_search.export import palette
from topo_search.export.brackets import DIGITS, MILLIMETRES, TURNS, Part, connector_turn, struts
from topo_search.export.overview import overview
from topo_search.export.parts import ABOUT_PARTS, COLUMNS, Row
from topo_search.export.poses import ROTOR_ANGLES, poses, rod_of
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.layout import PORT_DIRECTIONS
from topo_search.model.module import Bracket
from topo_search.model.tables import paragraph, table
from topo_search.model.topology import PORT_NAMES

STYLE = """
body { font: 11pt/1.35 sans-serif; max-width: 180mm; margin: 10mm auto; color: #111; background: #fff }
table { border-collapse: collapse; font-size: 9.5pt } th, td { border: 0.3mm solid #999; padding: 1mm 2mm }
section { display: flex; gap: 6mm; align-items: center; break-inside: avoid; border-top: 0.3mm solid #999 }
section svg { width: 48mm; flex: none } .convention svg { width: 70mm } h2 { break-after: avoid }
section:has(figure) { flex-wrap: wrap } figure { margin: 0 }
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
        notes: further notes on the kit, one sentence each.
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
        *(f"<section>{strut_drawing(design, part)}{paragraph(_strut(part))}</section>" for part in struts(design)),
        "<h2>Parts</h2>",
        table(COLUMNS, rows),
        paragraph(ABOUT_PARTS),
        "<h2>Steps</h2>",
        *_steps(design, joints),
        *_rod(design, len(joints) + 1, mount),
        "<h2>The whole platform</h2>",
        *overview(design),
        "</body></html>",
    ]
    return "\n".join(lines) + "\n"


def _faces(design: Design) -> str:
    module = design.task.module
    at = 1000 * (module.connector_distance - module.bracket_sizes.set_back)
    x, y = (1000 * edge / 2 for edge in module.body.hub[:2])
    return (
        f"A bracket's flange bolts to a module's face {at:.2f} mm from the module's centre. Struts, where the "
        f"parts list has some, reach it from the hub, whose faces are {x:.2f} mm (ports 0 and 2) and {y:.2f} mm "
        "(ports 1 and 3) from the centre. First bolt one to the hub at every port that a step names, mark hole up."
    )


def _strut(part: Part) -> str:
    return (
        f"The strut {part.file}, {part.count} of them, from its side: the hub on the left, a bracket or the rod's "
        "mount on the right, mark holes up. Lengths are in millimetres from the module's centre."
    )


def strut_drawing(design: Design, part: Part) -> str:
    """Return a strut from its side with the places of its faces."""
    (start, _, low), (end, _, high) = part.mesh.bounds
    t = MILLIMETRES * design.task.module.bracket_sizes.thickness
    half = MILLIMETRES * design.task.module.body.arm_width / 2
    svg = [HEAD.format(start - 15, -high - 15, end - start + 30, high - low + 40, f"strut of {end - start:.1f} mm")]
    flanges = [np.array([[x, low], [x + t, low], [x + t, high], [x, high]]) for x in (start, end - t)]
    beam = np.array([[start, -half], [end, -half], [end, half], [start, half]])
    svg += [_polygon(flange, palette.CONNECTOR) for flange in flanges]
    svg += [_polygon(beam, palette.MODULE), *(_text(x, -low + 12, f"{x:.2f}", 7) for x in (start, end))]
    return "\n".join([*svg, "</svg>"])


def _steps(design: Design, joints: Sequence[Part]) -> Iterator[str]:
    edges = zip(joints, design.topology.edges(), design.hinge_angles_rad, strict=True)
    for step, (part, (h, i, a, b), alpha) in enumerate(edges, start=1):
        text = (
            f"Step {step}. Bolt port {b} ({PORT_NAMES[b]}) of module {i} to port {a} ({PORT_NAMES[a]}) of module "
            f"{h}, at {math.degrees(alpha):+.{DIGITS}f} deg, with {part.file}. Module {i} {slope(a, alpha)}."
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
        f"Step {step}. Bolt the rod's mount, {mount.file}, to port {a} ({PORT_NAMES[a]}) of module {i}, mark hole "
        f"up. Cut the rod to {1000 * rod.length:.1f} mm, push it in until it bottoms out, and close the clamp with "
        "its bolt. Check with a square: "
        f"from the bottom of the bore, which is the connector, the tip is {1000 * rod.length * x:.1f} mm outwards, "
        f"{1000 * rod.length * y:.1f} mm to the left seen outwards, and {1000 * rod.length * z:.1f} mm up."
    )


Line = list[str]
HEAD = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="{:.6g} {:.6g} {:.6g} {:.6g}" role="img" aria-label="{}">'


def ports() -> str:
    """Return a module from above with its axes, ports and rotors."""
    svg = [HEAD.format(-80, -80, 160, 160, "a module from above: ports and rotors")]
    for q, angle in enumerate(ROTOR_ANGLES):
        x, y = 36 * math.cos(angle), -36 * math.sin(angle)
        svg.append(f'<line x1="0" y1="0" x2="{x:.2f}" y2="{y:.2f}" stroke="#666" stroke-width="3"/>')
        svg.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="18" fill="{palette.ROTOR}" fill-opacity="0.25"/>')
        turn = "CCW" if q % 2 == 0 else "CW"
        svg.append(_text(x, y + 2, f"rotor {q}", 6))
        svg.append(_text(x, y + 9, turn, 6))
    for number, (x, y, _) in enumerate(PORT_DIRECTIONS.tolist()):
        svg.append(f'<line x1="0" y1="0" x2="{56 * x}" y2="{-56 * y}" stroke="#222" stroke-width="1.5"/>')
        svg.append(f'<circle cx="{56 * x}" cy="{-56 * y}" r="2.5" fill="{palette.CONNECTOR}"/>')
        svg.append(_text(66 * x, -66 * y - 1, f"port {number}", 7))
        svg.append(_text(66 * x, -66 * y + 7, PORT_NAMES[number], 7))
    return "\n".join([*svg, "</svg>"])


def joint(sizes: Bracket, port: int, alpha: float) -> str:
    """Return a bracket from its side, the parent on the left, the parent's upper side up.

    The eye is where the hinge's turn phi about the bracket's y is clockwise for a positive phi: at -y.
    """
    r, d, t = (MILLIMETRES * x for x in (sizes.half_width, sizes.set_back, sizes.thickness))
    phi = TURNS[port] * alpha
    span = 3.2 * d
    svg = [HEAD.format(-span, -span, 2 * span, 2 * span, f"joint at {math.degrees(alpha):.3f} degrees")]
    flange = np.array([[-d, -r], [-d + t, -r], [-d + t, r], [-d, r]])
    own = np.array([[-span, -r / 2], [-d, -r / 2], [-d, r / 2], [-span, r / 2]])
    for points, colour in ((own, palette.MODULE), (flange, palette.CONNECTOR)):
        svg.append(_polygon(points, colour))
        svg.append(_polygon(_turn(points * [-1, 1], phi), colour))
    dashed = 'stroke="#888" stroke-width="0.7" stroke-dasharray="3 2"'
    svg.append(f'<circle r="1.5" fill="#222"/><line x1="0" y1="0" x2="{2 * d}" y2="0" {dashed}/>')
    end = _turn(np.array([[2 * d, 0.0]]), phi)[0]
    svg.append(f'<line x1="0" y1="0" x2="{end[0]:.2f}" y2="{-end[1]:.2f}" stroke="#222" stroke-width="0.7"/>')
    svg.append(_text(-2.2 * d, -r - 3, "up", 8))
    svg.append(_text(-2.2 * d, r + 11, "parent", 8))
    label = _turn(np.array([[2.2 * d, -r - 8]]), phi)[0]
    svg.append(_text(label[0], -label[1], "child", 8))
    return "\n".join([*svg, "</svg>"])


def slope(port: int, alpha: float) -> str:
    """Return how a child slopes away from its parent, for a reader who has the parent level before them."""
    if alpha == 0:
        return "is in line"
    return "slopes down" if TURNS[port] * alpha > 0 else "slopes up"


def _turn(points: Array, phi: float) -> Array:
    c, s = math.cos(phi), math.sin(phi)
    return np.asarray(points @ np.array([[c, -s], [s, c]]))


def _polygon(points: Array, colour: str) -> str:
    corners = " ".join(f"{x:.2f},{-z:.2f}" for x, z in points)
    return f'<polygon points="{corners}" fill="{colour}" fill-opacity="0.45" stroke="#222" stroke-width="0.6"/>'


def _text(x: float, y: float, text: str, size: float) -> str:
    return f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size}" text-anchor="middle">{text}</text>'

"""The assembly sheet as a page that prints: the convention, the parts, one step a joint, the whole platform.

The parts list says what to buy, cut and print, with masses and their totals. The whole platform is drawn in two
views with numbers; distances of a module's centre from three others, and from the tip, tell whether it is where it
belongs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from topo_search.export import brackets, palette
from topo_search.export.allocation import allocation
from topo_search.export.brackets import DIGITS, MILLIMETRES, Part
from topo_search.export.poses import ROTOR_ANGLES, rod_of
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.model.design import Design
from topo_search.model.module import Bracket
from topo_search.model.task import ResolvedTask
from topo_search.model.text import csv_text, html_page, paragraph, table
from topo_search.model.topology import PORT_NAMES
from verify.kinematics import Platform, platform

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
two on the child's: towards the upper side of either module, or the lower one where a step says mark holes down."""


def sheet(design: Design, solids: Sequence[Part], notes: Sequence[str]) -> str:
    """Return the sheet.

    Args:
        design: what is built.
        solids: what is printed of it.
        notes: further notes on the kit, one sentence each.
    """
    lines = [
        *(paragraph(text) for text in notes),
        "<h2>Convention</h2>",
        f'<section class="convention">{ports()}{paragraph(CONVENTION)}</section>',
        paragraph(f"Angles are stated to {10**-DIGITS:g} deg. {_faces(design)}"),
        *(
            f"<section>{strut_drawing(design, part)}{paragraph(_strut(part))}</section>"
            for part in solids
            if part.name == "strut"
        ),
        "<h2>Parts</h2>",
        table(COLUMNS, parts_list(design, solids)),
        paragraph(ABOUT_PARTS),
        "<h2>Steps</h2>",
        *_steps(design),
        *_rod(design, design.topology.n, solids),
        "<h2>The whole platform</h2>",
        *overview(design),
    ]
    return html_page(f"Assembly of {design.task.name}, {design.topology.key}", STYLE, lines)


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


def _steps(design: Design) -> Iterator[str]:
    edges = zip(design.topology.edges(), design.hinge_angles_rad, brackets.bracket_turns(design), strict=True)
    for step, ((h, i, a, b), alpha, phi) in enumerate(edges, start=1):
        text = (
            f"Step {step}. Bolt port {b} ({PORT_NAMES[b]}) of module {i} to port {a} ({PORT_NAMES[a]}) of module "
            f"{h}, at {math.degrees(alpha):+.{DIGITS}f} deg, with {brackets.bracket_file(abs(phi))}, mark holes "
            f"{'down' if phi < 0 else 'up'}. Module {i} {slope(a, alpha)}."
        )
        yield f"<section>{joint(design.task.module.bracket_sizes, a, alpha)}{paragraph(text)}</section>"


def _rod(design: Design, step: int, solids: Sequence[Part]) -> Iterator[str]:
    """Yield the step of the end-effector."""
    at = platform(design)
    rod = rod_of(design, at)
    if rod is None or design.mount is None:
        yield paragraph("No connector is named for a straight rod to the end-effector: it is not part of this kit.")
        return
    i, a = design.mount.module, design.mount.port
    (mount,) = (part for part in solids if part.name == "rod mount")
    x, y, z = (at.R[i] @ brackets.connector_turn(a)).T @ (rod.end - rod.start) / rod.length
    yield paragraph(
        f"Step {step}. Bolt the rod's mount, {mount.file}, to port {a} ({PORT_NAMES[a]}) of module {i}, mark hole "
        f"up. Cut the rod to {1000 * rod.length:.1f} mm, push it in until it bottoms out, and close the clamp with "
        "its bolt. The end-effector of "
        f"{1000 * design.task.end_effector.mass:.3g} g goes onto the tip; its fixture is yours. "
        "Check with a square: "
        f"from the bottom of the bore, which is the connector, the tip is {1000 * rod.length * x:.1f} mm outwards, "
        f"{1000 * rod.length * y:.1f} mm to the left seen outwards, and {1000 * rod.length * z:.1f} mm up."
    )


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
    phi = brackets.TURNS[port] * alpha
    span = 3.2 * d
    svg = [HEAD.format(-span, -span, 2 * span, 2 * span, f"joint at {math.degrees(alpha):.3f} degrees")]
    flange = np.array([[-d, -r], [-d + t, -r], [-d + t, r], [-d, r]])
    arm = np.array([[-span, -r / 2], [-d, -r / 2], [-d, r / 2], [-span, r / 2]])
    for points, colour in ((arm, palette.MODULE), (flange, palette.CONNECTOR)):
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
    return "slopes down" if brackets.TURNS[port] * alpha > 0 else "slopes up"


def _turn(points: Array, phi: float) -> Array:
    c, s = math.cos(phi), math.sin(phi)
    return np.asarray(points @ np.array([[c, -s], [s, c]]))


def _polygon(points: Array, colour: str) -> str:
    corners = " ".join(f"{x:.2f},{-z:.2f}" for x, z in points)
    return f'<polygon points="{corners}" fill="{colour}" fill-opacity="0.45" stroke="#222" stroke-width="0.6"/>'


def _text(x: float, y: float, text: str, size: float) -> str:
    return f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size:.4g}" text-anchor="middle">{text}</text>'


def overview(design: Design) -> Iterator[str]:
    """Yield the lines of the section."""
    at = platform(design)
    views = [_view(design, at, *axes) for axes in ((0, 1, "from above"), (0, 2, "from the side"))]
    yield f'<section class="convention">{"".join(views)}</section>'
    yield paragraph(
        "Numbers are those of the modules, E is the tip, + the centre of mass; in the axes of the task x is to the "
        "right and y (from above) or z (from the side) up. Distances between centres, to check with a rule:"
    )
    near = at.p[:3]
    head = ["module", *(f"to module {k} [mm]" for k in range(len(near))), "to the tip [mm]"]
    apart = (np.linalg.norm(np.vstack([near, at.end_effector]) - p, axis=1) for p in at.p)
    yield table(head, [[str(i), *_millimetres(lengths)] for i, lengths in enumerate(apart)])
    yield paragraph("How modules lie, from the centre of mass and in the axes of the task:")
    yield table(
        ("module", "x [mm]", "y [mm]", "z [mm]", "port 0 points to", "port 1 points to", "upper side points to"),
        [
            (i, *_millimetres(p - at.p_com), *(_direction(axis) for axis in R.T))
            for i, (p, R) in enumerate(zip(at.p, at.R, strict=True))
        ],
    )
    yield paragraph(_autopilot(at))
    yield paragraph(
        "Rotors from the centre of mass, in the axes of the task. Columns of the matrix, thrusts of allocator.py "
        "and CA_ROTOR parameters of PX4 count from 0, its motors from 1. CCW: "
        "counter-clockwise, seen against the thrust."
    )
    names = ("motor of PX4", "column", "module", "rotor", "turns", "x [mm]", "y [mm]", "z [mm]")
    rows = [
        (j + 1, j, one.module, one.rotor, "CCW" if one.spin > 0 else "CW", *_millimetres(one.position_m))
        for j, one in enumerate(allocation(design).rotors)
    ]
    yield table(names, rows)


def _autopilot(at: Platform) -> str:
    """Say where the autopilot goes, in the axes of module 0, which can be seen."""
    x, _, z = (_direction(axis) for axis in at.R[0])
    com = ", ".join(_millimetres(at.R[0].T @ at.p_com))
    hub = ", ".join(f"{number:.3f}" for number in (at.p[0] - at.p_com) * (1, -1, -1))  # forward, right, down
    return (
        f"Autopilot: the centre of mass is at [{com}] mm from the centre of module 0, in the axes of that module "
        f"(x towards port 0, y towards port 1, z up). Mount the autopilot there, its arrow along {x} and its "
        f"upper side along {z} in these axes: that is x and z of the task. If no part is there, put it on "
        f"the hub of module 0, with EKF2_IMU_POS_X, Y, Z = {hub} m; if it is turned set SENS_BOARD_ROT."
    )


def _view(design: Design, at: Platform, across: int, up: int, words: str) -> str:
    """Return the platform projected on two axes of the task."""
    module = design.task.module
    ports = at.p[:, None] + module.connector_distance * np.einsum("nij,kj->nki", at.R, PORT_DIRECTIONS)
    rotors = at.rotors + at.p_com
    points = MILLIMETRES * np.vstack([ports.reshape(-1, 3), rotors.reshape(-1, 3), [at.end_effector]])
    flat = points[:, [across, up]] * [1.0, -1.0]
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = float((high - low).max())
    low = (low + high - size) / 2 - 0.1 * size
    svg = [HEAD.format(*low, 1.2 * size, 1.2 * size, words)]

    def place(p: Array) -> tuple[float, float]:
        return float(MILLIMETRES * p[across]), float(-MILLIMETRES * p[up])

    radius, width = 0.02 * size, 0.006 * size
    for p, ends, discs in zip(at.p, ports, rotors, strict=True):
        x, y = place(p)
        for u, v in map(place, ends):
            line = f'x1="{x:.2f}" y1="{y:.2f}" x2="{u:.2f}" y2="{v:.2f}"'
            svg.append(f'<line {line} stroke="{palette.CONNECTOR}" stroke-width="{width:.4g}"/>')
        for u, v in map(place, discs):
            svg.append(f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{radius:.4g}" fill="{palette.ROTOR}"/>')
    u, v = place(at.end_effector)
    svg.append(f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{radius:.4g}" fill="{palette.END_EFFECTOR}"/>')
    named = [*((str(i), p) for i, p in enumerate(at.p)), ("E", at.end_effector), ("+", at.p_com)]
    svg += [_text(*place(p), text, size / 18) for text, p in named]
    return "".join([*svg, "</svg>"])


def _millimetres(lengths: Sequence[float] | Array) -> list[str]:
    return [f"{MILLIMETRES * float(x) + 0.0:.1f}" for x in lengths]


def _direction(v: Array) -> str:
    return f"[{', '.join(f'{float(x) + 0.0:.3f}' for x in v)}]"


COLUMNS = ("part", "count", "size", "mass_kg", "total_kg", "file")
ListedPart = tuple[str, int | str, str, str, str, str]
"""Cells in the order of `COLUMNS`."""
PLASTIC, STEEL = 1240.0, 7850.0
"""Densities of printed PLA and of bolts [kg/m^3]."""
ABOUT_PARTS = (
    "Printed parts weigh what solid PLA does, bolts with nuts what steel does. A bolt is long enough for a flange, "
    "a face of the module as thick as that, and a nut. The last row is the mass that search and audit count with."
)


def parts_list(design: Design, solids: Sequence[Part]) -> list[ListedPart]:
    """Return a row for every kind of part, then the total, and the mass of the model."""
    task, bracket = design.task, design.task.module.bracket_sizes
    rows = [_row("module", design.topology.n, "", task.module.mass)]
    for name in ("bracket", "strut", "rod mount"):
        rows += [_part_row(part) for part in solids if part.name == name]
    flanges = 2 * (design.topology.n - 1) + sum(part.count for part in solids if part.name != "bracket")
    rod = rod_of(design, platform(design))
    if rod is not None:
        size = f"{MILLIMETRES * rod.length:.1f} mm long, {2 * MILLIMETRES * rod.radius:g} mm thick"
        rows.append(_row("rod", 1, size, task.end_effector.rod_linear_density * rod.length))
    rows.append(_row("end-effector", 1, "", task.end_effector.mass))
    hole = bracket.bolt_diameter
    if flanges:
        rows.append(_bolt_row("bolt with nut", 4 * flanges, *bolt_of(hole, 2 * bracket.thickness)))
    if rod is not None and brackets.has_clamp(bracket, brackets.grip_of(rod)):
        rows.append(_bolt_row("clamp bolt with nut", 1, *bolt_of(hole, 2 * bracket.wall + brackets.SLOT)))
    total = sum(float(row[4]) for row in rows)
    rows.append(("all parts", "", "", "", f"{total:.4f}", ""))
    rows.append(("model of the search", "", "", "", f"{task.total_mass(task.n):.4f}", ""))
    return rows


def mass_note(task: ResolvedTask, rows: Sequence[ListedPart]) -> str:
    """Return what all parts weigh beside the model, and the fields with which both agree."""
    *parts, whole, model = rows
    note = f"all parts weigh {whole[4]} kg, the model of the search {model[4]} kg"
    joints = sum(int(row[1]) for row in parts if row[0] == "bracket")
    if not joints:
        return note
    joined = sum(float(row[4]) for row in parts if row[0] not in ("module", "rod", "end-effector"))
    fields = []
    if abs(joined / joints - task.module.joint_mass) > 5e-4:
        fields.append(f"module.joint_mass={joined / joints:.3g}")
    if task.end_effector.rod_mass == "ignored":
        fields.append('end_effector.rod_mass="included"')
    return f"{note}; with {' and '.join(fields)} a search counts what joins the modules" if fields else note


def parts_csv(rows: Sequence[ListedPart]) -> str:
    """Return the list as the text of a CSV file."""
    return csv_text(COLUMNS, rows)


def bolt_of(hole: float, grip: float) -> tuple[float, float]:
    """Return diameter and length of a bolt [mm], for a hole and what it holds together [m]."""
    threads = (1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)  # diameters of metric bolts
    lengths = (4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90, 100)
    d = max((thread for thread in threads if thread <= MILLIMETRES * hole), default=MILLIMETRES * hole)
    least = MILLIMETRES * grip + 0.8 * d + 1  # a nut is 0.8 d high, and a millimetre looks out of it
    return d, next((length for length in lengths if length >= least), math.ceil(least))


def _bolt_row(name: str, count: int, d: float, length: float) -> ListedPart:
    volume = math.pi / 4 * (d**2 * length + (1.8 * d) ** 2 * d + ((1.7 * d) ** 2 - d**2) * 0.8 * d)
    return _row(name, count, f"M{d:g} x {length:g}", STEEL * volume / MILLIMETRES**3)


def _part_row(part: Part) -> ListedPart:
    mass = PLASTIC * part.volume_cm3 / 100.0**3
    return _row(part.name, part.count, f"{part.volume_cm3:.1f} cm^3", mass, f"brackets/{part.file}")


def _row(name: str, count: int, size: str, mass: float, file: str = "") -> ListedPart:
    return name, count, size, f"{mass:.4g}", f"{count * mass:.4g}", file

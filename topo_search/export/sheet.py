"""The assembly sheet, a page to print: conventions, parts, a step per joint, and the whole platform.

The parts list says what to buy, cut and print, with masses and totals. A perspective picture shows each step, a
table the angles to set. Two views show the whole platform with the modules' numbers; distances from each module's
centre to three others, and to the tip, serve to check the assembly.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from topo_search.export import brackets, palette
from topo_search.export.allocation import allocation
from topo_search.export.brackets import DIGITS, MILLIMETRES, PrintedPart
from topo_search.export.poses import axis_words, kinds, rod_of
from topo_search.export.step_picture import step_picture
from topo_search.export.strength import ENOUGH, strengths
from topo_search.limits import quantity
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.model.bracket import Bracket
from topo_search.model.design import Design
from topo_search.model.html import html_page, paragraph, table
from topo_search.model.joint_mass import PLASTIC, bolt_mass, bolt_of, strut_width
from topo_search.model.module import Module
from topo_search.model.proven import lower_text
from topo_search.model.task import ResolvedTask
from topo_search.model.text import csv_text
from topo_search.model.topology import PORT_NAMES
from verify.kinematics import Platform, has_rotor, platform

STYLE = """
@page { size: A4; margin: 12mm }
body { font: 11pt/1.35 sans-serif; max-width: 180mm; margin: 10mm auto; color: #111; background: #fff }
table { border-collapse: collapse; font-size: 9.5pt } th, td { border: 0.3mm solid #999; padding: 1mm 2mm }
section { display: flex; gap: 6mm; align-items: center; break-inside: avoid; border-top: 0.3mm solid #999 }
section svg { width: 40mm; flex: none } .convention svg, section svg.step { width: 75mm } h2 { break-after: avoid }
section:has(figure) { flex-wrap: wrap } figure { margin: 0 }
@media print { body { margin: 0 } tr { break-inside: avoid } }
"""
CONVENTION = """\
Place the parent in front of you, with its rotors pulling up. The joint's x axis points from the parent's centre
to the port; z is up. The hinge angle rotates the child about the parent's y axis at ports 0 and 2, and about its
x axis at ports 1 and 3, by the right-hand rule; at zero, parent and child lie in one plane. A positive angle
therefore lowers the child's far end at ports 0 and 3, and raises it at ports 1 and 2. The drawing of each step
shows the joint from the side: parent on the left, its upper side up. Each bracket has one mark hole on the
parent's flange and two on the child's. Mount it with the mark holes on the upper side of both modules, or on the
lower side where a step says "mark holes down"."""


ABOUT_STEPS = (
    "A picture shows the platform after its step: what the step adds is dark, what was there before is light. "
    "White numbers on black are modules, black ones on white the ports that the step joins; E is the tip."
)


def sheet(design: Design, solids: Sequence[PrintedPart], notes: Sequence[str]) -> str:
    """Return the assembly sheet as an HTML page.

    Args:
        design: the design.
        solids: its printed parts.
        notes: notes on the kit, printed first, one sentence each.
    """
    first = max(kinds(design), key=lambda kind: kind.module.rotor_table.count)
    lines = [
        *(paragraph(text) for text in notes),
        "<h2>Convention</h2>",
        f'<section class="convention">{ports(first.module)}{paragraph(CONVENTION)}</section>',
        *_types(design),
        paragraph(f"Angles are given to {10**-DIGITS:g} deg. {_faces(design)}"),
        *(strut_section(design.task.module.bracket_sizes, kind) for kind in brackets.struts(design)),
        "<h2>Parts</h2>",
        table(COLUMNS, parts_list(design, solids)),
        paragraph(ABOUT_PARTS),
        "<h2>Steps</h2>",
        paragraph(ABOUT_STEPS),
        *_steps(design),
        *_rod(design, design.topology.n, solids),
        *_angles(design),
        *_strength(design),
        "<h2>The whole platform</h2>",
        *overview(design),
    ]
    return html_page(f"Assembly of {design.task.name}, {design.topology.key}", STYLE, lines)


def _types(design: Design) -> Iterator[str]:
    """Yield a drawing of each type of module with its name and the numbers of its modules, if there are types."""
    for kind in kinds(design) if design.task.module_types else ():
        rotors = quantity(kind.module.rotor_table.count, "rotor") if kind.module.rotor_table.count else "no rotors"
        numbers = ", ".join(map(str, kind.nodes))
        text = f"Type {kind.name}: {rotors}, {1000 * kind.module.mass:.4g} g. It is at the modules {numbers}."
        yield f'<section class="convention">{ports(kind.module)}{paragraph(text)}</section>'


def _faces(design: Design) -> str:
    """Return where brackets are bolted to modules, of each type."""
    set_back, faces, hubs = design.task.module.bracket_sizes.set_back, [], []
    for kind in kinds(design):
        of_type = kind.name and f" ({kind.name})"
        faces.append(f"{1000 * (kind.module.connector_distance - set_back):.2f} mm{of_type}")
        x, y = (1000 * edge / 2 for edge in kind.module.body.hub[:2])
        hubs.append(f"{x:.2f} mm (ports 0 and 2) and {y:.2f} mm (ports 1 and 3){of_type}")
    return (
        f"A bracket's flange bolts to a mounting face {', '.join(faces)} from the module's centre. If the parts "
        f"list has struts, they bridge the gap from the hub, whose faces are {', '.join(hubs)} from the centre: "
        "first bolt a strut to the hub at every port used in a step, mark hole up."
    )


def strut_section(sizes: Bracket, kind: brackets.Strut) -> str:
    """Return a side view of a strut with the positions of its faces, and its text."""
    end = 80.0
    lengths = sizes.half_width, sizes.thickness, sizes.wall, kind.tube, kind.width
    r, t, w, D, wide = (end * x / kind.length for x in lengths)
    length = f"{MILLIMETRES * kind.length:.1f} mm"
    svg = [HEAD.format(-15, -r - 15, end + 30, 2 * r + 40, f"strut of {length}")]

    def box(low: float, high: float, half: float, colour: str) -> str:
        return _polygon(np.array([[low, -half], [high, -half], [high, half], [low, half]]), colour)

    sockets = [(t, t + D), (end - t - D, end - t)] if D else []
    svg += [box(low, high, r, palette.CONNECTOR) for low, high in ((0.0, t), (end - t, end))]
    svg += [box(low, high, D / 2 + w, palette.CONNECTOR) for low, high in sockets]
    svg.append(box(t, end - t, D / 2 or wide, palette.MODULE))
    for x, place in ((0.0, kind.inner), (end, kind.outer)):
        svg.append(_text(x, r + 12, f"{MILLIMETRES * place:.2f}", 7))
    text = (
        f"Strut of {length} ({kind.number} needed), side view: the hub is on the left, a bracket or the rod's "
        "mount on the right, mark holes up. Dimensions are in millimetres from the module's centre."
    )
    if kind.tube:
        cut = MILLIMETRES * (kind.length - 2 * sizes.thickness)
        text += (
            f" It is a tube of {MILLIMETRES * kind.tube:g} mm, cut to {cut:.1f} mm and glued into two printed ends "
            "until it bottoms out. While the glue sets, lay both ends on a flat table, mark holes up."
        )
    return "\n".join(["<section>", *svg, f"</svg>{paragraph(text)}</section>"])


def _joints(design: Design) -> Iterator[tuple[int, tuple[int, int, int, int], float, float]]:
    """Yield the step of each joint, its modules and ports, its hinge angle [rad] and its bracket's turn [deg]."""
    edges = zip(design.topology.edges(), design.hinge_angles_rad, brackets.bracket_turns(design), strict=True)
    yield from ((step, *joint) for step, joint in enumerate(edges, start=1))


def _steps(design: Design) -> Iterator[str]:
    names = {i: f", {kind.name}," for kind in kinds(design) if kind.name for i in kind.nodes}
    for step, (h, i, a, b), alpha, phi in _joints(design):
        text = (
            f"Step {step}. Bolt port {b} ({PORT_NAMES[b]}) of module {i}{names.get(i, '')} to port {a} "
            f"({PORT_NAMES[a]}) of module {h}{names.get(h, ',')} at {math.degrees(alpha):+.{DIGITS}f} deg, with "
            f"{brackets.bracket_file(abs(phi))}, mark holes {'down' if phi < 0 else 'up'}. "
            f"Module {i} {slope(a, alpha)}."
        )
        side_view = joint(design.task.module.bracket_sizes, a, alpha)
        yield f"<section>{step_picture(design, i + 1)}<div>{paragraph(text)}{side_view}</div></section>"


def _angles(design: Design) -> Iterator[str]:
    """Yield a table of the hinge angles, as a person sets them with a protractor."""
    if design.topology.n == 1:
        return
    yield "<h2>Angles to set</h2>"
    yield paragraph(
        "The protractor measures between the two modules' upper sides where the child slopes up, and between their "
        "lower sides where it slopes down: 180 degrees less the angle of the bracket."
    )
    rows = []
    for step, (h, i, a, b), alpha, phi in _joints(design):
        sides = "either" if phi == 0 else "lower" if phi > 0 else "upper"
        joined = f"port {a} of module {h} to port {b} of module {i}"
        angle = f"{math.degrees(alpha) + 0.0:+.{DIGITS}f}"
        rows.append((step, joined, angle, slope(a, alpha), f"{180 - abs(phi):.1f}, {sides} sides"))
    yield table(("step", "joint", "hinge angle [deg]", "child", "protractor [deg]"), rows)


def _strength(design: Design) -> Iterator[str]:
    """Yield the section on printing the brackets, and on what they carry."""
    if design.topology.n == 1:
        return
    yield "<h2>Printing and strength</h2>"
    yield paragraph(
        "Print each bracket lying on one of its two webs, so that layers run along the webs from flange to flange, "
        "solid; the rod's mount, and the ends of tubes, on their flange. Safety factors are those of brackets of "
        "PLA under the largest load of each joint in the load cases: an estimate without holes, shocks and "
        "fatigue. Other materials: multiply by their strength over 50 MPa."
    )
    rows = [
        (step, brackets.bracket_file(abs(phi)), f"{one.force_N:.2f}", f"{one.moment_Nm:.3f}", f"{one.factor:.1f}")
        for step, (phi, one) in enumerate(
            zip(brackets.bracket_turns(design), strengths(design), strict=True), start=1
        )
    ]
    yield table(("step", "bracket", "force [N]", "moment [N m]", "safety factor"), rows)


def strength_note(design: Design) -> Iterator[str]:
    """Yield a warning if the weakest bracket has less than the usual safety factor."""
    weakest = min((one.factor for one in strengths(design)), default=math.inf)
    if weakest < ENOUGH:
        yield (
            f"the weakest bracket, of PLA, has a safety factor of {lower_text(weakest, 2)}, below {ENOUGH:g}: "
            "print a stronger material, or search again with a larger thickness and wall in [module.bracket]"
        )


def _rod(design: Design, step: int, solids: Sequence[PrintedPart]) -> Iterator[str]:
    """Yield the step that mounts the end-effector."""
    poses = platform(design)
    rod = rod_of(design, poses)
    if rod is None or design.mount is None:
        yield paragraph(
            "The design names no connector for a straight rod to the end-effector: this kit has no mount for it."
        )
        return
    i, a = design.mount.module, design.mount.port
    (mount,) = (part for part in solids if part.name == "rod mount")
    offsets = (poses.R[i] @ brackets.connector_turn(a)).T @ (rod.end - rod.start)
    sides = ("outwards", "inwards"), ("to the left", "to the right"), ("up", "down")
    x, y, z = (f"{1000 * abs(d):.1f} mm {words[d < 0]}" for d, words in zip(offsets.tolist(), sides, strict=True))
    tilt = axis_words(design.task, (rod.end - rod.start) / rod.length)
    text = (
        f"Step {step}. Bolt the rod's mount, {mount.file}, to port {a} ({PORT_NAMES[a]}) of module {i}, mark hole "
        f"up. Cut the rod to {1000 * rod.length:.1f} mm, push it in until it bottoms out, and close the clamp with "
        "its bolt. The end-effector of "
        f"{1000 * design.task.end_effector.mass:.3g} g goes on the tip; its fixture is not part of the kit. "
        "Check with a square: "
        f"from the bottom of the bore, which is the connector, the tip is {x}, {y} (looking outwards), and {z}."
        + (f" The rod is then {tilt}." if tilt else "")
    )
    yield f"<section>{step_picture(design, design.topology.n, with_rod=True)}<div>{paragraph(text)}</div></section>"


HEAD = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="{:.6g} {:.6g} {:.6g} {:.6g}" role="img" aria-label="{}">'


def ports(module: Module) -> str:
    """Return a top view of a module with its axes, ports and rotors, as SVG."""
    svg = [HEAD.format(-86, -80, 172, 160, "a module from above: ports and rotors")]
    rotors = module.rotor_table
    scale = 36 / rotors.distances.max(initial=1e-9)
    for q, ((x, y, _), spin) in enumerate(zip(scale * rotors.positions * [1, -1, 1], rotors.spins, strict=True)):
        svg.append(f'<line x1="0" y1="0" x2="{x:.2f}" y2="{y:.2f}" stroke="#ccc" stroke-width="3"/>')
        svg.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="18" fill="{palette.ROTOR}" fill-opacity="0.25"/>')
        turn = "CCW" if spin > 0 else "CW"
        svg.append(_text(x, y + 2, f"rotor {q}", 6))
        svg.append(_text(x, y + 9, turn, 6))
    for number, (x, y, _) in enumerate(PORT_DIRECTIONS.tolist()):
        svg.append(f'<line x1="0" y1="0" x2="{56 * x}" y2="{-56 * y}" stroke="#222" stroke-width="1.5"/>')
        svg.append(f'<circle cx="{56 * x}" cy="{-56 * y}" r="2.5" fill="{palette.CONNECTOR}"/>')
        svg.append(_text(71 * x, -69 * y - 1, f"port {number}", 7))
        svg.append(_text(71 * x, -69 * y + 7, PORT_NAMES[number], 7))
    return "\n".join([*svg, "</svg>"])


DRAWN = 24.0
"""Set-back of a bracket in a side view, for letters and lines of one size whatever the bracket's."""


def joint(sizes: Bracket, port: int, alpha: float) -> str:
    """Return a side view of a bracket, the parent on the left with its upper side up, as SVG.

    The view is along the bracket's +y, so a positive turn phi is clockwise.
    """
    r, d, t = (DRAWN * x / sizes.set_back for x in (sizes.half_width, sizes.set_back, sizes.thickness))
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
    """Return how a child slopes away from its parent, with the parent level."""
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
    """Yield the lines of the section on the whole platform."""
    poses = platform(design)
    views = [_view(design, poses, *axes) for axes in ((0, 1, "from above"), (0, 2, "from the side"))]
    yield f'<section class="convention">{"".join(views)}</section>'
    yield paragraph(
        "The numbers are those of the modules, E is the tip, and + is the centre of mass. In the axes of the task, "
        "x points right and y (from above) or z (from the side) up. Distances between centres, to check with a "
        "ruler:"
    )
    first_centres = poses.p[:3]
    head = ["module", *(f"to module {k} [mm]" for k in range(len(first_centres))), "to the tip [mm]"]
    distances = (np.linalg.norm(np.vstack([first_centres, poses.end_effector]) - p, axis=1) for p in poses.p)
    yield table(head, [[str(i), *_millimetres(lengths)] for i, lengths in enumerate(distances)])
    yield paragraph("Poses of the modules, from the centre of mass in the axes of the task:")
    yield table(
        ("module", "x [mm]", "y [mm]", "z [mm]", "port 0 points to", "port 1 points to", "upper side points to"),
        [
            (i, *_millimetres(p - poses.p_com), *(_direction(axis) for axis in R.T))
            for i, (p, R) in enumerate(zip(poses.p, poses.R, strict=True))
        ],
    )
    yield paragraph(_autopilot(poses))
    yield paragraph(
        "Positions of the rotors, from the centre of mass in the axes of the task. Columns of the matrix, thrusts "
        "in allocator.py and PX4's CA_ROTOR parameters count from 0, PX4's motors from 1. CCW is counter-clockwise "
        "as seen from above a rotor that pulls up."
    )
    names = ("PX4 motor", "column", "module", "rotor", "spin", "x [mm]", "y [mm]", "z [mm]")
    rows = [
        (j + 1, j, rotor.module, rotor.rotor, "CCW" if rotor.spin > 0 else "CW", *_millimetres(rotor.position_m))
        for j, rotor in enumerate(allocation(design).rotors)
    ]
    yield table(names, rows)


def _autopilot(poses: Platform) -> str:
    """Return where the autopilot goes, in the axes of module 0, which a builder can see."""
    x, _, z = (_direction(axis) for axis in poses.R[0])
    com = ", ".join(_millimetres(poses.R[0].T @ poses.p_com))
    hub = ", ".join(f"{number:.3f}" for number in (poses.p[0] - poses.p_com) * (1, -1, -1))  # forward, right, down
    return (
        f"Autopilot: the centre of mass is [{com}] mm from the centre of module 0, in the axes of that module "
        f"(x towards port 0, y towards port 1, z up). Mount the autopilot there, with its arrow along {x} and "
        f"its upper side along {z} in these axes, which are x and z of the task. If there is nothing to mount it "
        f"on, put it on the hub of module 0 and set EKF2_IMU_POS_X, Y, Z = {hub} m. If it is rotated, set "
        "SENS_BOARD_ROT."
    )


def _view(design: Design, poses: Platform, across: int, up: int, words: str) -> str:
    """Return a view of the platform on two axes of the task, as SVG."""
    l_c = np.array([module.connector_distance for module in design.task.modules_of_nodes])[:, None, None]
    ports = poses.p[:, None] + l_c * np.einsum("nij,kj->nki", poses.R, PORT_DIRECTIONS)
    rotors = [discs[own] + poses.p_com for discs, own in zip(poses.rotors, has_rotor(design.task), strict=True)]
    points = MILLIMETRES * np.vstack([ports.reshape(-1, 3), *rotors, [poses.end_effector]])
    flat = points[:, [across, up]] * [1.0, -1.0]
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = float((high - low).max())
    low = (low + high - size) / 2 - 0.1 * size
    svg = [HEAD.format(*low, 1.2 * size, 1.2 * size, words)]

    def project(p: Array) -> tuple[float, float]:
        return float(MILLIMETRES * p[across]), float(-MILLIMETRES * p[up])

    radius, width = 0.02 * size, 0.006 * size
    for p, ends, discs in zip(poses.p, ports, rotors, strict=True):
        x, y = project(p)
        for u, v in map(project, ends):
            line = f'x1="{x:.2f}" y1="{y:.2f}" x2="{u:.2f}" y2="{v:.2f}"'
            svg.append(f'<line {line} stroke="{palette.CONNECTOR}" stroke-width="{width:.4g}"/>')
        for u, v in map(project, discs):
            svg.append(f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{radius:.4g}" fill="{palette.ROTOR}"/>')
    if (rod := rod_of(design, poses)) is not None:
        (x, y), (u, v) = project(rod.start), project(rod.end)
        line = f'x1="{x:.2f}" y1="{y:.2f}" x2="{u:.2f}" y2="{v:.2f}"'
        svg.append(f'<line {line} stroke="{palette.END_EFFECTOR}" stroke-width="{2 * width:.4g}"/>')
    svg.append(_text(*project(poses.p_com), "+", size / 18))
    for text, point in (*((str(i), p) for i, p in enumerate(poses.p)), ("E", poses.end_effector)):
        x, y = project(point)
        svg.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{size / 30:.4g}" fill="#111"/>')
        svg.append(_text(x, y + size / 75, text, size / 25).replace(">", ' font-weight="bold" fill="#fff">', 1))
    return "".join([*svg, "</svg>"])


def _millimetres(lengths: Sequence[float] | Array) -> list[str]:
    return [f"{MILLIMETRES * float(x) + 0.0:.1f}" for x in lengths]


def _direction(v: Array) -> str:
    return f"[{', '.join(f'{float(x) + 0.0:.3f}' for x in v)}]"


SAME_MASS = 0.05
"""Largest difference of the mass of all parts from that of the search's model, as a share, that is not told."""
COLUMNS = ("part", "count", "size", "mass_kg", "total_kg", "file")
ListedPart = tuple[str, int | str, str, str, str, str]
"""Cells of a part, in the order of `COLUMNS`."""
ABOUT_PARTS = (
    "Masses of printed parts are for solid PLA, those of bolts with nuts for steel. A bolt is long enough for a "
    "flange, a module face of the same thickness, and a nut. Tubes are of carbon fibre. The last row is the mass "
    "used by search and audit."
)
TUBE_WALL, TUBE_DENSITY = 0.001, 1600.0
"""Wall thickness of a strut's tube [m], and its density [kg/m^3]."""


def parts_list(design: Design, solids: Sequence[PrintedPart]) -> list[ListedPart]:
    """Return a row for every kind of part, then the total mass, then the mass of the search's model."""
    task, bracket = design.task, design.task.module.bracket_sizes
    rows = [_row("module", len(kind.nodes), kind.name, kind.module.mass) for kind in kinds(design)]
    for name in ("bracket", "strut", "tube end", "rod mount"):
        rows += [_part_row(part) for part in solids if part.name == name]
    struts = brackets.struts(design)
    rows += [_tube_row(kind, bracket.thickness) for kind in struts if kind.tube]
    mounts = sum(part.name == "rod mount" for part in solids)
    flanges = 2 * (design.topology.n - 1) + sum(kind.number for kind in struts) + mounts
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
    """Return the mass of all parts, that of the search's model, and how to make them agree if they do not."""
    *parts, total, model = rows
    more = float(total[4]) / float(model[4]) - 1
    note = f"all parts weigh {total[4]} kg, the model of the search {model[4]} kg"
    joints = sum(int(row[1]) for row in parts if row[0] == "bracket")
    if abs(more) <= SAME_MASS or not joints:
        return note
    joining_mass = sum(float(row[4]) for row in parts if row[0] not in ("module", "rod", "end-effector"))
    settings = [f"--set module.joint_mass={joining_mass / joints:.3g}"]
    if task.end_effector.rod == "straight" and task.end_effector.rod_mass == "ignored":
        settings.append("--set 'end_effector.rod_mass=\"included\"'")
    return f"{note}, off by {100 * abs(more):.2g} %; search again with {' '.join(settings)}"


def struts_note(design: Design) -> Iterator[str]:
    """Yield what has to hold the brackets if rotors leave no room for struts."""
    sizes, modules = design.task.module.bracket_sizes, brackets.modules_with_brackets(design)
    for kind in kinds(design):
        module = modules[kind.nodes[0]]
        outer, hub = module.connector_distance - sizes.set_back, min(module.body.hub[:2]) / 2
        if module.body.frame is None and not strut_width(module) and outer - hub > 2 * sizes.thickness:
            faces, middle = f"{MILLIMETRES * outer:.1f} mm", f"{MILLIMETRES * hub:.1f} mm"
            of_type = kind.name and f" of the type {kind.name}"
            yield (
                f"rotors leave no room for straight struts: nothing in the kit joins a hub{of_type}, {middle} from "
                f"the centre, to the faces of brackets, {faces} from it; that part, and its mass, are yours to add"
            )


def parts_csv(rows: Sequence[ListedPart]) -> str:
    """Return the parts list as the text of a CSV file."""
    return csv_text(COLUMNS, rows)


def _tube_row(kind: brackets.Strut, thickness: float) -> ListedPart:
    D, wall, length = kind.tube, TUBE_WALL, kind.length - 2 * thickness
    inside = MILLIMETRES * (D - 2 * wall)
    size = f"{MILLIMETRES * length:.1f} mm long, {MILLIMETRES * D:g} mm thick, {inside:g} mm inside"
    return _row("tube", kind.number, size, TUBE_DENSITY * math.pi * (D - wall) * wall * length)


def _bolt_row(name: str, count: int, d: float, length: float) -> ListedPart:
    return _row(name, count, f"M{d:g} x {length:g}", bolt_mass(d, length))


def _part_row(part: PrintedPart) -> ListedPart:
    mass = PLASTIC * part.volume_cm3 / 100.0**3
    return _row(part.name, part.count, f"{part.volume_cm3:.1f} cm^3", mass, f"brackets/{part.file}")


def _row(name: str, count: int, size: str, mass: float, file: str = "") -> ListedPart:
    return name, count, size, f"{mass:.4g}", f"{count * mass:.4g}", file

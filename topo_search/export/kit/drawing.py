"""Line drawings of the assembly sheet: the ports of a module, the sign of a hinge, a bracket from its side."""

from __future__ import annotations

import math

import numpy as np

from topo_search.export import palette
from topo_search.export.kit.brackets import MILLIMETRES, TURNS
from topo_search.export.parts import ROTOR_ANGLES
from topo_search.export.poses import PORTS
from topo_search.model.arrays import Array
from topo_search.model.module import Bracket
from topo_search.model.topology import PORT_NAMES

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
    for number, (x, y, _) in enumerate(PORTS.tolist()):
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
    svg.append(f'<circle r="1.5" fill="#222"/><line x1="0" y1="0" x2="{2 * d}" y2="0" {_DASHED}/>')
    end = _turn(np.array([[2 * d, 0.0]]), phi)[0]
    svg.append(f'<line x1="0" y1="0" x2="{end[0]:.2f}" y2="{-end[1]:.2f}" stroke="#222" stroke-width="0.7"/>')
    svg.append(_text(-2.2 * d, -r - 3, "up", 8))
    svg.append(_text(-2.2 * d, r + 11, "parent", 8))
    label = _turn(np.array([[2.2 * d, -r - 8]]), phi)[0]
    svg.append(_text(label[0], -label[1], "child", 8))
    return "\n".join([*svg, "</svg>"])


def tips(port: int, alpha: float) -> str:
    """Say which way a child tips, for a reader who has the parent level before them."""
    if alpha == 0:
        return "in line"
    return "child's far end down" if TURNS[port] * alpha > 0 else "child's far end up"


_DASHED = 'stroke="#888" stroke-width="0.7" stroke-dasharray="3 2"'


def _turn(points: Array, phi: float) -> Array:
    """Return points (x, z) turned about y: a positive phi takes x towards -z."""
    c, s = math.cos(phi), math.sin(phi)
    return np.asarray(points @ np.array([[c, -s], [s, c]]))


def _polygon(points: Array, colour: str) -> str:
    corners = " ".join(f"{x:.2f},{-z:.2f}" for x, z in points)
    return f'<polygon points="{corners}" fill="{colour}" fill-opacity="0.45" stroke="#222" stroke-width="0.6"/>'


def _text(x: float, y: float, text: str, size: float) -> str:
    return f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size}" text-anchor="middle">{text}</text>'

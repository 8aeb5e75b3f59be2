"""The tree of modules as inline SVG: squares with their four ports, lines with the hinge angles.

Drawn like the tree of the static pictures, in cells of a grid of one unit.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np

from topo_search.export import palette
from topo_search.export.poses import PORTS
from topo_search.export.tree_layout import layout
from topo_search.model import Assembly, Design
from topo_search.model.arrays import Array
from topo_search.model.topology import PORT_NAMES

SIDE = 0.46
"""Edge of a module's square."""
PORT = 0.13
"""Edge of a port's square."""
CELL = 90
"""Width of a cell on the page at most [px]."""


def tree_svg(design: Design, assembly: Assembly | None = None) -> str:
    """Return the drawing as the text of an `svg` element; an assembly sheet adds mount and blocked connectors."""
    topology = design.topology
    cells, turns = layout(topology)
    place = cells * np.array([1, -1])  # y points down on a page
    low, high = place.min(axis=0) - 0.6, place.max(axis=0) + 0.6
    width, height = high - low
    svg = ElementTree.Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "viewBox": " ".join(f"{x:g}" for x in (*low, width, height)),
            "role": "img",
            "aria-label": f"tree of the {topology.n} modules, {topology.key}",
            "style": f"width:{CELL * width:.0f}px",
        },
    )
    for (h, i, a, b), alpha in zip(topology.edges(), design.hinge_angles_rad, strict=True):
        ends = place[[h, i]]
        (x1, y1), (x2, y2) = ends
        _add(svg, "line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=palette.CONNECTOR, stroke_width=0.05)
        aside = np.array([0.0, -0.12]) if turns is not None and y1 == y2 else np.array([0.19, 0.0])
        _text(svg, ends.mean(axis=0) + aside, f"{math.degrees(alpha):.0f}°".replace("-", "−"), 0.15)
        if turns is None:
            for end, other, port in ((h, i, a), (i, h, b)):
                at = place[end] + 0.33 * (place[other] - place[end])
                _text(svg, at, PORT_NAMES[port], 0.13, palette.CONNECTOR)
    colours = _port_colours(design, assembly)
    for i, centre in enumerate(place):
        _square(svg, centre, SIDE, "#ffffff", palette.MODULE, 0.05 if i == 0 else 0.025)
        _text(svg, centre, str(i), 0.2)
        if turns is None:
            continue
        for port in range(4):
            place_of_port = centre + SIDE / 2 * _drawn_direction(port + turns[i])
            _square(svg, place_of_port, PORT, colours[i, port], palette.MODULE, 0.012)
        x, y = centre + 0.32 * SIDE * _drawn_direction(turns[i])
        _add(svg, "circle", cx=x, cy=y, r=0.03, fill=palette.THRUST_AXIS)
    return ElementTree.tostring(svg, encoding="unicode")


def _port_colours(design: Design, assembly: Assembly | None) -> dict[tuple[int, int], str]:
    """Return the colour of every port: with a joint, free, blocked for the rod, or its mount."""
    topology = design.topology
    colours = {(i, port): palette.CONNECTOR for i in range(topology.n) for port in range(4)}
    colours.update(dict.fromkeys(topology.free_connectors, palette.FREE_PORT))
    if assembly is not None and assembly.end_effector is not None:
        for connector in assembly.end_effector.connectors:
            if connector.blocked_by:
                colours[connector.module, connector.port] = palette.BLOCKED_PORT
    if assembly is not None and assembly.mount is not None:
        colours[assembly.mount.module, assembly.mount.port] = palette.END_EFFECTOR
    return colours


def _drawn_direction(port: int) -> Array:
    """Return the direction of a port in the drawing."""
    return np.asarray(PORTS[port % 4, :2] * np.array([1, -1]))


def _add(svg: ElementTree.Element, name: str, **attributes: object) -> ElementTree.Element:
    given = {key.replace("_", "-"): f"{x:g}" if isinstance(x, float) else str(x) for key, x in attributes.items()}
    return ElementTree.SubElement(svg, name, given)


def _square(
    svg: ElementTree.Element, centre: Array, side: float, fill: str, stroke: str, stroke_width: float
) -> None:
    x, y = centre - side / 2
    _add(svg, "rect", x=x, y=y, width=side, height=side, fill=fill, stroke=stroke, stroke_width=stroke_width)


def _text(svg: ElementTree.Element, at: Array, text: str, size: float, fill: str = "#000000") -> None:
    look = {"text_anchor": "middle", "dominant_baseline": "central", "paint_order": "stroke"}
    halo = {"stroke": "#ffffff", "stroke_width": 0.04}
    _add(svg, "text", x=at[0], y=at[1], font_size=size, fill=fill, **look, **halo).text = text

"""Drawings of the tree of modules with ports and hinge angles, in matplotlib and as inline SVG.

The tree is unfolded flat on a square grid; if modules overlap there, it is drawn in layers. Lengths are in cells.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from topo_search.export import palette
from topo_search.export.poses import ModuleKind, kinds
from topo_search.model import PORT_DIRECTIONS, Array, Assembly, Design
from topo_search.model.topology import PORT_NAMES, Topology

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE = 0.46
"""Edge of a module's square."""


def flat_layout(topology: Topology) -> tuple[Array, list[int]]:
    """Unfold the tree on a square grid, with every hinge flat.

    Returns:
        The cell of every module, (n, 2), and its rotation in quarter turns.
    """
    cells, turns = [np.zeros(2)], [0]
    for h, _, a, b in topology.edges():
        cells.append(cells[h] + PORT_DIRECTIONS[(a + turns[h]) % 4, :2])
        turns.append((turns[h] + a + 2 - b) % 4)
    return np.array(cells), turns


def layered_layout(topology: Topology) -> Array:
    """Return positions in layers, (n, 2): leaves side by side, every parent above the middle of its children."""
    import networkx as nx  # slow to import, and few trees need layers

    tree = topology.graph()
    depth = nx.shortest_path_length(tree, 0)
    leaves = itertools.count()
    x: dict[int, float] = {}
    for i in nx.dfs_postorder_nodes(tree, 0):
        below = [x[j] for j in tree[i] if topology.parents[j] == i]
        x[i] = (min(below) + max(below)) / 2 if below else next(leaves)
    return np.array([[x[i], -1.3 * depth[i]] for i in range(topology.n)])


def layout(topology: Topology) -> tuple[Array, list[int] | None]:
    """Return the cell of every module, (n, 2), and its quarter turns; None instead of turns for layers."""
    cells, turns = flat_layout(topology)
    if len(np.unique(cells, axis=0)) == topology.n:
        return cells, turns
    return layered_layout(topology), None


def draw_tree(axes: Axes, design: Design) -> None:
    """Draw the tree: the shapes of `tree_svg`, without text that would be too small to read."""
    from matplotlib.patches import Circle, Rectangle
    from matplotlib.patheffects import withStroke

    svg = _tree(design, None, ())
    left, top, width, height = map(float, svg.attrib["viewBox"].split())
    half = np.maximum((width, height), 2.5) / 2
    scale = float(np.clip(85 / half.max(), 20, 40))  # points per cell; squares shrink further as the grid grows
    halo = [withStroke(linewidth=0.08 * scale, foreground="white")]
    for order, shape in enumerate(svg):
        match shape.tag:
            case "line":
                x1, y1, x2, y2, wide = _numbers(shape, "x1", "y1", "x2", "y2", "stroke-width")
                axes.plot([x1, x2], [-y1, -y2], color=shape.get("stroke"), linewidth=scale * wide, zorder=order)
            case "rect":
                x, y, side, wide = _numbers(shape, "x", "y", "width", "stroke-width")
                colours: dict[str, Any] = {"facecolor": shape.get("fill"), "edgecolor": shape.get("stroke")}
                axes.add_patch(Rectangle((x, -y - side), side, side, lw=scale * wide, zorder=order, **colours))
            case "circle":
                x, y, r = _numbers(shape, "cx", "cy", "r")
                axes.add_patch(Circle((x, -y), r, color=shape.get("fill"), zorder=order))
            case "text":
                x, y, size = _numbers(shape, "x", "y", "font-size")
                if scale * size > 3:
                    style: Any = {"color": shape.get("fill"), "ha": "center", "va": "center", "path_effects": halo}
                    axes.text(x, -y, str(shape.text), fontsize=scale * size, zorder=order, **style)
    x, y = left + width / 2, -top - height / 2
    axes.set(xlim=(x - half[0], x + half[0]), ylim=(y - half[1], y + half[1]), aspect="equal")
    axes.axis("off")


def _numbers(shape: ElementTree.Element, *names: str) -> list[float]:
    return [float(shape.attrib[name]) for name in names]


def tree_svg(design: Design, assembly: Assembly | None = None, marked: Collection[int] = ()) -> str:
    """Return the tree as the text of an `svg` element.

    Args:
        design: the design.
        assembly: adds the rod's mount and blocked connectors.
        marked: modules whose mutual joints are highlighted.
    """
    svg = _tree(design, assembly, marked)
    if design.task.module_types:
        _add_legend(svg, kinds(design))
    return ElementTree.tostring(svg, encoding="unicode")


def _add_legend(svg: ElementTree.Element, types: list[ModuleKind]) -> None:
    """Add a row below the tree for each type of module: its colour and its name."""
    left, top, width, height = map(float, svg.attrib["viewBox"].split())
    svg.set("viewBox", f"{left:g} {top:g} {width:g} {height + 0.25 * len(types) + 0.05:g}")
    for row, kind in enumerate(types):
        middle = np.array([left + 0.15, top + height + 0.25 * row + 0.1])
        _square(svg, middle, 0.16, _tint(kind.colour), 0.012)
        name = _text(
            svg, middle + np.array([0.14, 0.0]), kind.name, min(0.15, 1.7 * (width - 0.3) / len(kind.name))
        )
        name.set("text-anchor", "start")


def _tint(colour: str) -> str:
    """Return a colour like #d55e00 mixed with as much white, on which numbers are read."""
    return "#" + "".join(f"{(int(colour[k : k + 2], 16) + 255) // 2:02x}" for k in (1, 3, 5))


def _tree(design: Design, assembly: Assembly | None = None, marked: Collection[int] = ()) -> ElementTree.Element:
    """Return a square per module with its four ports, and a line per joint with its hinge angle."""
    topology = design.topology
    cells, turns = layout(topology)
    centres = cells * np.array([1, -1])  # y points down on a page
    low, high = centres.min(axis=0) - 0.6, centres.max(axis=0) + 0.6
    width, height = high - low
    shown = {"viewBox": " ".join(f"{x:g}" for x in (*low, width, height)), "role": "img"}
    words = {
        "aria-label": f"tree of the {topology.n} modules, {topology.key}",
        "style": f"width:{90 * width:.0f}px",
    }
    svg = ElementTree.Element("svg", {"xmlns": "http://www.w3.org/2000/svg", **shown, **words})
    for (h, a, i, b), alpha in design.bolts:
        endpoints = centres[[h, i]]
        (x1, y1), (x2, y2) = endpoints
        stroke, wide = (palette.END_EFFECTOR, 0.1) if {h, i} <= {*marked} else (palette.CONNECTOR, 0.05)
        _add(svg, "line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=stroke, stroke_width=wide)
        label_offset = np.array([0.0, -0.12]) if turns is not None and y1 == y2 else np.array([0.19, 0.0])
        _text(svg, endpoints.mean(axis=0) + label_offset, f"{math.degrees(alpha):.0f}°".replace("-", "−"), 0.15)
        if turns is None:
            for near_end, far_end, port in ((h, i, a), (i, h, b)):
                point = centres[near_end] + 0.33 * (centres[far_end] - centres[near_end])
                _text(svg, point, PORT_NAMES[port], 0.13, palette.CONNECTOR)
    colours = _port_colours(design, assembly)
    fills = {i: _tint(kind.colour) for kind in kinds(design) if kind.name for i in kind.nodes}
    for i, centre in enumerate(centres):
        _square(svg, centre, SIDE, fills.get(i, "#ffffff"), 0.05 if i == 0 else 0.025)
        _text(svg, centre, str(i), 0.2)
        if turns is None:
            continue
        for port in range(4):
            port_centre = centre + SIDE / 2 * _drawn_direction(port + turns[i])
            _square(svg, port_centre, 0.13, colours[i, port], 0.012)
        x, y = centre + 0.32 * SIDE * _drawn_direction(turns[i])
        _add(svg, "circle", cx=x, cy=y, r=0.03, fill=palette.THRUST_AXIS)
    return svg


def _port_colours(design: Design, assembly: Assembly | None) -> dict[tuple[int, int], str]:
    """Return the colour of every port by its use: joint, free, blocked for the rod, or the rod's mount."""
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
    return np.asarray(PORT_DIRECTIONS[port % 4, :2] * np.array([1, -1]))


def _add(svg: ElementTree.Element, name: str, **attributes: object) -> ElementTree.Element:
    texts = {key.replace("_", "-"): f"{x:g}" if isinstance(x, float) else str(x) for key, x in attributes.items()}
    return ElementTree.SubElement(svg, name, texts)


def _square(svg: ElementTree.Element, centre: Array, side: float, fill: str, edge: float) -> None:
    x, y = centre - side / 2
    _add(svg, "rect", x=x, y=y, width=side, height=side, fill=fill, stroke=palette.MODULE, stroke_width=edge)


def _text(
    svg: ElementTree.Element, point: Array, text: str, size: float, fill: str = "#000000"
) -> ElementTree.Element:
    style = {"text_anchor": "middle", "dominant_baseline": "central", "paint_order": "stroke"}
    halo = {"stroke": "#ffffff", "stroke_width": 0.04}
    added = _add(svg, "text", x=point[0], y=point[1], font_size=size, fill=fill, **style, **halo)
    added.text = text
    return added

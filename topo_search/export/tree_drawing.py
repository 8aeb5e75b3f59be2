"""Drawings of the tree of modules with ports and hinge angles, in matplotlib and as inline SVG.

The tree is unfolded flat on a square grid; if modules overlap there, it is drawn in layers. Lengths are in cells.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from topo_search.export import palette
from topo_search.model import Assembly, Design
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.model.topology import PORT_NAMES, Topology

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Rectangle

PLOT_SIDE = 0.44
SVG_SIDE = 0.46
"""Edges of a module's square."""


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
    """Draw the tree: a square per module with its four ports, a line per joint with its hinge angle."""
    topology = design.topology
    centres, turns = layout(topology)
    flat = turns is not None
    low, high = centres.min(axis=0), centres.max(axis=0)
    half = np.maximum(high - low + 1, 2.5) / 2
    size = float(np.clip(34 / half.max() / 2, 4, 8))  # of the text [pt]; squares shrink as the grid grows
    for (h, i, a, b), alpha in zip(topology.edges(), design.hinge_angles_rad, strict=True):
        axes.plot(*centres[[h, i]].T, color=palette.CONNECTOR, linewidth=size / 4, zorder=1)
        if size < 5:  # too small to read
            continue
        middle, angle = centres[[h, i]].mean(axis=0), f"{math.degrees(alpha):.0f}°".replace("-", "−")
        if flat and centres[h, 1] == centres[i, 1]:
            axes.text(middle[0], middle[1] + 0.06, angle, fontsize=0.85 * size, ha="center", va="bottom")
        elif flat:
            axes.text(middle[0] + 0.07, middle[1], angle, fontsize=0.85 * size, ha="left", va="center")
        else:
            _note(axes, middle, angle, 0.85 * size)
            for near_end, far_end, port in ((h, i, a), (i, h, b)):
                point = centres[near_end] + 0.33 * (centres[far_end] - centres[near_end])
                _note(axes, point, PORT_NAMES[port], 0.75 * size, color=palette.CONNECTOR)
    used = {(h, a) for h, _, a, _ in topology.edges()} | {(i, b) for _, i, _, b in topology.edges()}
    for i, centre in enumerate(centres):
        axes.add_patch(_rectangle(centre, PLOT_SIDE, "white", palette.MODULE, size / 4 if i == 0 else size / 8))
        axes.text(centre[0], centre[1], str(i), fontsize=size, ha="center", va="center", zorder=5)
        if turns is not None:
            for port in range(4):
                out = PORT_DIRECTIONS[(port + turns[i]) % 4, :2]
                colour = palette.CONNECTOR if (i, port) in used else palette.FREE_PORT
                axes.add_patch(_rectangle(centre + out * PLOT_SIDE / 2, 0.12, colour, "white", 0.5))
            mark = centre + 0.34 * PLOT_SIDE * PORT_DIRECTIONS[turns[i], :2]
            axes.plot(*mark, marker="o", color=palette.THRUST_AXIS, markersize=size / 3.5, zorder=6)
    axes.set_aspect("equal")
    x, y = (low + high) / 2
    axes.set(xlim=(x - half[0], x + half[0]), ylim=(y - half[1], y + half[1]))
    axes.axis("off")


def _rectangle(centre: Array, side: float, face: str, edge: str, width: float) -> Rectangle:
    from matplotlib.patches import Rectangle

    corner = tuple(centre - side / 2)
    return Rectangle(corner, side, side, facecolor=face, edgecolor=edge, linewidth=width, zorder=3)


def _note(axes: Axes, point: Array, text: str, size: float, color: str = "black") -> None:
    box = {"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none"}
    axes.text(point[0], point[1], text, fontsize=size, color=color, ha="center", va="center", bbox=box, zorder=2)


def tree_svg(design: Design, assembly: Assembly | None = None, marked: Collection[int] = ()) -> str:
    """Return the tree as the text of an `svg` element.

    Args:
        design: the design.
        assembly: adds the rod's mount and blocked connectors.
        marked: modules whose mutual joints are highlighted.
    """
    topology = design.topology
    cells, turns = layout(topology)
    centres = cells * np.array([1, -1])  # y points down on a page
    low, high = centres.min(axis=0) - 0.6, centres.max(axis=0) + 0.6
    width, height = high - low
    svg = ElementTree.Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "viewBox": " ".join(f"{x:g}" for x in (*low, width, height)),
            "role": "img",
            "aria-label": f"tree of the {topology.n} modules, {topology.key}",
            "style": f"width:{90 * width:.0f}px",
        },
    )
    for (h, i, a, b), alpha in zip(topology.edges(), design.hinge_angles_rad, strict=True):
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
    for i, centre in enumerate(centres):
        _square(svg, centre, SVG_SIDE, "#ffffff", palette.MODULE, 0.05 if i == 0 else 0.025)
        _text(svg, centre, str(i), 0.2)
        if turns is None:
            continue
        for port in range(4):
            port_centre = centre + SVG_SIDE / 2 * _drawn_direction(port + turns[i])
            _square(svg, port_centre, 0.13, colours[i, port], palette.MODULE, 0.012)
        x, y = centre + 0.32 * SVG_SIDE * _drawn_direction(turns[i])
        _add(svg, "circle", cx=x, cy=y, r=0.03, fill=palette.THRUST_AXIS)
    return ElementTree.tostring(svg, encoding="unicode")


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


def _square(
    svg: ElementTree.Element, centre: Array, side: float, fill: str, stroke: str, stroke_width: float
) -> None:
    x, y = centre - side / 2
    _add(svg, "rect", x=x, y=y, width=side, height=side, fill=fill, stroke=stroke, stroke_width=stroke_width)


def _text(svg: ElementTree.Element, point: Array, text: str, size: float, fill: str = "#000000") -> None:
    style = {"text_anchor": "middle", "dominant_baseline": "central", "paint_order": "stroke"}
    halo = {"stroke": "#ffffff", "stroke_width": 0.04}
    _add(svg, "text", x=point[0], y=point[1], font_size=size, fill=fill, **style, **halo).text = text

"""The tree of modules with its ports, laid flat on the grid; as a layered tree where the grid would overlap."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from topo_search.export import palette
from topo_search.export.poses import PORTS
from topo_search.export.tree_layout import layout
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.topology import PORT_NAMES

SIDE = 0.44
"""Edge of a module's square, in cells."""
LEAST_READABLE = 5.0
"""Under this size of text [pt] angles and port names are left out."""


def draw_tree(axes: Axes, design: Design) -> None:
    """Draw the tree: a square per module with its four ports, a line per joint with its hinge angle."""
    topology = design.topology
    place, turns = layout(topology)
    flat = turns is not None
    low, high = place.min(axis=0), place.max(axis=0)
    half = np.maximum(high - low + 1, 2.5) / 2
    size = float(np.clip(34 / half.max() / 2, 4, 8))
    """Of the text [pt]: squares shrink with the number of cells."""
    for (h, i, a, b), alpha in zip(topology.edges(), design.hinge_angles_rad, strict=True):
        axes.plot(*place[[h, i]].T, color=palette.CONNECTOR, linewidth=size / 4, zorder=1)
        if size < LEAST_READABLE:
            continue
        middle, angle = place[[h, i]].mean(axis=0), f"{math.degrees(alpha):.0f}°".replace("-", "−")
        if flat and place[h, 1] == place[i, 1]:
            axes.text(middle[0], middle[1] + 0.06, angle, fontsize=0.85 * size, ha="center", va="bottom")
        elif flat:
            axes.text(middle[0] + 0.07, middle[1], angle, fontsize=0.85 * size, ha="left", va="center")
        else:
            _note(axes, middle, angle, 0.85 * size)
            for end, other, port in ((h, i, a), (i, h, b)):
                at = place[end] + 0.33 * (place[other] - place[end])
                _note(axes, at, PORT_NAMES[port], 0.75 * size, color=palette.CONNECTOR)
    used = {(h, a) for h, _, a, _ in topology.edges()} | {(i, b) for _, i, _, b in topology.edges()}
    for i, centre in enumerate(place):
        axes.add_patch(_square(centre, SIDE, "white", palette.MODULE, size / 4 if i == 0 else size / 8))
        axes.text(centre[0], centre[1], str(i), fontsize=size, ha="center", va="center", zorder=5)
        if turns is not None:
            for port in range(4):
                out = PORTS[(port + turns[i]) % 4, :2]
                colour = palette.CONNECTOR if (i, port) in used else palette.FREE_PORT
                axes.add_patch(_square(centre + out * SIDE / 2, 0.12, colour, "white", 0.5))
            mark = centre + 0.34 * SIDE * PORTS[turns[i], :2]
            axes.plot(*mark, marker="o", color=palette.THRUST_AXIS, markersize=size / 3.5, zorder=6)
    axes.set_aspect("equal")
    x, y = (low + high) / 2
    axes.set(xlim=(x - half[0], x + half[0]), ylim=(y - half[1], y + half[1]))
    axes.axis("off")


def _square(centre: Array, side: float, face: str, edge: str, width: float) -> Rectangle:
    return Rectangle(
        tuple(centre - side / 2), side, side, facecolor=face, edgecolor=edge, linewidth=width, zorder=3
    )


def _note(axes: Axes, at: Array, text: str, size: float, color: str = "black") -> None:
    box = {"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none"}
    axes.text(at[0], at[1], text, fontsize=size, color=color, ha="center", va="center", bbox=box, zorder=2)

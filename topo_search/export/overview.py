"""The whole platform on the assembly sheet: two views with numbers, distances to check, rotors and autopilot.

Distances of a module's centre from three others, and from the tip, tell whether it is where it belongs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from topo_search.export import palette
from topo_search.export.allocation import allocation
from topo_search.export.brackets import MILLIMETRES
from topo_search.export.poses import Poses, poses
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.layout import PORT_DIRECTIONS
from topo_search.model.tables import paragraph, table

REFERENCES = 3
"""Number of modules from which distances are given."""


def overview(design: Design) -> Iterator[str]:
    """Yield the lines of the section."""
    at = poses(design)
    views = [_view(design, at, *axes) for axes in ((0, 1, "from above"), (0, 2, "from the side"))]
    yield f'<section class="convention">{"".join(views)}</section>'
    yield paragraph(
        "Numbers are those of the modules, E is the tip, + the centre of mass; in the axes of the task x is to the "
        "right and y (from above) or z (from the side) up. Distances between centres, to check with a rule:"
    )
    yield table(*_distances(at))
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


def _distances(at: Poses) -> tuple[list[str], list[list[str]]]:
    """Return the head and the rows of the table of distances."""
    near = at.p[:REFERENCES]
    head = ["module", *(f"to module {k} [mm]" for k in range(len(near))), "to the tip [mm]"]
    rows = [
        [str(i), *_millimetres(np.linalg.norm(np.vstack([near, at.end_effector]) - p, axis=1))]
        for i, p in enumerate(at.p)
    ]
    return head, rows


def _autopilot(at: Poses) -> str:
    """Say where the autopilot goes, in the axes of module 0, which can be seen."""
    x, _, z = (_direction(axis) for axis in at.R[0])
    com = ", ".join(_millimetres(at.R[0].T @ at.p_com))
    return (
        f"Autopilot: the centre of mass is at [{com}] mm from the centre of module 0, in the axes of that module "
        f"(x towards port 0, y towards port 1, z up). Mount the autopilot there, its arrow along {x} and its "
        f"upper side along {z} in these axes: that is x and z of the task. If it sits elsewhere set "
        "EKF2_IMU_POS_*, if it is turned SENS_BOARD_ROT."
    )


def _view(design: Design, at: Poses, across: int, up: int, words: str) -> str:
    """Return the platform projected on two axes of the task."""
    module = design.task.module
    ports = at.p[:, None] + module.connector_distance * np.einsum("nij,kj->nki", at.R, PORT_DIRECTIONS)
    rotors = at.rotors + at.p_com
    points = MILLIMETRES * np.vstack([ports.reshape(-1, 3), rotors.reshape(-1, 3), [at.end_effector]])
    flat = points[:, [across, up]] * [1.0, -1.0]
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = float((high - low).max())
    low = (low + high - size) / 2 - 0.1 * size
    box = f"{low[0]:.6g} {low[1]:.6g} {1.2 * size:.6g} {1.2 * size:.6g}"
    svg = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" role="img" aria-label="{words}">']

    def place(p: Array) -> tuple[float, float]:
        return float(MILLIMETRES * p[across]), float(-MILLIMETRES * p[up])

    def write(p: Array, text: str) -> str:
        x, y = place(p)
        return f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size / 18:.4g}" text-anchor="middle">{text}</text>'

    radius, width = 0.02 * size, 0.006 * size
    for i, p in enumerate(at.p):
        x, y = place(p)
        for end in ports[i]:
            u, v = place(end)
            line = f'x1="{x:.2f}" y1="{y:.2f}" x2="{u:.2f}" y2="{v:.2f}"'
            svg.append(f'<line {line} stroke="{palette.CONNECTOR}" stroke-width="{width:.4g}"/>')
        for end in rotors[i]:
            u, v = place(end)
            svg.append(f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{radius:.4g}" fill="{palette.ROTOR}"/>')
    u, v = place(at.end_effector)
    svg.append(f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{radius:.4g}" fill="{palette.END_EFFECTOR}"/>')
    svg += [write(p, str(i)) for i, p in enumerate(at.p)]
    svg += [write(at.end_effector, "E"), write(at.p_com, "+")]
    return "".join([*svg, "</svg>"])


def _millimetres(lengths: Sequence[float] | Array) -> list[str]:
    return [f"{MILLIMETRES * float(x) + 0.0:.1f}" for x in lengths]


def _direction(v: Array) -> str:
    return f"[{', '.join(f'{float(x) + 0.0:.3f}' for x in v)}]"

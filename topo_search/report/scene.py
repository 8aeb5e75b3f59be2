"""A design in interactive 3-D: each kind of part is one mesh for all modules, so that a hundred turn smoothly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from trimesh import Trimesh

from topo_search.export import palette
from topo_search.export.poses import Poses, azimuth_deg, towards_viewer
from topo_search.export.regions import cone_slant, cone_triangles, region_words, shapes
from topo_search.export.solids import airflow, cone_sphere, frame, join, pose_matrix, region_mesh, rotors
from topo_search.model import Assembly, Audit, Clearance, Design
from topo_search.model.arrays import Array
from topo_search.model.layout import PORT_DIRECTIONS
from topo_search.model.module import Module
from topo_search.model.shape import Cone
from topo_search.model.topology import PORT_NAMES
from topo_search.report.wording import clearance

NUMBERED = 30
"""Largest number of modules that carry their number in the picture; more are named where the pointer is."""
AXIS = 1.8
"""Length of a drawn thrust axis [l_arm]."""


def scene(
    design: Design, at: Poses, nearest: Clearance | None = None, assembly: Assembly | None = None
) -> go.Figure:
    """Return the figure of a design; each trace's `meta` says which `part` it is, and of which `mesh` copies.

    Args:
        design: any design.
        at: its poses.
        nearest: the clearance to mark, where its audit says; None if there is no audit.
        assembly: says which connector carries the end-effector, and which are blocked; None if there is no audit.
    """
    connectors = at.p[:, None] + design.task.module.connector_distance * np.einsum(
        "nij,aj->nai", at.R, PORT_DIRECTIONS
    )
    mount = None if assembly is None else assembly.mount
    foot = None if mount is None else connectors[mount.module, mount.port]
    figure = go.Figure([*_volumes(design, at), *_platform(design, at, connectors)])
    figure.add_traces(_free_connectors(design, connectors, assembly))
    figure.add_traces(_end_effector(design, at, foot))
    if nearest is not None and nearest.closest_m is not None:
        figure.add_traces(_closest(nearest, np.array(nearest.closest_m)))
    axis = {"showbackground": False, "gridcolor": "#dddddd", "zerolinecolor": "#bbbbbb", "showspikes": False}
    figure.update_layout(
        scene={
            "aspectmode": "data",
            "camera": {
                "center": {"x": 0.0, "y": 0.0, "z": -0.12},  # the legend covers the lower edge
                "eye": dict(
                    zip("xyz", (2.0 * towards_viewer(azimuth_deg(at))).tolist(), strict=True)
                ),  # in edges of a cube as large as what is shown
            },
            **{f"{name}axis": {**axis, "title": {"text": f"{name} [m]"}} for name in "xyz"},
        },
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        legend={"orientation": "h", "yanchor": "top", "y": 0.0, "itemsizing": "constant", "font": {"size": 12}},
    )
    return figure


def closest(audit: Audit | None) -> Clearance | None:
    """Return the least clearance of an audit; None without any."""
    return None if audit is None else min(audit.pairs, key=lambda pair: pair.analytic_m, default=None)


def meshes(module: Module, *, sides: int) -> dict[str, Trimesh]:
    """Return what every module has a copy of, in its own frame: by the name that `meta` of a trace gives.

    Args:
        module: the module.
        sides: number of sides of a circle.
    """
    l_arm, up = module.arm_length, np.array([0.0, 0.0, 1.0])
    head = cone_triangles(AXIS * l_arm * up, -up, math.radians(14), 0.4 * l_arm, sides=8)
    return {
        "airflow": airflow(module, sides=sides),
        "modules": frame(module),
        "rotors": rotors(module, sides=sides),
        "axes": triangles(head),
    }


def sides(n: int) -> int:
    """Return the number of sides of a circle: fewer than in files for other programs, fewest for many modules."""
    return 24 if n <= NUMBERED else 12


def _volumes(design: Design, at: Poses) -> list[Any]:
    """Return the airflow envelopes and the exposure regions."""
    traces = [_copies("airflow", "airflow envelopes", design, at, palette.AIRFLOW, opacity=0.22)]
    apex = at.end_effector
    found: dict[tuple[bool, str], list[Trimesh]] = {}
    for _, shape in shapes(design.task, at.p_E):
        surface = region_mesh(shape, cone_slant(design, at)).apply_translation(apex)
        found.setdefault((isinstance(shape, Cone), region_words(shape)), []).append(surface)
    for (is_cone, words), surfaces in sorted(found.items()):
        part, opacity = ("cones", 0.15) if is_cone else ("regions", 0.4)
        traces.append(drawn_mesh(words, join(surfaces), palette.EXPOSURE, part, opacity=opacity))
    return traces


def _platform(design: Design, at: Poses, connectors: Array) -> list[Any]:
    """Return the modules with their rotors, axes and joints."""
    module, topology = design.task.module, design.topology
    joints = [np.stack([at.p[h], connectors[h, a], at.p[i]]) for h, i, a, _ in topology.edges()]
    tips = at.p + AXIS * module.arm_length * at.z
    axes = list(np.stack([at.p, tips], axis=1))
    grouped = {"legendgroup": "axes"}
    traces = [
        _copies("modules", "modules", design, at, palette.MODULE, flatshading=True, lighting=MATT),
        _copies("rotors", "rotors", design, at, palette.ROTOR, flatshading=True, lighting=MATT),
        drawn_lines("rotor axes", axes, palette.THRUST_AXIS, 5, "axes", **grouped),
        _copies("axes", "rotor axes", design, at, palette.THRUST_AXIS, lighting=MATT, showlegend=False, **grouped),
    ]
    if joints:
        traces.append(drawn_lines("joints", joints, palette.CONNECTOR, 8, "joints"))
    numbers = [
        f"module {i}<br>thrust axis [{x:.3f}, {y:.3f}, {z:.3f}]" for i, (x, y, z) in enumerate(at.z.tolist())
    ]
    traces.append(
        go.Scatter3d(
            **columns(tips + 0.2 * module.arm_length * at.z),
            name="module numbers",
            mode="markers+text" if topology.n <= NUMBERED else "markers",
            marker={"size": 2, "color": palette.THRUST_AXIS},
            text=[f"<b>{i}</b>" for i in range(topology.n)],
            textposition="top center",
            textfont={"size": 14, "color": "#000000"},
            hovertext=numbers,
            hoverinfo="text",
            meta={"part": "numbers"},
        )
    )
    return traces


def _copies(mesh: str, name: str, design: Design, at: Poses, colour: str, **options: Any) -> Any:
    """Return every module's copy of one of the `meshes`, as one trace."""
    one = meshes(design.task.module, sides=sides(design.topology.n))[mesh]
    copies = [one.copy().apply_transform(pose_matrix(R, p)) for R, p in zip(at.R, at.p, strict=True)]
    return drawn_mesh(name, join(copies), colour, mesh, **options, meta={"part": mesh, "mesh": mesh})


def _free_connectors(design: Design, connectors: Array, assembly: Assembly | None) -> list[Any]:
    """Return the connectors without a joint; those from which no straight rod reaches the end-effector apart."""
    sheet = None if assembly is None else assembly.end_effector
    obstacles = {
        (connector.module, connector.port): ", ".join(
            f"{x.part} of module {x.module}" for x in connector.blocked_by
        )
        for connector in (() if sheet is None else sheet.connectors)
        if connector.blocked_by
    }
    traces = []
    for name, colour, blocked in (
        ("free connectors", palette.FREE_PORT, False),
        ("connectors blocked for the rod", palette.BLOCKED_PORT, True),
    ):
        places = [place for place in sorted(design.topology.free_connectors) if (place in obstacles) == blocked]
        if places:
            told = [
                f"module {i}, port {PORT_NAMES[port]}: {f'blocked by {obstacles[i, port]}' if blocked else 'free'}"
                for i, port in places
            ]
            spots = connectors[tuple(zip(*places, strict=True))]
            traces.append(drawn_points(name, spots, colour, told, "connectors"))
    return traces


def _end_effector(design: Design, at: Poses, foot: Array | None) -> list[Any]:
    """Return the centre of mass, the end-effector, the line between them, and the rod from its foot."""
    p_E = ", ".join(f"{x:.3f}" for x in at.p_E.tolist())
    traces = []
    if foot is not None:
        r = design.task.end_effector.rod_radius
        rod = cone_sphere(foot, r, at.end_effector, r, sides=12)
        traces.append(drawn_mesh("rod of the end-effector", rod, palette.END_EFFECTOR, "rod", lighting=MATT))
    line = [np.stack([at.p_com, at.end_effector])]
    traces.append(drawn_lines("p_E: end-effector from the centre of mass", line, palette.OFFSET, 8, "tip"))
    for name, point, colour, text in (
        ("centre of mass", at.p_com, palette.CENTRE_OF_MASS, ""),
        ("end-effector", at.end_effector, palette.END_EFFECTOR, f", p_E = [{p_E}] m from the centre of mass"),
    ):
        traces.append(drawn_points(name, point[None], colour, [name + text], "tip", symbol="circle", size=8))
    return traces


def _closest(pair: Clearance, ends: Array) -> list[Any]:
    """Return the mark between the two volumes that come closest."""
    spare = " beyond the least distance" if pair.kind in ("separation", "exclusion") else ""
    text = f"closest pair: {clearance(pair)}{spare}, {pair.name}"
    return [
        go.Scatter3d(
            **columns(ends),
            name=text,
            mode="lines+markers",
            line={"color": palette.CLOSEST_PAIR, "width": 6},
            marker={"color": palette.CLOSEST_PAIR, "size": 6, "symbol": "diamond"},
            hovertext=text,
            hoverinfo="text",
            meta={"part": "closest"},
        )
    ]


MATT = {"ambient": 0.65, "diffuse": 0.6, "specular": 0.05, "roughness": 0.9}


def triangles(corners: Array) -> Trimesh:
    """Return triangles, (t, 3, 3), as a mesh."""
    return Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)


def drawn_mesh(name: str, mesh: Trimesh, colour: str, part: str, **options: Any) -> Any:
    """Return a mesh as a trace.

    Args:
        name: in the legend.
        mesh: where it is drawn.
        colour: its colour.
        part: of the picture.
        options: of the trace.
    """
    vertices, (i, j, k) = mesh.vertices, mesh.faces.astype(np.int32).T
    lighting = {"ambient": 0.8, "diffuse": 0.4, "specular": 0.0, "roughness": 1.0}
    given = {"lighting": lighting, "hoverinfo": "skip", "showlegend": True, "meta": {"part": part}, **options}
    return go.Mesh3d(**columns(vertices), i=i, j=j, k=k, name=name, color=colour, **given)


def drawn_lines(name: str, lines: Sequence[Array], colour: str, width: float, part: str, **options: Any) -> Any:
    """Return lines, (points, 3) each, as one trace, with a gap after each; see `drawn_mesh`."""
    broken = np.concatenate([np.concatenate([line, np.full((1, 3), np.nan)]) for line in lines])
    given = {"hoverinfo": "skip", "meta": {"part": part}, **options}
    look = {"color": colour, "width": width}
    return go.Scatter3d(**columns(broken), name=name, mode="lines", line=look, **given)


def drawn_points(
    name: str,
    points: Array,
    colour: str,
    texts: Sequence[str],
    part: str,
    *,
    symbol: str = "square",
    size: float = 4,
) -> Any:
    """Return points, (points, 3), as a trace with a text each; see `drawn_mesh`."""
    look = {"color": colour, "size": size, "symbol": symbol, "line": {"color": "#000000", "width": 1}}
    told = {"hovertext": texts, "hoverinfo": "text", "meta": {"part": part}}
    return go.Scatter3d(**columns(points), name=name, mode="markers", marker=look, **told)


def columns(points: Array) -> dict[str, Any]:
    """Return points as a trace takes them: single precision is finer than a picture shows."""
    x, y, z = points.astype(np.float32).T
    return {"x": x, "y": y, "z": z}

"""A design in interactive 3-D: each kind of part is one mesh for all modules, so that a hundred turn smoothly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from trimesh import Trimesh

from topo_search.export import outlines, palette
from topo_search.export.meshes import cone_sphere, frame, joined, placed, rotors
from topo_search.export.poses import PORTS, Poses
from topo_search.export.regions import cone_axis, cone_slant, paths, polytope
from topo_search.export.viewpoint import azimuth_deg, towards_viewer
from topo_search.model import Assembly, Clearance, Design, Directional, Exterior
from topo_search.model.arrays import Array
from topo_search.model.topology import PORT_NAMES
from topo_search.report.closest import closest_points
from topo_search.report.wording import clearance

CLOSE = 2.0
"""Distance of the viewer, in edges of a cube as large as what is shown."""
NUMBERED = 30
"""Most modules that carry their number in the picture; more are named where the pointer is."""
AROUND = "around the platform"
"""Marks what the page leaves out to show the platform alone."""
MATT = {"ambient": 0.65, "diffuse": 0.6, "specular": 0.05, "roughness": 0.9}
GHOSTLY = {"ambient": 0.8, "diffuse": 0.4, "specular": 0.0, "roughness": 1.0}


def scene(
    design: Design, at: Poses, closest: Clearance | None = None, assembly: Assembly | None = None
) -> go.Figure:
    """Return the figure of a design.

    Args:
        design: any design.
        at: its poses.
        closest: the clearance to mark; None if there is no audit.
        assembly: says which connector carries the end-effector, and which are blocked; None if there is no audit.
    """
    connectors = at.p[:, None] + design.task.module.connector_distance * np.einsum("nij,aj->nai", at.R, PORTS)
    mount = None if assembly is None or assembly.mount is None else assembly.mount
    foot = None if mount is None else connectors[mount.module, mount.port]
    figure = go.Figure([*_volumes(design, at), *_platform(design, at, connectors)])
    figure.add_traces(_free_connectors(design, connectors, assembly))
    figure.add_traces(_end_effector(design, at, foot))
    if closest is not None:
        figure.add_traces(_closest(closest, np.stack(closest_points(design, at, closest, foot))))
    axis = {"backgroundcolor": "white", "gridcolor": "#dddddd", "zerolinecolor": "#bbbbbb", "showspikes": False}
    figure.update_layout(
        scene={
            "aspectmode": "data",
            "camera": {
                "center": {"x": 0.0, "y": 0.0, "z": -0.12},  # the legend covers the lower edge
                "eye": dict(zip("xyz", (CLOSE * towards_viewer(azimuth_deg(at))).tolist(), strict=True)),
            },
            **{f"{name}axis": {**axis, "title": {"text": f"{name} [m]"}} for name in "xyz"},
        },
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        legend={"orientation": "h", "yanchor": "top", "y": 0.0, "itemsizing": "constant", "font": {"size": 12}},
    )
    return figure


def _volumes(design: Design, at: Poses) -> list[Any]:
    """Return the airflow envelopes and the exposure regions."""
    envelope = design.task.module.envelope
    ends = at.p - envelope.length * at.z
    airflow = [
        cone_sphere(p, envelope.start_radius, end, envelope.end_radius, sides=_sides(design))
        for p, end in zip(at.p, ends, strict=True)
    ]
    traces = [_mesh("airflow envelopes", airflow, palette.AIRFLOW, opacity=0.22, meta=AROUND)]
    apex = at.end_effector
    kept_out: list[Trimesh] = []
    cones: list[Trimesh] = []
    for requirement in design.task.exposure:
        if isinstance(requirement, Exterior):
            d, theta = cone_axis(requirement, at), math.radians(requirement.half_angle_deg)
            cones.append(_triangles(outlines.cone(apex, d, theta, cone_slant(design, at))))
            continue
        r = requirement.radius
        if r is None:
            corners, triangles, *_ = polytope(requirement)
            kept_out.append(Trimesh(apex + corners, triangles))
            continue
        along = paths(requirement, at) if isinstance(requirement, Directional) else [np.zeros(3)]
        kept_out += [cone_sphere(apex, r, apex + path, r) for path in along]
    if kept_out:
        traces.append(_mesh("to be kept out of the airflow", kept_out, palette.EXPOSURE, opacity=0.4, meta=AROUND))
    if cones:
        traces.append(_mesh("cone to hold all airflow", cones, palette.EXPOSURE, opacity=0.15, meta=AROUND))
    return traces


def _platform(design: Design, at: Poses, connectors: Array) -> list[Any]:
    """Return the modules with their rotors, axes and joints."""
    module, topology = design.task.module, design.topology
    here = [placed(R, p) for R, p in zip(at.R, at.p, strict=True)]
    bodies, discs = (
        [mesh.copy().apply_transform(pose) for pose in here]
        for mesh in (frame(module), rotors(module, sides=_sides(design)))
    )
    joints = [np.stack([at.p[h], connectors[h, a], at.p[i]]) for h, i, a, _ in topology.edges()]
    tips = at.p + 1.8 * module.arm_length * at.z
    head, slim = 0.4 * module.arm_length, math.radians(14)
    heads = [_triangles(outlines.cone(tip, -z, slim, head, sides=8)) for tip, z in zip(tips, at.z, strict=True)]
    traces = [
        _mesh("modules", bodies, palette.MODULE, flatshading=True, lighting=MATT),
        _mesh("rotors", discs, palette.ROTOR, flatshading=True, lighting=MATT),
        _lines("rotor axes", list(np.stack([at.p, tips], axis=1)), palette.THRUST_AXIS, 5, legendgroup="axes"),
        _mesh("rotor axes", heads, palette.THRUST_AXIS, lighting=MATT, legendgroup="axes", showlegend=False),
    ]
    if joints:
        traces.append(_lines("joints", joints, palette.CONNECTOR, 8))
    numbers = [
        f"module {i}<br>thrust axis [{x:.3f}, {y:.3f}, {z:.3f}]" for i, (x, y, z) in enumerate(at.z.tolist())
    ]
    traces.append(
        go.Scatter3d(
            **_columns(tips + 0.2 * module.arm_length * at.z),
            name="module numbers",
            mode="markers+text" if topology.n <= NUMBERED else "markers",
            marker={"size": 2, "color": palette.THRUST_AXIS},
            text=[f"<b>{i}</b>" for i in range(topology.n)],
            textposition="top center",
            textfont={"size": 14, "color": "#000000"},
            hovertext=numbers,
            hoverinfo="text",
        )
    )
    return traces


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
            traces.append(_points(name, connectors[tuple(zip(*places, strict=True))], colour, told))
    return traces


def _end_effector(design: Design, at: Poses, foot: Array | None) -> list[Any]:
    """Return the centre of mass, the end-effector, the line between them, and the rod from its foot."""
    p_E = ", ".join(f"{x:.3f}" for x in at.p_E.tolist())
    rod = []
    if foot is not None:
        r = design.task.end_effector.rod_radius
        rod.append(
            _mesh(
                "rod of the end-effector",
                [cone_sphere(foot, r, at.end_effector, r, sides=12)],
                palette.END_EFFECTOR,
                lighting=MATT,
            )
        )
    return [
        *rod,
        _lines(
            "p_E: end-effector from the centre of mass", [np.stack([at.p_com, at.end_effector])], palette.OFFSET, 8
        ),
        _points(
            "centre of mass", at.p_com[None], palette.CENTRE_OF_MASS, ["centre of mass"], symbol="circle", size=8
        ),
        _points(
            "end-effector",
            at.end_effector[None],
            palette.END_EFFECTOR,
            [f"end-effector, p_E = [{p_E}] m from the centre of mass"],
            symbol="circle",
            size=8,
        ),
    ]


def _closest(pair: Clearance, ends: Array) -> list[Any]:
    """Return the mark between the two volumes that come closest."""
    spare = " beyond the least distance" if pair.kind in ("separation", "exclusion") else ""
    text = f"closest pair: {clearance(pair)}{spare}, {pair.name}"
    return [
        go.Scatter3d(
            **_columns(ends),
            name=text,
            mode="lines+markers",
            line={"color": palette.CLOSEST_PAIR, "width": 6},
            marker={"color": palette.CLOSEST_PAIR, "size": 6, "symbol": "diamond"},
            hovertext=text,
            hoverinfo="text",
        )
    ]


def _sides(design: Design) -> int:
    """Return the number of sides of a circle: fewer than in files for other programs, fewest for many modules."""
    return 24 if design.topology.n <= NUMBERED else 12


def _triangles(corners: Array) -> Trimesh:
    """Return triangles, (t, 3, 3), as a mesh."""
    return Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)


def _mesh(name: str, meshes: list[Trimesh], colour: str, **options: Any) -> Any:
    mesh = joined(meshes)
    vertices, (i, j, k) = mesh.vertices, mesh.faces.astype(np.int32).T
    given = {"lighting": GHOSTLY, "hoverinfo": "skip", "showlegend": True, **options}
    return go.Mesh3d(**_columns(vertices), i=i, j=j, k=k, name=name, color=colour, **given)


def _lines(name: str, lines: Sequence[Array], colour: str, width: float, **options: Any) -> Any:
    broken = np.concatenate([np.concatenate([line, np.full((1, 3), np.nan)]) for line in lines])
    look = {"color": colour, "width": width}
    return go.Scatter3d(**_columns(broken), name=name, mode="lines", line=look, hoverinfo="skip", **options)


def _points(
    name: str, points: Array, colour: str, texts: Sequence[str], *, symbol: str = "square", size: float = 4
) -> Any:
    look = {"color": colour, "size": size, "symbol": symbol, "line": {"color": "#000000", "width": 1}}
    return go.Scatter3d(
        **_columns(points), name=name, mode="markers", marker=look, hovertext=texts, hoverinfo="text"
    )


def _columns(points: Array) -> dict[str, Any]:
    """Return points as a trace takes them: single precision is finer than a picture shows."""
    x, y, z = points.astype(np.float32).T
    return {"x": x, "y": y, "z": z}

"""Traces of a picture in 3-D: meshes, lines and points, each with the part of the picture that it belongs to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from trimesh import Trimesh

from topo_search.model.arrays import Array

MATT = {"ambient": 0.65, "diffuse": 0.6, "specular": 0.05, "roughness": 0.9}
GHOSTLY = {"ambient": 0.8, "diffuse": 0.4, "specular": 0.0, "roughness": 1.0}


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
    given = {"lighting": GHOSTLY, "hoverinfo": "skip", "showlegend": True, "meta": {"part": part}, **options}
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

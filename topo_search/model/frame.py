"""A module's own frame: closed convex surfaces, from a mesh file or as a design file holds them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Self

import networkx as nx
import numpy as np
from pydantic import AfterValidator, model_validator

from topo_search.limits import FRAME_PIECES, FRAME_TRIANGLES
from topo_search.model.arrays import Array
from topo_search.model.bad_input import BadInput, Fault, of_file, to_printable
from topo_search.model.mesh_file import FARTHEST, surface
from topo_search.model.value import Index, Value, Vector, at_most, refuse

FLAT = 1e-6
"""How far a corner of a convex surface may lie beyond a face, over the surface's size: single precision."""

CLOSED = (
    "must be a closed surface, every edge once in either direction; "
    "pieces of a mesh that share a corner count as one, so let them overlap"
)


def _corners(value: tuple[int, ...]) -> tuple[int, int, int]:
    i, j, k = value
    if len({i, j, k}) < 3:
        raise ValueError("must have three different corners")
    return i, j, k


class ConvexPiece(Value):
    """A convex body by its surface: triangles that turn counter-clockwise seen from outside."""

    vertices: Annotated[tuple[Vector, ...], at_most(FRAME_TRIANGLES, "vertices")]
    """Corners, in the module's frame [m]."""
    triangles: Annotated[
        tuple[Annotated[tuple[Index, Index, Index], AfterValidator(_corners)], ...],
        at_most(FRAME_TRIANGLES, "triangles"),
    ]
    """Numbers of their corners."""

    @model_validator(mode="after")
    def _closed_and_convex(self) -> Self:
        faces = np.array(self.triangles, dtype=np.int64).reshape(-1, 3)
        if not len(faces) or set(faces.ravel().tolist()) != set(range(len(self.vertices))):
            refuse("ConvexPiece", (("triangles",), "must use every vertex, and no other"))
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()
        there = {(i, j) for i, j in edges}
        if len(there) < len(edges) or there != {(j, i) for i, j in there}:
            refuse("ConvexPiece", (("triangles",), CLOSED))
        if np.abs(self.vertices).max() > FARTHEST:
            refuse("ConvexPiece", (("vertices",), f"must be at most {FARTHEST:g} m away"))
        sticks_out = _beyond_faces(np.array(self.vertices), faces)
        if sticks_out > FLAT:
            text = f"must be convex, but a corner lies {100 * sticks_out:.3g} % of its size beyond a face"
            refuse("ConvexPiece", (("triangles",), text))
        return self


def _beyond_faces(vertices: Array, faces: Any) -> float:
    """Return how far the farthest corner lies beyond a face, over the size.

    It is 1 of a surface that is inside out, and of one of slivers alone.
    """
    corners = vertices[faces]
    size = float(np.ptp(vertices, axis=0).max())
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    if float(np.einsum("fx,fx->", normals, corners[:, 0] - vertices.mean(axis=0))) <= 1e-12 * size**3:
        return 1.0
    told = area > 1e-9 * size * size  # of slivers the direction is lost
    if not np.any(told):
        return 1.0
    unit = normals[told] / area[told, None]
    beyond = vertices @ unit.T - np.einsum("fx,fx->f", unit, corners[told, 0])
    return float(beyond.max()) / size


def read_frame(data: dict[str, Any], folder: Path, source: str) -> None:
    """Put the pieces of the file that a task's `module.body.mesh` names in its place, as `module.body.frame`.

    Args:
        data: the task as its file holds it; changed.
        folder: where the mesh is looked for.
        source: the task's file, for messages.

    Raises:
        BadInput: the mesh cannot be used.
    """
    module = data.get("module")
    body = module.get("body") if isinstance(module, dict) else None
    if not isinstance(body, dict) or "mesh" not in body:
        return
    name = body.pop("mesh")

    def refusal(rule: str) -> BadInput:
        return BadInput(source, [Fault("module.body.mesh", of_file(rule, name))])

    if not isinstance(name, str):
        raise refusal("must be the name of an .stl or .obj file")
    if "frame" in body:
        raise refusal("must be left out where `frame` is given")
    try:
        body["frame"] = pieces(*surface(folder / name))
    except FileNotFoundError:
        raise refusal(f"must be a file in {to_printable(folder.absolute())}") from None
    except OSError as error:
        raise refusal(f"must be a file that can be read ({error.strerror})") from None
    except ValueError as error:
        raise refusal(str(error)) from None


def pieces(vertices: Array, faces: Any) -> list[dict[str, Any]]:
    """Return the connected parts of a surface, corners at one place being one corner, flat triangles left out.

    Args:
        vertices: corners, shape (v, 3).
        faces: triangles, shape (f, 3).

    Raises:
        ValueError: there are too many.
    """
    unique, number = np.unique(vertices, axis=0, return_inverse=True)
    faces = number.reshape(-1)[faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    if len(faces) > FRAME_TRIANGLES:
        raise ValueError(f"must have at most {FRAME_TRIANGLES:,} triangles, but has {len(faces):,}")
    graph: nx.Graph[int] = nx.Graph()
    graph.add_edges_from(faces[:, :2].tolist())
    graph.add_edges_from(faces[:, 1:].tolist())
    found = []
    parts = sorted(nx.connected_components(graph), key=min)
    if len(parts) > FRAME_PIECES:
        raise ValueError(f"must have at most {FRAME_PIECES} pieces, but has {len(parts):,}")
    for connected in parts:
        own = faces[np.isin(faces[:, 0], list(connected))]
        used, compact = np.unique(own, return_inverse=True)
        found.append({"vertices": unique[used].tolist(), "triangles": compact.reshape(-1, 3).tolist()})
    return found

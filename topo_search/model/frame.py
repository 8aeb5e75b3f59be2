"""A module's own frame: closed convex surfaces, from a mesh file or as a design file holds them."""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, model_validator

from topo_search.limits import FRAME_PIECES, FRAME_TRIANGLES
from topo_search.model.arrays import Array
from topo_search.model.mesh_file import FARTHEST, Surface, parts_of
from topo_search.model.value import Index, Value, Vector, at_most, refuse

FLAT = 1e-6
"""How far a corner of a convex surface may lie beyond a face, over the surface's size: single precision."""

CLOSED = (
    "must be a closed surface, every edge once in either direction; "
    "pieces of a mesh that share an edge count as one, so let them overlap"
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


def frame_of(mesh: Surface) -> list[dict[str, Any]]:
    """Return the convex pieces that a mesh consists of, as data of `ConvexPiece`.

    Raises:
        ValueError: there are too many.
    """
    if len(mesh.triangles) > FRAME_TRIANGLES:
        raise ValueError(f"must have at most {FRAME_TRIANGLES:,} triangles, but has {len(mesh.triangles):,}")
    parts = parts_of(mesh)
    if len(parts) > FRAME_PIECES:
        raise ValueError(f"must have at most {FRAME_PIECES} pieces, but has {len(parts):,}")
    return [{"vertices": part.vertices.tolist(), "triangles": part.triangles.tolist()} for part in parts]

"""STL and OBJ files: the surface that one holds, and the corners of its convex hull."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.hulls import convex_hull, has_volume

LARGEST = 64_000_000
"""Larger files are refused [bytes]."""


def surface(path: Path) -> tuple[Array, Any]:
    """Return the corners, shape (v, 3), and the triangles, shape (f, 3), of a mesh file.

    Raises:
        ValueError: says why the file has no surface.
        OSError: it cannot be read.
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in ("stl", "obj"):
        raise ValueError("must be an .stl or .obj file")
    if path.stat().st_size > LARGEST:
        raise ValueError(f"must be a file of at most {LARGEST:,} bytes")
    import trimesh  # only tasks with a mesh need it

    try:
        mesh = trimesh.load_mesh(path, file_type=form, process=False)
        vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)
    except (ValueError, IndexError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"must be a mesh ({error})") from None
    if not len(faces) or not np.all(np.abs(vertices) <= 1e15):  # NaN is none of them either
        raise ValueError("must be the mesh of a body with a volume")
    return vertices, faces


def hull_corners(path: Path) -> Array:
    """Return the corners of the convex hull of a mesh file's shape, shape (k, 3), sorted.

    Raises:
        ValueError: says why the file has no such hull.
        OSError: it cannot be read.
    """
    points = np.unique(surface(path)[0], axis=0)
    if not has_volume(points):
        raise ValueError("must be the mesh of a body with a volume")
    return convex_hull(points).corners

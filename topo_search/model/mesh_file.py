"""The corners of a shape in an STL or OBJ file: all that a convex region needs of it."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.hulls import convex_hull, has_volume

LARGEST = 64_000_000
"""Larger files are refused [bytes]."""
STL_HEADER, STL_TRIANGLE = 84, 50
"""Sizes in a binary STL [bytes]: its header with the count of triangles, and one triangle."""
NUMBER = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
POINT = rb"[ \t]+(" + NUMBER + rb")[ \t]+(" + NUMBER + rb")[ \t]+(" + NUMBER + rb")(?=\s|$)"


def hull_corners(path: Path) -> Array:
    """Return the corners of the convex hull of a mesh file's shape, shape (k, 3), sorted.

    Raises:
        ValueError: says why the file has no such hull.
        OSError: it cannot be read.
    """
    points = np.unique(_points(path), axis=0)
    if not np.all(np.abs(points) <= 1e15) or not has_volume(points):
        raise ValueError("must be the mesh of a body with a volume")
    return convex_hull(points).corners


def _points(path: Path) -> Array:
    """Return the vertices that a file lists, shape (m, 3)."""
    suffix = path.suffix.lower()
    if suffix not in (".stl", ".obj"):
        raise ValueError("must be an .stl or .obj file")
    if path.stat().st_size > LARGEST:
        raise ValueError(f"must be a file of at most {LARGEST:,} bytes")
    data = path.read_bytes()
    if suffix == ".stl" and len(data) >= STL_HEADER:
        count = struct.unpack_from("<I", data, STL_HEADER - 4)[0]
        if len(data) == STL_HEADER + STL_TRIANGLE * count:
            triangles = np.frombuffer(data, np.uint8, offset=STL_HEADER).reshape(count, STL_TRIANGLE)
            return triangles[:, 12:48].copy().view("<f4").reshape(-1, 3).astype(float)
    word = rb"^[ \t]*vertex" if suffix == ".stl" else rb"^[ \t]*v"
    found = re.findall(word + POINT, data, re.MULTILINE)
    if not found:
        raise ValueError("must have vertices, as STL and OBJ files list them")
    return np.array(found, dtype=np.bytes_).astype(float)

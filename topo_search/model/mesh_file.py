"""STL and OBJ files: the surface that one holds, and the corners of its convex hull.

A mesh is vertices and facets. Everything else that these formats know (normals, colours, textures, materials,
groups, lines, and the other files that an OBJ may name) is passed over, and no other file is opened. Free-form
surfaces are refused: what they bound is not among the facets.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topo_search.limits import CORNERS, FACETS, MESH_BYTES
from topo_search.model.arrays import Array
from topo_search.model.bad_input import show
from topo_search.model.hulls import convex_hull, has_volume
from topo_search.model.regular_file import read_regular

Triangles = NDArray[np.intp]

FARTHEST = 1e15
"""Largest coordinate, without sign [m]."""
LINES = 10 * FACETS
"""Of an OBJ: as many vertices, texture coordinates and normals as there may be, and all facets."""
LINE = 10_000
"""Bytes of a line, with those that continue it."""
HEADER, FACET = 84, 50
"""Bytes of a binary STL before its facets, and of each."""
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A facet of a binary STL."""
ASCII_FACET = b"facet normal x y z outer loop vertex x y z vertex x y z vertex x y z endloop endfacet".split()
"""The words of a facet in an ASCII STL; x, y and z stand for numbers."""
NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?")
REFERENCE = re.compile(rb"([+-]?\d{1,9})(?:/[+-]?\d{1,9}|/[+-]?\d{0,9}/[+-]?\d{1,9})?")
"""A corner of an OBJ's facet: its vertex, perhaps with a texture coordinate and a normal."""
PASSED_OVER = frozenset(
    b"vt vn vp o g s mg l p usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj trace_obj".split()
)
"""What an OBJ may say beside vertices and facets."""


def surface(path: Path) -> tuple[Array, Triangles]:
    """Return the corners, shape (v, 3), and the triangles, shape (f, 3), of a mesh file.

    Polygons are cut into triangles from their first corner. Every corner belongs to a triangle.

    Raises:
        ValueError: says why the file has no surface.
        OSError: it cannot be read.
    """
    form = path.suffix.lower()
    if form not in (".stl", ".obj"):
        raise ValueError("must be an .stl or .obj file")
    content = read_regular(path, most_bytes=MESH_BYTES)
    vertices, triangles = _obj(content) if form == ".obj" else _stl(content)
    used, compact = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], compact.reshape(-1, 3)
    if not len(triangles) or not np.all(np.abs(vertices) <= FARTHEST):  # NaN is none of them either
        raise ValueError("must be the mesh of a body with a volume")
    return vertices, triangles


def hull_corners(path: Path) -> Array:
    """Return the corners of the convex hull of a mesh file's shape, shape (k, 3), sorted.

    Raises:
        ValueError: says why the file has no such hull.
        OSError: it cannot be read.
    """
    points = np.unique(surface(path)[0], axis=0)
    if not has_volume(points):
        raise ValueError("must be the mesh of a body with a volume")
    return convex_hull(points, most_corners=CORNERS).corners


def _stl(content: bytes) -> tuple[Array, Triangles]:
    """Read an STL: a binary one has exactly the length that its header states, whatever its first word."""
    stated = int.from_bytes(content[80:HEADER], "little") if len(content) >= HEADER else -1
    if len(content) == HEADER + FACET * stated:
        _few_facets(stated)
        corners = np.frombuffer(content, RECORD, offset=HEADER)["corners"].astype(float).reshape(-1, 3)
    elif re.match(rb"(?i)\s*solid\b", content):
        corners = _ascii_corners(content)
    else:
        facets = "too few bytes for a header" if stated < 0 else f"{len(content):,} bytes for {stated:,} facets"
        raise ValueError(f"must be a whole STL file: {HEADER} bytes and {FACET} per facet; this one has {facets}")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _ascii_corners(content: bytes) -> Array:
    """Return the corners of an ASCII STL's facets in order, shape (3 f, 3)."""
    _few_facets(content.count(b"endfacet") + content.count(b"ENDFACET"))
    body = re.sub(rb"(?im)^[ \t]*(?:end)?solid\b.*$", b"", content.replace(b"\r", b"\n"))
    words = body.split()
    size = len(ASCII_FACET)
    if len(words) % size:
        raise ValueError(f"must be a whole ASCII STL, {size} words per facet, but has {len(words):,} words")
    for place, due in enumerate(ASCII_FACET):
        if due not in (b"x", b"y", b"z"):
            facet = next((f for f, word in enumerate(words[place::size]) if word.lower() != due), None)
            if facet is not None:
                given = show(_word(words[place + size * facet]))
                raise ValueError(f"must be an ASCII STL, but facet {facet} has {given} for `{due.decode()}`")
    places = [place for place, due in enumerate(ASCII_FACET) if due in (b"x", b"y", b"z")][3:]
    columns = [[_number(word) for word in words[place::size]] for place in places]
    return np.array(columns).T.reshape(-1, 3)


def _obj(content: bytes) -> tuple[Array, Triangles]:
    """Read an OBJ."""
    vertices: list[tuple[float, float, float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(_lines(content), start=1):
        word, *rest = line.split() or [b""]
        try:
            if word == b"v":
                vertices.append(_vertex(rest))
                _few_facets(len(vertices) / 3)
            elif word == b"f":
                first, *others = _corners(rest, len(vertices))
                triangles += [(first, i, j) for i, j in pairwise(others)]
                _few_facets(len(triangles))
            elif word and word not in PASSED_OVER:
                raise ValueError(f"must be an OBJ of vertices and facets, but has {show(_word(word))}")
        except ValueError as error:
            raise ValueError(f"{error} (line {number})") from None
    return np.array(vertices).reshape(-1, 3), np.array(triangles, dtype=np.intp).reshape(-1, 3)


def _lines(content: bytes) -> Iterator[bytes]:
    """Yield the lines without comments; of those that a backslash continues the last, with all of them."""
    if content.count(b"\n") + content.count(b"\r") > LINES:
        raise ValueError(f"must have at most {LINES:,} lines, but has more")
    begun = b""
    for line in content.splitlines():
        said = begun + line.split(b"#", 1)[0]
        if len(said) > LINE:
            raise ValueError(f"must have at most {LINE:,} bytes per line, but has {len(said):,}")
        begun = said[:-1] + b" " if said.endswith(b"\\") else b""
        yield b"" if begun else said
    yield begun


def _vertex(words: list[bytes]) -> tuple[float, float, float]:
    if not 3 <= len(words) <= 8:  # with a weight, a colour, or both
        raise ValueError(f"must have three numbers per vertex, but got {len(words)}")
    x, y, z, *_ = map(_number, words)
    return x, y, z


def _corners(words: list[bytes], vertices: int) -> list[int]:
    """Return the numbers of a facet's vertices, from 0; the file counts from 1, or back from the last one."""
    if len(words) < 3:
        raise ValueError(f"must have at least three corners per facet, but got {len(words)}")
    found = []
    for word in words:
        match = REFERENCE.fullmatch(word)
        if match is None:
            raise ValueError(f"must have the number of a vertex for a corner, but got {show(_word(word))}")
        given = int(match[1])
        corner = given + vertices if given < 0 else given - 1
        if given == 0 or not 0 <= corner < vertices:
            raise ValueError(f"must have the number of a vertex before it, 1 to {vertices}, but got {given}")
        found.append(corner)
    return found


def _number(word: bytes) -> float:
    if len(word) > 64 or NUMBER.fullmatch(word) is None:
        raise ValueError(f"must have numbers for coordinates, but got {show(_word(word))}")
    return float(word)


def _word(word: bytes) -> str:
    """Return a word of a file to be shown."""
    return word[:100].decode("utf-8", "replace")


def _few_facets(facets: float) -> None:
    if facets > FACETS:
        raise ValueError(f"must have at most {FACETS:,} facets and {3 * FACETS:,} vertices, but has more")

"""STL and OBJ files that a task names: their surface, convex pieces that contain it, and a module's own frame.

trimesh reads both formats. It passes over much that it does not understand, and counts backwards from the end of an
OBJ instead of from the line; so the text is checked and brought into the form that trimesh reads in full. Only
vertices and facets are read, no materials, and no other file is opened. Free-form surfaces are refused: what they
bound is not among the facets.
"""

from __future__ import annotations

import io
import math
import re
from codecs import BOM_UTF8
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Never

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator

from topo_search.limits import LIMITS
from topo_search.model.arrays import Array
from topo_search.model.shape import has_volume, outer_hull
from topo_search.model.text import read_regular
from topo_search.model.value import (
    Broken,
    Index,
    Positive,
    Value,
    Vector,
    at_most,
    of_file,
    refuse,
    show,
    to_printable,
)

Triangles = NDArray[np.intp]

LARGEST_COORDINATE = 1e15
"""Largest coordinate, without sign [m]."""
HEADER, FACET = 84, 50
"""Bytes of a binary STL before its facets, and of each facet."""
NUMBER = rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?"
NO_VOLUME = "must be the mesh of a body with a volume"


@dataclass(frozen=True)
class Folder:
    """The context of validation that lets a task name files: the folder where they are looked for."""

    path: Path


class MeshFile(Value):
    """Entry of a mesh in a task file; `scale` is applied first, then `offset`."""

    mesh: str
    """In a task file: an STL or OBJ file beside it."""
    scale: Positive = 1.0
    """In a task file, with `mesh`: metres per unit of the mesh, 0.001 for millimetres."""
    offset: Vector = (0.0, 0.0, 0.0)
    """In a task file, with `mesh`: where the origin of the mesh is [m]."""


class Surface(NamedTuple):
    """The surface of a mesh."""

    vertices: Array
    """Shape (v, 3); every one is a corner of a triangle."""
    triangles: Triangles
    """Numbers of their corners, shape (f, 3)."""
    closed: bool = False
    """True if every edge has an even number of triangles, so that the surface encloses a volume."""


def mesh_schema(schema: dict[str, Any]) -> None:
    """Add the fields of a mesh to the JSON schema of a table that may name one."""
    schema["properties"] |= MeshFile.model_json_schema()["properties"]


def take_mesh(data: dict[str, Any], replaces: str, context: Any) -> Surface | None:
    """Return the mesh that a table of a task file names, if it does; its fields are removed from the data.

    Args:
        data: the table; changed.
        replaces: the field that the mesh stands for.
        context: the `Folder` where files are looked for; anything else: no file may be named.

    Raises:
        ValidationError: a field is wrong, or the file has no surface.
    """
    fields = {name: data.pop(name) for name in MeshFile.model_fields if data.get(name) is not None}
    if "mesh" not in fields:
        refuse(*((name, "must be left out where there is no `mesh`") for name in fields))
        return None
    name = fields["mesh"]

    def refuse_mesh(text: str) -> Never:
        refuse(("mesh", of_file(text, name)))
        raise AssertionError

    if not isinstance(context, Folder):
        refuse_mesh(f"must be given by its `{replaces}` outside a task file")
    if not isinstance(name, str):
        refuse_mesh("must be the name of an STL or OBJ file")
    file = MeshFile.model_validate(fields)
    path = context.path / name
    try:
        return surface(path, file.scale, file.offset)
    except OSError as error:
        refuse_mesh(f"must be a file that can be read ({to_printable(path)}: {error.strerror})")
    except ValueError as error:
        refuse_mesh(str(error))


def surface(path: Path, scale: float = 1.0, offset: Vector = (0.0, 0.0, 0.0)) -> Surface:
    """Return the surface of a mesh file, polygons cut into triangles from their first corner.

    Args:
        path: the file, .stl or .obj.
        scale: metres per unit of the file.
        offset: where the origin of the file is [m].

    Raises:
        ValueError: says why the file has no surface.
        OSError: it cannot be read.
    """
    form = path.suffix.lower()
    if form not in (".stl", ".obj"):
        raise ValueError("must be an .stl or .obj file")
    content = read_regular(path, most_bytes=LIMITS.mesh_bytes).removeprefix(BOM_UTF8)
    content, facets = _obj(content) if form == ".obj" else _stl(content)
    if facets > LIMITS.facets:
        raise ValueError(f"must have at most {LIMITS.facets:,} facets, but has {facets:,}")
    if not facets:
        raise ValueError(NO_VOLUME)
    import trimesh  # slow to import, and few tasks need it

    mesh = trimesh.load_mesh(io.BytesIO(content), file_type=form[1:], process=False)
    if len(mesh.faces) != facets:
        rule = f"must have three corners per facet: {facets:,} facets"
        raise ValueError(f"{rule}, but has {len(mesh.faces):,} triangles")
    result = _compact(mesh.vertices * scale + np.array(offset), np.asarray(mesh.faces, dtype=np.intp))
    if not np.all(np.abs(result.vertices) <= LARGEST_COORDINATE):  # NaN is none of them either
        raise ValueError(NO_VOLUME)
    return result


def parts_of(mesh: Surface) -> list[Surface]:
    """Return the closed parts of a surface, which share no edge, in the file's order, then the open ones as one.

    Edges are those of the file's own corners if all parts are then closed, else those of corners by position.
    Triangles that are lines are left out.
    """
    unique, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    parts = _parts(mesh.vertices, mesh.triangles)
    return parts if parts and parts[-1].closed else _parts(unique, number.reshape(-1)[mesh.triangles])


def convex_pieces(mesh: Surface) -> tuple[list[Array], list[float]]:
    """Return convex pieces that contain all that a surface encloses, and how far each reaches beyond the surface.

    Every closed part becomes a piece, and all open parts together become one. Where one of these has no volume, the
    whole mesh is one piece. A piece is the hull of its part, or something larger if that has too many corners; one
    inside another is left out.

    Returns:
        The corners of each piece, shape (k, 3), sorted, and a bound on its excess over its part [m].

    Raises:
        ValueError: the surface has no volume, or too many parts.
    """
    parts = parts_of(mesh)
    bodies = [part for part in parts if has_volume(part.vertices)]
    if len(bodies) < len(parts):
        bodies = [Surface(*mesh[:2])]
    if not has_volume(bodies[0].vertices):
        raise ValueError(NO_VOLUME)
    if len(bodies) > LIMITS.pieces:
        raise ValueError(f"must have at most {LIMITS.pieces} bodies, but has {len(bodies):,}")
    bodies = _without_inner(bodies)
    outer = [outer_hull(body.vertices, min(LIMITS.corners, LIMITS.all_corners // len(bodies))) for body in bodies]
    excess = [beyond + _concavity(body) for body, (_, beyond) in zip(bodies, outer, strict=True)]
    return [corners for corners, _ in outer], excess


def _compact(vertices: Array, triangles: Triangles) -> Surface:
    used, compact = np.unique(triangles, return_inverse=True)
    return Surface(vertices[used], compact.reshape(-1, 3))


def _parts(vertices: Array, triangles: Triangles) -> list[Surface]:
    """Return the closed parts by the numbers of corners, and last all open ones as one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    i, j, k = triangles.T
    triangles = triangles[(i != j) & (j != k) & (k != i)]
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    _, edge, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    edge, face = edge.reshape(-1), np.repeat(np.arange(len(triangles)), 3)
    nodes = len(triangles) + len(count)
    graph = coo_array((np.ones(len(edge)), (face, len(triangles) + edge)), shape=(nodes, nodes))
    number, part = connected_components(graph, directed=False)
    part = part[: len(triangles)]
    is_open = np.bincount(part[face], weights=count[edge] % 2, minlength=number) > 0
    part = np.where(is_open[part], number, part)
    _, first = np.unique(np.sort(part), return_index=True)
    faces = np.split(triangles[np.argsort(part, kind="stable")], first[1:])
    whole = [*[True] * (len(faces) - 1), not is_open.any()]
    return [_compact(vertices, shell)._replace(closed=closed) for shell, closed in zip(faces, whole, strict=True)]


def _without_inner(bodies: list[Surface]) -> list[Surface]:
    """Return the bodies whose hulls are in no other's hull; of equal ones the first."""
    hulls = [_hull(body) for body in bodies]

    def is_inside(one: int, other: int) -> bool:
        normals, offsets = hulls[other].equations[:, :3], hulls[other].equations[:, 3]
        heights = hulls[one].points[hulls[one].vertices] @ normals.T + offsets
        return bool(heights.max() <= 1e-12 * np.ptp(hulls[other].points, axis=0).max())  # up to rounding

    def is_inner(one: int) -> bool:
        others = (other for other in range(len(bodies)) if other != one and is_inside(one, other))
        return any(other < one or not is_inside(other, one) for other in others)

    return [body for one, body in enumerate(bodies) if not is_inner(one)]


def _hull(body: Surface) -> Any:
    from scipy.spatial import ConvexHull  # slow to import, and few tasks need it

    return ConvexHull(body.vertices)


def _concavity(body: Surface) -> float:
    """Return a bound on the distance of the surface of a body's hull from the body [m]; 0 of a convex body.

    Both surfaces are sampled; no point of the hull's is farther than h / sqrt(3) from a sample, h its longest edge.
    """
    import trimesh
    from scipy.spatial import cKDTree

    mesh, hull = trimesh.Trimesh(*body[:2], process=False), _hull(body)
    if body.closed:
        trimesh.repair.fix_winding(mesh)
        if hull.volume <= abs(mesh.volume) * (1 + 1e-5):  # convex up to single precision, with room
            return 0.0
    samples, _ = _sample(*body[:2])
    of_hull, h = _sample(body.vertices, hull.simplices)
    return float(cKDTree(samples).query(of_hull)[0].max()) + h / math.sqrt(3)


def _sample(vertices: Array, triangles: Triangles) -> tuple[Array, float]:
    """Return about 200,000 points of a surface, and how long the edges between them are at most."""
    from trimesh.remesh import subdivide_to_size

    sides = vertices[triangles] - vertices[np.roll(triangles, 1, axis=1)]
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    h = max(float(longest.max()) / 100, math.sqrt(float(np.sum(longest**2)) / 200_000))
    points, _ = subdivide_to_size(vertices, triangles, max_edge=h)
    return np.asarray(points), h


def _stl(content: bytes) -> tuple[bytes, int]:
    """Return an STL without what trimesh would stumble over, and how many facets it has.

    A binary one is as long as its header says or longer, whatever its first word: bytes behind its facets are cut.
    """
    facets = int.from_bytes(content[80:HEADER], "little") if len(content) >= HEADER else -1
    if facets >= 0 and HEADER + FACET * facets <= len(content):
        if _is_facet(content[HEADER + FACET * facets :][:FACET]):
            raise ValueError(f"must have as many facets as its header says, {facets:,}, but has more")
        return content[: HEADER + FACET * facets], facets
    if not re.match(rb"(?i)\s*solid\b", content):
        given = "too few bytes for a header" if facets < 0 else f"{len(content):,} bytes for {facets:,} facets"
        raise ValueError(f"must be a whole STL file: {HEADER} bytes and {FACET} per facet; this one has {given}")
    body = re.sub(rb"(?im)^[ \t]*(?:end)?solid\b.*$", b"", content.replace(b"\r", b"\n"))
    # trimesh reads a vertex to the end of its line
    body = re.sub(rb"(?i)\s+(facet|vertex|endloop|endfacet)\b", rb"\n\1", body)
    words = (b"facet", b"endfacet", b"vertex")
    facets, ended, vertices = (len(re.findall(rb"(?im)^%b\b" % word, body)) for word in words)
    not_a_vertex = rb"(?im)^vertex(?!(?:[ \t]+%b){3}[ \t]*$).*" % NUMBER  # a line that begins like one
    if ended <= LIMITS.facets and (wrong := re.search(not_a_vertex, body)):
        raise ValueError(f"must have three numbers per vertex, but got {show(_text(wrong[0]))}")
    if ended <= LIMITS.facets and not vertices == 3 * facets == 3 * ended:
        counts = f"{facets:,} `facet`, {vertices:,} `vertex` and {ended:,} `endfacet`"
        raise ValueError(f"must be a whole ASCII STL, with three vertices per facet, but has {counts}")
    # without normals, which trimesh complains about where they are no numbers
    return b"\n".join([b"solid", *re.findall(rb"(?im)^vertex.*$", body), b"endsolid\n"]), ended


def _is_facet(behind: bytes) -> bool:
    """True if bytes are a facet of a binary STL: a unit normal, or none, and three different corners."""
    if len(behind) < FACET or any(behind[48:]):
        return False
    normal, *corners = np.frombuffer(behind[:48], "<f4").reshape(4, 3).astype(float)
    if not np.all(np.isfinite([normal, *corners])) or np.abs(corners).max() > LARGEST_COORDINATE:
        return False
    length = np.linalg.norm(normal)
    return bool((length == 0 or abs(length - 1) < 0.01) and np.ptp(corners, axis=0).any())


def _obj(content: bytes) -> tuple[bytes, int]:
    """Return an OBJ of vertices and facets alone, its corners counted from 1, and how many triangles it has."""
    passed_over = frozenset(
        b"vt vn vp o g s mg l p end usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj "
        b"trace_obj".split()
    )
    lines, statements = list[bytes](), passed_over | {b"v", b"f"}
    vertices = facets = 0
    for number, line in enumerate(_lines(content.rstrip(b"\0\x1a\r\n")), start=1):
        word, *rest = line.split() or [b""]
        try:
            if word == b"v":
                if len(rest) < 3:
                    raise ValueError(f"must have three numbers per vertex, but got {len(rest)}")
                if merged := statements.intersection(rest[3:]):  # weights, colours and normals are numbers
                    raise ValueError(f"must have a line per vertex and facet, but got {show(_text(min(merged)))}")
                lines.append(b"v " + b" ".join(map(_coordinate, rest[:3])))
                vertices += 1
            elif word == b"f":
                if len(rest) < 3:
                    raise ValueError(f"must have at least three corners per facet, but got {len(rest)}")
                lines.append(b"f " + b" ".join(b"%d" % _corner(corner, vertices) for corner in rest))
                facets += len(rest) - 2
            elif word and word not in passed_over:
                raise ValueError(f"must be an OBJ of vertices and facets, but has {show(_text(word))}")
        except ValueError as error:
            raise ValueError(f"{error} (line {number})") from None
        if vertices > 3 * LIMITS.facets or facets > LIMITS.facets:
            most = f"{LIMITS.facets:,} facets and {3 * LIMITS.facets:,} vertices"
            raise ValueError(f"must have at most {most}, but has more")
    return b"\n".join(lines), facets


def _lines(content: bytes) -> Iterator[bytes]:
    """Yield the lines without comments; of those that a backslash continues the last, with all of them."""
    most_lines, most_bytes = 10 * LIMITS.facets, 10_000  # with texture coordinates and normals; of a line
    if content.count(b"\n") + content.count(b"\r") > most_lines:
        raise ValueError(f"must have at most {most_lines:,} lines, but has more")
    unfinished = b""
    for line in content.splitlines():
        text = unfinished + line.split(b"#", 1)[0]
        if len(text) > most_bytes:
            raise ValueError(f"must have at most {most_bytes:,} bytes per line, but has {len(text):,}")
        unfinished = text[:-1] + b" " if text.endswith(b"\\") else b""
        yield b"" if unfinished else text
    yield unfinished


def _coordinate(word: bytes) -> bytes:
    if len(word) > 64 or re.fullmatch(NUMBER, word) is None:
        raise ValueError(f"must have numbers for coordinates, but got {show(_text(word))}")
    return word


def _corner(word: bytes, vertices: int) -> int:
    """Return the number of a facet's vertex, from 1; a negative one counts back from the last vertex so far."""
    # perhaps with a texture coordinate and a normal, which may be empty
    match = re.fullmatch(rb"([+-]?\d{1,9})(?:/[+-]?\d{0,9}){0,2}", word)
    if match is None:
        raise ValueError(f"must have the number of a vertex for a corner, but got {show(_text(word))}")
    given = int(match[1])
    corner = given + vertices + 1 if given < 0 else given
    if not 1 <= corner <= vertices or given == 0:
        raise ValueError(f"must have the number of a vertex before it, 1 to {vertices}, but got {given}")
    return corner


def _text(word: bytes) -> str:
    return word[:100].decode("utf-8", "replace")


def _corners(value: tuple[int, ...]) -> tuple[int, int, int]:
    i, j, k = value
    if len({i, j, k}) < 3:
        raise ValueError("must have three different corners")
    return i, j, k


class ConvexPiece(Value):
    """A convex body by its surface: triangles that turn counter-clockwise seen from outside."""

    vertices: Annotated[tuple[Vector, ...], at_most(LIMITS.frame_triangles, "vertices")]
    """Corners, in the module's frame [m]."""
    triangles: Annotated[
        tuple[Annotated[tuple[Index, Index, Index], AfterValidator(_corners)], ...],
        at_most(LIMITS.frame_triangles, "triangles"),
    ]
    """Numbers of their corners."""

    def _broken_rules(self) -> Broken:
        faces = np.array(self.triangles, dtype=np.int64).reshape(-1, 3)
        if not len(faces) or set(faces.ravel().tolist()) != set(range(len(self.vertices))):
            yield "triangles", "must use every vertex, and no other"
            return
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()
        there = {(i, j) for i, j in edges}
        if len(there) < len(edges) or there != {(j, i) for i, j in there}:
            closed = "must be a closed surface, every edge once in either direction"
            yield "triangles", f"{closed}; pieces of a mesh that share an edge count as one, so let them overlap"
        elif np.abs(self.vertices).max() > LARGEST_COORDINATE:
            yield "vertices", f"must be at most {LARGEST_COORDINATE:g} m away"
        elif (beyond := _beyond_faces(np.array(self.vertices), faces)) > 1e-6:  # single precision
            yield "triangles", f"must be convex, but a corner lies {100 * beyond:.3g} % of its size beyond a face"


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
    large = area > 1e-9 * size * size  # of slivers the direction is lost
    if not np.any(large):
        return 1.0
    unit = normals[large] / area[large, None]
    beyond = vertices @ unit.T - np.einsum("fx,fx->f", unit, corners[large, 0])
    return float(beyond.max()) / size


def frame_of(mesh: Surface) -> list[dict[str, Any]]:
    """Return the convex pieces that a mesh consists of, as data of `ConvexPiece`.

    Raises:
        ValueError: there are too many.
    """
    if len(mesh.triangles) > LIMITS.frame_triangles:
        raise ValueError(f"must have at most {LIMITS.frame_triangles:,} triangles, but has {len(mesh.triangles):,}")
    parts = parts_of(mesh)
    if len(parts) > LIMITS.frame_pieces:
        raise ValueError(f"must have at most {LIMITS.frame_pieces} pieces, but has {len(parts):,}")
    return [{"vertices": part.vertices.tolist(), "triangles": part.triangles.tolist()} for part in parts]

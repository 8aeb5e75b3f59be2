"""STL and OBJ files that a task names: surfaces, convex pieces that contain them, and custom module frames.

trimesh reads both formats, but skips what it does not understand, and resolves negative indices of an OBJ from the
end of the file instead of the line. So the text is checked first and reduced to what trimesh reads correctly:
vertices and facets. No other file is opened. Free-form surfaces are refused, because facets do not describe them.
"""

from __future__ import annotations

import io
import math
import re
from codecs import BOM_UTF8
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Never, TypeVar

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
    refuse,
    show,
    to_printable,
    with_file_name,
)

Triangles = NDArray[np.intp]
Result = TypeVar("Result")

LARGEST_COORDINATE = 1e15
"""Largest absolute value of a coordinate [m]."""
HEADER, FACET = 84, 50
"""Sizes of a binary STL's header and of each facet [bytes]."""
NUMBER = rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?"
NO_VOLUME = "must be the mesh of a body with a volume"


@dataclass(frozen=True)
class Folder:
    """Validation context that allows a task to name files: the folder that contains them."""

    path: Path


class MeshFile(Value):
    """Mesh entry of a task file; `scale` is applied before `offset`."""

    mesh: str
    """In a task file: path of an STL or OBJ file, relative to the task file."""
    scale: Positive = 1.0
    """In a task file, with `mesh`: metres per unit of the mesh; 0.001 for millimetres."""
    offset: Vector = (0.0, 0.0, 0.0)
    """In a task file, with `mesh`: position of the mesh's origin [m]."""


class Surface(NamedTuple):
    """Triangulated surface."""

    vertices: Array
    """Vertices, shape (v, 3) [m]; each belongs to a triangle."""
    triangles: Triangles
    """Vertex indices, shape (f, 3)."""
    closed: bool = False
    """True if every edge belongs to an even number of triangles, so that the surface encloses a volume."""


def mesh_schema(schema: dict[str, Any]) -> None:
    """Add the fields of `MeshFile` to the JSON schema of a table that may name a mesh."""
    schema["properties"] |= MeshFile.model_json_schema()["properties"]


def take_mesh(
    data: dict[str, Any], replaces: str, context: Any, convert: Callable[[Surface], Result]
) -> Result | None:
    """Return the converted mesh that a table of a task file names, if any, and remove its fields from the data.

    Args:
        data: the table; changed.
        replaces: the field that the mesh replaces.
        context: `Folder` of the file; anything else: no file may be named.
        convert: function of the surface; a ValueError names the rule that the mesh breaks.

    Raises:
        ValidationError: a field is wrong, or the file has no surface.
    """
    fields = {name: data.pop(name) for name in MeshFile.model_fields if data.get(name) is not None}
    if "mesh" not in fields:
        refuse(*((name, "must be left out without a `mesh`") for name in fields))
        return None
    name = fields["mesh"]

    def refuse_mesh(text: str) -> Never:
        refuse(("mesh", with_file_name(text, name)))
        raise AssertionError

    if not isinstance(context, Folder):
        refuse_mesh(f"must be given by its `{replaces}` outside a task file")
    if not isinstance(name, str):
        refuse_mesh("must be the name of an STL or OBJ file")
    file = MeshFile.model_validate(fields)
    path = context.path / name
    try:
        return convert(surface(path, file.scale, file.offset))
    except OSError as error:
        refuse_mesh(f"must be a file that can be read ({to_printable(path)}: {error.strerror})")
    except ValueError as error:
        refuse_mesh(str(error))


def surface(path: Path, scale: float = 1.0, offset: Vector = (0.0, 0.0, 0.0)) -> Surface:
    """Read the surface of a mesh file; polygons are triangulated from their first corner.

    Args:
        path: .stl or .obj file.
        scale: metres per unit of the file.
        offset: position of the file's origin [m].

    Raises:
        ValueError: says why the file has no surface.
        OSError: the file cannot be read.
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
    if not np.all(np.abs(result.vertices) <= LARGEST_COORDINATE):  # false for NaN, too
        raise ValueError(NO_VOLUME)
    return result


def parts_of(mesh: Surface) -> list[Surface]:
    """Return the closed parts of a surface in the file's order, then all open ones as a single part.

    Parts share no edge. Vertices are identified by their index if that closes all parts, otherwise by position.
    Degenerate triangles are dropped.
    """
    unique, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    parts = _parts(mesh.vertices, mesh.triangles)
    return parts if parts and parts[-1].closed else _parts(unique, number.reshape(-1)[mesh.triangles])


def convex_pieces(mesh: Surface) -> tuple[list[Array], list[float]]:
    """Return convex pieces that contain everything a surface encloses, and their excess over the surface.

    Each closed part becomes a piece, and all open parts together another. If one of them has no volume, the whole
    mesh is one piece. A piece is the hull of its part, or a larger polytope if the hull has too many corners.
    Pieces inside another are dropped.

    Returns:
        Sorted corners of each piece, shape (k, 3), and an upper bound for its excess over its part [m].

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
    indices, compact = np.unique(triangles, return_inverse=True)
    return Surface(vertices[indices], compact.reshape(-1, 3))


def _parts(vertices: Array, triangles: Triangles) -> list[Surface]:
    """Return the closed parts, with vertices identified by index, then all open ones as a single part."""
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
    closed = [*[True] * (len(faces) - 1), not is_open.any()]
    return [_compact(vertices, shell)._replace(closed=flag) for shell, flag in zip(faces, closed, strict=True)]


def _without_inner(bodies: list[Surface]) -> list[Surface]:
    """Return the bodies whose hulls are not inside another's; the first of equal ones."""
    hulls = [_hull(body) for body in bodies]

    def is_inside(inner: int, outer: int) -> bool:
        normals, offsets = hulls[outer].equations[:, :3], hulls[outer].equations[:, 3]
        heights = hulls[inner].points[hulls[inner].vertices] @ normals.T + offsets
        return bool(heights.max() <= 1e-12 * np.ptp(hulls[outer].points, axis=0).max())  # up to rounding

    def is_inner(number: int) -> bool:
        others = (other for other in range(len(bodies)) if other != number and is_inside(number, other))
        return any(other < number or not is_inside(other, number) for other in others)

    return [body for number, body in enumerate(bodies) if not is_inner(number)]


def _hull(body: Surface) -> Any:
    from scipy.spatial import ConvexHull  # slow to import, and few tasks need it

    return ConvexHull(body.vertices)


def _concavity(body: Surface) -> float:
    """Return an upper bound for the distance of the hull's surface from the body [m]; 0 for a convex body.

    Both surfaces are sampled; every point of the hull is within h / sqrt(3) of a sample, h being the longest edge.
    """
    import trimesh
    from scipy.spatial import cKDTree

    mesh, hull = trimesh.Trimesh(*body[:2], process=False), _hull(body)
    if body.closed:
        trimesh.repair.fix_winding(mesh)
        if hull.volume <= abs(mesh.volume) * (1 + 1e-5):  # convex, within single precision
            return 0.0
    body_samples, _ = _sample(*body[:2])
    hull_samples, h = _sample(body.vertices, hull.simplices)
    return float(cKDTree(body_samples).query(hull_samples)[0].max()) + h / math.sqrt(3)


def _sample(vertices: Array, triangles: Triangles) -> tuple[Array, float]:
    """Return about 200,000 points of a surface, and the largest length of the edges between them."""
    from trimesh.remesh import subdivide_to_size

    sides = vertices[triangles] - vertices[np.roll(triangles, 1, axis=1)]
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    h = max(float(longest.max()) / 100, math.sqrt(float(np.sum(longest**2)) / 200_000))
    points, _ = subdivide_to_size(vertices, triangles, max_edge=h)
    return np.asarray(points), h


def _stl(content: bytes) -> tuple[bytes, int]:
    """Return an STL in a form that trimesh reads correctly, and its number of facets.

    A file is binary if it is at least as long as the header says, whatever its first word; trailing bytes are cut.
    """
    facets = int.from_bytes(content[80:HEADER], "little") if len(content) >= HEADER else -1
    if facets >= 0 and HEADER + FACET * facets <= len(content):
        if _is_facet(content[HEADER + FACET * facets :][:FACET]):
            raise ValueError(f"must have as many facets as its header says, {facets:,}, but has more")
        return content[: HEADER + FACET * facets], facets
    if not re.match(rb"(?i)\s*solid\b", content):
        actual = "too few bytes for a header" if facets < 0 else f"{len(content):,} bytes for {facets:,} facets"
        raise ValueError(f"must be a whole STL file: {HEADER} bytes and {FACET} per facet; this one has {actual}")
    body = re.sub(rb"(?im)^[ \t]*(?:end)?solid\b.*$", b"", content.replace(b"\r", b"\n"))
    # one statement per line: trimesh reads a vertex to the end of its line
    body = re.sub(rb"(?i)\s+(facet|vertex|endloop|endfacet)\b", rb"\n\1", body)
    words = (b"facet", b"endfacet", b"vertex")
    facets, ends, vertices = (len(re.findall(rb"(?im)^%b\b" % word, body)) for word in words)
    not_a_vertex = rb"(?im)^vertex(?!(?:[ \t]+%b){3}[ \t]*$).*" % NUMBER
    if ends <= LIMITS.facets and (wrong := re.search(not_a_vertex, body)):
        raise ValueError(f"must have three numbers per vertex, but got {show(_text(wrong[0]))}")
    if ends <= LIMITS.facets and not vertices == 3 * facets == 3 * ends:
        counts = f"{facets:,} `facet`, {vertices:,} `vertex` and {ends:,} `endfacet`"
        raise ValueError(f"must be a whole ASCII STL, with three vertices per facet, but has {counts}")
    # without normals: trimesh fails if they are not numbers
    return b"\n".join([b"solid", *re.findall(rb"(?im)^vertex.*$", body), b"endsolid\n"]), ends


def _is_facet(content: bytes) -> bool:
    """True if bytes look like a facet of a binary STL: a unit or zero normal, and distinct corners."""
    if len(content) < FACET or any(content[48:]):
        return False
    normal, *corners = np.frombuffer(content[:48], "<f4").reshape(4, 3).astype(float)
    if not np.all(np.isfinite([normal, *corners])) or np.abs(corners).max() > LARGEST_COORDINATE:
        return False
    length = np.linalg.norm(normal)
    return bool((length == 0 or abs(length - 1) < 0.01) and np.ptp(corners, axis=0).any())


def _obj(content: bytes) -> tuple[bytes, int]:
    """Return an OBJ reduced to vertices and facets with positive indices, and its number of triangles."""
    ignored = frozenset(
        b"vt vn vp o g s mg l p end usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj "
        b"trace_obj".split()
    )
    lines, statements = list[bytes](), ignored | {b"v", b"f"}
    vertices = facets = 0
    for number, line in enumerate(_lines(content.rstrip(b"\0\x1a\r\n")), start=1):
        word, *arguments = line.split() or [b""]
        try:
            if word == b"v":
                if len(arguments) < 3:
                    raise ValueError(f"must have three numbers per vertex, but got {len(arguments)}")
                if extra := statements.intersection(arguments[3:]):  # weights and colours are numbers
                    raise ValueError(f"must have a line per vertex and facet, but got {show(_text(min(extra)))}")
                lines.append(b"v " + b" ".join(map(_coordinate, arguments[:3])))
                vertices += 1
            elif word == b"f":
                if len(arguments) < 3:
                    raise ValueError(f"must have at least three corners per facet, but got {len(arguments)}")
                lines.append(b"f " + b" ".join(b"%d" % _corner(corner, vertices) for corner in arguments))
                facets += len(arguments) - 2
            elif word and word not in ignored:
                raise ValueError(f"must be an OBJ of vertices and facets, but has {show(_text(word))}")
        except ValueError as error:
            raise ValueError(f"{error} (line {number})") from None
        if vertices > 3 * LIMITS.facets or facets > LIMITS.facets:
            most = f"{LIMITS.facets:,} facets and {3 * LIMITS.facets:,} vertices"
            raise ValueError(f"must have at most {most}, but has more")
    return b"\n".join(lines), facets


def _lines(content: bytes) -> Iterator[bytes]:
    """Yield the lines without comments; lines continued by a backslash are joined into the last of them."""
    most_lines, most_bytes = 10 * LIMITS.facets, 10_000  # room for texture coordinates and normals; per line
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
    """Return the index of a facet's vertex, from 1; negative ones count back from the last vertex so far."""
    # indices of a texture coordinate and a normal may follow
    match = re.fullmatch(rb"([+-]?\d{1,9})(?:/[+-]?\d{0,9}){0,2}", word)
    if match is None:
        raise ValueError(f"must have the number of a vertex for a corner, but got {show(_text(word))}")
    index = int(match[1])
    corner = index + vertices + 1 if index < 0 else index
    if not 1 <= corner <= vertices or index == 0:
        raise ValueError(f"must have the number of a vertex before it, 1 to {vertices}, but got {index}")
    return corner


def _text(word: bytes) -> str:
    return word[:100].decode("utf-8", "replace")


def _distinct_corners(value: tuple[int, ...]) -> tuple[int, int, int]:
    i, j, k = value
    if len({i, j, k}) < 3:
        raise ValueError("must have three different corners")
    return i, j, k


class ConvexPiece(Value):
    """Convex body by its surface: triangles, counter-clockwise seen from outside."""

    vertices: Annotated[tuple[Vector, ...], at_most(LIMITS.frame_triangles, "vertices")]
    """Vertices in the module's frame [m]."""
    triangles: Annotated[
        tuple[Annotated[tuple[Index, Index, Index], AfterValidator(_distinct_corners)], ...],
        at_most(LIMITS.frame_triangles, "triangles"),
    ]
    """Vertex indices of the triangles."""

    def _broken_rules(self) -> Broken:
        faces = np.array(self.triangles, dtype=np.int64).reshape(-1, 3)
        if not len(faces) or set(faces.ravel().tolist()) != set(range(len(self.vertices))):
            yield "triangles", "must use every vertex, and no other"
            return
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()
        distinct = {(i, j) for i, j in edges}
        if len(distinct) < len(edges) or distinct != {(j, i) for i, j in distinct}:
            closed = "must be a closed surface, every edge once in either direction"
            yield "triangles", f"{closed}; pieces of a mesh that share an edge count as one, so let them overlap"
        elif np.abs(self.vertices).max() > LARGEST_COORDINATE:
            yield "vertices", f"must be at most {LARGEST_COORDINATE:g} m away"
        elif (beyond := _beyond_faces(np.array(self.vertices), faces)) > 1e-6:  # single precision
            yield "triangles", f"must be convex, but a corner lies {100 * beyond:.3g} % of its size beyond a face"


def _beyond_faces(vertices: Array, faces: Any) -> float:
    """Return the largest distance of a vertex beyond a face, over the size; 1 if inside out or all slivers."""
    corners = vertices[faces]
    size = float(np.ptp(vertices, axis=0).max())
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    if float(np.einsum("fx,fx->", normals, corners[:, 0] - vertices.mean(axis=0))) <= 1e-12 * size**3:
        return 1.0
    large = area > 1e-9 * size * size  # the normals of slivers are lost to rounding
    if not np.any(large):
        return 1.0
    unit = normals[large] / area[large, None]
    beyond = vertices @ unit.T - np.einsum("fx,fx->f", unit, corners[large, 0])
    return float(beyond.max()) / size


def frame_of(mesh: Surface) -> list[dict[str, Any]]:
    """Return the convex pieces of a mesh, as data of `ConvexPiece`; ValueError if there are too many."""
    if len(mesh.triangles) > LIMITS.frame_triangles:
        raise ValueError(f"must have at most {LIMITS.frame_triangles:,} triangles, but has {len(mesh.triangles):,}")
    parts = parts_of(mesh)
    if len(parts) > LIMITS.frame_pieces:
        raise ValueError(f"must have at most {LIMITS.frame_pieces} pieces, but has {len(parts):,}")
    return [{"vertices": part.vertices.tolist(), "triangles": part.triangles.tolist()} for part in parts]

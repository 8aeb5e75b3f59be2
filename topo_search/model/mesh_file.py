"""STL and OBJ files that a task names: surfaces, convex pieces that contain them, and custom module frames.

Only vertices and facets are read, and no other file is opened. Free-form surfaces are refused, because facets do
not describe them.
"""

import io
import math
import re
from codecs import BOM_UTF8
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Never, TypeVar

import numpy as np
from pydantic import AfterValidator

from topo_search.limits import LIMITS
from topo_search.model.arrays import Array, Indices
from topo_search.model.kinds import Index, NonNegative, Positive, Vector, at_most
from topo_search.model.proven import upper_text
from topo_search.model.shape import convex_hull, has_volume, quickhull
from topo_search.model.text import Folder, read_regular
from topo_search.model.value import Broken, Value, refuse, show, to_printable

Triangles = Indices
Result = TypeVar("Result")

LARGEST_COORDINATE = 1e15
"""Largest absolute value of a coordinate [m]."""
SLACK = 1e-9
"""Offset of the planes of an outer hull, relative to its size; exceeds rounding errors of corners."""
CONVEX = 1e-6
"""Distance of a corner beyond a face, over the size, up to which a body is convex: single precision."""
NO_VOLUME = "must be the mesh of a body with a volume"


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


class MeshExcess(Value):
    """Excess of a region over its source mesh."""

    exposure: Index
    """Number of the requirement."""
    segment: Index | None
    """Index of the convex piece; None for a single one."""
    at_most_m: NonNegative
    """Upper bound for the distance of the piece's surface from that of the mesh [m]."""

    @property
    def words(self) -> str:
        """Region and excess, in words."""
        piece = "" if self.segment is None else f", piece {self.segment},"
        return f"exposure {self.exposure}{piece} reaches up to {upper_text(self.at_most_m, 3)} m beyond its mesh"


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
        refuse(("mesh", f"{text} (in {show(name)})"))
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
    except (OverflowError, ValueError) as error:
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
    vertices, triangles = _obj(content) if form == ".obj" else _stl(content)
    if len(triangles) > LIMITS.facets:
        raise ValueError(f"must have at most {LIMITS.facets:,} facets, but has {len(triangles):,}")
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise ValueError(f"must have corners 1 to {len(vertices)}, the number of vertices, in every facet")
    result = _compact(vertices * scale + np.array(offset), triangles)
    if not len(triangles) or not np.all(np.abs(result.vertices) <= LARGEST_COORDINATE):  # false for NaN, too
        raise ValueError(NO_VOLUME)
    return result


def _obj(content: bytes) -> tuple[Array, Triangles]:
    """Return the vertices and triangles of an OBJ; a negative index counts back from the last vertex so far."""
    vertices, triangles = list[list[float]](), list[tuple[int, ...]]()
    for line in re.sub(rb"\\\r?\n", b" ", content).splitlines():
        word, *arguments = line.split(b"#")[0].split() or [b""]
        if word in (b"curv", b"curv2", b"surf"):
            raise ValueError(f"must be an OBJ of vertices and facets, but has `{word.decode()}`")
        try:
            if word == b"v":  # weights or colours may follow
                x, y, z, *_ = map(float, arguments)
                vertices.append([x, y, z])
            elif word == b"f":  # a texture coordinate and a normal may follow each corner
                numbers = (int(corner.split(b"/")[0]) for corner in arguments)
                first, *others = (k + len(vertices) if k < 0 else k - 1 for k in numbers)
                triangles += [(first, *side) for side in pairwise(others)]
        except ValueError:
            rule = "must have three numbers per vertex, and numbers of vertices in every facet"
            raise ValueError(f"{rule}, but got {show(line[:100].decode(errors='replace'))}") from None
    return np.array(vertices).reshape(-1, 3), np.array(triangles, dtype=np.intp).reshape(-1, 3)


def _stl(content: bytes) -> tuple[Array, Triangles]:
    """Return the vertices, three per facet, and the triangles of an STL, binary or text."""
    import trimesh

    try:
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type="stl", process=False)
    except ValueError as error:
        raise ValueError(f"must be a whole STL file, but {error}") from None
    if not len(mesh.faces):
        raise ValueError("must be a whole STL file, but no facet can be read")
    corners = np.asarray(mesh.triangles).reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def parts_of(mesh: Surface) -> list[Surface]:
    """Return the closed parts of a surface in the file's order, then all open ones as a single part.

    Parts share no edge. Vertices are identified by their index if that closes all parts, otherwise by position, and
    a facet that occurs twice counts once if that closes them. Degenerate triangles are dropped.
    """
    unique, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    by_position = number.reshape(-1)[mesh.triangles]
    _, first = np.unique(np.sort(by_position), axis=0, return_index=True)
    by_index, *others = (
        _parts(*given)
        for given in ((mesh.vertices, mesh.triangles), (unique, by_position), (unique, by_position[np.sort(first)]))
    )
    return next((parts for parts in (by_index, *others) if parts and parts[-1].closed), others[0])


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
    excess = [beyond + _excess(body) for body, (_, beyond) in zip(bodies, outer, strict=True)]
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
    """Return the bodies whose hulls are not inside another's, one of equal ones."""
    hulls, outer = [_hull(body) for body in bodies], list[int]()
    for number in sorted(range(len(bodies)), key=lambda number: -hulls[number].volume):
        corners = np.column_stack([bodies[number].vertices, np.ones(len(bodies[number].vertices))])
        size = 1e-12 * np.ptp(corners)  # up to rounding
        if all((corners @ hulls[other].equations.T).max() > size for other in outer):
            outer.append(number)
    return [bodies[number] for number in sorted(outer)]


def _hull(body: Surface) -> Any:
    from scipy.spatial import ConvexHull  # slow to import, and few tasks need it

    return ConvexHull(body.vertices)


def _excess(body: Surface) -> float:
    """Return an upper bound for the distance of the hull's surface from the body [m]; 0 for a convex body.

    If no facet of a closed body is deeper in its hull than d, the body contains all that is deeper, and the bound
    is the largest distance of the hull's corners from there. Otherwise points of body and hull are compared: every
    point of the hull is within h / sqrt(3) of one, h being their longest edge.
    """
    import trimesh
    from scipy.spatial import HalfspaceIntersection, QhullError, cKDTree

    body = body._replace(vertices=body.vertices - body.vertices.mean(axis=0))
    mesh, hull = trimesh.Trimesh(body.vertices, body.triangles, process=False), _hull(body)
    trimesh.repair.fix_winding(mesh)
    if body.closed and abs(mesh.volume) > hull.volume / 2:
        points, pieces, face, _ = _sample(body.vertices, hull.simplices, 20_000)
        corners, near = mesh.triangles, cKDTree(points[pieces].mean(axis=1))
        planes = hull.equations[face[near.query(corners.mean(axis=1), k=8)[1]]]  # of faces close to each facet
        heights = np.einsum("fpx,fcx->fpc", planes[..., :3], corners) + planes[..., 3:]
        deepest = float(-heights.min(axis=2).max(axis=1).min())
        if deepest <= CONVEX * np.ptp(body.vertices, axis=0).max():
            return 0.0
        with suppress(QhullError):  # nothing is that deep
            inner = HalfspaceIntersection(hull.equations + np.array([0, 0, 0, deepest]), np.zeros(3)).intersections
            return float(cKDTree(inner).query(body.vertices[hull.vertices])[0].max())
    points, *_ = _sample(body.vertices, body.triangles, 200_000)
    hull_points, *_, h = _sample(body.vertices, hull.simplices, 200_000)
    return float(cKDTree(points).query(hull_points)[0].max()) + h / math.sqrt(3)


def _sample(vertices: Array, triangles: Triangles, count: int) -> tuple[Array, Triangles, Triangles, float]:
    """Return a surface as about `count` points and small triangles, the triangle of each, and the longest edge."""
    from trimesh.remesh import subdivide_to_size

    sides = vertices[triangles] - vertices[np.roll(triangles, 1, axis=1)]
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    h = max(float(longest.max()) / 100, math.sqrt(float(np.sum(longest**2)) / count))
    points, pieces, triangle = subdivide_to_size(vertices, triangles, max_edge=h, return_index=True)
    return np.asarray(points), pieces, triangle, h


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
        elif (beyond := _beyond_faces(np.array(self.vertices), faces)) > CONVEX:
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


def frame_of(mesh: Surface) -> tuple[list[dict[str, Any]], float]:
    """Return the hulls of a mesh's pieces, as data of `ConvexPiece`, and how far they reach beyond the mesh [m].

    Raises:
        ValueError: there are too many triangles or pieces, or one is not closed, or not convex within rounding.
    """
    if len(mesh.triangles) > LIMITS.frame_triangles:
        raise ValueError(f"must have at most {LIMITS.frame_triangles:,} triangles, but has {len(mesh.triangles):,}")
    parts = parts_of(mesh)
    if len(parts) > LIMITS.frame_pieces:
        raise ValueError(f"must have at most {LIMITS.frame_pieces} pieces, but has {len(parts):,}")
    share = "pieces of a mesh that share an edge count as one, so let them overlap"
    if not (parts and parts[-1].closed):
        raise ValueError(f"must be closed surfaces; {share}")
    if not all(has_volume(part.vertices) for part in parts):
        raise ValueError(NO_VOLUME)
    excess = [_excess(part) for part in parts]
    for number, (part, beyond) in enumerate(zip(parts, excess, strict=True)):
        if beyond > max(1e-4, 1e-3 * np.ptp(part.vertices, axis=0).max()):  # rounding of files: 0.1 mm, or 0.1 %
            raise ValueError(
                f"must have convex pieces, but piece {number} is up to {beyond:.3g} m inside its hull; {share}"
            )
    hulls = [convex_hull(part.vertices) for part in parts]
    return [{"vertices": hull.corners.tolist(), "triangles": hull.triangles.tolist()} for hull in hulls], max(
        excess
    )


def outer_hull(points: Array, most_corners: int) -> tuple[Array, float]:
    """Return the corners of a convex polytope that contains points, and its excess over their hull.

    The polytope is the hull if that has few enough corners. Otherwise a box is cut by supporting planes of the
    hull, one after the other at the corner farthest from the hull. All planes are moved outwards by more than
    rounding.

    Args:
        points: points that span a volume, shape (m, 3).
        most_corners: largest number of corners, at least eight.

    Returns:
        Corners, shape (k, 3), and the largest distance of a corner from the hull.

    Raises:
        ValueError: the points are flat or nearly so, or too far from the origin for their size.
    """
    qhull = quickhull(points)
    hull = points[np.unique(qhull.simplices)]
    if len(hull) <= most_corners:
        return hull, 0.0
    from scipy.spatial import HalfspaceIntersection, QhullError

    middle = hull.mean(axis=0)
    size = float(np.abs(hull - middle).max())
    scaled = (hull - middle) / size
    slack = SLACK + 8 * np.finfo(float).eps * float(np.abs(middle).max()) / size
    axes = np.linalg.svd(scaled, full_matrices=False)[2]
    normals, corners, excess = [*axes, *-axes], np.zeros((0, 3)), 0.0
    gaps: dict[tuple[float, ...], Array] = {}
    while True:
        offsets = (np.array(normals) @ scaled.T).max(axis=1) + slack
        try:
            cut = HalfspaceIntersection(np.column_stack([normals, -offsets]), np.zeros(3)).intersections
        except QhullError:
            raise ValueError("must be thicker for its size, to be simplified") from None
        _, first = np.unique(cut.round(9) + 0.0, axis=0, return_index=True)
        if len(first) > most_corners:
            break
        corners = cut[first]
        for key, corner in zip(map(tuple, corners.round(9).tolist()), corners, strict=True):
            if key not in gaps:
                gaps[key] = corner - _nearest(corner, scaled)
        beyond = [gaps[key] for key in map(tuple, corners.round(9).tolist())]
        lengths = np.linalg.norm(beyond, axis=1)
        excess = float(lengths.max())
        if excess <= 100 * slack:
            break
        normals.append(beyond[int(np.argmax(lengths))] / excess)
    outer = np.unique(middle + size * corners, axis=0)
    faces = quickhull(outer).equations
    if (hull @ faces[:, :3].T + faces[:, 3]).max() > 0:
        raise ValueError("must be nearer to the origin for its size, to be simplified")
    return outer, size * (excess + slack)


def _nearest(x: Array, corners: Array) -> Array:
    """Return the point of a hull nearest to a point x outside of it, shape (3,), given its corners, shape (k, 3).

    Active-set method: the corner farthest towards x enters; least distances by Lawson and Hanson, Ch. 23.
    """
    from scipy.optimize import nnls

    active = [int(np.argmin(np.linalg.norm(corners - x, axis=1)))]
    while True:
        towards = corners[active] - x
        weights = nnls(np.vstack([towards.T, np.ones(len(active))]), np.array([0.0, 0.0, 0.0, 1.0]))[0]
        nearest = np.asarray(weights @ corners[active] / weights.sum())
        ahead = corners @ (x - nearest)
        farthest = int(np.argmax(ahead))
        if farthest in active or ahead[farthest] - nearest @ (x - nearest) <= SLACK * np.linalg.norm(x - nearest):
            return nearest
        active = [*(corner for corner, weight in zip(active, weights, strict=True) if weight > 0), farthest]

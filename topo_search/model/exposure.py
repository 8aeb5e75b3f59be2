"""Exposure requirements: regions at the target that airflow must not reach (paper, Sec. III).

Points are in metres from the end-effector p_E, in the axes of the task frame.
"""

import math
import sys
from collections.abc import Iterable, Iterator
from itertools import pairwise, product
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    model_serializer,
    model_validator,
)

from topo_search.limits import LIMITS, figures, length, quantity, vector
from topo_search.model import kinds, proven
from topo_search.model.arrays import Array
from topo_search.model.mesh_file import LARGEST_COORDINATE, convex_pieces, mesh_schema, take_mesh
from topo_search.model.shape import Capsule, Cone, Polytope, Shape, has_volume, unit
from topo_search.model.value import Broken, Value, refuse, show


def _has_direction(vector: kinds.Vector) -> kinds.Vector:
    if kinds.is_zero(vector):
        raise ValueError("must have a direction")
    if not 1e-15 <= math.hypot(*vector) <= 1e15:
        raise ValueError("must be between 1e-15 and 1e15 long")
    return vector


Direction = Annotated[kinds.Vector, AfterValidator(_has_direction)]
Axis = Annotated[Literal["com"] | Direction, kinds.OneOf('must be "com" or [x, y, z]')]


def _check_volume(vertices: tuple[kinds.Vector, ...]) -> tuple[kinds.Vector, ...]:
    if max((abs(x) for vertex in vertices for x in vertex), default=0.0) > LARGEST_COORDINATE:
        raise ValueError(f"must be at most {LARGEST_COORDINATE:g} m away")
    if not has_volume(np.array(vertices).reshape(-1, 3)):
        raise ValueError(f"must span a volume, but got {show(vertices)}")
    return vertices


def _check_thickness(box: kinds.Vector) -> kinds.Vector:
    if min(box) <= 1e-6 * max(box):
        raise ValueError(f"must not be thinner than a millionth of its length, but got {show(box)}")
    return box


HullPoints = Annotated[
    tuple[kinds.Vector, ...], kinds.at_most(LIMITS.corners, "corners"), AfterValidator(_check_volume)
]


class Region(Value):
    """Fields that all regions share; each kind also has `words` and `shapes`."""

    speed: kinds.Omitted[kinds.Positive] = None
    """Largest allowed air speed in the region, in every load case, by the jet model [m/s]."""
    geometry: Annotated[kinds.Flag, Field(exclude_if=lambda flag: flag)] = True
    """True if airflow envelopes must stay out of the region; false: only its `speed` is limited, if at all."""
    solid: Annotated[kinds.Flag, kinds.OMIT_EMPTY] = False
    """True if the region is an object, such as a wall: rigid parts stay out too, and so does the rod except its
    tip, unless p_E is inside."""
    contact: kinds.Omitted[kinds.Index] = None
    """Number of the load case whose object the region is. Set in designs, not in tasks."""

    @model_serializer(mode="wrap")
    def _write_solid_last(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the fields in the order of older files, on which the random starts of a task depend."""
        fields = write(self)
        return {name: fields[name] for name in sorted(fields, key=("solid", "contact").count)}

    @property
    def speed_reach(self) -> float | None:
        """Distance from the end-effector up to which `speed` applies [m]; None: everywhere in the region."""
        return None

    @property
    def sides(self) -> str:
        """Where airflow must stay, in words; empty if it must stay out of the region."""
        return ""

    def mesh_excesses(self) -> Iterator[tuple[int | None, float]]:
        """Yield the segments (see `segment_of`) that reach beyond the mesh that they replace, and how far [m]."""
        yield from ()

    def _broken_rules(self) -> Broken:
        if not (self.geometry or self.solid) and self.speed is None:
            yield "geometry", "must be true, or `speed` or `solid` must be given"


class UnboundedRegion(Region):
    """Fields that unbounded regions share."""

    speed_within: kinds.Omitted[kinds.Positive] = None
    """Distance from the end-effector up to which `speed` applies [m]; default: everywhere."""

    @property
    def speed_reach(self) -> float | None:
        """See `Region.speed_reach`."""
        return self.speed_within

    @property
    def content(self) -> str:
        """Things that must stay inside the allowed part of space, in words."""
        return "rigid parts" if self.solid and not self.geometry else "airflow"

    def _broken_rules(self) -> Broken:
        yield from super()._broken_rules()
        if self.speed_within is not None and self.speed is None:
            yield "speed_within", "must be left out, or `speed` must be given"


class Local(Region):
    """Region around the end-effector that no envelope may enter: a ball, a box, or convex hulls of points.

    A task file may name a `mesh`, an STL or OBJ file with its origin at p_E, instead of `vertices` or, for several
    bodies, of `pieces`: the region is the hulls of its bodies. Boxes, points and meshes use the axes of the task
    frame.
    """

    model_config = ConfigDict(json_schema_extra=mesh_schema)

    kind: Literal["local"] = "local"
    radius: kinds.Omitted[kinds.Positive] = None
    """r_sph: radius of a ball centred at p_E [m]; default: 0.15, if no other shape is given."""
    box: kinds.Omitted[Annotated[kinds.PositiveVector, AfterValidator(_check_thickness)]] = None
    """Edges of a box centred at p_E, along x, y and z [m]."""
    vertices: kinds.Omitted[HullPoints] = None
    """Points from p_E [m]; the region is their convex hull."""
    pieces: kinds.Omitted[
        Annotated[tuple[HullPoints, ...], kinds.at_most(LIMITS.pieces, "pieces"), kinds.NonEmpty]
    ] = None
    """Lists of points from p_E [m]; the region is the union of their convex hulls."""
    mesh_excess: kinds.Omitted[Annotated[tuple[kinds.NonNegative, ...], kinds.at_most(LIMITS.pieces)]] = None
    """Upper bound for the excess of each piece over its source mesh [m]; None without excess."""

    @model_validator(mode="before")
    @classmethod
    def _one_shape(cls, data: Any, info: ValidationInfo) -> Any:
        """Fill in the default shape, or the corners of a mesh."""
        if not isinstance(data, dict):
            return data
        shapes = [name for name in ("radius", "box", "vertices", "pieces", "mesh") if data.get(name) is not None]
        if len(shapes) > 1:
            rule = "must have one of `radius`, `box`, `vertices`, `pieces` and `mesh`"
            refuse(((), f"{rule}, but got {' and '.join(shapes)}"))
        data = dict(data)
        mesh = take_mesh(data, "vertices", info.context, convex_pieces)
        if mesh is None:
            return data if shapes else {**data, "radius": 0.15}
        corners, excess = mesh
        pieces = [points.tolist() for points in corners]
        shape = {"vertices": pieces[0]} if len(pieces) == 1 else {"pieces": pieces}
        return {**data, **shape, "mesh_excess": excess if any(excess) else None}

    @property
    def words(self) -> str:
        """The region in words."""
        if self.radius is not None:
            return f"a ball of radius {length(self.radius)} around the end-effector"
        if self.box is not None:
            return f"a box of {vector(self.box)} m along x, y and z, centred at the end-effector"
        hulls = f"the convex hull of {quantity(len(self.corners), 'point')} about the end-effector"
        if self.pieces is not None:
            pieces = quantity(len(self.pieces), "convex piece")
            hulls = f"{pieces} about the end-effector, with {len(self.corners)} corners in all"
        beyond = max(self.mesh_excess or (0.0,))
        return hulls + (f", up to {length(proven.at_most(beyond, 3))} larger than the mesh" if beyond else "")

    def mesh_excesses(self) -> Iterator[tuple[int | None, float]]:
        """See `Region.mesh_excesses`."""
        excesses = enumerate(self.mesh_excess or ())
        yield from ((segment_of(self, piece), excess) for piece, excess in excesses if excess)

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Shapes that make up the region."""
        if self.radius is not None:
            return (Capsule(self.radius),)
        return tuple(Polytope(tuple((x, y, z) for x, y, z in points.tolist())) for points in self.polytopes)

    @property
    def polytopes(self) -> tuple[Array, ...]:
        """Points of the convex hulls that make up the region, from p_E, shape (k, 3) each [m]; none for a ball."""
        if self.box is not None:
            return (np.array(list(product((-0.5, 0.5), repeat=3))) * np.array(self.box),)
        return tuple(map(np.array, self.pieces or (self.vertices and (self.vertices,)) or ()))

    @property
    def corners(self) -> Array:
        """All points of `polytopes`, shape (k, 3) [m]."""
        return np.concatenate([np.zeros((0, 3)), *self.polytopes])


def _check_path(points: tuple[kinds.Vector, ...]) -> tuple[kinds.Vector, ...]:
    if len(points) < 2:
        raise ValueError(f"must have at least two points, but got {show(points)}")
    if max(abs(x) for point in points for x in point) > LARGEST_COORDINATE:
        raise ValueError(f"must be at most {LARGEST_COORDINATE:g} m away")
    if any(math.dist(start, end) < 1e-15 for start, end in pairwise(points)):
        raise ValueError(f"must lead from each point to a different one, but got {show(points)}")
    return points


Path = Annotated[tuple[kinds.Vector, ...], kinds.at_most(LIMITS.segments, "points"), AfterValidator(_check_path)]


class Directional(Region):
    """Capsules along motion paths near the end-effector that no envelope may enter."""

    kind: Literal["directional"] = "directional"
    radius: kinds.Positive = 0.15
    """r_sph: radius of the capsules [m]."""
    segments: Annotated[tuple[Direction, ...], kinds.at_most(LIMITS.segments), kinds.NonEmpty] | None = None
    """End of each straight path that starts at the end-effector, from p_E [m]."""
    polylines: kinds.Omitted[Annotated[tuple[Path, ...], kinds.at_most(LIMITS.segments), kinds.NonEmpty]] = None
    """Instead of segments: bent paths, each a list of points from p_E [m]."""
    along: Literal["end_effector"] | None = None
    """Instead of segments: one path along p_E, away from the COM."""
    length: kinds.Positive | None = None
    """Length of the path along p_E [m]."""

    def _broken_rules(self) -> Broken:
        yield from super()._broken_rules()
        forms = ("segments", "polylines", "along", "length")
        fields = [name for name in forms if getattr(self, name) is not None]
        if fields not in (["segments"], ["polylines"], ["along", "length"]):
            actual = " and ".join(fields) or "none of them"
            yield (), f"must have either `segments`, or `polylines`, or `along` with `length`, but got {actual}"

    @property
    def words(self) -> str:
        """The region in words."""
        path = f"{length(self.length or 0.0)} along p_E, away from the centre of mass"
        if self.segments is not None:
            endpoints = ", ".join(vector(end) for end in self.segments)
            path = f"{quantity(len(self.segments), 'path')} from the end-effector to {endpoints} m"
        if self.polylines is not None:
            paths = "; ".join(" to ".join(vector(point) for point in points) for points in self.polylines)
            path = f"{quantity(len(self.polylines), 'bent path')}, from the end-effector: {paths} m"
        return f"capsules of radius {length(self.radius)} along {path}"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """One capsule per straight piece; its index is the `segment` in audits."""
        if self.length is not None:
            return (Capsule(self.radius, length=self.length),)
        paths = self.polylines or tuple(((0.0, 0.0, 0.0), end) for end in self.segments or ())
        return tuple(Capsule(self.radius, *piece) for path in paths for piece in pairwise(path))


class Exterior(UnboundedRegion):
    """Everything outside an infinite cone with its apex at p_E; all envelopes stay inside the cone."""

    kind: Literal["exterior"] = "exterior"
    half_angle_deg: Annotated[float, Field(strict=True, gt=0, le=90)] = 60.0
    """theta_con: half-angle of the cone [deg]; at 90 it is a half-space."""
    axis: Axis = "com"
    """d_con: axis, from p_E into the allowed cone; `com`: from p_E to the centre of mass."""

    @property
    def words(self) -> str:
        """The region in words."""
        if self.contact is not None and self.axis != "com":
            outwards = vector(tuple(0.0 - x for x in self.axis))
            return f"object of load case {self.contact}: everything beyond the end-effector along {outwards}"
        axis = "towards the centre of mass" if self.axis == "com" else f"along {vector(self.axis)}"
        return (
            f"everything outside a cone of half-angle {figures(self.half_angle_deg)}° with its apex at the "
            f"end-effector and its axis {axis}"
        )

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Cone of the allowed side."""
        axis = None if self.axis == "com" else unit(self.axis)
        return (Cone(self.half_angle_deg, axis, content=self.content),)


class Plane(Value):
    """Half-space: normal . x is at most the offset, with x from p_E [m]; a region keeps it with a unit normal."""

    normal: Direction
    """Normal that points out of the half-space; of any length, which divides the offset."""
    offset: Annotated[float, Field(strict=True, ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)] = 0.0
    """Largest normal . x: with a unit normal, the distance from p_E [m]; negative where p_E is outside."""


def _with_unit_normal(plane: Plane) -> Plane:
    size = math.hypot(*plane.normal)
    if abs(size - 1) <= 4 * sys.float_info.epsilon:  # a unit vector, which keeps its digits
        return plane
    return Plane(normal=unit(plane.normal), offset=plane.offset / size)


UnitPlane = Annotated[Plane, AfterValidator(_with_unit_normal)]


class Allowed(UnboundedRegion):
    """Everything outside a convex polyhedron, which may be unbounded; all envelopes stay inside it."""

    kind: Literal["allowed"] = "allowed"
    planes: Annotated[tuple[UnitPlane, ...], kinds.at_most(LIMITS.segments, "planes"), kinds.NonEmpty]
    """Half-spaces whose intersection is the polyhedron."""

    def _broken_rules(self) -> Broken:
        yield from super()._broken_rules()
        farthest = max(plane.offset for plane in self.planes)
        if self.speed_within is not None and self.speed_within <= farthest:
            rule = f"must be more than the distance of every plane, {farthest:g} m at most"
            yield "speed_within", f"{rule}, but got {self.speed_within:g}"

    @property
    def sides(self) -> str:
        """The polyhedron in words."""
        sides = (f"{vector(plane.normal)} · x ≤ {length(plane.offset)}" for plane in self.planes)
        return f"{' and '.join(sides)}, with x from the end-effector"

    @property
    def words(self) -> str:
        """The region in words."""
        return f"everything except where {self.sides}"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """One half-space per plane; its index is the `segment` in audits."""
        planes = ((*plane.normal, plane.offset) for plane in self.planes)
        return tuple(
            Cone(90.0, (-x, -y, -z), apex=(offset * x, offset * y, offset * z), content=self.content)
            for x, y, z, offset in planes
        )


AnyExposure = Local | Directional | Exterior | Allowed
Exposure = Annotated[AnyExposure, Field(discriminator="kind")]
"""One exposure requirement."""


ExposureKind = Literal["local", "directional", "exterior", "allowed"]
EXPOSURE_KINDS: tuple[ExposureKind, ...] = get_args(ExposureKind)
PART_NAMES = {"directional": "segment", "allowed": "plane", "local": "piece"}
"""Names of the numbered parts of a requirement."""


def object_beyond(outwards: kinds.Vector, case: int) -> AnyExposure:
    """Return the object of a load case: all beyond the plane through p_E with that normal; air may enter."""
    x, y, z = outwards
    return Exterior(half_angle_deg=90.0, axis=(0.0 - x, 0.0 - y, 0.0 - z), solid=True, geometry=False, contact=case)


def solid_name(number: int, segment: int | None, contact: int | None) -> str:
    """Name a solid region: the number and part of its requirement, or the load case whose object it is."""
    part = "" if segment is None else f", segment {segment}"
    return f"solid exposure {number}{part}" if contact is None else f"object of load case {contact}"


def half_spaces(exposure: Iterable[AnyExposure]) -> list[Cone]:
    """Return the half-spaces of fixed direction that all airflow must stay within."""
    shapes = (shape for requirement in exposure if requirement.geometry for shape in requirement.shapes)
    cones = (shape for shape in shapes if isinstance(shape, Cone) and shape.half_angle_deg == 90)
    return [cone for cone in cones if not cone.takes_direction_from_com]


LEAST_OFFSET = 0.1
"""Smallest ||p_E|| allowed if a requirement takes its direction from p_E [l_arm]."""


def needs_offset(exposure: AnyExposure) -> bool:
    """True if a requirement takes its direction from p_E, so that it is undefined at p_E = 0."""
    return any(shape.takes_direction_from_com for shape in exposure.shapes)


def segment_of(exposure: AnyExposure, part: int) -> int | None:
    """Return the `segment` of one of a requirement's shapes in audits; None for kinds with a single shape."""
    is_single = isinstance(exposure, Exterior) or (isinstance(exposure, Local) and exposure.pieces is None)
    return None if is_single else part

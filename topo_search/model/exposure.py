"""Exposure requirements: regions at the target that the airflow must not reach (paper, Sec. III).

Points are in metres from the end-effector p_E, in the axes of the task frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise, product
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, ValidationInfo, model_validator

from topo_search.limits import LIMITS
from topo_search.model.arrays import Array
from topo_search.model.mesh_file import LARGEST_COORDINATE, convex_pieces, mesh_schema, take_mesh
from topo_search.model.shape import Capsule, Cone, Polytope, Shape, has_volume, unit
from topo_search.model.value import (
    OMIT_EMPTY,
    Broken,
    Flag,
    NonEmpty,
    NonNegative,
    Omitted,
    OneOf,
    Positive,
    PositiveVector,
    Value,
    Vector,
    at_most,
    is_zero,
    refuse,
    show,
)


def _has_direction(vector: Vector) -> Vector:
    if is_zero(vector):
        raise ValueError("must have a direction")
    if not 1e-15 <= math.hypot(*vector) <= 1e15:
        raise ValueError("must be between 1e-15 and 1e15 long")
    return vector


Direction = Annotated[Vector, AfterValidator(_has_direction)]
Axis = Annotated[Literal["com"] | Direction, OneOf('must be "com" or [x, y, z]')]


def _check_volume(vertices: tuple[Vector, ...]) -> tuple[Vector, ...]:
    if max((abs(x) for vertex in vertices for x in vertex), default=0.0) > LARGEST_COORDINATE:
        raise ValueError(f"must be at most {LARGEST_COORDINATE:g} m away")
    if not has_volume(np.array(vertices).reshape(-1, 3)):
        raise ValueError(f"must span a volume, but got {show(vertices)}")
    return vertices


def _check_thickness(box: Vector) -> Vector:
    if min(box) <= 1e-6 * max(box):
        raise ValueError(f"must not be thinner than a millionth of its length, but got {show(box)}")
    return box


Points = Annotated[tuple[Vector, ...], at_most(LIMITS.corners, "corners"), AfterValidator(_check_volume)]


Solid = Annotated[Flag, OMIT_EMPTY]
"""True if a region is a thing: a wall, a pane, an object, rather than a place that must not be blown at."""


class Region(Value):
    """Requirements that every region may state."""

    speed: Omitted[Positive] = None
    """Largest air speed in the region, in every load case, by the jet model [m/s]."""
    geometry: Annotated[Flag, Field(exclude_if=lambda given: given)] = True
    """True if airflow envelopes must keep out of the region; if false, only its `speed` is asked for."""

    @property
    def speed_reach(self) -> float | None:
        """Distance from the end-effector up to which `speed` holds [m]; None: everywhere in the region."""
        return None

    def _broken_rules(self) -> Broken:
        if not self.geometry and self.speed is None:
            yield "geometry", "must be true, or `speed` must be given"


class UnboundedRegion(Region):
    """Requirements that an unbounded region may state."""

    speed_within: Omitted[Positive] = None
    """Distance from the end-effector up to which `speed` holds [m]; without it, everywhere."""

    @property
    def speed_reach(self) -> float | None:
        """See `Region.speed_reach`."""
        return self.speed_within

    def _broken_rules(self) -> Broken:
        yield from super()._broken_rules()
        if self.speed_within is not None and self.speed is None:
            yield "speed_within", "must be left out, or `speed` must be given"


class Local(Region):
    """A region around the end-effector that no envelope may enter: a ball, a box, or convex hulls of points.

    In a task file `mesh`, the name of an STL or OBJ file with its origin at p_E, may stand for `vertices` or, where
    it has several bodies, for `pieces`: those of their hulls. The axes of boxes, points and meshes are those of the
    task frame.
    """

    model_config = ConfigDict(json_schema_extra=mesh_schema)

    kind: Literal["local"] = "local"
    radius: Omitted[Positive] = None
    """r_sph of a ball centred at p_E [m]; 0.15 if nothing else is given."""
    box: Omitted[Annotated[PositiveVector, AfterValidator(_check_thickness)]] = None
    """Edges of a box centred at p_E, along x, y and z [m]."""
    vertices: Omitted[Points] = None
    """Points whose convex hull the region is, from p_E [m]."""
    pieces: Omitted[Annotated[tuple[Points, ...], at_most(LIMITS.pieces, "pieces"), NonEmpty]] = None
    """Lists of points, each from p_E [m]: the region is the union of their convex hulls."""
    mesh_excess: Omitted[Annotated[tuple[NonNegative, ...], at_most(LIMITS.pieces)]] = None
    """Upper bound on each piece's excess over its source mesh [m]; None if there is no excess."""
    solid: Solid = False
    """True if rigid parts must stay outside too, and the rod except its tip unless p_E is inside."""

    @model_validator(mode="before")
    @classmethod
    def _one_shape(cls, data: Any, info: ValidationInfo) -> Any:
        """Fill in the default, or the corners of a mesh."""
        if not isinstance(data, dict):
            return data
        given = [name for name in ("radius", "box", "vertices", "pieces", "mesh") if data.get(name) is not None]
        if len(given) > 1:
            rule = "must have one of `radius`, `box`, `vertices`, `pieces` and `mesh`"
            refuse(((), f"{rule}, but got {' and '.join(given)}"))
        data = dict(data)
        mesh = take_mesh(data, "vertices", info.context)
        if mesh is None:
            return data if given else {**data, "radius": 0.15}
        try:
            corners, excess = convex_pieces(mesh)
        except ValueError as error:
            refuse(("mesh", str(error)))
        pieces = [points.tolist() for points in corners]
        shape = {"vertices": pieces[0]} if len(pieces) == 1 else {"pieces": pieces}
        return {**data, **shape, "mesh_excess": excess if any(excess) else None}

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The region."""
        if self.radius is not None:
            return (Capsule(self.radius),)
        return tuple(Polytope(tuple((x, y, z) for x, y, z in points.tolist())) for points in self.polytopes)

    @property
    def polytopes(self) -> tuple[Array, ...]:
        """Points whose convex hulls make up the region, from p_E, shape (k, 3) each [m]; none of a ball."""
        if self.box is not None:
            return (np.array(list(product((-0.5, 0.5), repeat=3))) * np.array(self.box),)
        return tuple(map(np.array, self.pieces or (self.vertices and (self.vertices,)) or ()))

    @property
    def corners(self) -> Array:
        """All points of its polytopes, shape (k, 3) [m]."""
        return np.concatenate([np.zeros((0, 3)), *self.polytopes])


def _path(points: tuple[Vector, ...]) -> tuple[Vector, ...]:
    if len(points) < 2:
        raise ValueError(f"must have at least two points, but got {show(points)}")
    if max(abs(x) for point in points for x in point) > LARGEST_COORDINATE:
        raise ValueError(f"must be at most {LARGEST_COORDINATE:g} m away")
    if any(math.dist(one, other) < 1e-15 for one, other in pairwise(points)):
        raise ValueError(f"must lead from each point to a different one, but got {show(points)}")
    return points


Path = Annotated[tuple[Vector, ...], at_most(LIMITS.segments, "points"), AfterValidator(_path)]


class Directional(Region):
    """Capsules along motion paths near the end-effector; no envelope may enter any of them."""

    kind: Literal["directional"] = "directional"
    radius: Positive = 0.15
    """r_sph [m]."""
    segments: Annotated[tuple[Direction, ...], at_most(LIMITS.segments), NonEmpty] | None = None
    """The end of each straight path from the end-effector, from p_E [m]."""
    polylines: Omitted[Annotated[tuple[Path, ...], at_most(LIMITS.segments), NonEmpty]] = None
    """Instead of segments: bent paths, each a list of points from p_E [m]."""
    along: Literal["end_effector"] | None = None
    """Instead of segments: one path along p_E, away from the COM."""
    length: Positive | None = None
    """Length of the path along p_E [m]."""
    solid: Solid = False
    """True if rigid parts must stay out of the capsules too."""

    def _broken_rules(self) -> Broken:
        yield from super()._broken_rules()
        forms = ("segments", "polylines", "along", "length")
        given = [name for name in forms if getattr(self, name) is not None]
        if given not in (["segments"], ["polylines"], ["along", "length"]):
            but = " and ".join(given) or "none of them"
            yield (), f"must have either `segments`, or `polylines`, or `along` with `length`, but got {but}"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """A capsule for each straight piece, by the index that is its `segment` in audits."""
        if self.length is not None:
            return (Capsule(self.radius, length=self.length),)
        paths = self.polylines or tuple(((0.0, 0.0, 0.0), end) for end in self.segments or ())
        return tuple(Capsule(self.radius, *piece) for path in paths for piece in pairwise(path))


class Exterior(UnboundedRegion):
    """Everything outside an infinite cone with its apex at p_E; all envelopes stay inside the cone."""

    kind: Literal["exterior"] = "exterior"
    half_angle_deg: Annotated[float, Field(strict=True, gt=0, le=90)] = 60.0
    """theta_con [deg]; at 90 the cone is a half-space."""
    axis: Axis = "com"
    """d_con: from p_E into the allowed cone; `com` points from p_E to the centre of mass."""
    solid: Solid = False
    """True if rigid parts, and the rod except its tip, must stay inside the cone too."""

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The cone."""
        return (Cone(self.half_angle_deg, None if self.axis == "com" else unit(self.axis)),)


class Plane(Value):
    """A half-space: normal . x is at most the offset, with x from p_E and the normal as a unit vector."""

    normal: Direction
    """Normal that points out of the half-space, of any length."""
    offset: Annotated[float, Field(strict=True, ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)] = 0.0
    """Distance of the plane from p_E along the normal [m]; negative where p_E is outside."""


class Allowed(UnboundedRegion):
    """Everything outside a convex polyhedron, which may be unbounded; all envelopes stay inside it."""

    kind: Literal["allowed"] = "allowed"
    planes: Annotated[tuple[Plane, ...], at_most(LIMITS.segments, "planes"), NonEmpty]
    """Half-spaces whose intersection it is."""
    solid: Solid = False
    """True if rigid parts, and the rod except its tip, must stay inside too."""

    def _broken_rules(self) -> Broken:
        yield from super()._broken_rules()
        farthest = max(plane.offset for plane in self.planes)
        if self.speed_within is not None and self.speed_within <= farthest:
            text = f"must be more than every plane's offset, {farthest:g} m at most, but got {self.speed_within:g}"
            yield "speed_within", text

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """A half-space for each plane, by the index that is its `segment` in audits."""
        inwards = [(unit(plane.normal), plane.offset) for plane in self.planes]
        return tuple(
            Cone(90.0, axis=(-x, -y, -z), apex=(offset * x, offset * y, offset * z))
            for (x, y, z), offset in inwards
        )


AnyExposure = Local | Directional | Exterior | Allowed
Exposure = Annotated[AnyExposure, Field(discriminator="kind")]
"""One exposure requirement."""


ExposureKind = Literal["local", "directional", "exterior", "allowed"]
EXPOSURE_KINDS: tuple[ExposureKind, ...] = get_args(ExposureKind)
PART_NAMES = {"directional": "segment", "allowed": "plane", "local": "piece"}
"""Names of the numbered parts of a requirement."""


def half_spaces(exposure: Iterable[AnyExposure]) -> list[Cone]:
    """Return the half-spaces that all airflow must stay within, if their directions are given."""
    shapes = (shape for requirement in exposure if requirement.geometry for shape in requirement.shapes)
    cones = (shape for shape in shapes if isinstance(shape, Cone) and shape.half_angle_deg == 90)
    return [cone for cone in cones if not cone.takes_direction_from_com]


LEAST_OFFSET = 0.1
"""Least ||p_E|| where a requirement takes its direction from p_E [l_arm]."""


def needs_offset(exposure: AnyExposure) -> bool:
    """True if a requirement's direction is p_E itself, so that it is undefined at p_E = 0."""
    return any(shape.takes_direction_from_com for shape in exposure.shapes)


def segment_of(exposure: AnyExposure, part: int) -> int | None:
    """Return the `segment` of one of a requirement's shapes in audits: None where there is only ever one."""
    one = isinstance(exposure, Exterior) or (isinstance(exposure, Local) and exposure.pieces is None)
    return None if one else part

r"""Printable solids: brackets, struts, ends of tubes, the rod's mount, in millimetres, each in its own frame.

| symbol | meaning | shape | unit |
|---|---|---|---|
| h, i, a, alpha | parent, child, the parent's port, the hinge angle of their joint | | -, rad |
| c | the connector, origin of a bracket's frame: x away from the parent's centre, z the parent's z | | |
| phi | turn about y from the parent's flange to the child's: alpha at ports 0 and 3, -alpha at 1 and 2 | | rad |
| r, d, t, w | half width, set-back and thickness of a flange; wall thickness (`model.bracket.Bracket`) | | m |
| v | direction of the rod in the frame of the connector that holds it | (3,) | |

R_h H_a(alpha) = R_h R_z(a pi/2) R_y(phi) R_z(-a pi/2), so the same solid fits all four ports; upside down it is the
solid for -phi. The outer face of the parent's flange is the plane x = -d; that of the child's is x = d after the
turn. On its z side, a flange has one mark hole (the parent's) or two (the child's). That side faces the upper sides
of both modules, or their lower sides if the bracket is upside down.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from manifold3d import Manifold, Mesh, OpType
from trimesh import Trimesh

from topo_search.export.poses import RodPose, rod_of
from topo_search.export.solids import pose_matrix
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.model.bracket import Bracket
from topo_search.model.design import Design
from topo_search.model.joint_mass import strut_width, tube_room
from topo_search.model.module import Module
from topo_search.model.proven import lower_text
from topo_search.model.value import BadInput, Fault
from verify.kinematics import platform, rotation

MILLIMETRES = 1000.0
SIDES = 64
"""Sides of a round hole, a polygon inscribed in the circle."""
TURNS = (1.0, -1.0, -1.0, 1.0)
"""phi / alpha at the ports 0..3."""
SLOT = 1e-3
"""Width of the slot that a clamp closes [m]."""
BALL = 1.02
"""Radius of the ball at the foot of a socket, over that of the socket."""
PLAY = 1e-4
"""Radial play of a tube in its bore [m]."""
LONGEST_PRINTED = 0.08
"""Length above which a strut is a tube [m]."""
SMALLEST_TUBE, TUBE_STEP = 0.004, 0.002
"""Smallest outer diameter of tubes, and the step of diameters, as they are sold [m]."""
DIGITS = 3
"""Decimals of angles in file names [deg]."""


@dataclass(frozen=True)
class PrintedPart:
    """A printable solid."""

    name: Literal["bracket", "rod mount", "strut", "tube end"]
    file: str
    mesh: Trimesh
    """In millimetres."""
    count: int = 1

    @property
    def volume_cm3(self) -> float:
        """[cm^3]."""
        return float(self.mesh.volume) / 1000.0

    def stl(self) -> bytes:
        """Return the content of a binary STL file."""
        content = self.mesh.export(file_type="stl")
        assert isinstance(content, bytes)  # STL is binary
        return content


def printed_parts(design: Design) -> list[PrintedPart]:
    """Return the printable solids of a design; BadInput if there is no room for brackets."""
    return [*brackets(design), *mount(design), *strut_parts(design)]


def brackets(design: Design) -> list[PrintedPart]:
    """Return the brackets, one part per size of hinge angle, with its count.

    Raises:
        BadInput: there is no room for them between a connector and the modules' centres.
    """
    module = design.task.module
    require_room(design)
    kinds = Counter(map(abs, bracket_turns(design)))
    return [
        PrintedPart("bracket", bracket_file(size), bracket(module.bracket_sizes, math.radians(size)), count)
        for size, count in sorted(kinds.items())
    ]


def modules_with_brackets(design: Design) -> tuple[Module, ...]:
    """Return the module of each node, with the brackets of the platform: they are those of `[module]` for all."""
    bracket = design.task.module.bracket_sizes
    return tuple(module.model_copy(update={"bracket": bracket}) for module in design.task.modules_of_nodes)


def bracket_turns(design: Design) -> list[float]:
    """Return phi of every joint, rounded as in file names [deg]; negative: the bracket is upside down."""
    edges = zip(design.topology.edges(), design.hinge_angles_rad, strict=True)
    return [round(TURNS[a] * math.degrees(alpha), DIGITS) for (_, _, a, _), alpha in edges]


def bracket_file(size: float) -> str:
    """Return the file name of a bracket, from the size of its angle [deg]."""
    return f"bracket_{size:.{DIGITS}f}deg.stl"


class Strut(NamedTuple):
    """Struts of one length, between a hub and brackets or the rod's mount."""

    inner: float
    """x of the hub's face, in its module's axes at port 0 [m]."""
    outer: float
    """x of the bracket's face [m]."""
    number: int
    tube: float
    """Outer diameter of the tube that spans it, between printed ends [m]; 0: printed in one piece."""
    width: float
    """Half width of the cross that is its section, if it is printed [m]."""

    @property
    def length(self) -> float:
        """[m]."""
        return self.outer - self.inner


def struts(design: Design) -> list[Strut]:
    """Return the struts that hold brackets and the rod's mount on the hub, one kind per length.

    The list is empty for a frame of the user's own, and if there is no room between the rotors.
    """
    modules, sizes = modules_with_brackets(design), design.task.module.bracket_sizes
    used_ports = [place for h, i, a, b in design.topology.edges() for place in ((h, a), (i, b))]
    if design.mount is not None and rod_of(design, platform(design)) is not None:
        used_ports.append((design.mount.module, design.mount.port))
    used = [(modules[i], port) for i, port in used_ports]
    lengths = Counter(
        (module.body.hub[port % 2] / 2, module.connector_distance - sizes.set_back, width)
        for module, port in used
        if (width := strut_width(module))
    )
    return [
        Strut(inner, outer, count, tube_diameter(sizes, outer - inner), width)
        for (inner, outer, width), count in lengths.items()
        if outer - inner > 2 * sizes.thickness
    ]


def tube_diameter(sizes: Bracket, length: float) -> float:
    """Return the outer diameter of the tube that a strut of some length takes [m]; 0: it is printed in one piece.

    Args:
        sizes: sizes of the flanges at its ends.
        length: length with both flanges [m].
    """
    diameter = TUBE_STEP * math.floor(2 * tube_room(sizes) / TUBE_STEP)
    fits = diameter >= SMALLEST_TUBE and length >= 2 * (sizes.thickness + diameter)
    return diameter if fits and length > LONGEST_PRINTED else 0.0


def strut_parts(design: Design) -> Iterator[PrintedPart]:
    """Yield the printed struts, and the ends of those that are tubes."""
    sizes = design.task.module.bracket_sizes
    ends, files = Counter[float](), Counter[str]()
    for kind in struts(design):
        if kind.tube:
            ends[kind.tube] += 2 * kind.number
        else:
            mesh = strut(sizes, kind.inner, kind.outer, kind.width)
            file = f"strut_{MILLIMETRES * kind.length:.1f}mm"
            files[file] += 1  # those of two types of module may be as long as each other
            another = f"-{files[file]}" if files[file] > 1 else ""
            yield PrintedPart("strut", f"{file}{another}.stl", mesh, kind.number)
    for diameter, count in ends.items():
        file = f"tube-end_{MILLIMETRES * diameter:g}mm.stl"
        yield PrintedPart("tube end", file, tube_end(sizes, diameter), count)


def strut(sizes: Bracket, inner: float, outer: float, width: float) -> Trimesh:
    """Return a printed strut as a closed mesh in millimetres, in its module's axes at port 0.

    It is two flanges joined by a beam with a cross as its section.

    Args:
        sizes: sizes of the flanges.
        inner: x of the hub's face [m].
        outer: x of the bracket's face [m].
        width: half width of the cross [m].
    """
    lengths = sizes.half_width, sizes.thickness, sizes.wall, inner, outer, width
    r, t, w, start, end, wide = (MILLIMETRES * x for x in lengths)
    solid = _box((start, -r, -r), (start + t, r, r)) + _box((end - t, -r, -r), (end, r, r))
    solid += _box((start, -wide, -w / 2), (end, wide, w / 2)) + _box((start, -w / 2, -wide), (end, w / 2, wide))
    for x in (start, end - t):
        solid -= _holes(sizes, x, t, marks=1)
    return _mesh(solid)


def tube_end(sizes: Bracket, diameter: float) -> Trimesh:
    """Return a flange with a socket as deep as the tube is thick, as a closed mesh in millimetres.

    The flange's outer face is the plane x = 0; the tube leaves along x.

    Args:
        sizes: sizes of the flange.
        diameter: outer diameter of the tube [m].
    """
    r, t, w, D = (MILLIMETRES * x for x in (sizes.half_width, sizes.thickness, sizes.wall, diameter))
    socket = Manifold.cylinder(t + D, D / 2 + w, circular_segments=SIDES)
    bore = Manifold.cylinder(2 * D, D / 2 + MILLIMETRES * PLAY, circular_segments=SIDES)
    solid = _box((0, -r, -r), (t, r, r)) + _move(socket, _x_from_z(0))
    return _mesh(solid - _move(bore, _x_from_z(t)) - _holes(sizes, 0, t, marks=1))


def mount(design: Design) -> Iterator[PrintedPart]:
    """Yield the mount of the end-effector's rod, if there is a rod.

    Raises:
        BadInput: the rod is too thick for a module's brackets, or there is no room for them.
    """
    poses = platform(design)
    rod = rod_of(design, poses)
    if rod is not None and design.mount is not None:
        require_room(design)
        if rod.radius > (most := tube_room(design.task.module.bracket_sizes)):
            rule = f"must be at most {lower_text(most, 2)}, so that the bolts of the rod's mount have room"
            fault = Fault("end_effector.rod_radius", f"{rule}, but got {rod.radius:g}")
            raise BadInput("the design's task", [fault])
        i, a = design.mount.module, design.mount.port
        v = (poses.R[i] @ connector_turn(a)).T @ (rod.end - rod.start) / rod.length
        shape = _mount(design.task.module.bracket_sizes, v, rod.radius, grip_of(rod))
        yield PrintedPart("rod mount", f"rod-mount_module{i}-port{a}.stl", shape)


def grip_of(rod: RodPose) -> float:
    """Return the depth of the socket that holds a rod [m]."""
    return min(6 * rod.radius, rod.length)


def require_room(design: Design) -> None:
    """Reject brackets that reach the modules' centres, and those of cycles."""
    module = design.task.module
    if design.topology.closures:
        rule = "must be a tree for brackets and sheets: what loads the joints of a cycle is not known"
        raise BadInput("the design", [Fault("topology", rule)])
    d, l_c = module.bracket_sizes.set_back, min(kind.connector_distance for kind in design.task.types)
    if d >= l_c:
        rule = (
            "must be smaller: `bolt_circle / 2 + bolt_diameter / 2 + thickness + 2 wall < connector_distance` must "
            f"hold, but got {d:.6g} for a connector_distance of {l_c:g}"
        )
        if module.bracket is None:
            rule = (
                "must be stated: the module is too small for its own brackets, whose M1.6 bolts are the smallest; "
                f"they take {MILLIMETRES * d:.3g} mm of a connector_distance of {MILLIMETRES * l_c:.3g} mm"
            )
        raise BadInput("the design's task", [Fault("module.bracket", rule)])


def connector_turn(port: int) -> Array:
    """Return the axes of a connector's frame in the axes of its module, (3, 3)."""
    x = PORT_DIRECTIONS[port]
    return np.stack([x, np.cross([0.0, 0.0, 1.0], x), [0.0, 0.0, 1.0]], axis=1)


def bracket(sizes: Bracket, phi: float) -> Trimesh:
    """Return the bracket for a turn phi as a closed mesh, in millimetres."""
    r, d, t, w = (MILLIMETRES * x for x in (sizes.half_width, sizes.set_back, sizes.thickness, sizes.wall))
    # As d > r, neither end reaches beyond the other's mating face.
    turned = pose_matrix(rotation(1, phi), np.zeros(3))
    parent_flange = _box((-d, -r, -r), (-d + t, r, r))
    child_flange = _box((d - t, -r, -r), (d, r, r))
    solid = parent_flange + _move(child_flange, turned)
    for y in (-r, r - w):
        slabs = [_box((x, y, -r), (x + t, y + w, r)) for x in (-d, d - t)]
        solid += Manifold.batch_hull([slabs[0], _move(slabs[1], turned)])
    solid -= _holes(sizes, -d, t, marks=1)
    solid -= _move(_holes(sizes, d - t, t, marks=2), turned)
    return _mesh(solid)


def _mount(sizes: Bracket, v: Array, radius: float, grip: float) -> Trimesh:
    """Return a flange with a socket for a rod from c along v, with a clamp at the socket's end."""
    r, d, t = (MILLIMETRES * x for x in (sizes.half_width, sizes.set_back, sizes.thickness))
    bore, outside = MILLIMETRES * (radius + PLAY), MILLIMETRES * (radius + sizes.wall)
    reach = MILLIMETRES * grip
    pose = pose_matrix(_clamp_axes(v), np.zeros(3))
    foot = _move(Manifold.cylinder(t, outside, circular_segments=SIDES), _x_from_z(-d))
    # a ball as thick as the socket would touch it all around, and leave slivers
    ball = Manifold.sphere(BALL * outside, SIDES)
    socket = Manifold.cylinder(reach, outside, circular_segments=SIDES)
    if has_clamp(sizes, grip):
        ears, gap = _clamp(sizes, outside, reach)
        socket = socket + ears - gap
    behind = _box((-6 * d, -6 * d, -6 * d), (-d, 6 * d, 6 * d))
    solid = _box((-d, -r, -r), (-d + t, r, r)) + Manifold.batch_hull([foot, ball]) + (_move(socket, pose) - behind)
    solid -= _move(Manifold.cylinder(2 * reach, bore, circular_segments=SIDES), pose)
    return _mesh(solid - _holes(sizes, -d, t, marks=1))


def has_clamp(sizes: Bracket, grip: float) -> bool:
    """Return true if a socket of this depth [m] has room for ears with a bolt."""
    return grip >= sizes.bolt_diameter + 2 * sizes.wall


def _clamp_axes(v: Array) -> Array:
    """Return the axes of a clamp: z along the rod, x towards the ears, which point up or else outwards."""
    upwards = np.array([0.0, 0.0, 1.0]) - v[2] * v
    # nearly upright rods, at a sine below 0.3, have no upper side
    x = upwards if np.linalg.norm(upwards) > 0.3 else np.array([1.0, 0.0, 0.0]) - v[0] * v
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(v, x), v], axis=1)


def _clamp(sizes: Bracket, outside: float, reach: float) -> tuple[Manifold, Manifold]:
    """Return the ears at the end of a socket, and the cut-out: the slot, and the hole of the clamp bolt [mm]."""
    hole, w, slot = (MILLIMETRES * x for x in (sizes.bolt_diameter, sizes.wall, SLOT))
    ear, half = hole + 2 * w, w + slot / 2
    ears = _box((0.0, -half, reach - ear), (outside + ear, half, reach))
    gap = _box((0.0, -slot / 2, reach - ear), (outside + ear + 1.0, slot / 2, reach + 1.0))
    bolt = Manifold.cylinder(2 * half + 2.0, hole / 2, circular_segments=SIDES, center=True)
    turned = pose_matrix(rotation(0, math.pi / 2), np.array([outside + ear / 2, 0.0, reach - ear / 2]))
    return ears, gap + _move(bolt, turned)


def _holes(sizes: Bracket, x: float, t: float, *, marks: int) -> Manifold:
    """Return the bolt and mark holes through a flange from x to x + t."""
    s, apart = sizes.bolt_circle / 2 / math.sqrt(2), sizes.bolt_diameter
    circles = [(centre, apart / 2) for centre in ((s, s), (-s, s), (-s, -s), (s, -s))]
    circles += [(((k - (marks - 1) / 2) * apart, sizes.bolt_circle / 2), apart / 4) for k in range(marks)]
    holes = []
    for (y, z), radius in circles:
        hole = Manifold.cylinder(t + 2.0, MILLIMETRES * radius, circular_segments=SIDES)
        holes.append(_move(hole, _x_from_z(x - 1.0)).translate((0.0, MILLIMETRES * y, MILLIMETRES * z)))
    return Manifold.batch_boolean(holes, OpType.Add)


def _x_from_z(x: float) -> Array:
    return pose_matrix(np.round(rotation(1, math.pi / 2)), np.array([x, 0.0, 0.0]))


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Manifold:
    size = np.subtract(high, low)
    return Manifold.cube(tuple(size.tolist())).translate(low)


def _move(solid: Manifold, pose: Array) -> Manifold:
    return solid.transform(pose[:3])


def _mesh(solid: Manifold) -> Trimesh:
    mesh: Mesh = solid.to_mesh()
    return Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts, process=False)

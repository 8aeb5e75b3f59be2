"""A design in 3-D: its parts and their meshes, for the page and for Plotly figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from topo_search.export import palette, solids
from topo_search.export.poses import azimuth_deg, cone_slant, connector, kind_of, kinds, shapes, towards_viewer
from topo_search.export.solids import cylinder, join
from topo_search.model import PORT_DIRECTIONS, Array, Assembly, Clearance, Design, Module, Status
from topo_search.model.exposure import EXPOSURE_KINDS
from topo_search.model.mesh import Mesh, cone_sphere, revolve, rotation_to
from topo_search.report import ON_ANY_PAGE
from topo_search.report.wording import clearance
from verify.kinematics import Platform

if TYPE_CHECKING:
    import plotly.graph_objects as go

TURN = math.radians(300)
"""Angle that the arrow of a torque spans [rad]."""
NUMBERED = 30
"""Largest number of modules that are numbered in the picture; in larger ones only tooltips show the number."""
UP = np.array([0.0, 0.0, 1.0])
VIOLATED = "violated pair"
"""Name in the legend of the volumes and the region of a violated pair."""
IN_REGION = (*EXPOSURE_KINDS, "part-region", "rod-region")
"""Kinds of pairs of which one volume is a region."""
SPINS = {-1.0: "counter-clockwise rotors", 1.0: "clockwise rotors"}
"""Spin of rotors seen from above, by the sign of their drag torque, which opposes it."""


class Part(NamedTuple):
    """A mesh of one colour, either in the axes of the task or copied into the frames of modules."""

    kind: str
    name: str
    """Name in the legend."""
    colour: str
    mesh: Mesh | str
    """The mesh itself; for copies, the name of a mesh that all modules share."""
    modules: Sequence[int] = ()
    """Module of each copy."""
    steps: Sequence[int] = (0,)
    """Assembly step from which each copy is shown."""
    opacity: float = 1.0

    def dump(self) -> dict[str, Any]:
        """Return the part as JSON data for the page."""
        return {**self._asdict(), "mesh": self.mesh if isinstance(self.mesh, str) else triangles_of(self.mesh)}


def scene(
    design: Design, poses: Platform, nearest: Clearance | None = None, assembly: Assembly | None = None
) -> Iterator[Part]:
    """Yield the parts of the picture of a design.

    Args:
        design: any design.
        poses: its poses.
        nearest: the clearance to mark; None without an audit.
        assembly: the connector that holds the rod, and blocked connectors; None without an audit.
    """
    violated = nearest if nearest is not None and nearest.status is Status.VIOLATED else None
    types = kinds(design)
    flying = [kind for kind in types if kind.module.rotor_table.count]
    for kind, copies in ((kind, (kind.nodes, kind.nodes)) for kind in flying):
        yield Part("airflow", "airflow", palette.AIRFLOW, f"airflow{kind.suffix}", *copies, 0.2)
    yield from _regions(design, poses, violated)
    for kind in types:
        name = kind.name or "modules"
        yield Part("modules", name, kind.colour, f"modules{kind.suffix}", kind.nodes, kind.nodes)
    for kind, copies in ((kind, (kind.nodes, kind.nodes)) for kind in flying):
        for q in range(kind.module.rotor_table.count):
            yield Part("rotors", "rotors", palette.ROTOR, f"rotor {q}{kind.suffix}", *copies, 0.6)
        for (drag, name), colour in zip(SPINS.items(), palette.SPINS, strict=True):
            if -drag in kind.module.rotor_table.spins:
                yield Part("spin", name, colour, f"{name}{kind.suffix}", *copies)
        yield Part("axes", "thrust axes", palette.THRUST_AXIS, f"axes{kind.suffix}", *copies)
    yield from _connectors(design, assembly)
    yield from _end_effector(design, poses, assembly)
    if nearest is not None and nearest.closest_m is not None:
        start, end = np.array(nearest.closest_m)
        r = 0.08 * design.task.module.arm_length
        mark = join([tube(start, end, r / 4), ball(start, r), ball(end, r)])
        if violated is None:
            yield Part("closest", "closest pair", palette.CLOSEST_PAIR, mark)
        else:
            yield Part("violated", VIOLATED, palette.NOT_CLEAR, mark)
            for kind in flying:
                if air := [i for i in _airflow_of(violated) if i in kind.nodes]:
                    yield Part("violated", VIOLATED, palette.NOT_CLEAR, f"airflow{kind.suffix}", air, air, 0.4)


def _airflow_of(pair: Clearance) -> list[int]:
    """Return the modules whose airflow is one of a pair's volumes."""
    if pair.kind in EXPOSURE_KINDS:
        return [pair.a]
    return {"airflow": [pair.a, pair.b]}.get(pair.kind, [pair.b] if pair.kind.endswith("-airflow") else [])


def figure(design: Design, poses: Platform, nearest: Clearance | None, assembly: Assembly | None) -> go.Figure:
    """Return the picture as a Plotly figure; see `scene`."""
    import plotly.graph_objects as go  # slow to import, and not needed for pages

    shared = meshes_of(design)
    drawn, named = go.Figure(), set()
    for part in scene(design, poses, nearest, assembly):
        mesh = part.mesh
        if isinstance(mesh, str):
            mesh = join([shared[mesh].move(poses.R[i], poses.p[i]) for i in part.modules])
        drawn.add_mesh3d(
            **dict(zip("xyzijk", (*mesh.vertices.astype(np.float32).T, *mesh.faces.T), strict=True)),
            name=part.name,
            legendgroup=part.name,
            showlegend=part.name not in named,
            hoverinfo="name",
            color=part.colour,
            opacity=part.opacity,
            flatshading=True,
            meta={"part": part.kind},
        )
        named.add(part.name)
    eye = dict(zip("xyz", (2.0 * towards_viewer(azimuth_deg(poses))).tolist(), strict=True))
    axis = {"showbackground": False, "gridcolor": "#dddddd", "zerolinecolor": "#bbbbbb", "showspikes": False}
    axes = {f"{name}axis": {**axis, "title": {"text": f"{name} [m]"}} for name in "xyz"}
    drawn.update_layout(
        ON_ANY_PAGE,
        scene={"aspectmode": "data", "camera": {"eye": eye}, **axes},
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        legend={"orientation": "h", "yanchor": "top", "y": 0.0, "itemsizing": "constant"},
    )
    return drawn


def closest_words(nearest: Clearance) -> str:
    """Return the smallest clearance in words."""
    spare = " beyond the required distance" if nearest.kind in ("separation", "exclusion") else ""
    which = "violated" if nearest.status is Status.VIOLATED else "closest"
    return f"The {which} pair: {clearance(nearest)}{spare}, {nearest.name}."


def meshes(module: Module, *, sides: int) -> dict[str, Mesh]:
    """Return the meshes that all modules share, in the module frame, by name.

    Args:
        module: the module.
        sides: number of sides of a circle.
    """
    l_arm, l_c, body = module.arm_length, module.connector_distance, module.body
    rotors, height = module.rotor_table, body.rotor_height / 2
    by_name = {"modules": solids.frame(module)}
    if rotors.count:
        by_name["airflow"] = solids.airflow(module, sides=sides)
    by_name |= {f"rotor {q}": disc for q, disc in enumerate(solids.rotor_discs(module, sides=sides))}
    for drag, name in SPINS.items():
        turning = [
            ring(l_arm * hub + height * axis, -drag * axis, 0.7 * radius, 0.05 * radius)[0]
            for hub, axis, radius, spin in zip(
                rotors.positions, rotors.axes, module.rotor_radii, rotors.spins, strict=True
            )
            if spin == -drag
        ]
        if turning:
            by_name[name] = join(turning)
    by_name["axes"] = straight_arrow(np.zeros(3), UP, 1.3 * l_arm, 0.03 * l_arm)[0]
    for port, direction in enumerate(PORT_DIRECTIONS):
        by_name[f"joint {port}"] = tube(np.zeros(3), l_c * direction, 0.6 * body.arm_width)
        by_name[f"connector {port}"] = ball(l_c * direction, 0.6 * body.arm_width)
    return by_name


def shared_meshes(design: Design) -> dict[str, Any]:
    """Return the meshes that all modules of a design share, as JSON data for the page."""
    return {name: triangles_of(mesh) for name, mesh in meshes_of(design).items()}


def meshes_of(design: Design) -> dict[str, Mesh]:
    """Return the meshes that all modules of a type share, by name, and by type where there are types."""
    detail = sides(design.topology.n)
    return {
        name + kind.suffix: mesh
        for kind in kinds(design)
        for name, mesh in meshes(kind.module, sides=detail).items()
    }


def sides(n: int) -> int:
    """Return the number of sides of a circle: fewer than in exported files, and fewer still for many modules."""
    return 24 if n <= NUMBERED else 12


def _regions(design: Design, poses: Platform, violated: Clearance | None) -> Iterator[Part]:
    """Yield the exposure regions: solid objects, keep-out regions, cones that must contain all airflow."""
    in_the_way = violated.b if violated is not None and violated.kind in IN_REGION else None
    looks: dict[tuple[str, str, str, float], list[Mesh]] = {}
    for number, shape in shapes(design.task, poses.p_e):
        solid, half_spaces = design.task.exposure[number].solid, shape.half_spaces()
        surface, colour = shape.mesh(cone_slant(design, poses)), palette.EXPOSURE
        if solid and len(half_spaces) == 1:
            surface, colour = _wall(*half_spaces[0], poses), palette.WALL
            kind, words, opacity = "walls", "ground" if half_spaces[0][1] @ UP > 0.9 else "solid region", 0.6
        elif shape.contains_airflow:
            kind, words, opacity = "cones", shape.words, 0.15
        elif solid:
            kind, words, opacity = "solids", f"solid {shape.words}", 0.9
        else:
            kind, words, opacity = "regions", shape.words, 0.2
        if number == in_the_way:
            kind, words, colour = "violated", VIOLATED, palette.NOT_CLEAR
        looks.setdefault((kind, words, colour, opacity), []).append(surface)
    for (kind, words, colour, opacity), surfaces in sorted(looks.items(), key=lambda look: look[0]):
        yield Part(kind, words, colour, join(surfaces).move(np.eye(3), poses.end_effector), opacity=opacity)


def _wall(point: Array, inwards: Array, poses: Platform) -> Mesh:
    """Return part of the plane that bounds a half-space, scaled to the platform's distance from its tip."""
    width = 1.2 * float(np.linalg.norm(poses.p - poses.end_effector, axis=1).max())
    slab = solids.box((width, width, 0.02 * width))
    return slab.move(rotation_to(inwards), point - 0.01 * width * inwards)


def _connectors(design: Design, assembly: Assembly | None) -> Iterator[Part]:
    """Yield the joints, the free connectors, and the connectors from which no straight rod reaches the tip."""
    joined = [(port, module, i) for h, a, i, b in design.topology.bolts for module, port in ((h, a), (i, b))]
    end_effector = None if assembly is None else assembly.end_effector
    blocked_connectors = {
        (x.module, x.port) for x in (() if end_effector is None else end_effector.connectors) if x.blocked_by
    }
    free = [(port, module, module) for module, port in sorted(design.topology.free_connectors)]
    blocked = [copy for copy in free if copy[1::-1] in blocked_connectors]
    suffixes = {i: kind.suffix for kind in kinds(design) for i in kind.nodes}
    open_ = [copy for copy in free if copy[1::-1] not in blocked_connectors]
    for kind, mesh, name, colour, copies in (
        ("joints", "joint", "joints", palette.CONNECTOR, joined),
        ("connectors", "connector", "free connectors", palette.FREE_PORT, open_),
        ("connectors", "connector", "connectors blocked for the rod", palette.BLOCKED_PORT, blocked),
    ):
        for port, suffix in sorted({(port, suffixes[i]) for port, i, _ in copies}):
            chosen = (copy[1:] for copy in copies if (copy[0], suffixes[copy[1]]) == (port, suffix))
            modules, steps = zip(*chosen, strict=True)
            yield Part(kind, name, colour, f"{mesh} {port}{suffix}", modules, steps)


def _end_effector(design: Design, poses: Platform, assembly: Assembly | None) -> Iterator[Part]:
    """Yield the rod, or a line from the centre of mass without one, and both points, shown from the last step."""
    tip, last = poses.end_effector, (design.topology.n,)
    mount = design.mount if assembly is None else assembly.mount
    if mount is not None:
        i, port = mount.module, mount.port
        rod = tube(connector(design, poses, i, port), tip, design.task.end_effector.rod_radius)
        yield Part("rod", "rod", palette.END_EFFECTOR, rod, steps=last)
        yield Part("rod", "rod", palette.END_EFFECTOR, f"joint {port}{kind_of(design, i).suffix}", [i], last)
    r = 0.12 * design.task.module.arm_length
    yield Part("tip", "end-effector", palette.END_EFFECTOR, ball(tip, r), steps=last)
    yield Part("tip", "centre of mass", palette.CENTRE_OF_MASS, ball(poses.p_com, r), steps=last)
    if mount is None:
        line = tube(poses.p_com, tip, 0.2 * r)
        yield Part("offset", "centre of mass to tip", palette.OFFSET, line, steps=last)


def triangles_of(mesh: Mesh) -> dict[str, list[float]]:
    """Return a mesh as JSON data for the page, with vertices duplicated at sharp edges."""
    from scipy.sparse import coo_array  # slow to import, and pages without a view need none
    from scipy.sparse.csgraph import connected_components

    first, second, third = mesh.triangles.transpose(1, 0, 2)
    normals = np.cross(second - first, third - first)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    sides = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)) @ [len(mesh.vertices), 1]
    _, edges, counts = np.unique(sides, return_inverse=True, return_counts=True)
    order = np.argsort(edges, kind="stable")
    one, other = (order[counts[edges[order]] == 2] // 3).reshape(-1, 2).T  # adjacent triangles
    # 46 deg: adjacent sides of an octagon are shaded smoothly
    smooth = np.einsum("fx,fx->f", normals[one], normals[other]) > math.cos(math.radians(46))
    one, other = one[smooth], other[smooth]
    adjacent = coo_array((np.ones(len(one)), (one, other)), shape=(len(mesh.faces),) * 2)
    _, parts = connected_components(adjacent)  # each triangle's smooth part
    size = len(mesh.vertices)
    corners, faces = np.unique(parts.repeat(3) * size + mesh.faces.ravel(), return_inverse=True)
    return {"corners": mesh.vertices[corners % size].round(5).ravel().tolist(), "faces": faces.tolist()}


def ball(centre: Array, radius: float) -> Mesh:
    """Return a ball."""
    return cone_sphere(centre, radius, centre, radius, sides=16)


def tube(start: Array, end: Array, radius: float) -> Mesh:
    """Return a tube with round ends."""
    return cone_sphere(start, radius, end, radius, sides=12)


def straight_arrow(start: Array, direction: Array, length: float, thick: float) -> tuple[Mesh, Array]:
    """Return a straight arrow and its tip, (3,) [m].

    Args:
        start: start of the arrow, (3,) [m].
        direction: unit vector, (3,).
        length: length of the arrow [m].
        thick: radius of the shaft [m].
    """
    head = min(5 * thick, length / 2)
    shaft = cylinder(thick, length - head, 10).move(np.eye(3), (length - head) / 2 * UP)
    tip = arrow_head(thick, head).move(np.eye(3), (length - head) * UP)
    return join([shaft, tip]).move(rotation_to(direction), start), start + length * direction


def ring(centre: Array, axis: Array, radius: float, thick: float) -> tuple[Mesh, Array]:
    """Return an arrow along a ring about an axis, by the right-hand rule, and its start, (3,) [m]."""
    angles = np.linspace(0.0, TURN, 25)
    path = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    chords = np.diff(path, axis=0)
    length = float(np.linalg.norm(chords[0]))
    step = cylinder(thick, length, 8)
    steps = [step.move(rotation_to(chord / length), p + chord / 2) for p, chord in zip(path, chords, strict=False)]
    forward = np.array([-math.sin(TURN), math.cos(TURN), 0.0])
    head = arrow_head(thick, 5 * thick).move(rotation_to(forward), path[-1])
    return join([*steps, head]).move(rotation_to(axis), centre), centre + rotation_to(axis) @ path[0]


def arrow_head(thick: float, length: float) -> Mesh:
    """Return the head of an arrow along z with a shaft of radius `thick`, from the origin."""
    return revolve(np.array([[0.0, 0.0], [2.4 * thick, 0.0], [0.0, length]]), 10)

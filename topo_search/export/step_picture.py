r"""Perspective pictures of a platform as it grows, as SVG: faces sorted by depth, what is new in a dark colour.

| symbol | meaning | shape | unit |
|---|---|---|---|
| v | unit vector towards the viewer | (3,) | |
| D | distance of the viewer from the middle of what is shown | | m |
| q | depth of a point, its component along v from the middle | | m |

A point is shown D / (D - q) times as large as in the plane of the middle.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from trimesh import Trimesh

from topo_search.export import brackets
from topo_search.export.poses import azimuth_deg, connector, rod_of
from topo_search.export.solids import box, cylinder, frame
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.mesh import Mesh, circle, rotation_to
from verify.kinematics import Platform, platform

NEW, NEW_ROTOR = "#b3390f", "#e88e6b"
BUILT, BUILT_ROTOR = "#c8c8c8", "#ececec"
"""Colours of what a step adds and of what is there; dark and light in grey, too."""
ELEVATION = math.radians(40)
"""Angle of v above the horizontal, from where numbers on hubs are seen [rad]."""
DISTANCE = 4.0
"""D over the size of what is shown."""


class Face(NamedTuple):
    """A polygon to draw."""

    corners: Array
    """(c, 3) [m]."""
    colour: str
    two_sided: bool = False


class Label(NamedTuple):
    """A number beside a part."""

    at: Array
    """(3,) [m]."""
    text: str
    is_module: bool


def step_picture(design: Design, count: int, *, with_rod: bool = False) -> str:
    """Return the platform of the first modules, the last of them new, or with the rod as what is new."""
    poses, edges = platform(design), [*design.topology.edges()][: count - 1]
    faces, labels = list[Face](), list[Label]()
    for i in range(count):
        faces += _module(design, poses, i, is_new=i == count - 1 and not with_rod)
        labels.append(Label(poses.p[i], str(i), is_module=True))
    for k, (h, i, a, b) in enumerate(edges):
        is_new = k == len(edges) - 1 and not with_rod
        faces += _joint(design, poses, k, NEW if is_new else BUILT)
        if is_new:
            labels += [Label(_port(design, poses, j, port, 0.62), str(port), False) for j, port in ((h, a), (i, b))]
    rod = rod_of(design, poses)
    if with_rod and rod is not None and design.mount is not None:
        v = (rod.end - rod.start) / rod.length
        tube = cylinder(rod.radius, rod.length, 8).move(rotation_to(v), (rod.start + rod.end) / 2)
        faces += [*_strut(design, poses, design.mount.module, design.mount.port, NEW), *_faces(tube, NEW)]
        for part in brackets.mount(design):
            faces += _part(part.mesh, design, poses, design.mount.module, design.mount.port, NEW)
        mount = _port(design, poses, design.mount.module, design.mount.port, 0.62)
        labels += [Label(mount, str(design.mount.port), False), Label(rod.end, "E", is_module=True)]
    words = f"step {count - 1 + with_rod}: " + ("the rod" if with_rod else f"module {count - 1}")
    azimuth = math.radians(azimuth_deg(poses))
    v = np.array([*(math.cos(ELEVATION) * np.array([math.cos(azimuth), math.sin(azimuth)])), math.sin(ELEVATION)])
    return _svg(faces, labels, v, words)


def _module(design: Design, poses: Platform, i: int, *, is_new: bool) -> Iterator[Face]:
    module, R, p = design.task.modules_of_nodes[i], poses.R[i], poses.p[i]
    yield from _faces(frame(module).move(R, p), NEW if is_new else BUILT)
    hubs = poses.rotors[i] + poses.p_com
    # inputs, and rotors of poses, have as many columns as the type with the most rotors
    for centre, radius, axis in zip(hubs, module.rotor_radii, poses.thrust_axes[i], strict=False):
        rim = circle(centre, radius, axis, points=24)
        yield Face(rim, NEW_ROTOR if is_new else BUILT_ROTOR, two_sided=True)


def _joint(design: Design, poses: Platform, k: int, colour: str) -> Iterator[Face]:
    """Yield the bracket of a joint and its struts."""
    h, i, a, b = [*design.topology.edges()][k]
    phi = math.radians(brackets.bracket_turns(design)[k])
    yield from _part(brackets.bracket(design.task.module.bracket_sizes, phi), design, poses, h, a, colour)
    yield from _strut(design, poses, h, a, colour)
    yield from _strut(design, poses, i, b, colour)


def _part(solid: Trimesh, design: Design, poses: Platform, i: int, port: int, colour: str) -> Iterator[Face]:
    """Yield the hull of a printed solid at a connector [mm]."""
    hull = solid.convex_hull
    mesh = Mesh(np.asarray(hull.vertices) / brackets.MILLIMETRES, np.asarray(hull.faces))
    turn, c = poses.R[i] @ brackets.connector_turn(port), _port(design, poses, i, port, 1.0)
    yield from _faces(mesh.move(turn, c), colour)


def _strut(design: Design, poses: Platform, i: int, port: int, colour: str) -> Iterator[Face]:
    """Yield what joins a module's hub to its mating face at a port."""
    module = design.task.modules_of_nodes[i]
    inner = module.body.hub[port % 2] / 2
    outer = module.connector_distance - design.task.module.bracket_sizes.set_back
    if outer > inner:
        bar = box((outer - inner, module.body.arm_width / 2, module.body.arm_width / 2))
        turn = poses.R[i] @ brackets.connector_turn(port)
        yield from _faces(bar.move(turn, poses.p[i] + turn[:, 0] * (inner + outer) / 2), colour)


def _port(design: Design, poses: Platform, i: int, port: int, share: float) -> Array:
    """Return a point on the way from a module's centre to its connector, (3,) [m]."""
    return np.asarray(poses.p[i] + share * (connector(design, poses, i, port) - poses.p[i]))


def _faces(mesh: Mesh, colour: str) -> Iterator[Face]:
    return (Face(triangle, colour) for triangle in mesh.triangles)


def _svg(faces: Sequence[Face], labels: Iterable[Label], v: Array, words: str) -> str:
    """Return faces and labels as SVG, seen from v."""
    points = np.concatenate([face.corners for face in faces])
    middle, size = (points.min(axis=0) + points.max(axis=0)) / 2, float(np.ptp(points, axis=0).max())
    right = np.cross([0.0, 0.0, 1.0], v) / math.hypot(v[0], v[1])
    axes, D = np.stack([right, np.cross(v, right)], axis=1), DISTANCE * size

    def project(corners: Array) -> Array:
        off = (corners - middle) @ axes * [1, -1]
        return np.asarray(1000 * off * (D / (D - (corners - middle) @ v))[:, None])

    light = v + 0.5 * right + np.array([0.0, 0.0, 0.8])
    light /= np.linalg.norm(light)
    drawn = list[tuple[float, str]]()
    for corners, colour, two_sided in faces:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        towards = (middle + D * v - corners.mean(axis=0)) @ normal
        if towards <= 0 and not two_sided:
            continue
        shade = 0.65 + 0.35 * max(0.0, float(normal @ light))
        red, green, blue = (round(shade * int(colour[k : k + 2], 16)) for k in (1, 3, 5))
        fill = f"#{red:02x}{green:02x}{blue:02x}"
        edge = f'stroke="{"#333" if two_sided else fill}" stroke-width="{size:.3g}"'
        outline = " ".join(f"{x:.1f},{y:.1f}" for x, y in project(corners))
        opacity = ' fill-opacity="0.6"' if two_sided else ""
        polygon = f'<polygon points="{outline}" fill="{fill}"{opacity} {edge}/>'
        drawn.append((float((corners.mean(axis=0) - middle) @ v), polygon))
    flat = project(points)
    low, high = flat.min(axis=0), flat.max(axis=0)
    radius = 0.034 * float(max(high - low))
    low, high = low - 2 * radius, high + 2 * radius
    box_of_view = " ".join(f"{x:.1f}" for x in (*low, *(high - low)))
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box_of_view}" class="step" role="img" '
    head += f'aria-label="{words}">'
    svg = [head, *(polygon for _, polygon in sorted(drawn))]
    for at, text, is_module in sorted(labels, key=lambda label: label.is_module):
        ((x, y),) = project(at[None])
        r, paper, ink = (radius, "#111", "#fff") if is_module else (0.75 * radius, "#fff", "#111")
        svg.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}" fill="{paper}" stroke="#111"/>')
        style = f'font-size="{1.4 * r:.1f}" font-weight="bold" text-anchor="middle" fill="{ink}"'
        svg.append(f'<text x="{x:.1f}" y="{y + 0.5 * r:.1f}" {style}>{text}</text>')
    return "".join([*svg, "</svg>"])

"""A picture of a design, drawn without a display: the platform with its airflow, a close-up, and its tree.

It follows the paper's figures: 3-D matplotlib axes, in metres, along the axes of the task frame W.
"""

import io
import itertools
import math
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from matplotlib import patheffects, style
from matplotlib.artist import Artist
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from topo_search.export import PAPER, TWO_COLUMNS, palette, solids
from topo_search.export import poses as geometry
from topo_search.export.air_field import AirSurface
from topo_search.export.tree_drawing import draw_tree
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.files import write_atomically
from topo_search.model.mesh import circle, cone_sphere, cone_sphere_outline
from topo_search.model.proven import gap_percent
from verify.kinematics import Platform

Kind = Literal["png", "svg", "pdf"]


def draw(design: Design, path: str | Path) -> None:
    """Write a picture of a design.

    Args:
        design: any design, audited or not.
        path: the file, which ends in `.png`, `.svg` or `.pdf`; its folder is created if necessary.

    Raises:
        ValueError: the file has another suffix.
        BadInput: the end-effector is too far away to be drawn to scale.
    """
    save(figure_of(design), path)


def picture(design: Design, kind: Kind, air: AirSurface | None = None) -> bytes:
    """Return a picture of a design as the content of a file; `air` replaces the envelopes.

    Raises:
        BadInput: the end-effector is too far away to be drawn to scale.
    """
    return content(figure_of(design, air), kind)


png = partial(picture, kind="png")
svg = partial(picture, kind="svg")
pdf = partial(picture, kind="pdf")


@style.context(PAPER)
def figure_of(design: Design, air: AirSurface | None = None) -> Figure:
    """Return the picture as a matplotlib figure across two columns; `air` replaces the envelopes."""
    figure = Figure(figsize=(TWO_COLUMNS, 5.0))
    figure.set_layout_engine("none")  # all parts have their place
    poses = geometry.poses_to_draw(design)
    whole = Drawing(figure.add_axes((0.0, 0.16, 0.5, 0.76), projection="3d"), design, poses)
    whole.exposure()
    if air is None:
        whole.airflow()
    else:
        whole.air(air)
    whole.platform()
    whole.finish()
    close_up = Drawing(figure.add_axes((0.51, 0.50, 0.48, 0.42), projection="3d"), design, poses)
    close_up.platform()
    close_up.load_cases()
    close_up.finish()
    close_up.number_modules()
    draw_tree(figure.add_axes((0.58, 0.16, 0.35, 0.28)), design)
    key = design.topology.key
    for x, y, text in (
        (0.25, 0.93, "airflow" if air is None else air.words),
        (0.75, 0.93, "platform and load cases"),
        (0.75, 0.455, f"topology {key}" if len(key) <= 44 else f"topology {key[:40]}..."),
    ):
        figure.text(x, y, text, ha="center")
    figure.suptitle(title(design), y=0.99)
    figure.legend(handles=_legend(design, air), loc="lower center", ncols=4)
    return figure


def title(design: Design) -> str:
    """Return one line with the task's name, size, control effort and gap."""
    mantissa, exponent = f"{design.objective:.3e}".split("e")
    parts = [
        design.task.name,
        f"$n$ = {design.topology.n}",
        rf"$J$ = {mantissa}$\times$10$^{{{int(exponent)}}}$ rad$^4$/s$^4$",
    ]
    if design.gap is not None:
        parts.append(f"gap {gap_percent(design.gap)}")
    return "   ".join(parts)


def _legend(design: Design, air: AirSurface | None) -> list[Artist]:
    def dot(colour: str, label: str) -> Artist:
        return Line2D([], [], marker="o", linestyle="", color=colour, markeredgecolor="black", label=label)

    def volume(colour: str, alpha: float, label: str) -> Artist:
        return Patch(facecolor=(colour, alpha), edgecolor=colour, label=label)

    entries: list[Artist] = [
        *(Patch(color=kind.colour, label=kind.words) for kind in geometry.kinds(design)),
        Line2D([], [], color=palette.THRUST_AXIS, marker=">", label="thrust axis"),
        Line2D([], [], color=palette.CONNECTOR, linewidth=2, label="joint (hinge angle)"),
        Line2D([], [], marker="s", linestyle="", color=palette.FREE_PORT, label="free connector"),
        Line2D([], [], marker=".", linestyle="", color=palette.THRUST_AXIS, label="side of port $+x$"),
        volume(palette.AIRFLOW, 0.3, "airflow envelope") if air is None else volume(palette.AIR, 0.3, "air"),
        dot(palette.END_EFFECTOR, "end-effector"),
        dot(palette.CENTRE_OF_MASS, "centre of mass"),
        Line2D([], [], color=palette.END_EFFECTOR, linewidth=2.5, label="rod and its mount"),
    ]
    entries += [
        Line2D([], [], color=palette.CASES[k], marker=">", label=f"load case {k}")
        for k in sorted({k for k, *_ in wrenches(design, geometry.poses_to_draw(design))})
    ]
    regions = [shape for exposure in design.task.exposure for shape in exposure.shapes]
    kinds = {shape.words: 0.12 if shape.contains_airflow else 0.3 for shape in regions}
    entries += [volume(palette.EXPOSURE, opacity, words) for words, opacity in sorted(kinds.items())]
    return entries


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure to a `.png`, `.svg` or `.pdf` file; ValueError for another suffix."""
    path = Path(path)
    kind = path.suffix.removeprefix(".").lower()
    if kind not in get_args(Kind):
        raise ValueError(f"the picture's name must end in .png, .svg or .pdf, but got {path.name}")
    write_atomically(path, content(figure, kind))


def content(figure: Figure, kind: str, *, dpi: int = 300) -> bytes:
    """Return a figure as the content of a file; no date in it, so that the same figure is the same file."""
    stream, dated = io.BytesIO(), {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with style.context(PAPER):
        figure.savefig(stream, format=kind, dpi=dpi, metadata=dated.get(kind))
    return stream.getvalue()


LABEL_OFFSETS = np.array(sorted(itertools.product(range(-6, 7), repeat=2), key=lambda step: math.hypot(*step)))
"""Candidate offsets of a module's number from its centre, nearest first, in font sizes."""
ARROW_SHARE = 0.5
"""Arrow length of the largest force, and of the largest torque, over the size of the platform."""


class Drawing:
    """One drawing of a design on 3-D axes, which it fills; its limits enclose everything drawn."""

    def __init__(self, axes: Axes3D, design: Design, poses: Platform, *, azimuth: float | None = None) -> None:
        """Look at the platform from an azimuth [deg]; by default from the clearest side."""
        self.axes = axes
        self.design = design
        self.poses = poses
        azimuth = geometry.azimuth_deg(poses) if azimuth is None else azimuth
        axes.view_init(elev=geometry.ELEVATION_DEG, azim=azimuth)
        axes.set_proj_type("ortho")
        axes.computed_zorder = False
        axes.patch.set_visible(False)
        self.v = geometry.towards_viewer(azimuth)
        """Unit vector towards the viewer."""
        self._points: list[Array] = []

    def airflow(self) -> None:
        """Draw the airflow envelope of every module: its outline, and the equator of its far ball."""
        for i, air in ((kind.nodes, air) for kind in geometry.kinds(self.design) for air in kind.module.envelopes):
            starts = self.poses.p[i] + self.poses.R[i] @ np.array(air.origin)
            axes = self.poses.R[i] @ np.array(air.upstream)
            ends = list(zip(starts, starts - air.length * axes, strict=True))
            sizes = air.start_radius, air.end_radius
            outlines = [cone_sphere_outline(p, sizes[0], end, sizes[1], self.v) for p, end in ends]
            self._volumes(outlines, palette.AIRFLOW)
            rings = [circle(end, sizes[1], axis) for (_, end), axis in zip(ends, axes, strict=True)]
            self._lines(rings, palette.AIRFLOW, 0.5)

    def air(self, surface: AirSurface) -> None:
        """Draw a surface of equal speed."""
        self._volumes(list(surface.mesh.triangles), palette.AIR, 0.08, edge=0.0)

    def exposure(self) -> None:
        """Draw every exposure region; for a cone, the surface that must contain all airflow."""
        tip, extent = self.poses.end_effector, geometry.cone_slant(self.design, self.poses)
        for _, shape in geometry.shapes(self.design.task, self.poses.p_e):
            faces = [tip + face for face in shape.faces(self.v, extent)]
            layers = min(len(faces), 2)  # the front and the back of a surface are seen, but an outline once
            opacity = 0.12 if shape.contains_airflow else 0.3 / layers
            self._volumes(faces, palette.EXPOSURE, opacity, edge=0.0 if layers > 1 else 0.7)
            for lines, width in ((shape.edges(extent), 0.8), (shape.generators(extent), 0.5)):
                if len(lines):
                    self._lines([tip + line for line in lines], palette.EXPOSURE, width)

    def platform(self) -> None:
        """Draw modules, joints and thrust axes, the rod on its mount, the end-effector and the centre of mass."""
        poses, kinds = self.poses, geometry.kinds(self.design)
        for h, a, i, _ in self.design.topology.bolts:
            joint = geometry.connector(self.design, poses, h, a)
            self._lines([np.stack([poses.p[h], joint, poses.p[i]])], palette.CONNECTOR, 2.0)
        faces, tints = list[Array](), list[str]()
        for kind in kinds:
            frame, rotors = solids.frame(kind.module), solids.rotor_discs(kind.module, sides=12)
            triangles = np.concatenate([mesh.triangles for mesh in (frame, *rotors)])
            faces += [triangles @ poses.R[i].T + poses.p[i] for i in kind.nodes]
            discs = len(triangles) - len(frame.faces)
            tints += ([kind.colour] * len(frame.faces) + [palette.ROTOR] * discs) * len(kind.nodes)
        rod = geometry.rod_of(self.design, poses)
        if rod is not None and self.design.mount is not None:
            hub = poses.p[self.design.mount.module]
            for start, end, radius in ((hub, rod.start, 2 * rod.radius), (rod.start, rod.end, rod.radius)):
                tube = cone_sphere(start, radius, end, radius, sides=12).triangles
                faces.append(tube)
                tints += [palette.END_EFFECTOR] * len(tube)
        self._solid(np.concatenate(faces), np.array(list(map(to_rgb, tints))))
        flying = [i for kind in kinds if kind.module.rotor_table.count for i in kind.nodes]
        axes = 1.6 * self.design.task.module.arm_length * poses.z[flying]
        look = {"linewidth": 1.2, "arrow_length_ratio": 0.3, "zorder": 7}
        self.axes.quiver(*poses.p[flying].T, *axes.T, color=palette.THRUST_AXIS, **look)
        self._extend_limits([poses.p[flying] + axes])
        for point, colour in ((poses.p_com, palette.CENTRE_OF_MASS), (poses.end_effector, palette.END_EFFECTOR)):
            self.axes.plot(*point[:, None], "o", color=colour, markeredgecolor="black", markersize=5, zorder=8)
            self._extend_limits([point])

    def load_cases(self) -> None:
        """Draw forces as arrows, and torques as dashed arrows through a ring, in the colour of their load case."""
        module = self.design.task.module
        extent = np.ptp(np.vstack([self.poses.p, self.poses.end_effector]), axis=0)
        reach = float(extent.max()) + 2 * module.arm_length
        for k, is_torque, point, share in wrenches(self.design, self.poses):
            arrow, colour = ARROW_SHARE * reach * share, palette.CASES[k]
            look = {"linewidth": 1.5, "linestyle": "dashed" if is_torque else "solid"}
            self.axes.quiver(*point, *arrow, color=colour, arrow_length_ratio=0.2, zorder=8, **look)
            self._extend_limits([point + arrow])
            if is_torque:
                ring = circle(point + arrow / 2, 0.15 * ARROW_SHARE * reach, arrow / np.linalg.norm(arrow))
                self._lines([ring], colour, 1.4)

    def finish(self) -> float:
        """Set equal scales on all axes, as large as fits with the labels, and return the zoom."""
        points = np.concatenate(self._points)
        low, high = points.min(axis=0), points.max(axis=0)
        half = np.maximum(high - low, 0.4 * (high - low).max()) / 2
        middle = (low + high) / 2
        limits = np.stack([middle - half, middle + half], axis=1)
        self.axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
        width = self.axes.figure.get_figwidth() * self.axes.get_position(original=True).width
        ticks = min(1.0, width / 3.5) * (3 * half / half.max() + 2)  # fewer where their labels would touch
        for name, most in zip("xyz", ticks, strict=True):
            axis = getattr(self.axes, f"{name}axis")
            axis.set_major_locator(MaxNLocator(max(2, round(most)), steps=[1, 2, 5, 10], prune="both"))
            axis.set_label_text(f"${name}$ [m]")
            axis.set_tick_params(pad=0 if name == "z" else -2)
            axis.labelpad = -1 if name == "z" else -4
            axis.set_pane_color((1, 1, 1, 0))
            axis._axinfo["grid"].update(color="0.8", linewidth=0.4)
        return self._fill(half)

    def _fill(self, half: Array) -> float:
        """Zoom and move the axes so that they fill their place in the figure with their labels; return the zoom."""
        axes, zoom = self.axes, 1.0
        place, inches = axes.get_position(original=True), np.array(axes.figure.get_size_inches())
        size = 0.98 * inches * place.size
        axes.set_position(place)  # no layout moves them from now on
        shown = (axes.xaxis, axes.yaxis, axes.zaxis) if axes._axis3don else ()
        box = np.array(list(itertools.product(*self._limits()))) if shown else np.concatenate(self._points)
        for _ in range(4):  # labels keep their size, and depend on the place of the box
            axes.set_box_aspect(tuple(half), zoom=zoom)
            axes.figure.draw_without_rendering()  # places the labels
            labels = [axis.get_tightbbox().get_points() / axes.figure.dpi for axis in shown]
            everything = np.vstack([self._on_paper(box) / 72, *labels])
            zoom *= float((size / np.ptp(everything, axis=0)).min())
        middle = (everything.min(axis=0) + everything.max(axis=0)) / 2 / inches
        axes.set_position(place.translated(*((place.p0 + place.p1) / 2 - middle)))
        axes.apply_aspect()
        for artist in axes.get_children():
            artist.set_clip_on(False)  # by the square around the axes' middle
        return zoom

    def _limits(self) -> list[tuple[float, float]]:
        return [self.axes.get_xlim(), self.axes.get_ylim(), self.axes.get_zlim()]

    def number_modules(self) -> None:
        """Write every module's number beside it, clear of thrust axes, marks and other numbers.

        Call `finish` first.
        """
        anchors = self.poses.p
        size = float(np.clip(40 / len(anchors), 5, 8))
        along = np.linspace(0.0, 1.6, 5)[:, None, None] * self.design.task.module.arm_length * self.poses.z
        marks = np.stack([self.poses.p_com, self.poses.end_effector])
        halo = [patheffects.withStroke(linewidth=1.8, foreground="white")]  # readable on any background
        line = {"arrowstyle": "-", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0, "path_effects": halo}
        wide_halo = [patheffects.withStroke(linewidth=2.5, foreground="white")]
        look: dict[str, Any] = {"textcoords": "offset points", "fontsize": size, "ha": "center", "va": "center"}
        look |= {"path_effects": wide_halo, "arrowprops": line, "zorder": 9}
        occupied = list(self._on_paper(np.concatenate([(self.poses.p + along).reshape(-1, 3), marks])))
        for i, (on_axes, on_paper) in enumerate(zip(self._project(anchors), self._on_paper(anchors), strict=True)):
            offset = next(
                (step * size for step in LABEL_OFFSETS if not _overlap(on_paper + step * size, occupied, size)),
                size * LABEL_OFFSETS[-1],
            )
            occupied.append(on_paper + offset)
            self.axes.annotate(str(i), on_axes, xytext=tuple(offset), **look)

    def _project(self, points: Array) -> Array:
        x, y, _ = proj3d.proj_transform(*points.T, self.axes.get_proj())
        return np.stack([x, y], axis=1)

    def _on_paper(self, points: Array) -> Array:
        pixels = self.axes.transData.transform(self._project(points))
        return np.asarray(pixels * 72 / self.axes.figure.dpi)

    def _volumes(self, polygons: list[Array], colour: str, alpha: float = 0.16, *, edge: float = 0.7) -> None:
        face, line = (*to_rgb(colour), alpha), (*to_rgb(colour), 0.8)
        self.axes.add_collection3d(Poly3DCollection(polygons, facecolors=face, edgecolors=line, linewidths=edge))
        self._extend_limits(polygons)

    def _solid(self, faces: Array, tints: Array) -> None:
        """Draw the faces that point towards the viewer."""
        self._extend_limits([faces])
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 1])
        visible = normals @ self.v > 0
        faces, normals = faces[visible], normals[visible]
        faces += 1e-12 * np.arange(len(faces))[:, None, None] * self.v  # ties in depth: in their order
        towards_light = np.array([0.27, -0.18, 0.95])
        cosine = np.abs(normals @ towards_light) / np.linalg.norm(normals, axis=1)
        tints = tints[visible] * (0.7 + 0.3 * cosine[:, None])
        solid = Poly3DCollection(faces, facecolors=tints, edgecolors=tints, linewidths=0.2, zorder=5, zsort="min")
        self.axes.add_collection3d(solid)

    def _lines(self, lines: list[Array], colour: str, width: float) -> None:
        self.axes.add_collection3d(Line3DCollection(lines, colors=colour, linewidths=width, zorder=4))
        self._extend_limits(lines)

    def _extend_limits(self, polygons: list[Array]) -> None:
        self._points.extend(np.asarray(points).reshape(-1, 3) for points in polygons)


def wrenches(design: Design, poses: Platform) -> list[tuple[int, bool, Array, Array]]:
    """Return the nonzero forces and torques of the load cases, of as many as there are colours.

    An item is the load case, whether it is a torque, the point (3,) [m] and the vector (3,), as a share of
    the largest force or torque of all load cases.
    """
    largest = {kind: geometry.largest_wrench(design, poses, kind) for kind in ("force", "torque")}
    return [
        (k, kind == "torque", point, v / largest[kind])
        for k, kind, _, point, v in geometry.load_wrenches(design, poses)
        if v.any() and k < len(palette.CASES)
    ]


def _overlap(centre: Array, occupied: list[Array], size: float) -> bool:
    gaps = np.abs(np.array(occupied) - centre)
    return bool(np.any((gaps[:, 0] < 1.4 * size) & (gaps[:, 1] < 1.3 * size)))

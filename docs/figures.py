"""The drawings of the documentation, from the model's own data.

    .venv/bin/python docs/figures.py

writes each to `docs/pages/figures/NAME.svg`, where NAME is that of its function. Ports, rotors, hinge axes,
envelopes and the jet come from the package. Lengths are in metres unless an axis says otherwise.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Wedge

from topo_search.export import PAPER, palette
from topo_search.export.brackets import bracket
from topo_search.export.picture import Drawing
from topo_search.export.tree_drawing import layout
from topo_search.model import Design, Module, Topology
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.model.bracket import Bracket
from topo_search.model.files import read_json
from topo_search.model.mesh import circle, cone_sphere_outline
from topo_search.model.topology import PORT_NAMES
from verify.air.jets import jets, speeds, wakes
from verify.kinematics import platform as poses_of
from verify.kinematics import poses, rotation

OUT = Path(__file__).parent / "pages/figures"
DESIGNS = Path(__file__).parents[1] / "tests/designs"
INK, PALE = "#222222", "#777777"
SITE = {"svg.fonttype": "none", "font.size": 9, "text.color": INK}
"""Differences from figures of papers: text stays text, so that readers of the site can search and enlarge it."""
MODULE = Module()
ROTORS = MODULE.rotor_table
Y = np.array([0.0, 1.0, 0.0])
"""The normal of a side view, which is seen from -y: x to the right, z up."""

Draw = Callable[..., None]
DRAWN: dict[str, tuple[Draw, tuple[float, float], int]] = {}
"""Every figure by name: its function, its size [in] and its number of panels, side by side."""


def drawing(width: float, height: float, panels: int = 1) -> Callable[[Draw], Draw]:
    """Register a function that draws a figure of this size [in] on panels side by side."""

    def register(draw: Draw) -> Draw:
        DRAWN[draw.__name__.replace("_", "-")] = draw, (width, height), panels
        return draw

    return register


def svg(name: str) -> str:
    """Return a figure as SVG."""
    draw, size, panels = DRAWN[name]
    with style.context([PAPER, SITE]):
        figure = Figure(figsize=size)
        if panels:
            axes = figure.subplots(1, panels, squeeze=False)[0]
            for panel in axes:
                panel.set_aspect("equal")
                panel.axis("off")
            draw(*axes)
        else:
            draw(figure)
        stream = io.StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def arrow(axes: Axes, tail: Any, head: Any, text: str = "", colour: str = INK, **at: Any) -> None:
    """Draw an arrow with a text at its head."""
    axes.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "color": colour, "shrinkA": 0, "shrinkB": 0})
    axes.plot(*np.transpose([tail, head]), alpha=0)  # annotations do not set limits
    if text:
        position = np.array(head) + at.pop("by", (0.0, 0.0))
        axes.text(*position, text, **{"color": colour, "ha": "center", "va": "center", **at})


def dimension(axes: Axes, a: Any, b: Any, text: str, by: tuple[float, float] = (0.0, 0.0)) -> None:
    """Draw a length with its name."""
    axes.annotate("", a, b, arrowprops={"arrowstyle": "<->", "color": PALE, "shrinkA": 0, "shrinkB": 0})
    axes.text(*(np.add(a, b) / 2 + by), text, ha="center", va="center", fontsize=8)


def fill(axes: Axes, points: Any, colour: str, alpha: float = 0.25) -> None:
    """Fill a polygon."""
    axes.add_patch(Polygon(points, facecolor=(*mpl.colors.to_rgb(colour), alpha), edgecolor=colour))
    axes.plot(*np.transpose(points), alpha=0)


def dot(axes: Axes, at: Any, colour: str, text: str = "", by: tuple[float, float] = (0.0, 0.0)) -> None:
    """Mark a point."""
    axes.plot(*at, "o", color=colour, markeredgecolor=INK, markersize=6, zorder=9)
    if text:
        axes.text(*np.add(at, by), text, ha="center", va="center", fontsize=8)


def boxes(axes: Axes, rows: list[tuple[str, ...]], *, back: tuple[str, int, int] | None = None) -> None:
    """Draw a row of boxes joined by arrows, each with a title and lines; `back` is an arrow from box to box."""
    for k, (title, *lines) in enumerate(rows):
        axes.add_patch(
            FancyBboxPatch((2.4 * k, 0), 1.9, 1.2, boxstyle="round,pad=0.08", fc="#eef3f8", ec=palette.CONNECTOR)
        )
        axes.text(2.4 * k + 0.95, 0.95, title, ha="center", va="center", weight="bold")
        axes.text(2.4 * k + 0.95, 0.42, "\n".join(lines), ha="center", va="center", fontsize=7.5)
        if k:
            arrow(axes, (2.4 * k - 0.41, 0.6), (2.4 * k - 0.09, 0.6))
    if back:
        text, start, end = back
        x, y = 2.4 * start + 0.95, 2.4 * end + 0.95
        axes.plot([x, x, y], [-0.09, -0.5, -0.5], color=INK, linewidth=1)
        arrow(axes, (y, -0.5), (y, -0.09))
        axes.text((x + y) / 2, -0.66, text, ha="center", va="center", fontsize=8)
    axes.set(xlim=(-0.2, 2.4 * len(rows) - 0.2), ylim=(-0.85, 1.4))


def project(points: Array, azimuth: float = -60.0, elevation: float = 22.0) -> Array:
    """Project points in space onto the paper, (..., 2)."""
    turned = points @ (rotation(0, math.radians(elevation)) @ rotation(2, math.radians(-90 - azimuth))).T
    return np.asarray(turned[..., [0, 2]])


def quadrotor(axes: Axes, R: Array, p: Array, view: Callable[[Array], Array], *, thrust: bool = True) -> None:
    """Draw a module: arms, rotor discs, connectors, thrust axis."""
    for position in p + MODULE.arm_length * ROTORS.positions @ R.T:
        axes.plot(*view(np.stack([p, position])).T, color=palette.MODULE, linewidth=2)
        axes.add_patch(
            Polygon(view(circle(position, MODULE.body.rotor_radius, R[:, 2])), fc=palette.ROTOR, ec=PALE, alpha=0.6)
        )
    for position in p + MODULE.connector_distance * PORT_DIRECTIONS @ R.T:
        axes.plot(*view(np.stack([p, position])).T, color=palette.CONNECTOR, linewidth=1)
    if thrust:
        arrow(axes, view(p), view(p + 1.6 * MODULE.arm_length * R[:, 2]), colour=palette.THRUST_AXIS)


def side(points: Array) -> Array:
    """Project points onto the x-z plane, x to the right."""
    return np.asarray(points[..., [0, 2]])


def envelope(axes: Axes, R: Array, p: Array, *, colour: str = palette.AIRFLOW) -> None:
    """Draw a module's airflow from the side."""
    shape = MODULE.envelope
    far = p - shape.length * R[:, 2]
    fill(axes, side(cone_sphere_outline(p, shape.start_radius, far, shape.end_radius, Y)), colour, 0.2)


@drawing(5.2, 3.4)
def module(axes: Axes) -> None:
    """Ports and rotors of a module from above."""
    flat = np.eye(3)
    quadrotor(axes, flat, np.zeros(3), lambda x: x[..., :2], thrust=False)
    for q, (position, spin) in enumerate(zip(MODULE.arm_length * ROTORS.positions, ROTORS.drags, strict=True)):
        axes.text(*position[:2], f"rotor {q}\n{'↺' if spin < 0 else '↻'}", ha="center", va="center", fontsize=8)
    for port, (name, e) in enumerate(zip(PORT_NAMES, PORT_DIRECTIONS, strict=True)):
        end = MODULE.connector_distance * e[:2]
        axes.plot(*end, "s", color=palette.CONNECTOR)
        axes.text(*(1.33 * end), f"port {port}\n({name})", ha="center", va="center", weight="bold")
    dimension(axes, (0, 0), MODULE.arm_length * ROTORS.positions[3][:2], "")
    axes.text(0.055, 0.025, "arm_length", fontsize=7)
    axes.text(
        0.0,
        -0.285,
        "↺ counter-clockwise from above, ↻ clockwise; the thrust axis z points at you",
        ha="center",
        fontsize=8,
    )
    axes.set(xlim=(-0.36, 0.36), ylim=(-0.3, 0.26))


@drawing(7.4, 2.1, panels=4)
def hinges(*panels: Axes) -> None:
    """A hinge angle of +25 degrees at each port of the root, from the audit's kinematics."""
    for port, (axes, name) in enumerate(zip(panels, PORT_NAMES, strict=True)):
        tree = Topology(((-1, -1, -1), (0, port, (port + 2) % 4)))
        bodies = poses(tree, (0.0, 0.0, 0.0), (math.radians(25),), MODULE.connector_distance)
        for R, p in zip(bodies.R, bodies.p, strict=True):
            quadrotor(axes, R, p, project)
        rise = "up" if bodies.p[1, 2] > 0 else "down"
        axes.set(xlim=(-0.5, 0.5), ylim=(-0.42, 0.5))
        axes.set_title(f"port {port} ({name}): +25°\nchild's far end {rise}", fontsize=8)


@drawing(7.4, 2.3, panels=4)
def euler(*panels: Axes) -> None:
    """The root's orientation, one turn after the other: Rz(psi) Rx(alpha_0) Ry(alpha_1)."""
    steps = (
        ("start", 2, 0.0),
        ("1. ψ about z", 2, 0.6),
        ("2. α₀ about the new x", 0, 0.5),
        ("3. α₁ about the new y", 1, 0.5),
    )
    R = np.eye(3)
    for axes, (title, axis, angle) in zip(panels, steps, strict=True):
        R = R @ rotation(axis, angle)
        quadrotor(axes, R, np.zeros(3), project, thrust=False)
        for name, e, colour in zip("xyz", R.T, ("#d55e00", "#009e73", "#0072b2"), strict=True):
            arrow(axes, project(np.zeros(3)), project(0.24 * e), name, colour, by=0.05 * project(e))
        axes.set(xlim=(-0.36, 0.36), ylim=(-0.25, 0.34))
        axes.set_title(title, fontsize=9)


@drawing(5.6, 3.6, panels=0)
def frames(figure: Figure) -> None:
    """Task frame, centre of mass and end-effector of a real design."""
    figure.set_layout_engine("none")  # the scene knows its part of the figure
    design = read_json(Design, DESIGNS / "wall-push.json")
    platform = poses_of(design)
    scene = Drawing(figure.add_axes((0.02, 0.02, 0.96, 0.94), projection="3d"), design, platform)
    scene.platform()
    scene.finish()
    for position, words, by in (
        (platform.p[0], "root module: origin of W,\nits axes are the task's", (-60, 40)),
        (platform.p_com, "centre of mass: COM loads act here", (60, -45)),
        (platform.end_effector, "tip: end-effector loads act here,\n$p_E$ from the centre of mass", (25, 40)),
    ):
        scene.axes.annotate(
            words,
            scene._project(position[None])[0],
            xytext=by,
            textcoords="offset points",
            fontsize=8,
            arrowprops={"arrowstyle": "-", "color": PALE},
            zorder=20,
            ha="center",
        )


@drawing(4.4, 4.4)
def airflow_envelope(axes: Axes) -> None:
    """The cone-sphere of the default module."""
    shape = MODULE.envelope
    quadrotor(axes, np.eye(3), np.zeros(3), side)
    envelope(axes, np.eye(3), np.zeros(3))
    dimension(axes, (0.0, 0.0), (shape.start_radius, 0.0), "start_radius", (0.17, 0.03))
    dimension(axes, (0.42, 0.0), (0.42, -MODULE.reach), "reach", (0.11, 0.0))
    for z in (0.0, -MODULE.reach):
        axes.plot([0.0, 0.45], [z, z], color=PALE, linewidth=0.6)
    half = math.radians(MODULE.airflow.spread_angle_deg) / 2
    axes.plot([0, 0], [0, -shape.length], color=PALE, linestyle="--", linewidth=0.8)
    axes.plot([0, math.tan(half) * 0.9], [-0.3, -1.2], color=PALE, linewidth=0.8)
    axes.text(
        -0.5,
        -0.8,
        f"spread_angle_deg:\n{MODULE.airflow.spread_angle_deg:g}° in total,\nhalf to each side",
        ha="center",
        fontsize=8,
    )
    axes.set(xlim=(-0.8, 0.8))


@drawing(7.4, 2.2, panels=3)
def clearance(*panels: Axes) -> None:
    """The clearance of two envelopes, positive, zero and negative."""
    for axes, (words, gap) in zip(
        panels, (("clear: positive", 0.05), ("touching: 0", 0.0), ("overlap: negative", -0.05)), strict=True
    ):
        ends = [(np.array([x, 0, 0]), 0.1, np.array([x * 1.15, 0, -0.42]), 0.14) for x in (-0.16 - gap, 0.16 + gap)]
        for p, r, q, s in ends:
            fill(axes, side(cone_sphere_outline(p, r, q, s, Y)), palette.AIRFLOW, 0.25)
            axes.plot(*side(np.stack([p, q])).T, color=PALE, linestyle="--", linewidth=0.8)
        (_, _, a, r), (_, _, b, s) = ends
        axes.plot([a[0] + r, b[0] - s], [a[2], b[2]], color=INK, linewidth=2)
        axes.set_title(words, fontsize=9)


def tip_and_module(axes: Axes, tilt: float = -0.35) -> None:
    """Draw a tip, and above left of it a module with its airflow."""
    R, p = rotation(1, tilt), np.array([-0.62, 0.0, 0.42])
    quadrotor(axes, R, p, side)
    envelope(axes, R, p)
    axes.plot([-0.5, 0.0], [0.36, 0.0], color=INK, linewidth=1.5)
    dot(axes, (0, 0), palette.END_EFFECTOR)
    axes.set(xlim=(-0.95, 0.75), ylim=(-0.75, 0.85))


@drawing(2.4, 2.3)
def region_ball(axes: Axes) -> None:
    """A ball around the tip."""
    tip_and_module(axes, 0.35)
    fill(axes, side(circle(np.zeros(3), 0.3, Y)), palette.EXPOSURE)
    dimension(axes, (0, 0), (0.3, 0), "radius", (0.03, 0.07))


@drawing(2.4, 2.3)
def region_box(axes: Axes) -> None:
    """A box around the tip."""
    tip_and_module(axes, 0.35)
    fill(axes, [(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)], palette.EXPOSURE)
    dimension(axes, (-0.3, -0.27), (0.3, -0.27), "box[0]", (0.0, -0.08))
    dimension(axes, (0.37, -0.2), (0.37, 0.2), "box[2]", (0.2, 0.0))


@drawing(2.4, 2.3)
def region_path(axes: Axes) -> None:
    """Capsules along a path from the tip."""
    tip_and_module(axes, 0.35)
    corners = np.array([[0, 0, 0], [0.4, 0, 0.1], [0.45, 0, -0.5]])
    for a, b in itertools.pairwise(corners):
        fill(axes, side(cone_sphere_outline(a, 0.13, b, 0.13, Y)), palette.EXPOSURE)
    axes.plot(*side(corners).T, color=INK, linewidth=1)


@drawing(2.4, 2.3)
def region_cone(axes: Axes) -> None:
    """A cone that holds all airflow."""
    tip_and_module(axes, 0.2)
    axis = math.degrees(math.atan2(0.42, -0.62))
    axes.add_patch(
        Wedge(
            (0, 0), 1.6, axis - 55, axis + 75, fc=(*mpl.colors.to_rgb(palette.EXPOSURE), 0.2), ec=palette.EXPOSURE
        )
    )
    arrow(axes, (0, 0), (-0.31, 0.21), "axis", by=(0.02, 0.09))
    axes.text(0.35, -0.35, "no airflow\noutside", ha="center", fontsize=8)


@drawing(2.4, 2.3)
def region_half_space(axes: Axes) -> None:
    """A half-space that airflow must not enter."""
    tip_and_module(axes, 0.2)
    fill(axes, [(0.2, -0.75), (0.75, -0.75), (0.75, 0.85), (0.2, 0.85)], palette.EXPOSURE)
    arrow(axes, (0.2, 0.45), (0.5, 0.45), "normal", by=(0.0, 0.1))
    dimension(axes, (0.0, -0.15), (0.2, -0.15), "offset", (0.0, -0.1))


@drawing(2.4, 2.3)
def region_solid(axes: Axes) -> None:
    """A solid wall: rotors, arms and rod keep out as well."""
    tip_and_module(axes, 0.2)
    fill(axes, [(0.0, -0.75), (0.75, -0.75), (0.75, 0.85), (0.0, 0.85)], palette.EXPOSURE, 0.55)
    axes.text(0.37, 0.3, "solid:\nno rotor, arm\nor rod either", ha="center", fontsize=8)


@drawing(7.4, 1.5)
def pipeline(axes: Axes) -> None:
    """From a task to a report."""
    rows = [
        ("task", "wrenches, regions,", "module, reserves"),
        ("enumerate", "trees up to", "symmetry"),
        ("solve", "many starts,", "Ipopt polishes"),
        ("audit", "independent code,", "proves each row"),
        ("report", "page, tables,", "kit"),
    ]
    boxes(axes, rows, back=("audit not clear: solve again with a larger margin", 3, 2))


@drawing(7.4, 1.5)
def build_pipeline(axes: Axes) -> None:
    """From a design to a flight."""
    rows = [
        ("best.json", "an audited", "design"),
        ("export", "angles rounded,", "audited again"),
        ("kit", "brackets, matrix,", "sheet, PX4"),
        ("fly", "MuJoCo, gusts,", "dead rotors"),
        ("hardware", "tethered first", ""),
    ]
    boxes(axes, rows, back=("not recovered: ask for more reserve and search again", 3, 0))


@drawing(7.0, 1.5)
def cluster(axes: Axes) -> None:
    """The processes of a search on a cluster."""
    rows = [
        ("topo-search", "proposes, records,", "ranks"),
        ("scheduler", "dask, one", "address"),
        ("workers", "solve and audit", "in child processes"),
    ]
    boxes(axes, rows, back=("results", 2, 0))


@drawing(7.4, 1.5)
def verdicts(axes: Axes) -> None:
    """The verdicts on a tree."""
    rows = [
        ("tree", "one topology", ""),
        ("impossible?", "proven,", "with the reason"),
        ("solved?", "else infeasible:", "not a proof"),
        ("clear?", "audit proves", "every row"),
        ("best", "gap proven", ""),
    ]
    boxes(axes, rows)


@drawing(6.4, 3.0, panels=2)
def branch_and_bound(left: Axes, right: Axes) -> None:
    """Boxes of two hinge angles, halved until a bound excludes them, and one bound along one angle."""
    rng = np.random.default_rng(3)
    todo = [(0.0, 0.0, 1.0, 1.0)]
    while todo:
        x, y, w, h = todo.pop()
        near = math.hypot(max(x - 0.62, 0, 0.62 - x - w), max(y - 0.4, 0, 0.4 - y - h))
        if w * h > 0.002 and near < 0.9 * max(w, h):
            todo += (
                [(x, y, w / 2, h), (x + w / 2, y, w / 2, h)]
                if w >= h
                else [(x, y, w, h / 2), (x, y + h / 2, w, h / 2)]
            )
            continue
        colour = (
            palette.SERIES[1] if near == 0 else (palette.SERIES[5] if rng.random() < 0.75 else palette.SERIES[3])
        )
        fill(left, [(x, y), (x + w, y), (x + w, y + h), (x, y + h)], colour, 0.35)
    left.set_title("boxes of two angles", fontsize=9)
    left.text(
        0.5,
        -0.14,
        "blue: bound above the cut; pink: modules too close;\norange: still open",
        ha="center",
        fontsize=7.5,
    )
    t = np.linspace(0, 1, 80)
    effort = 0.25 + 0.5 * (1 - np.cos(5 * (t - 0.62))) / 2 + 0.05
    right.plot(t, effort, color=INK)
    right.plot(t, np.full_like(t, 0.3), "--", color=palette.SERIES[1])
    right.text(0.02, 0.24, "cut: the best design minus the gap", fontsize=7.5)
    for a in np.arange(0, 1, 0.125):
        part = (t >= a) & (t <= a + 0.125)
        right.hlines(effort[part].min() - 0.03, a, a + 0.125, color=palette.SERIES[0], linewidth=2)
    right.text(0.02, 0.86, "effort along one angle", fontsize=8)
    right.text(0.02, 0.79, "bound of each box", fontsize=8, color=palette.SERIES[0])
    right.set(xlim=(0, 1), ylim=(0.15, 0.95))
    right.set_title("one angle", fontsize=9)


@drawing(5.2, 4.2, panels=0)
def jet(figure: Figure) -> None:
    """Speeds of the jet model in a section through two rotors, in hover."""
    axes = figure.subplots()
    l_arm, u = MODULE.arm_length, np.full((1, 4), MODULE.mass * 9.81 / 4 / MODULE.thrust_coefficient)
    air = jets(MODULE, 1.2, np.zeros((1, 3)), np.eye(3)[None], ROTORS.positions[None], u)
    r, z = np.linspace(-0.7, 0.7, 57), np.linspace(-2.0, 0.3, 93)
    along = ROTORS.positions[3]
    grid = (r[None, :, None] * along + z[:, None, None] * np.array([0, 0, 1.0])) / l_arm
    speed = speeds(air, grid.reshape(-1, 3))[:, 0].reshape(len(z), len(r))
    lines = axes.contour(r, z, speed, levels=[1, 2, 3, 5, 8], colors=[INK], linewidths=0.8)
    axes.contourf(r, z, speed, levels=[1, 2, 3, 5, 8, 30], cmap="Blues", alpha=0.8)
    axes.clabel(lines, fmt="%g m/s", fontsize=7)
    shape = MODULE.envelope
    outline = side(
        cone_sphere_outline(np.zeros(3), shape.start_radius, np.array([0, 0, -shape.length]), shape.end_radius, Y)
    )
    axes.plot(*outline.T, color=palette.AIRFLOW, linewidth=1.6, label="airflow envelope")
    for sign in (-1, 1):
        axes.plot(sign * l_arm + np.array([-1, 1]) * MODULE.body.rotor_radius, [0, 0], color=INK, linewidth=3)
    axes.set(xlabel="distance from the axis [m]", ylabel="height [m]", aspect="equal")
    axes.legend(loc="lower right", fontsize=7)


@drawing(4.6, 2.8, panels=0)
def momentum(figure: Figure) -> None:
    """Momentum of a module's jet over its thrust by depth, for rotors of four sizes."""
    axes, s = figure.subplots(), np.linspace(0.1, 4.0, 79)
    x = (np.arange(160) + 0.5) / 20
    x, y = (side.ravel() for side in np.meshgrid(x, x))  # points of a quadrant, which has one rotor [l_arm]
    for ratio, colour in zip((3, 4, 5, 6), palette.SERIES, strict=False):
        module = Module.model_validate({"body": {"rotor_radius": 2 * MODULE.arm_length / ratio}})
        air = jets(module, 1.2, np.zeros((1, 3)), np.eye(3)[None], ROTORS.positions[None], np.ones((1, 4)))
        squares = [(wakes(air, np.column_stack([x, y, 0 * x - 2 * depth])) ** 2).sum() for depth in s]
        thrust = 2 * math.pi * air.radii[0] ** 2 * air.induced[0, 0] ** 2 * 20**2
        axes.plot(
            s, np.array(squares) / thrust, color=colour, label=f"L/R = {ratio}, f = {module.jet_momentum:.2f}"
        )
    axes.axhline(1.0, color=PALE, linewidth=0.8, zorder=0)
    axes.set(xlabel="depth s [L]", ylabel="momentum of the jet over thrust", xlim=(0, 4), ylim=(0, 2.4))
    axes.legend(fontsize=7)


@drawing(6.6, 2.4, panels=3)
def interference(*panels: Axes) -> None:
    """The three rules of interference between two modules."""
    for axes, (name, dx, tilt) in zip(
        panels, (("airflow", 0.42, 0.12), ("parts", 0.34, 0.0), ("separation", 0.3, -0.15)), strict=True
    ):
        for sign in (-1, 1):
            R, p = rotation(1, -sign * tilt), np.array([sign * dx / 2, 0, 0])
            quadrotor(axes, R, p, side)
            envelope(axes, R, p)
        axes.set(ylim=(-1.5, 0.45))
        axes.set_title(f'"{name}"', fontsize=9)
        if name == "separation":
            dimension(axes, (-dx / 2, 0.25), (dx / 2, 0.25), "least distance", (0, 0.08))


@drawing(4.2, 3.4)
def downwash(axes: Axes) -> None:
    """Where to measure a jet."""
    quadrotor(axes, np.eye(3), np.zeros(3), side)
    L = 2 * MODULE.arm_length
    for s in (3, 6, 10):
        axes.plot([0.0, 0.6], [-s * L, -s * L], color=palette.CONNECTOR)
        for r in np.linspace(0, 0.6, 7):
            axes.plot(r, -s * L, "o", color=palette.CONNECTOR, markersize=3)
        axes.text(0.68, -s * L, f"s = {s}: {s * L:g} m", va="center", fontsize=8)
    axes.plot([0, 0], [0, -2.1], "--", color=PALE)
    axes.set(xlim=(-0.6, 1.4), ylim=(-2.2, 0.3))


@drawing(3.6, 2.6)
def bracket_solid(axes: Axes) -> None:
    """A printed hinge bracket of 20 degrees."""
    mesh = bracket(Bracket(), math.radians(20.0))
    faces, normals = np.asarray(mesh.triangles), np.asarray(mesh.face_normals)
    view = project(np.eye(3))
    towards = np.cross(*view.T)
    shown = normals @ towards > 1e-6
    order = np.argsort((faces[shown].mean(axis=1)) @ towards)
    grey = 0.55 + 0.35 * np.abs(normals[shown][order] @ np.array([0.3, -0.3, 0.9]))
    tints = np.repeat(np.minimum(grey, 1.0)[:, None], 3, axis=1)
    axes.add_collection(
        PolyCollection(project(faces[shown][order]), facecolors=tints, edgecolors=tints, linewidths=0.3)
    )
    axes.autoscale_view()


def tree(axes: Axes, key: str, title: str = "", moved: int | None = None) -> None:
    """Draw a tree in the plane with numbered modules, the moved one marked."""
    topology = Topology.from_key(key)
    at, _ = layout(topology)
    for h, i, a, _ in topology.edges():
        axes.plot(*at[[h, i]].T, color=palette.CONNECTOR, linewidth=2, zorder=1)
        axes.text(
            *(at[h] + 0.38 * (at[i] - at[h]) + (0, 0.16)), PORT_NAMES[a] if h == 0 else "", fontsize=7, ha="center"
        )
    for i, (x, y) in enumerate(at):
        axes.add_patch(
            FancyBboxPatch(
                (x - 0.18, y - 0.18),
                0.36,
                0.36,
                boxstyle="round,pad=0.04",
                fc=palette.EXPOSURE if i == moved else "#eef3f8",
                ec=INK,
            )
        )
        axes.text(x, y, str(i), ha="center", va="center")
    axes.set(
        xlim=at[:, 0].min() + np.array([-0.6, 0.6 + np.ptp(at[:, 0])]),
        ylim=at[:, 1].min() + np.array([-0.6, 0.6 + np.ptp(at[:, 1])]),
    )
    axes.set_title(title or key, fontsize=9)


@drawing(7.0, 2.2, panels=3)
def keys(*panels: Axes) -> None:
    """Three trees with their keys."""
    for axes, key in zip(panels, ("a300", "a5100", "a70010"), strict=True):
        tree(axes, key)


@drawing(6.4, 2.2, panels=2)
def move(left: Axes, right: Axes) -> None:
    """A leaf is cut off and bolted on elsewhere."""
    tree(left, "a70010", "a70010", moved=4)
    tree(right, "af0000", "af0000, one move apart", moved=4)


@drawing(6.4, 2.2, panels=2)
def load_case(left: Axes, right: Axes) -> None:
    """The total wrench of the rotors, without and with the weight."""
    for axes, carries in ((left, False), (right, True)):
        quadrotor(axes, np.eye(3), np.zeros(3), side, thrust=False)
        axes.plot([0.0, 0.4], [0.0, 0.1], color=INK, linewidth=1.5)
        dot(axes, (0.4, 0.1), palette.END_EFFECTOR)
        dot(axes, (0.0, 0.0), palette.CENTRE_OF_MASS)
        arrow(axes, (0.4, 0.1), (0.62, 0.1), "force\non the wall", palette.CASES[2], by=(0.15, 0.0))
        if carries:
            arrow(axes, (0, 0), (0, 0.38), "weight", palette.THRUST_AXIS, by=(0.11, 0.0))
        axes.set(xlim=(-0.3, 0.95), ylim=(-0.15, 0.45))
        axes.set_title(
            "only end_effector: falls" if not carries else "with carries_weight = true: hovers and pushes",
            fontsize=9,
        )


@drawing(5.6, 2.5, panels=2)
def force_cone(left: Axes, right: Axes) -> None:
    """A cone of forces and the pyramid around it; a disc of reserves and the octagon around it."""
    half, F = math.radians(20), 2.5
    axes, edge = left, F * np.array([math.cos(half), math.sin(half)])
    top = F * math.tan(half) / math.cos(math.pi / 8)
    axes.add_patch(Wedge((0, 0), F, -20, 20, fc=(*mpl.colors.to_rgb(palette.EXPOSURE), 0.3), ec=palette.EXPOSURE))
    axes.plot([0, F, F, 0], [0, top, -top, 0], color=palette.CONNECTOR)
    arrow(axes, (0, 0), (2.0, 0), "2 N", by=(0.15, 0.2))
    axes.text(*(edge * 0.62 + (-0.35, 0.35)), "20°, 2.5 N", fontsize=8)
    axes.set_title("cone of forces", fontsize=9)
    axes.set(xlim=(-0.1, 3.0), ylim=(-1.3, 1.3))
    right.add_patch(Circle((0, 0), 1, fc=(*mpl.colors.to_rgb(palette.EXPOSURE), 0.3), ec=palette.EXPOSURE))
    corners = np.exp(2j * math.pi * (np.arange(9) + 0.5) / 8) / math.cos(math.pi / 8)
    right.plot(corners.real, corners.imag, "o-", color=palette.CONNECTOR, markersize=4)
    right.set_title("reserve: disc, and 8 corners", fontsize=9)
    right.set(xlim=(-1.3, 1.3), ylim=(-1.3, 1.3))


@drawing(6.6, 1.5)
def gap(axes: Axes) -> None:
    """Effort of the winner of push relative to its lower bound, from its design file."""
    design = read_json(Design, DESIGNS / "push-a70010.json")
    over = 1 / (1 - design.gap)
    axes.set_aspect("auto")
    axes.barh([1, 0], [over, 1.0], color=[palette.SERIES[5], palette.FREE_PORT], height=0.6)
    axes.text(0.02, 1, f"{design.topology.key}: J = {over:.4f} times the bound", va="center")
    axes.text(0.02, 0, "lower bound: no tree of this size needs less", va="center")
    axes.plot([1, 1], [-0.4, 1.4], "--", color=INK, linewidth=0.8)
    axes.text(1.005, 0, "gap: no design saves more", va="center", fontsize=8)
    axes.set(xlim=(0, 1.35))


@drawing(5.4, 2.4)
def rod(axes: Axes) -> None:
    """The rod, its mount and its deflection."""
    quadrotor(axes, np.eye(3), np.zeros(3), side, thrust=False)
    x = np.linspace(0, 0.5, 30)
    start = MODULE.connector_distance
    axes.plot(start + x, 0 * x, "--", color=PALE)
    axes.plot(start + x, -0.5 * x**2 * (1.5 - x) / 1.0, color=INK, linewidth=2)
    tip = (start + 0.5, -0.5 * 0.25)
    dot(axes, tip, palette.END_EFFECTOR, "tip", (0.07, 0.0))
    arrow(axes, tip, np.add(tip, (0, -0.12)), "largest load", by=(0, -0.04))
    dimension(axes, (start, 0.1), (start + 0.5, 0.1), "largest_reach", (0.0, 0.04))
    dimension(axes, (start + 0.53, 0.0), (start + 0.53, -0.125), "rod_deflection", (0.2, 0.03))
    axes.plot(start, 0, "s", color=palette.CONNECTOR)
    axes.text(start, -0.08, "mount", ha="center", fontsize=8)
    axes.set(xlim=(-0.25, 1.1), ylim=(-0.36, 0.18))


@drawing(5.6, 2.6, panels=2)
def build_error(left: Axes, right: Axes) -> None:
    """A hinge error of some degrees swings the airflow."""
    for axes, off in ((left, 0.0), (right, 6.0)):
        angle = math.radians(-18 + off)
        bodies = poses(Topology.from_key("a10"), (0.0, 0.0, 0.0), (angle,), MODULE.connector_distance)
        for R, p in zip(bodies.R, bodies.p, strict=True):
            quadrotor(axes, R, p, side)
            envelope(axes, R, p)
        axes.set_title("as designed" if not off else "hinge off: clearance lost", fontsize=9)


@drawing(5.6, 2.4)
def front(axes: Axes) -> None:
    """A Pareto front: no design on it is beaten in both figures."""
    rng = np.random.default_rng(7)
    x = rng.uniform(0.05, 1, 26)
    y = 0.12 + 0.75 * x**2 + rng.uniform(0.0, 0.5, 26)
    best = [k for k in range(26) if not np.any((x > x[k]) & (y < y[k]))]
    best.sort(key=lambda k: x[k])
    axes.set_aspect("auto")
    axes.plot(x, y, "o", color=palette.FREE_PORT)
    axes.plot(x[best], y[best], "o:", color=palette.CONNECTOR)
    arrow(axes, (0, 0), (1.1, 0), "more reserve", by=(-0.12, -0.1))
    arrow(axes, (0, 0), (0, 1.4), "more effort", by=(0.09, 0.0))
    axes.text(0.45, 0.12, "the front: choose here", fontsize=8, color=palette.CONNECTOR)
    axes.set(ylim=(-0.15, 1.5))


@drawing(6.4, 2.3, panels=0)
def drawer(figure: Figure) -> None:
    """Brackets of a few kinds serve several tasks."""
    axes = figure.subplots()
    axes.axis("off")
    axes.set_aspect("equal")
    for k, degrees in enumerate((0, 15, 30, 45)):
        turn = math.radians(degrees)
        axes.plot(
            [k - 0.3, k, k + 0.3 * math.cos(turn)],
            [0, 0, -0.3 * math.sin(turn)],
            color=palette.CONNECTOR,
            linewidth=5,
        )
        axes.text(k, 0.18, f"{degrees}°", ha="center")
    for k, task in enumerate(("wall-push", "window-cleaning", "survives-a-rotor")):
        axes.text(1.5 * k, -1.0, task, ha="center", weight="bold", fontsize=8)
        for kind in ((0, 1), (0, 1, 2), (1, 2))[k]:
            arrow(axes, (kind, -0.32), (1.5 * k, -0.88), colour=PALE)
    axes.set(xlim=(-0.8, 3.8), ylim=(-1.15, 0.4))


@drawing(6.4, 2.4, panels=2)
def starts(left: Axes, right: Axes) -> None:
    """The outer search over trees and the inner one: descents from several starts."""
    tree(left, "a5100", "outer: choose a tree")
    t = np.linspace(0, 1, 200)
    effort = 0.5 + 0.25 * np.cos(14 * t) + 0.5 * (t - 0.7) ** 2
    right.plot(t, effort, color=INK)
    for s in (0.05, 0.4, 0.62, 0.95):
        k = round(s * 199)
        while 0 < k < 199 and min(effort[k - 1], effort[k + 1]) < effort[k]:
            k += 1 if effort[k + 1] < effort[k] else -1
        right.annotate(
            "",
            (t[k], effort[k]),
            (s, effort[round(s * 199)]),
            arrowprops={"arrowstyle": "-|>", "color": palette.CONNECTOR, "connectionstyle": "arc3,rad=0.3"},
        )
        right.plot(s, effort[round(s * 199)], "o", color=palette.CONNECTOR)
    right.set_title("inner: descend from several starts", fontsize=9)
    right.set_aspect("auto")


def star() -> Iterator[tuple[Array, Array]]:
    """Yield position and axis of the rotors of a hexarotor, tilted by 30 degrees to alternate sides."""
    for k in range(6):
        turn = rotation(2, k * math.pi / 3)
        yield turn @ np.array([0.3, 0, 0]), turn @ rotation(0, math.radians(30 * (-1) ** k)) @ np.array([0, 0, 1.0])


@drawing(4.2, 2.2)
def vehicle(axes: Axes) -> None:
    """A vehicle with tilted rotors."""
    for position, axis in star():
        axes.plot(*project(np.stack([0 * position, position])).T, color=palette.MODULE, linewidth=2)
        axes.add_patch(Polygon(project(circle(position, 0.1, axis)), fc=palette.ROTOR, ec=PALE, alpha=0.6))
        arrow(axes, project(position), project(position + 0.22 * axis), colour=palette.THRUST_AXIS)
    axes.text(
        *project(np.array([0, 0, -0.3])), "x_m, y_m, z_m and ax, ay, az of every rotor", ha="center", fontsize=8
    )


@drawing(5.0, 3.0)
def bridge(axes: Axes) -> None:
    """A probe that touches the underside of a deck."""
    fill(axes, [(-1.0, 0.0), (1.0, 0.0), (1.0, 0.18), (-1.0, 0.18)], palette.EXPOSURE, 0.55)
    axes.text(0.0, 0.09, "deck: solid, no airflow above its underside", ha="center", va="center", fontsize=8)
    for x, tilt in ((-0.3, -0.25), (0.0, 0.0), (0.3, 0.25)):
        quadrotor(axes, rotation(1, tilt), np.array([x, 0, -0.45 - 0.05 * abs(x)]), side)
    axes.plot([0.15, 0.15], [-0.45, 0.0], color=INK, linewidth=2)
    dot(axes, (0.15, 0.0), palette.END_EFFECTOR)
    arrow(axes, (0.15, 0.0), (0.15, 0.32), "3 N", by=(0.09, 0.0))


def main() -> None:
    """Draw every figure."""
    OUT.mkdir(exist_ok=True)
    for name in DRAWN:
        (OUT / f"{name}.svg").write_text(svg(name), encoding="utf-8")


if __name__ == "__main__":
    main()

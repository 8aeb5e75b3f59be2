"""What a task asks for, drawn around the end-effector: forces, regions kept out of the airflow, a module to scale.

| symbol | meaning | shape | unit |
|---|---|---|---|
| v | unit vector along which a view looks | (3,) | |
| d, theta | axis of a cone from the end-effector, half-angle | (3,), | -, rad |
| phi | half-angle of the cone on the paper: sin(phi) = sin(theta) / sin(angle between d and v) | | rad |

Three views along the axes of the task frame W, lengths in metres from the end-effector. A direction that the design
decides, towards or away from the centre of mass, is drawn as if the centre of mass were straight below.
"""

from __future__ import annotations

import math
from itertools import cycle
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon

from topo_search.export import outlines, palette
from topo_search.export.poses import Poses
from topo_search.export.regions import cone_axis, paths, polytope
from topo_search.model import Directional, Exterior, Local, ResolvedTask, needs_offset
from topo_search.model.arrays import Array

VIEWS = ((0, 2, "from the front"), (1, 2, "from the side"), (0, 1, "from above"))
"""Axes of W that lie to the right and up on the paper."""
UP = np.array([0.0, 0.0, 1.0])
"""From the centre of mass to the end-effector where a design decides it."""
LONGEST = 0.9
"""Length of the arrow of the largest force, over half the width of a view."""


def task_figure(task: ResolvedTask) -> Figure:
    """Return the picture of a task as a matplotlib figure."""
    with mpl.rc_context({"font.size": 8}):
        figure = Figure(figsize=(10.5, 4.4), layout="constrained")
        size = _reach(task)
        for axes, (right, up, name) in zip(figure.subplots(1, 3), VIEWS, strict=True):
            _draw(axes, task, (right, up), size)
            axes.set_title(name, fontsize=9)
        below = "; the centre of mass, which the design decides, taken to be straight below"
        undecided = task.end_effector.position == "free" and any(needs_offset(asked) for asked in task.exposure)
        figure.suptitle(f"{task.name}: what is asked for at the end-effector{below if undecided else ''}")
        figure.legend(handles=_legend(task), loc="outside lower center", ncols=5, frameon=False)
    return figure


def _draw(axes: Axes, task: ResolvedTask, view: tuple[int, int], size: float) -> None:
    """Draw one view of what lies within `size` metres of the end-effector."""
    right, up = view
    for is_cone, outline in _regions(task, view, size):
        axes.add_patch(Polygon(outline, **_look(is_cone)))
    module, envelope = np.zeros(3), task.module.envelope
    module[right] = -0.75 * size
    far = module - envelope.length * UP
    airflow = outlines.cone_sphere(module, envelope.start_radius, far, envelope.end_radius, _towards_viewer(view))
    axes.add_patch(Polygon(airflow[:, view], facecolor=(palette.AIRFLOW, 0.16), edgecolor=palette.AIRFLOW))
    axes.plot(*module[[right, up]], "s", color=palette.MODULE, markersize=4)
    forces = _forces(task)
    longest = max((float(np.linalg.norm(force)) for _, force in forces), default=1.0)
    for (k, force), colour in zip(forces, cycle(palette.SERIES), strict=False):
        tip = LONGEST * size * force[[right, up]] / longest
        if np.hypot(*tip) > 0.02 * size:
            axes.add_patch(FancyArrowPatch((0, 0), tuple(tip), color=colour, arrowstyle="-|>", mutation_scale=9))
            axes.annotate(str(k), tuple(1.08 * tip), color=colour, ha="center", va="center")
    axes.plot(0, 0, "o", color=palette.END_EFFECTOR, markeredgecolor="black", zorder=5)
    axes.set(xlim=(-1.1 * size, 1.1 * size), ylim=(-1.1 * size, 1.1 * size), aspect="equal")
    axes.set_xlabel(f"${'xyz'[right]}$ [m]")
    axes.set_ylabel(f"${'xyz'[up]}$ [m]")
    axes.grid(color="0.9", linewidth=0.5)
    axes.set_axisbelow(True)


def _look(is_cone: bool) -> dict[str, Any]:
    """Return how a region is drawn: what airflow keeps out of full, the cone that it stays in pale and dashed."""
    opacity, line = (0.1, "dashed") if is_cone else (0.4, "solid")
    return {"facecolor": (palette.EXPOSURE, opacity), "edgecolor": palette.EXPOSURE, "linestyle": line}


def _regions(task: ResolvedTask, view: tuple[int, int], size: float) -> list[tuple[bool, Array]]:
    """Return the outlines of all regions on the paper, (points, 2) each, and whether it is a cone to stay in."""
    at, outlined = _stand_in(task), list[tuple[bool, Array]]()
    for asked in task.exposure:
        if isinstance(asked, Exterior):
            theta = math.radians(asked.half_angle_deg)
            outlined.append((True, _wedge(cone_axis(asked, at), theta, view, 4 * size)))
            continue
        if asked.radius is None:
            outlined.append((False, outlines.flat_hull(polytope(asked).corners[:, view])))
            continue
        for end in _ends(task, asked):
            outline = outlines.cone_sphere(np.zeros(3), asked.radius, end, asked.radius, _towards_viewer(view))
            outlined.append((False, outline[:, view]))
    return outlined


def _wedge(d: Array, theta: float, view: tuple[int, int], far: float) -> Array:
    """Return what a cone covers of the paper, out to a distance; all of it where one looks into the cone."""
    on_paper = d[list(view)]
    ratio = math.sin(theta) / max(math.hypot(*on_paper), 1e-12)
    phi = math.asin(min(ratio, 1.0)) if ratio < 1 + 1e-9 else math.pi
    middle = math.atan2(on_paper[1], on_paper[0])
    angles = np.linspace(middle - phi, middle + phi, 49)
    arc = far * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray(arc if phi == math.pi else np.vstack([np.zeros(2), arc]))


def _ends(task: ResolvedTask, asked: Local | Directional) -> list[Array]:
    """Return where the paths of a requirement end; a ball's is at its centre."""
    return paths(asked, _stand_in(task)) if isinstance(asked, Directional) else [np.zeros(3)]


def _stand_in(task: ResolvedTask) -> Poses:
    """Return one module below the end-effector, in the direction that the task fixes or else straight below."""
    p_E = np.array(task.end_effector.fixed_position or UP)
    return Poses(np.eye(3)[None], -p_E[None], -p_E, np.zeros(3))


def _towards_viewer(view: tuple[int, int]) -> Array:
    """Return v."""
    return np.asarray(np.eye(3)[3 - sum(view)])


def _forces(task: ResolvedTask) -> list[tuple[int, Array]]:
    """Return number and force of every load case that exerts one at the end-effector [N]."""
    forces = [(k, np.array(case.at_end_effector.force)) for k, case in enumerate(task.load_cases)]
    return [(k, force) for k, force in forces if force.any()]


def _reach(task: ResolvedTask) -> float:
    """Return how far all regions with an end reach, and most of a module's airflow [m]."""
    finite = [asked for asked in task.exposure if not isinstance(asked, Exterior)]
    reaches = [0.6 * task.module.reach]
    for asked in finite:
        if asked.radius is None:
            reaches.append(float(np.linalg.norm(polytope(asked).corners, axis=1).max()))
        else:
            reaches += [asked.radius + float(np.linalg.norm(end)) for end in _ends(task, asked)]
    return max(reaches)


def _legend(task: ResolvedTask) -> list[Artist]:
    entries: list[Artist] = [
        Line2D(
            [],
            [],
            marker="o",
            linestyle="",
            color=palette.END_EFFECTOR,
            markeredgecolor="black",
            label="end-effector",
        ),
        Patch(
            facecolor=(palette.AIRFLOW, 0.16), edgecolor=palette.AIRFLOW, label="airflow of one module, to scale"
        ),
    ]
    for is_cone, words in ((False, "to be kept out of the airflow"), (True, "cone to hold all airflow")):
        if any(isinstance(asked, Exterior) is is_cone for asked in task.exposure):
            entries.append(Patch(**_look(is_cone), label=words))
    for (k, force), colour in zip(_forces(task), cycle(palette.SERIES), strict=False):
        label = f"{task.case_labels[k]}: {np.linalg.norm(force):.3g} N"
        entries.append(Line2D([], [], color=colour, marker=">", label=label))
    return entries

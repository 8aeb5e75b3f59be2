"""Picture of a task around its end-effector: forces, torques, exposure regions, and a module to scale.

| symbol | meaning | shape | unit |
|---|---|---|---|
| v | unit vector along the line of sight | (3,) | |

Three views along the axes of the task frame W, in metres from the end-effector. Directions that depend on the
design, towards or away from its centre of mass, are drawn as if the centre of mass were straight below.
"""

from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon

from topo_search.export import PAPER, TWO_COLUMNS, palette
from topo_search.export.poses import longest_reach, shapes
from topo_search.model import Array, ResolvedTask, needs_offset
from topo_search.model.mesh import circle, cone_sphere_outline

VIEWS = ((0, 2, "from the front"), (1, 2, "from the side"), (0, 1, "from above"))
"""Axes of W that point right and up in each view, and the view's name."""
ROD_STYLE: dict[str, Any] = {"color": palette.END_EFFECTOR, "linewidth": 2.5, "alpha": 0.6}
UP = np.array([0.0, 0.0, 1.0])
"""Assumed direction from the centre of mass to the end-effector if it depends on the design."""


@style.context(PAPER)
def task_figure(task: ResolvedTask) -> Figure:
    """Return the picture of a task as a matplotlib figure across two columns."""
    entries = _legend(task)
    rows = -(-len(entries) // 3)
    figure = Figure(figsize=(TWO_COLUMNS, 2.7 + 0.16 * rows))
    # the views enclose all bounded regions and most of a module's airflow [m]
    size = max([0.6 * longest_reach(task), *(shape.reach for _, shape in shapes(task, _end_effector(task)))])
    for axes, (right, up, name) in zip(figure.subplots(1, 3), VIEWS, strict=True):
        _draw(axes, task, (right, up), size)
        axes.set_title(name)
    assumption = " (centre of mass assumed straight below)"
    undecided = task.end_effector.position == "free" and any(needs_offset(exposure) for exposure in task.exposure)
    figure.suptitle(f"{task.name}: requirements at the end-effector{assumption if undecided else ''}")
    figure.legend(handles=entries, loc="outside lower center", ncols=3, handlelength=3)
    return figure


def _draw(axes: Axes, task: ResolvedTask, view: tuple[int, int], size: float) -> None:
    """Draw one view of everything within `size` metres of the end-effector."""
    right, up = view
    for _, shape in shapes(task, _end_effector(task)):
        axes.add_patch(Polygon(shape.outline(view, 4 * size), **_region_style(shape.contains_airflow)))
    if task.rod_axis is not None:
        rod = np.outer([0.0, -0.7 * size], task.rod_axis)
        axes.plot(*rod[:, view].T, **ROD_STYLE)
    # the module to scale has the same position in all views
    module = size * np.array([-0.75, -0.75, 0.0])
    for air in next(kind.envelopes for kind in task.types if kind.envelopes):
        start = module + air.origin
        far = start - air.length * np.array(air.upstream)
        airflow = cone_sphere_outline(start, air.start_radius, far, air.end_radius, _towards_viewer(view))
        axes.add_patch(Polygon(airflow[:, view], facecolor=(palette.AIRFLOW, 0.16), edgecolor=palette.AIRFLOW))
    axes.plot(*module[[right, up]], "s", color=palette.MODULE, markersize=4)
    for name in ("force", "torque"):
        _arrows(axes, task, view, size, name)
    axes.plot(0, 0, "o", color=palette.END_EFFECTOR, markeredgecolor="black", zorder=5)
    axes.set(xlim=(-1.1 * size, 1.1 * size), ylim=(-1.1 * size, 1.1 * size), aspect="equal")
    axes.set_xlabel(f"${'xyz'[right]}$ [m]")
    axes.set_ylabel(f"${'xyz'[up]}$ [m]")
    axes.grid()
    axes.set_axisbelow(True)


def _arrows(axes: Axes, task: ResolvedTask, view: tuple[int, int], size: float, name: str) -> None:
    """Draw the load cases' forces at the end-effector as arrows, or torques as dashed arrows through a ring."""
    vectors, in_view = _vectors(task, name), list(view)
    longest = max((float(np.linalg.norm(vector)) for _, vector in vectors), default=1.0)
    is_torque = name == "torque"
    for k, vector in vectors:
        colour = _colour(k)
        arrow = 0.9 * size * vector / longest
        if is_torque:
            ring = circle(0.6 * arrow, 0.07 * size, vector / np.linalg.norm(vector))
            axes.plot(*ring[:, in_view].T, color=colour, linewidth=1.2)
        tip = arrow[in_view]
        if np.hypot(*tip) > 0.02 * size:
            look: dict[str, Any] = {"color": colour, "linestyle": "dashed" if is_torque else "solid"}
            axes.add_patch(FancyArrowPatch((0, 0), tuple(tip), arrowstyle="-|>", mutation_scale=9, **look))
            axes.annotate(str(k), tuple(1.08 * tip), color=colour, ha="center", va="center")


def _colour(k: int) -> str:
    return palette.SERIES[k % len(palette.SERIES)]


def _region_style(contains_airflow: bool) -> dict[str, Any]:
    opacity, line = (0.1, "dashed") if contains_airflow else (0.4, "solid")
    return {"facecolor": (palette.EXPOSURE, opacity), "edgecolor": palette.EXPOSURE, "linestyle": line}


def _end_effector(task: ResolvedTask) -> Array:
    return np.array(task.end_effector.fixed_position or UP)


def _towards_viewer(view: tuple[int, int]) -> Array:
    return np.asarray(np.eye(3)[3 - sum(view)])


def _vectors(task: ResolvedTask, name: str) -> list[tuple[int, Array]]:
    vectors = [(k, np.array(getattr(case.at_end_effector, name))) for k, case in enumerate(task.load_cases)]
    return [(k, vector) for k, vector in vectors if vector.any()]


def _legend(task: ResolvedTask) -> list[Artist]:
    airflow = palette.AIRFLOW
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "markeredgecolor": "black"}
    entries: list[Artist] = [
        Line2D([], [], color=palette.END_EFFECTOR, label="end-effector", **dot),
        Patch(facecolor=(airflow, 0.16), edgecolor=airflow, label="airflow of one module, to scale"),
    ]
    if task.rod_axis is not None:
        angle = task.end_effector.largest_angle_deg
        entries.append(Line2D([], [], label=f"rod, within {angle:g} deg", **ROD_STYLE))
    regions = [shape for exposure in task.exposure for shape in exposure.shapes]
    kinds = {shape.words: shape.contains_airflow for shape in regions}
    entries += [Patch(**_region_style(inside), label=words) for words, inside in sorted(kinds.items())]
    for name, unit in (("force", "N"), ("torque", "N m")):
        for k, vector in _vectors(task, name):
            label = f"{task.case_labels[k]}: {np.linalg.norm(vector):.3g} {unit}"
            dash: Any = "dashed" if name == "torque" else "solid"
            entries.append(Line2D([], [], color=_colour(k), marker=">", linestyle=dash, label=label))
    return entries

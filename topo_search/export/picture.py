"""A picture of a design without a display: the platform with its airflow, a close-up, and its tree.

Drawn as the paper draws it, in the axes of the task frame W and in metres.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from topo_search.export import palette
from topo_search.export.air_field import AirSurface
from topo_search.export.poses import poses_to_draw
from topo_search.export.regions import region_words
from topo_search.export.scene import Scene, wrenches
from topo_search.export.tree_drawing import draw_tree
from topo_search.model.design import Design
from topo_search.model.files import write_atomically
from topo_search.model.proven import gap_percent
from topo_search.model.shape import Cone


def draw(design: Design, path: str | Path, *, format: Literal["png", "svg"] | None = None) -> None:
    """Write a picture of a design.

    Args:
        design: any design, audited or not.
        path: the file; its folder is made if need be.
        format: the kind of file; default: by the end of its name.

    Raises:
        ValueError: neither `format` nor the name says `png` or `svg`.
        BadInput: the end-effector is too far away to be drawn with the rest.
    """
    with mpl.rc_context({"font.size": 8}):
        save(figure_of(design), path, format=format)


def picture(design: Design, kind: Literal["png", "svg"], air: AirSurface | None = None) -> bytes:
    """Return a picture of a design as a file's content, with `air` instead of envelopes; errors as `draw`."""
    with mpl.rc_context({"font.size": 8}):
        return content(figure_of(design, air), kind)


@dataclass(frozen=True)
class Picture:
    """A design's picture, for a notebook to show."""

    design: Design

    def _repr_png_(self) -> bytes:
        return picture(self.design, "png")


def figure_of(design: Design, air: AirSurface | None = None) -> Figure:
    """Return the picture as a matplotlib figure; `air` is drawn instead of the envelopes."""
    figure = Figure(figsize=(10.5, 6.8))
    at = poses_to_draw(design)
    whole = Scene(figure, (0.0, 0.10, 0.58, 0.82), design, at)
    whole.exposure()
    if air is None:
        whole.airflow()
    else:
        whole.air(air)
    whole.platform()
    whole.finish()
    close = Scene(figure, (0.57, 0.47, 0.42, 0.45), design, at)
    close.platform()
    close.load_cases()
    close.finish()
    close.number_modules()
    draw_tree(figure.add_axes((0.62, 0.11, 0.35, 0.30)), design)
    key = design.topology.key
    for x, y, text in (
        (0.29, 0.915, "airflow" if air is None else air.words),
        (0.79, 0.915, "platform and load cases"),
        (0.79, 0.43, f"topology {key}" if len(key) <= 44 else f"topology {key[:40]}..."),
    ):
        figure.text(x, y, text, fontsize=9, ha="center")
    figure.suptitle(title(design), y=0.98, fontsize=11)
    figure.legend(handles=_legend(design, air), loc="lower center", ncols=5, frameon=False, fontsize=9)
    return figure


def title(design: Design) -> str:
    """Return name, size, topology, objective and gap in one line."""
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
        Patch(color=palette.MODULE, label="module"),
        Line2D([], [], color=palette.THRUST_AXIS, marker=">", label="thrust axis"),
        Line2D([], [], color=palette.CONNECTOR, linewidth=2, label="joint (hinge angle)"),
        Line2D([], [], marker="s", linestyle="", color=palette.FREE_PORT, label="free connector"),
        Line2D([], [], marker=".", linestyle="", color=palette.THRUST_AXIS, label="side of port $+x$"),
        volume(palette.AIRFLOW, 0.3, "airflow envelope") if air is None else volume(palette.AIR, 0.3, "air"),
        dot(palette.END_EFFECTOR, "end-effector"),
        dot(palette.CENTRE_OF_MASS, "centre of mass"),
        Line2D([], [], color=palette.OFFSET, linewidth=2.5, label="$p_E$"),
    ]
    entries += [
        Line2D([], [], color=palette.CASES[k], marker=">", label=f"load case {k}")
        for k in sorted({k for k, *_ in wrenches(design, poses_to_draw(design))})
    ]
    regions = [shape for requirement in design.task.exposure for shape in requirement.shapes]
    kinds = {region_words(shape): 0.12 if isinstance(shape, Cone) else 0.3 for shape in regions}
    entries += [volume(palette.EXPOSURE, opacity, words) for words, opacity in sorted(kinds.items())]
    return entries


def save(figure: Figure, path: str | Path, *, format: Literal["png", "svg"] | None = None) -> None:
    """Write a figure.

    Args:
        figure: a figure that no window shows.
        path: the file; its folder is made if need be.
        format: the kind of file; default: by the end of its name.

    Raises:
        ValueError: neither `format` nor the name says `png` or `svg`.
    """
    path = Path(path)
    kind = format or path.suffix.removeprefix(".").lower()
    if kind not in ("png", "svg"):
        raise ValueError(f"the picture's name must end in .png or .svg, but got {path.name}")
    write_atomically(path, content(figure, kind))


def content(figure: Figure, kind: str) -> bytes:
    """Return a figure as the content of a `png` or `svg` file."""
    stream = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "topo-search"}):
        figure.savefig(stream, format=kind, dpi=200, metadata={"Date": None} if kind == "svg" else None)
    return stream.getvalue()

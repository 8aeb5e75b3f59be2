"""Platforms and the figures of `plot_*` on matplotlib axes, for papers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from topo_search.export.poses import poses_to_draw
from topo_search.model import BadInput, Design, Fault

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from matplotlib.axes import Axes

DASHES = {"dash": "--", "dot": ":", "dashdot": "-."}
STEPS = {"hv": "steps-post", "vh": "steps-pre"}
MARKERS = {"circle": "o", "x": "x"}
"""Names of dashes, steps and markers in plotly, and in matplotlib; others are solid, straight, or do not occur."""
Part = Literal["exposure", "airflow", "platform", "load_cases"]


def draw(what: Design | go.Figure, ax: Axes, parts: Sequence[Part] = ("platform", "load_cases")) -> None:
    """Draw a platform, or the figure of a `plot_...` function, on matplotlib axes, as a figure of a paper.

    The style `topo_search.paper` has fonts, sizes and colours for one column; with `topo_search.two_columns` after
    it figures are as wide as two. Lengths are in metres along the axes of the task.

    Args:
        what: a design, or a two-dimensional figure; of one with two panels, the upper.
        ax: the axes; for a design with `projection="3d"`, and after all other axes of the figure are drawn, since a
            layout moves them no longer.
        parts: of a design, what to draw: `exposure`, `airflow`, `platform`, `load_cases`.

    Raises:
        BadInput: `what` or the axes are of another kind, or there is no such part.

    Example:
        >>> import matplotlib.pyplot as plt
        >>> from topo_search import draw, plot_candidates, read_answer
        >>> answer = read_answer("hover-2")
        >>> with plt.style.context("topo_search.paper"):
        ...     figure, ax = plt.subplots()
        ...     draw(plot_candidates(answer, x="rod_length_m"), ax)
        ...     figure.savefig("candidates.pdf")
        ...     ax = plt.figure().add_subplot(projection="3d")
        ...     draw(answer.design, ax)
        >>> ax.get_zlabel()
        '$z$ [m]'
    """
    needed = "3d" if isinstance(what, Design) else "rectilinear"
    if ax.name != needed:
        rule = f"must have the projection {needed} for a {type(what).__name__}, but got {ax.name}"
        raise BadInput("draw", [Fault("ax", rule)])
    if isinstance(what, Design):
        _draw_platform(what, ax, parts)
    else:
        _draw_figure(what, ax)


def _draw_platform(design: Design, ax: Any, parts: Sequence[str]) -> None:
    from topo_search.export.picture import Drawing  # imports matplotlib, which the extra `viz` installs

    if unknown := [part for part in parts if part not in get_args(Part)]:
        raise BadInput("draw", [Fault("parts", f"must be among {', '.join(get_args(Part))}, but got {unknown[0]}")])
    if (layout := ax.figure.get_layout_engine()) is not None:
        ax.set_axis_off()  # the drawing makes room for labels itself
        layout.execute(ax.figure)
        ax.set_axis_on()
    drawing = Drawing(ax, design, poses_to_draw(design))
    for part in get_args(Part):  # in the order of their depth
        if part in parts:
            getattr(drawing, part)()
    drawing.finish()
    if "airflow" not in parts:
        drawing.number_modules()


def _draw_figure(figure: go.Figure, ax: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    if unknown := {trace.type for trace in figure.data} - {"scatter"}:
        raise BadInput("draw", [Fault("what", f"must be a two-dimensional figure, but has {', '.join(unknown)}")])
    for trace in figure.data:
        if trace.yaxis in (None, "y"):
            _draw_trace(trace, ax)
    layout = figure.layout
    for shape in layout.shapes:
        ax.axhline(shape.y0, color="0.3", linestyle="--", linewidth=0.8)
    ax.set(xlabel=layout.xaxis.title.text, ylabel=layout.yaxis.title.text)
    if layout.yaxis.range is not None:
        ax.set_ylim(layout.yaxis.range)
    if all(np.asarray(trace.x).dtype.kind == "i" for trace in figure.data):
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    if len(ax.get_legend_handles_labels()[1]) > 1:
        ax.legend()


def _draw_trace(trace: Any, ax: Axes) -> None:
    x, y = np.asarray(trace.x), np.asarray(trace.y)
    if trace.mode == "lines":
        dash, steps = DASHES.get(trace.line.dash, "-"), STEPS.get(trace.line.shape, "default")
        ax.plot(x, y, color=trace.line.color, linestyle=dash, drawstyle=steps, label=trace.name)
        return
    symbol = trace.marker.symbol
    symbols = np.broadcast_to("circle" if symbol is None else symbol, len(x))
    for symbol in dict.fromkeys(symbols.tolist()):
        chosen = symbols == symbol
        label = trace.name if chosen[0] else None  # one entry of the legend
        ax.plot(x[chosen], y[chosen], MARKERS[symbol], color=trace.marker.color, label=label)

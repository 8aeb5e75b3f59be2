"""Charts of the page: clearances as matrices, rotor inputs against their limits, the progress of a search."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from topo_search.export import palette
from topo_search.model import Audit, Clearance, Design
from topo_search.model.proven import at_least, at_most
from topo_search.report.wording import clearance, figures, length, millimetres
from topo_search.study import SolveEvent

IN_CELLS = 7
"""Largest matrix whose values are written into its cells, so that they fit."""
TIGHT = 0.01
"""A clearance up to this has a colour [m]."""
MOST_POINTS = 4000
"""Largest number of points of a chart; of more solves, evenly many are left out."""
PAIRWISE = {
    "airflow": "airflow envelopes, clearance of each pair [mm]",
    "separation": "module centres, distance beyond the least one [mm]",
    "body": "bodies, clearance of each pair [mm]",
    "rotor-airflow": "rotors, hubs and arms (rows) beside other modules' airflow (columns) [mm]",
    "bracket-airflow": "brackets, by the module they hold (rows), beside airflow of modules (columns) [mm]",
    "bracket-rotor": "brackets (rows) beside rotors of modules (columns) [mm]",
}


def clearance_matrices(design: Design, audit: Audit) -> Iterator[tuple[str, go.Figure]]:
    """Yield a caption and a matrix for every kind of pair of modules, and for modules against requirements."""
    n = design.topology.n
    for kind, caption in PAIRWISE.items():
        pairs = [pair for pair in audit.pairs if pair.kind == kind]
        if pairs:
            # the least last: of a module's rotors, hub and arms one cell shows the nearest
            cells = {(p.a, p.b): p for p in sorted(pairs, key=lambda pair: pair.analytic_m, reverse=True)}
            if n <= IN_CELLS and kind in ("airflow", "separation", "body"):  # rows and columns are alike
                cells |= {(b, a): pair for (a, b), pair in cells.items()}
            yield caption, _matrix(cells, n, [str(j) for j in range(n)], "module")
    rest = [pair for pair in audit.pairs if pair.kind not in PAIRWISE]
    if rest:
        columns = list(dict.fromkeys(_requirement(pair) for pair in rest))
        modules = (pair.b if pair.kind == "rod-airflow" else pair.a for pair in rest)
        cells = {(i, columns.index(_requirement(pair))): pair for i, pair in zip(modules, rest, strict=True)}
        yield "modules against requirements [mm]", _matrix(cells, n, columns, "")


def _requirement(pair: Clearance) -> str:
    """Name what a module is kept away from."""
    if name := {"exclusion": "tip", "rod": "rod", "rod-airflow": "rod, airflow"}.get(pair.kind):
        return name
    solid = {"part-region": "solid ", "rod-region": "rod, solid "}.get(pair.kind, "")
    return f"{solid}exposure {pair.b}" + ("" if pair.segment is None else f", part {pair.segment}")


def _matrix(cells: dict[tuple[int, int], Clearance], n: int, columns: Sequence[str], title: str) -> go.Figure:
    """Return a matrix of clearances in millimetres; what is tight or not clear has a colour."""
    colours = (palette.CELL, palette.TIGHT, palette.NOT_CLEAR)  # only what is critical has a colour
    levels = np.full((n, len(columns)), np.nan)
    hover = np.full((n, len(columns)), "", dtype=object)
    written: list[tuple[str, str, str, str]] = []
    for (i, j), pair in cells.items():
        level = 2 if pair.status != "clear" else int(pair.analytic_m <= TIGHT)
        levels[i, j] = level
        lower = "none" if pair.lower_m is None else length(at_least(pair.lower_m, 3))
        upper = "none" if pair.upper_m is None else length(at_most(pair.upper_m, 3))
        hover[i, j] = f"{pair.name}<br>{pair.status}, {clearance(pair)}<br>proven: {lower} to {upper}"
        written.append((columns[j], str(i), millimetres(pair), palette.IN_CELLS[level]))
    figure = go.Figure(
        go.Heatmap(
            z=levels.astype(np.float32),
            x=list(columns),
            y=[str(i) for i in range(n)],
            customdata=hover,
            hovertemplate="%{customdata}<extra></extra>",
            hoverongaps=False,
            xgap=1,
            ygap=1,
            colorscale=[(k / 3, colour) for level, colour in enumerate(colours) for k in (level, level + 1)],
            zmin=0,
            zmax=2,
            showscale=False,
        )
    )
    if written and max(n, len(columns)) <= IN_CELLS:
        x, y, text, tints = (list(column) for column in zip(*written, strict=True))
        look = {"size": 12, "color": tints}
        figure.add_trace(go.Scatter(x=x, y=y, text=text, textfont=look, mode="text", hoverinfo="skip"))
    figure.update_layout(
        xaxis={"type": "category", "title": {"text": title}, "constrain": "domain", "showgrid": False},
        yaxis={
            "type": "category",
            "title": {"text": "module"},
            "autorange": "reversed",
            "scaleanchor": "x" if title else None,
            "constrain": "domain",
            "showgrid": False,
        },
        showlegend=False,
    )
    return figure


def rotor_inputs(design: Design) -> go.Figure:
    """Return every rotor input in units of the largest one that is allowed, a trace for each load case."""
    u_max = design.task.module.max_input(design.task.gravity)
    n = design.topology.n
    x = np.arange(n).repeat(4) + np.tile([-0.3, -0.1, 0.1, 0.3], n)
    names = [f"module {i}, rotor {q}" for i in range(n) for q in range(4)]
    figure = go.Figure()
    marks = ("circle", "square", "diamond", "triangle-up", "x", "cross", "star")
    inputs, looks = design.inputs.reshape(-1, 4 * n), itertools.cycle(zip(palette.SERIES, marks, strict=True))
    for case, u, (colour, symbol) in zip(design.task.case_labels, inputs, looks, strict=False):
        figure.add_scatter(
            x=x,
            y=u / u_max,
            name=case,
            mode="markers",
            marker={"color": colour, "symbol": symbol, "size": 6 if n <= 30 else 4},
            text=[f"{name}<br>{case}: {figures(value)} rad²/s²" for name, value in zip(names, u, strict=True)],
            hovertemplate="%{text}, %{y:.3f} u_max<extra></extra>",
        )
    share = design.task.search.peak_input
    largest = "largest input, u_max" if share == 1 else f"largest input, {share:g} u_max"
    for bound, name in ((design.task.module.min_input, "least input"), (share, largest)):
        line = {"color": "#000000", "width": 1.5, "dash": "dash"}
        figure.add_hline(bound, line=line, annotation={"text": name, "yanchor": "bottom", "xanchor": "right"})
    figure.update_layout(
        xaxis={"title": {"text": "module (four rotors each)"}, "dtick": 1 if n <= 30 else None, "zeroline": False},
        yaxis={"title": {"text": "rotor input / u_max"}, "range": [-0.06, 1.13], "zeroline": False},
        legend={"orientation": "h", "y": -0.25},
    )
    return figure


def progress(solves: Sequence[SolveEvent], lower_bound: float) -> go.Figure:
    """Return the incumbent against the number of solves over the count of each status."""
    J = np.array([np.nan if solve.objective is None else solve.objective for solve in solves]) / lower_bound
    number = np.arange(1, len(solves) + 1)
    incumbent = np.fmin.accumulate(J)
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, row_heights=[0.62, 0.38], vertical_spacing=0.06)
    solved = np.flatnonzero(np.isfinite(J))
    shown = _thin(solved)
    figure.add_scatter(
        x=number[shown],
        y=J[shown],
        name="candidate's best so far",
        mode="markers",
        marker={"color": palette.OFFSET, "size": 5, "symbol": "circle"},
        text=[solves[k].key for k in shown],
        hovertemplate="%{text}: %{y:.4f}<extra></extra>",
        row=1,
        col=1,
    )
    steps = np.flatnonzero(np.diff(incumbent, prepend=np.inf) != 0)
    steps = np.append(steps[np.isfinite(incumbent[steps])], len(solves) - 1)
    line = {"color": palette.CONNECTOR, "width": 2.5, "shape": "hv"}
    course = {"x": number[steps], "y": incumbent[steps], "name": "incumbent", "mode": "lines", "line": line}
    figure.add_scatter(**course, row=1, col=1)
    at = _thin(np.arange(len(solves)))
    dashes = ("solid", "dash", "dot", "dashdot")
    for (status, colour), dash in zip(palette.STATUSES.items(), dashes, strict=True):
        count = np.cumsum([solve.status == status for solve in solves])
        if count[-1]:
            line = {"color": colour, "width": 2, "dash": dash}
            figure.add_scatter(x=number[at], y=count[at], name=status, mode="lines", line=line, row=2, col=1)
    top = np.nanpercentile(J, 90) if solved.size else 1.0
    figure.update_yaxes(title={"text": "J / lower bound"}, row=1, col=1)
    if solved.size:
        highest = max(top, float(np.nanmin(J))) + 0.1 * (top - 1.0) + 1e-3
        figure.update_yaxes(range=[1.0 - 0.05 * (top - 1.0), highest], row=1, col=1)
    else:
        figure.update_yaxes(visible=False, row=1, col=1)
        middle = {"x": 0.5, "y": 0.5, "xref": "x domain", "yref": "y domain"}
        figure.add_annotation(text="no solve has found a design", showarrow=False, **middle)
    figure.update_yaxes(title={"text": "solves"}, rangemode="tozero", row=2, col=1)
    figure.update_xaxes(title={"text": "solves"}, row=2, col=1)
    figure.update_layout(legend={"orientation": "h", "y": -0.2})
    return figure


def _thin(indices: Any) -> Any:
    """Return at most MOST_POINTS of some indices, evenly spread, the last one included."""
    if len(indices) <= MOST_POINTS:
        return indices
    return indices[np.linspace(0, len(indices) - 1, MOST_POINTS).round().astype(int)]


def style(figure: go.Figure) -> go.Figure:
    """Give a figure the look of the page."""
    figure.update_layout(
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        modebar={"bgcolor": "rgba(0,0,0,0)", "color": "#777777", "activecolor": "#0072b2"},
        autosize=True,
    )
    if not figure.layout.scene.aspectmode:
        figure.update_layout(margin={"l": 60, "r": 20, "t": 36, "b": 50})
    return figure

"""Charts of the report, and plots of an answer for notebooks and scripts.

Clearances as matrices, rotor inputs with their limits, the progress of a search, control effort over a goal; all in
the format of plotly.js.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from topo_search.export import palette
from topo_search.export.poses import throttles
from topo_search.model import LEAST_EFFORT, Audit, BadInput, Clearance, Design, Fault, Objective
from topo_search.model.exposure import solid_name
from topo_search.model.proven import at_least, at_most, lower_text, upper_text
from topo_search.report import ON_ANY_PAGE, PLOTLY_LAYOUT, Figure
from topo_search.report.wording import clearance, figures, length, modules
from topo_search.study import Answer, FrontPoint, SolveEvent, front
from verify.kinematics import has_rotor

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go


MAX_NUMBERED = 7
"""Largest size of a matrix whose values are written into its cells; in larger ones they do not fit."""
MAX_POINTS = 4000
"""Largest number of points in a chart; more are thinned evenly."""
PAIRWISE = {
    "airflow": "airflow envelopes, clearance of each pair [mm]",
    "separation": "module centres, distance beyond the required one [mm]",
    "body": "bodies, clearance of each pair [mm]",
    "rotor-airflow": "rotors, hubs and arms (rows) to airflow of other modules (columns) [mm]",
    "bracket-airflow": "brackets, by the child module (rows), to airflow of modules (columns) [mm]",
    "bracket-rotor": "brackets (rows) to rotors of modules (columns) [mm]",
}


def clearance_matrices(design: Design, audit: Audit) -> Iterator[tuple[str, Figure]]:
    """Yield caption and matrix for every kind of module pair, and for modules against requirements."""
    n = design.topology.n
    for kind, caption in PAIRWISE.items():
        pairs = [pair for pair in audit.pairs if pair.kind == kind]
        if pairs:
            # smallest last: one cell shows the nearest of a module's rotors, hub and arms
            cells = {(p.a, p.b): p for p in sorted(pairs, key=lambda pair: pair.analytic_m, reverse=True)}
            if n <= MAX_NUMBERED and kind in ("airflow", "separation", "body"):  # symmetric
                cells |= {(b, a): pair for (a, b), pair in cells.items()}
            yield caption, _matrix(cells, n, [str(j) for j in range(n)], "module")
    others = [pair for pair in audit.pairs if pair.kind not in PAIRWISE]
    if others:
        columns = list(dict.fromkeys(_requirement(pair) for pair in others))
        modules = (pair.b if pair.kind == "rod-airflow" else pair.a for pair in others)
        cells = {(i, columns.index(_requirement(pair))): pair for i, pair in zip(modules, others, strict=True)}
        yield "modules against requirements [mm]", _matrix(cells, n, columns, "")


def _requirement(pair: Clearance) -> str:
    """Return a name for what a module must stay clear of."""
    if name := {"exclusion": "tip", "rod": "rod", "rod-airflow": "rod, airflow"}.get(pair.kind):
        return name
    region = solid_name(pair.b, pair.segment, pair.contact)
    solid = {"part-region": region, "rod-region": f"rod, {region}"}.get(pair.kind)
    return solid or f"exposure {pair.b}" + ("" if pair.segment is None else f", part {pair.segment}")


def _matrix(cells: dict[tuple[int, int], Clearance], n: int, columns: Sequence[str], title: str) -> Figure:
    """Return a matrix of clearances in millimetres; tight ones and those that are not clear are coloured."""
    colours = (palette.CELL, palette.TIGHT, palette.NOT_CLEAR)  # only critical cells have a colour
    levels: list[list[int | None]] = [[None] * len(columns) for _ in range(n)]
    hover = [[""] * len(columns) for _ in range(n)]
    cell_texts: list[tuple[str, str, str, str]] = []
    for (i, j), pair in cells.items():
        level = 2 if pair.status != "clear" else int(pair.analytic_m <= 0.01)
        levels[i][j] = level
        lower = "none" if pair.lower_m is None else length(at_least(pair.lower_m, 3))
        upper = "none" if pair.upper_m is None else length(at_most(pair.upper_m, 3))
        hover[i][j] = f"{pair.name}<br>{pair.status}, {clearance(pair)}<br>proven: {lower} to {upper}"
        millimetres = lower_text(1000 * pair.analytic_m, 3).replace("-", "−")
        cell_texts.append((columns[j], str(i), millimetres, palette.IN_CELLS[level]))
    cells_drawn = {"z": levels, "x": list(columns), "y": [str(i) for i in range(n)], "customdata": hover}
    tooltip = {"hovertemplate": "%{customdata}<extra></extra>", "hoverongaps": False, "xgap": 1, "ygap": 1}
    scale = [(k / 3, colour) for level, colour in enumerate(colours) for k in (level, level + 1)]
    look = {"colorscale": scale, "zmin": 0, "zmax": 2, "showscale": False}
    heat = {"type": "heatmap", **cells_drawn, **tooltip, **look}
    texts = []
    if cell_texts and max(n, len(columns)) <= MAX_NUMBERED:
        x, y, text, colours_of_text = (list(column) for column in zip(*cell_texts, strict=True))
        style = {"size": 12, "color": colours_of_text}
        texts = [{"x": x, "y": y, "text": text, "textfont": style, "mode": "text", "hoverinfo": "skip"}]
    axis = {"type": "category", "constrain": "domain", "showgrid": False}
    square = {"scaleanchor": "x" if title else None, "autorange": "reversed"}
    across, down = {**axis, "title": {"text": title}}, {**axis, **square, "title": {"text": "module"}}
    return {"data": [heat, *texts], "layout": {"xaxis": across, "yaxis": down, "showlegend": False}}


def rotor_inputs(design: Design) -> Figure:
    """Return the chart of every rotor input relative to u_max, a trace per load case."""
    n, rotors = design.topology.n, [module.rotor_table.count for module in design.task.modules_of_nodes]
    x = np.concatenate([i + np.linspace(-0.3, 0.3, count) for i, count in enumerate(rotors)])
    names = [f"module {i}, rotor {q}" for i, count in enumerate(rotors) for q in range(count)]
    marks = ("circle", "square", "diamond", "triangle-up", "x", "cross", "star")
    shares, looks = throttles(design), itertools.cycle(zip(palette.SERIES, marks, strict=True))
    inputs = design.inputs[:, has_rotor(design.task)]
    traces = [
        markers(
            *(x.round(1).tolist(), share.tolist(), case, colour),
            [f"{name}<br>{case}: {figures(value)} rad²/s²" for name, value in zip(names, u, strict=True)],
            "%{text}, %{y:.3f} u_max",
            symbol=symbol,
            size=6 if n <= 30 else 4,
        )
        for case, u, share, (colour, symbol) in zip(design.task.case_labels, inputs, shares, looks, strict=False)
    ]
    share = design.task.search.peak_input
    largest = "largest input, u_max" if share == 1 else f"largest input, {share:g} u_max"
    bounds = {"smallest input": design.task.module.min_input, largest: share}
    across = "module" if len({*rotors}) > 1 else f"module ({rotors[0]} rotors each)"
    above = {"x": 1, "xref": "x domain", "yref": "y", "xanchor": "right", "yanchor": "bottom", "showarrow": False}
    layout = {
        **axes(across, "rotor input over u_max", legend=-0.25),
        "shapes": [level(bound, width=1.5) for bound in bounds.values()],
        "annotations": [{**above, "text": name, "y": bound} for name, bound in bounds.items()],
    }
    layout["xaxis"] |= {"dtick": 1 if n <= 30 else None, "zeroline": False}
    layout["yaxis"] |= {"range": [-0.06, 1.13], "zeroline": False}
    return {"data": traces, "layout": layout}


def level(y: float, axis: str = "y", *, width: float) -> dict[str, Any]:
    """Return a dashed horizontal line across a figure."""
    endpoints = {"x0": 0, "x1": 1, "xref": "x domain", "y0": y, "y1": y, "yref": axis}
    return {"type": "line", **endpoints, "line": {"color": "#000000", "width": width, "dash": "dash"}}


def markers(x: Any, y: Any, name: str, colour: str, text: Any, tooltip: str, **style: Any) -> dict[str, Any]:
    """Return a trace of points, each with a text, and the template of its tooltip."""
    points = {"x": x, "y": y, "name": name, "mode": "markers", "marker": {"color": colour, **style}}
    return {**points, "text": text, "hovertemplate": f"{tooltip}<extra></extra>"}


def line(x: Any, y: Any, name: str, colour: str, width: float, **style: Any) -> dict[str, Any]:
    """Return a trace that joins points by a line."""
    return {"x": x, "y": y, "name": name, "mode": "lines", "line": {"color": colour, "width": width, **style}}


def axes(across: str, up: str, *, legend: float) -> dict[str, Any]:
    """Return the layout of a figure with titles of its axes, and the legend below."""
    titles = {"xaxis": {"title": {"text": across}}, "yaxis": {"title": {"text": up}}}
    return {**titles, "legend": {"orientation": "h", "y": legend}}


def progress(solves: Sequence[SolveEvent], objective: Objective, bound: float) -> Figure:
    """Return the chart of the incumbent over the number of solves, above the count of each status.

    It shows J over its lower bound, or a maximised value below its upper bound.
    """
    is_effort = objective.better == "less"
    values = [objective.number(solve) for solve in solves]
    J = np.array([np.nan if x is None else x for x in values]) / (bound if is_effort else 1.0)
    number = np.arange(1, len(solves) + 1)
    incumbent = (np.fmin if is_effort else np.fmax).accumulate(J)
    solved = np.flatnonzero(np.isfinite(J))
    drawn = _thin(solved)
    steps = np.flatnonzero(np.diff(incumbent, prepend=np.inf) != 0)
    steps = np.append(steps[np.isfinite(incumbent[steps])], len(solves) - 1) if solved.size else solved
    keys = [solves[k].key for k in drawn]
    candidate_points = number[drawn].tolist(), J[drawn].tolist()
    incumbent_points = number[steps].tolist(), incumbent[steps].tolist()
    style = {"size": 5, "symbol": "circle"}
    traces = [
        markers(*candidate_points, "candidate's best so far", palette.OFFSET, keys, "%{text}: %{y:.4f}", **style),
        line(*incumbent_points, "incumbent", palette.CONNECTOR, 2.5, shape="hv"),
    ]
    sampled = _thin(np.arange(len(solves)))
    dashes = ("solid", "dash", "dot", "dashdot")
    for (status, colour), dash in zip(palette.STATUSES.items(), dashes, strict=True):
        count = np.cumsum([solve.status == status for solve in solves])
        if count[-1]:
            counted = line(number[sampled].tolist(), count[sampled].tolist(), status, colour, 2, dash=dash)
            traces.append({**counted, "yaxis": "y2"})
    layout = axes("solves", "J over lower bound" if is_effort else objective.column, legend=-0.2)
    layout["xaxis"]["anchor"] = "y2"
    layout["yaxis"]["domain"] = [0.42, 1.0]
    layout["yaxis2"] = {"title": {"text": "solves"}, "domain": [0.0, 0.36], "rangemode": "tozero"}
    if solved.size and not is_effort:
        low = float(np.nanpercentile(J, 10))
        layout["shapes"] = [level(bound, width=1.5)]
        layout["yaxis"]["range"] = [low - 0.1 * (bound - low), bound + 0.1 * (bound - low)]
    elif solved.size:
        top = np.nanpercentile(J, 90)
        highest = max(top, float(np.nanmin(J))) + 0.1 * (top - 1.0) + 1e-3
        layout["yaxis"]["range"] = [1.0 - 0.05 * (top - 1.0), highest]
    else:
        layout["yaxis"]["visible"] = False
        middle = {"x": 0.5, "y": 0.5, "xref": "x domain", "yref": "y domain", "showarrow": False}
        layout["annotations"] = [{"text": "no solve has found a design", **middle}]
    return {"data": traces, "layout": layout}


def _thin(indices: Any) -> Any:
    if len(indices) <= MAX_POINTS:
        return indices
    return indices[np.linspace(0, len(indices) - 1, MAX_POINTS).round().astype(int)]


AXES = {
    "clearance": ("clearance", "smallest clearance [mm]", 1e3),
    "stand_off": ("stand-off", "smallest distance of the end-effector from a module's centre [cm]", 1e2),
    "peak_input": ("peak input", "largest rotor input over u_max", 1.0),
    "force_reserve": ("force reserve", "force reserve at the end-effector in any direction [N]", 1.0),
    "torque_reserve": ("torque reserve", "torque reserve in any direction [N m]", 1.0),
    "rotor_out": ("failures", "any one rotor failure survived in", 1.0),
    "joint_moment": ("joint moment", "largest moment in a joint [N m]", 1.0),
    "hinge_angle_deg": ("hinge error", "tolerated error of every hinge angle [deg]", 1.0),
    "speed": ("air speed", "air speed in the regions, proven bound [m/s]", 1.0),
    "modules": ("modules", "modules", 1.0),
    "objective": ("control effort", "control effort J [rad⁴/s⁴]", 1.0),
}
TITLES = {
    "modules": "modules",
    "orbit": "symmetric copies",
    "objective": "control effort J [rad⁴/s⁴]",
    "lower_bound": "lower bound of J [rad⁴/s⁴]",
    "gap": "gap, 1 - bound / J",
    "violation": "violation of the worst constraint [its unit]",
    "starts": "starts",
    "starts_feasible": "feasible starts",
    "seconds": "time of all solves [s]",
    "starts_at_best": "hits",
    "force_reserve_N": "force reserve at the tip, any direction [N]",
    "torque_reserve_Nm": "torque reserve, any axis [N m]",
    "rotors_out_hover": "rotors that may fail in hover, one at a time",
    "load_factor": "load until a rotor saturates [load cases]",
    "joint_moment_Nm": "largest moment in a joint [N m]",
    "hinge_tolerance_deg": "tolerated error of every hinge angle [deg]",
    "rod_length_m": "length of the rod [m]",
    "power_W": "shaft power in hover [W]",
    "air_tip_m_s": "air speed at the tip, at most [m/s]",
    "air_region_m_s": "air speed in the regions, at most [m/s]",
    "force_reserve_com_N": "force reserve at the centre of mass, any direction [N]",
    "tilt_deg": "tilt in hover [deg]",
    "proven_bound": "bound proven by branch and bound",
    "proven_gap": "gap proven by branch and bound",
    "value": "maximised value",
    "value_bound": "upper bound of the maximised value",
    "reach": "value asked for",
}
"""Titles of the numeric columns of `candidates.csv` as axes."""


def front_chart(points: Sequence[FrontPoint], name: str, objective: Objective = LEAST_EFFORT) -> Figure:
    """Return the chart of control effort, or the maximised value, over a goal: all designs, and the best ones."""
    is_effort = objective.better == "less"
    unit = points[0].row.objective or 1.0 if is_effort else 1.0
    _, title, scale = AXES[name]

    def coordinates(chosen: Sequence[FrontPoint]) -> tuple[list[Any], list[float]]:
        values = [point.cells[name] for point in chosen]
        x = [scale * value if isinstance(value, int | float) else value for value in values]
        return x, [(objective.number(point.row) or 0.0) / unit for point in chosen]

    best, dotted = f"{objective.least} for this or better", {"dash": "dot", "shape": "vh"}
    texts = ["<br>".join(_describe(point)) for point in points]
    layout = axes(title, "J over least J of the front" if is_effort else objective.column, legend=-0.25)
    layout["xaxis"]["dtick"] = 1 if name == "modules" else None
    traces = [
        {**line(*coordinates(front(points, [name])), best, palette.CONNECTOR, 1.5, **dotted), "hoverinfo": "skip"},
        markers(*coordinates(points), "designs of the front", palette.CONNECTOR, texts, "%{text}", size=9),
    ]
    return {"data": traces, "layout": layout}


def _describe(point: FrontPoint) -> Iterator[str]:
    """Yield the lines of a design's tooltip."""
    yield f"{point.row.key}, {modules(point.row.modules)}"
    yield f"J = {figures(point.row.objective or 0.0, 5)} rad⁴/s⁴"
    if point.row.value is not None:
        yield f"value {lower_text(point.row.value, 4)}"
    yield f"clearance {length_or_none(point.clearance)}, stand-off {length_or_none(point.stand_off)}"
    yield f"largest input {upper_text(point.peak_input, 4)} u_max"
    yield f"any one rotor failure survived in: {point.rotor_out}"
    yield f"level {point.number}: {point.level.words}"


def length_or_none(metres: float | None) -> str:
    """Return a length with its unit, rounded down, or "none"."""
    return "none" if metres is None else length(at_least(metres, 3))


Choice = TypeVar("Choice")


def plot_front(answer: Answer, goal: str | None = None) -> go.Figure:
    """Plot the Pareto front of a run: J, or the maximised value, over one of its goals.

    Args:
        answer: the answer of a run with goals.
        goal: the goal's name, or `objective` for the control effort; default: the first with values on the front.

    Raises:
        BadInput: the run has no goals or no design, or the front has no values for the goal.

    Example:
        >>> from topo_search import plot_front, search
        >>> answer = search("goals-front", out="goals")  # doctest: +SKIP
        >>> plot_front(answer, "clearance").show()  # doctest: +SKIP
    """
    names = [name for name in AXES if any(point.cells[name] is not None for point in answer.points)]
    chosen = _choose("goal", names, goal or next(iter(names), None))
    return _plotly_figure(front_chart(answer.points, chosen, answer.objective))


def plot_history(answer: Answer, modules: int | None = None) -> go.Figure:
    """Plot the best design so far over the number of solves, and the count of each status.

    Args:
        answer: the answer of a run; of a run with goals, the level of its best design is shown.
        modules: number of modules; default: that of the best design, or the smallest.

    Raises:
        BadInput: the run has no such size.

    Example:
        >>> from topo_search import plot_history, read_answer
        >>> type(plot_history(read_answer("hover-2"))).__name__
        'Figure'
    """
    bounds = {size.modules: size.value_bound or size.lower_bound for size in answer.at_level.sizes}
    n = _choose("modules", list(bounds), modules or (answer.best.modules if answer.best else min(bounds)))
    candidates, solves = (_of_level(answer, frame) for frame in (answer.candidates, answer.solves))
    keys = candidates.loc[candidates["modules"] == n, "key"]
    events = [SolveEvent(*row) for row in solves[solves["key"].isin(keys)].itertuples(index=False)]
    return _plotly_figure(progress(events, answer.objective, bounds[n]))


def plot_candidates(answer: Answer, x: str = "hinge_tolerance_deg", y: str = "objective") -> go.Figure:
    """Plot two numbers of all candidates against each other, coloured by number of modules.

    Args:
        answer: the answer of a run; of a run with goals, the level of its best design is shown.
        x: numeric column of `answer.candidates` on the horizontal axis.
        y: numeric column on the vertical axis.

    Raises:
        BadInput: there is no such numeric column.

    Example:
        >>> from topo_search import plot_candidates, read_answer
        >>> plot_candidates(read_answer("hover-2"), x="rod_length_m").layout.xaxis.title.text
        'length of the rod [m]'
    """
    candidates = _of_level(answer, answer.candidates)
    numbers = list(candidates.select_dtypes("number").columns)
    for name, column in (("x", x), ("y", y)):
        _choose(name, numbers, column)
    traces = []
    for colour, size in zip(palette.SERIES, answer.at_level.sizes, strict=False):
        rows = candidates[candidates["modules"] == size.modules].dropna(subset=[x, y])
        symbols = np.where(rows["audit"] == "clear", "circle", "x")
        texts = rows["key"] + ", audit " + rows["audit"].fillna("none")
        name, tooltip = f"{size.modules} modules", f"%{{text}}<br>{TITLES[x]}: %{{x}}<br>{TITLES[y]}: %{{y}}"
        traces.append(markers(rows[x], rows[y], name, colour, texts, tooltip, size=9, symbol=symbols))
    titles = {"xaxis": {"title": {"text": TITLES[x]}}, "yaxis": {"title": {"text": TITLES[y]}}}
    return _plotly_figure({"data": traces, "layout": {**titles, "showlegend": True}})


def _plotly_figure(figure: Figure) -> go.Figure:
    import plotly.graph_objects as go  # slow to import, and not needed for pages

    return go.Figure(figure["data"], {**PLOTLY_LAYOUT, **ON_ANY_PAGE, **figure["layout"]})


def _of_level(answer: Answer, frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame["level"] == answer.level].drop(columns="level") if answer.levels else frame


def _choose(field: str, valid: Sequence[Choice], chosen: Choice | None) -> Choice:
    """Return the chosen value; BadInput if it is not valid."""
    if chosen is None or chosen not in valid:
        names = ", ".join(map(str, valid)) or "none"
        raise BadInput("plot", [Fault(field, f"must be one of {names}, but got {chosen}")])
    return chosen

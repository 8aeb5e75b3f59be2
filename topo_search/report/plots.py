"""Plots of an answer for notebooks and scripts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import pandas as pd
import plotly.graph_objects as go

from topo_search.export import palette
from topo_search.model import BadInput, Fault
from topo_search.report import charts
from topo_search.report.front_part import AXES, front_chart
from topo_search.study import Answer, SolveEvent

Value = TypeVar("Value")


def plot_front(answer: Answer, goal: str | None = None) -> go.Figure:
    """Return the front of a run with goals: J over one of them, as a Plotly figure.

    Args:
        answer: the answer of a run with goals.
        goal: the goal's name; default: the first that the front has figures for.

    Raises:
        BadInput: the run has no goals or no design, or its front has no such figure.

    Example:
        >>> from topo_search import plot_front, search
        >>> answer = search("goals-front", out="goals")  # doctest: +SKIP
        >>> plot_front(answer, "clearance").show()  # doctest: +SKIP
    """
    names = [name for name in AXES if any(point.cells[name] is not None for point in answer.points)]
    return charts.style(front_chart(answer.points, _choose("goal", names, goal or next(iter(names), None))))


def plot_history(answer: Answer, modules: int | None = None) -> go.Figure:
    """Return the best effort over the number of solves, and how the solves ended, as a Plotly figure.

    Args:
        answer: the answer of a run; of a run with goals, the level of its best design is shown.
        modules: size to show; default: that of the best design, or the smallest.

    Raises:
        BadInput: the run has no such size.

    Example:
        >>> from topo_search import plot_history, read_answer
        >>> type(plot_history(read_answer("hover-2"))).__name__
        'Figure'
    """
    bounds = {size.modules: size.lower_bound for size in answer.at_level.sizes}
    n = _choose("modules", list(bounds), modules or (answer.best.modules if answer.best else min(bounds)))
    candidates, solves = (_of_level(answer, frame) for frame in (answer.candidates, answer.solves))
    keys = candidates.loc[candidates["modules"] == n, "key"]
    events = [SolveEvent(*row) for row in solves[solves["key"].isin(keys)].itertuples(index=False)]
    return charts.style(charts.progress(events, bounds[n]))


def plot_candidates(answer: Answer, x: str = "hinge_tolerance_deg", y: str = "objective") -> go.Figure:
    """Return one figure of all candidates over another, coloured by size, as a Plotly figure.

    Args:
        answer: the answer of a run; of a run with goals, the level of its best design is shown.
        x: a column of numbers of `answer.candidates`.
        y: another.

    Raises:
        BadInput: there is no such column of numbers.

    Example:
        >>> from topo_search import plot_candidates, read_answer
        >>> plot_candidates(read_answer("hover-2"), x="rod_length_m").layout.xaxis.title.text
        'rod_length_m'
    """
    candidates = _of_level(answer, answer.candidates)
    numbers = list(candidates.select_dtypes("number").columns)
    for name, column in (("x", x), ("y", y)):
        _choose(name, numbers, column)
    figure = go.Figure()
    for colour, size in zip(palette.SERIES, answer.at_level.sizes, strict=False):
        rows = candidates[candidates["modules"] == size.modules].dropna(subset=[x, y])
        figure.add_scatter(
            x=rows[x],
            y=rows[y],
            name=f"{size.modules} modules",
            mode="markers",
            marker={
                "color": colour,
                "size": 9,
                "symbol": ["circle" if audit == "clear" else "x" for audit in rows["audit"]],
            },
            text=rows["key"] + ", audit " + rows["audit"].fillna("none"),
            hovertemplate=f"%{{text}}<br>{x}: %{{x}}<br>{y}: %{{y}}<extra></extra>",
        )
    figure.update_layout(xaxis={"title": {"text": x}}, yaxis={"title": {"text": y}}, showlegend=True)
    return charts.style(figure)


def _of_level(answer: Answer, frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame["level"] == answer.level].drop(columns="level") if answer.levels else frame


def _choose(field: str, valid: Sequence[Value], chosen: Value | None) -> Value:
    """Return what was chosen, if it is valid."""
    if chosen is None or chosen not in valid:
        names = ", ".join(map(str, valid)) or "none"
        raise BadInput("plot", [Fault(field, f"must be one of {names}, but got {chosen}")])
    return chosen

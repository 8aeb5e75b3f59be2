"""The front of a run with goals: effort against each goal, its designs, and the outcome of every level."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import plotly.graph_objects as go

from topo_search.export import palette
from topo_search.model.proven import at_least, upper_text
from topo_search.report.page import Chart, Table
from topo_search.report.wording import figures, length, modules, quantity
from topo_search.study import Answer, FrontPoint, front

AXES = {
    "clearance": ("clearance", "least clearance [mm]", 1e3),
    "stand_off": ("stand-off", "least distance of the end-effector from a module's centre [cm]", 1e2),
    "peak_input": ("peak input", "largest rotor input / u_max", 1.0),
    "force_reserve": ("reserve of force", "any force that can be added at the end-effector [N]", 1.0),
    "torque_reserve": ("reserve of torque", "any torque that can be added [N m]", 1.0),
    "rotor_out": ("failures", "possible with any one rotor dead", 1.0),
    "joint_moment": ("joint moment", "largest moment in a joint [N m]", 1.0),
    "hinge_angle_deg": ("hinge error", "error of every hinge angle that is survived [deg]", 1.0),
    "speed": ("air speed", "air over the regions, proven bound [m/s]", 1.0),
    "modules": ("modules", "modules", 1.0),
}


def front_part(answer: Answer, names: Sequence[str]) -> dict[str, Any]:
    """Return all that is shown of a front.

    Args:
        answer: of a run with goals.
        names: the goals.
    """
    charts = [
        Chart(f"front-{name.replace('_', '-')}", f"J against {AXES[name][0]}", front_chart(answer.points, name))
        for name in names
        if any(point.cells[name] is not None for point in answer.points)
    ]
    return {"charts": charts, "designs": _designs(answer.points), "levels": _levels(answer)}


def front_chart(points: Sequence[FrontPoint], name: str) -> go.Figure:
    """Return effort over a goal: all points, and what each value of the goal takes, whatever the other goals."""
    least = points[0].row.objective or 1.0
    _, title, scale = AXES[name]

    def at(chosen: Sequence[FrontPoint]) -> dict[str, list[Any]]:
        values = [point.cells[name] for point in chosen]
        x = [scale * value if isinstance(value, int | float) else value for value in values]
        return {"x": x, "y": [(point.row.objective or 0.0) / least for point in chosen]}

    figure = go.Figure()
    figure.add_scatter(
        **at(front(points, [name])),
        name="least control effort for as good a value",
        mode="lines",
        line={"color": palette.CONNECTOR, "width": 1.5, "dash": "dot", "shape": "vh"},
        hoverinfo="skip",
    )
    figure.add_scatter(
        **at(points),
        name="designs of the front",
        mode="markers",
        marker={"color": palette.CONNECTOR, "size": 9},
        text=["<br>".join(_describe(point)) for point in points],
        hovertemplate="%{text}<extra></extra>",
    )
    figure.update_layout(
        xaxis={"title": {"text": title}, "dtick": 1 if name == "modules" else None},
        yaxis={"title": {"text": "J / least J of the front"}},
        legend={"orientation": "h", "y": -0.25},
    )
    return figure


def _describe(point: FrontPoint) -> Iterator[str]:
    """Yield one design in lines, for the pointer."""
    yield f"{point.row.key}, {modules(point.row.modules)}"
    yield f"J = {figures(point.row.objective or 0.0, 5)} rad⁴/s⁴"
    yield f"clearance {_length(point.clearance)}, stand-off {_length(point.stand_off)}"
    yield f"largest input {upper_text(point.peak_input, 4)} u_max"
    yield f"any one rotor dead: {point.rotor_out}"
    yield f"level {point.number}: {point.level.words}"


def _designs(points: Sequence[FrontPoint]) -> Table:
    least = points[0].row.objective if points else None
    rows = [
        [
            point.row.key,
            str(point.row.modules),
            figures(point.row.objective or 0.0, 5),
            f"{(point.row.objective or 0.0) / least:.4f}" if least else "",
            _length(point.clearance),
            _length(point.stand_off),
            upper_text(point.peak_input, 4),
            str(point.number),
            point.row.audit or "",
        ]
        for point in points
    ]
    reached = ("least clearance", "stand-off", "largest input / u_max")
    columns = ("tree", "modules", "J [rad⁴/s⁴]", "J / least J", *reached, "level", "audit")
    return Table(columns, rows, range(1, 8))


def _levels(answer: Answer) -> Table:
    """Return a row for every level and size, with the reason where nothing was found."""
    on_front = [point.number for point in answer.points]
    rows = [
        {
            "level": str(at.number),
            "held at": at.level.words,
            "modules": str(size.modules),
            "candidates": size.counts,
            "best there": size.best.key if size.best else "none",
            "J [rad⁴/s⁴]": figures(size.best.objective, 5) if size.best and size.best.objective is not None else "",
            "gives the front": quantity(on_front.count(at.number), "design"),
            "why none": size.reason or "",
        }
        for at in answer.levels
        for size in at.sizes
    ]
    return Table.from_rows(rows, {0, 2, 5})


def _length(metres: float | None) -> str:
    return "none" if metres is None else length(at_least(metres, 3))

"""What `fly` showed of a design, for its page: the table, the course of every flight, what no simulation knows."""

from __future__ import annotations

import csv
import io
import itertools
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from topo_search.export import palette
from topo_search.limits import RESULT_BYTES
from topo_search.model.arrays import Array
from topo_search.model.bad_input import BadInput, Fault, show
from topo_search.model.design import Design
from topo_search.model.files import load_text, read_json
from topo_search.model.flight import direction
from topo_search.report.charts import MOST_POINTS
from topo_search.report.page import Chart, SimulatedPart, Table
from topo_search.report.wording import figures
from topo_search.simulation.result import NO_DOWNWASH, FlightResult, ScenarioResult, digest_of

EVIDENCE = "This is evidence from a simulation. It never changes the audit's verdict."
COURSE = ("error_x_m", "error_y_m", "error_z_m", "tilt_deg", "largest_input")
DASHES = ("solid", "dash", "dot")


def read_simulated(folder: Path, design: Design) -> SimulatedPart:
    """Return what a folder that `fly --out` wrote says of a design.

    Raises:
        BadInput: a file is missing or damaged, or the flights are those of another design.
    """
    result = read_json(FlightResult, folder / "flight.json")
    if result.design != digest_of(design):
        rule = "must be of the design whose page this is; fly it again with --out"
        raise BadInput(str(folder / "flight.json"), [Fault("design", f"{rule} (got {show(result.design)})")])
    course = _course(folder / "flight.csv", {one.name for one in result.scenarios})
    return simulated_part(result, course)


def simulated_part(result: FlightResult, course: dict[str, Array]) -> SimulatedPart:
    """Return all that is shown of flights.

    Args:
        result: their table.
        course: time and COURSE of each that was flown, (T, 1 + 5).
    """
    x = result.options
    rod = f", the rod's {figures(1000 * result.rod_mass_kg, 3)} g included" if result.rod_mass_kg > 0 else ""
    sentences = (
        f"Simulated: {figures(result.mass_kg, 4)} kg{rod}; "
        f"motor lag {figures(1000 * x.get('motor_lag_s', 0.0), 3)} ms, sensor noise × {x.get('noise', 0.0):g}, "
        f"model error {100 * x.get('model_error', 0.0):g} %, seed {x.get('seed', 0.0):g}.",
        f"Side force in hover: {figures(result.weakest_force_N, 3)} N in the weakest direction "
        f"({direction(result.weakest_direction)}), {figures(100 * result.weakest_force_share, 3)} % of the weight; "
        f"hover survives {result.rotors_out} of {result.rotors} single rotor failures.",
        *result.notes,
        *(() if NO_DOWNWASH in result.notes else (NO_DOWNWASH,)),
        EVIDENCE,
    )
    caption = "Errors of position and attitude, and the largest input; a click on a name hides that flight"
    chart = Chart("simulated-course", caption, _figure(course)) if course else None
    return SimulatedPart(result.verdict, _scenarios(result), chart, sentences)


def _scenarios(result: FlightResult) -> Table:
    columns = ("scenario", "verdict", "drift", "tilt", "force error", "at limit", "short", "largest input", "why")
    return Table(columns, [_row(one) for one in result.scenarios], frozenset(range(2, 8)))


def _row(one: ScenarioResult) -> tuple[str, ...]:
    def share(value: float | None) -> str:
        return "" if value is None else f"{100 * value:.1f}\u00a0%"

    why = "" if one.reason is None else one.reason
    return (
        *(one.name, one.verdict if one.counts else f"{one.verdict} (informative)"),
        "" if one.drift_m is None else f"{100 * one.drift_m:.2f}\u00a0cm",
        "" if one.tilt_deg is None else f"{one.tilt_deg:.2f}°",
        *(share(one.force_error_share), share(one.saturated_share), share(one.missed_share)),
        *(share(one.largest_input), why),
    )


def _course(path: Path, names: set[str]) -> dict[str, Array]:
    """Return the rows of each flight, (T, 1 + 5)."""
    rows: dict[str, list[list[float]]] = {}
    reader = csv.DictReader(io.StringIO(load_text(path, most_bytes=RESULT_BYTES)))
    for row in reader:
        name = row.get("scenario")
        if name not in names:
            rule = f"line {reader.line_num}: must be of a scenario of flight.json, but got {show(name)}"
            raise BadInput(str(path), [Fault("scenario", rule)])
        try:
            numbers = [float(row[column]) for column in ("time_s", *COURSE)]
        except (KeyError, TypeError, ValueError):
            rule = f"line {reader.line_num}: must have a number in each of time_s, {', '.join(COURSE)}"
            raise BadInput(str(path), [Fault("", rule)]) from None
        rows.setdefault(str(name), []).append(numbers)
    return {name: np.array(values) for name, values in rows.items()}


def _figure(course: dict[str, Array]) -> go.Figure:
    """Return error, tilt and largest thrust of all flights over time."""
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    every = 1 + sum(map(len, course.values())) // MOST_POINTS
    looks = itertools.cycle((colour, dash) for dash in DASHES for colour in palette.SERIES)
    for (name, rows), (colour, dash) in zip(course.items(), looks, strict=False):
        shown_rows = rows[::every]
        error = 100 * np.linalg.norm(shown_rows[:, 1:4], axis=1)
        for place, values in enumerate((error, shown_rows[:, 4], shown_rows[:, 5]), start=1):
            line = go.Scatter(
                x=shown_rows[:, 0].astype(np.float32),
                y=values.astype(np.float32),
                name=name,
                legendgroup=name,
                showlegend=place == 1,
                mode="lines",
                line={"color": colour, "width": 1.5, "dash": dash},
            )
            figure.add_trace(line, row=place, col=1)
    for place, title in enumerate(("error [cm]", "tilt [deg]", "input / limit"), start=1):
        figure.update_yaxes(title={"text": title}, rangemode="tozero", row=place, col=1)
    figure.add_hline(1.0, line={"color": "#000000", "width": 1, "dash": "dash"}, row=3, col=1)
    figure.update_xaxes(title={"text": "time [s]"}, row=3, col=1)
    figure.update_layout(legend={"orientation": "h", "y": -0.15})
    return figure

"""Pages without a run's own: a design with what `fly` showed of it, designs beside each other, any vehicle."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from topo_search.export import palette
from topo_search.export.sheet import STYLE
from topo_search.limits import LIMITS
from topo_search.model import Audit, Design, Status
from topo_search.model.arrays import Array
from topo_search.model.files import load_text, read_json
from topo_search.model.flight import Capability, direction
from topo_search.model.proven import at_least, gap_percent, lower_text
from topo_search.model.text import html_page, paragraph, table
from topo_search.model.value import BadInput, Fault, show
from topo_search.report import Figure, Table, Tile
from topo_search.report.charts import MOST_POINTS, level, line
from topo_search.report.design_part import cases, flight_sentences
from topo_search.report.headline import card, headline
from topo_search.report.scene import shared_meshes
from topo_search.report.wording import EFFORT, figures, modules
from topo_search.simulation.result import CELLS, FlightResult, ScenarioResult, digest_of, word


def design_page(design: Design, audit: Audit, file: str, simulated: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the page of a design.

    Args:
        design: the design.
        audit: its audit.
        file: the name of its file, for the commands.
        simulated: what it did in simulation.
    """
    task = design.task
    gap = design.gap if audit.verdict == Status.CLEAR else None  # the effort of another design bounds nothing
    return {
        "title": title(task.name, task.n),
        "key": design.topology.key,
        "answer": "This report covers one design, not a search.",
        "tiles": tuple(headline(design, audit, gap, "a single design")),
        "notes": () if audit.inputs_words is None else (audit.inputs_words,),
        "bound": bound(design.lower_bound, gap, task.n),
        "task": task,
        "user_task": task,
        "design": design,
        "audit": audit,
        "reproduction": _reproduction(design, audit, file),
        "simulated": simulated,
    }


def title(name: str, n: int) -> str:
    """Return what a page is about: its task and size."""
    return f"{name}: {modules(n)}"


def bound(lower_bound: float | None, gap: float | None, n: int) -> tuple[str, ...]:
    """Return the lower bound and what it means, a paragraph each."""
    if lower_bound is None:
        return ("The design states no lower bound, so how far it is from the optimum is unknown.",)
    statement = f"Lower bound: {figures(at_least(lower_bound, 5), 5)} rad⁴/s⁴ for the control effort {EFFORT}."
    meaning = (
        f"It holds for every platform of {modules(n)} of this kind, for any tree, hinge angles and end-effector "
        "position: it is what the forces of the load cases would cost rotors within their limits if every thrust "
        "axis could point wherever it is needed. Torques and geometry are neglected, so part of the gap may come "
        "from the bound rather than from the design. It allows for the audit's tolerances of forces and "
        "inputs, so no design whose audit is clear lies below it."
    )
    if gap is None:
        return statement, meaning
    return (
        statement,
        f"The gap is {gap_percent(gap)}: no platform of {modules(n)} saves more than this share of J.",
        meaning,
    )


def _reproduction(design: Design, audit: Audit, file: str) -> dict[str, Any]:
    """Return how to audit the design again and, if it says how it was found, how to find it."""
    solver: dict[str, Any] = design.solver or {}
    commands = [f"topo-search audit {file}"]
    if isinstance(solver.get("seed"), int) and isinstance(solver.get("starts"), int):
        options = f"--starts {solver['starts']} --seed {solver['seed']}"
        commands.append(f"topo-search solve task.toml --topology {design.topology.key} {options}")
    both = {**(solver.get("versions") or {}), **audit.versions}
    versions = {str(name): str(value) for name, value in both.items()}
    return {"commands": commands, "task": design.task, "versions": versions, "notes": ()}


COURSE = ("error_x_m", "error_y_m", "error_z_m", "tilt_deg", "largest_input")


def read_simulated(folder: Path, design: Design) -> dict[str, Any]:
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


def simulated_part(result: FlightResult, course: dict[str, Array]) -> dict[str, Any]:
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
        f"hover survives {result.rotors_out} of {result.rotors} single rotor failures, each known after "
        f"{x.get('detection_time_s', 0.1):g} s.",
        *result.notes,
        "This is evidence from a simulation. It never changes the audit's verdict.",
    )
    caption = "Errors of position and attitude, and the largest input; a click on a name hides that flight"
    scenarios = Table(("scenario", "outcome", *CELLS, "why"), [_row(one) for one in result.scenarios], range(2, 8))
    chart = ("simulated-course", caption, _figure(course)) if course else None
    return {"outcome": word(result), "scenarios": scenarios, "course": chart, "sentences": sentences}


def _row(one: ScenarioResult) -> tuple[str, ...]:
    cells = (cell.replace(" deg", "°").replace(" ", "\u00a0") for cell in one.cells)
    return one.name, word(one) if one.counts else f"{word(one)} (informative)", *cells, one.reason or ""


def _course(path: Path, names: set[str]) -> dict[str, Array]:
    """Return the rows of each flight, (T, 1 + 5)."""
    rows: dict[str, list[list[float]]] = {}
    reader = csv.DictReader(io.StringIO(load_text(path, most_bytes=LIMITS.result_bytes)))
    for row in reader:
        name = row.get("scenario")
        if name not in names:
            rule = f"line {reader.line_num}: must be of a scenario of flight.json, but got {show(name)}"
            raise BadInput(str(path), [Fault("scenario", rule)])
        try:
            numbers = [float(row[column]) for column in ("time_s", *COURSE)]
        except (KeyError, TypeError, ValueError):
            rule = f"line {reader.line_num}: must have a number in each of time_s, {', '.join(COURSE)}"
            raise BadInput(str(path), rule) from None
        rows.setdefault(str(name), []).append(numbers)
    return {name: np.array(values) for name, values in rows.items()}


def _figure(course: dict[str, Array]) -> Figure:
    """Return error, tilt and largest thrust of all flights over time."""
    traces = []
    every = 1 + sum(map(len, course.values())) // MOST_POINTS
    looks = itertools.cycle((colour, dash) for dash in ("solid", "dash", "dot") for colour in palette.SERIES)
    for (name, rows), (colour, dash) in zip(course.items(), looks, strict=False):
        shown_rows = rows[::every]
        error = 100 * np.linalg.norm(shown_rows[:, 1:4], axis=1)
        for row, values in enumerate((error, shown_rows[:, 4], shown_rows[:, 5]), start=1):
            drawn = line(shown_rows[:, 0].round(4).tolist(), values.round(4).tolist(), name, colour, 1.5, dash=dash)
            traces.append({**drawn, "yaxis": f"y{row}", "legendgroup": name, "showlegend": row == 1})
    layout: dict[str, Any] = {
        "xaxis": {"title": {"text": "time [s]"}, "anchor": "y3"},
        "shapes": [level(1.0, "y3", width=1)],
        "legend": {"orientation": "h", "y": -0.15},
    }
    for row, title in enumerate(("error [cm]", "tilt [deg]", "input / limit"), start=1):
        domain = [(3 - row) * 0.35, (3 - row) * 0.35 + 0.3]
        layout[f"yaxis{row}"] = {"title": {"text": title}, "rangemode": "tozero", "domain": domain}
    return {"data": traces, "layout": layout}


def vehicle_page(name: str, rotors: int, capability: Capability) -> str:
    """Return the page.

    Args:
        name: the vehicle's file.
        rotors: how many it has.
        capability: what it can do.
    """
    summary, *others = (text.replace(" of module 0", "") for text in flight_sentences(capability.flight))
    reserves = cases(capability.flight)
    verdict = {True: "meets every load case of the task.", False: "does not meet the task.", None: ""}[
        capability.met
    ]
    lines = [
        paragraph(f"{rotors} rotors, rank {capability.rank} of 6. {verdict and f'The vehicle {verdict}'}".strip()),
        paragraph(
            f"Without torque it exerts any force up to {lower_text(capability.zero_torque_ball_N, 5)} N; all such "
            f"forces have a volume of {lower_text(capability.zero_torque_volume_N3, 5)} N³."
        ),
        paragraph(summary),
        table(reserves.columns, reserves.rows),
        *map(paragraph, others),
    ]
    return html_page(name, f"{STYLE}body {{ max-width: 260mm }}", lines)


class Compared(NamedTuple):
    """A design with the name that tells it from the others."""

    name: str
    design: Design
    audit: Audit | None
    gap: float | None
    """Largest share of its effort that another platform of its size can save."""


def compare_page(first: Sequence[Compared], second: Sequence[Compared]) -> dict[str, Any]:
    """Return the page.

    Args:
        first: designs of the first run, the best first; or the first design alone.
        second: those of the second.
    """
    most = 10  # designs of one run
    shown = {one.name: one for one in (*first[:most], *reversed(second[:most]))}
    cards = []
    for one in shown.values():
        made = card(one.name, one.design, one.audit, _effort(one.design), one.gap)
        made["view"]["value"]["meshes"] = shared_meshes(one.design)
        cards.append(made)
    return {
        "title": f"{first[0].name} beside {second[0].name}",
        "answer": "Designs of two sources in linked views; figures that differ are marked.",
        "tiles": (),
        "compared": {"figures": figure_table(first[0], second[0]), "cards": cards},
    }


def figure_table(first: Compared, second: Compared) -> Table:
    """Return every figure of two designs, a row each."""
    sides = [
        {"Control effort": _effort(one.design).figure}
        | {tile.name: tile.figure for tile in headline(one.design, one.audit, one.gap, "")}
        for one in (first, second)
    ]
    rows = [[name, *(side.get(name, "") for side in sides)] for name in sides[0] | sides[1]]
    return Table(("figure", first.name, second.name), rows)


def _effort(design: Design) -> Tile:
    return Tile("Control effort", f"{figures(design.objective, 5)} rad⁴/s⁴", EFFORT)

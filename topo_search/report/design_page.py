"""Pages that need no run: one design with its simulated flights, designs side by side, and any vehicle."""

import io
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from topo_search.export import palette
from topo_search.export.audits import forces_without_torque
from topo_search.limits import LIMITS
from topo_search.model import Array, Audit, Capability, Design, LargestValue, ResolvedTask, Status, objective_of
from topo_search.model.files import load_text, read_json
from topo_search.model.flight import direction
from topo_search.model.html import html_page, paragraph, table
from topo_search.model.maximized import Quantity
from topo_search.model.proven import gap_percent
from topo_search.model.value import BadInput, Fault, as_bad_input, show
from topo_search.report import Figure, Table, Tile
from topo_search.report.charts import MAX_POINTS, level, line
from topo_search.report.design_part import cases, flight_sentences
from topo_search.report.headline import Compared, card, headline
from topo_search.report.polytope import polytopes
from topo_search.report.scene import shared_meshes
from topo_search.report.wording import EFFORT, figures, modules, quantity, rounded_down, rounded_up, sentence
from topo_search.simulation.files import POSE
from topo_search.simulation.result import CELLS, FlightResult, ScenarioResult, digest_of, word


def design_page(design: Design, audit: Audit, file: str, simulated: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the page of a design.

    Args:
        design: the design.
        audit: its audit.
        file: the name of its file, for the commands to reproduce it.
        simulated: its simulated flights, as `read_simulated` returns them.
    """
    task = design.task
    gap = design.gap if audit.verdict == Status.CLEAR else None  # only the effort of a clear design counts
    return {
        "title": f"{task.name}: {modules(task.n)}",
        "key": design.topology.key,
        "answer": "This report covers one design, not a search.",
        "tiles": tuple(headline(design, audit, gap, "in this design")),
        "notes": () if audit.inputs_words is None else (audit.inputs_words,),
        "bound": bound(design.lower_bound, gap, task),
        "polytopes": polytopes([(design, audit)]),
        "task": task,
        "user_task": task,
        "design": design,
        "audit": audit,
        "simulated": simulated,
        "reproduction": _reproduction(design, audit, file),
    }


def bound(
    lower_bound: float | None, gap: float | None, task: ResolvedTask, value_bound: float | None = None
) -> tuple[str, ...]:
    """Return paragraphs on the bound of effort, or of a maximised value: its value, the gap, and what it means."""
    objective = objective_of(task)
    if value_bound is not None and isinstance(objective, LargestValue):
        return tuple(_value_bound(objective.quantity, value_bound, gap, task))
    if lower_bound is None:
        return ("The design has no lower bound, so its distance from the optimum is unknown.",)
    n, attitude = task.n, task.attitude and " that keeps one attitude for all wrenches"
    alike = task.module.rotor_table.is_uniform
    differ = "" if alike else " Rotors differ, so it is not the sum of squared thrusts."
    statement = (
        f"Lower bound: {rounded_down(lower_bound, digits=5)} rad⁴/s⁴ for the control effort {EFFORT}.{differ}"
    )
    meaning = (
        f"It holds for every platform of {modules(n)} of this kind{attitude}, with any tree, hinge angles and "
        "end-effector position. It is the control effort for the forces of the load cases, within the rotors' "
        "limits, if every thrust axis could point in any direction. Torques and geometry are neglected, so part of "
        "the gap may come from the bound rather than from the design. It allows for the audit's tolerances on "
        "forces and inputs, so no design with a clear audit lies below it."
    )
    if gap is None:
        return statement, meaning
    return (
        statement,
        f"The gap is {gap_percent(gap)}: no platform of {modules(n)} saves more than this share of J.",
        meaning,
    )


def _value_bound(quantity: Quantity, bound: float, gap: float | None, task: ResolvedTask) -> Iterator[str]:
    """Yield paragraphs on the upper bound of a maximised quantity."""
    platforms, most = f"platform of {modules(task.n)}", f"{rounded_up(bound, digits=5)} {quantity.unit}"
    yield f"Upper bound: {most} for the {quantity.words} of every {platforms}."
    if gap is not None:
        yield f"The gap is {gap_percent(gap)}: no {platforms} has a {quantity.words} that is larger by more."
    yield (
        "It holds for any tree, hinge angles and end-effector position. Thrust axes and levers cannot serve all "
        "directions at once: the bound is what all rotors together can do for them. Geometry, except for the "
        "lengths of levers, is neglected, so part of the gap may come from the bound rather than from the design. "
        "It allows for the audit's tolerances. `topo-search prove` lowers it."
    )


def _reproduction(design: Design, audit: Audit, file: str) -> dict[str, Any]:
    """Return the commands that audit the design again and, if its solver settings are known, find it again."""
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
    """Read the simulated flights of a design from a folder that `fly --out` wrote.

    Raises:
        BadInput: a file is missing or damaged, or the flights belong to another design.
    """
    result = read_json(FlightResult, folder / "flight.json")
    if result.design != digest_of(design):
        rule = "must be the digest of this design; fly it again with --out"
        raise BadInput(str(folder / "flight.json"), [Fault("design", f"{rule} (got {show(result.design)})")])
    path = folder / "flight.csv"
    with as_bad_input(str(path)):
        course = course_of(load_text(path, most_bytes=LIMITS.result_bytes))
    options = result.options
    rod = f", the rod's {figures(1000 * result.rod_mass_kg, 3)} g included" if result.rod_mass_kg > 0 else ""
    sentences = (
        f"Simulated: {figures(result.mass_kg, 4)} kg{rod}; "
        f"motor lag {figures(1000 * options.get('motor_lag_s', 0.0), 3)} ms, "
        f"sensor noise × {options.get('noise', 0.0):g}, "
        f"model error {100 * options.get('model_error', 0.0):g} %, seed {options.get('seed', 0.0):g}.",
        f"Side force in hover: {figures(result.weakest_force_N, 3)} N in the weakest direction "
        f"({direction(result.weakest_direction)}), {figures(100 * result.weakest_force_share, 3)} % of the weight; "
        f"it {result.statics}.",
        *result.notes,
        "This is evidence from a simulation. It does not affect the audit's verdict.",
    )
    caption = "Position error, attitude error and largest input; click a name to hide that flight"
    scenarios = Table(("scenario", "outcome", *CELLS, "reason"), [*map(_row, result.scenarios)], range(2, 8))
    chart = ("simulated-course", caption, _figure(course)) if course else None
    flights = flights_of(course, result)
    return {
        "outcome": word(result),
        "scenarios": scenarios,
        "course": chart,
        "sentences": sentences,
        "flights": flights,
    }


def _row(scenario: ScenarioResult) -> tuple[str, ...]:
    cells = (cell.replace(" deg", "°").replace(" ", "\u00a0") for cell in scenario.cells)
    outcome = word(scenario) + " (informative)" * (not scenario.counts)
    return scenario.name, outcome, *cells, scenario.reason or ""


def course_of(text: str) -> dict[str, Array]:
    """Return the time series of each flight: time, `COURSE` and, but for older files, `POSE`.

    Args:
        text: the content of flight.csv.
    """
    import pandas as pd  # slow to import, and other pages do not need it

    numbers, columns = ["time_s", *COURSE], ["time_s", *COURSE, *POSE]
    rows = pd.read_csv(
        io.StringIO(text),
        usecols=lambda name: name in ("scenario", *columns),
        dtype=dict.fromkeys(columns, "float64"),
    )
    rows = rows.dropna(subset=numbers).reindex(columns=["scenario", *columns])
    return {str(name): flight[columns].to_numpy() for name, flight in rows.groupby("scenario", sort=False)}


def flights_of(course: dict[str, Array], result: FlightResult) -> list[dict[str, Any]]:
    """Return the flights that the 3-D view plays: rows of time, position, quaternion without its scalar, errors."""
    outcomes = {scenario.name: word(scenario) for scenario in result.scenarios}
    played = []
    for name, rows in course.items():
        time, error, tilt, largest, position, turn = np.split(rows[::3], [1, 4, 5, 6, 9], axis=1)
        if np.isnan(turn).any():  # a file of an older version
            return []
        vector = turn[:, 1:] * np.where(turn[:, :1] < 0, -1, 1)
        away = 100 * np.linalg.norm(error, axis=1, keepdims=True)
        shown = np.hstack([time, position, vector, away, tilt, 100 * largest])
        played.append({"name": name, "outcome": outcomes[name], "rows": (shown.round(4) + 0.0).tolist()})
    return played


def _figure(course: dict[str, Array]) -> Figure:
    """Return the chart of position error, tilt and largest input of all flights over time."""
    traces = []
    stride = 1 + sum(map(len, course.values())) // MAX_POINTS
    looks = itertools.cycle((colour, dash) for dash in ("solid", "dash", "dot") for colour in palette.SERIES)
    for (name, rows), (colour, dash) in zip(course.items(), looks, strict=False):
        samples = rows[::stride]
        error = 100 * np.linalg.norm(samples[:, 1:4], axis=1)
        for row, values in enumerate((error, samples[:, 4], samples[:, 5]), start=1):
            trace = line(samples[:, 0].round(4).tolist(), values.round(4).tolist(), name, colour, 1.5, dash=dash)
            traces.append({**trace, "yaxis": f"y{row}", "legendgroup": name, "showlegend": row == 1})
    layout: dict[str, Any] = {
        "xaxis": {"title": {"text": "time [s]"}, "anchor": "y3"},
        "shapes": [level(1.0, "y3", width=1)],
        "legend": {"orientation": "h", "y": -0.15},
    }
    for row, title in enumerate(("position error [cm]", "tilt [deg]", "input over limit"), start=1):
        domain = [(3 - row) * 0.35, (3 - row) * 0.35 + 0.3]
        layout[f"yaxis{row}"] = {"title": {"text": title}, "rangemode": "tozero", "domain": domain}
    return {"data": traces, "layout": layout}


def vehicle_page(name: str, rotors: int, capability: Capability) -> str:
    """Return the page of a vehicle.

    Args:
        name: the name of the vehicle's file.
        rotors: number of rotors.
        capability: its forces, reserves and failure cases.
    """
    from topo_search.export.sheet import STYLE  # slow to import, and other pages do not need it

    summary, *others = (text.replace(" of module 0", "") for text in flight_sentences(capability.flight))
    reserves = cases(capability.flight)
    verdict = {True: "meets every load case of the task.", False: "does not meet the task.", None: ""}[
        capability.met
    ]
    lines = [
        paragraph(f"{rotors} rotors, rank {capability.rank} of 6. {verdict and f'The vehicle {verdict}'}".strip()),
        *(paragraph(sentence(line)) for line in forces_without_torque(capability)),
        paragraph(summary),
        table(reserves.columns, reserves.rows),
        *map(paragraph, others),
    ]
    return html_page(name, f"{STYLE}body {{ max-width: 260mm }}", lines)


def compare_page(first: Sequence[Compared], second: Sequence[Compared]) -> dict[str, Any]:
    """Return the page that compares two runs or designs.

    Args:
        first: designs of the first run, the best first; or a single design.
        second: designs of the second run, or a single design.
    """
    limit = 10  # designs per run
    by_name = {compared.name: compared for compared in (*first[:limit], *reversed(second[:limit]))}
    cards = []
    for compared in by_name.values():
        made_card = card(compared, _effort(compared.design))
        made_card["view"]["meshes"] = shared_meshes(compared.design)
        cards.append(made_card)
    return {
        "title": f"{first[0].name} and {second[0].name}",
        "answer": "Designs from two sources in linked views; figures that differ are highlighted.",
        "tiles": (),
        "compared": {"figures": figure_table(first[0], second[0]), "cards": cards},
    }


class Comparison(list[list[Compared]]):
    """The designs of two runs, the best first, whose best ones a notebook shows side by side."""

    def __repr__(self) -> str:
        return " and ".join(f"{side[0].name} ({quantity(len(side), 'design')})" for side in self)

    def _repr_html_(self) -> str:
        shown = figure_table(self[0][0], self[1][0])
        return table(shown.columns, shown.rows)


def figure_table(first: Compared, second: Compared) -> Table:
    """Return a table of all key figures of two designs."""
    sides = [
        {"Control effort": _effort(compared.design).figure}
        | {tile.name: tile.figure for tile in headline(compared.design, compared.audit, compared.gap, "")}
        for compared in (first, second)
    ]
    rows = [[name, *(side.get(name, "") for side in sides)] for name in sides[0] | sides[1]]
    return Table(("figure", first.name, second.name), rows)


def _effort(design: Design) -> Tile:
    return Tile("Control effort", f"{figures(design.objective, 5)} rad⁴/s⁴", EFFORT)

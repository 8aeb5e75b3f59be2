"""`topo-search fly`: simulate a design in closed loop."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from topo_search.cli import options
from topo_search.cli.errors import command, needs_extras, note

if TYPE_CHECKING:
    from topo_search.simulation.result import FlightResult, ScenarioResult


@command(epilog="Example: topo-search fly runs/push-*/best.json --out flight --video flight.webp")
@click.argument("design", metavar="DESIGN.json")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder for flight.json, flight.csv and flight.png.",
)
@options.out("--video", "video", "Render some flights as an animated .gif or .webp, 1280 x 720; needs no display.")
@options.seed
@options.real_number("--noise", (0, 100), "Scale factor for the sensor noise.", default=1.0)
@options.real_number(
    "--model-error",
    (0, 0.5),
    "Relative standard deviation of masses and thrusts from the controller's model.",
    default=0.0,
)
@options.flag(
    "--rotor-out", "Require that a rotor failure is survived, as `flight.rotor_out` does; otherwise only report it."
)
@options.real_number(
    "--detection-time",
    (0, 10),
    "Time until the controller knows that a rotor has failed.",
    default=0.1,
    metavar="SECONDS",
)
@options.choice(
    "--allocator",
    ["bounded", "pseudo-inverse"],
    "Thrusts by least squares within limits, or by PX4's rule: the pseudo-inverse, clipped at the limits.",
    default="bounded",
)
@click.option(
    "--wake/--no-wake",
    default=True,
    help="Reduce each rotor's thrust by the wakes of other modules, as the audit's air model predicts.",
)
@click.option(
    "--only", multiple=True, metavar="NAME", help="Fly only scenarios whose name starts with NAME (repeatable)."
)
@options.as_json
def fly(design: str, out: Path | None, video: Path | None, **option_values: Any) -> None:
    """Fly a design in closed-loop simulation with rotor limits, motor lag and noise.

    Scenarios: hover; recovery from an offset of 10 cm and 10 degrees to four sides; tilts by
    flight.tilt_deg; a gust; every load case that carries the weight, with its load at the end-effector and, if it
    pushes, against a wall that all parts can touch; the weakest corners of its cone and vertices, with their load
    at the end-effector; a rotor failure. Load cases that are not steady flight are reported as such. The
    simulation does not change the audit; `report DESIGN.json --flight DIR` shows its results on a page. Needs the
    extra `sim`.

    Exit status: 0 every scenario that counts recovered; 1 one did not; 2 bad input, or the extra is missing.
    """
    from topo_search import compose

    completed = compose.read_completed(design)
    for option, path in (("--video", video), ("--out", out and out / "flight.json")):
        options.require_writable(path, option)
    if video is None:  # else MuJoCo would load a graphics library, which may be missing
        os.environ["MUJOCO_GL"] = "disable"
    os.environ.setdefault("MUJOCO_GL", "egl")
    with needs_extras("fly"):
        result = compose.fly(
            completed,
            out=out,
            video=video,
            tell=lambda flown: note(": ".join(filter(None, (flown.name, _outcome(flown), flown.reason)))),
            **option_values,
        )
    options.echo_answer(result.model_dump(mode="json"), _lines(result))
    if result.verdict != "held":
        raise SystemExit(1)


def _outcome(scenario: ScenarioResult) -> str:
    from topo_search.simulation.result import word

    return word(scenario) + " (informative)" * (scenario.verdict == "not held" and not scenario.counts)


def _lines(result: FlightResult) -> Iterator[str]:
    """Yield a table of the scenarios, and the outcome of all that count."""
    from topo_search.cli.tables import table_lines
    from topo_search.simulation.result import CELLS, word

    rows = ((scenario.name, _outcome(scenario), *scenario.cells) for scenario in result.scenarios)
    yield from table_lines(("scenario", "outcome", *CELLS[:-1], "largest"), rows)
    yield f"in simulation: {word(result)}"

"""Results of flights, the contents of `flight.json`."""

from typing import Literal

from topo_search.model import Design, Value
from topo_search.model.html import heading, paragraph, table
from topo_search.model.kinds import Flag, Index, Number, Vector
from topo_search.study.request import digest

Verdict = Literal["held", "not held", "not flown"]
Outcome = Literal["lost", "saturated", "off target", "recovered", "not flown"]
"""Worst first. `lost`: ended early; `saturated`: limits exceeded, rotors saturated; `off target`: not saturated."""

CELLS = ("drift", "tilt", "force error", "at limit", "demand unmet", "largest input")
"""Column names of a scenario's figures."""


class ScenarioResult(Value):
    """Result of one scenario."""

    name: str
    verdict: Verdict
    """`held` if `outcome` is `recovered`; for readers of older files, which have no `outcome`."""
    outcome: Outcome | None = None
    """`lost`: ended early; `saturated`: limits exceeded with rotors at theirs; `off target`: limits exceeded with
    rotors below theirs; None in older files."""
    reason: str | None = None
    """Why it did not recover, or was not flown."""
    counts: Flag = True
    """True if the overall verdict depends on this scenario."""
    seconds: Number = 0.0
    """Simulated time [s]."""
    drift_m: Number | None = None
    """Largest position error in the judged interval [m]."""
    tilt_deg: Number | None = None
    """Largest attitude error in the judged interval [deg]."""
    settled_s: Number | None = None
    """Settling time, from which errors stay within the limits [s]."""
    force_N: Number | None = None
    """Mean force on the environment in the judged interval, along the required force [N]."""
    force_error_share: Number | None = None
    """Error of the mean force over the required force."""
    saturated_share: Number | None = None
    """Share of time that the most saturated rotor is at its largest thrust."""
    missed_share: Number | None = None
    """Share of time in which the rotors cannot produce the commanded wrench."""
    largest_input: Number | None = None
    """Largest commanded thrust over the largest thrust of a rotor."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Figures with units in the order of CELLS; empty strings for missing ones."""
        shares = self.force_error_share, self.saturated_share, self.missed_share, self.largest_input
        return (
            "" if self.drift_m is None else f"{100 * self.drift_m:.2f} cm",
            "" if self.tilt_deg is None else f"{self.tilt_deg:.2f} deg",
            *("" if share is None else f"{100 * share:.1f} %" for share in shares),
        )


class FlightResult(Value):
    """The file `flight.json`."""

    format: Literal["topo-search/flight"] = "topo-search/flight"
    version: Literal[1] = 1
    design: str | None = None
    """Digest of the flown design; None in older files."""
    verdict: Literal["held", "not held"]
    """`not held` if a scenario that counts did not recover; for readers of older files, as in scenarios."""
    outcome: Outcome | None = None
    """Worst outcome of the scenarios that count; None in older files."""
    scenarios: tuple[ScenarioResult, ...]
    weakest_force_N: Number
    """Smallest force that the rotors can add in hover, over horizontal directions in steps of 15 deg [N]."""
    weakest_force_share: Number
    """Weakest force over the weight."""
    weakest_direction: Vector
    rotors_out: Index
    """Number of single rotor failures that hover survives by statics, as in an audit but with the simulated rod."""
    hover_only: Index | None = None
    """Number of those after which it can only hover; None in older files, whose `rotors_out` includes them."""
    rotors: Index
    mass_kg: Number
    """Simulated mass, rod included."""
    rod_mass_kg: Number
    """Mass of the rod, if the design's model ignores it."""
    options: dict[str, Number]
    versions: dict[str, str]
    notes: tuple[str, ...] = ()

    @property
    def statics(self) -> str:
        """Single rotor failures by statics, in words that no flight stands for."""
        hovers = f"hovers statically after {self.rotors_out + (self.hover_only or 0)} of {self.rotors}"
        controls = "" if self.hover_only is None else f", {self.rotors_out} of them with torque left for control"
        return f"{hovers} single rotor failures{controls} (computed, not flown)"

    def _repr_html_(self) -> str:
        rows = [(scenario.name, word(scenario), *scenario.cells, scenario.reason) for scenario in self.scenarios]
        html = table(("scenario", "outcome", *CELLS, "why"), rows)
        return heading(f"flight in simulation: {word(self)}") + html + "".join(map(paragraph, self.notes))


def word(result: ScenarioResult | FlightResult) -> str:
    """Return the outcome; older files only say whether it is `recovered`."""
    return result.outcome or result.verdict.replace("held", "recovered")


def digest_of(design: Design) -> str:
    """Return a digest of a design's task, tree and numbers, without the fields that only its file states."""
    numbers = design.model_dump(mode="json", exclude={"solver", "task"})
    return digest({**numbers, "task": design.task.model_dump(mode="json")})


NO_DOWNWASH = (
    "Flown without downwash (--no-wake): against it the simulation relies on the airflow envelopes of the audit."
)

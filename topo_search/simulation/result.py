"""Results of flights, as `flight.json` holds them."""

from __future__ import annotations

from typing import Literal

from topo_search.model.design import Design
from topo_search.model.text import heading, paragraph, table
from topo_search.model.value import Flag, Index, Number, Value, Vector
from topo_search.study.request import digest

Verdict = Literal["held", "not held", "not flown"]
Outcome = Literal["lost", "saturated", "off target", "recovered", "not flown"]
"""Worst first. `lost`: ended early; `saturated`: missed a limit with rotors at theirs; `off target`: without."""


CELLS = ("drift", "tilt", "force error", "at limit", "demand unmet", "largest input")
"""Names of the figures of a scenario."""


class ScenarioResult(Value):
    """One scenario."""

    name: str
    verdict: Verdict
    outcome: Outcome | None = None
    """`lost`: ended early; `saturated`: missed a limit with rotors at theirs; `off target`: missed one without;
    None in files that do not say."""
    reason: str | None = None
    """Why it did not recover, or was not flown."""
    counts: Flag = True
    """True if the overall verdict depends on this scenario."""
    seconds: Number = 0.0
    """Simulated [s]."""
    drift_m: Number | None = None
    """Largest error of position while it was judged [m]."""
    tilt_deg: Number | None = None
    """Largest error of attitude while it was judged [deg]."""
    settled_s: Number | None = None
    """When errors had come within the limits to stay [s]."""
    force_N: Number | None = None
    """Mean force on the environment while it was judged, along the one asked for [N]."""
    force_error_share: Number | None = None
    """Mean error of that force, over the force asked for."""
    saturated_share: Number | None = None
    """Share of the time in which the rotor that was most at its largest thrust was there."""
    missed_share: Number | None = None
    """Share of the time in which rotors could not produce the wrench that the controller asked for."""
    largest_input: Number | None = None
    """Largest thrust that was commanded, over the largest of a rotor."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Figures with their units, by the names of CELLS; empty where one is missing."""
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
    """`digest_of` the design that was flown; None in files that do not say."""
    verdict: Literal["held", "not held"]
    """`held` if every scenario that was flown and counts recovered."""
    outcome: Outcome | None = None
    """The worst of the scenarios that count; None in files that do not say."""
    scenarios: tuple[ScenarioResult, ...]
    weakest_force_N: Number
    """The least force that rotors can add in hover, of horizontal directions in steps of 15 deg [N]."""
    weakest_force_share: Number
    """The same over the weight."""
    weakest_direction: Vector
    rotors_out: Index
    """Number of single rotor failures that hover survives, by the same least squares as in flight."""
    rotors: Index
    mass_kg: Number
    """Simulated, with the rod's."""
    rod_mass_kg: Number
    """The model leaves it out."""
    options: dict[str, Number]
    versions: dict[str, str]
    notes: tuple[str, ...] = ()

    def _repr_html_(self) -> str:
        """Show a notebook the table."""
        rows = [(one.name, word(one), *one.cells, one.reason) for one in self.scenarios]
        shown = table(("scenario", "outcome", *CELLS, "why"), rows)
        return heading(f"flight in simulation: {word(self)}") + shown + "".join(map(paragraph, self.notes))


def word(result: ScenarioResult | FlightResult) -> str:
    """Return the outcome; of files that do not say, the verdict."""
    return result.outcome or result.verdict


def digest_of(design: Design) -> str:
    """Return a short name of a design that differs whenever its task, tree or numbers do."""
    return digest(design.model_dump(mode="json", exclude={"solver"}))


NO_DOWNWASH = (
    "Flown without downwash (--no-wake): against it the simulation relies on the airflow envelopes of the audit."
)

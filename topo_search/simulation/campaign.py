"""The campaign of all flights of a design: their selection, order and overall result.

It starts with the capability of the rotors in hover, which often explains why a flight fails.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import get_args

import numpy as np

from topo_search.model import Array, BadInput, Design, Fault, RotorsOut
from topo_search.model.load_case import labels
from topo_search.model.placement import must_pull
from topo_search.simulation import scenarios
from topo_search.simulation.controller import Allocator, Controller
from topo_search.simulation.fly import Options, Track, Watch, fly, judge
from topo_search.simulation.plant import Nominal, in_wakes, nominal
from topo_search.simulation.result import NO_DOWNWASH, FlightResult, Outcome, ScenarioResult, digest_of
from verify.air.bound import case_jets, ingested_wakes
from verify.flight.analysis import CapabilityAnalysis
from verify.flight.programs import Bounds
from verify.kinematics import has_rotor
from verify.requirements import Scene

HOVER_TOLERANCE = 1e-3
"""Largest residual of the hover wrench by least squares, in weights and arm lengths times weights."""


def hover_residual(nominal: Nominal, dead: int | None = None) -> tuple[float, float]:
    """Return the residual of the hover wrench, in weights and arm lengths times weights, and the largest input."""
    allocator = Allocator(nominal)
    if dead is not None:
        allocator.stop_rotor(dead)
    T, missing = allocator.thrusts(np.array([0.0, 0.0, nominal.weight, 0.0, 0.0, 0.0]))
    residual = np.abs(missing) / nominal.weight / np.repeat([1.0, nominal.arm], 3)
    return float(residual.max()), float((T / nominal.largest_thrust).max())


def hardest_rotor(nominal: Nominal) -> int:
    """Return the rotor whose failure is hardest on hover."""
    residuals = [hover_residual(nominal, rotor) for rotor in range(nominal.B.shape[1])]
    severity = [(max(residual, HOVER_TOLERANCE), largest_input) for residual, largest_input in residuals]
    return max(range(len(residuals)), key=severity.__getitem__)


def static_failures(nominal: Nominal, torque: float | None) -> RotorsOut:
    """Return the single rotor failures that hover survives by statics, as the audit counts them.

    Args:
        nominal: the model of the platform.
        torque: `flight.rotor_out_torque` [N m]; None: its default.
    """
    N, units = nominal.B.shape[1], (nominal.weight, nominal.arm)
    box = Bounds(np.full(N, nominal.least_share), np.ones(N))
    A = nominal.B * nominal.largest_thrust
    return CapabilityAnalysis(A, nominal.tip, units, box, {}, [None], None, torque).rotors_out([0])


def worst_wakes(design: Design) -> tuple[float, ...]:
    """Return W of each rotor, in the wakes of its worst load case [N]."""
    density, modules = design.task.air_density, design.task.modules_of_nodes
    V = np.max([ingested_wakes(jets)[1][has_rotor(design.task)] for _, jets in case_jets(Scene(design))], axis=0)
    radii, losses = (
        np.concatenate(x)
        for x in zip(*((m.rotor_radii, np.full_like(m.rotor_radii, m.wake_loss)) for m in modules), strict=True)
    )
    return tuple((2 * density * math.pi * (radii * losses * V) ** 2).tolist())


def hover_losses(nominal: Nominal, wakes: tuple[float, ...]) -> tuple[Array, float]:
    """Return the thrust that each rotor loses in hover, (N,) [N], and the share of the one that loses most."""
    T, _ = Allocator(nominal).thrusts(np.array([0.0, 0.0, nominal.weight, 0.0, 0.0, 0.0]))
    lost = T - in_wakes(T, np.array(wakes))
    most = int(np.argmax(lost))
    return lost, float(lost[most] / T[most]) if lost[most] else 0.0


def describe_losses(nominal: Nominal, wakes: tuple[float, ...]) -> str:
    """Return a note on the thrust lost to wakes in hover, and whether the rotors can make up for it."""
    thrusts, share = hover_losses(nominal, wakes)
    lost, full = nominal.B @ thrusts, nominal.largest_thrust
    force, torque = np.linalg.norm(lost[:3]), np.linalg.norm(lost[3:])
    residual, _ = hover_residual(replace(nominal, B=nominal.B * in_wakes(full, np.array(wakes)) / full))
    comparison = "more" if residual > HOVER_TOLERANCE else "less"
    return (
        f"Wakes of other modules take up to {100 * share:.2g} % of a rotor's thrust in hover: together "
        f"{force:.2g} N and {torque:.2g} N m, {comparison} than the rotors can add."
    )


CORNERS = 12
"""Largest number of vertices of wrench cones and sets to fly; each takes a second or two."""

FlownScenario = tuple[scenarios.Scenario, Track]


@dataclass(frozen=True)
class Campaign:
    """The flights of a design, and their result."""

    result: FlightResult
    flown: tuple[FlownScenario, ...]


def fly_all(
    design: Design,
    options: Options,
    *,
    rotor_out: bool = False,
    only: tuple[str, ...] = (),
    tell: Callable[[ScenarioResult], None] = lambda _: None,
    watch: Callable[[scenarios.Scenario], Watch | None] = lambda _: None,
) -> Campaign:
    """Fly all scenarios of a design.

    Args:
        design: the design.
        options: options of the flights.
        rotor_out: whether a rotor failure must be survived even if the task does not require it.
        only: prefixes of the scenarios to fly; empty: all.
        tell: called with the result of each scenario as it finishes.
        watch: returns the observer of a scenario, if any.

    Raises:
        BadInput: the rotors cannot hover the platform, or no scenario's name begins with a prefix.
    """
    model = nominal(design)
    _require_hover(design, model)
    wakes = worst_wakes(design) if options.wake else ()
    options = replace(options, errors=replace(options.errors, wakes=wakes))
    force, d = model.hover.weakest_force()
    rotor, out = hardest_rotor(model), static_failures(model, design.task.flight.rotor_out_torque)
    results: list[ScenarioResult] = []
    flown: list[FlownScenario] = []
    for planned in plan(design, rotor, rotor_out):
        if only and not planned.name.startswith(only):
            continue
        if isinstance(planned, ScenarioResult):
            result = planned
        else:
            track, lost = fly(design, planned, options, watch(planned), model)
            flown.append((planned, track))
            result = judge(planned, track, lost)
        results.append(result)
        tell(result)
    if not results:
        names = ", ".join(planned.name for planned in plan(design, rotor, rotor_out))
        raise BadInput("--only", [Fault("", f"must begin the name of a scenario, one of {names}; got {only[0]}")])
    outcomes = (result.outcome for result in results if result.counts and result.outcome)
    outcome: Outcome = min(outcomes, key=get_args(Outcome).index, default="not flown")
    rod_mass = model.mass - design.task.total_mass(design.topology.n)
    losses = (describe_losses(model, wakes),) if any(wakes) else ()
    errors, wake_loss = options.errors, hover_losses(model, wakes)[1]
    settings = {"seed": errors.seed, "noise": errors.noise, "model_error": errors.model, "motor_lag_s": options.lag}
    settings |= {"detection_time_s": options.detection, "wake_loss_share": wake_loss}
    settings["position_bandwidth_rad_s"] = Controller.omega_p
    settings["attitude_bandwidth_rad_s"] = Controller.omega_a
    downwash_note = (
        "The simulator models one effect of downwash, the thrust that rotors lose to wakes (by the audit's air "
        "model); against all others it relies on the airflow envelopes of the audit."
    )
    return Campaign(
        FlightResult(
            design=digest_of(design),
            verdict="held" if outcome in ("recovered", "not flown") else "not held",
            outcome=outcome,
            scenarios=tuple(results),
            weakest_force_N=force,
            weakest_force_share=force / model.weight,
            weakest_direction=(float(d[0]), float(d[1]), float(d[2])),
            rotors_out=out.survive,
            hover_only=out.hover_only,
            rotors=model.B.shape[1],
            mass_kg=model.mass,
            rod_mass_kg=rod_mass,
            options=settings,
            versions={name: version(name) for name in ("mujoco", "casadi", "numpy")},
            notes=(downwash_note if options.wake else NO_DOWNWASH, *losses),
        ),
        tuple(flown),
    )


def plan(design: Design, rotor: int, rotor_out: bool) -> list[scenarios.Scenario | ScenarioResult]:
    """Return all scenarios of a design in order; those that are not flown are given as results.

    Args:
        design: the design.
        rotor: the rotor that fails.
        rotor_out: whether the failure must be survived even if the task does not require it.
    """
    tilt, dropped = design.task.flight.tilt_deg, design.task.flight.dropped
    reserve = "flight.force_reserve" not in dropped
    tilts = scenarios.tilts(tilt or scenarios.TILT, counts=tilt > 0) if tilt or "flight.tilt_deg" in dropped else []
    planned: list[scenarios.Scenario | ScenarioResult] = [
        *scenarios.hover_scenarios(counts=reserve),
        *tilts,
        scenarios.gust(nominal(design), counts=reserve),
    ]
    solid = any(region.solid for region in design.task.exposure)
    weakest = _weakest_corners(design)
    for k, (name, case) in enumerate(zip(labels(design.task.load_cases), design.task.load_cases, strict=True)):
        if (why := scenarios.imbalance(design, case)) is not None:
            also = f"; nor are its {len(case.corners)} corners" if case.corners else ""
            planned.append(ScenarioResult(name=name, verdict="not flown", reason=why + also))
            continue
        pulls = must_pull(design.task.exposure, np.array(case.at_end_effector.force))
        planned += scenarios.hold(name, case, solid=solid, pulls=pulls) or [_as_hover(name)]
        selected = [number for number in range(len(case.corners)) if (k, number) in weakest]
        for number in selected:  # without a wall: only the case's own load defines one
            corner_name = f"{name}, corner {number}"
            planned.append(scenarios.hold_at_tip(corner_name, case.corners[number]) or _as_hover(corner_name))
        if others := len(case.corners) - len(selected):
            why = f"only the {CORNERS} corners of all load cases with the least load factors are flown"
            planned.append(ScenarioResult(name=f"{name}, {others} other corners", verdict="not flown", reason=why))
    required = design.task.flight.rotor_out != "none"
    return [*planned, scenarios.dead_rotor(rotor, design.task, counts=rotor_out or required)]


def _weakest_corners(design: Design) -> set[tuple[int, int]]:
    """Return the corners with the smallest load factors, as pairs of load case and number."""
    model = nominal(design)
    factors = []
    for k, case in enumerate(design.task.load_cases):
        if scenarios.imbalance(design, case) is None:
            loads = [model.about_com(scenarios.tip_wrench(corner)) for corner in case.corners]
            factors += [(model.hover.load_factor(load), k, number) for number, load in enumerate(loads)]
    return {(k, number) for _, k, number in sorted(factors)[:CORNERS]}


def _as_hover(name: str) -> ScenarioResult:
    return ScenarioResult(name=name, verdict="not flown", reason="same as hover, flown above")


def _require_hover(design: Design, model: Nominal) -> None:
    residual, _ = hover_residual(model)
    if residual > HOVER_TOLERANCE:
        rule = (
            f"cannot hover in the attitude of its task: rotors within their limits leave {100 * residual:.3g} % of "
            "the weight, or of arm length times weight, unbalanced, with the mass of the rod; nothing was flown"
        )
        raise BadInput(design.task.name, [Fault("", rule)])

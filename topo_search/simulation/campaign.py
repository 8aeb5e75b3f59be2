"""All flights of a design: which are flown, in which order, and what all of them say together.

The capability of the rotors in hover comes first: the reason why a flight fails is often there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import get_args

import numpy as np
from scipy.optimize import linprog

from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.load_case import labels
from topo_search.model.value import BadInput, Fault
from topo_search.simulation import scenarios
from topo_search.simulation.controller import Allocator, Controller
from topo_search.simulation.fly import Options, Track, Watch, fly, judge
from topo_search.simulation.plant import Nominal, nominal
from topo_search.simulation.result import NO_DOWNWASH, FlightResult, Outcome, ScenarioResult, digest_of
from verify.air.bound import air
from verify.kinematics import platform
from verify.requirements import Scene

MET = 1e-3
"""Largest residual of the hovering wrench by least squares, in weights and arm lengths times weights."""


def weakest_force(nominal: Nominal) -> tuple[float, Array]:
    """Return the least horizontal force that can be added to hover at the COM [N], and its direction, (3,).

    Each of the evenly spaced directions is a linear program over the thrusts.
    """
    forces, directions = [], 24
    for k in range(directions):
        angle = 2 * math.pi * k / directions
        d = np.array([math.cos(angle), math.sin(angle), 0.0])
        forces.append((load_factor(nominal, np.append(d, np.zeros(3))), k, d))
    force, _, d = min(forces, key=lambda one: one[:2])
    return force, d


def load_factor(nominal: Nominal, wrench: Array) -> float:
    """Return the largest factor of a wrench about the COM, (6,), that can be added to hover; inf of no wrench."""
    if not wrench.any():
        return math.inf
    N, W = nominal.B.shape[1], nominal.weight
    hover = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    scale = np.repeat([1.0, nominal.arm], 3) * W
    size = float(np.linalg.norm(wrench / scale))
    A = np.column_stack([nominal.B * nominal.largest_thrust / scale[:, None], -wrench / scale / size])
    bounds = [(nominal.least_share, 1)] * N + [(0, None)]
    solution = linprog(np.append(np.zeros(N), -1.0), A_eq=A, b_eq=hover, bounds=bounds)
    return float(solution.x[-1]) / size + 0.0 if solution.status == 0 else 0.0  # never -0.0


def hover_residual(nominal: Nominal, dead: int | None = None) -> tuple[float, float]:
    """Return what is missing of hover, in weights and arm lengths times weights, and the largest thrust's share."""
    allocator = Allocator(nominal)
    if dead is not None:
        allocator.stop_rotor(dead)
    T, missing = allocator.thrusts(np.array([0.0, 0.0, nominal.weight, 0.0, 0.0, 0.0]))
    short = np.abs(missing) / nominal.weight / np.repeat([1.0, nominal.arm], 3)
    return float(short.max()), float(T.max()) / nominal.largest_thrust


def hardest_rotor(nominal: Nominal) -> tuple[int, int]:
    """Return the rotor whose failure leaves least, and the number of single rotor failures that hover survives."""
    residuals = [hover_residual(nominal, rotor) for rotor in range(nominal.B.shape[1])]
    survived = sum(short <= MET for short, _ in residuals)
    worst = max(range(len(residuals)), key=lambda rotor: (max(residuals[rotor][0], MET), residuals[rotor][1]))
    return worst, survived


def wake_losses(design: Design) -> tuple[float, ...]:
    """Return the share of its thrust that each rotor loses to wakes, in the load case in which it loses most."""
    placed = platform(design)
    blown = air(Scene(design, placed))
    if blown is None:
        return ()
    losses = ([rotor.thrust_loss for rotor in case.rotors] for case in blown.cases)
    return tuple(map(max, zip(*losses, strict=True)))


def tell_losses(nominal: Nominal, losses: tuple[float, ...]) -> str:
    """Return words for what wakes take, and whether that is more than the rotors have left in hover."""
    T, _ = Allocator(nominal).thrusts(np.array([0.0, 0.0, nominal.weight, 0.0, 0.0, 0.0]))
    lost = nominal.B @ (np.array(losses) * T)
    force, torque = np.linalg.norm(lost[:3]), np.linalg.norm(lost[3:])
    short, _ = hover_residual(replace(nominal, B=nominal.B * (1 - np.array(losses))))
    return (
        f"Wakes of other modules take up to {100 * max(losses):.2g} % of a rotor's thrust. In hover that is "
        f"{force:.2g} N and {torque:.2g} N m, {'more' if short > MET else 'less'} than the rotors can add."
    )


CORNERS = 12
"""Largest number of vertices of cones and sets that are flown, a second or two each."""

Flown = tuple[scenarios.Scenario, Track]


@dataclass(frozen=True)
class Campaign:
    """The flights of a design, and their result."""

    result: FlightResult
    flown: tuple[Flown, ...]


def fly_all(
    design: Design,
    options: Options,
    *,
    rotor_out: bool = False,
    only: tuple[str, ...] = (),
    tell: Callable[[ScenarioResult], None] = lambda _: None,
    watch: Callable[[scenarios.Scenario], Watch | None] = lambda _: None,
) -> Campaign:
    """Fly everything that can be flown with a design.

    Args:
        design: the design.
        options: how.
        rotor_out: whether the death of a rotor has to be survived even if the task does not ask for it.
        only: beginnings of the names of scenarios; none: all.
        tell: is called with each scenario as it finishes.
        watch: returns what watches a scenario.

    Raises:
        BadInput: the rotors cannot carry the weight at all, or no scenario begins as asked.
    """
    known = nominal(design)
    _require_hover(design, known)
    losses = wake_losses(design) if options.wake else ()
    options = replace(options, errors=replace(options.errors, losses=losses))
    force, d = weakest_force(known)
    rotor, survived = hardest_rotor(known)
    results: list[ScenarioResult] = []
    flown: list[Flown] = []
    for each in plan(design, rotor, rotor_out):
        if only and not each.name.startswith(only):
            continue
        if isinstance(each, ScenarioResult):
            result = each
        else:
            track, lost = fly(design, each, options, watch(each))
            flown.append((each, track))
            result = judge(each, track, lost)
        results.append(result)
        tell(result)
    if not results:
        names = ", ".join(each.name for each in plan(design, rotor, rotor_out))
        raise BadInput("--only", [Fault("", f"must begin the name of a scenario, one of {names}; got {only[0]}")])
    counting = (one.outcome for one in results if one.counts and one.outcome)
    outcome: Outcome = min(counting, key=get_args(Outcome).index, default="not flown")
    rod = known.mass - design.task.total_mass(design.topology.n)
    model = (
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
            weakest_force_share=force / known.weight,
            weakest_direction=(float(d[0]), float(d[1]), float(d[2])),
            rotors_out=survived,
            rotors=known.B.shape[1],
            mass_kg=known.mass,
            rod_mass_kg=rod,
            options={
                "seed": options.errors.seed,
                "noise": options.errors.noise,
                "model_error": options.errors.model,
                "motor_lag_s": options.lag,
                "detection_time_s": options.detection,
                "wake_loss_share": max(losses, default=0.0),
                "position_bandwidth_rad_s": Controller.omega_p,
                "attitude_bandwidth_rad_s": Controller.omega_a,
            },
            versions={name: version(name) for name in ("mujoco", "casadi", "numpy")},
            notes=(
                model if options.wake else NO_DOWNWASH,
                *([tell_losses(known, losses)] if any(losses) else []),
            ),
        ),
        tuple(flown),
    )


def plan(design: Design, rotor: int, rotor_out: bool) -> list[scenarios.Scenario | ScenarioResult]:
    """Return all scenarios of a design in order; those that are not flown as their results.

    Args:
        design: the design.
        rotor: the one that dies.
        rotor_out: whether its death has to be survived even if the task does not ask for it.
    """
    tilt = design.task.flight.tilt_deg
    planned: list[scenarios.Scenario | ScenarioResult] = [
        *scenarios.hover_scenarios(),
        *scenarios.tilts(tilt or scenarios.TILT, counts=tilt > 0),
        scenarios.gust(nominal(design)),
    ]
    solid = any(region.solid for region in design.task.exposure)
    weakest = _weakest_corners(design)
    for k, (name, case) in enumerate(zip(labels(design.task.load_cases), design.task.load_cases, strict=True)):
        if (why := scenarios.imbalance(design, case)) is not None:
            also = f"; nor are its {len(case.corners)} corners" if case.corners else ""
            planned.append(ScenarioResult(name=name, verdict="not flown", reason=why + also))
            continue
        planned += scenarios.hold(name, case, solid=solid) or [_as_hover(name)]
        chosen = [number for number in range(len(case.corners)) if (k, number) in weakest]
        for number in chosen:  # of a contact no wall is known but that of the case
            called = f"{name}, corner {number}"
            planned.append(scenarios.hold_at_tip(called, case.corners[number]) or _as_hover(called))
        if others := len(case.corners) - len(chosen):
            why = f"only the {CORNERS} corners of all load cases with the least load factors are flown"
            planned.append(ScenarioResult(name=f"{name}, {others} other corners", verdict="not flown", reason=why))
    required = design.task.flight.rotor_out != "none"
    return [*planned, scenarios.dead_rotor(rotor, counts=rotor_out or required)]


def _weakest_corners(design: Design) -> set[tuple[int, int]]:
    """Return the corners that are flown, as load case and number: those that can grow least."""
    known = nominal(design)
    factors = []
    for k, case in enumerate(design.task.load_cases):
        if scenarios.imbalance(design, case) is None:
            loads = [known.about_com(scenarios.exertion(corner)) for corner in case.corners]
            factors += [(load_factor(known, load), k, number) for number, load in enumerate(loads)]
    return {(k, number) for _, k, number in sorted(factors)[:CORNERS]}


def _as_hover(name: str) -> ScenarioResult:
    return ScenarioResult(name=name, verdict="not flown", reason="same as hover, flown above")


def _require_hover(design: Design, known: Nominal) -> None:
    short, _ = hover_residual(known)
    if short > MET:
        without = nominal(design, rod_mass=False)
        rod = known.mass - without.mass
        cause = (
            f"; the cause is the rod of the end-effector: without its mass, {rod:.4g} kg or "
            f"{100 * rod / without.mass:.3g} % of the rest, which the search and the audit leave out, it hovers"
            if hover_residual(without)[0] <= MET
            else ""
        )
        rule = (
            f"cannot hover in the attitude of its task: rotors within their limits leave {100 * short:.3g} % of "
            f"the weight, or of arm length times weight, unbalanced{cause}; nothing was flown"
        )
        raise BadInput(design.task.name, [Fault("", rule)])

"""Simulation of one scenario in closed loop, and its evaluation.

| symbol | meaning | shape | unit |
|---|---|---|---|
| e | distance of the COM from its reference, without the direction into a wall that it presses against | | m |
| tilt | angle between the platform's attitude and its reference, the task's axes unless a tilt is held | | deg |
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np

from topo_search.model import Array, Design
from topo_search.simulation.controller import Allocator, Controller, Reference
from topo_search.simulation.plant import LAG, STEP, ModelErrors, Nominal, Plant, State, in_wakes, orientation
from topo_search.simulation.result import Outcome, ScenarioResult
from topo_search.simulation.scenarios import APPROACH, TILT, Scenario

EVERY = 5
"""Simulation steps per control step: 200 Hz."""
WRENCH_TOLERANCE = 0.01
"""Largest residual of a wrench that counts as produced, in weights and arm lengths times weights."""
LOST_DISTANCE, LOST_TILT = 1.0, 60.0
"""Errors above which a platform counts as lost [m], [deg]."""

Watch = Callable[[Plant, float], None]
"""Observer that is called after every control step with the plant and the time."""


@dataclass(eq=False)
class Track:
    """Time series, one entry per control step."""

    time: list[float] = field(default_factory=list)
    error: list[Array] = field(default_factory=list)
    """Position error of the COM, world axes [m]."""
    tilt: list[float] = field(default_factory=list)
    force: list[Array] = field(default_factory=list)
    """Force on the environment at the end-effector [N]."""
    shares: list[Array] = field(default_factory=list)
    """Commanded thrusts over the largest."""
    missing: list[Array] = field(default_factory=list)
    """Part of the commanded wrench that is not produced, in weights and arm lengths times weights."""
    pose: list[Array] = field(default_factory=list)
    """Distance from the design's place, where the tip touches any wall [m], and attitude as quaternion, (7,)."""


@dataclass(frozen=True)
class Options:
    """Options of the flights."""

    errors: ModelErrors = field(default_factory=ModelErrors)
    lag: float = LAG
    detection: float = 0.1
    """Delay until the controller detects a rotor failure [s]."""
    allocator: type[Allocator] = Allocator
    """Thrust allocation: bounded least squares, or `PseudoInverse`."""
    wake: bool = True
    """True if rotors lose thrust to the wakes of other modules, by the audit's air model."""


def fly(
    design: Design, scenario: Scenario, options: Options, watch: Watch | None = None, known: Nominal | None = None
) -> tuple[Track, str | None]:
    """Fly a scenario and return its track, and the reason if it ended early.

    `known` is the controller's model of the design, if it is at hand.
    """
    plant = Plant(design, options.errors, scenario.wall, options.lag, known)
    rng = np.random.default_rng([options.errors.seed, 1])
    nominal, allocator = plant.nominal, options.allocator(plant.nominal)
    controller = Controller(nominal, EVERY * STEP)
    home = nominal.com.copy()  # the design's COM is the origin
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    plant.place(home, quaternion)
    plant.data.act[:] = in_wakes(_trim(plant, controller, allocator, home), plant.wakes)
    if scenario.axis.any() and not scenario.tilt:
        mujoco.mju_axisAngle2Quat(quaternion, scenario.axis, math.radians(TILT))
    plant.place(home + scenario.start, quaternion)
    track = Track()
    for k in range(round(scenario.seconds / (EVERY * STEP))):
        t = k * EVERY * STEP
        reference = _reference(scenario, home, t, nominal)
        dead = scenario.dead if scenario.dead is not None and t >= scenario.dead_at else None
        if dead is not None and t >= scenario.dead_at + options.detection:
            allocator.stop_rotor(dead)
        measured = _add_noise(plant.state, options.errors.noise, rng)
        wrench = controller.wrench(measured, reference)
        T, missing = allocator.thrusts(wrench)
        scaled = missing / nominal.weight / np.repeat([1.0, nominal.arm], 3)
        controller.integrate(measured, reference, bool(np.abs(scaled).max() <= WRENCH_TOLERANCE))
        share = T / nominal.largest_thrust
        if dead is not None:
            plant.model.actuator_ctrlrange[dead] = 0.0  # removes the smallest thrust of a running rotor
            T[dead] = 0.0
        # a wall reacts by contact
        load = np.zeros(6) if scenario.wall is not None else -scenario.share_at(t) * scenario.exerted
        wind = np.zeros(6)
        if scenario.gust is not None and scenario.gust[0] <= t < scenario.gust[1]:
            wind = scenario.wind
        for _ in range(EVERY):
            plant.step(T, load, wind)
        _record(track, scenario, plant, reference, t, share, scaled)
        if watch is not None:
            watch(plant, t)
        if np.linalg.norm(track.error[-1]) > LOST_DISTANCE or track.tilt[-1] > LOST_TILT:
            return track, f"lost after {t:.1f} s"
        if (struck := plant.struck) is not None:
            why = "" if scenario.counts else ": the task has no solid region that keeps parts out of it"
            return track, f"{struck} struck the wall after {t:.1f} s{why}"
    return track, None


def _trim(plant: Plant, controller: Controller, allocator: Allocator, home: Array) -> Array:
    """Trim the integrals for hover with the model's errors, and return the thrusts of hover, (N,) [N]."""
    level = (home, np.zeros(3), np.eye(3), np.zeros(3))
    for _ in range(10):  # the correction itself has the model's relative error, so repeat it
        T, _ = allocator.thrusts(controller.wrench(level, Reference(home, np.zeros(6), np.zeros(3))))
        controller.trim(plant.missing_wrench(T))
    return T


def judge(scenario: Scenario, track: Track, lost: str | None) -> ScenarioResult:
    """Evaluate a flight; `lost` is the reason if it ended early."""
    # shares of the largest thrust, of the time, of the force
    at_limit, most_saturated, force_tolerance = 0.999, 0.05, 0.05
    t, tilt = np.array(track.time), np.array(track.tilt)
    e = np.linalg.norm(track.error, axis=1)
    is_judged = t >= scenario.judged_from
    shares, missing = np.array(track.shares), np.abs(track.missing).max(axis=1)
    saturated = float((shares >= at_limit).mean(axis=0).max())
    missed = float((missing > WRENCH_TOLERANCE).mean())
    within = (e <= scenario.largest_drift) & (tilt <= scenario.largest_tilt)
    outside = np.flatnonzero(np.logical_not(within))
    settling_time = 0.0 if not len(outside) else None  # None if errors are outside the limits at the end
    if len(outside) and outside[-1] < len(t) - 1:
        settling_time = float(t[outside[-1] + 1])
    force = error = None
    if scenario.force > 0 and is_judged.any():
        mean_force = np.array(track.force)[is_judged].mean(axis=0)
        force = float(mean_force @ scenario.exerted[:3]) / scenario.force
        error = float(np.linalg.norm(mean_force - scenario.exerted[:3])) / scenario.force
        if scenario.wall is not None:  # friction may take up the tangential part
            error = abs(force / scenario.force - 1)
    reasons = [] if lost is None else [lost]
    largest_drift = float(e[is_judged].max()) if is_judged.any() else float(e.max())
    largest_tilt = float(tilt[is_judged].max()) if is_judged.any() else float(tilt.max())
    if lost is None and largest_drift > scenario.largest_drift:
        reasons.append(f"{100 * largest_drift:.3g} cm away, more than {100 * scenario.largest_drift:g} cm")
    if lost is None and largest_tilt > scenario.largest_tilt:
        reasons.append(f"tilted by {largest_tilt:.3g} deg, more than {scenario.largest_tilt:g} deg")
    if error is not None and error > force_tolerance:
        reasons.append(f"force off by {100 * error:.2g} %, more than {100 * force_tolerance:g} %")
    if saturated > most_saturated:
        reasons.append(f"a rotor at its largest thrust for {100 * saturated:.3g} % of the time")
    if reasons and missed > 0:
        mean_missing = np.mean(track.missing, axis=0)
        reasons.append(
            f"rotors could not produce what the controller asked for {100 * missed:.3g} % of the time, short of "
            f"{np.linalg.norm(mean_missing[:3]):.2g} of the weight on average"
        )
    outcome: Outcome = "recovered"
    if reasons:
        is_saturated = saturated > most_saturated or missed > 0
        outcome = "lost" if lost is not None else "saturated" if is_saturated else "off target"
    return ScenarioResult(
        name=scenario.name,
        verdict="not held" if reasons else "held",
        outcome=outcome,
        reason="; ".join(reasons) or None,
        counts=scenario.counts,
        seconds=float(t[-1]),
        drift_m=largest_drift,
        tilt_deg=largest_tilt,
        settled_s=settling_time,
        force_N=force,
        force_error_share=error,
        saturated_share=saturated,
        missed_share=missed,
        largest_input=float(shares.max()),
    )


def _reference(scenario: Scenario, home: Array, t: float, nominal: Nominal) -> Reference:
    """Return the reference pose and wrench at a time."""
    share = scenario.share_at(t)
    wrench = nominal.about_com(share * scenario.exerted)
    if scenario.wall is None:
        quaternion = np.zeros(4)
        mujoco.mju_axisAngle2Quat(quaternion, scenario.axis, share * math.radians(scenario.tilt))
        return Reference(home, wrench, np.zeros(3), orientation(quaternion))
    advance = min(0.02 * t, APPROACH)  # at 0.02 m/s
    free = scenario.wall.towards if t >= scenario.ramp_at else np.zeros(3)
    return Reference(home + advance * scenario.wall.towards, wrench, free)


def _record(
    track: Track, scenario: Scenario, plant: Plant, reference: Reference, t: float, share: Array, missing: Array
) -> None:
    p, _, R, _ = plant.state
    cosine = (np.trace(reference.attitude.T @ R) - 1) / 2
    track.time.append(t)
    track.error.append(reference.errors(p, R)[0])
    track.tilt.append(math.degrees(math.acos(float(np.clip(cosine, -1.0, 1.0)))))
    if scenario.wall is not None:
        track.force.append(plant.contact_force)
    else:  # rotor force minus the weight
        F = plant.R @ (plant.nominal.B @ (plant.data.act * plant.gain))[:3]
        track.force.append(np.asarray(F + plant.model.body_mass.sum() * plant.model.opt.gravity))
    track.shares.append(share)
    track.missing.append(missing)
    pose = plant.data.qpos[:7].copy()
    if scenario.wall is not None:
        pose[:3] -= scenario.wall.gap * scenario.wall.towards
    track.pose.append(pose)


def _add_noise(state: State, factor: float, rng: np.random.Generator) -> State:
    """Return a state with sensor noise."""
    p, v, R, omega = state
    deviations = 1e-3, 5e-3, math.radians(0.1), math.radians(0.5)  # [m], [m/s], [rad], [rad/s]
    draws = factor * np.array(deviations)[:, None] * rng.standard_normal((4, 3))
    quaternion = np.zeros(4)
    angle = float(np.linalg.norm(draws[2]))
    mujoco.mju_axisAngle2Quat(quaternion, draws[2] / angle if angle else np.array([0.0, 0.0, 1.0]), angle)
    return p + draws[0], v + draws[1], R @ orientation(quaternion), omega + draws[3]

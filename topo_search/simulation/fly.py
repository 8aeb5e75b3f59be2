"""The closed loop, one scenario at a time, and what it showed.

| symbol | meaning | shape | unit |
|---|---|---|---|
| e | distance of the COM from its reference; in a wall's direction contact holds it | | m |
| tilt | angle between the platform's attitude and its reference, the task's axes but where a tilt is held | | deg |
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.simulation.controller import Allocator, Controller, Reference
from topo_search.simulation.plant import LAG, STEP, Errors, Nominal, Plant, orientation
from topo_search.simulation.result import Outcome, ScenarioResult
from topo_search.simulation.scenarios import APPROACH, TILT, Scenario

EVERY = 5
"""Steps of the simulation a step of the controller: 200 Hz."""
MISSED = 0.01
"""Largest residual of a wrench that counts as met, in weights and arm lengths times weights."""
GONE, OVER = 1.0, 60.0
"""Errors at which a platform counts as lost [m], [deg]."""

Watch = Callable[[Plant, float], None]
"""Called after every step of the controller with the plant and the time."""


@dataclass(eq=False)
class Track:
    """Records of every step of the controller."""

    time: list[float] = field(default_factory=list)
    error: list[Array] = field(default_factory=list)
    """Position error of the COM, world axes [m]."""
    tilt: list[float] = field(default_factory=list)
    force: list[Array] = field(default_factory=list)
    """On the environment at the end-effector [N]."""
    shares: list[Array] = field(default_factory=list)
    """Commanded thrusts over the largest."""
    missing: list[Array] = field(default_factory=list)
    """Wrench commanded but not produced, in weights and arm lengths times weights."""


@dataclass(frozen=True)
class Options:
    """Options of the flights."""

    errors: Errors = field(default_factory=Errors)
    lag: float = LAG
    detection: float = 0.1
    """Time from a rotor's death until the controller knows of it [s]."""
    allocator: type[Allocator] = Allocator
    """Turns wrenches into thrusts: by least squares within limits, or by a `PseudoInverse`."""
    wake: bool = True
    """True if rotors lose thrust to the wakes of other modules, as the audit's air model says."""


def fly(
    design: Design, scenario: Scenario, options: Options, watch: Watch | None = None
) -> tuple[Track, str | None]:
    """Fly a scenario and return its track, and when it ended before its time, why."""
    plant = Plant(design, options.errors, scenario.wall, options.lag)
    rng = np.random.default_rng([options.errors.seed, 1])
    nominal, allocator = plant.nominal, options.allocator(plant.nominal)
    controller = Controller(nominal, EVERY * STEP)
    home = nominal.com.copy()  # the design's COM is the origin
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    plant.place(home, quaternion)
    plant.data.act[:] = _trim(plant, controller, allocator, home)
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
        seen = _add_noise(plant.state, options.errors.noise, rng)
        wrench = controller.wrench(seen, reference)
        T, missing = allocator.thrusts(wrench)
        scaled = missing / nominal.weight / np.repeat([1.0, nominal.arm], 3)
        controller.learn(seen, reference, bool(np.abs(scaled).max() <= MISSED))
        share = T / nominal.largest_thrust
        if dead is not None:
            plant.model.actuator_ctrlrange[dead] = 0.0  # it has no least thrust any more
            T[dead] = 0.0
        # a wall pushes back by itself
        load = np.zeros(6) if scenario.wall is not None else -scenario.share_at(t) * scenario.exerted
        wind = np.zeros(6)
        if scenario.gust is not None and scenario.gust[0] <= t < scenario.gust[1]:
            wind = scenario.wind
        for _ in range(EVERY):
            plant.step(T, load, wind)
        _record(track, scenario, plant, reference, t, share, scaled)
        if watch is not None:
            watch(plant, t)
        if np.linalg.norm(track.error[-1]) > GONE or track.tilt[-1] > OVER:
            return track, f"lost after {t:.1f} s"
        if (struck := plant.struck) is not None:
            why = "" if scenario.counts else ": the task has no solid region that keeps parts out of it"
            return track, f"{struck} struck the wall after {t:.1f} s{why}"
    return track, None


def _trim(plant: Plant, controller: Controller, allocator: Allocator, home: Array) -> Array:
    """Let the integrals know what hover lacks by errors of the model, and return the thrusts of hover, (N,) [N]."""
    level = (home, np.zeros(3), np.eye(3), np.zeros(3))
    for _ in range(10):  # each correction leaves the model's error of what it corrects
        T, _ = allocator.thrusts(controller.wrench(level, Reference(home, np.zeros(6), np.zeros(3))))
        controller.trim(plant.missing_wrench(T))
    return T


def judge(scenario: Scenario, track: Track, lost: str | None) -> ScenarioResult:
    """Return what a flight showed."""
    at_limit, most_saturated, force_within = 0.999, 0.05, 0.05  # shares: of a thrust, of the time, of a force
    t, tilt = np.array(track.time), np.array(track.tilt)
    e = np.linalg.norm(track.error, axis=1)
    late = t >= scenario.judged_from
    shares, missing = np.array(track.shares), np.abs(track.missing).max(axis=1)
    saturated = float((shares >= at_limit).mean(axis=0).max())
    missed = float((missing > MISSED).mean())
    within = (e <= scenario.largest_drift) & (tilt <= scenario.largest_tilt)
    outside = np.flatnonzero(np.logical_not(within))
    settled = 0.0 if not len(outside) else None  # from when on all is within its limits; None: never to stay
    if len(outside) and outside[-1] < len(t) - 1:
        settled = float(t[outside[-1] + 1])
    force = error = None
    if scenario.force > 0 and late.any():
        along = np.array(track.force)[late].mean(axis=0)
        force = float(along @ scenario.exerted[:3]) / scenario.force
        error = float(np.linalg.norm(along - scenario.exerted[:3])) / scenario.force
        if scenario.wall is not None:  # friction may take up the rest
            error = abs(force / scenario.force - 1)
    why = [] if lost is None else [lost]
    drift = float(e[late].max()) if late.any() else float(e.max())
    tilted = float(tilt[late].max()) if late.any() else float(tilt.max())
    if lost is None and drift > scenario.largest_drift:
        why.append(f"{100 * drift:.3g} cm away, more than {100 * scenario.largest_drift:g} cm")
    if lost is None and tilted > scenario.largest_tilt:
        why.append(f"tilted by {tilted:.3g} deg, more than {scenario.largest_tilt:g} deg")
    if error is not None and error > force_within:
        why.append(f"force off by {100 * error:.2g} %, more than {100 * force_within:g} %")
    if saturated > most_saturated:
        why.append(f"a rotor at its largest thrust for {100 * saturated:.3g} % of the time")
    if why and missed > 0:
        short = np.mean(track.missing, axis=0)
        why.append(
            f"rotors could not produce what the controller asked for {100 * missed:.3g} % of the time, short of "
            f"{np.linalg.norm(short[:3]):.2g} of the weight on average"
        )
    outcome: Outcome = "recovered"
    if why:
        limited = saturated > most_saturated or missed > 0
        outcome = "lost" if lost is not None else "saturated" if limited else "off target"
    return ScenarioResult(
        name=scenario.name,
        verdict="not held" if why else "held",
        outcome=outcome,
        reason="; ".join(why) or None,
        counts=scenario.counts,
        seconds=float(t[-1]),
        drift_m=drift,
        tilt_deg=tilted,
        settled_s=settled,
        force_N=force,
        force_error_share=error,
        saturated_share=saturated,
        missed_share=missed,
        largest_input=float(shares.max()),
    )


def _reference(scenario: Scenario, home: Array, t: float, nominal: Nominal) -> Reference:
    """Return where the platform is to be, and what it is to exert."""
    share = scenario.share_at(t)
    wrench = nominal.about_com(share * scenario.exerted)
    if scenario.wall is None:
        turn = np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, scenario.axis, share * math.radians(scenario.tilt))
        return Reference(home, wrench, np.zeros(3), orientation(turn))
    ahead = min(0.02 * t, APPROACH)  # at 0.02 m/s
    free = scenario.wall.towards if t >= scenario.ramp_at else np.zeros(3)
    return Reference(home + ahead * scenario.wall.towards, wrench, free)


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
    else:  # that of the rotors less the weight
        F = plant.R @ (plant.nominal.B @ (plant.data.act * plant.gain))[:3]
        track.force.append(np.asarray(F + plant.model.body_mass.sum() * plant.model.opt.gravity))
    track.shares.append(share)
    track.missing.append(missing)


def _add_noise(
    state: tuple[Array, Array, Array, Array], factor: float, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array]:
    """Return a state as sensors tell it."""
    p, v, R, omega = state
    deviations = 1e-3, 5e-3, math.radians(0.1), math.radians(0.5)  # [m], [m/s], [rad], [rad/s]
    draws = factor * np.array(deviations)[:, None] * rng.standard_normal((4, 3))
    quaternion = np.zeros(4)
    angle = float(np.linalg.norm(draws[2]))
    mujoco.mju_axisAngle2Quat(quaternion, draws[2] / angle if angle else np.array([0.0, 0.0, 1.0]), angle)
    return p + draws[0], v + draws[1], R @ orientation(quaternion), omega + draws[3]

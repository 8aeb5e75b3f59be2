"""The figures of flight of any vehicle with fixed rotors.

| symbol | meaning | shape |
|---|---|---|
| v | inputs over the largest one of each rotor | (N,) |
| F, T | forces and torques of the rotors at v = 1 | (3, N) |
| t | what the torques are to be, 0 of a vehicle without torque | (3,) |
| Z | forces F v with T v = t: a polytope | |

Each corner of Z is found by a linear program towards the normal of a facet of the hull of those that are known,
until no facet moves: the hull is Z then.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from topo_search.model import Flight, LoadCase, RotorsOut, Task
from topo_search.model.flight import Capability, Vehicle
from topo_search.model.load_case import labels
from verify.bodies import Array
from verify.flight.balls import largest_balls
from verify.flight.measured import Measured
from verify.flight.programs import Box, greatest
from verify.residuals import clamp

FOUND = 1e-9
"""Distance from a facet, in weights, up to which a corner lies on it."""


def capability(vehicle: Vehicle, task: Task | None = None) -> Capability | None:
    """Return what a vehicle can do; None where its numbers are too large to compute with.

    Args:
        vehicle: the vehicle.
        task: whose load cases it is judged against, corners of cones and vertices included; forces in weights are
            in those of the vehicle.
    """
    r = np.array([(one.x_m, one.y_m, one.z_m) for one in vehicle.rotors]) - vehicle.com
    arm, weight = float(np.linalg.norm(r, axis=1).max()) or 1.0, vehicle.mass * vehicle.gravity
    A, cases = rotor_map(vehicle), {} if task is None else _cases(task, weight)
    low = np.array([one.u_min / one.u_max for one in vehicle.rotors])
    box = Box(low, np.ones(len(low)))
    given = vehicle.inertia
    J = None if given is None else np.diag(given) if np.ndim(given) == 1 else np.array(given)
    measured = Measured(A, _end_effector(vehicle, task), (weight, arm), box, cases, [None] * (1 + len(cases)), J)
    if not measured.in_range:
        return None
    F, T = measured.A[:3], measured.A[3:]
    ball = largest_balls(F, T, np.zeros((1, 3)), np.zeros((1, 3)), box)[0]
    rows, hull = measured.cases(), force_hull(F, T, np.zeros(3), box)
    # singular values below this share of the largest are zero
    return Capability(
        rank=int(np.linalg.matrix_rank(measured.A, rtol=1e-9)),
        zero_torque_volume_N3=0.0 if hull is None else clamp(hull.volume * weight**3),
        zero_torque_ball_N=clamp(ball.lower * weight),
        flight=Flight(
            cases=rows,
            rotors_out_hover=_count_through(measured.rotors_out(1)),
            rotors_out_all=_count_through(measured.rotors_out(len(rows))),
            joints=(),
            hinge_tolerance_deg=None,
            hover_input=measured.hover_input,
            hover_power_ratio=measured.hover_power_ratio,
            rod_length_m=None,
            rod_mass_share=None,
            span_m=clamp(max(float(np.linalg.norm(r - one, axis=1).max()) for one in r)),
        ),
        met=None if task is None else all(row.possible is True for row in rows[1:]),
    )


def rotor_map(vehicle: Vehicle) -> Array:
    """Return the wrenches of all rotors at their largest inputs about the centre of mass, shape (6, N) [N, N m]."""
    columns = []
    for one in vehicle.rotors:
        a = np.array([one.ax, one.ay, one.az]) / math.hypot(one.ax, one.ay, one.az)
        r = np.array([one.x_m, one.y_m, one.z_m]) - vehicle.com
        torque = one.k_f * np.cross(r, a) - one.spin * one.k_tau * a
        columns.append(one.u_max * np.concatenate([one.k_f * a, torque]))
    return np.array(columns).T


def _end_effector(vehicle: Vehicle, task: Task | None) -> Array:
    """Return the place of the end-effector from the centre of mass, shape (3,) [m]."""
    if vehicle.end_effector is not None:
        return np.subtract(vehicle.end_effector, vehicle.com)
    return np.zeros(3) if task is None else np.array(task.end_effector.fixed_position or (0.0, 0.0, 0.0))


def _cases(task: Task, weight: float) -> dict[str, LoadCase]:
    """Return load cases and their corners in SI by name."""
    units, cases = (weight, task.module.arm_length * weight), {}
    for label, case in zip(labels(task.cases), task.cases, strict=True):
        cases[label] = case.to_si(*units)
        cases |= {f"{label}, corner {k}": corner.to_si(*units) for k, corner in enumerate(case.corners)}
    return cases


def _count_through(out: RotorsOut) -> RotorsOut:
    """Return the same with rotors counted through, not in modules of four."""
    lost, undecided = (tuple((0, 4 * m + q) for m, q in some) for some in (out.lost, out.undecided))
    return out.model_copy(update={"lost": lost, "undecided": undecided})


def force_hull(F: Array, T: Array, t: Array, box: Box, *, rounds: int = 200) -> ConvexHull | None:
    """Return the hull of all forces F v with T v = t and v in the box; None if it has no volume.

    Args:
        F: shape (3, N).
        T: shape (3, N).
        t: shape (3,).
        box: bounds of v.
        rounds: number of refinements after which the hull may still be too small.
    """
    directions, hull = np.concatenate([np.eye(3), -np.eye(3)]), None
    points = np.empty((0, 3))
    for _ in range(rounds):
        optima = greatest(directions @ F, T, np.broadcast_to(t, (len(directions), 3)), box)
        points = np.concatenate([points, optima.v[np.isfinite(optima.attained)] @ F.T])
        if len(points) < 4:
            return None
        _, sizes, axes = np.linalg.svd(points - points.mean(axis=0))
        if sizes[-1] <= FOUND:
            if len(directions) == 2 and abs(float(directions[0] @ axes[-1])) > 1 - FOUND:
                return None
            directions = np.stack([axes[-1], -axes[-1]])
            continue
        try:
            hull = ConvexHull(points)
        except QhullError:
            return None
        facets = np.unique(np.round(hull.equations, 9), axis=0)
        reach = greatest(facets[:, :3] @ F, T, np.broadcast_to(t, (len(facets), 3)), box)
        beyond = reach.attained + facets[:, 3] > 10 * FOUND
        if not beyond.any():
            break
        directions = facets[beyond, :3]
    return hull

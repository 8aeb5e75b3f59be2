"""Flight capability of any vehicle with fixed rotors.

| symbol | meaning | shape |
|---|---|---|
| v | inputs over the largest one of each rotor | (N,) |
| F, T | forces and torques of the rotors at v = 1 | (3, N) |
| t | required torque, zero for torque-free forces | (3,) |
| Z | polytope of the forces F v with T v = t | |

Linear programs maximise along the facet normals of the hull of the known vertices of Z; when no facet moves, the
hull is Z.
"""

import math

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from topo_search.model import Array, Flight, LoadCase, Task
from topo_search.model.load_case import labels
from topo_search.model.vehicle import Capability, Vehicle
from verify.flight.analysis import CapabilityAnalysis
from verify.flight.balls import Polytopes, largest_balls
from verify.flight.programs import Bounds, greatest
from verify.residuals import clamp

ON_FACET = 1e-9
"""Largest distance from a facet, in weights, of a vertex that lies on it."""


def capability(vehicle: Vehicle, task: Task | None = None) -> Capability | None:
    """Return the flight capability of a vehicle; None if its numbers are too large.

    Args:
        vehicle: the vehicle.
        task: a task whose load cases it must meet, vertices of cones and sets included; a unit of weight is the
            vehicle's.
    """
    r = np.array([(rotor.x_m, rotor.y_m, rotor.z_m) for rotor in vehicle.rotors]) - vehicle.com
    arm, weight = float(np.linalg.norm(r, axis=1).max()) or 1.0, vehicle.mass * vehicle.gravity
    A, cases = rotor_map(vehicle), {} if task is None else _cases(task, weight)
    low = np.array([rotor.u_min / rotor.u_max for rotor in vehicle.rotors])
    box = Bounds(low, np.ones(len(low)))
    inertia = vehicle.inertia
    J = None if inertia is None else np.diag(inertia) if np.ndim(inertia) == 1 else np.array(inertia)
    analysis = CapabilityAnalysis(
        A, _end_effector(vehicle, task), (weight, arm), box, cases, [None] * (1 + len(cases)), J
    )
    if not analysis.in_range:
        return None
    F, T = analysis.A[:3], analysis.A[3:]
    ((ball,),) = largest_balls([Polytopes(F, T, np.zeros((1, 3)), np.zeros((1, 3)))], box)
    rows, hull = analysis.cases(), force_hull(F, T, np.zeros(3), box)
    # relative to the largest, smaller singular values count as zero
    return Capability(
        rank=int(np.linalg.matrix_rank(analysis.A, rtol=1e-9)),
        zero_torque_volume_N3=0.0 if hull is None else clamp(hull.volume * weight**3),
        zero_torque_ball_N=clamp(ball.lower * weight),
        flight=Flight(
            cases=rows,
            rotors_out_hover=analysis.rotors_out([0]),
            rotors_out_all=analysis.rotors_out(range(len(rows))),
            joints=(),
            hinge_tolerance_deg=None,
            hover_input=analysis.hover_input,
            hover_power_ratio=analysis.hover_power_ratio,
            rod_length_m=None,
            rod_mass_share=None,
            span_m=clamp(max(float(np.linalg.norm(r - rotor, axis=1).max()) for rotor in r)),
        ),
        met=None if task is None else all(row.possible is True for row in rows[1:]),
    )


def rotor_map(vehicle: Vehicle) -> Array:
    """Return the wrench of each rotor about the centre of mass at its largest input, shape (6, N) [N, N m]."""
    columns = []
    for rotor in vehicle.rotors:
        a = np.array([rotor.ax, rotor.ay, rotor.az]) / math.hypot(rotor.ax, rotor.ay, rotor.az)
        r = np.array([rotor.x_m, rotor.y_m, rotor.z_m]) - vehicle.com
        torque = rotor.k_f * np.cross(r, a) - rotor.spin * rotor.k_tau * a
        columns.append(rotor.u_max * np.concatenate([rotor.k_f * a, torque]))
    return np.array(columns).T


def _end_effector(vehicle: Vehicle, task: Task | None) -> Array:
    if vehicle.end_effector is not None:
        return np.subtract(vehicle.end_effector, vehicle.com)
    return np.zeros(3) if task is None else np.array(task.end_effector.fixed_position or (0.0, 0.0, 0.0))


def _cases(task: Task, weight: float) -> dict[str, LoadCase]:
    """Return load cases and their vertices in SI by name."""
    units, cases = (weight, task.module.arm_length * weight), {}
    for label, case in zip(labels(task.cases), task.cases, strict=True):
        cases[label] = case.to_si(*units)
        cases |= {f"{label}, corner {k}": corner.to_si(*units) for k, corner in enumerate(case.corners)}
    return cases


def force_hull(F: Array, T: Array, t: Array, box: Bounds, *, rounds: int = 200) -> ConvexHull | None:
    """Return the hull of all forces F v with T v = t and v in the box; None if it has no volume.

    Args:
        F: shape (3, N).
        T: shape (3, N).
        t: shape (3,).
        box: bounds on v.
        rounds: largest number of refinements, after which the hull may still be too small.
    """
    directions, hull = np.concatenate([np.eye(3), -np.eye(3)]), None
    points = np.empty((0, 3))
    for _ in range(rounds):
        optima = greatest(directions @ F, T, np.broadcast_to(t, (len(directions), 3)), box)
        points = np.concatenate([points, optima.v[np.isfinite(optima.attained)] @ F.T])
        if len(points) < 4:
            return None
        _, sizes, axes = np.linalg.svd(points - points.mean(axis=0))
        if sizes[-1] <= ON_FACET:
            if len(directions) == 2 and abs(float(directions[0] @ axes[-1])) > 1 - ON_FACET:
                return None
            directions = np.stack([axes[-1], -axes[-1]])
            continue
        try:
            hull = ConvexHull(points)
        except QhullError:
            return None
        facets = np.unique(np.round(hull.equations, 9), axis=0)
        reach = greatest(facets[:, :3] @ F, T, np.broadcast_to(t, (len(facets), 3)), box)
        beyond = reach.attained + facets[:, 3] > 10 * ON_FACET
        if not beyond.any():
            break
        directions = facets[beyond, :3]
    return hull

"""Every constraint of a point evaluated again in numpy, exactly: no smoothing, no margin, no word of Ipopt's.

A point is a design when nothing here is violated by more than the tolerances; else the worst violation is the
reason that a user reads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from nlp import names
from nlp.geometry import Swept, clearance, cone_clearance, hull_clearance
from nlp.hinges import beyond_folds
from nlp.point import Point
from topo_search.model import LEAST_OFFSET, Directional, Exterior, Local, Module, needs_offset
from topo_search.model.airflow_room import part_cover
from topo_search.model.arrays import Array
from topo_search.model.hulls import convex_hull

WRENCH_TOLERANCE = 1e-8
"""Largest wrench residual of a design [m_t g, l_arm m_t g]; the audit allows TOLERANCE."""


@dataclass(frozen=True)
class Violation:
    """How far a point is from meeting one constraint."""

    name: str
    amount: float
    """Positive when violated, zero or negative when met, in `unit`."""
    unit: str
    scaled: float
    """The same in l_arm, m_t g, l_arm m_t g or rad, so that different kinds compare."""
    tolerance: float = 0.0
    """Largest `scaled` of a met constraint."""

    @property
    def met(self) -> bool:
        """Whether the constraint holds; NaN never does."""
        return bool(self.scaled <= self.tolerance)

    @property
    def rank(self) -> float:
        """How far beyond its tolerance; NaN is the farthest."""
        return math.inf if math.isnan(self.scaled) else self.scaled - self.tolerance


def violations(point: Point) -> list[Violation]:
    """Return every constraint of the problem with its violation."""
    return [*_wrenches(point), *_clearances(point), *_bounds(point)]


def worst(checks: list[Violation]) -> Violation:
    """Return the constraint that is furthest from being met."""
    return max(checks, key=lambda check: check.rank)


def wrench_matrix(point: Point) -> Array:
    """Return A about W's origin, shape (6, 4n): force [N] and torque [N m] of every rotor at unit input."""
    module, (R, p) = point.task.module, point.poses
    z = R[:, :, 2]
    rotors = p[:, None] + np.einsum("iab,qb->iqa", R, rotor_positions(module))
    thrust_axis = np.broadcast_to(z[:, None], rotors.shape)
    spin = np.array([-1.0, 1.0, -1.0, 1.0])[None, :, None]
    torque = module.thrust_coefficient * np.cross(rotors, thrust_axis)
    torque += spin * module.torque_coefficient * thrust_axis
    columns = np.concatenate([module.thrust_coefficient * thrust_axis, torque], axis=-1)
    return columns.reshape(-1, 6).T


def rotor_positions(module: Module) -> Array:
    """Return delta_1..delta_4 in the module frame, shape (4, 3) [m]."""
    signs = np.array([[1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    return signs * module.arm_length / math.sqrt(2)


def asked_wrenches(point: Point) -> Array:
    """Return the wrench of every load case about W's origin, shape (K, 6) [N, N m]."""
    tip = [case.at_end_effector for case in point.task.load_cases]
    com = [case.at_com for case in point.task.load_cases]
    f_E, tau_E = np.array([wrench.force for wrench in tip]), np.array([wrench.torque for wrench in tip])
    f_C, tau_C = np.array([wrench.force for wrench in com]), np.array([wrench.torque for wrench in com])
    torque = tau_E + tau_C + np.cross(point.p_E, f_E) + np.cross(point.p_COM, f_C)
    return np.concatenate([f_E + f_C, torque], axis=1)


def _wrenches(point: Point) -> Iterator[Violation]:
    task, n = point.task, point.topology.n
    units = task.force_unit(n), task.torque_unit(n)
    K = len(task.load_cases)
    residual = point.u.reshape(K, -1) @ wrench_matrix(point).T - asked_wrenches(point)
    # the residual is about W's origin; a force that is missing makes a torque there, so move it to the COM
    residual[:, 3:] -= np.cross(point.p_COM, residual[:, :3])
    amounts = np.linalg.norm(residual.reshape(K, 2, 3), axis=2)
    # about p_E too, where a missing force has another lever: whichever is more
    at_tip = np.linalg.norm(residual[:, 3:] - np.cross(point.p_E - point.p_COM, residual[:, :3]), axis=1)
    amounts[:, 1] = np.maximum(amounts[:, 1], at_tip)
    for label, (force, torque) in zip(task.case_labels, amounts.tolist(), strict=True):
        yield Violation(names.force(label), force, "N", force / units[0], WRENCH_TOLERANCE)
        yield Violation(names.torque(label), torque, "N m", torque / units[1], WRENCH_TOLERANCE)


def _clearances(point: Point) -> Iterator[Violation]:
    unit = point.task.module.arm_length
    for name, gap in _gaps(point):
        yield Violation(name, -gap, "m", -gap / unit)


def _gaps(point: Point) -> Iterator[tuple[str, float]]:
    """Yield the name and the exact clearance [m], positive when clear, of every geometric constraint."""
    task, n = point.task, point.topology.n
    p = point.poses[1]
    envelopes = point.envelopes
    i, j = np.array(list(combinations(range(n), 2)), dtype=int).reshape(-1, 2).T
    if task.search.interference == "airflow":
        one, other = (replace(envelopes, o=p[side], d=envelopes.d[side]) for side in (i, j))
        yield from zip(map(names.airflow, i, j), clearance(one, other), strict=True)
        distance, bolted = task.centre_distance, point.topology.bolted
    else:
        distance, bolted = task.separation, frozenset()
    if distance is not None:
        for a, b, length in zip(i.tolist(), j.tolist(), np.linalg.norm(p[i] - p[j], axis=1), strict=True):
            if (a, b) not in bolted:
                yield names.separation(a, b), length - distance
    if task.body_clearance is not None:
        unbolted = point.topology.unbolted
        yield from zip(
            (names.rotor_airflow(i, j) for i, j in unbolted), beside_airflow(point).tolist(), strict=True
        )
    if task.exclusion_radius is not None:
        gaps = np.linalg.norm(p - point.p_E, axis=1) - task.exclusion_radius
        yield from ((names.exclusion(a), gap) for a, gap in enumerate(gaps))
    if task.tip_radius is not None:
        gaps = clearance(envelopes, Swept(point.p_E, np.zeros(3), task.tip_radius))
        yield from ((names.tip_airflow(a), gap) for a, gap in enumerate(gaps))

    offset = point.p_E - point.p_COM
    for number, requirement in enumerate(task.exposure):
        if needs_offset(requirement):
            yield names.OFFSET, float(np.linalg.norm(offset)) - LEAST_OFFSET * task.module.arm_length
        match requirement:
            case Local():
                if requirement.radius is None:
                    gaps = hull_clearance(envelopes, point.p_E, convex_hull(requirement.corners))
                else:
                    gaps = clearance(envelopes, Swept(point.p_E, np.zeros(3), requirement.radius))
                yield from ((names.exposure(number, requirement, a), gap) for a, gap in enumerate(gaps))
            case Directional():
                along = requirement.length and requirement.length * offset / np.linalg.norm(offset)
                for segment, path in enumerate(requirement.segments or [along]):
                    gaps = clearance(envelopes, Swept(point.p_E, np.asarray(path), requirement.radius))
                    yield from (
                        (names.exposure(number, requirement, a, segment), gap) for a, gap in enumerate(gaps)
                    )
            case Exterior():
                axis = -offset if requirement.axis == "com" else np.asarray(requirement.axis)
                half_angle = math.radians(requirement.half_angle_deg)
                gaps = cone_clearance(envelopes, point.p_E, axis / np.linalg.norm(axis), half_angle)
                yield from ((names.exposure(number, requirement, a), gap) for a, gap in enumerate(gaps))


def beside_airflow(point: Point) -> Array:
    """Return how clear balls around module i's parts are of module j's envelope, for all unbolted (i, j) [m]."""
    (R, p), air, balls = point.poses, point.envelopes, part_cover(point.task.module)
    i, j = np.array(point.topology.unbolted, dtype=np.intp).reshape(-1, 2).T
    envelope, still = replace(air, o=air.o[j], d=air.d[j]), np.zeros(3)
    least = np.full(len(i), math.inf)
    for place, radius in zip(balls.centres, balls.radii.tolist(), strict=True):
        least = np.minimum(least, clearance(envelope, Swept((p + R @ place)[i], still, radius)))
    return least


def _bounds(point: Point) -> Iterator[Violation]:
    task = point.task
    above = (point.u.max(axis=(1, 2)) - task.max_input).tolist()
    below = (task.min_input - point.u.min(axis=(1, 2))).tolist()
    for label, *beyond in zip(task.case_labels, above, below, strict=True):
        for name, excess in zip((names.largest_input(label), names.smallest_input(label)), beyond, strict=True):
            yield Violation(name, excess, "rad^2/s^2", excess / task.max_input)
    right = math.pi / 2
    for i, excess in enumerate(beyond_folds(task, point.topology, point.alpha).tolist(), start=1):
        yield Violation(names.hinge_angle(i), excess, "rad", excess)
    if task.search.root == "paper":
        limits = zip(("psi", "alpha_0", "alpha_1"), point.root.tolist(), (0.0, right, right), strict=True)
        for name, angle, limit in limits:
            yield Violation(names.root_angle(name), abs(angle) - limit, "rad", abs(angle) - limit)
    l_arm = task.module.arm_length
    too_far = float(np.linalg.norm(point.p_E - point.p_COM)) - task.farthest_end_effector(point.topology.n)
    yield Violation(names.REACH, too_far, "m", too_far / l_arm)
    position = task.end_effector.fixed_position
    if position is not None:
        excess = float(np.linalg.norm(point.p_E - point.p_COM - position))
        yield Violation(names.POSITION, excess, "m", excess / l_arm, 1e-9)

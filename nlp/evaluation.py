r"""Constraint violations at a point of a task, and the correction of points to have none.

Every constraint of a point evaluated again in numpy, exactly: no smoothing, no margin, no word of Ipopt's.

A point is a design when nothing here is violated by more than the tolerances; else the worst violation is the
reason that a user reads.

Correction takes the point that Ipopt reached to one that a file can hold: angles wrapped, inputs exact. Where a
load case has no weight, Ipopt leaves any inputs that produce it; a file gets the least ones, from one small convex
problem per load case:

.. math:: \min_{v_{min} \le v \le 1} \tfrac12 \|v\|^2 \quad \text{subject to} \quad A v = b_k

| symbol | meaning | shape |
|---|---|---|
| v, v_min | inputs over the largest that a design may use; the least that a rotor runs at | (4n,) |
| A | wrench of the rotors at v about W's origin, in weights and arm lengths times weights | (6, 4n) |
| b_k | what load case k asks for, in the same units | (6,) |

The solver is DAQP, a dual active-set method, as CasADi brings it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from nlp import airspeed, names
from nlp.joints import limited_loads, loads
from nlp.numbers.geometry import fold_excess, root_angles, root_rotation
from nlp.numbers.point import Point, weigh_rod
from nlp.requirements import clearances
from nlp.requirements.balances import (
    PAPER_ROOT,
    WRENCH_TOLERANCE,
    asked_wrenches,
    missed_wrenches,
    running_rotors,
    wrench_matrix,
)
from topo_search.model import Design
from topo_search.model.arrays import Array

LOAD_TOLERANCE = 1e-7
"""Tolerance of a joint's load above the largest [m_t g, l_arm m_t g]; the audit allows TOLERANCE."""
PLACE_TOLERANCE = 1e-9
"""Largest error of a fixed end-effector's place [l_arm]."""


@dataclass(frozen=True)
class Violation:
    """Violation of one constraint at a point."""

    name: str
    amount: float
    """Positive when violated, zero or negative when met, in `unit`."""
    unit: str
    scaled: float
    """The same in l_arm, m_t g, l_arm m_t g or rad, so that different kinds compare."""
    tolerance: float = 0.0
    """Largest `scaled` of a met constraint."""
    air: tuple[airspeed.SpeedPoint, ...] = ()
    """Points at which a program states an air speed; empty for other constraints."""

    @property
    def met(self) -> bool:
        """True if the constraint holds; NaN never does."""
        return bool(self.scaled <= self.tolerance)

    @property
    def rank(self) -> float:
        """Excess over its tolerance; NaN is the largest."""
        return math.inf if math.isnan(self.scaled) else self.scaled - self.tolerance


def violations(point: Point) -> list[Violation]:
    """Return every constraint of the problem with its violation."""
    return [*_balances(point), *_clearances(point), *_joints(point), *_air(point), *_bounds(point)]


def worst(checks: list[Violation]) -> Violation:
    """Return the constraint that is furthest from being met."""
    return max(checks, key=lambda check: check.rank)


def _balances(point: Point) -> Iterator[Violation]:
    task, n = point.task, point.topology.n
    for label, (force, torque) in zip(task.case_labels, missed_wrenches(point).tolist(), strict=True):
        yield Violation(names.force(label), force * task.force_unit(n), "N", force, WRENCH_TOLERANCE)
        yield Violation(names.torque(label), torque * task.torque_unit(n), "N m", torque, WRENCH_TOLERANCE)


def _joints(point: Point) -> Iterator[Violation]:
    task, n = point.task, point.topology.n
    for load, size in zip(limited_loads(task, point.topology), loads(point).tolist(), strict=True):
        excess, unit = size - load.limit, task.torque_unit(n) if load.moment else task.force_unit(n)
        yield Violation(load.name, excess, "N m" if load.moment else "N", excess / unit, LOAD_TOLERANCE)


def _air(point: Point) -> Iterator[Violation]:
    for at in airspeed.fastest(point):
        excess = at.speed - airspeed.ALLOWED * at.limit
        yield Violation(airspeed.name_of(point.task, at), excess, "m/s", excess / at.limit, air=at.points)


def _clearances(point: Point) -> Iterator[Violation]:
    l_arm = point.task.module.arm_length
    for requirement in clearances(point.task, point.topology):
        gaps = requirement.gaps(point.vectors).ravel().tolist()
        for (name, _, _), gap in zip(requirement.rows(), gaps, strict=True):
            yield Violation(name, -gap * l_arm, "m", -gap)


def _bounds(point: Point) -> Iterator[Violation]:
    """Yield those of inputs, hinges, root, and p_E where it is bounded.

    The printed problem has no row for the end-effector's reach, and none for its place where a task fixes that: it
    is no unknown then.
    """
    task, l_arm = point.task, point.task.module.arm_length
    u, alive = point.u.reshape(len(task.load_cases), -1), running_rotors(task)
    above = (u - task.max_input * alive).max(axis=1).tolist()
    below = (task.min_input * alive - u).max(axis=1).tolist()
    for label, over, under in zip(task.case_labels, above, below, strict=True):
        yield Violation(f"{label}, largest rotor input", over, "rad^2/s^2", over / task.max_input)
        yield Violation(f"{label}, smallest rotor input", under, "rad^2/s^2", under / task.max_input)
    for i, excess in enumerate(fold_excess(task, point.topology, point.alpha).tolist(), start=1):
        yield Violation(f"hinge angle of module {i}", excess, "rad", excess)
    if task.search.root == "paper":
        for (name, limit), angle in zip(PAPER_ROOT.items(), point.root.tolist(), strict=True):
            yield Violation(f"root orientation, {name}", abs(angle) - limit, "rad", abs(angle) - limit)
    offset, position = point.p_E - point.p_COM, task.end_effector.fixed_position
    too_far = float(np.linalg.norm(offset)) - task.farthest_end_effector(point.topology.n)
    yield Violation(names.REACH, too_far, "m", too_far / l_arm)
    if position is not None:
        off = float(np.linalg.norm(offset - position))
        yield Violation(names.POSITION, off, "m", off / l_arm, PLACE_TOLERANCE)


class Correction(NamedTuple):
    """The correction of inputs."""

    passes: int = 3
    """Largest number of corrections of the inputs; one leaves rounding errors only, unless an input meets its
    bound."""
    stiffness: float = 1e10
    """Price of a squared residual where least inputs are sought, in squared inputs; what is missed is corrected."""


CORRECTION = Correction()


Limits = tuple[Array, Array]
"""Least and largest input of every rotor in every load case, shape (K, 4n) each."""


def correct(point: Point, *, settled: int = 0, refit: bool = False) -> Point:
    """Return the point with its root angles in range and its inputs on the wrench balance.

    Every load case's inputs are moved by the least-norm correction over the rotors that are not at a bound, then
    brought inside their bounds: the balance that Ipopt meets to its tolerance is then met to rounding.

    Args:
        point: where Ipopt ended.
        settled: the first load cases that keep their inputs even if they weigh nothing.
        refit: whether every load case gets the least inputs, whatever it weighs.
    """
    A, b, alive = wrench_matrix(point), asked_wrenches(point), running_rotors(point.task)
    limits = point.task.min_input * alive, point.task.max_input * alive
    u = _balance(A, b, np.clip(point.u.reshape(len(b), -1), *limits), limits)
    weightless = np.array([case.weight == 0 for case in point.task.load_cases])
    weightless[:settled] = False
    weightless |= refit
    if weightless.any():
        low, high = (limit[weightless] for limit in limits)
        u[weightless] = _least(point, A, b[weightless], u[weightless], (low, high))
    root = root_angles(root_rotation(point.root)) if point.task.search.root == "free" else point.root
    return replace(point, root=root, u=u.reshape(point.u.shape))


def _least(point: Point, A: Array, b: Array, u: Array, limits: Limits) -> Array:
    """Return the least inputs of the wrenches b (K, 6), shape (K, 4n); u where they are not found and miss more."""
    from nlp.reduced.inputs import dual  # compiled code, which most tasks need not load

    units = np.repeat([point.task.force_unit(point.topology.n), point.task.torque_unit(point.topology.n)], 3)
    u_min, u_max = point.task.min_input, point.task.max_input
    columns, wrenches = np.ascontiguousarray((A * u_max / units[:, None]).T), b / units
    least = np.empty_like(u)
    for k, w in enumerate(wrenches):
        produced = columns * (limits[1][k] > 0)[:, None]  # by rotors that run
        dual(produced, w, CORRECTION.stiffness, u_min / u_max, 1.0, np.zeros(6), least[k])
    least = _balance(A, b, np.clip(least * u_max, *limits), limits)
    missed, before = (np.abs((inputs @ A.T - b) / units).max(axis=1) for inputs in (least, u))
    balanced, less = missed <= WRENCH_TOLERANCE / 10, np.sum(least**2, axis=1) < np.sum(u**2, axis=1)
    better = np.where(before <= WRENCH_TOLERANCE / 10, balanced & less, missed < before)
    return np.where(better[:, None], least, u)


def _balance(A: Array, b: Array, u: Array, limits: Limits) -> Array:
    """Return inputs u (K, 4n) within their bounds, moved onto the wrenches b (K, 6); u is changed."""
    unfinished = np.arange(len(b))
    for _ in range(CORRECTION.passes):
        before, u_min, u_max = u[unfinished], limits[0][unfinished], limits[1][unfinished]
        free = (before > u_min) & (before < u_max)
        inverses = np.linalg.pinv(A * free[:, None], rcond=1e-6)
        correction = np.einsum("krw,kw->kr", inverses, b[unfinished] - before @ A.T)
        corrected = np.where(free, before + correction, before)
        u[unfinished] = np.clip(corrected, u_min, u_max)
        met_bound = np.any(free & ((corrected <= u_min) | (corrected >= u_max)), axis=1)
        unfinished = unfinished[met_bound]
        if not len(unfinished):
            break
    return u


class NotPossible(ValueError):
    """No inputs within their limits produce a load case."""


def refit(design: Design, hinge_angles_rad: Sequence[float]) -> Design:
    """Return a design with other hinge angles and the inputs that fit them.

    The root keeps its orientation; the end-effector keeps its place, or where the task fixes it, that from the COM.

    Raises:
        NotPossible: names the first load case that rotors can no longer produce.
    """
    root, alpha = np.array(design.root_orientation_rad), np.array(hinge_angles_rad)
    topology, p_E = design.topology, np.array(design.end_effector_m)
    point = weigh_rod(Point(design.task, topology, root, alpha, p_E, design.inputs))
    task, p_E = point.task, point.p_E
    units = np.repeat([task.force_unit(topology.n), task.torque_unit(topology.n)], 3)
    A = wrench_matrix(point) * task.max_input / units[:, None]
    u = task.max_input * _least_inputs(A, asked_wrenches(point) / units, task.min_input / task.max_input)
    corrected = correct(Point(task, topology, root, alpha, p_E, u.reshape(point.u.shape)))
    off = np.abs(corrected.u.reshape(len(u), -1) / task.max_input @ A.T - asked_wrenches(point) / units).max(axis=1)
    if off.max() > WRENCH_TOLERANCE:
        raise NotPossible(f"load case {int(np.argmax(off))} cannot be produced by the rotors")
    J = corrected.objective
    return design.model_copy(
        update={
            "task": task,
            "hinge_angles_rad": tuple(alpha.tolist()),
            "end_effector_m": tuple(p_E.tolist()),
            "rotor_speeds_squared": tuple(tuple(u_k.ravel().tolist()) for u_k in corrected.u),
            "objective": J,
            "gap": None if design.lower_bound is None else Design.gap_of(J, design.lower_bound),
            "solver": None,
        }
    )


def _least_inputs(A: Array, b: Array, lowest: float) -> Array:
    """Return the least inputs of every load case, shape (K, 4n); NotPossible names one that has none."""
    N = A.shape[1]
    options = {"error_on_fail": False, "print_time": False}
    solve = ca.conic("least", "daqp", {"h": ca.Sparsity.diag(N), "a": ca.Sparsity.dense(6, N)}, options)
    inputs = []
    for k, b_k in enumerate(b):
        solution = solve(h=ca.DM.eye(N), g=0, a=A, lba=b_k, uba=b_k, lbx=lowest, ubx=1)
        if not solve.stats()["success"]:
            raise NotPossible(f"load case {k} cannot be produced by the rotors")
        inputs.append(np.asarray(solution["x"]).ravel())
    return np.array(inputs)

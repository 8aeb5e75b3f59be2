"""A lower bound on the control effort of every design of a task's size."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from nlp.bounds.duality import dual_value, multipliers
from nlp.units import Units
from topo_search.model import Array, CountedRod, Module, ResolvedTask
from topo_search.model.corners import CorneredTask, to_corners
from topo_search.model.proven import TOLERANCE


class EffortBound(NamedTuple):
    """Settings of the searches for good multipliers, and allowances for rounding."""

    min_weight: float = 1e-3
    """Least weight, over the largest, with which the search uses the true weights."""
    raised_weights: tuple[float, float] = (1e-4, 1e-2)
    """Shares of the largest weight to which smaller weights are raised otherwise, one search each."""
    max_multiplier: float = 100.0
    """Largest multiplier of a dual search, in knees 2 lambda T of phi; reached only if a task is impossible."""
    rounding: float = 1e-9
    """Relative amount by which J must be under the bound to be an error."""


BOUND = EffortBound()


class BoundBroken(RuntimeError):
    """A design has less effort than the proven bound: an error of the program."""


def total_forces(task: ResolvedTask) -> Array:
    """Return F_k = f_E + f_C of every load case, shape (K, 3) [N]."""
    return np.array([np.add(case.at_end_effector.force, case.at_com.force) for case in task.load_cases])


def least_force_norms(task: ResolvedTask) -> Array:
    """Return the least magnitude of every load case's force over all rods, shape (K,) [N]."""
    F, D = total_forces(task), rod_force_change(task)
    share = np.clip(-np.sum(F * D, axis=1) / np.maximum(np.sum(D * D, axis=1), np.finfo(float).tiny), 0.0, 1.0)
    return np.asarray(np.linalg.norm(F + share[:, None] * D, axis=1))


def heaviest_extra(task: ResolvedTask) -> float:
    """Return the largest mass of a design beyond the lightest platform's, of its rod and closures [kg]."""
    return task.heaviest_rod + task.heaviest_closures


def rod_force_change(task: ResolvedTask) -> Array:
    """Return the change of every F_k by the heaviest possible rod and closures, shape (K, 3) [N].

    `task` has neither. Every F_k is affine in their mass, so a sum of products with fixed multipliers is least
    without them or with the heaviest ones.
    """
    end_effector, rod_mass = task.end_effector, heaviest_extra(task)
    if rod_mass == 0.0 or end_effector.counted_rod is not None:
        return np.zeros((len(task.load_cases), 3))
    task_with_rod = task.declared.with_rod(CountedRod(module=0, port=0, mass=rod_mass))
    if isinstance(task, CorneredTask):
        task_with_rod = to_corners(task_with_rod, inner=True)
    return np.asarray(total_forces(task_with_rod) - total_forces(task))


def lower_bound(task: ResolvedTask, *, accuracy: float = 0.0) -> float:
    """Return a bound that no design of the task's size undercuts [rad^4/s^4].

    It is the largest of three: the closed form, which allows thrusts of either sign; a dual value, with thrusts
    between zero and those of rho u_max; and the effort of all rotors at their least input. Torques, and all
    geometry except that of axes, are left out. If the rod has mass, the bound holds for rods of any mass
    (`rod_force_change`).

    Args:
        task: task.
        accuracy: largest error of every force [m_t g] and of every input limit [u_max]. With 0 the bound is proven
            for designs that produce their wrenches exactly; with `TOLERANCE` it is `proven_bound`, which is lower
            by about 3e-6 of it if the forces are near m_t g, and by more if they are smaller.
    """
    task = lightest_task(task)
    idle, allowed = 0.0, accuracy * task.module.max_input(task.gravity)
    for kind, count in task.counts:
        inputs = np.maximum(0.0, task.min_input * task.rotor_shares(kind) - allowed)
        idle += count * float(inputs @ inputs)
    idle_effort = float(_weights(task).sum()) * idle * (1 - BOUND.rounding)
    return max(closed_form(task, accuracy), _dual_bound(task, accuracy), idle_effort)


def lightest_task(task: ResolvedTask) -> ResolvedTask:
    """Return the task with the lightest rod, of any tree, and with points of its reserves as load cases.

    Tilts, errors of the centre of mass and dead rotors are left out: they make bounds on forces slower, not better.
    """
    light = task.declared.lightest.model_copy(update={"types_of_nodes": ()})
    flight = light.flight.model_copy(update={"tilt_deg": 0.0, "com_error": 0.0, "rotor_out": "none"})
    return to_corners(light.model_copy(update={"flight": flight}), inner=True)


def proven_bound(task: ResolvedTask) -> float:
    """Return a bound that no design of the task's size with a clear audit undercuts [rad^4/s^4]."""
    return lower_bound(task, accuracy=TOLERANCE)


def bound_of(task: ResolvedTask, J: float) -> float:
    """Return the bound for a design of effort J: `lower_bound`, or J if that is less within the audit's tolerances.

    Raises:
        BoundBroken: J is under the bound that is proven with the audit's tolerances.
    """
    bound = lower_bound(task)
    if bound <= J:
        return bound
    proven = proven_bound(task)
    if proven * (1 - BOUND.rounding) > J:
        raise BoundBroken(
            f"internal error: a design has the control effort {J!r} rad^4/s^4, which is below the lower bound "
            f"{proven!r} rad^4/s^4 proven for all designs: one of the two is wrong"
        )
    return J


def closed_form(task: ResolvedTask, accuracy: float = 0.0) -> float:
    """Return (trace Q^(1/2))^2 / (N k_f^2) <= J [rad^4/s^4].

    Torques, input limits and geometry are dropped, and all rotors have the largest k_f. With the axes of all N
    rotors as columns of Z, F_k = k_f Z u_k. For fixed Z the least ||u_k||^2 is F_k^T M^+ F_k / k_f^2 with
    M = Z Z^T, trace M = N. With
    Q = sum_k lambda_k F_k F_k^T, minimising trace(M^+ Q) over all positive semidefinite M of trace N gives
    (trace Q^(1/2))^2 / N, at M ~ Q^(1/2).

    Trace Q^(1/2) is the sum of the singular values of the rows sqrt(lambda_k) F_k. Errors of e in each row reduce
    it by at most sqrt(3 sum_k lambda_k) e: three singular values, whose squares sum to no more than those of the
    errors.
    """
    F, weights = total_forces(task), _weights(task)
    scale, largest_weight = float(np.abs(F).max()), float(weights.max())
    if scale == 0:
        return 0.0
    rows = np.sqrt(weights / largest_weight)[:, None] * (F / scale)
    loss = math.sqrt(3 * float(np.sum(weights / largest_weight))) * accuracy * _platform_weight(task) / scale
    U, sigma, V = np.linalg.svd(rows, full_matrices=False)
    # a sum of singular values is at least any <Y, rows> with |Y| <= 1; here Y = U V attains it
    change = float(np.sum((U @ V) * np.sqrt(weights / largest_weight)[:, None] * rod_force_change(task) / scale))
    root_trace = max(0.0, float(sigma.sum()) - loss + min(0.0, change))
    thrust = root_trace * scale / (task.module.thrust_coefficient * _largest_gain(task))
    return thrust * thrust / task.number_of_rotors * largest_weight


@lru_cache(maxsize=32)
def _dual_bound(task: ResolvedTask, accuracy: float) -> float:
    """Return the best dual value of the search, as a bound on J [rad^4/s^4].

    With several types of module, N rotors are as good as N / r modules with the r rotors of [module], of which none
    has less thrust at its limit than any of them; modules without rotors lift nothing. The r rotors of a module at
    best share a thrust s m g equally, by the largest k_f:
    ||u_ik||^2 >= r (s_ik u_hover)^2, and s_ik <= T as no rotor exceeds its limit; `nlp.bounds.duality` bounds the
    sum of the squares. It holds for the best of all axes, so that rotors with axes of their own do no better. If
    inputs may exceed their limits by
    `accuracy`, a module's thrust exceeds [0, T] by d, which raises phi_k by at most d |t|, for t < 0.
    """
    result = _search(task)
    if result is None:
        return 0.0
    nu, f, weights, T, effort_scale, scale = result
    d = accuracy * task.module.max_thrust_to_weight * max(mean for _, _, mean in _lifting(task)) / scale
    lengths = np.linalg.norm(nu, axis=1)
    force_error = accuracy * _platform_weight(task) / _force_scale(task) / scale
    change = float(np.sum(nu * rod_force_change(task))) / _force_scale(task) / scale
    value = dual_value(nu, f, weights, T + d) - float(lengths.sum()) * (force_error + d) + min(0.0, change)
    return effort_scale * value if value > 0 else 0.0


@lru_cache(maxsize=32)
def _search(task: ResolvedTask) -> tuple[Array, Array, Array, float, float, float] | None:
    """Return good multipliers, the scaled forces, weights and T, and the units of effort and of force.

    Load cases with almost no weight have almost no curvature, on which the search stalls. It is then repeated with
    raised weights; any multipliers are valid, and those with the greatest dual value at the true weights are
    returned.
    """
    unit = Units.of(task)
    T = task.max_thrust_to_weight * max(limit for _, limit, _ in _lifting(task))
    f, weights = total_forces(task) / _force_scale(task), _weights(task)
    scale, largest_weight = float(np.linalg.norm(f, axis=1).max()), float(weights.max())
    if scale == 0:
        return None
    # scaled for Ipopt, which works best with numbers near 1
    mean = float(np.mean(weights / largest_weight))
    f, weights, T = f / scale, weights / largest_weight / mean, T / scale
    thrust = scale * unit.input / _largest_gain(task)
    effort_scale = task.number_of_rotors * thrust * thrust * mean * largest_weight
    largest = BOUND.max_multiplier * 2 * float(weights.max()) * T
    known_bound = closed_form(task) / effort_scale if 0 < effort_scale < math.inf else 0.0
    ratio = float(weights.min() / weights.max())
    shares = [ratio] if ratio >= BOUND.min_weight else [share for share in BOUND.raised_weights if share > ratio]
    raised_weights = [np.maximum(weights, share * weights.max()) for share in shares]
    candidates = [multipliers(f, w, T, largest=largest, known_bound=known_bound) for w in raised_weights]
    best = candidates[0] if len(candidates) == 1 else max(candidates, key=lambda nu: dual_value(nu, f, weights, T))
    return best, f, weights, T, effort_scale, scale


def gains_of(task: ResolvedTask, kind: Module) -> Array:
    """Return the thrust of a type's rotors over k_f of [module] times their input, shape (r,)."""
    return np.asarray(kind.thrust_coefficient / task.module.thrust_coefficient * kind.rotor_table.gains)


def _lifting(task: ResolvedTask) -> Iterator[tuple[float, float, float]]:
    """Yield largest gain, limit of a rotor's thrust [k_f u_max], and mean gain of each type with rotors.

    Parallel rotors have the mean of a module's limits; tilted ones the largest, as axes differ.
    """
    for kind in task.types:
        if kind.rotor_table.count:
            gains, largest = gains_of(task, kind), max if kind.rotor_table.tilt > 0 else np.mean
            yield float(gains.max()), float(largest(gains * task.rotor_shares(kind))), float(gains.mean())


def _largest_gain(task: ResolvedTask) -> float:
    return max(gain for gain, _, _ in _lifting(task))


def _force_scale(task: ResolvedTask) -> float:
    """Return m g of N / r modules [N]."""
    return task.number_of_rotors / task.module.rotor_table.count * Units.of(task).force


def _platform_weight(task: ResolvedTask) -> float:
    """Return the weight of the heaviest platform [N]."""
    return task.force_unit(task.n) + heaviest_extra(task) * task.gravity


def _weights(task: ResolvedTask) -> Array:
    return np.array([case.weight for case in task.load_cases])

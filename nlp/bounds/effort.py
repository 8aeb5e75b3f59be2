"""A lower bound on the control effort of every design of a task's size."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from nlp.bounds.duality import dual_value, multipliers
from nlp.units import Units
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array
from topo_search.model.corners import CorneredTask, to_corners
from topo_search.model.module import CountedRod
from topo_search.model.proven import TOLERANCE


class EffortBound(NamedTuple):
    """The searches for good multipliers, and what is left to rounding."""

    least_weight: float = 1e-3
    """Least weight, in the largest, of a search with the weights as they are."""
    raised_weights: tuple[float, float] = (1e-4, 1e-2)
    """To what share of the largest weight lesser ones are raised in other searches."""
    largest_multiplier: float = 100.0
    """Largest multiplier of a dual search, in knees 2 lambda T of phi; only what cannot be done drives it there."""
    rounding: float = 1e-9
    """Share of the bound by which J must be under it to be an error."""


BOUND = EffortBound()


class BoundBroken(RuntimeError):
    """A design undercuts what is proven of all designs: a fault of the program."""


def total_forces(task: ResolvedTask) -> Array:
    """Return F_k = f_E + f_C of every load case, shape (K, 3) [N]."""
    return np.array([np.add(case.at_end_effector.force, case.at_com.force) for case in task.load_cases])


def least_sizes(task: ResolvedTask) -> Array:
    """Return the size of every load case's force, whatever its rod weighs, shape (K,) [N]."""
    F, D = total_forces(task), growth(task)
    along = np.clip(-np.sum(F * D, axis=1) / np.maximum(np.sum(D * D, axis=1), np.finfo(float).tiny), 0.0, 1.0)
    return np.asarray(np.linalg.norm(F + along[:, None] * D, axis=1))


def growth(task: ResolvedTask) -> Array:
    """Return by how much the heaviest rod that may count changes every F_k, shape (K, 3) [N].

    `task` has no rod. Every F_k is affine in the rod's mass, so that a sum of products with fixed multipliers is
    least with no rod or with the heaviest.
    """
    end_effector, heaviest = task.end_effector, task.heaviest_rod
    if heaviest == 0.0 or end_effector.counted_rod is not None:
        return np.zeros((len(task.load_cases), 3))
    heavy = task.declared.with_rod(CountedRod(module=0, port=0, mass=heaviest))
    if isinstance(task, CorneredTask):
        heavy = to_corners(heavy, inner=True)
    return np.asarray(total_forces(heavy) - total_forces(task))


def lower_bound(task: ResolvedTask, *, accuracy: float = 0.0) -> float:
    """Return a bound that no design of the task's size undercuts [rad^4/s^4].

    It is the largest of the closed form, which needs no sign of a thrust, of a dual value, which knows that rotors
    only pull, and no more than rho u_max, and of what rotors cost that run at their least input. Torques and all
    geometry but that of axes are left out. Where the rod counts, it holds of rods of any mass (`growth`).

    Args:
        task: the task.
        accuracy: what a design may miss every force by [m_t g], and the limits of every input [u_max]. With 0 the
            bound is proven of designs that produce their wrenches exactly; with `TOLERANCE` it is `proven_bound`,
            which is lower by some 3e-6 of it where the forces are near m_t g, and by more where they are less.
    """
    task = lightest_cases(task)
    idle = max(0.0, task.min_input - accuracy * task.module.max_input(task.gravity))
    at_rest = float(_weights(task).sum()) * 4 * task.n * idle * idle * (1 - BOUND.rounding)
    return max(closed_form(task, accuracy), _dual_bound(task, accuracy), at_rest)


def lightest_cases(task: ResolvedTask) -> ResolvedTask:
    """Return the task with the lightest rod and with points of its reserves as load cases.

    Tilts, errors of the centre of mass and dead rotors are left out: bounds of forces gain nothing from them, and
    take longer.
    """
    light = task.declared.lightest
    flight = light.flight.model_copy(update={"tilt_deg": 0.0, "com_error": 0.0, "rotor_out": "none"})
    return to_corners(light.model_copy(update={"flight": flight}), inner=True)


def proven_bound(task: ResolvedTask) -> float:
    """Return a bound that no design of the task's size undercuts whose audit is clear [rad^4/s^4]."""
    return lower_bound(task, accuracy=TOLERANCE)


def bound_of(task: ResolvedTask, J: float) -> float:
    """Return the bound of a design of effort J: `lower_bound`, or J where the wrench's accuracy lets it be less.

    Raises:
        BoundBroken: J is under what is proven of every design within the audit's tolerances.
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
    """Return (trace Q^(1/2))^2 / (4 n k_f^2) <= J [rad^4/s^4].

    Drop torques, bounds and geometry. With s_ik the thrust of module i in load case k, its four rotors share it
    at best equally, ||u_ik||^2 >= s_ik^2 / (4 k_f^2), and F_k = Z s_k with Z = [z_1 .. z_n]. For fixed Z the least
    ||s_k||^2 is F_k^T M^+ F_k with M = Z Z^T, trace M = n. With Q = sum_k lambda_k F_k F_k^T, minimising
    trace(M^+ Q) over all positive semidefinite M of trace n gives (trace Q^(1/2))^2 / n, at M ~ Q^(1/2).

    Trace Q^(1/2) is the sum of the singular values of the rows sqrt(lambda_k) F_k. Rows that are off by e each take
    sqrt(3 sum_k lambda_k) e from it at most: three singular values, whose squares sum to no more than theirs.
    """
    F, weights = total_forces(task), _weights(task)
    size, heaviest = float(np.abs(F).max()), float(weights.max())
    if size == 0:
        return 0.0
    rows = np.sqrt(weights / heaviest)[:, None] * (F / size)
    off = math.sqrt(3 * float(np.sum(weights / heaviest))) * accuracy * _heaviest(task) / size
    U, sigma, V = np.linalg.svd(rows, full_matrices=False)
    # a sum of singular values is no less than any <Y, rows> with |Y| <= 1, and Y = U V has it here
    change = float(np.sum((U @ V) * np.sqrt(weights / heaviest)[:, None] * growth(task) / size))
    root_trace = max(0.0, float(sigma.sum()) - off + min(0.0, change))
    thrust = root_trace * size / task.module.thrust_coefficient
    return thrust * thrust / (4 * task.n) * heaviest


@lru_cache(maxsize=32)
def _dual_bound(task: ResolvedTask, accuracy: float) -> float:
    """Return the best dual value found, as a bound on J [rad^4/s^4].

    Four rotors share a thrust of s m g at best equally, ||u_ik||^2 >= 4 (s_ik u_hover)^2, and s_ik <= T because
    none of them exceeds rho u_max; `nlp.bounds.duality` bounds the sum of the squares. Where inputs may be beyond
    their limits by `accuracy`, thrusts of a module are beyond [0, T] by d: phi_k is d |t| more at most, for t < 0.
    """
    result = _search(task)
    if result is None:
        return 0.0
    nu, f, weights, T, in_si, size = result
    d = accuracy * task.module.max_thrust_to_weight / size
    lengths = np.linalg.norm(nu, axis=1)
    missed = accuracy * _heaviest(task) / (task.n * Units.of(task).force) / size
    change = float(np.sum(nu * growth(task))) / (task.n * Units.of(task).force) / size
    value = dual_value(nu, f, weights, T + d) - float(lengths.sum()) * (missed + d) + min(0.0, change)
    return in_si * value if value > 0 else 0.0


@lru_cache(maxsize=32)
def _search(task: ResolvedTask) -> tuple[Array, Array, Array, float, float, float] | None:
    """Return good multipliers with the forces, weights and T that they are for, the effort's unit and the force's.

    Load cases that weigh next to nothing have next to no curvature, on which the search stalls. It is repeated with
    such weights raised: all multipliers are proof, and those that prove the most with the true weights are taken.
    """
    unit, T = Units.of(task), task.max_thrust_to_weight
    f, weights = total_forces(task) / (task.n * unit.force), _weights(task)
    size, heaviest = float(np.linalg.norm(f, axis=1).max()), float(weights.max())
    if size == 0:
        return None
    # any unit of force and of effort will do: Ipopt wants numbers near 1
    mean = float(np.mean(weights / heaviest))
    f, weights, T = f / size, weights / heaviest / mean, T / size
    thrust = size * unit.input
    in_si = 4 * task.n * thrust * thrust * mean * heaviest
    largest = BOUND.largest_multiplier * 2 * float(weights.max()) * T
    known = closed_form(task) / in_si if 0 < in_si < math.inf else 0.0
    evenness = float(weights.min() / weights.max())
    least = (
        [evenness]
        if evenness >= BOUND.least_weight
        else [share for share in BOUND.raised_weights if share > evenness]
    )
    raised = [np.maximum(weights, share * weights.max()) for share in least]
    candidates = [multipliers(f, w, T, largest=largest, known=known) for w in raised]
    best = max(candidates, key=lambda nu: dual_value(nu, f, weights, T))
    return best, f, weights, T, in_si, size


def _heaviest(task: ResolvedTask) -> float:
    """Return the largest weight of a platform with any rod [N]."""
    return task.force_unit(task.n) + task.heaviest_rod * task.gravity


def _weights(task: ResolvedTask) -> Array:
    return np.array([case.weight for case in task.load_cases])

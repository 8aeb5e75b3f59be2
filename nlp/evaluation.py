"""Constraint violations at a point of a task, and the correction of points.

Every constraint is evaluated exactly in NumPy, without smoothing or margins, and without trusting Ipopt. A point is
a design if all violations are within their tolerances; otherwise the worst violation is the reason given to the
user.

Correction turns Ipopt's result into a point that a file can hold: angles wrapped, inputs exact. If a load case has
no weight, Ipopt returns any inputs that produce it; correction finds the smallest ones (`nlp.reduced.inputs`).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nlp import names
from nlp.features import LAZY_ROWS, rows_of
from nlp.numbers.geometry import fold_excess, root_angles, root_rotation
from nlp.numbers.point import Point
from nlp.requirements import clearances
from nlp.requirements.balances import (
    WRENCH_TOLERANCE,
    required_wrenches,
    running_rotors,
    wrench_matrix,
    wrench_residuals,
)
from nlp.rows import UserConstraints, Violation
from topo_search.model.arrays import Array

POSITION_TOLERANCE = 1e-9
"""Largest allowed error of a fixed end-effector's position [l_arm]."""


def violations(point: Point, constraints: UserConstraints = ()) -> list[Violation]:
    """Return the violations of all constraints: of the printed problem, of features, and of the user."""
    lazy = (violation for kind in LAZY_ROWS for violation in kind.violations(point))
    added = rows_of(constraints, point.task, point.topology).violations(point) if constraints else ()
    return [*_balances(point), *_clearances(point), *lazy, *_bounds(point), *added]


def worst(checks: list[Violation]) -> Violation:
    """Return the largest violation, relative to tolerances."""
    return max(checks, key=lambda check: check.rank)


def _balances(point: Point) -> Iterator[Violation]:
    task, n = point.task, point.topology.n
    for label, (force, torque) in zip(task.case_labels, wrench_residuals(point).tolist(), strict=True):
        yield Violation(names.force(label), force * task.force_unit(n), "N", force, WRENCH_TOLERANCE)
        yield Violation(names.torque(label), torque * task.torque_unit(n), "N m", torque, WRENCH_TOLERANCE)


def _clearances(point: Point) -> Iterator[Violation]:
    l_arm = point.task.module.arm_length
    for requirement in clearances(point.task, point.topology):
        gaps = requirement.gaps(point.vectors).ravel().tolist()
        for (name, _, _), gap in zip(requirement.rows(), gaps, strict=True):
            yield Violation(name, -gap * l_arm, "m", -gap)


def _bounds(point: Point) -> Iterator[Violation]:
    """Yield the violations of bounds on inputs, hinges, root and p_E.

    The printed problem has no row for the end-effector's reach, nor for a fixed position, which is no unknown.
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
    for (name, (low, high)), angle in zip(task.search.root_ranges.items(), point.root.tolist(), strict=False):
        excess = max(low - angle, angle - high)
        yield Violation(f"root orientation, {name}", excess, "rad", excess)
    offset, position = point.tip - point.p_COM, task.end_effector.fixed_position
    too_far = float(np.linalg.norm(offset)) - task.farthest_end_effector(point.topology.n)
    yield Violation(names.REACH, too_far, "m", too_far / l_arm)
    if position is not None:
        error = float(np.linalg.norm(offset - position))
        yield Violation(names.POSITION, error, "m", error / l_arm, POSITION_TOLERANCE)


def correct_point(point: Point, constraints: UserConstraints) -> Point:
    """Return a corrected point; with user constraints, which may bound inputs, declared load cases keep theirs."""
    return correct(point, settled=len(point.task.declared.load_cases) if constraints else 0)


class Correction(NamedTuple):
    """Settings of the correction of inputs."""

    passes: int = 3
    """Largest number of corrections; one leaves only rounding errors unless an input reaches a bound."""
    stiffness: float = 1e10
    """Price of a squared residual in the search for minimum inputs; residuals are corrected afterwards."""


CORRECTION = Correction()


InputBounds = tuple[Array, Array]
"""Minimum and maximum input of every rotor in every load case, shape (K, r n) each."""


def correct(point: Point, *, settled: int = 0, refit: bool = False) -> Point:
    """Return the point with wrapped root angles and inputs that satisfy the wrench balance.

    The inputs of every load case get the least-norm correction over the rotors that are not at a bound, and are
    then clipped to their bounds. The balance, which Ipopt satisfies to its tolerance, then holds to rounding.

    Args:
        point: the result of Ipopt.
        settled: number of leading load cases that keep their inputs even if they have no weight.
        refit: whether every load case gets its minimum inputs, regardless of its weight.
    """
    A, b, alive = wrench_matrix(point), required_wrenches(point), running_rotors(point.task)
    bounds = point.task.min_input * alive, point.task.max_input * alive
    u = _balance(A, b, np.clip(point.u.reshape(len(b), -1), *bounds), bounds)
    weightless = np.array([case.weight == 0 for case in point.task.load_cases])
    weightless[:settled] = False
    weightless |= refit
    if weightless.any():
        lower, upper = (limit[weightless] for limit in bounds)
        u[weightless] = _smallest_inputs(point, A, b[weightless], u[weightless], (lower, upper))
    root = point.root if point.task.search.root_ranges else root_angles(root_rotation(point.root))
    return replace(point, root=root, u=u.reshape(point.u.shape))


def _smallest_inputs(point: Point, A: Array, b: Array, u: Array, bounds: InputBounds) -> Array:
    """Return the minimum inputs of the wrenches b (K, 6), shape (K, r n), or u where that is better balanced."""
    from nlp.reduced.inputs import dual  # compiled code, which most tasks need not load

    units = np.repeat([point.task.force_unit(point.topology.n), point.task.torque_unit(point.topology.n)], 3)
    u_max = point.task.max_input
    columns, wrenches = np.ascontiguousarray((A * u_max / units[:, None]).T), b / units
    smallest, shares = np.empty_like(u), point.task.input_shares.ravel()
    least, is_uniform = point.task.min_input / u_max, bool(np.all(shares == 1))
    low, high = (least, 1.0) if is_uniform else (least * shares, shares)
    for k, w in enumerate(wrenches):
        produced = columns * (bounds[1][k] > 0)[:, None]  # without dead rotors
        dual(produced, w, CORRECTION.stiffness, low, high, np.zeros(6), smallest[k])
    smallest = _balance(A, b, np.clip(smallest * u_max, *bounds), bounds)
    residuals, residuals_before = (np.abs((inputs @ A.T - b) / units).max(axis=1) for inputs in (smallest, u))
    balanced, cheaper = residuals <= WRENCH_TOLERANCE / 10, np.sum(smallest**2, axis=1) < np.sum(u**2, axis=1)
    better = np.where(residuals_before <= WRENCH_TOLERANCE / 10, balanced & cheaper, residuals < residuals_before)
    return np.where(better[:, None], smallest, u)


def _balance(A: Array, b: Array, u: Array, bounds: InputBounds) -> Array:
    """Correct inputs u (K, r n) in place to produce the wrenches b (K, 6) within their bounds; return u."""
    active = np.arange(len(b))
    for _ in range(CORRECTION.passes):
        inputs, u_min, u_max = u[active], bounds[0][active], bounds[1][active]
        free = (inputs > u_min) & (inputs < u_max)
        inverses = np.linalg.pinv(A * free[:, None], rcond=1e-6)
        correction = np.einsum("krw,kw->kr", inverses, b[active] - inputs @ A.T)
        corrected = np.where(free, inputs + correction, inputs)
        u[active] = np.clip(corrected, u_min, u_max)
        met_bound = np.any(free & ((corrected <= u_min) | (corrected >= u_max)), axis=1)
        active = active[met_bound]
        if not len(active):
            break
    return u

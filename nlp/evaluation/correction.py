"""From the point that Ipopt reached to one that a file can hold: angles wrapped, inputs exact.

Where a load case weighs nothing, Ipopt leaves any inputs that produce it; a file gets the least ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlp.numbers.geometry import root_angles, root_rotation
from nlp.numbers.point import Point
from nlp.requirements.balances import WRENCH_TOLERANCE, asked_wrenches, wrench_matrix
from nlp.requirements.bounds import running_rotors
from topo_search.model.arrays import Array

PASSES = 3
"""Largest number of corrections of the inputs; one leaves rounding errors only, unless an input meets its bound."""
Limits = tuple[Array, Array]
"""Least and largest input of every rotor in every load case, shape (K, 4n) each."""
STIFFNESS = 1e10
"""Price of a squared residual where least inputs are sought, in squared inputs; what is missed is corrected."""


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
        dual(produced, w, STIFFNESS, u_min / u_max, 1.0, np.zeros(6), least[k])
    least = _balance(A, b, np.clip(least * u_max, *limits), limits)
    missed, before = (np.abs((inputs @ A.T - b) / units).max(axis=1) for inputs in (least, u))
    found, less = missed <= WRENCH_TOLERANCE / 10, np.sum(least**2, axis=1) < np.sum(u**2, axis=1)
    better = np.where(before <= WRENCH_TOLERANCE / 10, found & less, missed < before)
    return np.where(better[:, None], least, u)


def _balance(A: Array, b: Array, u: Array, limits: Limits) -> Array:
    """Return inputs u (K, 4n) within their bounds, moved onto the wrenches b (K, 6); u is changed."""
    unfinished = np.arange(len(b))
    for _ in range(PASSES):
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

"""A lower bound on the control effort of every design of a task's size."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from nlp.bounds.duality import dual_value, multipliers
from nlp.units import Units
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array

FARTHEST = 100.0
"""Largest multiplier of a dual search, in knees 2 lambda T of phi; only what cannot be done drives it there."""


def total_forces(task: ResolvedTask) -> Array:
    """Return F_k = f_E + f_C of every load case, shape (K, 3) [N]."""
    return np.array([np.add(case.at_end_effector.force, case.at_com.force) for case in task.load_cases])


def lower_bound(task: ResolvedTask) -> float:
    """Return a bound that no design of the task's size undercuts [rad^4/s^4].

    It is the larger of the closed form, which needs no sign of a thrust, and of a dual value, which knows that
    rotors only pull, and no more than rho u_max. Torques and all geometry but that of axes are left out: a design
    that produces its forces to within the audit's tolerances may be under the bound by as much.
    """
    return max(closed_form(task), _dual_bound(task))


def closed_form(task: ResolvedTask) -> float:
    """Return (trace Q^(1/2))^2 / (4 n k_f^2) <= J [rad^4/s^4].

    Drop torques, bounds and geometry. With s_ik the thrust of module i in load case k, its four rotors share it
    at best equally, ||u_ik||^2 >= s_ik^2 / (4 k_f^2), and F_k = Z s_k with Z = [z_1 .. z_n]. For fixed Z the least
    ||s_k||^2 is F_k^T M^+ F_k with M = Z Z^T, trace M = n. With Q = sum_k lambda_k F_k F_k^T, minimising
    trace(M^+ Q) over all positive semidefinite M of trace n gives (trace Q^(1/2))^2 / n, at M ~ Q^(1/2).
    """
    F = total_forces(task)
    eigenvalues = np.linalg.eigvalsh((F.T * _weights(task)) @ F)
    root_trace = np.sqrt(np.clip(eigenvalues, 0.0, None)).sum()
    return float(root_trace**2 / (4 * task.n * task.module.thrust_coefficient**2))


@lru_cache(maxsize=32)
def _dual_bound(task: ResolvedTask) -> float:
    """Return the best dual value found, as a bound on J [rad^4/s^4].

    Four rotors share a thrust of s m g at best equally, ||u_ik||^2 >= 4 (s_ik u_hover)^2, and s_ik <= T because
    none of them exceeds rho u_max; `nlp.bounds.duality` bounds the sum of the squares.
    """
    unit, T = Units.of(task), task.max_thrust_to_weight
    f, weights = total_forces(task) / (task.n * unit.force), _weights(task)
    size, mean_weight = float(np.linalg.norm(f, axis=1).max()), float(weights.mean())
    if size == 0:
        return 0.0
    # any unit of force and of effort will do: Ipopt wants numbers near 1
    f, weights, T = f / size, weights / mean_weight, T / size
    in_si = 4 * task.n * (size * unit.input) ** 2 * mean_weight
    largest = FARTHEST * 2 * float(weights.max()) * T
    nu = multipliers(f, weights, T, largest=largest, known=closed_form(task) / in_si)
    return in_si * dual_value(nu, f, weights, T)


def _weights(task: ResolvedTask) -> Array:
    return np.array([case.weight for case in task.load_cases])

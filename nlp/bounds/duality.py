r"""Thrusts along any axes against the forces of all load cases at once: a dual problem.

| symbol | meaning | shape | unit |
|---|---|---|---|
| n, K | modules, load cases | | |
| f_k | force of load case k that a module bears on average, F_k / n | (3,) | m g |
| z_i | thrust axis of module i, any unit vector | (3,) | |
| s_ik | thrust of module i in load case k, 0 <= s_ik <= T | | m g |
| lambda_k | weight of load case k | | |
| nu_k | multiplier: what a unit of force costs in load case k | (3,) | m g |
| phi_k(t) | greatest t s - lambda_k s^2 of a thrust s in [0, T] | | (m g)^2 |

Whatever the multipliers are, s_ik z_i summing to n f_k means that

    sum_ik lambda_k s_ik^2 >= sum_ik (s_ik nu_k . z_i - phi_k(nu_k . z_i))
                           >= n (sum_k nu_k . f_k - max over unit z of sum_k phi_k(nu_k . z)).

With s the best thrust for t, t / (2 lambda_k) within [0, T], phi_k(t) = s (t - lambda_k s): a form without
cancellation for any weights, zero included. Each phi_k is convex, not negative and zero at 0, so `greatest` bounds
the maximum by proof, and no step of the search for good multipliers has to be believed. The dual problem is
concave; its constraints, one for every z, are added where they are violated.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np

from nlp.bounds.sphere import directions, greatest, ring_around
from nlp.ipopt import ipopt
from topo_search.model.arrays import Array

OPTIONS: dict[str, int | float | str | bool] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 100,
}


class DualSearch(NamedTuple):
    """The search for good multipliers; no step of it has to be believed."""

    splits: int = 2
    """Subdivisions of the octahedron for the first directions: 66 of them."""
    rounds: int = 6
    """Largest number of refinements of the directions."""
    ring: float = 0.25
    """Angle from an added direction to its six companions [rad]; a third of it in every further round."""
    ascents: int = 60
    """Steps from a direction towards a local maximum."""
    good_enough: float = 2e-4
    """Share of the dual value that a search for better multipliers is not continued for."""


SEARCH = DualSearch()

ROUNDING = 1e-14
"""Share of the sum of all |nu_k| |f_k| that is left to rounding."""


def dual_value(nu: Array, f: Array, weights: Array, T: float) -> float:
    """Return a lower bound on the mean over the modules of sum_k lambda_k s_ik^2, for multipliers nu (K, 3)."""
    rounding = ROUNDING * float(np.sum(np.abs(nu) * np.abs(f)))
    return float(np.sum(nu * f)) - rounding - greatest(lambda z: np.sum(_phi(z @ nu.T, weights, T), axis=-1))


def multipliers(f: Array, weights: Array, T: float, *, largest: float, known: float = 0.0) -> Array:
    """Return multipliers nu, shape (K, 3), near those of the greatest dual value with all |nu| <= largest.

    The search ends early when no multipliers can have a dual value above `known`.
    """
    z, best, lower = directions(SEARCH.splits), np.zeros_like(f), -math.inf
    for step in range(SEARCH.rounds):
        nu = _best_multipliers(z, f, weights, T, largest)
        peaks = _peaks(nu, weights, T)
        of_z, of_peaks = (np.sum(_phi(axes @ nu.T, weights, T), axis=-1) for axes in (z, peaks))
        upper, value = np.sum(nu * f) - of_z.max(), np.sum(nu * f) - max(of_z.max(), of_peaks.max())
        if value > lower:
            best, lower = nu, value
        if upper - max(lower, known) <= SEARCH.good_enough * upper:
            break
        z = np.concatenate([z, ring_around(peaks[of_peaks > of_z.max()], SEARCH.ring / 3**step)])
    return best


def _best_multipliers(z: Array, f: Array, weights: Array, T: float, largest: float) -> Array:
    """Return the best multipliers when only the axes z, shape (m, 3), exist."""
    nu, greatest_phi = ca.MX.sym("nu", len(f), 3), ca.MX.sym("greatest_phi")
    t = ca.mtimes(ca.DM(z), nu.T)
    weight = ca.repmat(ca.DM(weights).T, len(z), 1)
    s = ca.fmin(ca.fmax(t, 0) / (2 * weight), T)
    phi = s * (t - weight * s)
    problem = {
        "x": ca.veccat(nu, greatest_phi),
        "f": greatest_phi - ca.sum1(ca.sum2(nu * ca.DM(f))),
        "g": greatest_phi - ca.sum2(phi),
    }
    solver = ipopt("dual", problem, OPTIONS)
    bounds = ca.vertcat(ca.DM.ones(nu.numel()) * largest, ca.inf)
    x = solver(x0=ca.vertcat(ca.vec(ca.DM(2 * weights[:, None] * f)), 1.0), lbx=-bounds, ubx=bounds, lbg=0.0)["x"]
    return np.asarray(np.asarray(x[:-1]).reshape(f.shape, order="F"))


def _peaks(nu: Array, weights: Array, T: float) -> Array:
    """Return the local maxima over the sphere of the convex sum of the phi_k: each step follows its gradient."""
    z = directions(SEARCH.splits)
    for _ in range(SEARCH.ascents):
        t = z @ nu.T
        thrust = _thrust(t, weights, T)  # phi_k'
        gradient = thrust @ nu
        length = np.linalg.norm(gradient, axis=1, keepdims=True)
        z = np.where(length > 0, gradient / np.where(length > 0, length, 1.0), z)
    return z[np.unique(np.round(z, 3), axis=0, return_index=True)[1]]


def _phi(t: Array, weights: Array, T: float) -> Array:
    """Return phi_k(t) for t (..., K): t^2 / (4 lambda_k) between 0 and the knee 2 lambda_k T, linear beyond."""
    s = _thrust(t, weights, T)
    return np.asarray(s * (t - weights * s))


def _thrust(t: Array, weights: Array, T: float) -> Array:
    """Return the thrust s for t (..., K)."""
    half = np.maximum(2 * weights, np.finfo(float).tiny)
    with np.errstate(over="ignore"):
        result: Array = np.where(t >= 2 * weights * T, np.where(t > 0, T, 0.0), np.maximum(t, 0.0) / half)
    return result

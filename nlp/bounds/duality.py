r"""A dual problem: thrusts along any axes against the forces of all load cases at once.

| symbol | meaning | shape | unit |
|---|---|---|---|
| n, K | modules, load cases | | |
| f_k | force of load case k per module, F_k / n | (3,) | m g |
| z_i | thrust axis of module i, any unit vector | (3,) | |
| s_ik | thrust of module i in load case k, 0 <= s_ik <= T | | m g |
| lambda_k | weight of load case k | | |
| nu_k | multiplier: cost of a unit of force in load case k | (3,) | m g |
| phi_k(t) | greatest t s - lambda_k s^2 of a thrust s in [0, T] | | (m g)^2 |

For any multipliers, if the s_ik z_i sum to n f_k then

    sum_ik lambda_k s_ik^2 >= sum_ik (s_ik nu_k . z_i - phi_k(nu_k . z_i))
                           >= n (sum_k nu_k . f_k - max over unit z of sum_k phi_k(nu_k . z)).

With s the best thrust for t, t / (2 lambda_k) clipped to [0, T], phi_k(t) = s (t - lambda_k s), a form without
cancellation for any weights, zero included. Each phi_k is convex, nonnegative and zero at 0, so `sphere_maximum` is
a proven bound on the maximum, and the proof depends on no step of the search for good multipliers. The dual problem
is concave; its constraints, one for every z, are added where they are violated.

`sphere_maximum` covers the sphere by the cones of triangles with unit vertices a, b, c. A point z of such a cone's
part of the sphere is y / ||y|| for a point y of the flat triangle, and ||y|| >= d, the distance of its plane from
the origin. A convex h >= 0 with h(0) = 0 grows along every ray and is largest at a vertex, so

    h(z) <= h(y / d) <= max(h(a / d), h(b / d), h(c / d)),

which exceeds h at the vertices themselves by the order of the triangle's area. Triangles where that still matters
are split into four.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from nlp.ipopt import ipopt
from topo_search.model.arrays import Array

Function = Callable[[Array], Array]
"""From points (m, 3) to values (m,)."""


class SphereCover(NamedTuple):
    """Settings of the cover of the sphere by triangles."""

    accuracy: float = 2e-4
    """Largest relative excess of a triangle's bound over the largest value of h so far that needs no split."""
    max_triangles: int = 300_000
    """Largest number of triangles; beyond it nothing is split, and the bound is coarser but still valid."""
    rounding: float = 1e-12
    """Allowance for the rounding of d and of the vertices, over the bound."""


SPHERE = SphereCover()


def octahedron() -> Array:
    """Return the eight triangles of the octahedron, shape (8, 3, 3)."""
    x, y, z = np.eye(3)
    return np.array([[i * x, j * y, k * z] for i in (1, -1) for j in (1, -1) for k in (1, -1)])


def split(triangles: Array) -> Array:
    """Return four triangles for each, with vertices at the middles of its sides, projected onto the sphere."""
    a, b, c = triangles.transpose(1, 0, 2)
    ab, bc, ca = (_unit(a + b), _unit(b + c), _unit(c + a))
    quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(vertices, axis=1) for vertices in quarters])


def directions(splits: int) -> Array:
    """Return 4^(splits + 1) + 2 evenly spread directions, shape (m, 3)."""
    triangles = octahedron()
    for _ in range(splits):
        triangles = split(triangles)
    return np.unique(np.round(triangles.reshape(-1, 3), 12), axis=0)


def ring_around(axes: Array, angle: float) -> Array:
    """Return unit axes (m, 3) and six directions at an angle [rad] around each, shape (7 m, 3)."""
    across = _unit(np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), axis=1)]))
    turns = np.arange(6) * np.pi / 3
    ring = np.multiply.outer(np.cos(turns), across) + np.multiply.outer(np.sin(turns), np.cross(axes, across))
    return np.concatenate([axes, (np.cos(angle) * axes + np.sin(angle) * ring).reshape(-1, 3)])


def sphere_maximum(h: Function) -> float:
    """Return an upper bound on h over the unit sphere; h must be convex and nonnegative with h(0) = 0."""
    triangles, largest_value, bound = octahedron(), 0.0, 0.0
    while True:
        largest_value = max(largest_value, float(h(triangles.reshape(-1, 3)).max()))
        outer = triangles / _distance(triangles)[:, None, None]
        bounds = h(outer.reshape(-1, 3)).reshape(-1, 3).max(axis=1)
        is_open = bounds > (1 + SPHERE.accuracy) * largest_value
        if 4 * np.count_nonzero(is_open) > SPHERE.max_triangles:
            is_open[:] = False
        bound = max(bound, float(bounds[~is_open].max(initial=0.0)))
        triangles = split(triangles[is_open])
        if not len(triangles):
            return bound * (1 + SPHERE.rounding)


def _distance(triangles: Array) -> Array:
    """Return the distance d of every triangle's plane from the origin."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    return np.asarray(np.abs(np.sum(normal * a, axis=1)) / np.linalg.norm(normal, axis=1))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


class DualSearch(NamedTuple):
    """Settings of the search for good multipliers."""

    splits: int = 2
    """Subdivisions of the octahedron for the initial directions: 66 of them."""
    rounds: int = 6
    """Largest number of refinements of the directions."""
    ring: float = 0.25
    """Angle from an added direction to the six around it [rad]; each round divides it by three."""
    ascents: int = 60
    """Steps from a direction towards a local maximum."""
    tolerance: float = 2e-4
    """Relative gap of the dual value at which the search ends."""


SEARCH = DualSearch()


def dual_value(nu: Array, f: Array, weights: Array, T: float) -> float:
    """Return a lower bound on the mean over the modules of sum_k lambda_k s_ik^2, for multipliers nu (K, 3)."""
    # 1e-14: allowance for rounding, over the sum of all |nu_k| |f_k|
    rounding = 1e-14 * float(np.sum(np.abs(nu) * np.abs(f)))
    return float(np.sum(nu * f)) - rounding - sphere_maximum(lambda z: np.sum(_phi(z @ nu.T, weights, T), axis=-1))


def multipliers(f: Array, weights: Array, T: float, *, largest: float, known_bound: float = 0.0) -> Array:
    """Return near-optimal multipliers nu with all |nu| <= largest, shape (K, 3).

    The search ends early if no multipliers can have a dual value above `known_bound`.
    """
    z, best, lower = directions(SEARCH.splits), np.zeros_like(f), -math.inf
    for step in range(SEARCH.rounds):
        nu = _best_multipliers(z, f, weights, T, largest)
        peaks = _peaks(nu, weights, T)
        of_z, of_peaks = (np.sum(_phi(axes @ nu.T, weights, T), axis=-1) for axes in (z, peaks))
        upper, value = np.sum(nu * f) - of_z.max(), np.sum(nu * f) - max(of_z.max(), of_peaks.max())
        if value > lower:
            best, lower = nu, value
        if upper - max(lower, known_bound) <= SEARCH.tolerance * upper:
            break
        z = np.concatenate([z, ring_around(peaks[of_peaks > of_z.max()], SEARCH.ring / 3**step)])
    return best


def _best_multipliers(z: Array, f: Array, weights: Array, T: float, largest: float) -> Array:
    """Return the best multipliers if only the axes z, shape (m, 3), were possible."""
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
    silent = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": 100}
    solver = ipopt("dual", problem, silent)
    bounds = ca.vertcat(ca.DM.ones(nu.numel()) * largest, ca.inf)
    x = solver(x0=ca.vertcat(ca.vec(ca.DM(2 * weights[:, None] * f)), 1.0), lbx=-bounds, ubx=bounds, lbg=0.0)["x"]
    return np.asarray(np.asarray(x[:-1]).reshape(f.shape, order="F"))


def _peaks(nu: Array, weights: Array, T: float) -> Array:
    """Return the local maxima over the sphere of the convex sum of the phi_k, by gradient steps."""
    z = directions(SEARCH.splits)
    for _ in range(SEARCH.ascents):
        t = z @ nu.T
        thrust = _thrust(t, weights, T)  # phi_k'
        gradient = thrust @ nu
        length = np.linalg.norm(gradient, axis=1, keepdims=True)
        z = np.where(length > 0, gradient / np.where(length > 0, length, 1.0), z)
    return z[np.unique(np.round(z, 3), axis=0, return_index=True)[1]]


def _phi(t: Array, weights: Array, T: float) -> Array:
    s = _thrust(t, weights, T)
    return np.asarray(s * (t - weights * s))


def _thrust(t: Array, weights: Array, T: float) -> Array:
    """Return the thrust s for t (..., K)."""
    half = np.maximum(2 * weights, np.finfo(float).tiny)
    with np.errstate(over="ignore"):
        result: Array = np.where(t >= 2 * weights * T, np.where(t > 0, T, 0.0), np.maximum(t, 0.0) / half)
    return result

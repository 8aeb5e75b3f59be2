r"""Rotor inputs by duality: with the platform fixed, each load case is a small convex problem.

.. math::

    \phi = \min_{u_{min} \le u \le u_{max}} \tfrac{c}{2} \|u\|^2 + \rho \|A u - w\|^2
         = c \max_\mu \; \mu \cdot w - \frac{\|\mu\|^2}{2 \rho'} - \sum_j h(a_j \cdot \mu),
    \qquad \rho' = 2 \rho / c, \quad u = \mathrm{clip}(A^T \mu, u_{min}, u_{max}), \quad h(v) = v u - u^2 / 2

| symbol | meaning | shape |
|---|---|---|
| A; a_j | wrench of the rotors about the COM over the platform's weight; its column for rotor j | (6, r n); (6,) |
| w | required wrench over the platform's weight | (6,) |
| mu | dual unknowns, rho' (w - A u) at the maximum | (6,) |
| rho | price of a squared residual | |
| J | inertia about the COM; a corner that is an angular acceleration adds J times it to the torque | (3, 3) |

phi is once differentiable in A and w. By the envelope theorem d phi = c mu . (dw - dA u), without derivatives of u.
Infeasible wrenches leave a residual and a finite phi. The concave dual is piecewise quadratic, so Newton's method
with an exact line search terminates after finitely many steps.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from nlp.numbers.cholesky import solve_in_place
from nlp.numbers.kinematics import Vector, add, cross, dot, multiply, row
from nlp.numbers.masses import TINY
from nlp.reduced.arrays import ReducedProblem, Rotors
from nlp.reduced.platform import ReducedPlatform, add_slopes, rotate
from topo_search.compiled_code import njit
from topo_search.model import Array, Flags


class DualAscent(NamedTuple):
    """Newton's method on the dual of the inputs."""

    steps: int = 60
    """Largest number of Newton steps; a warm start takes one to four."""
    accuracy: float = 1e-11
    """Largest gradient of the dual that counts as zero, relative to 1 + |w|."""


ASCENT = DualAscent()


Limit = float | Array
"""Limit of the input of every rotor, or of each, shape (r n,)."""


def limit(of_all: Limit, r: int) -> float:
    """Return the limit of rotor r; compiled functions read no array where all rotors have the same."""
    return float(of_all if isinstance(of_all, float) else of_all[r])


@overload(limit, strict=False)
def _compile_limit(of_all: Any, r: Any) -> Callable[[Any, Any], Any]:
    if isinstance(of_all, types.Array):
        return lambda of_all, r: of_all[r]
    return lambda of_all, r: of_all


@njit(cache=True, inner=True)
def effort(
    problem: ReducedProblem, pose: ReducedPlatform, active: Flags, rho: float, mu: Array, u: Array, gradient: Array
) -> float:
    """Return the sum of phi over the active load cases, add its gradient by x to `gradient`, and set mu and u.

    Args:
        problem: the task and topology.
        pose: the platform.
        active: mask of active load cases, shape (K,).
        rho: price of a squared residual.
        mu: dual unknowns, shape (K, 6): the warm start, then the maximum.
        u: output: the inputs, shape (K, r n).
        gradient: increased by the gradient, shape (N,).
    """
    A, w, total, any_turn = rotor_wrenches(problem, pose), np.empty(6), 0.0, problem.cases.turn.any()
    forces, E, by_J = np.zeros((len(pose.p), 6)), np.zeros(3), np.zeros((3, 3))
    J = inertia(problem.rotors, pose) if any_turn else by_J
    for k in range(len(active)):
        if active[k]:
            c = problem.cases.weight[k]
            find_wrench(problem, pose, J, k, w)
            total += c * inputs(problem, A, k, w, rho, mu[k], u[k])
            add_wrench_gradient(problem, k, c, mu[k], E, by_J)
            add_gradient(A, c, mu[k], u[k], forces)
    if any_turn:
        add_inertia_gradient(problem.rotors, pose, by_J, forces, E)
    add_slopes(problem, pose, forces, E, gradient)
    return total


@njit(cache=True, inner=True, allocates=False)
def add_wrench_gradient(problem: ReducedProblem, k: int, scale: float, mu: Array, E: Array, by_J: Array) -> None:
    """Add the gradient of scale mu . w of load case k by the end-effector to E, and by J (3, 3) to by_J."""
    scale /= problem.rotors.bodies + problem.rotors.m_E
    x, y, z = cross(row(problem.cases.f_E, k), (mu[3], mu[4], mu[5]))
    E[0] += scale * x
    E[1] += scale * y
    E[2] += scale * z
    turn = row(problem.cases.turn, k)
    for a in range(3):
        for b in range(3):
            by_J[a, b] += scale * mu[3 + a] * turn[b]


@njit(cache=True, inner=True, allocates=False)
def add_gradient(A: Array, scale: float, mu: Array, u: Array, forces: Array) -> None:
    """Subtract the gradient of scale mu . A u by the modules' poses from F and T."""
    by_force, by_torque, rotors = (mu[0], mu[1], mu[2]), (mu[3], mu[4], mu[5]), len(A) // len(forces)
    for i in range(len(forces)):
        f = t = (0.0, 0.0, 0.0)
        for j in range(rotors * i, rotors * (i + 1)):
            f, t = add(f, u[j], row(A, j)), add(t, u[j], row(A, j, 3))
        F, T = cross(f, by_torque), add(cross(f, by_force), 1.0, cross(t, by_torque))
        forces[i, 0], forces[i, 1], forces[i, 2] = add(row(forces, i), -scale, F)
        forces[i, 3], forces[i, 4], forces[i, 5] = add(row(forces, i, 3), -scale, T)


@njit(cache=True, inner=True)
def add_inertia_gradient(rotors: Rotors, pose: ReducedPlatform, by_J: Array, forces: Array, E: Array) -> None:
    """Convert a gradient by J to one by F, T and E, and add it."""
    S = (by_J + by_J.T) / 2
    trace, rod, tip, x = S[0, 0] + S[1, 1] + S[2, 2], rotors.rod, (pose.p_E[0], pose.p_E[1], pose.p_E[2]), row(S, 0)
    y, z = row(S, 1), row(S, 2)
    for i in range(len(forces)):
        o, I = _centre(rotors, pose, i), _rotate_inertia(rotors, pose, i)
        F = add(
            multiply(2 * rotors.modules[i] * trace, o), -2 * rotors.modules[i], (dot(x, o), dot(y, o), dot(z, o))
        )
        a, b, c = row(I, 0), row(I, 1), row(I, 2)
        T = add(cross(o, F), 2.0, (dot(b, z) - dot(c, y), dot(c, x) - dot(a, z), dot(a, y) - dot(b, x)))
        forces[i, 0], forces[i, 1], forces[i, 2] = add(row(forces, i), 1.0, F)
        forces[i, 3], forces[i, 4], forces[i, 5] = add(row(forces, i, 3), 1.0, T)
    F = add(multiply(2 * rotors.m_E * trace, tip), -2 * rotors.m_E, (dot(x, tip), dot(y, tip), dot(z, tip)))
    if rod.mass > 0.0:
        d = _rod_path(rotors, pose)
        square, by_d = max(dot(d, d), TINY), (dot(x, d), dot(y, d), dot(z, d))
        roll, i = rod.mass * rod.radius**2 / 2 / square, rod.module
        along = 2 * roll / square * dot(d, by_d) + rod.mass / 3 * trace
        by_d = add(multiply(2 * roll + rod.mass / 3, by_d), -along, d)
        forces[i, 0], forces[i, 1], forces[i, 2] = add(row(forces, i), -1.0, by_d)
        forces[i, 3], forces[i, 4], forces[i, 5] = add(row(forces, i, 3), -1.0, cross(add(tip, -1.0, d), by_d))
        F = add(F, 1.0, by_d)
    E[0] += F[0]
    E[1] += F[1]
    E[2] += F[2]


@njit(cache=True, inner=True, allocates=False)
def find_wrench(problem: ReducedProblem, pose: ReducedPlatform, J: Array, k: int, w: Array) -> None:
    """Compute w of load case k."""
    turn, f = row(problem.cases.turn, k), row(problem.cases.f, k)
    inertial = (dot(row(J, 0), turn), dot(row(J, 1), turn), dot(row(J, 2), turn))
    lever = cross((pose.p_E[0], pose.p_E[1], pose.p_E[2]), row(problem.cases.f_E, k))
    t, m = add(add(row(problem.cases.t, k), 1.0, lever), 1.0, inertial), problem.rotors.bodies + problem.rotors.m_E
    w[0], w[1], w[2], w[3], w[4], w[5] = f[0] / m, f[1] / m, f[2] / m, t[0] / m, t[1] / m, t[2] / m


@njit(cache=True, inner=True)
def inertia(rotors: Rotors, pose: ReducedPlatform) -> Array:
    """Return J, the inertia about the COM, shape (3, 3) [m l_arm^2]."""
    J, rod, tip = np.zeros((3, 3)), rotors.rod, (pose.p_E[0], pose.p_E[1], pose.p_E[2])
    _add_point_inertia(J, rotors.m_E, tip)
    for i in range(len(pose.p)):
        J += _rotate_inertia(rotors, pose, i)
        _add_point_inertia(J, rotors.modules[i], _centre(rotors, pose, i))
    if rod.mass > 0.0:  # beyond half its mass at each end
        d = _rod_path(rotors, pose)
        across = rod.mass * rod.radius**2 / 2
        roll = across / max(dot(d, d), TINY)
        _add_point_inertia(J, -roll - rod.mass / 6, d)
        for a in range(3):
            J[a, a] += across + roll * dot(d, d)
    return J


@njit(cache=True, inner=True)
def _add_point_inertia(J: Array, mass: float, o: Vector) -> None:
    """Add the inertia of a point mass at o from the COM."""
    for a in range(3):
        for b in range(3):
            J[a, b] -= mass * o[a] * o[b]
        J[a, a] += mass * dot(o, o)


@njit(cache=True, inner=True)
def _rotate_inertia(rotors: Rotors, pose: ReducedPlatform, i: int) -> Array:
    """Return the inertia of module i with its joints about its centre of mass, along the axes of W."""
    J, R, I = np.zeros((3, 3)), pose.R, rotors.inertias
    for a in range(3):
        for b in range(3):
            for c in range(3):
                for d in range(3):
                    J[a, b] += R[i, a, c] * I[i, c, d] * R[i, b, d]
    return J


@njit(cache=True, inner=True)
def _centre(rotors: Rotors, pose: ReducedPlatform, i: int) -> Vector:
    return add(row(pose.o, i), 1.0, rotate(pose.R, i, (rotors.centres[i, 0], rotors.centres[i, 1], 0.0)))


@njit(cache=True, inner=True)
def _rod_path(rotors: Rotors, pose: ReducedPlatform) -> Vector:
    """Return the vector from the rod's connector to the end-effector."""
    i = rotors.rod.module
    start = add(row(pose.o, i), 1.0, rotate(pose.R, i, rotors.rod.foot))
    return add((pose.p_E[0], pose.p_E[1], pose.p_E[2]), -1.0, start)


@njit(cache=True, inner=True)
def inputs(problem: ReducedProblem, A: Array, k: int, w: Array, rho: float, mu: Array, u: Array) -> float:
    """Return phi / c of load case k, and set mu and u to the maximum of the dual; a dead rotor's input is 0."""
    price, dead = 2 * rho / problem.cases.weight[k], problem.cases.dead[k]
    u_min, u_max = problem.rotors.u_min, problem.rotors.u_max
    if dead < 0:
        return dual(A, w, price, u_min, u_max, mu, u)
    column = np.empty(6)
    for a in range(6):
        column[a], A[dead, a] = A[dead, a], 0.0
    idle = limit(u_min, dead)
    value = dual(A, w, price, u_min, u_max, mu, u) - idle * idle / 2  # without the cost of the dead rotor
    for a in range(6):
        A[dead, a] = column[a]
    u[dead] = 0.0
    return value


@njit(cache=True, inner=True)
def rotor_wrenches(problem: ReducedProblem, pose: ReducedPlatform) -> Array:
    """Return the wrench of each rotor at unit input, A transposed, shape (r n, 6)."""
    R, centres, forces, torques = pose.R, pose.o, problem.rotors.forces, problem.rotors.torques
    m, rotors = problem.rotors.bodies + problem.rotors.m_E, len(forces) // len(R)
    A = np.empty((len(forces), 6))
    for i in range(len(R)):
        for q in range(rotors):
            j, (x, y, z) = rotors * i + q, rotate(R, i, row(forces, rotors * i + q))
            A[j, 0], A[j, 1], A[j, 2] = f = x / m, y / m, z / m
            lever = cross(row(centres, i), f)
            A[j, 3], A[j, 4], A[j, 5] = add(lever, 1 / m, rotate(R, i, row(torques, j)))
    return A


@njit(cache=True)
def dual(A: Array, w: Array, rho: float, u_min: Limit, u_max: Limit, mu: Array, u: Array) -> float:
    """Return phi / c, with rho' as `rho`; set mu to the maximum of the dual and u to the inputs there."""
    rotors = len(A)
    v, slope = np.empty(rotors), np.empty(rotors)
    H, g, d = np.empty((6, 6)), np.empty(6), np.empty(6)
    scale = 1.0
    for a in range(6):
        scale += abs(w[a])
    for _ in range(ASCENT.steps):
        for a in range(6):
            g[a] = w[a] - mu[a] / rho
            for b in range(a):
                H[a, b] = 0.0
            H[a, a] = 1.0 / rho
        for r in range(rotors):
            s = 0.0
            for a in range(6):
                s += A[r, a] * mu[a]
            v[r] = s
            u[r] = min(max(s, limit(u_min, r)), limit(u_max, r))
            if u[r] > 0.0:
                for a in range(6):
                    g[a] -= A[r, a] * u[r]
            if limit(u_min, r) < s < limit(u_max, r):
                for a in range(6):
                    for b in range(a + 1):
                        H[a, b] += A[r, a] * A[r, b]
        largest = 0.0
        for a in range(6):
            largest = max(largest, abs(g[a]))
        if largest <= ASCENT.accuracy * scale:
            break
        for a in range(6):
            d[a] = g[a]
        solve_in_place(H, d)
        t = _line_search(A, w, rho, u_min, u_max, mu, d, v, slope)
        for a in range(6):
            mu[a] += t * d[a]
    value = 0.0
    for a in range(6):
        value += mu[a] * w[a] - mu[a] * mu[a] / (2 * rho)
    for r in range(rotors):
        value -= v[r] * u[r] - u[r] * u[r] / 2
    return value


@njit(cache=True, inner=True, allocates=False)
def _line_search(
    A: Array, w: Array, rho: float, u_min: Limit, u_max: Limit, mu: Array, d: Array, v: Array, slope: Array
) -> float:
    """Return the step size along d that maximises the concave dual: the root of its piecewise linear slope.

    Newton's method in a bracket of the root; exact once a step stays within one linear piece.
    """
    first = second = 0.0
    for a in range(6):
        first += d[a] * (w[a] - mu[a] / rho)
        second += d[a] * d[a] / rho
    for r in range(len(A)):
        s = 0.0
        for a in range(6):
            s += A[r, a] * d[a]
        slope[r] = s
    low, high, t = 0.0, math.inf, 1.0
    for _ in range(100):
        value, change = first - t * second, second
        for r in range(len(A)):
            input_at = v[r] + t * slope[r]
            value -= slope[r] * min(max(input_at, limit(u_min, r)), limit(u_max, r))
            change += slope[r] * slope[r] if limit(u_min, r) < input_at < limit(u_max, r) else 0.0
        step = value / change
        if abs(step) <= 1e-13 * (1.0 + t):
            return t
        if value > 0.0:
            low = t
        else:
            high = t
        t += step
        if not low < t < high:
            t = (low + high) / 2 if high < math.inf else 2 * low
        if high - low <= 1e-15 * high:
            return t
    return t

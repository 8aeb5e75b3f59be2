r"""Rotor inputs by their dual: for a fixed platform each load case is a small convex problem.

.. math::

    \phi = \min_{u_{min} \le u \le u_{max}} \tfrac{c}{2} \|u\|^2 + \rho \|A u - w\|^2
         = c \max_\mu \; \mu \cdot w - \frac{\|\mu\|^2}{2 \rho'} - \sum_j h(a_j \cdot \mu),
    \qquad \rho' = 2 \rho / c, \quad u = \mathrm{clip}(A^T \mu, u_{min}, u_{max}), \quad h(v) = v u - u^2 / 2

| symbol | meaning | shape |
|---|---|---|
| A; a_j | wrench of the rotors about the COM over the platform's weight; its column of rotor j | (6, 4n); (6,) |
| w | the asked wrench over the platform's weight | (6,) |
| mu | dual unknowns, rho' (w - A u) at the maximum | (6,) |
| rho | price of a squared residual | |
| J | inertia about the COM; a corner that is an angular acceleration adds J times it to the torque | (3, 3) |

phi is once differentiable in A and w, and by the envelope theorem d phi = c mu . (dw - dA u), without any
derivative of u. Wrenches out of reach leave a residual and a finite phi. The concave dual is piecewise quadratic:
Newton's method with an exact line search ends in finitely many steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.numbers.cholesky import solve_in_place
from nlp.numbers.masses import TINY
from nlp.reduced.arrays import Mask, ReducedProblem
from nlp.reduced.platform import Moved, Platform
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class DualAscent(NamedTuple):
    """Newton's method on the dual of the inputs."""

    steps: int = 60
    """Largest number of Newton steps; a warm start takes one to four."""
    accuracy: float = 1e-11
    """Largest gradient of the dual at its maximum, relative to 1 + |w|."""


ASCENT = DualAscent()


@njit(cache=True)
def effort(
    problem: ReducedProblem,
    at: Platform,
    moved: Moved,
    counting: Mask,
    rho: float,
    mu: Array,
    u: Array,
    gradient: Array,
) -> float:
    """Return the sum of phi over the load cases; its gradient by x is added to `gradient`, and mu and u are found.

    Args:
        problem: the task and topology.
        at: the platform.
        moved: its derivatives.
        counting: which load cases count, shape (K,).
        rho: price of a squared residual.
        mu: where each case's search begins; then where it ended, shape (K, 6).
        u: the inputs that are found, shape (K, 4n).
        gradient: is added to, shape (N,).
    """
    n, K = len(at.p), len(problem.cases.effort)
    m = problem.rotors.bodies + problem.rotors.m_E
    A = columns(problem, at)
    w, total = np.empty(6), 0.0
    F, T, E = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(3)  # gradients by o_i, by turns of module i, by p_E
    for k in range(K):
        if not counting[k]:
            continue
        c = problem.cases.effort[k]
        find_wrench(problem, at, k, w)
        total += c * inputs(problem, A, k, w, rho, mu[k], u[k])
        add_wrench_gradient(problem, at, k, c / m, mu[k], u[k], F, T, E)
    to_unknowns(problem, at, moved, F, T, E, gradient)
    return total


@njit(cache=True)
def to_unknowns(
    problem: ReducedProblem, at: Platform, moved: Moved, F: Array, T: Array, E: Array, gradient: Array
) -> None:
    """Add a gradient by o_i, by turns of the modules, shape (n, 3) each, and by p_E to that by x, shape (N,)."""
    S = np.zeros(3)  # o_i = p_i - p_COM, and p_COM = p'_E - p_E
    for i in range(len(F)):
        S += F[i]
    for l in range(len(gradient)):
        slope = 0.0
        for a in range(3):
            slope += E[a] * moved.dB[l, a] - S[a] * (moved.dE[l, a] - moved.dB[l, a])
        if l < len(F) + 2:
            for i in range(len(F)):
                if problem.tree.moves[l, i]:
                    for a in range(3):
                        slope += F[i, a] * moved.dp[l, i, a] + T[i, a] * at.omega[l, a]
        gradient[l] += slope


@njit(cache=True)
def add_wrench_gradient(
    problem: ReducedProblem, at: Platform, k: int, scale: float, mu: Array, u: Array, F: Array, T: Array, E: Array
) -> None:
    """Add what m scale mu . (dw - dA u) of load case k is by o_i, by turns of the modules and by p_E."""
    add_gradient(problem, at, scale, mu, u, F, T)
    if problem.cases.turn[k].any():
        _add_turn_gradient(problem, at, scale, mu[3:], problem.cases.turn[k], F, T, E)
    fx, fy, fz = problem.cases.f_E[k]
    tx, ty, tz = mu[3], mu[4], mu[5]
    E[0] += scale * (fy * tz - fz * ty)
    E[1] += scale * (fz * tx - fx * tz)
    E[2] += scale * (fx * ty - fy * tx)


@njit(cache=True)
def find_wrench(problem: ReducedProblem, at: Platform, k: int, w: Array) -> None:
    """Find w of load case k."""
    m = problem.rotors.bodies + problem.rotors.m_E
    x, y, z = at.p_E[0] - at.p_COM[0], at.p_E[1] - at.p_COM[1], at.p_E[2] - at.p_COM[2]
    fx, fy, fz = problem.cases.f_E[k]
    for a in range(3):
        w[a], w[3 + a] = problem.cases.f[k, a] / m, problem.cases.t[k, a] / m
    w[3] += (y * fz - z * fy) / m
    w[4] += (z * fx - x * fz) / m
    w[5] += (x * fy - y * fx) / m
    turn = problem.cases.turn[k]
    if turn.any():
        w[3:] += (inertia(problem, at) @ turn) / m


@njit(cache=True)
def inertia(problem: ReducedProblem, at: Platform) -> Array:
    """Return J, the inertia about the COM, shape (3, 3) [m l_arm^2]."""
    J, R, rotors = np.zeros((3, 3)), at.R, problem.rotors
    for i in range(len(at.p) + 1):
        tip = i == len(at.p)
        o = (at.p_E if tip else at.p[i] + _offset(problem, at, i)) - at.p_COM
        mass = rotors.m_E if tip else rotors.modules[i]
        for a in range(3):
            for b in range(3):
                J[a, b] -= mass * o[a] * o[b]
                if not tip:
                    for c in range(3):
                        for d in range(3):
                            J[a, b] += R[i, a, c] * rotors.inertias[i, c, d] * R[i, b, d]
            J[a, a] += mass * (o[0] * o[0] + o[1] * o[1] + o[2] * o[2])
    rod = rotors.rod
    if rod.mass > 0.0:  # what it is beside its halves at its ends
        d = at.p_E - at.p[rod.module] - at.R[rod.module] @ np.array(rod.foot)
        square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        along = rod.mass * (rod.radius**2 / max(square, TINY) + 1 / 6)
        for a in range(3):
            for b in range(3):
                J[a, b] += along * d[a] * d[b]
            J[a, a] -= rod.mass / 6 * square
    return J


@njit(cache=True)
def _offset(problem: ReducedProblem, at: Platform, i: int) -> Array:
    """Return the centre of M_i from that of module i."""
    d, e = problem.rotors.centres[i]
    offset: Array = d * at.R[i, :, 0] + e * at.R[i, :, 1]
    return offset


@njit(cache=True)
def inputs(problem: ReducedProblem, A: Array, k: int, w: Array, rho: float, mu: Array, u: Array) -> float:
    """Return phi / c of load case k, with mu and u moved to its dual's maximum; a dead rotor's input is 0."""
    price, dead = 2 * rho / problem.cases.effort[k], problem.cases.dead[k]
    u_min, u_max = problem.rotors.u_min, problem.rotors.u_max
    if dead < 0:
        return dual(A, w, price, u_min, u_max, mu, u)
    column = A[dead].copy()
    A[dead] = 0.0
    value = dual(A, w, price, u_min, u_max, mu, u) - u_min * u_min / 2  # what a rotor that does nothing costs
    A[dead] = column
    u[dead] = 0.0
    return value


@njit(cache=True)
def columns(problem: ReducedProblem, at: Platform) -> Array:
    """Return A transposed, shape (4n, 6)."""
    n, torques = len(at.p), problem.rotors.torques
    m = problem.rotors.bodies + problem.rotors.m_E
    A = np.empty((4 * n, 6))
    for i in range(n):
        x, y, z = at.z[i]
        a, b, c = at.p[i, 0] - at.p_COM[0], at.p[i, 1] - at.p_COM[1], at.p[i, 2] - at.p_COM[2]
        lever = ((b * z - c * y) / 4, (c * x - a * z) / 4, (a * y - b * x) / 4)
        for q in range(4):
            for k in range(3):
                A[4 * i + q, k] = at.z[i, k] / 4 / m
                turned = (
                    at.R[i, k, 0] * torques[q, 0] + at.R[i, k, 1] * torques[q, 1] + at.R[i, k, 2] * torques[q, 2]
                )
                A[4 * i + q, 3 + k] = (lever[k] + turned) / m
    return A


@njit(cache=True)
def add_gradient(
    problem: ReducedProblem, at: Platform, scale: float, mu: Array, u: Array, F: Array, T: Array
) -> None:
    """Add what -m scale mu . dA u is by o_i and by turns of the modules."""
    torques = problem.rotors.torques
    fx, fy, fz, tx, ty, tz = mu
    for i in range(len(at.p)):
        s, m0, m1, m2 = 0.0, 0.0, 0.0, 0.0
        for q in range(4):
            v = u[4 * i + q]
            s += v / 4
            m0 += v * torques[q, 0]
            m1 += v * torques[q, 1]
            m2 += v * torques[q, 2]
        x, y, z = at.z[i]
        F[i, 0] -= scale * s * (y * tz - z * ty)
        F[i, 1] -= scale * s * (z * tx - x * tz)
        F[i, 2] -= scale * s * (x * ty - y * tx)
        a, b, c = at.p[i, 0] - at.p_COM[0], at.p[i, 1] - at.p_COM[1], at.p[i, 2] - at.p_COM[2]
        gx, gy, gz = fx + ty * c - tz * b, fy + tz * a - tx * c, fz + tx * b - ty * a
        vx = at.R[i, 0, 0] * m0 + at.R[i, 0, 1] * m1 + at.R[i, 0, 2] * m2
        vy = at.R[i, 1, 0] * m0 + at.R[i, 1, 1] * m1 + at.R[i, 1, 2] * m2
        vz = at.R[i, 2, 0] * m0 + at.R[i, 2, 1] * m1 + at.R[i, 2, 2] * m2
        T[i, 0] -= scale * (s * (y * gz - z * gy) + vy * tz - vz * ty)
        T[i, 1] -= scale * (s * (z * gx - x * gz) + vz * tx - vx * tz)
        T[i, 2] -= scale * (s * (x * gy - y * gx) + vx * ty - vy * tx)


@njit(cache=True)
def _add_turn_gradient(
    problem: ReducedProblem, at: Platform, scale: float, mu: Array, turn: Array, F: Array, T: Array, E: Array
) -> None:
    """Add what c mu . dJ turn is by the places o_i and p_E, and by turns of the modules."""
    along, rotors = mu[0] * turn[0] + mu[1] * turn[1] + mu[2] * turn[2], problem.rotors
    for i in range(len(at.p) + 1):
        tip = i == len(at.p)
        o = (at.p_E if tip else at.p[i] + _offset(problem, at, i)) - at.p_COM
        mass, by_mu, by_turn = rotors.m_E if tip else rotors.modules[i], 0.0, 0.0
        for a in range(3):
            by_mu += o[a] * mu[a]
            by_turn += o[a] * turn[a]
        by_place = scale * mass * (2 * along * o - by_turn * mu - by_mu * turn)
        if tip:
            E += by_place
            continue
        F[i] += by_place
        T[i] += np.cross(_offset(problem, at, i), by_place)
        I = at.R[i] @ rotors.inertias[i] @ at.R[i].T
        x, y = I @ turn, I @ mu
        T[i, 0] += scale * (x[1] * mu[2] - x[2] * mu[1] - turn[1] * y[2] + turn[2] * y[1])
        T[i, 1] += scale * (x[2] * mu[0] - x[0] * mu[2] - turn[2] * y[0] + turn[0] * y[2])
        T[i, 2] += scale * (x[0] * mu[1] - x[1] * mu[0] - turn[0] * y[1] + turn[1] * y[0])
    rod = rotors.rod
    if rod.mass > 0.0:
        foot = at.R[rod.module] @ np.array(rod.foot)
        d = at.p_E - at.p[rod.module] - foot
        square, by_mu, by_turn = max(d @ d, TINY), d @ mu, d @ turn
        around = rod.mass * rod.radius**2 / square
        by_d = (around + rod.mass / 6) * (by_mu * turn + by_turn * mu) - rod.mass / 3 * along * d
        by_d = scale * (by_d - 2 * around / square * by_mu * by_turn * d)
        E += by_d
        F[rod.module] -= by_d
        T[rod.module] -= np.cross(foot, by_d)


@njit(cache=True)
def dual(A: Array, w: Array, rho: float, u_min: float, u_max: float, mu: Array, u: Array) -> float:
    """Return phi / c, with rho' for rho; mu is moved to the maximum of the dual, and u are the inputs there."""
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
            u[r] = min(max(s, u_min), u_max)
            if u[r] > 0.0:
                for a in range(6):
                    g[a] -= A[r, a] * u[r]
            if u_min < s < u_max:
                for a in range(6):
                    for b in range(a + 1):
                        H[a, b] += A[r, a] * A[r, b]
        worst = 0.0
        for a in range(6):
            worst = max(worst, abs(g[a]))
        if worst <= ASCENT.accuracy * scale:
            break
        for a in range(6):
            d[a] = g[a]
        solve_in_place(H, d)
        t = _longest(A, w, rho, u_min, u_max, mu, d, v, slope)
        for a in range(6):
            mu[a] += t * d[a]
    value = 0.0
    for a in range(6):
        value += mu[a] * w[a] - mu[a] * mu[a] / (2 * rho)
    for r in range(rotors):
        value -= v[r] * u[r] - u[r] * u[r] / 2
    return value


@njit(cache=True)
def _longest(
    A: Array, w: Array, rho: float, u_min: float, u_max: float, mu: Array, d: Array, v: Array, slope: Array
) -> float:
    """Return the step along d at which the concave dual is largest: where its piecewise linear slope is zero.

    Newton's method between the ends of what is known to hold the root; it ends when a piece holds its own root.
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
            at = v[r] + t * slope[r]
            if at >= u_max:
                value -= slope[r] * u_max
            elif at > u_min:
                value -= slope[r] * at
                change += slope[r] * slope[r]
            else:
                value -= slope[r] * u_min
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

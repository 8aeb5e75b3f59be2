r"""Good multipliers of force and torque for fixed angles: a concave problem, by a damped semismooth Newton method.

.. math::

    D(y) = b \cdot y - \sum_{j,k} \psi_k(a_j \cdot y_k) - \frac{1}{2} \sum_{k,l} r_l y_{kl}^2
    \qquad \text{where} \qquad \sum_k g_k \times \mu_k = 0

Nothing that is proven rests on them being the best: any will do (`nlp.bounds.branch.box`). Of weights next to
nothing psi has a kink, on which the method stalls: here they count as more.

| symbol | meaning | shape |
|---|---|---|
| y_k = (nu_k, mu_k) | multipliers of force and torque of load case k, in W | (K, 6) |
| a_j | wrench of a unit of rotor j's input about the origin of W | (4 n, 6) |
| q | multiplier of the condition: the end-effector's best place p'_E | (3,) |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.frames import Frames, moment
from nlp.numbers.cholesky import factor, solve_factored
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

LEAST_WEIGHT = 1e-2
"""That a load case counts with here, in the largest."""


class Newton(NamedTuple):
    """Settings of the search."""

    least_step: float = 1e-3
    """Share of a Newton step under which the search ends."""
    longest: float = 2.0
    """Longest step, in the multipliers' own size: where the balance cannot be met they grow without end."""
    gain: float = 1e-5
    """Share of the dual value that another step should gain."""


NEWTON = Newton()


class Workspace(NamedTuple):
    """Arrays for one search."""

    a: Array
    b: Array
    H: Array
    rows: Array
    """The condition's three, then the gradients of the slopes (`nlp.bounds.branch.slopes`), shape (K, 3 + A, 6)."""
    solved: Array
    """H_k^-1 of the gradient and of the rows, shape (K, 4 + A, 6)."""
    S: Array
    """Compliance of all rows, shape (3 + A, 3 + A)."""
    q: Array
    """Multipliers of the rows, shape (3 + A,)."""
    diagonal: Array
    """Compliance of a row per unit of its multiplier, 0 for a condition, shape (3 + A,)."""
    goal: Array
    """Deficit that a row's change must make up, shape (3 + A,)."""
    step: Array
    trial: Array
    ridge: Array
    """Ridge of every component, shape (6,)."""


@njit(cache=True)
def workspace(problem: BranchProblem) -> Workspace:
    """Return arrays for one box at a time."""
    n, g = len(problem.tree.parent), problem.loads.g
    K, A = len(g), n + 2
    rows = np.zeros((K, 3 + A, 6))
    for k in range(K):
        rows[k, 0, 4], rows[k, 0, 5] = -g[k, 2], g[k, 1]
        rows[k, 1, 3], rows[k, 1, 5] = g[k, 2], -g[k, 0]
        rows[k, 2, 3], rows[k, 2, 4] = -g[k, 1], g[k, 0]
    return Workspace(
        np.zeros((4 * n, 6)),
        np.zeros((K, 6)),
        np.zeros((6, 6)),
        rows,
        np.zeros((K, 4 + A, 6)),
        np.zeros((3 + A, 3 + A)),
        np.zeros(3 + A),
        np.zeros(3 + A),
        np.zeros(3 + A),
        np.zeros((K, 6)),
        np.zeros((K, 6)),
        np.ones(6),
    )


@njit(cache=True, allocates=False)
def wrenches(problem: BranchProblem, R: Array, at: Frames, work: Workspace) -> None:
    """Fill the wrenches of all rotors, and the load cases' but for p'_E, for a root orientation R and frames."""
    loads, n = problem.loads, len(problem.tree.parent)
    for i in range(n):
        px, py, pz = at.p[i]
        zx, zy, zz = at.z[i]
        force = (zx, zy, zz)
        about = (py * zz - pz * zy, pz * zx - px * zz, px * zy - py * zx)
        for q in range(4):
            ox, oy, oz = problem.torques[q]
            for k in range(3):
                f, t = 0.0, 0.0
                for l in range(3):
                    f += R[k, l] * force[l]
                    t += R[k, l] * (about[l] + ox * at.x[i, l] + oy * at.y[i, l] + oz * at.z[i, l])
                work.a[4 * i + q, k], work.a[4 * i + q, 3 + k] = f / 4, t / 4
    sx, sy, sz = 0.0, 0.0, 0.0
    for i in range(n):
        mx, my, mz = moment(at, i, problem.bodies[i])
        sx, sy, sz = sx + mx, sy + my, sz + mz
    cx = R[0, 0] * sx + R[0, 1] * sy + R[0, 2] * sz
    cy = R[1, 0] * sx + R[1, 1] * sy + R[1, 2] * sz
    cz = R[2, 0] * sx + R[2, 1] * sy + R[2, 2] * sz
    for k in range(len(loads.f)):
        hx, hy, hz = loads.h[k]
        work.b[k, 0], work.b[k, 1], work.b[k, 2] = loads.f[k]
        work.b[k, 3] = loads.t[k, 0] + cy * hz - cz * hy
        work.b[k, 4] = loads.t[k, 1] + cz * hx - cx * hz
        work.b[k, 5] = loads.t[k, 2] + cx * hy - cy * hx


@njit(cache=True, allocates=False)
def value(problem: BranchProblem, work: Workspace, y: Array) -> float:
    """Return D(y), with the weights as they count here."""
    total, u_min, u_max = 0.0, problem.u_min, problem.u_max
    for k in range(len(y)):
        weight = max(LEAST_WEIGHT, problem.loads.weight[k])
        for l in range(6):
            total += (work.b[k, l] - work.ridge[l] / 2 * y[k, l]) * y[k, l]
        for j in range(len(work.a)):
            t = 0.0
            for l in range(6):
                t += work.a[j, l] * y[k, l]
            u = best_input(t, weight, u_min, u_max)
            total -= u * (t - weight * u)
    return total


@njit(cache=True, allocates=False)
def best_input(t: float, weight: float, u_min: float, u_max: float) -> float:
    """Return the u in [u_min, u_max] at which t u - weight u^2 is greatest."""
    if t <= 2 * weight * u_min:
        return u_min
    return u_max if t >= 2 * weight * u_max else t / (2 * weight)


@njit(cache=True, literals=False, allocates=False)
def improve(problem: BranchProblem, work: Workspace, y: Array, steps: int, enough: float) -> float:
    """Improve multipliers in place by so many Newton steps at most, until D(y) is enough; return it."""
    meet(problem, y)
    best = value(problem, work, y)
    for _ in range(steps if best < enough else 0):
        newton_step(problem, work, y, 3)
        size, step = 0.0, 0.0
        for k in range(len(y)):
            for l in range(6):
                size += y[k, l] ** 2
                step += work.step[k, l] ** 2
        share = 1.0
        if step > NEWTON.longest**2 * size > 0.0:
            share = NEWTON.longest * math.sqrt(size / step)
        least = NEWTON.least_step * share
        while True:
            for k in range(len(y)):
                for l in range(6):
                    work.trial[k, l] = y[k, l] + share * work.step[k, l]
            reached = value(problem, work, work.trial)
            if reached > best or share < least:
                break
            share /= 3
        if not reached > best:
            break
        copy(work.trial, y)
        gain, best = reached - best, reached
        if gain < NEWTON.gain * abs(best) or best > enough:
            break
    meet(problem, y)
    return best


@njit(cache=True, allocates=False)
def copy(y: Array, into: Array) -> None:
    """Copy multipliers, shape (K, 6)."""
    for k in range(len(y)):
        for l in range(6):
            into[k, l] = y[k, l]


@njit(cache=True, allocates=False)
def meet(problem: BranchProblem, y: Array) -> None:
    """Change torques' multipliers as little as makes sum_k g_k x mu_k = 0."""
    loads = problem.loads
    x, y_, z = residual(problem, y)
    P = loads.project
    qx = P[0, 0] * x + P[0, 1] * y_ + P[0, 2] * z
    qy = P[1, 0] * x + P[1, 1] * y_ + P[1, 2] * z
    qz = P[2, 0] * x + P[2, 1] * y_ + P[2, 2] * z
    for k in range(len(y)):  # mu_k -= [g_k]x^T q = q x g_k
        gx, gy, gz = loads.g[k]
        y[k, 3] -= qy * gz - qz * gy
        y[k, 4] -= qz * gx - qx * gz
        y[k, 5] -= qx * gy - qy * gx


@njit(cache=True, allocates=False)
def residual(problem: BranchProblem, y: Array) -> tuple[float, float, float]:
    """Return sum_k g_k x mu_k."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(len(y)):
        gx, gy, gz = problem.loads.g[k]
        mx, my, mz = y[k, 3], y[k, 4], y[k, 5]
        a, b, c = a + gy * mz - gz * my, b + gz * mx - gx * mz, c + gx * my - gy * mx
    return a, b, c


@njit(cache=True, allocates=False)
def imbalance(problem: BranchProblem, y: Array, sigma: Array) -> tuple[float, float, float]:
    """Return sum_k g_k x mu_k - sum_r sigma_r n_r, with multipliers of walls."""
    a, b, c = residual(problem, y)
    for r in range(len(sigma)):
        x, y_, z = problem.walls.normal[r]
        a, b, c = a - sigma[r] * x, b - sigma[r] * y_, c - sigma[r] * z
    return a, b, c


@njit(cache=True, allocates=False)
def newton_step(problem: BranchProblem, work: Workspace, y: Array, tied: int) -> None:
    """Fill the step to the maximum of the quadratic model under the first rows, so many.

    A row w with goal g and diagonal d takes (g + w . step)^2 / (2 d) from the model, or is held to 0 where d is 0.
    """
    K, u_min, u_max = len(y), problem.u_min, problem.u_max
    S, q = work.S, work.q
    for row in range(tied):
        q[row] = work.goal[row]
        for column in range(tied):
            S[row, column] = 0.0
    for k in range(K):
        weight = max(LEAST_WEIGHT, problem.loads.weight[k])
        columns, rows = work.solved[k], work.rows[k]
        H = work.H
        H[:] = 0.0
        for l in range(6):
            H[l, l] = work.ridge[l]
            columns[0, l] = work.b[k, l] - work.ridge[l] * y[k, l]
        for j in range(len(work.a)):
            t = 0.0
            for l in range(6):
                t += work.a[j, l] * y[k, l]
            u = best_input(t, weight, u_min, u_max)
            if u == 0.0:
                continue
            for l in range(6):
                columns[0, l] -= u * work.a[j, l]
            if u_min < u < u_max:
                for l in range(6):
                    for m in range(l + 1):
                        H[l, m] += work.a[j, l] * work.a[j, m] / (2 * weight)
        factor(H, 6)
        for row in range(tied):
            for l in range(6):
                columns[1 + row, l] = rows[row, l]
        for column in range(1 + tied):
            solve_factored(H, columns[column], 6)
        for row in range(tied):
            for l in range(6):
                q[row] += rows[row, l] * columns[0, l]
                for column in range(row + 1):
                    S[row, column] += rows[row, l] * columns[1 + column, l]
    size = S[0, 0] + S[1, 1] + S[2, 2]
    for row in range(tied):  # without g there is no condition
        S[row, row] += work.diagonal[row] if row > 2 else 1e-9 * size if size > 0.0 else 1.0
    factor(S, tied)
    solve_factored(S, q, tied)
    for k in range(K):
        for l in range(6):
            work.step[k, l] = work.solved[k, 0, l]
            for row in range(tied):
                work.step[k, l] -= q[row] * work.solved[k, 1 + row, l]

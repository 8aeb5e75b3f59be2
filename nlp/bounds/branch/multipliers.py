r"""Good multipliers of force and torque at fixed angles: a concave problem for a damped semismooth Newton method.

.. math::

    D(y) = b \cdot y - \sum_{j,k} \psi_k(a_j \cdot y_k) - \frac{1}{2} \sum_{k,l} r_l y_{kl}^2
    \qquad \text{where} \qquad \sum_k g_k \times \mu_k = 0

No proof depends on these multipliers being the best: any will do (`nlp.bounds.branch.box`). With a weight near zero
psi has a kink, on which the method stalls, so smaller weights are raised to MIN_WEIGHT here.

| symbol | meaning | shape |
|---|---|---|
| y_k = (nu_k, mu_k) | multipliers of force and torque of load case k, in W | (K, 6) |
| a_j | wrench of rotor j at unit input, about the origin of W | (r n, 6) |
| q | multiplier of the condition: the best end-effector position p'_E | (3,) |
"""

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import ROTORS, BranchProblem
from nlp.bounds.branch.frames import BoxFrames, moment, rotate
from nlp.numbers.cholesky import factor, solve_factored
from nlp.numbers.kinematics import Vector, add, cross, row
from topo_search.compiled_code import njit
from topo_search.model.arrays import Array

MIN_WEIGHT = 1e-2
"""Least weight of a load case in this search, over the largest."""


class Newton(NamedTuple):
    """Settings of the search."""

    min_step_size: float = 1e-3
    """Step size under which the search ends, over that of the first trial."""
    max_step: float = 2.0
    """Longest step, over the length of y: multipliers grow without limit if no balance exists."""
    min_gain: float = 1e-5
    """Least gain of a Newton step, over the dual value."""


NEWTON = Newton()


class NewtonWorkspace(NamedTuple):
    """Arrays for one search."""

    a: Array
    b: Array
    H: Array
    rows: Array
    """Three rows of the condition, then gradients of slopes (`nlp.bounds.branch.slopes`), shape (K, 3 + A, 6)."""
    solved: Array
    """H_k^-1 times the gradient and the rows, shape (K, 4 + A, 6)."""
    S: Array
    """Schur complement of all rows, shape (3 + A, 3 + A)."""
    q: Array
    """Multipliers of the rows, shape (3 + A,)."""
    diagonal: Array
    """d of a row, 0 for the condition, shape (3 + A,)."""
    goal: Array
    """g of a row, shape (3 + A,)."""
    step: Array
    trial_y: Array
    ridge: Array
    """Ridge of every component, shape (6,)."""


@njit(cache=True)
def newton_workspace(problem: BranchProblem) -> NewtonWorkspace:
    """Return the workspace for a task and tree."""
    n, g = len(problem.tree.parent), problem.loads.g
    K, A = len(g), n + 2
    rows = np.zeros((K, 3 + A, 6))
    for k in range(K):
        rows[k, 0, 4], rows[k, 0, 5] = -g[k, 2], g[k, 1]
        rows[k, 1, 3], rows[k, 1, 5] = g[k, 2], -g[k, 0]
        rows[k, 2, 3], rows[k, 2, 4] = -g[k, 1], g[k, 0]
    return NewtonWorkspace(
        np.zeros((ROTORS * n, 6)),
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
def fill_wrenches(problem: BranchProblem, box: BoxFrames, newton: NewtonWorkspace) -> None:
    """Fill a and b, without the torque of p'_E, at the middle of a box."""
    loads, n, R, frames = problem.loads, len(problem.tree.parent), box.roots[0], box.middle
    for i in range(n):
        force = row(frames.z, i)
        about = cross(row(frames.p, i), force)
        for q in range(ROTORS):
            ox, oy, oz = problem.rotor_torques[q]
            for k in range(3):
                f, t = 0.0, 0.0
                for l in range(3):
                    f += R[k, l] * force[l]
                    t += R[k, l] * (about[l] + ox * frames.x[i, l] + oy * frames.y[i, l] + oz * frames.z[i, l])
                newton.a[ROTORS * i + q, k], newton.a[ROTORS * i + q, 3 + k] = f / ROTORS, t / ROTORS
    total = (0.0, 0.0, 0.0)
    for i in range(n):
        total = add(total, 1.0, moment(frames, i, problem.bodies[i]))
    cx, cy, cz = rotate(R, total)
    for k in range(len(loads.f)):
        hx, hy, hz = loads.h[k]
        newton.b[k, 0], newton.b[k, 1], newton.b[k, 2] = loads.f[k]
        newton.b[k, 3] = loads.t[k, 0] + cy * hz - cz * hy
        newton.b[k, 4] = loads.t[k, 1] + cz * hx - cx * hz
        newton.b[k, 5] = loads.t[k, 2] + cx * hy - cy * hx


@njit(cache=True, allocates=False)
def dual_value(problem: BranchProblem, newton: NewtonWorkspace, y: Array) -> float:
    """Return D(y) with the raised weights."""
    total, u_min, u_max = 0.0, problem.u_min, problem.u_max
    for k in range(len(y)):
        weight = max(MIN_WEIGHT, problem.loads.weight[k])
        for l in range(6):
            total += (newton.b[k, l] - newton.ridge[l] / 2 * y[k, l]) * y[k, l]
        for j in range(len(newton.a)):
            t = product(newton.a, j, y, k)
            u = best_input(t, weight, u_min, u_max)
            total -= u * (t - weight * u)
    return total


@njit(cache=True, forceinline=True)
def product(a: Array, j: int, y: Array, k: int) -> float:
    """Return a_j . y_k."""
    t = 0.0
    for l in range(6):
        t += a[j, l] * y[k, l]
    return t


@njit(cache=True, inner=True, allocates=False)
def best_input(t: float, weight: float, u_min: float, u_max: float) -> float:
    """Return the u in [u_min, u_max] that maximizes t u - weight u^2."""
    if t <= 2 * weight * u_min:
        return u_min
    return u_max if t >= 2 * weight * u_max else t / (2 * weight)


@njit(cache=True, literals=False, allocates=False)
def maximize(problem: BranchProblem, newton: NewtonWorkspace, y: Array, steps: int, target: float) -> float:
    """Improve y in place until D(y) reaches `target` or after `steps` Newton steps; return D(y)."""
    enforce_condition(problem, y)
    best = dual_value(problem, newton, y)
    for _ in range(steps if best < target else 0):
        fill_newton_step(problem, newton, y, 3)
        y_square, step_square = 0.0, 0.0
        for k in range(len(y)):
            for l in range(6):
                y_square += y[k, l] ** 2
                step_square += newton.step[k, l] ** 2
        step_size = 1.0
        if step_square > NEWTON.max_step**2 * y_square > 0.0:
            step_size = NEWTON.max_step * math.sqrt(y_square / step_square)
        min_step_size = NEWTON.min_step_size * step_size
        while True:
            for k in range(len(y)):
                for l in range(6):
                    newton.trial_y[k, l] = y[k, l] + step_size * newton.step[k, l]
            trial_value = dual_value(problem, newton, newton.trial_y)
            if trial_value > best or step_size < min_step_size:
                break
            step_size /= 3
        if not trial_value > best:
            break
        copy(newton.trial_y, y)
        gain, best = trial_value - best, trial_value
        if gain < NEWTON.min_gain * abs(best) or best > target:
            break
    enforce_condition(problem, y)
    return best


@njit(cache=True, inner=True, allocates=False)
def copy(y: Array, target: Array) -> None:
    """Copy multipliers, shape (K, 6)."""
    for k in range(len(y)):
        for l in range(6):
            target[k, l] = y[k, l]


@njit(cache=True, inner=True, allocates=False)
def enforce_condition(problem: BranchProblem, y: Array) -> None:
    """Make sum_k g_k x mu_k = 0 by the least change of the torque multipliers."""
    loads, q = problem.loads, rotate(problem.loads.condition_inverse, lever_sum(problem.loads.g, y))
    for k in range(len(y)):  # mu_k -= [g_k]x^T q = q x g_k
        change = cross(q, row(loads.g, k))
        for l in range(3):
            y[k, 3 + l] -= change[l]


@njit(cache=True, allocates=False)
def lever_sum(forces: Array, y: Array) -> Vector:
    """Return sum_k f_k x mu_k for forces f, shape (K, 3): the residual of the condition for g, s for h."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(len(y)):
        fx, fy, fz = forces[k]
        mx, my, mz = y[k, 3], y[k, 4], y[k, 5]
        a, b, c = a + fy * mz - fz * my, b + fz * mx - fx * mz, c + fx * my - fy * mx
    return a, b, c


@njit(cache=True, inner=True, allocates=False)
def residual(problem: BranchProblem, y: Array, sigma: Array) -> Vector:
    """Return the residual of the condition, sum_k g_k x mu_k - sum_r sigma_r n_r."""
    a, b, c = lever_sum(problem.loads.g, y)
    for r in range(len(sigma)):
        x, y_, z = problem.walls.normal[r]
        a, b, c = a - sigma[r] * x, b - sigma[r] * y_, c - sigma[r] * z
    return a, b, c


@njit(cache=True, inner=True, allocates=False)
def fill_newton_step(problem: BranchProblem, newton: NewtonWorkspace, y: Array, row_count: int) -> None:
    """Fill the step to the maximum of the quadratic model with the first `row_count` rows.

    A row w with goal g and diagonal d subtracts (g + w . step)^2 / (2 d) from the model; with d = 0 it is a
    constraint, g + w . step = 0.
    """
    K, u_min, u_max = len(y), problem.u_min, problem.u_max
    S, q = newton.S, newton.q
    for r in range(row_count):
        q[r] = newton.goal[r]
        for column in range(row_count):
            S[r, column] = 0.0
    for k in range(K):
        weight = max(MIN_WEIGHT, problem.loads.weight[k])
        columns, rows = newton.solved[k], newton.rows[k]
        H = newton.H
        H[:] = 0.0
        for l in range(6):
            H[l, l] = newton.ridge[l]
            columns[0, l] = newton.b[k, l] - newton.ridge[l] * y[k, l]
        for j in range(len(newton.a)):
            u = best_input(product(newton.a, j, y, k), weight, u_min, u_max)
            if u == 0.0:
                continue
            for l in range(6):
                columns[0, l] -= u * newton.a[j, l]
            if u_min < u < u_max:
                for l in range(6):
                    for m in range(l + 1):
                        H[l, m] += newton.a[j, l] * newton.a[j, m] / (2 * weight)
        factor(H, 6)
        for r in range(row_count):
            for l in range(6):
                columns[1 + r, l] = rows[r, l]
        for column in range(1 + row_count):
            solve_factored(H, columns[column], 6)
        for r in range(row_count):
            for l in range(6):
                q[r] += rows[r, l] * columns[0, l]
                for column in range(r + 1):
                    S[r, column] += rows[r, l] * columns[1 + column, l]
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    for r in range(row_count):  # with all g = 0 there is no condition
        S[r, r] += newton.diagonal[r] if r > 2 else 1e-9 * trace if trace > 0.0 else 1.0
    factor(S, row_count)
    solve_factored(S, q, row_count)
    for k in range(K):
        for l in range(6):
            newton.step[k, l] = newton.solved[k, 0, l]
            for r in range(row_count):
                newton.step[k, l] -= q[r] * newton.solved[k, 1 + r, l]

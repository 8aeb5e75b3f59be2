r"""Multipliers whose dual function D falls little across a box.

In a box of half widths rho the bound is about D at the middle less its decrease towards a vertex: with the slopes
g_a = dD / d theta_a it is

.. math:: D(y) - \sum_a \rho_a |g_a(y)|

The best multipliers at the middle have the slopes of the effort itself; others are hardly worse there and flat in
most angles. The expression is maximized by Newton's method with |g| <= (g^2 / m + m) / 2, where m is |g| before the
step (iteratively reweighted least squares). Any multipliers will do for a proof.

| symbol | meaning | shape |
|---|---|---|
| beta_aj | derivative of the wrench of rotor j by angle a, in W | (A, r n, 6) |
| v_a | derivative of the sum of all B_i (`nlp.bounds.branch.box`) by angle a, in W | (A, 3) |
"""

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import ROTORS, BranchProblem
from nlp.bounds.branch.frames import BoxFrames, moment, rotate
from nlp.bounds.branch.multipliers import (
    MIN_WEIGHT,
    NewtonWorkspace,
    best_input,
    copy,
    enforce_condition,
    fill_newton_step,
    product,
)
from nlp.numbers.kinematics import add, cross, row
from topo_search.compiled_code import njit
from topo_search.model.arrays import Array


class Flattening(NamedTuple):
    """Settings of the search."""

    min_slope: float = 0.02
    """Slope under which g^2 replaces |g|, over the target value of D."""
    ridge_share: float = 0.3
    """Factor on the ridge, which stands for the slopes too before this search."""
    max_trials: int = 3
    """Largest number of step sizes in a line search: 1, backtracking, backtracking^2."""
    backtracking: float = 0.4


FLATTENING = Flattening()


class Slopes(NamedTuple):
    """Slopes of D in the angles at the middle of a box."""

    beta: Array
    v: Array
    g: Array
    """Slopes, shape (A,)."""
    trial_g: Array
    """g after the trial step, shape (A,)."""


@njit(cache=True)
def empty_slopes(n: int, A: int) -> Slopes:
    """Return arrays for n modules and A angles."""
    return Slopes(np.zeros((A, ROTORS * n, 6)), np.zeros((A, 3)), np.zeros(A), np.zeros(A))


@njit(cache=True, allocates=False)
def fill(problem: BranchProblem, box: BoxFrames, newton: NewtonWorkspace, slopes: Slopes) -> None:
    """Fill beta and v at the middle of a box; `newton` has the wrenches there."""
    tree, R, middle, axes = problem.tree, box.roots[0], box.middle, box.axes
    slopes.v[:] = 0.0
    for i in range(len(tree.parent)):
        body = rotate(R, moment(middle, i, problem.bodies[i]))
        for level in range(tree.depth[i] + 3):
            a = tree.path[i, level]
            w, c = rotate(R, row(axes.omega, a)), rotate(R, row(axes.c, a))
            velocity = cross(w, add(body, -problem.bodies[i, 0], c))
            for k in range(3):
                slopes.v[a, k] += velocity[k]
            for j in range(ROTORS * i, ROTORS * (i + 1)):
                beta, (fx, fy, fz, tx, ty, tz) = slopes.beta[a, j], newton.a[j]
                x, y, z = tx - c[1] * fz + c[2] * fy, ty - c[2] * fx + c[0] * fz, tz - c[0] * fy + c[1] * fx
                p, q, r = cross(w, (fx, fy, fz))
                beta[0], beta[1], beta[2] = p, q, r
                beta[3] = w[1] * z - w[2] * y + c[1] * r - c[2] * q
                beta[4] = w[2] * x - w[0] * z + c[2] * p - c[0] * r
                beta[5] = w[0] * y - w[1] * x + c[0] * q - c[1] * p


@njit(cache=True, literals=False, allocates=False)
def flatten(
    problem: BranchProblem, newton: NewtonWorkspace, slopes: Slopes, rho: Array, y: Array, steps: int, target: float
) -> None:
    """Improve y in place for a box of half widths rho, until D reaches `target` or after `steps` Newton steps."""
    A, row_count = len(rho), 3 + len(rho)
    for l in range(6):
        newton.ridge[l] *= FLATTENING.ridge_share
    best = _value(problem, newton, slopes, rho, y, slopes.g)
    for _ in range(steps):
        if best > target:
            break
        _fill_slope_gradients(problem, newton, slopes, y)
        for a in range(A):  # lambda_a = (g_a + G_a . step) rho_a / m_a
            newton.diagonal[3 + a] = max(abs(slopes.g[a]), FLATTENING.min_slope * target) / max(rho[a], 1e-12)
            newton.goal[3 + a] = slopes.g[a]
        fill_newton_step(problem, newton, y, row_count)
        step_size, trial_value = 1.0, -math.inf
        for _ in range(FLATTENING.max_trials):
            for k in range(len(y)):
                for l in range(6):
                    newton.trial_y[k, l] = y[k, l] + step_size * newton.step[k, l]
            enforce_condition(problem, newton.trial_y)
            trial_value = _value(problem, newton, slopes, rho, newton.trial_y, slopes.trial_g)
            if trial_value > best:
                break
            step_size *= FLATTENING.backtracking
        if not trial_value > best:
            break
        best = trial_value
        copy(newton.trial_y, y)
        for a in range(A):
            slopes.g[a] = slopes.trial_g[a]


@njit(cache=True, allocates=False)
def _value(
    problem: BranchProblem, newton: NewtonWorkspace, slopes: Slopes, rho: Array, y: Array, g: Array
) -> float:
    """Return the maximized expression, and fill g."""
    tree, u_min, u_max, total = problem.tree, problem.u_min, problem.u_max, 0.0
    g[:] = 0.0
    for k in range(len(y)):
        weight, h, mu = max(MIN_WEIGHT, problem.loads.weight[k]), problem.loads.h[k], y[k, 3:]
        for l in range(6):
            total += (newton.b[k, l] - newton.ridge[l] / 2 * y[k, l]) * y[k, l]
        for a in range(len(rho)):
            v = slopes.v[a]
            g[a] += mu[0] * (v[1] * h[2] - v[2] * h[1])
            g[a] += mu[1] * (v[2] * h[0] - v[0] * h[2]) + mu[2] * (v[0] * h[1] - v[1] * h[0])
        for j in range(len(newton.a)):
            t = product(newton.a, j, y, k)
            u = best_input(t, weight, u_min, u_max)
            if u > 0.0:
                total -= u * (t - weight * u)
                for level in range(tree.depth[j // ROTORS] + 3):
                    a = tree.path[j // ROTORS, level]
                    for l in range(6):
                        g[a] -= u * slopes.beta[a, j, l] * y[k, l]
    for a in range(len(rho)):
        total -= rho[a] * abs(g[a])
    return total


@njit(cache=True, allocates=False)
def _fill_slope_gradients(problem: BranchProblem, newton: NewtonWorkspace, slopes: Slopes, y: Array) -> None:
    """Fill the gradients of all slopes in y."""
    tree, u_min, u_max = problem.tree, problem.u_min, problem.u_max
    for k in range(len(y)):
        weight, h, rows = max(MIN_WEIGHT, problem.loads.weight[k]), problem.loads.h[k], newton.rows[k, 3:]
        for a in range(len(rows)):
            v, row = slopes.v[a], rows[a]
            row[0], row[1], row[2] = 0.0, 0.0, 0.0
            row[3], row[4] = v[1] * h[2] - v[2] * h[1], v[2] * h[0] - v[0] * h[2]
            row[5] = v[0] * h[1] - v[1] * h[0]
        for j in range(len(newton.a)):
            u = best_input(product(newton.a, j, y, k), weight, u_min, u_max)
            if u == 0.0:
                continue
            for level in range(tree.depth[j // ROTORS] + 3):
                a, input_slope = tree.path[j // ROTORS, level], 0.0
                if u_min < u < u_max:
                    for l in range(6):
                        input_slope += slopes.beta[a, j, l] * y[k, l]
                    input_slope /= 2 * weight
                for l in range(6):
                    rows[a, l] -= u * slopes.beta[a, j, l] + input_slope * newton.a[j, l]

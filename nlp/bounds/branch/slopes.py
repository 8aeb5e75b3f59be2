r"""Multipliers that a box is bounded well with, by how D changes across it.

In a box of half widths rho the bound is about D at the middle less what D may fall towards a vertex: with slopes
g_a = dD / d theta_a it is

.. math:: D(y) - \sum_a \rho_a |g_a(y)|

The multipliers that are best at the middle have the slopes of the effort itself; others, hardly worse there, are
flat in most angles. That is what is maximised here, by Newton's method with |g| <= (g^2 / m + m) / 2, m the size of
g before the step (iteratively reweighted). Any multipliers will do for a proof.

| symbol | meaning | shape |
|---|---|---|
| beta_aj | how the wrench of rotor j changes with angle a, in W | (A, 4 n, 6) |
| v_a | how the sum of all B_i does (`nlp.bounds.branch.box`) | (A, 3) |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.frames import Axes, Frames, moment
from nlp.bounds.branch.multipliers import LEAST_WEIGHT, Workspace, best_input, copy, meet, newton_step
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class Flattening(NamedTuple):
    """Settings of the search."""

    even: float = 0.02
    """Least size of a slope, in what is enough: below, g^2 stands for |g|."""
    ridge: float = 0.3
    """Share of the ridge that is left: it stood for the slopes too."""
    halvings: int = 3
    """Number of shares of a step that are tried: 1, shorter, shorter^2."""
    shorter: float = 0.4


FLATTENING = Flattening()


class Slopes(NamedTuple):
    """Slopes of D in the angles at the middle of a box."""

    beta: Array
    v: Array
    g: Array
    """(A,)"""
    tried: Array
    """(A,): g of a step that is tried."""
    w: Array
    """(3,): an axis' direction,"""
    c: Array
    """a point of it,"""
    d: Array
    """and a moment about that."""


@njit(cache=True)
def blank(n: int, A: int) -> Slopes:
    """Return arrays for one box at a time."""
    return Slopes(
        np.zeros((A, 4 * n, 6)), np.zeros((A, 3)), np.zeros(A), np.zeros(A), np.zeros(3), np.zeros(3), np.zeros(3)
    )


@njit(cache=True, allocates=False)
def fill(problem: BranchProblem, R: Array, middle: Frames, axes: Axes, work: Workspace, into: Slopes) -> None:
    """Fill beta and v for a root orientation R and frames, whose wrenches `work` holds."""
    tree, w, c, d = problem.tree, into.w, into.c, into.d
    into.v[:] = 0.0
    for i in range(len(tree.parent)):
        w_i, (mx, my, mz) = problem.bodies[i, 0], moment(middle, i, problem.bodies[i])
        for at in range(tree.depth[i] + 3):
            a = tree.path[i, at]
            for k in range(3):
                w[k] = R[k, 0] * axes.omega[a, 0] + R[k, 1] * axes.omega[a, 1] + R[k, 2] * axes.omega[a, 2]
                c[k] = R[k, 0] * axes.c[a, 0] + R[k, 1] * axes.c[a, 1] + R[k, 2] * axes.c[a, 2]
                d[k] = R[k, 0] * mx + R[k, 1] * my + R[k, 2] * mz - w_i * c[k]
            into.v[a, 0] += w[1] * d[2] - w[2] * d[1]
            into.v[a, 1] += w[2] * d[0] - w[0] * d[2]
            into.v[a, 2] += w[0] * d[1] - w[1] * d[0]
            for j in range(4 * i, 4 * i + 4):
                beta, (fx, fy, fz, tx, ty, tz) = into.beta[a, j], work.a[j]
                x, y, z = tx - c[1] * fz + c[2] * fy, ty - c[2] * fx + c[0] * fz, tz - c[0] * fy + c[1] * fx
                p, q, r = w[1] * fz - w[2] * fy, w[2] * fx - w[0] * fz, w[0] * fy - w[1] * fx
                beta[0], beta[1], beta[2] = p, q, r
                beta[3] = w[1] * z - w[2] * y + c[1] * r - c[2] * q
                beta[4] = w[2] * x - w[0] * z + c[2] * p - c[0] * r
                beta[5] = w[0] * y - w[1] * x + c[0] * q - c[1] * p


@njit(cache=True, literals=False, allocates=False)
def flatten(
    problem: BranchProblem, work: Workspace, slopes: Slopes, rho: Array, y: Array, steps: int, enough: float
) -> None:
    """Improve multipliers of a box of half widths rho in place, by so many steps at most, until D is enough."""
    A, tied = len(rho), 3 + len(rho)
    for l in range(6):
        work.ridge[l] *= FLATTENING.ridge
    best = _value(problem, work, slopes, rho, y, slopes.g)
    for _ in range(steps):
        if best > enough:
            break
        _gradients(problem, work, slopes, y)
        for a in range(A):  # lambda_a = (g_a + G_a . step) rho_a / m_a
            work.diagonal[3 + a] = max(abs(slopes.g[a]), FLATTENING.even * enough) / max(rho[a], 1e-12)
            work.goal[3 + a] = slopes.g[a]
        newton_step(problem, work, y, tied)
        share, reached = 1.0, -math.inf
        for _ in range(FLATTENING.halvings):
            for k in range(len(y)):
                for l in range(6):
                    work.trial[k, l] = y[k, l] + share * work.step[k, l]
            meet(problem, work.trial)
            reached = _value(problem, work, slopes, rho, work.trial, slopes.tried)
            if reached > best:
                break
            share *= FLATTENING.shorter
        if not reached > best:
            break
        best = reached
        copy(work.trial, y)
        for a in range(A):
            slopes.g[a] = slopes.tried[a]


@njit(cache=True, allocates=False)
def _value(problem: BranchProblem, work: Workspace, slopes: Slopes, rho: Array, y: Array, g: Array) -> float:
    """Return what is maximised, and fill g."""
    tree, u_min, u_max, total = problem.tree, problem.u_min, problem.u_max, 0.0
    g[:] = 0.0
    for k in range(len(y)):
        weight, h, mu = max(LEAST_WEIGHT, problem.loads.weight[k]), problem.loads.h[k], y[k, 3:]
        for l in range(6):
            total += (work.b[k, l] - work.ridge[l] / 2 * y[k, l]) * y[k, l]
        for a in range(len(rho)):
            v = slopes.v[a]
            g[a] += mu[0] * (v[1] * h[2] - v[2] * h[1])
            g[a] += mu[1] * (v[2] * h[0] - v[0] * h[2]) + mu[2] * (v[0] * h[1] - v[1] * h[0])
        for j in range(len(work.a)):
            t = 0.0
            for l in range(6):
                t += work.a[j, l] * y[k, l]
            u = best_input(t, weight, u_min, u_max)
            if u > 0.0:
                total -= u * (t - weight * u)
                for at in range(tree.depth[j // 4] + 3):
                    a = tree.path[j // 4, at]
                    for l in range(6):
                        g[a] -= u * slopes.beta[a, j, l] * y[k, l]
    for a in range(len(rho)):
        total -= rho[a] * abs(g[a])
    return total


@njit(cache=True, allocates=False)
def _gradients(problem: BranchProblem, work: Workspace, slopes: Slopes, y: Array) -> None:
    """Fill the gradients of all slopes in y."""
    tree, u_min, u_max = problem.tree, problem.u_min, problem.u_max
    for k in range(len(y)):
        weight, h, rows = max(LEAST_WEIGHT, problem.loads.weight[k]), problem.loads.h[k], work.rows[k, 3:]
        for a in range(len(rows)):
            v, row = slopes.v[a], rows[a]
            row[0], row[1], row[2] = 0.0, 0.0, 0.0
            row[3], row[4] = v[1] * h[2] - v[2] * h[1], v[2] * h[0] - v[0] * h[2]
            row[5] = v[0] * h[1] - v[1] * h[0]
        for j in range(len(work.a)):
            t = 0.0
            for l in range(6):
                t += work.a[j, l] * y[k, l]
            u = best_input(t, weight, u_min, u_max)
            if u == 0.0:
                continue
            for at in range(tree.depth[j // 4] + 3):
                a, changed = tree.path[j // 4, at], 0.0
                if u_min < u < u_max:
                    for l in range(6):
                        changed += slopes.beta[a, j, l] * y[k, l]
                    changed /= 2 * weight
                for l in range(6):
                    rows[a, l] -= u * slopes.beta[a, j, l] + changed * work.a[j, l]

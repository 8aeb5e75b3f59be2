"""The dual function D at all vertices of a box, smoothed, with the arrays of its search (`worst_vertex`)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp.bounds.branch.arrays import BranchProblem, Indices
from nlp.bounds.branch.frames import Frames, moment
from nlp.bounds.branch.multipliers import LEAST_WEIGHT, best_input
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

MOST_VERTICES = 32
"""Largest number of vertices that count in a step."""


class Vertices(NamedTuple):
    """Arrays for one search."""

    module: Indices
    """Whose frame it is, shape (frames,)."""
    frame: Indices
    """Every module's frame at every vertex of the hinges, shape (C, n)."""
    a: Array
    """Wrenches of a module's rotors in W, shape (8, frames, 4, 6)."""
    moment: Array
    """Moment of its body, shape (8, frames, 3)."""
    wall: Array
    """n_r . e_r of its own rows, 0 of others, shape (8, frames, W)."""
    t: Array
    """a_j . y_k, shape (8, frames, K, 4)."""
    added: Array
    """Contribution of a module to D, shape (8, frames)."""
    kinked: Array
    """Contribution of the kinks' width to that, shape (8, frames)."""
    D: Array
    """D of all vertices, shape (8 C,)."""
    share: Array
    """e^(-D_v / T), but for a factor; 0 once `order` has the vertex: (8 C,)."""
    order: Indices
    """Vertices that count in a step, shape (most,)."""
    of_frame: Array
    """Sum of w_v of a frame, shape (8, frames)."""
    part: Array
    """Contribution of a module to a gradient, shape (8, frames, K, 6)."""
    H: Array
    rows: Array
    """The condition's three, then the vertices', shape (3 + most, K, 6)."""
    wall_rows: Array
    solved: Array
    """H_k^-1 of the rows."""
    S: Array
    """Compliance of all rows."""
    q: Array
    """Multipliers of the rows, before that w_v."""
    mean: Array
    """Gradient of F, shape (K, 6)."""
    wall_mean: Array
    ridge: Array
    """r, shape (K, 6)."""
    on: NDArray[np.bool_]
    """True if a load case or corner counts, shape (K,)."""
    y: Array
    """Multipliers that meet the condition, shape (K, 6)."""
    sigma: Array
    step: Array
    """Step of y, shape (K, 6)."""
    wall_step: Array
    """Step of sigma, shape (W,)."""
    ahead: Array
    """y after a share of the step."""
    wall_ahead: Array


@njit(cache=True)
def blank_vertices(problem: BranchProblem) -> Vertices:
    """Return arrays for one box at a time."""
    tree, K, W = problem.tree, len(problem.loads.f), len(problem.walls.normal)
    n, count = len(tree.parent), tree.first[-1]
    module, frame = np.zeros(count, np.int64), np.zeros((2 ** (n - 1), n), np.int64)
    for i in range(1, n):
        h = tree.parent[i]
        module[tree.first[i] : tree.first[i + 1]] = i
        for c in range(len(frame)):
            frame[c, i] = tree.first[i] + 2 * (frame[c, h] - tree.first[h]) + (c >> (i - 1) & 1)
    most = MOST_VERTICES
    return Vertices(
        module,
        frame,
        np.zeros((8, count, 4, 6)),
        np.zeros((8, count, 3)),
        np.zeros((8, count, W)),
        np.zeros((8, count, K, 4)),
        np.zeros((8, count)),
        np.zeros((8, count)),
        np.zeros(8 * len(frame)),
        np.zeros(8 * len(frame)),
        np.zeros(most, np.int64),
        np.zeros((8, count)),
        np.zeros((8, count, K, 6)),
        np.zeros((K, 6, 6)),
        np.zeros((3 + most, K, 6)),
        np.zeros((3 + most, W)),
        np.zeros((3 + most, K, 6)),
        np.zeros((3 + most, 3 + most)),
        np.zeros(3 + most),
        np.zeros((K, 6)),
        np.zeros(W),
        np.zeros((K, 6)),
        np.zeros(K, np.bool_),
        np.zeros((K, 6)),
        np.zeros(W),
        np.zeros((K, 6)),
        np.zeros(W),
        np.zeros((K, 6)),
        np.zeros(W),
    )


@njit(cache=True, allocates=False)
def _rotate(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@njit(cache=True, allocates=False)
def fill_frames(problem: BranchProblem, roots: Array, vertices: Frames, into: Vertices) -> None:
    """Fill the wrenches, moments and ends of all frames."""
    walls = problem.walls
    for root in range(8):
        R = roots[1 + root]
        for v in range(len(into.module)):
            i, a = into.module[v], into.a[root, v]
            px, py, pz = _rotate(R, vertices.p[v, 0], vertices.p[v, 1], vertices.p[v, 2])
            zx, zy, zz = _rotate(R, vertices.z[v, 0], vertices.z[v, 1], vertices.z[v, 2])
            xx, xy, xz = _rotate(R, vertices.x[v, 0], vertices.x[v, 1], vertices.x[v, 2])
            yx, yy, yz = _rotate(R, vertices.y[v, 0], vertices.y[v, 1], vertices.y[v, 2])
            for q in range(4):
                x, y, z = problem.torques[q]
                a[q, 0], a[q, 1], a[q, 2] = zx / 4, zy / 4, zz / 4
                a[q, 3] = (py * zz - pz * zy + x * xx + y * yx + z * zx) / 4
                a[q, 4] = (pz * zx - px * zz + x * xy + y * yy + z * zy) / 4
                a[q, 5] = (px * zy - py * zx + x * xz + y * yz + z * zz) / 4
            mx, my, mz = moment(vertices, v, problem.bodies[i])
            cx, cy, cz = _rotate(R, mx, my, mz)
            into.moment[root, v, 0], into.moment[root, v, 1], into.moment[root, v, 2] = cx, cy, cz
            for r in range(len(walls.beyond)):
                if walls.module[r] == i:
                    down = walls.end[r] * walls.length
                    into.wall[root, v, r] = (
                        walls.normal[r, 0] * (px - down * zx)
                        + walls.normal[r, 1] * (py - down * zy)
                        + walls.normal[r, 2] * (pz - down * zz)
                    )


@njit(cache=True, allocates=False)
def value(
    problem: BranchProblem, into: Vertices, y: Array, sigma: Array, T: float, m: float, s: float
) -> tuple[float, float, float]:
    """Return F, the least D and the mean of all by their shares, and fill D and what it is computed from."""
    loads, walls, n = problem.loads, problem.walls, len(problem.tree.parent)
    u_min, u_max = problem.u_min, problem.u_max
    constant, sx, sy, sz, barrier = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(y)):
        if into.on[k]:
            for l in range(3):
                constant += loads.f[k, l] * y[k, l] + loads.t[k, l] * y[k, 3 + l]
            for l in range(6):
                constant -= into.ridge[k, l] / 2 * y[k, l] ** 2
            hx, hy, hz = loads.h[k]
            mx, my, mz = y[k, 3], y[k, 4], y[k, 5]
            sx, sy, sz = sx + hy * mz - hz * my, sy + hz * mx - hx * mz, sz + hx * my - hy * mx
    for r in range(len(sigma)):
        constant += sigma[r] * walls.beyond[r]
        barrier += m * math.log(sigma[r])
    for root in range(8):
        for v in range(len(into.module)):
            a, at = into.a[root, v], into.moment[root, v]
            a0, a1, a2 = a[0, 0], a[0, 1], a[0, 2]
            total, more = at[0] * sx + at[1] * sy + at[2] * sz, 0.0
            for r in range(len(sigma)):
                total += into.wall[root, v, r] * sigma[r]
            for k in range(len(y)):
                if not into.on[k]:
                    continue
                weight, force = loads.weight[k], a0 * y[k, 0] + a1 * y[k, 1] + a2 * y[k, 2]
                dead = loads.dead[k] - 4 * into.module[v]
                for q in range(4):
                    t = force + a[q, 3] * y[k, 3] + a[q, 4] * y[k, 4] + a[q, 5] * y[k, 5]
                    into.t[root, v, k, q] = t
                    if q == dead:
                        continue
                    if weight == 0.0:
                        short = (u_max - u_min) / 2 * (math.sqrt(t * t + s * s) - s - abs(t))
                        psi = best_input(t, 0.0, u_min, u_max) * t
                        total -= psi + short
                        more -= short
                    else:
                        counted = max(weight, LEAST_WEIGHT)
                        u = best_input(t, counted, u_min, u_max)
                        total -= u * (t - counted * u)
            into.added[root, v], into.kinked[root, v] = total, more
    C, least, worst, total, mean = len(into.frame), math.inf, math.inf, 0.0, 0.0
    for vertex in range(8 * C):
        D, more = constant, 0.0
        for i in range(n):
            D += into.added[vertex // C, into.frame[vertex % C, i]]
            more += into.kinked[vertex // C, into.frame[vertex % C, i]]
        into.D[vertex] = D
        least = min(least, D)
        worst = min(worst, D - more)
    for vertex in range(8 * C):
        share = math.exp((least - into.D[vertex]) / T)
        into.share[vertex] = share
        total += share
        mean += share * into.D[vertex]
    return least - T * math.log(total) + barrier, worst, mean / total

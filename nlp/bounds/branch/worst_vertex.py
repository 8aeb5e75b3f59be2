r"""Good multipliers for a box with corners of reserves or walls: those whose D is greatest at its worst vertex.

Where a reserve cannot be produced, multipliers at the middle of a box grow until D exceeds any cut there, and D
falls the more steeply towards the vertices. So what is maximised is D at all vertices v of the box at once,

.. math::

    F(y, \sigma) = -T \log \sum_v e^{-D_v(y, \sigma) / T} + m \sum_r \log \sigma_r
        - \frac{1}{2} \sum_{k,l} r_l y_{kl}^2

under the condition that p'_E drops out, by damped Newton steps while T, m and the width s of a kink fall: psi of a
corner, U max(t, 0), counts as U (t + sqrt(t^2 + s^2) - s) / 2, which is less, so that what stays under the cut is
beyond help. Nothing that is proven rests on it: any multipliers will do.

D_v is a sum over the modules, each in one of its frames at one of the 8 vertices of the root.

| symbol | meaning | shape |
|---|---|---|
| w_v | share of vertex v in the gradient, e^(-D_v / T) over the sum of all | (8 C,) |
| G_v | gradient of D_v; a row is sqrt(w_v / T) (G_v - sum_v w_v G_v) | (K, 6), (W,) |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import BranchProblem, Indices
from nlp.bounds.branch.frames import Frames, moment
from nlp.bounds.branch.multipliers import LEAST_WEIGHT, Workspace, imbalance
from nlp.numbers.cholesky import factor, solve_factored, solve_in_place
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class VertexSearch(NamedTuple):
    """Settings of the search."""

    stages: int = 5
    """Number of times that T, m and s fall."""
    steps: int = 3
    """Largest number of Newton steps per stage."""
    halvings: int = 6
    """Number of shares of a step that are tried: 1, shorter, shorter^2, ..."""
    shorter: float = 0.3
    gain: float = 1e-3
    """Share of the cut that another step should gain."""
    boundary: float = 0.95
    """Share of the way to sigma = 0 that a step goes."""
    soft: float = 0.05
    """T in the first stage, in the cut."""
    softer: float = 0.6
    """T in the next stage, in that of this one."""
    kink: float = 0.15
    """s in the first stage, in the cut over 4 n U."""
    kinked: float = 0.35
    """s and m in the next stage, in those of this one."""
    pressed: float = 2e-3
    """m and sigma in the first stage, in the cut."""
    hopeless: float = 0.98
    """Share of the cut below which the worst vertex ends the search."""
    enough: float = 1.1
    """Share of the cut above which it does."""
    light: float = 1e-3
    """Least w_v that counts in a step."""
    most: int = 32
    """Largest number of vertices that count in a step."""
    ridge: float = 0.02
    """Ridge of multipliers of force, over n / 24 sum_a rho_a^2: the remainders of the bound grow with them."""
    kinked_ridge: float = 10.0
    """Ridge of corners over the root of sum_a rho_a^2, in `ridge`: their psi has a kink."""
    largest_ridge: float = 100.0
    """Least factor of the ridge of corners."""
    levered: float = 10.0
    """Ridge of multipliers of torque, in that of force: levers are longer than l_arm."""
    least_square: float = 1e-6
    """Least sum_a rho_a^2 in a ridge [rad^2]."""
    idle: float = 1e-3
    """Largest |a_j . y_k| of a corner that costs nothing, over 2 U."""
    cannot: float = 1e-9
    """Share of the walls' multipliers that the condition may miss by rounding."""


SEARCH = VertexSearch()


class Vertices(NamedTuple):
    """Arrays for one search."""

    module: Indices
    """Whose frame it is, shape (frames,)."""
    frame: Indices
    """Every module's frame at every vertex of the hinges, shape (C, n)."""
    a: Array
    """Wrenches of a module's rotors in the root's frame, shape (frames, 4, 6)."""
    moment: Array
    """Moment of its body, shape (frames, 3)."""
    seen: Array
    """y in the root's frame at the root's vertices, shape (8, K, 6)."""
    added: Array
    """What a module adds to D, shape (8, frames)."""
    D: Array
    """D of all vertices, shape (8 C,)."""
    ridge: Array
    """r, shape (K, 6)."""
    y: Array
    """Multipliers that meet the condition, shape (K, 6)."""
    sigma: Array
    step: Array
    """Step of y, shape (K, 6)."""
    wall_step: Array
    """Step of sigma, shape (W,)."""


@njit(cache=True)
def blank(problem: BranchProblem) -> Vertices:
    """Return arrays for one box at a time."""
    tree, K, W = problem.tree, len(problem.loads.f), len(problem.walls.normal)
    n, count = len(tree.parent), tree.first[-1]
    module, frame = np.zeros(count, np.int64), np.zeros((2 ** (n - 1), n), np.int64)
    for i in range(1, n):
        h = tree.parent[i]
        module[tree.first[i] : tree.first[i + 1]] = i
        for c in range(len(frame)):
            frame[c, i] = tree.first[i] + 2 * (frame[c, h] - tree.first[h]) + (c >> (i - 1) & 1)
    return Vertices(
        module,
        frame,
        np.zeros((count, 4, 6)),
        np.zeros((count, 3)),
        np.zeros((8, K, 6)),
        np.zeros((8, count)),
        np.zeros(8 * len(frame)),
        np.zeros((K, 6)),
        np.zeros((K, 6)),
        np.zeros(W),
        np.zeros((K, 6)),
        np.zeros(W),
    )


@njit(cache=True)
def search_from_start(
    problem: BranchProblem,
    roots: Array,
    vertices: Frames,
    rho: Array,
    cut: float,
    first: Array,
    work: Workspace,
    into: Vertices,
) -> None:
    """Fill `into.y` and `into.sigma` with good multipliers that meet the condition.

    Args:
        problem: the task and the tree.
        roots: root orientations at the middle and at the 8 vertices, shape (9, 3, 3).
        vertices: frames at the vertices of the hinges.
        rho: half widths [rad].
        cut: in effort units.
        first: multipliers that the search starts at, shape (K, 6).
        work: with the wrenches of the box's middle.
        into: arrays.
    """
    n = len(problem.tree.parent)
    _fill_frames(problem, vertices, rho, into)
    y, sigma = into.y, into.sigma
    y[:], sigma[:] = first, SEARCH.pressed * cut
    # The condition holds from the start: steps that a barrier shortens keep it.
    _correct(problem, problem.loads.project, y, sigma, True)
    T, m, s = SEARCH.soft * cut, SEARCH.pressed * cut, SEARCH.kink * cut / (4 * n * problem.u_max)
    for _ in range(SEARCH.stages):
        best, least = _value(problem, roots, vertices, into, y, sigma, T, m, s)
        for _ in range(SEARCH.steps):
            _newton(problem, roots, vertices, work, into, T, m, s)
            share, better = 1.0, False
            for r in range(len(sigma)):
                if into.wall_step[r] < 0.0:
                    share = min(share, -SEARCH.boundary * sigma[r] / into.wall_step[r])
            for _ in range(SEARCH.halvings):
                ahead, pressed = y + share * into.step, sigma + share * into.wall_step
                reached, worst = _value(problem, roots, vertices, into, ahead, pressed, T, m, s)
                better = reached > best
                if better:
                    break
                share *= SEARCH.shorter
            if not better:
                break
            y[:], sigma[:] = ahead, pressed
            gain, best, least = reached - best, reached, worst
            if least > SEARCH.enough * cut:  # psi counts as less than it is
                if _value(problem, roots, vertices, into, y, sigma, T, m, 0.0)[1] > SEARCH.enough * cut:
                    _finish(problem, work, into)
                    return
                _value(problem, roots, vertices, into, y, sigma, T, m, s)
            if gain < SEARCH.gain * cut:
                break
        if least < SEARCH.hopeless * cut:
            break
        T, m, s = SEARCH.softer * T, SEARCH.kinked * m, SEARCH.kinked * s
    _finish(problem, work, into)


@njit(cache=True)
def _fill_frames(problem: BranchProblem, vertices: Frames, rho: Array, into: Vertices) -> None:
    """Fill the wrenches and moments of all frames, and the ridges."""
    for v in range(len(into.module)):
        (px, py, pz), (zx, zy, zz) = vertices.p[v], vertices.z[v]
        about = (py * zz - pz * zy, pz * zx - px * zz, px * zy - py * zx)
        for q in range(4):
            x, y, z = problem.torques[q]
            for l in range(3):
                into.a[v, q, l] = vertices.z[v, l] / 4
                torque = x * vertices.x[v, l] + y * vertices.y[v, l] + z * vertices.z[v, l]
                into.a[v, q, 3 + l] = (about[l] + torque) / 4
        into.moment[v] = moment(vertices, v, problem.bodies[into.module[v]])
    square = max((rho**2).sum(), SEARCH.least_square)
    ridge = SEARCH.ridge * len(problem.tree.parent) / 24 * square
    for k in range(len(into.ridge)):
        into.ridge[k, :3] = ridge
        if problem.loads.weight[k] == 0.0:
            into.ridge[k, :3] = ridge * max(SEARCH.kinked_ridge / math.sqrt(square), SEARCH.largest_ridge)
        into.ridge[k, 3:] = SEARCH.levered * into.ridge[k, 0]


@njit(cache=True)
def _value(
    problem: BranchProblem,
    roots: Array,
    vertices: Frames,
    into: Vertices,
    y: Array,
    sigma: Array,
    T: float,
    m: float,
    s: float,
) -> tuple[float, float]:
    """Return F and the least D, and fill D and what it is computed from."""
    loads, walls, U, n = problem.loads, problem.walls, problem.u_max, len(problem.tree.parent)
    constant, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
    for k in range(len(y)):
        for l in range(3):
            constant += loads.f[k, l] * y[k, l] + loads.t[k, l] * y[k, 3 + l]
        for l in range(6):
            constant -= into.ridge[k, l] / 2 * y[k, l] ** 2
        (hx, hy, hz), mx, my, mz = loads.h[k], y[k, 3], y[k, 4], y[k, 5]
        sx, sy, sz = sx + hy * mz - hz * my, sy + hz * mx - hx * mz, sz + hx * my - hy * mx
    barrier = 0.0
    for r in range(len(sigma)):
        constant += sigma[r] * walls.beyond[r]
        barrier += m * math.log(sigma[r])
    pressed, summed = np.zeros((n, 2, 3)), np.array([sx, sy, sz])
    for root in range(8):
        R, seen = roots[1 + root], into.seen[root]
        for k in range(len(y)):
            for l in range(3):
                seen[k, l] = R[0, l] * y[k, 0] + R[1, l] * y[k, 1] + R[2, l] * y[k, 2]
                seen[k, 3 + l] = R[0, l] * y[k, 3] + R[1, l] * y[k, 4] + R[2, l] * y[k, 5]
        pressed[:] = 0.0
        for r in range(len(sigma)):
            x, y_, z = sigma[r] * walls.normal[r]
            for l in range(3):
                pressed[walls.module[r], walls.end[r], l] += R[0, l] * x + R[1, l] * y_ + R[2, l] * z
        lever = summed @ R
        for v in range(len(into.module)):
            i, total = into.module[v], 0.0
            for l in range(3):
                total += into.moment[v, l] * lever[l] + vertices.p[v, l] * pressed[i, 0, l]
                total += (vertices.p[v, l] - walls.length * vertices.z[v, l]) * pressed[i, 1, l]
            for k in range(len(y)):
                weight = loads.weight[k]
                y0, y1, y2, y3, y4, y5 = seen[k]
                for q in range(4):
                    a = into.a[v, q]
                    t = a[0] * y0 + a[1] * y1 + a[2] * y2 + a[3] * y3 + a[4] * y4 + a[5] * y5
                    if weight == 0.0:
                        total -= U / 2 * (t + math.sqrt(t * t + s * s) - s)
                    elif t > 0.0:
                        weight = max(weight, LEAST_WEIGHT)
                        u = min(U, t / (2 * weight))
                        total -= u * (t - weight * u)
            into.added[root, v] = total
    C, worst, total = len(into.frame), math.inf, 0.0
    for vertex in range(8 * C):
        D = constant
        for i in range(n):
            D += into.added[vertex // C, into.frame[vertex % C, i]]
        into.D[vertex] = D
        worst = min(worst, D)
    for D in into.D:
        total += math.exp((worst - D) / T)
    return worst - T * math.log(total) + barrier, worst


@njit(cache=True)
def _newton(
    problem: BranchProblem,
    roots: Array,
    vertices: Frames,
    work: Workspace,
    into: Vertices,
    T: float,
    m: float,
    s: float,
) -> None:
    """Fill the step from y and sigma, of which `_value` has filled D, to the maximum of a quadratic model of F."""
    walls, y, sigma, K, C = problem.walls, into.y, into.sigma, len(into.y), len(into.frame)
    share = np.exp((into.D.min() - into.D) / T)
    order = np.argsort(-share)[: SEARCH.most]
    order = order[share[order] > SEARCH.light * share.sum()]
    share = share[order] / share[order].sum()
    V = len(order)
    slot, of_frame, count = np.full((8, len(into.module)), -1), np.zeros((8, len(into.module))), 0
    for vertex in range(V):
        for v in into.frame[order[vertex] % C]:
            root = order[vertex] // C
            of_frame[root, v] += share[vertex]
            if slot[root, v] < 0:
                slot[root, v] = count
                count += 1
    part, wall_part, H = np.zeros((count, K, 6)), np.zeros((count, len(sigma))), np.zeros((K, 6, 6))
    for root in range(8):
        for v in range(len(into.module)):
            if slot[root, v] >= 0:
                _add_frame(problem, roots[1 + root], root, v, into, of_frame[root, v], s, part[slot[root, v]], H)
                for r in range(len(sigma)):
                    if walls.module[r] == into.module[v]:
                        e = vertices.p[v] - walls.end[r] * walls.length * vertices.z[v]
                        wall_part[slot[root, v], r] = ((walls.normal[r] @ roots[1 + root]) * e).sum()
    rows, wall_rows = np.zeros((3 + V, K, 6)), np.zeros((3 + V, len(sigma)))
    mean, wall_mean = np.zeros((K, 6)), np.zeros(len(sigma))
    for vertex in range(V):
        for v in into.frame[order[vertex] % C]:
            rows[3 + vertex] += part[slot[order[vertex] // C, v]]
            wall_rows[3 + vertex] += wall_part[slot[order[vertex] // C, v]]
        mean += share[vertex] * rows[3 + vertex]
        wall_mean += share[vertex] * wall_rows[3 + vertex]
    for vertex in range(V):
        scale = math.sqrt(share[vertex] / T)
        rows[3 + vertex] = scale * (rows[3 + vertex] - mean)
        wall_rows[3 + vertex] = scale * (wall_rows[3 + vertex] - wall_mean)
    for k in range(K):
        rows[:3, k] = work.rows[k, :3]
        mean[k, :3] += problem.loads.f[k]
        mean[k, 3:] += problem.loads.t[k]
    for r in range(len(sigma)):
        wall_rows[:3, r] = -walls.normal[r]
    mean -= into.ridge * y
    wall_mean += walls.beyond + m / sigma
    _solve(y, sigma, H, rows, wall_rows, mean, wall_mean, m, into)


@njit(cache=True)
def _add_frame(
    problem: BranchProblem,
    R: Array,
    root: int,
    v: int,
    into: Vertices,
    share: float,
    s: float,
    part: Array,
    H: Array,
) -> None:
    """Fill what a module in one of its frames adds to a gradient, and add its share to minus the Hessian."""
    U, gradient, a = problem.u_max, np.zeros(6), np.zeros(6)
    cx, cy, cz = R @ into.moment[v]
    for k in range(len(part)):
        weight = problem.loads.weight[k]
        y0, y1, y2, y3, y4, y5 = into.seen[root, k]
        gradient[:] = 0.0
        for q in range(4):
            b = into.a[v, q]
            t = b[0] * y0 + b[1] * y1 + b[2] * y2 + b[3] * y3 + b[4] * y4 + b[5] * y5
            if weight == 0.0:
                length = math.sqrt(t * t + s * s)
                u, stiff = U / 2 * (1 + t / length), U / 2 * s * s / length**3
            else:
                weight = max(weight, LEAST_WEIGHT)
                u = max(0.0, min(U, t / (2 * weight)))
                stiff = 1 / (2 * weight) if 0.0 < u < U else 0.0
            for l in range(6):
                gradient[l] -= u * b[l]
            if stiff > 0.0:
                for l in range(3):
                    a[l] = R[l, 0] * b[0] + R[l, 1] * b[1] + R[l, 2] * b[2]
                    a[3 + l] = R[l, 0] * b[3] + R[l, 1] * b[4] + R[l, 2] * b[5]
                for l in range(6):
                    for column in range(l + 1):
                        H[k, l, column] += share * stiff * a[l] * a[column]
        for l in range(3):
            part[k, l] = R[l, 0] * gradient[0] + R[l, 1] * gradient[1] + R[l, 2] * gradient[2]
            part[k, 3 + l] = R[l, 0] * gradient[3] + R[l, 1] * gradient[4] + R[l, 2] * gradient[5]
        hx, hy, hz = problem.loads.h[k]
        part[k, 3] += cy * hz - cz * hy
        part[k, 4] += cz * hx - cx * hz
        part[k, 5] += cx * hy - cy * hx


@njit(cache=True)
def _solve(
    y: Array,
    sigma: Array,
    H: Array,
    rows: Array,
    wall_rows: Array,
    gradient: Array,
    wall_gradient: Array,
    m: float,
    into: Vertices,
) -> None:
    """Fill the step: the first three rows, the condition, are met, the others take half their square."""
    tied, K, step, wall_step = len(rows), len(y), into.step, into.wall_step
    S, q, solved = np.zeros((tied, tied)), np.zeros(tied), rows.copy()
    step[:] = gradient
    for k in range(K):
        for l in range(6):
            H[k, l, l] += into.ridge[k, l]
        factor(H[k], 6)
        solve_factored(H[k], step[k], 6)
        for row in range(tied):
            solve_factored(H[k], solved[row, k], 6)
    for r in range(len(sigma)):
        wall_step[r] = wall_gradient[r] * sigma[r] ** 2 / m
    for row in range(tied):
        q[row] = (rows[row] * step).sum() + (wall_rows[row] * wall_step).sum()
        if row < 3:
            q[row] += (rows[row] * y).sum() + (wall_rows[row] * sigma).sum()
        for column in range(row + 1):
            total = 0.0
            for k in range(K):
                for l in range(6):
                    total += rows[row, k, l] * solved[column, k, l]
            for r in range(len(sigma)):
                total += wall_rows[row, r] * wall_rows[column, r] * sigma[r] ** 2 / m
            S[row, column] = total
    size = S[0, 0] + S[1, 1] + S[2, 2]
    for row in range(tied):  # without g there is no condition
        S[row, row] += 1.0 if row > 2 or size == 0.0 else 1e-9 * size
    solve_in_place(S, q)
    for row in range(tied):
        step -= q[row] * solved[row]
        for r in range(len(sigma)):
            wall_step[r] -= q[row] * wall_rows[row, r] * sigma[r] ** 2 / m


@njit(cache=True)
def meet(problem: BranchProblem, project: Array, y: Array, sigma: Array) -> None:
    """Meet the condition by the least change of torques' multipliers that are not zero, or else without walls."""
    _correct(problem, project, y, sigma, False)
    a, b, c = imbalance(problem, y, sigma)
    if not math.sqrt(a * a + b * b + c * c) <= SEARCH.cannot * sigma.sum():
        sigma[:] = 0.0
        _correct(problem, project, y, sigma, False)


@njit(cache=True)
def _correct(problem: BranchProblem, project: Array, y: Array, sigma: Array, every: bool) -> None:
    q = project @ np.array(imbalance(problem, y, sigma))
    for k in range(len(y)):  # mu_k -= [g_k]x^T q = q x g_k
        if every or np.any(y[k] != 0.0):
            y[k, 3:] -= np.cross(q, problem.loads.g[k])


@njit(cache=True)
def _finish(problem: BranchProblem, work: Workspace, into: Vertices) -> None:
    """Meet the condition, without multipliers of corners that cost nothing: each loses something to rounding."""
    y, crosses = into.y, np.zeros((3, 3))
    for k in range(len(y)):
        if problem.loads.weight[k] == 0.0 and np.abs(work.a @ y[k]).max() < SEARCH.idle * 2 * problem.u_max:
            y[k] = 0.0
        else:
            rows = work.rows[k, :3, 3:].copy()
            crosses += rows @ rows.T
    meet(problem, np.asarray(np.linalg.pinv(crosses, 1e-9), np.float64), y, into.sigma)

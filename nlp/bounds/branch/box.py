r"""A lower bound on the effort of every design whose angles lie in a box.

**Duality.** For any multipliers y_k = (nu_k, mu_k) of force and torque and any design of angles theta

.. math::

    J \ge \sum_k y_k \cdot b_k(\theta) - \sum_{j,k} \psi_k(a_j(\theta) \cdot y_k)
    + \sum_r \sigma_r (n_r \cdot e_r(\theta) + d_r) =: D(\theta; y, \sigma), \qquad
    \psi_k(t) = \max_{0 \le u \le U} t u - \lambda_k u^2

with sigma_r >= 0 of the rows of walls, n_r . (e_r - p'_E) + d_r <= 0, e_r an end of an envelope. The balance of
load case k has p'_E x g_k in its torque; p'_E cancels in the sum where sum_k g_k x mu_k = sum_r sigma_r n_r, so
that no box for it is needed. b_k . y_k is const + sum_i B_i . s with s = sum_k h_k x mu_k and B_i the moment of
module i and its joints, p_i where joints weigh nothing. A corner of a reserve is a load case with lambda_k = 0,
whose psi is U max(t, 0); one with y_k = 0 adds nothing.

**Interpolation.** In every single angle a, the others held, t = a_j . y_k is A + alpha cos x + beta sin x, x
from the middle of the box and |x| <= rho. It exceeds the line through its values at x = -rho and rho by
alpha (cos x - cos rho) + beta (sin x - x sin rho / rho)
<= max(0, alpha) (1 - cos rho) + |beta| rho^3 / (9 sqrt 3): sin x - x sin rho / rho is the integral of Green's
function of the interval with sin s <= s, and (x rho^2 - x^3) / 6 is greatest at x = rho / sqrt 3. One angle
after the other, for interpolation averages: in the whole box t is at most its multilinear interpolant plus
E = sum_a (max(0, alpha_a) (1 - cos rho_a) + |beta_a| rho_a^3 / (9 sqrt 3)), with the largest alpha_a, beta_a
over the other angles. As psi is convex and nondecreasing, psi(t) is at most the interpolant of psi(t(v) + E), so

    D >= const + min over vertices v of sum_i (B_i(v) . s + w_i(v) - E_i - sum_jk psi_k(t_jk(v) + E_jk))

with w_i = sum_r sigma_r n_r . e_r over the two ends of module i, as harmonic as B_i . s.

**Minimum.** What module i adds depends on the root's angles and the hinges on its path alone. So for each of the 8
vertices of the root the minimum over hinges is taken from the leaves of the tree inwards, not over all 2^A
vertices.

**Remainders.** For rotor j of module i, about the axis (omega, c) of angle a with nu' = nu + mu x c, tau its torque
about c: 4 alpha = nu'_# . z + mu_# . tau (# across omega), 4 beta = nu' . omega x z + mu . omega x tau. Both are
known at the middle. One more angle b changes them by rho_b (|nu'_outer| + |mu| (|c_a - c_b| + |tau_inner|)) at
most, the outer and the inner of a and b; and they are never more than |nu'| + |mu| |tau|. Distances are those of
the tree stretched out, and |nu'| is that at the middle plus |mu| times how far c moves.

**Rounding.** Frames are products of at most A + 1 rotations, each of whose entries is off by 4 eps at most (eps =
2^-53: one rounding of each sine, product and sum), so an entry of a frame by under 8 (A + 1) eps, a position by
that times the path's length, and t by under 100 (A + 1) eps (|nu| + |mu| L), L the longest lever. psi' <= U, and
sums of 4 n K + 5 n + 6 K terms are off by that many eps of the sum of their sizes, none of which is above U (|nu| +
|mu| L), sigma L or the sizes of b . y. For A <= 20 and n K <= 10,000 that is under 6e-12 of these in all; `Slack`
takes ROUNDING = 1e-11 of them, beside the audit's tolerance, which is 1e-6 of those of y and alone a hundred
thousand times as large. Ends of boxes are floats, and adjacent boxes share them, so boxes leave no gap. What the
condition on mu and sigma misses costs as much times |p'_E|, which is bounded by what an audit lets pass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.frames import Axes, Frames, moment
from nlp.bounds.branch.multipliers import imbalance
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

CUBIC = 1 / (9 * math.sqrt(3))
"""Largest coefficient of rho^3, see the module's docstring."""
MISSED = 1e-13
"""Rounding error of the condition on mu and sigma, as a share of |g_k| |mu_k| and sigma_r."""


class Sums(NamedTuple):
    """Arrays that evaluating a box needs, and what it leaves in them."""

    E: Array
    """Remainders of one module's rotors, shape (K, 4)."""
    y: Array
    """Multipliers in the root's frame, shape (K, 6)."""
    active: NDArray[np.bool_]
    """Load cases with a weight or multipliers; others add nothing, shape (K,)."""
    walls: Array
    """sum_r sigma_r n_r of both ends of every module, in the root's frame, shape (n, 2, 3)."""
    least: Array
    """Least sums over the modules beyond, for every frame: (frames,)."""
    slope: Array
    """Slope of D at the middle, by angle, shape (A,)."""
    spread: Array
    """Loss of D to remainders, by angle, shape (A,)."""
    away: Array
    """(A,): |nu'| of a load case about every axis."""
    drift: Array
    """(A,): how far the point of every axis moves in the box."""


@njit(cache=True)
def sums(problem: BranchProblem) -> Sums:
    """Return arrays for one box at a time."""
    K, A, count = len(problem.loads.f), len(problem.levers.between), problem.tree.first[-1]
    return Sums(
        np.zeros((K, 4)),
        np.zeros((K, 6)),
        np.zeros(K, np.bool_),
        np.zeros((len(problem.tree.parent), 2, 3)),
        np.zeros(count),
        np.zeros(A),
        np.zeros(A),
        np.zeros(A),
        np.zeros(A),
    )


@njit(cache=True)
def bound(
    problem: BranchProblem,
    y: Array,
    sigma: Array,
    roots: Array,
    middle: Frames,
    axes: Axes,
    vertices: Frames,
    rho: Array,
    work: Sums,
    cut: float,
) -> float:
    """Return the lower bound of a box with multipliers y, in effort units, or if it is under the cut, a value so.

    Args:
        problem: the task and the tree.
        y: multipliers in W.
        sigma: those of the rows of walls, shape (W,).
        roots: root orientations at the middle and at the 8 vertices, shape (9, 3, 3).
        middle: frames at the middle of the box.
        axes: the angles' axes there.
        vertices: frames at the vertices of the hinges.
        rho: half widths [rad].
        work: arrays; its `slope` and `spread` say what a split of each angle might gain.
        cut: once a vertex is under it, no other is looked at.
    """
    n, tree, L = len(problem.tree.parent), problem.tree, problem.walls.length
    weight, U = problem.loads.weight, problem.u_max
    constant = _constant(problem, y, sigma)
    work.slope[:] = 0.0
    work.spread[:] = 0.0
    _drifts(problem, rho, work.drift)
    remainders, least_of = np.zeros((n, len(y), 4)), np.zeros(n)
    for k in range(len(y)):
        work.active[k] = weight[k] > 0.0 or np.any(y[k] != 0.0)
    _turn(roots[0], y, work.active, work.y)
    if len(sigma) > 0:
        _turn_walls(problem, roots[0], sigma, work.walls)
    sx, sy, sz = _lever_force(problem, y)
    s = _into(roots[0], sx, sy, sz)
    for i in range(n):
        _remainders(problem, i, work, middle, axes, rho)
        remainders[i] = work.E
        m, lever = moment(middle, i, problem.bodies[i]), problem.levers.body[i]
        least_of[i] = _remainder_of(problem, i, problem.bodies[i, 0], m, lever, s, axes, rho, work)
        for end in range(2 if len(sigma) > 0 else 0):
            x, y_, z = work.walls[i, end]
            if x * x + y_ * y_ + z * z > 0.0:
                e, lever = middle.p[i] - end * L * middle.z[i], problem.levers.centre[i] + end * L
                at = (e[0], e[1], e[2])
                least_of[i] += _remainder_of(problem, i, 1.0, at, lever, (x, y_, z), axes, rho, work)
    result = math.inf
    for vertex in range(8):
        R = roots[1 + vertex]
        _turn(R, y, work.active, work.y)
        if len(sigma) > 0:
            _turn_walls(problem, R, sigma, work.walls)
        s = _into(R, sx, sy, sz)
        for i in range(n - 1, -1, -1):
            near, far = work.walls[i, 0], work.walls[i, 1]
            for v in range(tree.first[i], tree.first[i + 1]):
                mx, my, mz = moment(vertices, v, problem.bodies[i])
                added = mx * s[0] + my * s[1] + mz * s[2] - least_of[i]
                if len(sigma) > 0:
                    for l in range(3):
                        added += vertices.p[v, l] * near[l] + (vertices.p[v, l] - L * vertices.z[v, l]) * far[l]
                work.least[v] = added - _psi(
                    problem.torques, weight, U, work.y, work.active, vertices, v, remainders[i]
                )
        for i in range(n - 1, 0, -1):
            h = tree.parent[i]
            for v in range(tree.first[h + 1] - tree.first[h]):
                at = tree.first[i] + 2 * v
                work.least[tree.first[h] + v] += min(work.least[at], work.least[at + 1])
        result = min(result, work.least[0])
        if constant + result < cut < math.inf:
            break
    return constant + result


@njit(cache=True)
def _constant(problem: BranchProblem, y: Array, sigma: Array) -> float:
    """Return what of D no angle changes, less what the audit lets pass and rounding take."""
    total, loads, slack = 0.0, problem.loads, problem.slack
    a, b, c = imbalance(problem, y, sigma)
    for r in range(len(sigma)):
        total += sigma[r] * (problem.walls.beyond[r] - slack.wall - slack.tip * MISSED)
    for k in range(len(y)):
        nu2, mu2 = 0.0, 0.0
        for l in range(3):
            total += loads.f[k, l] * y[k, l] + loads.t[k, l] * y[k, 3 + l]
            nu2 += y[k, l] ** 2
            mu2 += y[k, 3 + l] ** 2
        nu, mu = math.sqrt(nu2), math.sqrt(mu2)
        g = math.sqrt(loads.g[k, 0] ** 2 + loads.g[k, 1] ** 2 + loads.g[k, 2] ** 2)
        total -= slack.force[k] * nu + slack.torque[k] * mu + slack.tip * MISSED * g * mu
    return total - slack.tip * math.sqrt(a * a + b * b + c * c)


@njit(cache=True)
def _turn(R: Array, y: Array, active: NDArray[np.bool_], into: Array) -> None:
    """Fill multipliers seen in a root's frame, R^T nu and R^T mu."""
    for k in range(len(y)):
        if active[k]:
            for l in range(3):
                into[k, l] = R[0, l] * y[k, 0] + R[1, l] * y[k, 1] + R[2, l] * y[k, 2]
                into[k, 3 + l] = R[0, l] * y[k, 3] + R[1, l] * y[k, 4] + R[2, l] * y[k, 5]


@njit(cache=True)
def _turn_walls(problem: BranchProblem, R: Array, sigma: Array, into: Array) -> None:
    """Fill the sums of sigma_r n_r seen in a root's frame."""
    walls = problem.walls
    into[:] = 0.0
    for r in range(len(sigma)):
        if sigma[r] > 0.0:
            x, y, z = sigma[r] * walls.normal[r]
            sums = into[walls.module[r], walls.end[r]]
            for l in range(3):
                sums[l] += R[0, l] * x + R[1, l] * y + R[2, l] * z


@njit(cache=True)
def _into(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R^T of a vector."""
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@njit(cache=True)
def _lever_force(problem: BranchProblem, y: Array) -> tuple[float, float, float]:
    """Return s = sum_k h_k x mu_k in W."""
    x, y_, z = 0.0, 0.0, 0.0
    for k in range(len(y)):
        hx, hy, hz = problem.loads.h[k]
        mx, my, mz = y[k, 3], y[k, 4], y[k, 5]
        x, y_, z = x + hy * mz - hz * my, y_ + hz * mx - hx * mz, z + hx * my - hy * mx
    return x, y_, z


@njit(cache=True)
def _psi(
    torques: Array, weights: Array, U: float, y: Array, active: NDArray[np.bool_], at: Frames, v: int, E: Array
) -> float:
    """Return the sum of psi_k(t + E) over the rotors of one module, frame v."""
    xx, xy, xz = at.x[v]
    yx, yy, yz = at.y[v]
    zx, zy, zz = at.z[v]
    px, py, pz = at.p[v]
    total = 0.0
    for k in range(len(y)):
        if not active[k]:
            continue
        mx, my, mz = y[k, 3], y[k, 4], y[k, 5]
        nx, ny, nz = y[k, 0] + my * pz - mz * py, y[k, 1] + mz * px - mx * pz, y[k, 2] + mx * py - my * px
        force = nx * zx + ny * zy + nz * zz
        about_x = mx * xx + my * xy + mz * xz
        about_y = mx * yx + my * yy + mz * yz
        about_z = mx * zx + my * zy + mz * zz
        weight = weights[k]
        for q in range(4):
            t = 0.25 * (force + torques[q, 0] * about_x + torques[q, 1] * about_y + torques[q, 2] * about_z)
            t += E[k, q]
            if t > 0.0:
                u = U if t >= 2 * weight * U else t / (2 * weight)
                total += u * (t - weight * u)
    return total


@njit(cache=True)
def _drifts(problem: BranchProblem, rho: Array, drift: Array) -> None:
    """Fill how far the points of the axes move at most, in W."""
    tree, between = problem.tree, problem.levers.between
    drift[:] = 0.0
    for i in range(1, len(tree.parent)):
        for outer in range(2 + tree.depth[i]):
            b = tree.path[i, outer]
            drift[i + 2] += rho[b] * between[b, i + 2]


@njit(cache=True)
def _remainders(problem: BranchProblem, i: int, work: Sums, middle: Frames, axes: Axes, rho: Array) -> None:
    """Fill E of the rotors of module i, and add to `slope` and `spread` what they change."""
    path, count = problem.tree.path[i], problem.tree.depth[i] + 3
    between, lever, U = problem.levers.between, problem.levers.rotor[i], problem.u_max
    xx, xy, xz = middle.x[i]
    yx, yy, yz = middle.y[i]
    zx, zy, zz = middle.z[i]
    px, py, pz = middle.p[i]
    t, slopes, parts = np.zeros(4), np.zeros((count, 4)), np.zeros((count, 4))
    for k in range(len(work.y)):
        if not work.active[k]:
            continue
        nx, ny, nz = work.y[k, 0], work.y[k, 1], work.y[k, 2]
        mx, my, mz = work.y[k, 3], work.y[k, 4], work.y[k, 5]
        mu = math.sqrt(mx * mx + my * my + mz * mz)
        for at in range(count):
            a = path[at]
            cx, cy, cz = axes.c[a]
            fx, fy, fz = nx + my * cz - mz * cy, ny + mz * cx - mx * cz, nz + mx * cy - my * cx
            work.away[a] = math.sqrt(fx * fx + fy * fy + fz * fz) + mu * work.drift[a]
        for at in range(count):
            a = path[at]
            wx, wy, wz = axes.omega[a]
            cx, cy, cz = axes.c[a]
            fx, fy, fz = nx + my * cz - mz * cy, ny + mz * cx - mx * cz, nz + mx * cy - my * cx
            along, turning = fx * wx + fy * wy + fz * wz, mx * wx + my * wy + mz * wz
            ox, oy, oz = mx - turning * wx, my - turning * wy, mz - turning * wz  # mu across omega
            dx, dy, dz = px - cx, py - cy, pz - cz
            Tx, Ty, Tz = dy * zz - dz * zy, dz * zx - dx * zz, dx * zy - dy * zx
            alpha = (fx - along * wx) * zx + (fy - along * wy) * zy + (fz - along * wz) * zz
            alpha += ox * Tx + oy * Ty + oz * Tz
            vx, vy, vz = my * wz - mz * wy, mz * wx - mx * wz, mx * wy - my * wx  # mu x omega
            beta = (fy * wz - fz * wy) * zx + (fz * wx - fx * wz) * zy + (fx * wy - fy * wx) * zz
            beta += vx * Tx + vy * Ty + vz * Tz
            more = 0.0
            for other in range(count):
                if other != at:
                    b = path[other]
                    outer, inner = (b, a) if other < at else (a, b)
                    more += rho[b] * (work.away[outer] + mu * (between[a, b] + lever[inner]))
            most = work.away[a] + mu * lever[a]
            flat, cubic = 1 - math.cos(rho[a]), CUBIC * rho[a] ** 3
            for q in range(4):
                own_x, own_y, own_z = problem.torques[q]
                al = alpha + own_x * (ox * xx + oy * xy + oz * xz)
                al += own_y * (ox * yx + oy * yy + oz * yz) + own_z * (ox * zx + oy * zy + oz * zz)
                be = beta + own_x * (vx * xx + vy * xy + vz * xz)
                be += own_y * (vx * yx + vy * yy + vz * yz) + own_z * (vx * zx + vy * zy + vz * zz)
                slopes[at, q] = 0.25 * be
                al, be = min(al + more, most), min(abs(be) + more, most)
                parts[at, q] = 0.25 * (max(al, 0.0) * flat + be * cubic)
        about_x = mx * xx + my * xy + mz * xz
        about_y = mx * yx + my * yy + mz * yz
        about_z = mx * zx + my * zy + mz * zz
        force = (nx + my * pz - mz * py) * zx + (ny + mz * px - mx * pz) * zy + (nz + mx * py - my * px) * zz
        weight = problem.loads.weight[k]
        for q in range(4):
            own_x, own_y, own_z = problem.torques[q]
            t[q] = 0.25 * (force + own_x * about_x + own_y * about_y + own_z * about_z)
            E = 0.0
            for at in range(count):
                E += parts[at, q]
            work.E[k, q] = E
            if t[q] + E > 0.0:
                u = U if t[q] + E >= 2 * weight * U else (t[q] + E) / (2 * weight)
                for at in range(count):
                    work.slope[path[at]] -= u * slopes[at, q]
                    work.spread[path[at]] += u * parts[at, q]


@njit(cache=True)
def _remainder_of(
    problem: BranchProblem,
    i: int,
    w: float,
    m: tuple[float, float, float],
    lever: Array,
    s: tuple[float, float, float],
    axes: Axes,
    rho: Array,
    work: Sums,
) -> float:
    """Return by how much m . s is below its interpolant at most: as the rotors' remainders, for -s.

    m is the moment of a mass w that moves with module i, at the middle, `lever` its greatest about every axis.
    """
    path, count, (mx, my, mz) = problem.tree.path[i], problem.tree.depth[i] + 3, m
    size, total = math.sqrt(s[0] ** 2 + s[1] ** 2 + s[2] ** 2), 0.0
    for at in range(count):
        a = path[at]
        wx, wy, wz = axes.omega[a]
        dx, dy, dz = mx - w * axes.c[a, 0], my - w * axes.c[a, 1], mz - w * axes.c[a, 2]
        along = dx * wx + dy * wy + dz * wz
        alpha = -((dx - along * wx) * s[0] + (dy - along * wy) * s[1] + (dz - along * wz) * s[2])
        beta = (wy * dz - wz * dy) * s[0] + (wz * dx - wx * dz) * s[1] + (wx * dy - wy * dx) * s[2]
        more = 0.0
        for other in range(count):
            if other != at:
                b = path[other]
                more += rho[b] * size * lever[a if other < at else b]
        most = size * lever[a]
        part = max(0.0, min(alpha + more, most)) * (1 - math.cos(rho[a]))
        part += min(abs(beta) + more, most) * CUBIC * rho[a] ** 3
        work.slope[a] += beta
        work.spread[a] += part
        total += part
    return total

r"""A lower bound on the effort of every design whose angles lie in a box.

**Duality.** For any multipliers y_k = (nu_k, mu_k) of force and torque and any design of angles theta

.. math::

    J \ge \sum_k y_k \cdot b_k(\theta) - \sum_{j,k} \psi_k(a_j(\theta) \cdot y_k)
    + \sum_r \sigma_r (n_r \cdot e_r(\theta) + d_r) =: D(\theta; y, \sigma), \qquad
    \psi_k(t) = \max_{u_{min} \le u \le u_{max}} t u - \lambda_k u^2

with sigma_r >= 0 of the rows of walls, n_r . (e_r - p'_E) + d_r <= 0, e_r an end of an envelope. The balance of
load case k has p'_E x g_k in its torque; p'_E cancels in the sum where sum_k g_k x mu_k = sum_r sigma_r n_r, so
that no box for it is needed. b_k . y_k is const + sum_i B_i . s with s = sum_k h_k x mu_k and B_i the moment of
module i and its joints, p_i where joints weigh nothing; u_min >= 0, so that psi is nondecreasing. A corner of a
reserve is a load case with lambda_k = 0, whose psi is u_min t + (u_max - u_min) max(t, 0); one with y_k = 0 adds
nothing. A dead rotor contributes no psi.

**Interpolation.** In every single angle a, the others held, t = a_j . y_k is A + alpha cos x + beta sin x, x
from the middle of the box and |x| <= rho. It exceeds the line P_a t through its values at x = -rho and rho by
alpha (cos x - cos rho) + beta (sin x - x sin rho / rho)
<= max(0, alpha) (1 - cos rho) + |beta| rho^3 / (9 sqrt 3): sin x - x sin rho / rho is the integral of Green's
function of the interval with sin s <= s, and (x rho^2 - x^3) / 6 is greatest at x = rho / sqrt 3. One angle
after the other, outermost first, t - P t = sum_a P_{<a} (t - P_a t). There alpha_a is a harmonic in every angle b
beyond a too, so it exceeds its interpolant by M_a sum_{b > a} w_b at most, w_b the length of (1 - cos rho_b,
rho_b^3 / (9 sqrt 3)) and M_a at least |t - A| whatever the angles beyond a. As max(0, .) is convex, t is at most
the interpolant of t(v) + E(v) in the whole box,

.. math:: E(v) = \sum_a (1 - \cos \rho_a) \max(0, \alpha_a(v) + M_a \sum_{b > a} w_b) + M_a \rho_a^3 / (9 \sqrt 3)

and as psi is convex and nondecreasing, psi(t) is at most the interpolant of psi(t(v) + E(v)), so

    D >= const + min over vertices v of sum_i (B_i(v) . s + w_i(v) - E_i - sum_jk psi_k(t_jk(v) + E_jk(v)))

with w_i = sum_r sigma_r n_r . e_r over the two ends of module i, as harmonic as B_i . s.

**Minimum.** What module i adds depends on the root's angles and the hinges on its path alone. So for each of the 8
vertices of the root the minimum over hinges is taken from the leaves of the tree inwards, not over all 2^A
vertices.

**Remainders.** For rotor j of module i, about the axis (omega, c) of angle a with nu' = nu + mu x c, tau its torque
about c: 4 A = (nu' . omega) (omega . z) + (mu . omega) (omega . tau) and alpha cos rho is the mean of t less A at
the two vertices that differ in a alone. M_a is |nu'| + |mu| times the greatest lever, |nu'| that at the middle
plus |mu| times how far c moves. In E_i alpha and beta are those of the middle, which one more angle b changes by
rho_b |s| times the lever of the inner of a and b at most, and never more than |s| times that of a. Distances are
those of the tree stretched out.

**Rounding.** Frames are products of at most A + 1 rotations, each of whose entries is off by 4 eps at most (eps =
2^-53: one rounding of each sine, product and sum), so an entry of a frame by under 8 (A + 1) eps, a position by
that times the path's length, t by under 100 (A + 1) eps (|nu| + |mu| L), L the longest lever, and t + E by under
six times that: rho_a < 1/2. psi' <= u_max, and sums of 4 n K + 5 n + 6 K terms are off by that many eps of the sum
of their sizes, none of which is above u_max (|nu| + |mu| L), sigma L or the sizes of b . y. For A <= 20 and n K <=
10,000 that is under 8e-12 of these in all; `Slack` takes SUM_ROUNDING = 1e-11 of them, in proportion more where n K
is greater, beside the audit's tolerance, which is 1e-6 of those of y and alone a hundred thousand times as large.
Ends of boxes are floats, and adjacent boxes share them, so boxes leave no gap. What the condition on mu and sigma
misses costs as much times |p'_E|, which is bounded by what an audit lets pass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import BranchProblem, Indices
from nlp.bounds.branch.frames import Axes, Frames, moment
from nlp.bounds.branch.multipliers import best_input, imbalance
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

CUBIC = 1 / (9 * math.sqrt(3))
"""Largest coefficient of rho^3, see the module's docstring."""
MISSED = 1e-13
"""Rounding error of the condition on mu and sigma, as a share of |g_k| |mu_k| and sigma_r."""


class Sums(NamedTuple):
    """Arrays that evaluating a box needs, and what it leaves in them."""

    active: Indices
    """Load cases that count, shape (K,)."""
    y: Array
    """Their multipliers in the root's frame at its vertices, shape (8, K, 6)."""
    wrench: Array
    """(z, p x z + torque) of every rotor in all frames, shape (frames, 4, 6)."""
    screw: Array
    """(omega, c x omega) of the hinge before a module, at its first frame of two, shape (frames, 6)."""
    t: Array
    """a_j . y_k at all vertices, shape (8, frames, K, 4)."""
    above: Array
    """That with its remainder E."""
    most: Array
    """Greatest |nu'| of a load case about every axis, shape (K, A)."""
    added: Array
    """What the bodies and walls add, shape (8, frames)."""
    walls: Array
    """sum_r sigma_r n_r of both ends of every module, in the root's frame, shape (n, 2, 3)."""
    least: Array
    """Least sums over the modules beyond, for every frame: (frames,)."""
    slope: Array
    """Slope of D at the middle, by angle, shape (A,)."""
    spread: Array
    """Loss of D to remainders, by angle, shape (A,)."""
    drift: Array
    """(A,): how far the point of every axis moves in the box."""
    omega: Array
    """The root's axes in its frame at its vertices, shape (3, 8, 3)."""
    turning: Array
    """Torque of a module's rotors about an axis, shape (4,)."""
    flat: Array
    """1 - cos rho, shape (A,)."""
    cubic: Array
    """That of the sine, shape (A,)."""
    more: Array
    """What alpha may exceed its interpolant by, times `flat`, shape (K, A)."""
    slopes: Array
    """What every angle changes a module's rotors by, shape (A, 4)."""
    parts: Array
    """And their remainders."""


@njit(cache=True)
def sums(problem: BranchProblem) -> Sums:
    """Return arrays for one box at a time."""
    K, A, count = len(problem.loads.f), len(problem.levers.between), problem.tree.first[-1]
    return Sums(
        np.zeros(K, np.int64),
        np.zeros((8, K, 6)),
        np.zeros((count, 4, 6)),
        np.zeros((count, 6)),
        np.zeros((8, count, K, 4)),
        np.zeros((8, count, K, 4)),
        np.zeros((K, A)),
        np.zeros((8, count)),
        np.zeros((len(problem.tree.parent), 2, 3)),
        np.zeros(count),
        np.zeros(A),
        np.zeros(A),
        np.zeros(A),
        np.zeros((3, 8, 3)),
        np.zeros(4),
        np.zeros(A),
        np.zeros(A),
        np.zeros((K, A)),
        np.zeros((A, 4)),
        np.zeros((A, 4)),
    )


@njit(cache=True, allocates=False)
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
        rho: half widths, under 1/2 [rad].
        work: arrays, for `gains` too.
        cut: what ends the search for the least vertex.
    """
    constant, count = _constant(problem, y, sigma), 0
    for k in range(len(y)):
        if counts(problem, y, k):
            work.active[count] = k
            count += 1
    _drifts(problem, rho, work.drift)
    _add_bodies(problem, y, sigma, roots, middle, axes, vertices, rho, work)
    _fill_thrusts(problem, y, roots, vertices, count, work)
    if cut < math.inf:
        least = _least(problem, work, work.t, count, constant, cut)
        if least < cut:
            return least
    _fill_most(problem, y, roots[0], axes, count, work)
    _add_remainders(problem, roots, axes, rho, count, work)
    return _least(problem, work, work.above, count, constant, cut if cut < math.inf else -math.inf)


@njit(cache=True, allocates=False)
def counts(problem: BranchProblem, y: Array, k: int) -> bool:
    """True if a load case has a weight or multipliers; others add nothing."""
    some: bool = problem.loads.weight[k] > 0.0
    for l in range(6):
        some |= y[k, l] != 0.0
    return some


@njit(cache=True, allocates=False)
def _add_bodies(
    problem: BranchProblem,
    y: Array,
    sigma: Array,
    roots: Array,
    middle: Frames,
    axes: Axes,
    vertices: Frames,
    rho: Array,
    work: Sums,
) -> None:
    """Fill what bodies and walls add at every vertex, less their remainders."""
    tree, L, ends = problem.tree, problem.walls.length, 2 if len(sigma) > 0 else 0
    work.slope[:] = 0.0
    work.spread[:] = 0.0
    if ends > 0:
        _turn_walls(problem, roots[0], sigma, work.walls)
    sx, sy, sz = _lever_force(problem, y)
    s = _into(roots[0], sx, sy, sz)
    for i in range(len(tree.parent)):
        m, lever = moment(middle, i, problem.bodies[i]), problem.levers.body[i]
        lost = _remainder_of(problem, i, problem.bodies[i, 0], m, lever, 0.0, s, axes, rho, work)
        for end in range(ends):
            x, y_, z = work.walls[i, end]
            if x * x + y_ * y_ + z * z > 0.0:
                (px, py, pz), (zx, zy, zz), down = middle.p[i], middle.z[i], end * L
                e = (px - down * zx, py - down * zy, pz - down * zz)
                lost += _remainder_of(
                    problem, i, 1.0, e, problem.levers.centre[i], down, (x, y_, z), axes, rho, work
                )
        for root in range(8):
            for v in range(tree.first[i], tree.first[i + 1]):
                work.added[root, v] = -lost
    for root in range(8):
        s = _into(roots[1 + root], sx, sy, sz)
        if ends > 0:
            _turn_walls(problem, roots[1 + root], sigma, work.walls)
        for i in range(len(tree.parent)):
            near, far = work.walls[i, 0], work.walls[i, 1]
            for v in range(tree.first[i], tree.first[i + 1]):
                mx, my, mz = moment(vertices, v, problem.bodies[i])
                added = mx * s[0] + my * s[1] + mz * s[2]
                if ends > 0:
                    for l in range(3):
                        added += vertices.p[v, l] * near[l] + (vertices.p[v, l] - L * vertices.z[v, l]) * far[l]
                work.added[root, v] += added


@njit(cache=True, allocates=False)
def _fill_thrusts(problem: BranchProblem, y: Array, roots: Array, vertices: Frames, count: int, work: Sums) -> None:
    """Fill the multipliers, the wrenches and their products, at all vertices."""
    torques, seen, wrench, thrusts = problem.torques, work.y, work.wrench, work.t
    frames_x, frames_y, frames_z, frames_p = vertices.x, vertices.y, vertices.z, vertices.p
    for root in range(8):
        R = roots[1 + root]
        for slot in range(count):
            k = work.active[slot]
            for l in range(3):
                seen[root, slot, l] = R[0, l] * y[k, 0] + R[1, l] * y[k, 1] + R[2, l] * y[k, 2]
                seen[root, slot, 3 + l] = R[0, l] * y[k, 3] + R[1, l] * y[k, 4] + R[2, l] * y[k, 5]
    for v in range(len(wrench)):
        (px, py, pz), (zx, zy, zz) = frames_p[v], frames_z[v]
        about = (py * zz - pz * zy, pz * zx - px * zz, px * zy - py * zx)
        for q in range(4):
            a, b, c = torques[q]
            for l in range(3):
                wrench[v, q, l] = frames_z[v, l]
                wrench[v, q, 3 + l] = about[l] + a * frames_x[v, l] + b * frames_y[v, l] + c * frames_z[v, l]
        for root in range(8):
            for slot in range(count):
                n0, n1, n2, m0, m1, m2 = seen[root, slot]
                force = n0 * zx + n1 * zy + n2 * zz
                for q in range(4):
                    torque = m0 * wrench[v, q, 3] + m1 * wrench[v, q, 4] + m2 * wrench[v, q, 5]
                    thrusts[root, v, slot, q] = 0.25 * (force + torque)
    first, parent, port, l_c = problem.tree.first, problem.tree.parent, problem.tree.port, problem.l_c
    for i in range(1, len(parent)):
        h, across = parent[i], frames_y if port[i] % 2 == 0 else frames_x
        along = frames_x if port[i] % 2 == 0 else frames_y
        step = l_c if port[i] < 2 else -l_c
        for v in range(first[h + 1] - first[h]):
            screw, (wx, wy, wz), (ax, ay, az) = (
                work.screw[first[i] + 2 * v],
                across[first[h] + v],
                along[first[h] + v],
            )
            px, py, pz = frames_p[first[h] + v]
            cx, cy, cz = px + step * ax, py + step * ay, pz + step * az
            screw[0], screw[1], screw[2] = wx, wy, wz
            screw[3], screw[4], screw[5] = cy * wz - cz * wy, cz * wx - cx * wz, cx * wy - cy * wx


@njit(cache=True, allocates=False)
def _fill_most(problem: BranchProblem, y: Array, R: Array, axes: Axes, count: int, work: Sums) -> None:
    """Fill the greatest |nu'| of all load cases about all axes."""
    for slot in range(count):
        k = work.active[slot]
        mx, my, mz = _into(R, y[k, 3], y[k, 4], y[k, 5])
        nx, ny, nz = _into(R, y[k, 0], y[k, 1], y[k, 2])
        mu = math.sqrt(mx * mx + my * my + mz * mz)
        for a in range(len(work.drift)):
            cx, cy, cz = axes.c[a]
            fx, fy, fz = nx + my * cz - mz * cy, ny + mz * cx - mx * cz, nz + mx * cy - my * cx
            work.most[slot, a] = math.sqrt(fx * fx + fy * fy + fz * fz) + mu * work.drift[a]


@njit(cache=True, allocates=False)
def _add_remainders(problem: BranchProblem, roots: Array, axes: Axes, rho: Array, count: int, work: Sums) -> None:
    """Fill `above`: t with its remainders."""
    tree, seen, wrench, thrusts, above = problem.tree, work.y, work.wrench, work.t, work.above
    n, A, first = len(tree.parent), len(rho), tree.first
    more, a_q, omega, flat, cubic = work.more, work.turning, work.omega, work.flat, work.cubic
    for a in range(A):
        flat[a], cubic[a] = 1 - math.cos(rho[a]), CUBIC * rho[a] ** 3
    cosine, sine = math.cos(rho[2]), math.sin(rho[2])
    for root in range(8):
        for l in range(3):
            omega[0, root, l] = roots[1 + root, 2, l]
        turned = sine if root & 1 else -sine
        omega[1, root, 0] = axes.omega[1, 0] * cosine - axes.omega[1, 2] * turned
        omega[1, root, 2] = axes.omega[1, 2] * cosine + axes.omega[1, 0] * turned
        omega[2, root, 1] = 1.0
    for i in range(n):
        depth = tree.depth[i]
        for slot in range(count):
            m0, m1, m2 = seen[0, slot, 3], seen[0, slot, 4], seen[0, slot, 5]
            mu = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
            beyond, both = 0.0, 0.0
            for at in range(2 + depth, -1, -1):
                a = tree.path[i, at]
                most = work.most[slot, a] + mu * problem.levers.rotor[i, a]
                more[slot, at] = 0.25 * flat[a] * most * beyond
                beyond += math.sqrt(flat[a] * flat[a] + cubic[a] * cubic[a])
                both += 0.25 * most * cubic[a]
            for root in range(8):
                for v in range(first[i], first[i + 1]):
                    for q in range(4):
                        above[root, v, slot, q] = thrusts[root, v, slot, q] + both
        for at in range(3):
            bit, share = 4 >> at, flat[at] / math.cos(rho[at])
            for root in range(8):
                if root & bit:
                    continue
                other, (wx, wy, wz) = root + bit, omega[at, root]
                for v in range(first[i], first[i + 1]):
                    for q in range(4):
                        a_q[q] = wx * wrench[v, q, 3] + wy * wrench[v, q, 4] + wz * wrench[v, q, 5]
                    along = wx * wrench[v, 0, 0] + wy * wrench[v, 0, 1] + wz * wrench[v, 0, 2]
                    for slot in range(count):
                        n0, n1, n2, m0, m1, m2 = seen[root, slot]
                        held, turning = (n0 * wx + n1 * wy + n2 * wz) * along, m0 * wx + m1 * wy + m2 * wz
                        for q in range(4):
                            both = thrusts[root, v, slot, q] + thrusts[other, v, slot, q]
                            part = (0.5 * both - 0.25 * (held + turning * a_q[q])) * share + more[slot, at]
                            part = max(part, 0.0)
                            above[root, v, slot, q] += part
                            above[other, v, slot, q] += part
        for h in range(depth):
            a, bit = tree.path[i, 3 + h], 1 << (depth - 1 - h)
            share = flat[a] / math.cos(rho[a])
            for near in range(1 << depth):
                if near & bit:
                    continue
                v, other = first[i] + near, first[i] + near + bit
                wx, wy, wz, dx, dy, dz = work.screw[first[a - 2] + 2 * (near >> (depth - h))]
                moved = dx * wrench[v, 0, 0] + dy * wrench[v, 0, 1] + dz * wrench[v, 0, 2]
                for q in range(4):
                    a_q[q] = wx * wrench[v, q, 3] + wy * wrench[v, q, 4] + wz * wrench[v, q, 5] + moved
                along = wx * wrench[v, 0, 0] + wy * wrench[v, 0, 1] + wz * wrench[v, 0, 2]
                for root in range(8):
                    for slot in range(count):
                        n0, n1, n2, m0, m1, m2 = seen[root, slot]
                        turning = m0 * wx + m1 * wy + m2 * wz
                        held = (n0 * wx + n1 * wy + n2 * wz + m0 * dx + m1 * dy + m2 * dz) * along
                        for q in range(4):
                            both = thrusts[root, v, slot, q] + thrusts[root, other, slot, q]
                            part = (0.5 * both - 0.25 * (held + turning * a_q[q])) * share + more[slot, 3 + h]
                            part = max(part, 0.0)
                            above[root, v, slot, q] += part
                            above[root, other, slot, q] += part


@njit(cache=True, allocates=False)
def _least(problem: BranchProblem, work: Sums, thrusts: Array, count: int, constant: float, cut: float) -> float:
    """Return the constant and the least sum over the modules of all vertices, or of some that are under the cut."""
    tree, loads, u_min, u_max = problem.tree, problem.loads, problem.u_min, problem.u_max
    first, parent = tree.first, tree.parent
    active, added, least, result = work.active, work.added, work.least, math.inf
    for root in range(8):
        for i in range(len(parent)):
            for v in range(first[i], first[i + 1]):
                total = added[root, v]
                for slot in range(count):
                    weight, dead = loads.weight[active[slot]], loads.dead[active[slot]] - 4 * i
                    for q in range(4):
                        t = thrusts[root, v, slot, q]
                        u = best_input(t, weight, u_min, u_max)
                        if q != dead:
                            total -= u * (t - weight * u)
                least[v] = total
        for i in range(len(parent) - 1, 0, -1):
            h = parent[i]
            for v in range(first[h + 1] - first[h]):
                at = first[i] + 2 * v
                least[first[h] + v] += min(least[at], least[at + 1])
        result = min(result, constant + least[0])
        if result < cut:
            break
    return result


@njit(cache=True, allocates=False)
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


@njit(cache=True, allocates=False)
def _turn_walls(problem: BranchProblem, R: Array, sigma: Array, into: Array) -> None:
    """Fill the sums of sigma_r n_r seen in a root's frame."""
    walls = problem.walls
    into[:] = 0.0
    for r in range(len(sigma)):
        if sigma[r] > 0.0:
            x, y, z = sigma[r] * walls.normal[r, 0], sigma[r] * walls.normal[r, 1], sigma[r] * walls.normal[r, 2]
            sums = into[walls.module[r], walls.end[r]]
            for l in range(3):
                sums[l] += R[0, l] * x + R[1, l] * y + R[2, l] * z


@njit(cache=True, allocates=False)
def _into(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R^T of a vector."""
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@njit(cache=True, allocates=False)
def _lever_force(problem: BranchProblem, y: Array) -> tuple[float, float, float]:
    """Return s = sum_k h_k x mu_k in W."""
    x, y_, z = 0.0, 0.0, 0.0
    for k in range(len(y)):
        hx, hy, hz = problem.loads.h[k]
        mx, my, mz = y[k, 3], y[k, 4], y[k, 5]
        x, y_, z = x + hy * mz - hz * my, y_ + hz * mx - hx * mz, z + hx * my - hy * mx
    return x, y_, z


@njit(cache=True, allocates=False)
def _drifts(problem: BranchProblem, rho: Array, drift: Array) -> None:
    """Fill how far the points of the axes move at most, in W."""
    tree, between = problem.tree, problem.levers.between
    drift[:] = 0.0
    for i in range(1, len(tree.parent)):
        for outer in range(2 + tree.depth[i]):
            b = tree.path[i, outer]
            drift[i + 2] += rho[b] * between[b, i + 2]


@njit(cache=True, allocates=False)
def gains(problem: BranchProblem, y: Array, R: Array, middle: Frames, axes: Axes, rho: Array, work: Sums) -> None:
    """Add to `slope` and `spread` of a box that was bounded what its rotors change, at the middle."""
    u_min, u_max = problem.u_min, problem.u_max
    slopes, parts = work.slopes, work.parts
    for k in range(len(y)):
        nx, ny, nz = _into(R, y[k, 0], y[k, 1], y[k, 2])
        mx, my, mz = _into(R, y[k, 3], y[k, 4], y[k, 5])
        weight = problem.loads.weight[k]
        if not counts(problem, y, k):
            continue
        for i in range(len(middle.p)):
            path, count = problem.tree.path[i], problem.tree.depth[i] + 3
            xx, xy, xz = middle.x[i]
            yx, yy, yz = middle.y[i]
            zx, zy, zz = middle.z[i]
            px, py, pz = middle.p[i]
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
                flat, cubic = 1 - math.cos(rho[a]), CUBIC * rho[a] ** 3
                for q in range(4):
                    own_x, own_y, own_z = problem.torques[q]
                    al = alpha + own_x * (ox * xx + oy * xy + oz * xz)
                    al += own_y * (ox * yx + oy * yy + oz * yz) + own_z * (ox * zx + oy * zy + oz * zz)
                    be = beta + own_x * (vx * xx + vy * xy + vz * xz)
                    be += own_y * (vx * yx + vy * yy + vz * yz) + own_z * (vx * zx + vy * zy + vz * zz)
                    slopes[at, q] = 0.25 * be
                    parts[at, q] = 0.25 * (max(al, 0.0) * flat + abs(be) * cubic)
            about_x = mx * xx + my * xy + mz * xz
            about_y = mx * yx + my * yy + mz * yz
            about_z = mx * zx + my * zy + mz * zz
            force = (nx + my * pz - mz * py) * zx + (ny + mz * px - mx * pz) * zy + (nz + mx * py - my * px) * zz
            for q in range(4):
                own_x, own_y, own_z = problem.torques[q]
                t = 0.25 * (force + own_x * about_x + own_y * about_y + own_z * about_z)
                for at in range(count):
                    t += parts[at, q]
                u = best_input(t, weight, u_min, u_max)
                if u > 0.0 and problem.loads.dead[k] != 4 * i + q:
                    for at in range(count):
                        work.slope[path[at]] -= u * slopes[at, q]
                        work.spread[path[at]] += u * parts[at, q]


@njit(cache=True, allocates=False)
def _remainder_of(
    problem: BranchProblem,
    i: int,
    w: float,
    m: tuple[float, float, float],
    lever: Array,
    beyond: float,
    s: tuple[float, float, float],
    axes: Axes,
    rho: Array,
    work: Sums,
) -> float:
    """Return by how much m . s is below its interpolant at most: as the rotors' remainders, for -s.

    m is the moment of a mass w that moves with module i, at the middle, `lever` and what is `beyond` it its most
    about every axis.
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
                more += rho[b] * size * (lever[a if other < at else b] + beyond)
        most = size * (lever[a] + beyond)
        part = max(0.0, min(alpha + more, most)) * (1 - math.cos(rho[a]))
        part += min(abs(beta) + more, most) * CUBIC * rho[a] ** 3
        work.slope[a] += beta
        work.spread[a] += part
        total += part
    return total

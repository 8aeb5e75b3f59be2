r"""A lower bound on the effort of every design whose angles lie in a box.

**Duality.** For any multipliers y_k = (nu_k, mu_k) of force and torque and any design with angles theta

.. math::

    J \ge \sum_k y_k \cdot b_k(\theta) - \sum_{j,k} \psi_k(a_j(\theta) \cdot y_k)
    + \sum_r \sigma_r (n_r \cdot e_r(\theta) + d_r) =: D(\theta; y, \sigma), \qquad
    \psi_k(t) = \max_{u_{min} \le u \le u_{max}} t u - \lambda_k u^2

with multipliers sigma_r >= 0 of the walls, n_r . (e_r - p'_E) + d_r <= 0 for an end e_r of an envelope. The balance
of load case k has p'_E x g_k in its torque; p'_E cancels in the sum under the condition sum_k g_k x mu_k = sum_r
sigma_r n_r, so p'_E needs no box. b_k . y_k is const + sum_i B_i . s with s = sum_k h_k x mu_k and B_i the moment
of module i and its joints (p_i if joints have no mass); u_min >= 0, so psi is nondecreasing. If all lambda_k are
zero, J is zero and D has a multiple for every multiple of y and sigma: D > 0 shows that there is no design at all,
whatever the cut in effort. A corner of a reserve is a load case with lambda_k = 0, whose psi is u_min t + (u_max -
u_min) max(t, 0); with y_k = 0 it adds nothing. A dead rotor contributes no psi.

**Interpolation.** In a single angle a, with all others fixed, t = a_j . y_k is A + alpha cos x + beta sin x, where
x is measured from the middle, |x| <= rho. It exceeds the line P_a t through its values at -rho and rho by
alpha (cos x - cos rho) + beta (sin x - x sin rho / rho)
<= max(0, alpha) (1 - cos rho) + |beta| rho^3 / (9 sqrt 3): sin x - x sin rho / rho is the integral of Green's
function of the interval with sin s <= s, and (x rho^2 - x^3) / 6 is greatest at x = rho / sqrt 3. One angle
after the other, outermost first, t - P t = sum_a P_{<a} (t - P_a t). There alpha_a is a harmonic in every angle b
beyond a too, so it exceeds its interpolant by at most M_a sum_{b > a} w_b, with w_b the length of (1 - cos rho_b,
rho_b^3 / (9 sqrt 3)) and M_a at least |t - A| for all angles beyond a. As max(0, .) is convex, t is at most
the interpolant of t(v) + E(v) in the whole box,

.. math:: E(v) = \sum_a (1 - \cos \rho_a) \max(0, \alpha_a(v) + M_a \sum_{b > a} w_b) + M_a \rho_a^3 / (9 \sqrt 3)

and as psi is convex and nondecreasing, psi(t) is at most the interpolant of psi(t(v) + E(v)), so

    D >= const + min over vertices v of sum_i (B_i(v) . s + w_i(v) - E_i - sum_jk psi_k(t_jk(v) + E_jk(v)))

with w_i = sum_r sigma_r n_r . e_r over the two ends of module i, a harmonic like B_i . s.

**Minimum.** The term of module i depends only on the root's angles and the hinges on its path. So for each of the 8
vertices of the root (4 if psi is one angle) the minimum over hinges is computed from the leaves of the tree
inwards, not over all 2^A vertices.

**Remainders.** For rotor j of module i, about the axis (omega, c) of angle a with nu' = nu + mu x c and its torque
tau about c: 4 A = (nu' . omega) (omega . z) + (mu . omega) (omega . tau), and alpha cos rho is the mean of t - A at
the two vertices that differ only in a. M_a is |nu'| + |mu| times the greatest lever, where |nu'| is its value at
the middle plus |mu| times the drift of c. In E_i alpha and beta are those at the middle; another angle b changes
them by at most rho_b |s| times the lever of the inner of a and b, and never by more than |s| times that of a.
Distances are those of the tree stretched out.

**Rounding.** Frames are products of at most A + 1 rotations, whose entries have errors of at most 4 eps (eps =
2^-53: one rounding of each sine, product and sum). So an entry of a frame has an error under 8 (A + 1) eps, a
position that times the path's length, t under 100 (A + 1) eps (|nu| + |mu| L) with the longest lever L, and t + E
under six times that, as rho_a < 1/2. psi' <= u_max, and sums of r n K + 5 n + 6 K terms have errors of that many
eps times the sum of the terms' magnitudes, none of which exceeds u_max (|nu| + |mu| L), sigma L or the magnitudes
of b . y. For A <= 20 and n K <= 10,000 that is under 8e-12 of these in all. `Slack` allows SUM_ROUNDING = 1e-11 of
them, and proportionally more for greater n K, in addition to the audit's tolerance, which is 1e-6 of those of y and
by itself a hundred thousand times as large. Limits of boxes are floats that adjacent boxes share, so there are no
gaps. The residual of the condition on mu and sigma costs its length times |p'_E|, which the audit bounds.
"""

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import ROTORS, SHARE, BranchProblem
from nlp.bounds.branch.frames import BoxFrames, moment
from nlp.bounds.branch.multipliers import best_input, lever_sum, residual
from nlp.bounds.branch.rod import RodChange
from nlp.numbers.kinematics import Vector, add, cross, dot, row
from topo_search.compiled_code import njit
from topo_search.model import Array, Indices

CUBIC = 1 / (9 * math.sqrt(3))
"""Largest coefficient of rho^3 (module docstring)."""
CONDITION_ROUNDING = 1e-13
"""Rounding error of the condition on mu and sigma, over |g_k| |mu_k| and sigma_r."""


class BoundWorkspace(NamedTuple):
    """Arrays for the bound of one box, and the gains of its angles."""

    active_cases: Indices
    """Load cases that add to D, shape (K,)."""
    root_y: Array
    """Multipliers of these in the root's frame at its vertices, shape (roots, K, 6)."""
    wrenches: Array
    """(z, p x z + torque) of every rotor in all frames, shape (frames, r, 6)."""
    screws: Array
    """(omega, c x omega) of the hinge before a module, at the first of its two frames, shape (frames, 6)."""
    t: Array
    """a_j . y_k at all vertices, shape (roots, frames, K, r)."""
    t_bound: Array
    """t plus its remainder E, shape (roots, frames, K, r)."""
    force_limit: Array
    """Greatest |nu'| of a load case about every axis, shape (K, A)."""
    module_value: Array
    """Contribution of bodies and walls to D, shape (roots, frames)."""
    wall_sums: Array
    """sum_r sigma_r n_r for both ends of every module, in the root's frame, shape (n, 2, 3)."""
    least_sum: Array
    """Least sum over a module and all modules beyond it, for every frame, shape (frames,)."""
    slope: Array
    """Slope of D at the middle by each angle, shape (A,)."""
    loss: Array
    """Loss of D to remainders by each angle, shape (A,)."""
    drift: Array
    """Largest displacement of the point of each axis in the box, shape (A,)."""
    omega: Array
    """The root's axes in its frame at its vertices, shape (3, 8, 3)."""
    torque: Array
    """Torque of each rotor of a module about an axis, shape (r,)."""
    versine: Array
    """1 - cos rho, shape (A,)."""
    cubic: Array
    """Largest value of sin x - x sin rho / rho, shape (A,)."""
    excess: Array
    """Limit on the excess of alpha over its interpolant, times `versine`, shape (K, A)."""
    rotor_slopes: Array
    """Slope of t by each angle for each rotor of a module, shape (A, r)."""
    rotor_losses: Array
    """Remainder of t by each angle for each rotor of a module, shape (A, r)."""


@njit(cache=True)
def bound_workspace(problem: BranchProblem, roots: int = 8) -> BoundWorkspace:
    """Return the workspace for a task and tree, with 8 vertices of the root, or 4 if psi is one angle."""
    K, A, count = len(problem.loads.f), len(problem.levers.between), problem.tree.first[-1]
    return BoundWorkspace(
        np.zeros(K, np.int64),
        np.zeros((roots, K, 6)),
        np.zeros((count, ROTORS, 6)),
        np.zeros((count, 6)),
        np.zeros((roots, count, K, ROTORS)),
        np.zeros((roots, count, K, ROTORS)),
        np.zeros((K, A)),
        np.zeros((roots, count)),
        np.zeros((len(problem.tree.parent), 2, 3)),
        np.zeros(count),
        np.zeros(A),
        np.zeros(A),
        np.zeros(A),
        np.zeros((3, 8, 3)),
        np.zeros(ROTORS),
        np.zeros(A),
        np.zeros(A),
        np.zeros((K, A)),
        np.zeros((A, ROTORS)),
        np.zeros((A, ROTORS)),
    )


@njit(cache=True, allocates=False)
def bound(
    problem: BranchProblem, y: Array, sigma: Array, box: BoxFrames, workspace: BoundWorkspace, cut: float
) -> float:
    """Return the lower bound of a box in effort units; if it is under the cut, any value between it and the cut.

    Args:
        problem: task and tree.
        y: multipliers of the load cases in W, shape (K, 6).
        sigma: multipliers of the walls, shape (W,).
        box: the box; its half widths are under 1/2.
        workspace: output, also for `add_rotor_gains`.
        cut: value under which the minimum over the vertices is not completed.
    """
    constant, case_count = _constant(problem, y, sigma), 0
    for k in range(len(y)):
        if is_active(problem, y, k):
            workspace.active_cases[case_count] = k
            case_count += 1
    _fill_drifts(problem, box.rho, workspace.drift)
    _add_bodies(problem, y, sigma, box, workspace)
    _fill_products(problem, y, box, case_count, workspace)
    if cut < math.inf:
        minimum = _least_vertex_value(problem, workspace, workspace.t, case_count, constant, cut)
        if minimum < cut:
            return minimum
    _fill_force_limits(problem, y, box, case_count, workspace)
    _add_remainders(problem, box, case_count, workspace)
    cut = cut if cut < math.inf else -math.inf
    return _least_vertex_value(problem, workspace, workspace.t_bound, case_count, constant, cut)


@njit(cache=True, inner=True, allocates=False)
def is_active(problem: BranchProblem, y: Array, k: int) -> bool:
    """Return whether a load case has a weight or multipliers; others add nothing to D."""
    active: bool = problem.loads.weight[k] > 0.0
    for l in range(6):
        active |= y[k, l] != 0.0
    return active


@njit(cache=True, inner=True, allocates=False)
def _add_bodies(problem: BranchProblem, y: Array, sigma: Array, box: BoxFrames, workspace: BoundWorkspace) -> None:
    """Fill the contribution of bodies and walls at every vertex, less their remainders."""
    tree, L, ends = problem.tree, problem.walls.length, 2 if len(sigma) > 0 else 0
    roots, middle, vertices = box.roots, box.middle, box.vertices
    workspace.slope[:] = 0.0
    workspace.loss[:] = 0.0
    if ends > 0:
        _fill_wall_sums(problem, roots[0], sigma, workspace.wall_sums)
    sx, sy, sz = lever_sum(problem.loads.h, y)
    s = _to_root(roots[0], sx, sy, sz)
    for i in range(len(tree.parent)):
        m, lever = moment(middle, i, problem.bodies[i]), problem.levers.body[i]
        loss = _moment_loss(problem, i, problem.bodies[i, 0], m, lever, 0.0, s, box, workspace)
        for end in range(ends):
            x, y_, z = workspace.wall_sums[i, end]
            if x * x + y_ * y_ + z * z > 0.0:
                distance = end * L
                e = add(row(middle.p, i), -distance, row(middle.z, i))
                lever = problem.levers.centre[i]
                loss += _moment_loss(problem, i, 1.0, e, lever, distance, (x, y_, z), box, workspace)
        for root in range(len(workspace.root_y)):
            for v in range(tree.first[i], tree.first[i + 1]):
                workspace.module_value[root, v] = -loss
    for root in range(len(workspace.root_y)):
        s = _to_root(roots[1 + root], sx, sy, sz)
        if ends > 0:
            _fill_wall_sums(problem, roots[1 + root], sigma, workspace.wall_sums)
        for i in range(len(tree.parent)):
            n_0, n_1 = workspace.wall_sums[i, 0], workspace.wall_sums[i, 1]
            for v in range(tree.first[i], tree.first[i + 1]):
                total = dot(moment(vertices, v, problem.bodies[i]), s)
                if ends > 0:
                    for l in range(3):
                        total += vertices.p[v, l] * n_0[l] + (vertices.p[v, l] - L * vertices.z[v, l]) * n_1[l]
                workspace.module_value[root, v] += total


@njit(cache=True, inner=True, allocates=False)
def _fill_products(problem: BranchProblem, y: Array, box: BoxFrames, count: int, workspace: BoundWorkspace) -> None:
    """Fill multipliers, wrenches and their products at all vertices."""
    torques, root_y, wrenches, t_values = problem.rotor_torques, workspace.root_y, workspace.wrenches, workspace.t
    frames_x, frames_y, frames_z, frames_p = box.vertices
    for root in range(len(workspace.root_y)):
        R = box.roots[1 + root]
        for slot in range(count):
            k = workspace.active_cases[slot]
            for l in range(3):
                root_y[root, slot, l] = R[0, l] * y[k, 0] + R[1, l] * y[k, 1] + R[2, l] * y[k, 2]
                root_y[root, slot, 3 + l] = R[0, l] * y[k, 3] + R[1, l] * y[k, 4] + R[2, l] * y[k, 5]
    for v in range(len(wrenches)):
        z = row(frames_z, v)
        about = cross(row(frames_p, v), z)
        for q in range(ROTORS):
            a, b, c = torques[q]
            for l in range(3):
                wrenches[v, q, l] = frames_z[v, l]
                wrenches[v, q, 3 + l] = about[l] + a * frames_x[v, l] + b * frames_y[v, l] + c * frames_z[v, l]
        for root in range(len(workspace.root_y)):
            for slot in range(count):
                n0, n1, n2, m0, m1, m2 = root_y[root, slot]
                force = dot((n0, n1, n2), z)
                for q in range(ROTORS):
                    torque = m0 * wrenches[v, q, 3] + m1 * wrenches[v, q, 4] + m2 * wrenches[v, q, 5]
                    t_values[root, v, slot, q] = SHARE * (force + torque)
    first, parent, port, l_c = problem.tree.first, problem.tree.parent, problem.tree.port, problem.l_c
    for i in range(1, len(parent)):
        h, across = parent[i], frames_y if port[i] % 2 == 0 else frames_x
        along = frames_x if port[i] % 2 == 0 else frames_y
        step = l_c if port[i] < 2 else -l_c
        for v in range(first[h + 1] - first[h]):
            screw, omega = workspace.screws[first[i] + 2 * v], row(across, first[h] + v)
            c = add(row(frames_p, first[h] + v), step, row(along, first[h] + v))
            screw[0], screw[1], screw[2] = omega
            screw[3], screw[4], screw[5] = cross(c, omega)


@njit(cache=True, inner=True, allocates=False)
def _fill_force_limits(
    problem: BranchProblem, y: Array, box: BoxFrames, count: int, workspace: BoundWorkspace
) -> None:
    """Fill the greatest |nu'| of every load case about every axis."""
    R = box.roots[0]
    for slot in range(count):
        k = workspace.active_cases[slot]
        nu, mu = _to_root(R, y[k, 0], y[k, 1], y[k, 2]), _to_root(R, y[k, 3], y[k, 4], y[k, 5])
        mu_norm = math.sqrt(dot(mu, mu))
        for a in range(len(workspace.drift)):
            f = _nu_about(nu, mu, row(box.axes.c, a))
            workspace.force_limit[slot, a] = math.sqrt(dot(f, f)) + mu_norm * workspace.drift[a]


@njit(cache=True, inner=True, allocates=False)
def _add_remainders(problem: BranchProblem, box: BoxFrames, count: int, workspace: BoundWorkspace) -> None:
    """Fill `t_bound`."""
    tree, first, roots, axes, rho = problem.tree, problem.tree.first, box.roots, box.axes, box.rho
    root_y, wrenches, t_values, t_bound = workspace.root_y, workspace.wrenches, workspace.t, workspace.t_bound
    versine, cubic, excess = workspace.versine, workspace.cubic, workspace.excess
    omega, torque = workspace.omega, workspace.torque
    for a in range(len(rho)):
        versine[a], cubic[a] = 1 - math.cos(rho[a]), CUBIC * rho[a] ** 3
    cosine, sine = math.cos(rho[2]), math.sin(rho[2])
    for root in range(len(workspace.root_y)):
        for l in range(3):
            omega[0, root, l] = roots[1 + root, 2, l]
        signed_sine = sine if root & 1 else -sine
        omega[1, root, 0] = axes.omega[1, 0] * cosine - axes.omega[1, 2] * signed_sine
        omega[1, root, 2] = axes.omega[1, 2] * cosine + axes.omega[1, 0] * signed_sine
        omega[2, root, 1] = 1.0
    for i in range(len(tree.parent)):
        depth = tree.depth[i]
        for slot in range(count):
            m0, m1, m2 = root_y[0, slot, 3], root_y[0, slot, 4], root_y[0, slot, 5]
            mu = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
            outer_sum, cubic_loss = 0.0, 0.0
            for level in range(2 + depth, -1, -1):
                a = tree.path[i, level]
                limit = workspace.force_limit[slot, a] + mu * problem.levers.rotor[i, a]
                excess[slot, level] = SHARE * versine[a] * limit * outer_sum
                outer_sum += math.sqrt(versine[a] * versine[a] + cubic[a] * cubic[a])
                cubic_loss += SHARE * limit * cubic[a]
            for root in range(len(workspace.root_y)):
                for v in range(first[i], first[i + 1]):
                    for q in range(ROTORS):
                        t_bound[root, v, slot, q] = t_values[root, v, slot, q] + cubic_loss
        for level in range(0 if len(root_y) == 8 else 1, 3):
            bit, scale = 4 >> level, versine[level] / math.cos(rho[level])
            for root in range(len(workspace.root_y)):
                if root & bit:
                    continue
                upper_vertex, (wx, wy, wz) = root + bit, omega[level, root]
                for v in range(first[i], first[i + 1]):
                    for q in range(ROTORS):
                        torque[q] = wx * wrenches[v, q, 3] + wy * wrenches[v, q, 4] + wz * wrenches[v, q, 5]
                    axis_force = wx * wrenches[v, 0, 0] + wy * wrenches[v, 0, 1] + wz * wrenches[v, 0, 2]
                    for slot in range(count):
                        n0, n1, n2, m0, m1, m2 = root_y[root, slot]
                        mu_omega = m0 * wx + m1 * wy + m2 * wz
                        parallel = (n0 * wx + n1 * wy + n2 * wz) * axis_force
                        for q in range(ROTORS):
                            t_sum = t_values[root, v, slot, q] + t_values[upper_vertex, v, slot, q]
                            loss = (0.5 * t_sum - SHARE * (parallel + mu_omega * torque[q])) * scale
                            loss += excess[slot, level]
                            loss = max(loss, 0.0)
                            t_bound[root, v, slot, q] += loss
                            t_bound[upper_vertex, v, slot, q] += loss
        for h in range(depth):
            a, bit = tree.path[i, 3 + h], 1 << (depth - 1 - h)
            scale = versine[a] / math.cos(rho[a])
            for lower_vertex in range(1 << depth):
                if lower_vertex & bit:
                    continue
                v, upper_vertex = first[i] + lower_vertex, first[i] + lower_vertex + bit
                wx, wy, wz, dx, dy, dz = workspace.screws[first[a - 2] + 2 * (lower_vertex >> (depth - h))]
                shift = dx * wrenches[v, 0, 0] + dy * wrenches[v, 0, 1] + dz * wrenches[v, 0, 2]
                for q in range(ROTORS):
                    torque[q] = wx * wrenches[v, q, 3] + wy * wrenches[v, q, 4] + wz * wrenches[v, q, 5] + shift
                axis_force = wx * wrenches[v, 0, 0] + wy * wrenches[v, 0, 1] + wz * wrenches[v, 0, 2]
                for root in range(len(workspace.root_y)):
                    for slot in range(count):
                        n0, n1, n2, m0, m1, m2 = root_y[root, slot]
                        mu_omega = m0 * wx + m1 * wy + m2 * wz
                        parallel = (n0 * wx + n1 * wy + n2 * wz + m0 * dx + m1 * dy + m2 * dz) * axis_force
                        for q in range(ROTORS):
                            t_sum = t_values[root, v, slot, q] + t_values[root, upper_vertex, slot, q]
                            loss = (0.5 * t_sum - SHARE * (parallel + mu_omega * torque[q])) * scale
                            loss += excess[slot, 3 + h]
                            loss = max(loss, 0.0)
                            t_bound[root, v, slot, q] += loss
                            t_bound[root, upper_vertex, slot, q] += loss


@njit(cache=True, inner=True, allocates=False)
def _least_vertex_value(
    problem: BranchProblem, workspace: BoundWorkspace, t_values: Array, count: int, constant: float, cut: float
) -> float:
    """Return the least D over the vertices; once it is under the cut, that over a part of them."""
    tree, loads, u_min, u_max = problem.tree, problem.loads, problem.u_min, problem.u_max
    first, parent = tree.first, tree.parent
    active, module_value, least_sum = workspace.active_cases, workspace.module_value, workspace.least_sum
    result = math.inf
    for root in range(len(workspace.root_y)):
        for i in range(len(parent)):
            for v in range(first[i], first[i + 1]):
                total = module_value[root, v]
                for slot in range(count):
                    weight, dead_rotor = loads.weight[active[slot]], loads.dead_rotor[active[slot]] - ROTORS * i
                    for q in range(ROTORS):
                        t = t_values[root, v, slot, q]
                        u = best_input(t, weight, u_min, u_max)
                        if q != dead_rotor:
                            total -= u * (t - weight * u)
                least_sum[v] = total
        for i in range(len(parent) - 1, 0, -1):
            h = parent[i]
            for v in range(first[h + 1] - first[h]):
                child_frame = first[i] + 2 * v
                least_sum[first[h] + v] += min(least_sum[child_frame], least_sum[child_frame + 1])
        result = min(result, constant + least_sum[0])
        if result < cut:
            break
    return result


@njit(cache=True, inner=True, allocates=False)
def _constant(problem: BranchProblem, y: Array, sigma: Array) -> float:
    """Return the terms of D that depend on no angle, less the allowances for the audit's tolerance and rounding."""
    total, loads, slack = 0.0, problem.loads, problem.slack
    a, b, c = residual(problem, y, sigma)
    for r in range(len(sigma)):
        total += sigma[r] * (problem.walls.offset[r] - slack.wall - slack.tip * CONDITION_ROUNDING)
    for k in range(len(y)):
        nu2, mu2 = 0.0, 0.0
        for l in range(3):
            total += loads.f[k, l] * y[k, l] + loads.t[k, l] * y[k, 3 + l]
            nu2 += y[k, l] ** 2
            mu2 += y[k, 3 + l] ** 2
        nu, mu = math.sqrt(nu2), math.sqrt(mu2)
        g = math.sqrt(loads.g[k, 0] ** 2 + loads.g[k, 1] ** 2 + loads.g[k, 2] ** 2)
        total -= slack.force[k] * nu + slack.torque[k] * mu + slack.tip * CONDITION_ROUNDING * g * mu
    return total - slack.tip * math.sqrt(a * a + b * b + c * c) - _rod_loss(problem.rod, y)


@njit(cache=True, inner=True, allocates=False)
def _rod_loss(rod: RodChange, y: Array) -> float:
    """Return the largest loss of D to the mass of a rod."""
    loss = 0.0
    for r in range(len(rod.levered)):
        a, b, c = lever_sum(rod.levered[r], y)
        loss += math.sqrt(a * a + b * b + c * c)
    for k in range(len(y)):
        for l in range(3):
            loss -= rod.force[k, l] * y[k, l] + rod.torque[k, l] * y[k, 3 + l]
    return max(loss, 0.0)


@njit(cache=True, inner=True, allocates=False)
def _fill_wall_sums(problem: BranchProblem, R: Array, sigma: Array, wall_sums: Array) -> None:
    """Fill the sums of sigma_r n_r in the root's frame."""
    walls = problem.walls
    wall_sums[:] = 0.0
    for r in range(len(sigma)):
        if sigma[r] > 0.0:
            x, y, z = sigma[r] * walls.normal[r, 0], sigma[r] * walls.normal[r, 1], sigma[r] * walls.normal[r, 2]
            wall_sum = wall_sums[walls.module[r], walls.end[r]]
            for l in range(3):
                wall_sum[l] += R[0, l] * x + R[1, l] * y + R[2, l] * z


@njit(cache=True, inner=True, allocates=False)
def _to_root(R: Array, x: float, y: float, z: float) -> Vector:
    """Return R^T of a vector."""
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@njit(cache=True, forceinline=True)
def _nu_about(nu: Vector, mu: Vector, c: Vector) -> Vector:
    """Return nu' = nu + mu x c."""
    return (
        nu[0] + mu[1] * c[2] - mu[2] * c[1],
        nu[1] + mu[2] * c[0] - mu[0] * c[2],
        nu[2] + mu[0] * c[1] - mu[1] * c[0],
    )


@njit(cache=True, inner=True, allocates=False)
def _fill_drifts(problem: BranchProblem, rho: Array, drift: Array) -> None:
    """Fill the largest displacements of the points of the axes in the box."""
    tree, between = problem.tree, problem.levers.between
    drift[:] = 0.0
    for i in range(1, len(tree.parent)):
        for level in range(2 + tree.depth[i]):
            b = tree.path[i, level]
            drift[i + 2] += rho[b] * between[b, i + 2]


@njit(cache=True, inner=True, allocates=False)
def add_rotor_gains(problem: BranchProblem, y: Array, box: BoxFrames, workspace: BoundWorkspace) -> None:
    """Add the rotors' part to `slope` and `loss` of a box after `bound`, evaluated at the middle."""
    u_min, u_max, R = problem.u_min, problem.u_max, box.roots[0]
    middle, axes, rho = box.middle, box.axes, box.rho
    slopes, losses = workspace.rotor_slopes, workspace.rotor_losses
    for k in range(len(y)):
        nu, mu = _to_root(R, y[k, 0], y[k, 1], y[k, 2]), _to_root(R, y[k, 3], y[k, 4], y[k, 5])
        weight = problem.loads.weight[k]
        if not is_active(problem, y, k):
            continue
        for i in range(len(middle.p)):
            path, path_length = problem.tree.path[i], problem.tree.depth[i] + 3
            x, y_, z, p = row(middle.x, i), row(middle.y, i), row(middle.z, i), row(middle.p, i)
            for level in range(path_length):
                a = path[level]
                omega, c = row(axes.omega, a), row(axes.c, a)
                f, T = _nu_about(nu, mu, c), cross(add(p, -1.0, c), z)
                mu_across, f_across = add(mu, -dot(mu, omega), omega), add(f, -dot(f, omega), omega)
                mu_turned, f_turned = cross(mu, omega), cross(f, omega)
                alpha, beta = dot(f_across, z) + dot(mu_across, T), dot(f_turned, z) + dot(mu_turned, T)
                versine, cubic = 1 - math.cos(rho[a]), CUBIC * rho[a] ** 3
                for q in range(ROTORS):
                    torque = problem.rotor_torques[q]
                    alpha_q = alpha + torque[0] * dot(mu_across, x)
                    alpha_q += torque[1] * dot(mu_across, y_) + torque[2] * dot(mu_across, z)
                    beta_q = beta + torque[0] * dot(mu_turned, x)
                    beta_q += torque[1] * dot(mu_turned, y_) + torque[2] * dot(mu_turned, z)
                    slopes[level, q] = SHARE * beta_q
                    losses[level, q] = SHARE * (max(alpha_q, 0.0) * versine + abs(beta_q) * cubic)
            force, mu_x, mu_y, mu_z = dot(_nu_about(nu, mu, p), z), dot(mu, x), dot(mu, y_), dot(mu, z)
            for q in range(ROTORS):
                torque = problem.rotor_torques[q]
                t = SHARE * (force + torque[0] * mu_x + torque[1] * mu_y + torque[2] * mu_z)
                for level in range(path_length):
                    t += losses[level, q]
                u = best_input(t, weight, u_min, u_max)
                if u > 0.0 and problem.loads.dead_rotor[k] != ROTORS * i + q:
                    for level in range(path_length):
                        workspace.slope[path[level]] -= u * slopes[level, q]
                        workspace.loss[path[level]] += u * losses[level, q]


@njit(cache=True, inner=True, allocates=False)
def _moment_loss(
    problem: BranchProblem,
    i: int,
    w: float,
    m: Vector,
    lever: Array,
    beyond: float,
    s: Vector,
    box: BoxFrames,
    workspace: BoundWorkspace,
) -> float:
    """Return the largest deficit of m . s under its interpolant, and add to `slope` and `loss`.

    m is the moment at the middle of a mass w that moves with module i; about axis a, |m| <= lever[a] + beyond.
    """
    path, path_length, axes, rho = problem.tree.path[i], problem.tree.depth[i] + 3, box.axes, box.rho
    size, total = math.sqrt(s[0] ** 2 + s[1] ** 2 + s[2] ** 2), 0.0
    for level in range(path_length):
        a = path[level]
        omega, d = row(axes.omega, a), add(m, -w, row(axes.c, a))
        alpha, beta = -dot(add(d, -dot(d, omega), omega), s), dot(cross(omega, d), s)
        excess = 0.0
        for other_level in range(path_length):
            if other_level != level:
                b = path[other_level]
                excess += rho[b] * size * (lever[a if other_level < level else b] + beyond)
        limit = size * (lever[a] + beyond)
        loss = max(0.0, min(alpha + excess, limit)) * (1 - math.cos(rho[a]))
        loss += min(abs(beta) + excess, limit) * CUBIC * rho[a] ** 3
        workspace.slope[a] += beta
        workspace.loss[a] += loss
        total += loss
    return total

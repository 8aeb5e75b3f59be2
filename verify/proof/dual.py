r"""A lower bound on the effort of all designs in a box of angles, by weak duality.

Take any multipliers y_k = (nu_k, mu_k) of force and torque, and a design whose audit is clear. Its rotors produce
b_k + r_k, with |r_k| as in `verify.proof.platform`, so

.. math::

    J \ge \sum_{j,k} \lambda_k u_{jk}^2 - \sum_k y_k \cdot (A u_k - b_k - r_k)
        + \sum_r \sigma_r (n_r \cdot (e_r - p'_E) + d_r) \ge
        \sum_k y_k \cdot b_k - |y_k| \cdot |r_k| - \sum_{j,k} \psi_k(a_j \cdot y_k)
        + \sum_r \sigma_r (n_r \cdot (e_r - p'_E) + d_r), \qquad
    \psi_k(t) = \max_{u_{min} - \tau \le u \le 1 + \tau} t u - \lambda_k u^2

with tau the audit's tolerance; for a dead rotor, -tau <= u <= tau. The ends e_r of envelopes stay within
half-spaces, so n_r . (e_r - p'_E) + d_r <= 0, and sigma_r >= 0. Load cases that must be possible but cost nothing
have lambda_k = 0. p'_E cancels under the condition sum_k g_k x mu_k = sum_r sigma_r n_r; a residual costs its
length times the greatest |p'_E|. psi is convex, and a_j . y, b . y and n_r . e_r are affine in the pair of each
angle (`verify.proof.arcs`), so the right-hand side is least at a combination of triangle vertices. The term of a
module depends only on the root and on the hinges of its path, so for each of the 27 combinations of the root, or 9
of a single psi, the minimum over the hinges is computed from the leaves of the tree inwards.

**No design at all.** If no load case counts (all lambda_k = 0), the left-hand side of a design is zero: a positive
bound shows that there is none in the box. So does any multiple of its multipliers.

**Rounding.** Vertices have a length of at most 1.44, and a frame is a product of at most n + 2 matrices whose
entries have errors of 4 eps (eps = 2^-53), each product one of 3 eps of the sums of magnitudes. So entries of R
have errors of less than 16 (n + 2) eps times gamma, the product of the vertices' lengths on the path (1 if boxes
are narrow; gamma <= 1.44^(n + 2)), those of B that times the longest lever L. A term of the sum, at most (|nu| + L
|mu|) u gamma, then has an error under 20 (n + 2) eps of that, and the sum of r n K of them one of r n K eps more.
With the sum of all magnitudes in `magnitude`, the error is under (20 (n + 2) + r n K + 10) eps magnitude gamma;
BOUND_ROUNDING covers the first two factors. It is over 5 times what 12 modules and n K = 20,000 need, and grows
with n K beyond.
"""

import math
from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, Flags
from topo_search.model.proven import TOLERANCE
from verify.proof.arcs import ArcFrames, fill_root_orientation
from verify.proof.platform import ROTORS, CheckProblem
from verify.proof.rod import rod_loss

BOUND_ROUNDING = 5e-11
"""Allowance for rounding of the bound, over the sum of all magnitudes."""
MAX_INVERSE_WEIGHT = 1e300
"""1 / (2 lambda) of a load case without weight: its rotors are at their least or greatest input."""


class DualWorkspace(NamedTuple):
    """Arrays for the bound of one box."""

    R: Array
    """Root orientation for each combination of its vertices, shape (roots, 3, 3)."""
    root_y: Array
    """Multipliers in the root's frame, shape (K, 6, roots)."""
    root_s: Array
    """`lever_force` in the root's frame, shape (3, roots)."""
    wall_sums: Array
    """sum_r sigma_r n_r and sum_r sigma_r distance_r n_r by module, in the root's frame, shape (n, 2, 3, roots)."""
    active: Flags
    """Load cases with a weight or multipliers; others add nothing; shape (K,)."""
    least_sum: Array
    """Least sum over a module and all modules beyond it, shape (frames, roots)."""


@njit(cache=True)
def bound_workspace(problem: CheckProblem, frame_count: int, roots: int = 27) -> DualWorkspace:
    """Return arrays for boxes with `frame_count` frames; the root has 9 combinations if psi is one angle."""
    K = len(problem.f)
    return DualWorkspace(
        np.zeros((roots, 3, 3)),
        np.zeros((K, 6, roots)),
        np.zeros((3, roots)),
        np.zeros((len(problem.parent), 2, 3, roots)),
        np.zeros(K, np.bool_),
        np.zeros((frame_count, roots)),
    )


@njit(cache=True, allocates=False)
def bound(
    problem: CheckProblem, y: Array, sigma: Array, triangles: Array, frames: ArcFrames, workspace: DualWorkspace
) -> float:
    """Return a lower bound on the effort of all designs in a box.

    Args:
        problem: task and tree.
        y: any multipliers of the load cases, shape (K, 6).
        sigma: any nonnegative multipliers of the walls, shape (W,).
        triangles: triangles of all angles, shape (A, 3, 2).
        frames: frames of all modules for each combination of the hinges' triangle vertices.
        workspace: arrays to compute in.
    """
    n, K = len(problem.parent), len(y)
    s = lever_force(problem, y)
    workspace.wall_sums[:] = 0.0
    for k in range(K):
        workspace.active[k] = problem.weight[k] > 0.0
        for l in range(6):
            workspace.active[k] |= y[k, l] != 0.0
    for choice in range(len(workspace.R)):
        R = workspace.R[choice]
        fill_root_orientation(triangles[0, choice // 9], triangles[1, choice // 3 % 3], triangles[2, choice % 3], R)
        for l in range(3):
            workspace.root_s[l, choice] = R[0, l] * s[0] + R[1, l] * s[1] + R[2, l] * s[2]
            for r in range(len(sigma)):
                x, y_, z = problem.wall_normal[r]
                root_normal = sigma[r] * (R[0, l] * x + R[1, l] * y_ + R[2, l] * z)
                workspace.wall_sums[problem.wall_module[r], 0, l, choice] += root_normal
                workspace.wall_sums[problem.wall_module[r], 1, l, choice] += problem.wall_distance[r] * root_normal
            for k in range(K):
                workspace.root_y[k, l, choice] = R[0, l] * y[k, 0] + R[1, l] * y[k, 1] + R[2, l] * y[k, 2]
                workspace.root_y[k, 3 + l, choice] = R[0, l] * y[k, 3] + R[1, l] * y[k, 4] + R[2, l] * y[k, 5]
    for i in range(n):
        for v in range(frames.first[i], frames.first[i + 1]):
            _fill_module(problem, frames, i, v, workspace)
    for i in range(n - 1, 0, -1):
        h = problem.parent[i]
        for v in range(frames.first[h + 1] - frames.first[h]):
            child_frame, parent_sum = frames.first[i] + 3 * v, workspace.least_sum[frames.first[h] + v]
            for choice in range(len(workspace.R)):
                minimum = min(
                    workspace.least_sum[child_frame, choice], workspace.least_sum[child_frame + 1, choice]
                )
                parent_sum[choice] += min(minimum, workspace.least_sum[child_frame + 2, choice])
    result = math.inf
    for choice in range(len(workspace.R)):
        result = min(result, workspace.least_sum[0, choice])
    return result + constant(problem, y, sigma) - rounding(problem, y, sigma, triangles)


@njit(cache=True, inner=True, allocates=False)
def _fill_module(problem: CheckProblem, frames: ArcFrames, i: int, v: int, workspace: DualWorkspace) -> None:
    """Fill the term of module i in one frame, for each combination of the root."""
    R, value, (w, a, b) = frames.R[v], workspace.least_sum[v], problem.bodies[i]
    Mx, My, Mz = frames.B[v, 0, 2], frames.B[v, 1, 2], frames.B[v, 2, 2]
    value[:] = 0.0
    for l in range(3):
        c = w * frames.p[v, l] + a * R[l, 0] + b * R[l, 1]
        for choice in range(len(workspace.R)):
            value[choice] += c * workspace.root_s[l, choice]
    if len(problem.wall_normal) > 0:
        for l in range(3):
            for choice in range(len(workspace.R)):
                value[choice] += frames.p[v, l] * workspace.wall_sums[i, 0, l, choice]
                value[choice] -= R[l, 2] * workspace.wall_sums[i, 1, l, choice]
    for k in range(len(workspace.root_y)):
        if not workspace.active[k]:
            continue
        y, weight = workspace.root_y[k], problem.weight[k]
        inverse_weight = 0.5 / weight if weight > 0.5 / MAX_INVERSE_WEIGHT else MAX_INVERSE_WEIGHT
        for q in range(ROTORS):
            low, high = problem.u_min - TOLERANCE, 1 + TOLERANCE
            if problem.dead_rotor[k] == ROTORS * i + q:
                low, high = -TOLERANCE, TOLERANCE
            ox, oy, oz = problem.rotor_torques[q]
            tx = Mx + R[0, 0] * ox + R[0, 1] * oy + R[0, 2] * oz
            ty = My + R[1, 0] * ox + R[1, 1] * oy + R[1, 2] * oz
            tz = Mz + R[2, 0] * ox + R[2, 1] * oy + R[2, 2] * oz
            fx, fy, fz = R[0, 2], R[1, 2], R[2, 2]
            for choice in range(len(workspace.R)):
                t = fx * y[0, choice] + fy * y[1, choice] + fz * y[2, choice]
                t += tx * y[3, choice] + ty * y[4, choice] + tz * y[5, choice]
                u = min(max(t * inverse_weight, low), high)
                value[choice] -= u * (t - weight * u)


@njit(cache=True, inner=True, allocates=False)
def lever_force(problem: CheckProblem, y: Array) -> tuple[float, float, float]:
    """Return sum_k h_k x mu_k, the factor of c in sum_k mu_k . (c x h_k)."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(len(y)):
        x, y_, z = problem.h[k]
        mx, my, mz = y[k, 3], y[k, 4], y[k, 5]
        a, b, c = a + y_ * mz - z * my, b + z * mx - x * mz, c + x * my - y_ * mx
    return a, b, c


@njit(cache=True, inner=True, allocates=False)
def constant(problem: CheckProblem, y: Array, sigma: Array) -> float:
    """Return the terms that depend on no angle, less the losses to the audit's tolerance and to p'_E."""
    total, (a, b, c) = 0.0, residual(problem, y, sigma)
    for r in range(len(sigma)):
        total += sigma[r] * problem.wall_offset[r]
    for k in range(len(y)):
        nu, mu = y[k, :3], y[k, 3:]
        for l in range(3):
            total += problem.f[k, l] * nu[l] + problem.t[k, l] * mu[l]
        total -= problem.force_error * _norm(nu) + problem.torque_error[k] * _norm(mu)
    return total - problem.max_tip_distance * math.sqrt(a * a + b * b + c * c) - rod_loss(problem.rod, y)


@njit(cache=True, allocates=False)
def residual(problem: CheckProblem, y: Array, sigma: Array) -> tuple[float, float, float]:
    """Return the residual of the condition, sum_k g_k x mu_k - sum_r sigma_r n_r: the factor of p'_E."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(len(y)):
        (x, y_, z), mu = problem.g[k], y[k, 3:]
        a, b, c = a + y_ * mu[2] - z * mu[1], b + z * mu[0] - x * mu[2], c + x * mu[1] - y_ * mu[0]
    for r in range(len(sigma)):
        x, y_, z = problem.wall_normal[r]
        a, b, c = a - sigma[r] * x, b - sigma[r] * y_, c - sigma[r] * z
    return a, b, c


@njit(cache=True, inner=True, allocates=False)
def rounding(problem: CheckProblem, y: Array, sigma: Array, triangles: Array) -> float:
    """Return the allowance for rounding."""
    n, magnitude, gamma, deepest = len(problem.parent), 0.0, 1.0, 0
    for a in range(len(triangles)):
        gamma *= max(1.0, math.hypot(triangles[a, 2, 0], triangles[a, 2, 1]))
    for i in range(n):
        deepest = max(deepest, problem.depth[i])
    lever = 2 * problem.l_c * deepest + 2
    for k in range(len(y)):
        nu, mu = _norm(y[k, :3]), _norm(y[k, 3:])
        magnitude += (_norm(problem.f[k]) + ROTORS * n * (1 + problem.weight[k])) * nu
        torque = _norm(problem.t[k]) + lever * (n * _norm(problem.h[k]) + ROTORS * n)
        magnitude += torque * mu + ROTORS * n * problem.weight[k]
        magnitude += problem.max_tip_distance * _norm(problem.g[k]) * mu * 1e-3
        magnitude += _norm(problem.rod.df[k]) * nu + problem.rod.magnitude[k] * mu
    for r in range(len(sigma)):
        length = lever + problem.wall_distance[r] + abs(problem.wall_offset[r]) + problem.max_tip_distance * 1e-3
        magnitude += sigma[r] * length
    return BOUND_ROUNDING * max(1.0, n * len(y) / 20_000) * magnitude * gamma


@njit(cache=True, inner=True, allocates=False)
def _norm(v: Array) -> float:
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])

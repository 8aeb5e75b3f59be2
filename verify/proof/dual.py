r"""A lower bound of the effort of all designs in a box of angles, by weak duality.

Take any multipliers y_k = (nu_k, mu_k) of force and torque, and a design that an audit calls clear. What its rotors
produce is b_k + r_k with |r_k| as `verify.proof.platform` says, so

.. math::

    J \ge \sum_{j,k} \lambda_k u_{jk}^2 - \sum_k y_k \cdot (A u_k - b_k - r_k)
        + \sum_r \sigma_r (n_r \cdot (e_r - p'_E) + d_r) \ge
        \sum_k y_k \cdot b_k - |y_k| \cdot |r_k| - \sum_{j,k} \psi_k(a_j \cdot y_k)
        + \sum_r \sigma_r (n_r \cdot (e_r - p'_E) + d_r), \qquad
    \psi_k(t) = \max_{u_{min} - \tau \le u \le 1 + \tau} t u - \lambda_k u^2

with tau the audit's tolerance; of a dead rotor, -tau <= u <= tau. The ends e_r of envelopes keep within
half-spaces, so that n_r . (e_r - p'_E) + d_r <= 0, and sigma_r >= 0. What must be possible but costs nothing has
lambda_k = 0. p'_E drops out where sum_k g_k x mu_k = sum_r sigma_r n_r; what is missed of that costs as much times
the farthest p'_E. psi is convex, a_j . y, b . y and n_r . e_r are affine in the pair of each angle
(`verify.proof.arcs`), so the right-hand side is least at a choice of corners. A module adds what depends on the
root and on the hinges of its path alone, so for each of the 27 choices of the root the least over the hinges is
found from the leaves of the tree inwards.

**Rounding.** Corners are at most 1.44, and a frame is a product of at most n + 2 matrices whose entries are off
by 4 eps (eps = 2^-53), each product by 3 eps of the sums of sizes: entries of R are off by less than 16 (n + 2)
eps times gamma, the product of the corners' sizes on the path (1 where boxes are narrow; gamma <= 1.44^(n + 2)),
those of B by that times the longest lever L. A term of the sum, (|nu| + L |mu|) u gamma at most, is then off by
under 20 (n + 2) eps of that, the sum of 4 n K of them by 4 n K eps more. With all magnitudes summed in `size`,
their rounding is under (20 (n + 2) + 4 n K + 10) eps size gamma; BOUND_ROUNDING stands for all but size and gamma,
which are taken as they are. It is over 5 times what 12 modules and n K = 20,000 need, and grows with n K beyond.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.model.compiled_code import njit
from topo_search.model.proven import TOLERANCE
from verify.bodies import Array
from verify.proof.arcs import Frames, root_turn
from verify.proof.platform import Numbers

BOUND_ROUNDING = 5e-11
"""Share of the sum of all magnitudes by which the bound may be wrong."""
CHOICES = 27
"""Number of the root's corners."""
STEEP = 1e300
"""1 / (2 lambda) of a case without weight: its rotors are at their least or greatest input."""


class Sums(NamedTuple):
    """Arrays for the bound of one box."""

    R: Array
    """The root for each choice of its corners, shape (27, 3, 3)."""
    y: Array
    """Multipliers seen from there, shape (K, 6, 27)."""
    s: Array
    """Weights of the modules' centres, seen from there, shape (3, 27)."""
    walls: Array
    """sum_r sigma_r n_r of every module, and so with sigma_r down_r, seen from there, shape (n, 2, 3, 27)."""
    active: NDArray[np.bool_]
    """Load cases that add anything, shape (K,)."""
    least: Array
    """Least sum of a module and all beyond it, shape (frames, 27)."""


@njit(cache=True)
def sums(numbers: Numbers, frames: int) -> Sums:
    """Return arrays for boxes of so many frames."""
    K = len(numbers.f)
    return Sums(
        np.zeros((CHOICES, 3, 3)),
        np.zeros((K, 6, CHOICES)),
        np.zeros((3, CHOICES)),
        np.zeros((len(numbers.parent), 2, 3, CHOICES)),
        np.zeros(K, np.bool_),
        np.zeros((frames, CHOICES)),
    )


@njit(cache=True, allocates=False)
def bound(numbers: Numbers, y: Array, sigma: Array, corners: Array, frames: Frames, work: Sums) -> float:
    """Return a lower bound of the effort of all designs in a box.

    Args:
        numbers: the task and the tree.
        y: any multipliers, shape (K, 6).
        sigma: any that are not negative, shape (W,).
        corners: of the angles, shape (A, 3, 2).
        frames: of all modules for each choice of the hinges' corners.
        work: arrays.
    """
    n, K = len(numbers.parent), len(y)
    s = lever_force(numbers, y)
    work.walls[:] = 0.0
    for k in range(K):
        work.active[k] = numbers.weight[k] > 0.0
        for l in range(6):
            work.active[k] |= y[k, l] != 0.0
    for choice in range(CHOICES):
        R = work.R[choice]
        root_turn(corners[0, choice // 9], corners[1, choice // 3 % 3], corners[2, choice % 3], R)
        for l in range(3):
            work.s[l, choice] = R[0, l] * s[0] + R[1, l] * s[1] + R[2, l] * s[2]
            for r in range(len(sigma)):
                x, y_, z = numbers.normal[r]
                seen = sigma[r] * (R[0, l] * x + R[1, l] * y_ + R[2, l] * z)
                work.walls[numbers.module[r], 0, l, choice] += seen
                work.walls[numbers.module[r], 1, l, choice] += numbers.down[r] * seen
            for k in range(K):
                work.y[k, l, choice] = R[0, l] * y[k, 0] + R[1, l] * y[k, 1] + R[2, l] * y[k, 2]
                work.y[k, 3 + l, choice] = R[0, l] * y[k, 3] + R[1, l] * y[k, 4] + R[2, l] * y[k, 5]
    for i in range(n):
        for v in range(frames.first[i], frames.first[i + 1]):
            _fill(numbers, frames, i, v, work)
    for i in range(n - 1, 0, -1):
        h = numbers.parent[i]
        for v in range(frames.first[h + 1] - frames.first[h]):
            at, into = frames.first[i] + 3 * v, work.least[frames.first[h] + v]
            for choice in range(CHOICES):
                least = min(work.least[at, choice], work.least[at + 1, choice])
                into[choice] += min(least, work.least[at + 2, choice])
    result = math.inf
    for choice in range(CHOICES):
        result = min(result, work.least[0, choice])
    return result + constant(numbers, y, sigma) - rounding(numbers, y, sigma, corners)


@njit(cache=True, allocates=False)
def _fill(numbers: Numbers, frames: Frames, i: int, v: int, work: Sums) -> None:
    """Fill what module i adds in one frame, for each choice of the root."""
    R, into, (w, a, b) = frames.R[v], work.least[v], numbers.bodies[i]
    Mx, My, Mz = frames.B[v, 0, 2], frames.B[v, 1, 2], frames.B[v, 2, 2]
    into[:] = 0.0
    for l in range(3):
        c = w * frames.p[v, l] + a * R[l, 0] + b * R[l, 1]
        for choice in range(CHOICES):
            into[choice] += c * work.s[l, choice]
    if len(numbers.normal) > 0:
        for l in range(3):
            for choice in range(CHOICES):
                into[choice] += frames.p[v, l] * work.walls[i, 0, l, choice]
                into[choice] -= R[l, 2] * work.walls[i, 1, l, choice]
    for k in range(len(work.y)):
        if not work.active[k]:
            continue
        y, weight = work.y[k], numbers.weight[k]
        steep = 0.5 / weight if weight > 0.5 / STEEP else STEEP
        for q in range(4):
            low, high = numbers.u_min - TOLERANCE, 1 + TOLERANCE
            if numbers.dead[k] == 4 * i + q:
                low, high = -TOLERANCE, TOLERANCE
            ox, oy, oz = numbers.torques[q]
            tx = Mx + R[0, 0] * ox + R[0, 1] * oy + R[0, 2] * oz
            ty = My + R[1, 0] * ox + R[1, 1] * oy + R[1, 2] * oz
            tz = Mz + R[2, 0] * ox + R[2, 1] * oy + R[2, 2] * oz
            fx, fy, fz = R[0, 2], R[1, 2], R[2, 2]
            for choice in range(CHOICES):
                t = fx * y[0, choice] + fy * y[1, choice] + fz * y[2, choice]
                t += tx * y[3, choice] + ty * y[4, choice] + tz * y[5, choice]
                u = min(max(t * steep, low), high)
                into[choice] -= u * (t - weight * u)


@njit(cache=True, allocates=False)
def lever_force(numbers: Numbers, y: Array) -> tuple[float, float, float]:
    """Return sum_k h_k x mu_k: what mu . (c x h) is in c."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(len(y)):
        x, y_, z = numbers.h[k]
        mx, my, mz = y[k, 3], y[k, 4], y[k, 5]
        a, b, c = a + y_ * mz - z * my, b + z * mx - x * mz, c + x * my - y_ * mx
    return a, b, c


@njit(cache=True, allocates=False)
def constant(numbers: Numbers, y: Array, sigma: Array) -> float:
    """Return what no angle changes: the loads' part, less what the audit lets pass and what p'_E may bring."""
    total, (a, b, c) = 0.0, residual(numbers, y, sigma)
    for r in range(len(sigma)):
        total += sigma[r] * numbers.beyond[r]
    for k in range(len(y)):
        nu, mu = y[k, :3], y[k, 3:]
        for l in range(3):
            total += numbers.f[k, l] * nu[l] + numbers.t[k, l] * mu[l]
        total -= numbers.force_off * _size(nu) + numbers.torque_off[k] * _size(mu)
    return total - numbers.reach * math.sqrt(a * a + b * b + c * c)


@njit(cache=True, allocates=False)
def residual(numbers: Numbers, y: Array, sigma: Array) -> tuple[float, float, float]:
    """Return sum_k g_k x mu_k - sum_r sigma_r n_r, the factor of p'_E."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(len(y)):
        (x, y_, z), mu = numbers.g[k], y[k, 3:]
        a, b, c = a + y_ * mu[2] - z * mu[1], b + z * mu[0] - x * mu[2], c + x * mu[1] - y_ * mu[0]
    for r in range(len(sigma)):
        x, y_, z = numbers.normal[r]
        a, b, c = a - sigma[r] * x, b - sigma[r] * y_, c - sigma[r] * z
    return a, b, c


@njit(cache=True, allocates=False)
def rounding(numbers: Numbers, y: Array, sigma: Array, corners: Array) -> float:
    """Return the allowance for rounding."""
    n, size, gamma, deepest = len(numbers.parent), 0.0, 1.0, 0
    for a in range(len(corners)):
        gamma *= max(1.0, math.hypot(corners[a, 2, 0], corners[a, 2, 1]))
    for i in range(n):
        deepest = max(deepest, numbers.depth[i])
    lever = 2 * numbers.l_c * deepest + 2
    for k in range(len(y)):
        nu, mu = _size(y[k, :3]), _size(y[k, 3:])
        size += (_size(numbers.f[k]) + 4 * n * (1 + numbers.weight[k])) * nu
        size += (_size(numbers.t[k]) + lever * (n * _size(numbers.h[k]) + 4 * n)) * mu + 4 * n * numbers.weight[k]
        size += numbers.reach * _size(numbers.g[k]) * mu * 1e-3
    for r in range(len(sigma)):
        size += sigma[r] * (lever + numbers.down[r] + abs(numbers.beyond[r]) + numbers.reach * 1e-3)
    return BOUND_ROUNDING * max(1.0, n * len(y) / 20_000) * size * gamma


@njit(cache=True, allocates=False)
def _size(v: Array) -> float:
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])

r"""Exact clearances in closed form.

| symbol | meaning | shape |
|---|---|---|
| P_A(eta), r_A(eta); P_B(gamma), r_B(gamma) | balls of two cone-spheres, eta and gamma in [0, 1] | (3,), scalar |
| w | o_A - o_B | (N, 3) |
| M | [d_A, -d_B], so that P_A - P_B = w + M x with x = (eta, gamma) | (N, 3, 2) |
| c | (dr_A, dr_B) | (N, 2) |
| d | min over the unit square of |w + M x| - c.x - r_A - r_B | (N,) |

The function is convex in x (a norm of an affine map, minus an affine map). Its minimum over the square is
stationary inside, or the minimum over one of the four edges; when the axes are parallel or the function has no
stationary point, it is on an edge. With M = Q U (Q orthonormal, U upper triangular), y = U^-T c and h the part
of w outside the span of Q, the stationary point exists for |y| < 1:

.. math:: x = U^{-1} (\rho y - Q^T w), \qquad \rho = h / \sqrt{1 - |y|^2}
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from verify.bodies import Cone, ConeSphere, Rows, nearest_on_axis

Array = NDArray[np.float64]


class Nearest(NamedTuple):
    """The clearances of N pairs of cone-spheres, and where they are attained."""

    d: Array
    """Signed clearance, positive when clear, shape (N,)."""
    eta: Array
    """Position on the first axis, shape (N,)."""
    gamma: Array
    """Position on the second axis, shape (N,)."""


def clearances(pairs: Sequence[tuple[ConeSphere, ConeSphere]]) -> Nearest:
    """Return the exact signed clearance of every pair: the least distance of two balls' surfaces."""
    A, B = (Rows.of([pair[side] for pair in pairs]) for side in (0, 1))
    return clearances_of(A, B)


def clearances_of(A: Rows, B: Rows) -> Nearest:
    """Return the exact signed clearance of every row of the one from that of the other."""
    (o_A, d_A, r_A, dr_A), (o_B, d_B, r_B, dr_B) = A, B
    w = o_A - o_B
    candidates = [
        *((nearest_on_axis(w - gamma * d_B, d_A, dr_A), np.full_like(r_A, gamma)) for gamma in (0.0, 1.0)),
        *((np.full_like(r_A, eta), nearest_on_axis(-w - eta * d_A, d_B, dr_B)) for eta in (0.0, 1.0)),
        _stationary(w, d_A, d_B, dr_A, dr_B),
    ]
    eta = np.stack([candidate[0] for candidate in candidates])
    gamma = np.stack([candidate[1] for candidate in candidates])
    apart = np.linalg.norm(w + eta[..., None] * d_A - gamma[..., None] * d_B, axis=-1)
    d = apart - (r_A + eta * dr_A) - (r_B + gamma * dr_B)
    best = np.argmin(d, axis=0), np.arange(len(r_A))
    return Nearest(d[best], eta[best], gamma[best])


def _stationary(w: Array, d_A: Array, d_B: Array, dr_A: Array, dr_B: Array) -> tuple[Array, Array]:
    """Return the stationary point inside the square; where there is none, some point of the square."""
    L = np.linalg.norm(d_A, axis=-1)
    q_1 = d_A / np.where(L > 0, L, 1.0)[:, None]
    m = -np.sum(q_1 * d_B, axis=-1)
    v = -d_B - m[:, None] * q_1
    v -= np.sum(q_1 * v, axis=-1)[:, None] * q_1  # once more: nearly parallel axes lose all digits otherwise
    n = np.linalg.norm(v, axis=-1)
    spans = (L > 0) & (n > 0)
    L, n = np.where(spans, L, 1.0), np.where(spans, n, 1.0)
    q_2 = v / n[:, None]
    y_1 = dr_A / L
    y_2 = (dr_B - m * y_1) / n
    k = y_1 * y_1 + y_2 * y_2
    exists = spans & (k < 1)
    w_1, w_2 = np.sum(q_1 * w, axis=-1), np.sum(q_2 * w, axis=-1)
    h = np.linalg.norm(w - w_1[:, None] * q_1 - w_2[:, None] * q_2, axis=-1)
    rho = h / np.sqrt(np.where(exists, 1.0 - k, 1.0))
    gamma = (rho * y_2 - w_2) / n
    eta = (rho * y_1 - w_1 - m * gamma) / L
    return np.where(exists, np.clip(eta, 0.0, 1.0), 0.0), np.where(exists, np.clip(gamma, 0.0, 1.0), 0.0)


def cone_clearance(body: ConeSphere, cone: Cone) -> tuple[float, float]:
    """Return the exact clearance of a cone-sphere from a cone's surface, and the end ball that attains it.

    s is concave along the axis and the radius linear, so the least s - r is at an end (paper, Sec. III-D).

    Returns:
        The least s - r over both end balls, and its eta, 0 or 1.
    """
    gaps = cone.s(np.stack([body.centre(0.0), body.centre(1.0)])) - np.array([body.radius(0.0), body.radius(1.0)])
    worst = int(np.argmin(gaps))
    return float(gaps[worst]), float(worst)

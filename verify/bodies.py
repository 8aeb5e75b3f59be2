r"""Cone-spheres and cones, and their exact clearances in closed form.

| symbol | meaning | shape |
|---|---|---|
| K | cone-sphere: union of the balls B(P(eta), r(eta)), eta in [0, 1] | |
| P(eta) = o + eta d, r(eta) = r + eta dr | centre and radius of a ball | (3,), scalar |
| h_K(u) | support function, the largest u.x over K, for any vector u | |
| apex, d, theta | infinite cone: apex, unit axis into the cone, half-angle in (0, pi/2] | (3,), (3,), scalar |
| s(x) | (d.q) sin(theta) - |q - (d.q) d| cos(theta), q = x - apex: distance to the cone's surface, > 0 inside | |

A capsule has dr = 0, a ball also d = 0. Lengths are in l_arm, in any one frame.

| symbol | meaning | shape |
|---|---|---|
| P_A(eta), r_A(eta); P_B(gamma), r_B(gamma) | balls of two cone-spheres, eta and gamma in [0, 1] | (3,), scalar |
| w | o_A - o_B | (N, 3) |
| M | [d_A, -d_B], so that P_A - P_B = w + M x with x = (eta, gamma) | (N, 3, 2) |
| c | (dr_A, dr_B) | (N, 2) |
| d | min over the unit square of |w + M x| - c.x - r_A - r_B | (N,) |

The function is convex in x (a norm of an affine map minus an affine map). Its minimum over the square is either a
stationary point inside or the minimum over one of the four edges; if the axes are parallel or there is no
stationary point, it is on an edge. With M = Q U (Q orthonormal, U upper triangular), y = U^-T c and h the length of
the part of w orthogonal to Q, the stationary point exists for |y| < 1:

.. math:: x = U^{-1} (\rho y - Q^T w), \qquad \rho = h / \sqrt{1 - |y|^2}
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from topo_search.model import Array, Indices


def norms(v: Array) -> Array:
    """Return the lengths of vectors along the last axis, shape (..., k) to (...)."""
    return np.asarray(np.sqrt(np.add.reduce(v * v, axis=-1)))


def nearest_on_axis(w: Array, d: Array, dr: Array | float) -> Array:
    """Return the eta in [0, 1] that minimises |w + eta d| - eta dr, in closed form, shape (...).

    The function is convex. If L = |d| > dr, its stationary point is t + h dr / (L sqrt(L^2 - dr^2)), where the line
    passes the origin at eta = t and distance h. If L <= dr, the function never increases.

    Args:
        w: start of the axis, shape (..., 3).
        d: axis vector, shape (..., 3).
        dr: growth of the radius, >= 0, shape (...).
    """
    L2 = np.sum(d * d, axis=-1)
    L = np.sqrt(L2)
    steep = np.asarray(dr) >= L
    t = -np.sum(w * d, axis=-1) / np.where(steep, 1.0, L2)
    h = norms(w + t[..., None] * d)
    slope = np.asarray(dr) / np.where(steep, 1.0, L * np.sqrt(np.where(steep, 1.0, (L - dr) * (L + dr))))
    return np.where(steep, 1.0, np.clip(t + h * slope, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class ConeSphere:
    """A ball swept along a segment while its radius grows linearly (paper, Sec. III-A)."""

    o: Array
    """Centre of the first ball, shape (3,)."""
    d: Array
    """Vector from the first to the last ball's centre, shape (3,)."""
    r: Any
    """Radius of the first ball, > 0."""
    dr: Any
    """Growth of the radius, >= 0."""

    @property
    def extent(self) -> float:
        """Upper bound on half the diameter."""
        return float(np.linalg.norm(self.d) + self.r + self.dr)

    def centre(self, eta: Any) -> Array:
        """Return P(eta), shape (3,)."""
        return np.asarray(self.o + np.expand_dims(eta, -1) * self.d)

    def radius(self, eta: Any) -> Any:
        """Return r(eta)."""
        return self.r + eta * self.dr

    def move(self, shift: Array) -> ConeSphere:
        """Return a copy translated by `shift`, shape (3,)."""
        return replace(self, o=self.o + shift)

    def cut(self, etas: Sequence[float]) -> list[ConeSphere]:
        """Return the pieces between successive etas."""
        return [
            ConeSphere(self.centre(low), (high - low) * self.d, self.radius(low), (high - low) * self.dr)
            for low, high in pairwise(etas)
        ]

    def support(self, u: Array) -> Array:
        """Return h_K(u) for vectors u of any length, shape (..., 3) to (...)."""
        length = norms(u)
        first = u @ self.o + self.r * length
        return np.asarray(np.maximum(first, first + u @ self.d + self.dr * length))

    def depth(self, x: Array) -> Array:
        """Return the largest depth of points inside any of the balls, shape (..., 3) to (...); negative outside."""
        w = self.o - x
        eta = nearest_on_axis(w, np.broadcast_to(self.d, w.shape), self.dr)
        return np.asarray(self.radius(eta) - norms(w + eta[..., None] * self.d))


class ConeSpheres(ConeSphere):
    """A batch of N cone-spheres, one per row; its methods take one point or parameter per row."""

    @classmethod
    def of(cls, bodies: Sequence[ConeSphere]) -> Self:
        """Stack cone-spheres into a batch."""
        o, d = (np.array([getattr(body, name) for body in bodies]).reshape(-1, 3) for name in ("o", "d"))
        r, dr = (np.array([getattr(body, name) for body in bodies]) for name in ("r", "dr"))
        return cls(o, d, r, dr)

    def take(self, index: Indices) -> ConeSpheres:
        """Return the rows `index`."""
        return ConeSpheres(self.o[index], self.d[index], self.r[index], self.dr[index])

    def extents(self, u: Array) -> Array:
        """Return the largest u.x of both end balls, unit u (N, 3), shape (N, 2)."""
        first = np.einsum("nx,nx->n", self.o, u)
        last = first + np.einsum("nx,nx->n", self.d, u)
        return np.stack([first + self.r, last + (self.r + self.dr)], axis=1)


def ball(centre: Array, radius: float) -> ConeSphere:
    """Return a ball as a cone-sphere."""
    return ConeSphere(centre, np.zeros(3), radius, 0.0)


@dataclass(frozen=True, eq=False)
class AllowedCone:
    """The infinite cone that airflow may fill; a half-space if theta is 90 degrees."""

    apex: Array
    axis: Array
    """Unit vector from the apex into the cone, shape (3,)."""
    half_angle_deg: float
    """theta in the task's unit [deg], so that sine and cosine are exact at 90."""

    @property
    def sin_cos(self) -> tuple[float, float]:
        """Sine and cosine of theta."""
        if self.half_angle_deg == 90.0:
            return 1.0, 0.0
        theta = math.radians(self.half_angle_deg)
        return math.sin(theta), math.cos(theta)

    def s(self, x: Array) -> Array:
        """Return s of points, shape (..., 3) to (...); positive inside."""
        sin, cos = self.sin_cos
        q = x - self.apex
        along = q @ self.axis
        across = q - along[..., None] * self.axis
        return np.asarray(along * sin - norms(across) * cos)

    def direction_across(self, x: Array) -> Array:
        """Return the unit vectors from the axis towards points, perpendicular to the axis, shape (..., 3)."""
        q = x - self.apex
        across = q - (q @ self.axis)[..., None] * self.axis
        rho = np.linalg.norm(across, axis=-1, keepdims=True)
        on_axis = rho <= 1e-12 * np.linalg.norm(q, axis=-1, keepdims=True)  # any direction will do
        across = across - (across @ self.axis)[..., None] * self.axis
        length = np.linalg.norm(across, axis=-1, keepdims=True)
        return np.where(on_axis, basis_across(self.axis)[0], across / np.where(on_axis, 1.0, length))

    def inward_normal(self, x: Array) -> Array:
        """Return unit normals m of the supporting half-spaces m.(y - apex) >= 0 nearest to points, (..., 3)."""
        sin, cos = self.sin_cos
        return self.axis * sin - self.direction_across(x) * cos


def basis_across(axis: Array) -> tuple[Array, Array]:
    """Return two unit vectors that complete a unit vector to a right-handed orthonormal basis."""
    e_1 = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    e_1 /= np.linalg.norm(e_1)
    return e_1, np.cross(axis, e_1)


class NearestOnAxes(NamedTuple):
    """Clearances of N pairs of cone-spheres and the axis parameters that attain them."""

    d: Array
    """Signed clearance, positive when clear, shape (N,)."""
    eta: Array
    """Position on the first axis, shape (N,)."""
    gamma: Array
    """Position on the second axis, shape (N,)."""


def clearances(pairs: Sequence[tuple[ConeSphere, ConeSphere]]) -> NearestOnAxes:
    """Return the exact signed clearance of every pair."""
    A, B = (ConeSpheres.of([pair[side] for pair in pairs]) for side in (0, 1))
    return rowwise_clearances(A, B)


def rowwise_clearances(A: ConeSpheres, B: ConeSpheres) -> NearestOnAxes:
    """Return the exact signed clearance between corresponding rows of two batches."""
    w, ends, (first, last) = A.o - B.o, np.array([[[0.0]], [[1.0]]]), np.broadcast_to([[0.0], [1.0]], (2, len(A.r)))
    starts = np.concatenate([w - ends * B.d, -w - ends * A.d])
    from_end = nearest_on_axis(starts, np.array([A.d, A.d, B.d, B.d]), np.array([A.dr, A.dr, B.dr, B.dr]))
    inner_eta, inner_gamma = _stationary(w, A.d, B.d, A.dr, B.dr)
    eta = np.array([*from_end[:2], first, last, inner_eta])
    gamma = np.array([first, last, *from_end[2:], inner_gamma])
    distance = norms(w + eta[..., None] * A.d - gamma[..., None] * B.d)
    d = distance - A.radius(eta) - B.radius(gamma)
    best = np.argmin(d, axis=0), np.arange(len(A.r))
    return NearestOnAxes(d[best], eta[best], gamma[best])


def _stationary(w: Array, d_A: Array, d_B: Array, dr_A: Array, dr_B: Array) -> tuple[Array, Array]:
    """Return the stationary point clipped to the square, or the origin if there is none."""
    L = norms(d_A)
    q_1 = d_A / np.where(L > 0, L, 1.0)[:, None]
    m = -np.sum(q_1 * d_B, axis=-1)
    v = -d_B - m[:, None] * q_1
    v -= np.sum(q_1 * v, axis=-1)[:, None] * q_1  # orthogonalise twice: nearly parallel axes lose all digits
    n = norms(v)
    spans = (L > 0) & (n > 0)
    L, n = np.where(spans, L, 1.0), np.where(spans, n, 1.0)
    q_2 = v / n[:, None]
    y_1 = dr_A / L
    y_2 = (dr_B - m * y_1) / n
    k = y_1 * y_1 + y_2 * y_2
    exists = spans & (k < 1)
    w_1, w_2 = np.sum(q_1 * w, axis=-1), np.sum(q_2 * w, axis=-1)
    h = norms(w - w_1[:, None] * q_1 - w_2[:, None] * q_2)
    rho = h / np.sqrt(np.where(exists, 1.0 - k, 1.0))
    gamma = (rho * y_2 - w_2) / n
    eta = (rho * y_1 - w_1 - m * gamma) / L
    return np.where(exists, np.clip(eta, 0.0, 1.0), 0.0), np.where(exists, np.clip(gamma, 0.0, 1.0), 0.0)


def cone_clearance(body: ConeSphere, cone: AllowedCone) -> tuple[float, float]:
    """Return the exact clearance of a cone-sphere from a cone's surface, and the eta of the ball that attains it.

    s is concave along the axis and the radius linear, so the minimum of s - r is at an end ball (paper, Sec.
    III-D).
    """
    gaps = cone.s(np.stack([body.centre(0.0), body.centre(1.0)])) - np.array([body.radius(0.0), body.radius(1.0)])
    worst = int(np.argmin(gaps))
    return float(gaps[worst]), float(worst)

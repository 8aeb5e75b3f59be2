"""Smooth clearance of two swept balls: airflow envelopes, capsules, a ball (paper, Sec. III-A to III-C).

| symbol | meaning | unit |
|---|---|---|
| P(eta) = o + eta d, r(eta) = r_0 + eta dr | axis and radius of a cone-sphere, eta in [0, 1] | l_arm |
| w_0 = o_i - o_j | | l_arm |
| f(eta, gamma) = ||P_i - P_j||^2 - (r_i + r_j)^2 | squared-length clearance (paper, Eq. f_air) | l_arm^2 |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from nlp.symbols.smooth import EPSILON, log_sum_exp, smooth_clamp


@dataclass(frozen=True)
class ConeSphere:
    """A ball swept along a segment with linearly growing radius."""

    o: ca.SX
    d: ca.SX
    r_0: float
    dr: float = 0.0

    @property
    def end_radius(self) -> float:
        """Radius at eta = 1."""
        return self.r_0 + self.dr


@dataclass(frozen=True)
class Ball:
    """A single ball."""

    o: ca.SX
    end_radius: float


def clearance(one: ConeSphere, other: ConeSphere | Ball, beta: ca.SX) -> ca.SX:
    """Return the smooth clearance, in l_arm near contact.

    The log-sum-exp of f over the KKT candidates is an area; divided by twice the sum of the end radii it is a
    length, above the true clearance c > 0 by c^2 / (2 sum) at most and equal to it at contact.
    """
    f = _against_ball(one, other) if isinstance(other, Ball) else _against_segment(one, other)
    return as_length(f, one.end_radius + other.end_radius, beta)


def as_length(f: Sequence[ca.SX], R: float, beta: ca.SX) -> ca.SX:
    """Return the log-sum-exp of squares over 2 R; sharper where R is small, or it would ask for too much."""
    return log_sum_exp(f, beta * ca.fmax(1.0, 1 / (2 * R))) / (2 * R)


def clearance_of_all(one: ConeSphere, balls: Sequence[Ball], beta: ca.SX) -> ca.SX:
    """Return the smooth clearance of some balls together, in l_arm near contact.

    Every ball's f counts as the length that it is near contact, times twice the sum of the first one's radii.
    """
    scale = one.end_radius + balls[0].end_radius
    scaled = [scale / (one.end_radius + ball.end_radius) * f for ball in balls for f in _against_ball(one, ball)]
    return log_sum_exp(scaled, beta) / (2 * scale)


def _against_ball(one: ConeSphere, ball: Ball) -> list[ca.SX]:
    """Return f at its three KKT candidates: the stationary point and both ends."""
    w_0, r_0 = one.o - ball.o, one.r_0 + ball.end_radius
    A = ca.dot(one.d, one.d) - one.dr**2
    D = 2 * ca.dot(one.d, w_0) - 2 * r_0 * one.dr
    F = ca.dot(w_0, w_0) - r_0**2
    eta = smooth_clamp(-D * A / (2 * A**2 + EPSILON))
    return [A * eta**2 + D * eta + F, F, A + D + F]


def _against_segment(one: ConeSphere, other: ConeSphere) -> list[ca.SX]:
    """Return f at its nine KKT candidates, from the coefficients of the paper's Eq. (f_air)."""
    d_i, d_j = one.d, other.d
    w_0, r_0 = one.o - other.o, one.r_0 + other.r_0
    A = ca.dot(d_i, d_i) - one.dr**2
    B = ca.dot(d_j, d_j) - other.dr**2
    C = -2 * (ca.dot(d_i, d_j) + one.dr * other.dr)
    D = 2 * ca.dot(d_i, w_0) - 2 * r_0 * one.dr
    E = -2 * ca.dot(d_j, w_0) - 2 * r_0 * other.dr
    F = ca.dot(w_0, w_0) - r_0**2
    return quadratic_candidates(A, B, C, D, E, F)


def quadratic_candidates(
    A: ca.SX | float, B: ca.SX | float, C: ca.SX, D: ca.SX, E: ca.SX, F: ca.SX | float
) -> list[ca.SX]:
    """Return f = A eta^2 + B gamma^2 + C eta gamma + D eta + E gamma + F at the KKT candidates of its minimum.

    They are the stationary point, one point on each edge of [0, 1]^2, and the corners.
    """
    f_det = 4 * A * B - C**2
    ends = (0.0, 1.0)

    def f(eta: ca.SX | float, gamma: ca.SX | float) -> ca.SX:
        return A * eta**2 + B * gamma**2 + C * eta * gamma + D * eta + E * gamma + F

    eta_0 = smooth_clamp((C * E - 2 * B * D) * f_det / (f_det**2 + EPSILON))
    gamma_0 = smooth_clamp((C * D - 2 * A * E) * f_det / (f_det**2 + EPSILON))
    gamma_1 = {eta_1: smooth_clamp(-(C * eta_1 + E) * B / (2 * B**2 + EPSILON)) for eta_1 in ends}
    eta_2 = {gamma_2: smooth_clamp(-(C * gamma_2 + D) * A / (2 * A**2 + EPSILON)) for gamma_2 in ends}
    return [
        f(eta_0, gamma_0),
        *(f(eta_1, gamma_1[eta_1]) for eta_1 in ends),
        *(f(eta_2[gamma_2], gamma_2) for gamma_2 in ends),
        *(f(eta, gamma) for eta in ends for gamma in ends),
    ]

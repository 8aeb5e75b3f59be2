"""Smooth stand-ins for min, max and the minimum over a few values (paper, Sec. III-A)."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

EPSILON = 1e-6
"""Regularisation of the clamps and of the stationary points; dimensionless."""


def smooth_max(a: ca.SX | float, b: ca.SX | float) -> ca.SX:
    """Return max(a, b), over by sqrt(epsilon)/2 at most."""
    return 0.5 * (a + b + ca.sqrt((a - b) ** 2 + EPSILON))


def smooth_min(a: ca.SX | float, b: ca.SX | float) -> ca.SX:
    """Return min(a, b), under by sqrt(epsilon)/2 at most."""
    return 0.5 * (a + b - ca.sqrt((a - b) ** 2 + EPSILON))


def smooth_clamp(value: ca.SX) -> ca.SX:
    """Return the value bounded to [0, 1]."""
    return smooth_max(0.0, smooth_min(1.0, value))


def log_sum_exp(values: Sequence[ca.SX], beta: float | ca.SX) -> ca.SX:
    """LSE_beta (paper, Eq. lse_def): at most the least value, at least that minus log(count)/beta.

    The least value is taken out before exp, so that nothing overflows; the result does not change.
    """
    least = values[0]
    for value in values[1:]:
        least = ca.fmin(least, value)
    total = sum(ca.exp(-beta * (value - least)) for value in values)
    return least - ca.log(total) / beta

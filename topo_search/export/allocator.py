r"""Thrusts for a wanted wrench: the bounded least squares of one platform, without other libraries.

.. math::

    \min_T \| T - T_0 \| \quad \text{of all } T_{min} \le T \le T_{max} \text{ with least } \| S (w - B T) \|

| symbol | meaning | shape | unit |
|---|---|---|---|
| w | wrench to exert on the platform: force, then torque about the centre of mass | (6,) | N, N m |
| B | `MATRIX`: wrench by thrusts | (6, N) | N and N m per N |
| T; T_0; T_min, T_max | thrusts; preferred ones; limits | (N,) | N |
| S | `SCALE`: what a missing newton or newton metre counts | (6,) | 1/N, 1/(N m) |

Axes are the platform's, in level flight those of the task: x forward, y left, z up. (PX4 has y right and z down:
turn the signs of y and z of force and torque.) Rotors count from 0 as in `rotors.csv`, rotor q of module i is
column 4 i + q; motors of PX4 count from 1.

    from allocator import LARGEST, WEIGHT, allocate

    thrusts, missed = allocate((0, 0, WEIGHT, 0, 0, 0))  # hover
    largest = list(LARGEST)
    largest[5] = 0.0  # rotor 5 is dead
    thrusts, missed = allocate((1.5, 0, WEIGHT, 0, 0, 0.1), preferred=thrusts, largest=largest)

Rotor j turns at sqrt(thrusts[j] / THRUST_COEFFICIENT) rad/s. A wrench within reach is exerted to rounding; of any
other the nearest is, and `missed` says what is missing. Equal arguments give equal answers; the number of steps is
bounded, and whatever happens thrusts are within their limits. Python 3.10 or later.

Method: each round moves six multipliers mu_k to the maximum of a dual, and raises rho; the best round counts.

.. math:: \mu \cdot S w - \frac{\| \mu - \mu_k \|^2}{2 \rho} - \sum_j h_j((S B)_j \cdot \mu),
    \qquad h_j'(v) = \mathrm{clip}(T_{0j} + v, T_{min,j}, T_{max,j})

It is concave and piecewise quadratic: Newton's method with an exact line search ends in finitely many steps. A step
of mu is rho S (w - B T), so that it stops once nothing is missing. Inside, thrusts are shares of `FULL`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, inf, isfinite

PLATFORM: str = ""
"""Task and topology."""
NAMES: tuple[str, ...] = ()
"""Rotors, in the order of the columns."""
MATRIX: tuple[tuple[float, ...], ...] = ((),) * 6
"""B."""
LEAST: tuple[float, ...] = ()
"""T_min [N]."""
LARGEST: tuple[float, ...] = ()
"""T_max [N]."""
SCALE: tuple[float, ...] = (1.0,) * 6
"""S."""
FULL: float = 1.0
"""Thrust of a rotor at its largest speed [N]."""
WEIGHT: float = 0.0
"""The platform's weight [N]."""
THRUST_COEFFICIENT: float = 1.0
"""k_f [N s^2]."""

PRICES = (1e4, 1e6, 1e8, 1e10, 1e12, 1e12)
"""rho of each round. Most wrenches need two or three; at the very edge of the reach multipliers are large."""
STEPS = 60
"""Largest number of Newton steps in a round; all rounds together take about eight."""
ACCURACY = 1e-12
"""Gain that ends the rounds: in size of the scaled missing wrench, over 1 + the largest component of S w."""
ROUNDING = 1e-16
"""Size of a gradient that is zero, but for rounding."""

COLUMNS = [[s * row[j] * FULL for s, row in zip(SCALE, MATRIX, strict=True)] for j in range(len(NAMES))]
"""Those of S B, for thrusts as shares of `FULL`."""


def allocate(
    wrench: Sequence[float],
    preferred: Sequence[float] = LEAST,
    least: Sequence[float] = LEAST,
    largest: Sequence[float] = LARGEST,
) -> tuple[list[float], list[float]]:
    """Return thrusts [N], a number per rotor, and what they miss of the wrench, (6,) [N, N m].

    Args:
        wrench: force, then torque about the centre of mass, (6,) [N, N m].
        preferred: thrusts to be near to, for instance the last ones, so that motors change little [N].
        least: lower limits [N]; where one is above the upper limit, that one holds.
        largest: upper limits [N]; 0 for a dead rotor.

    Raises:
        ValueError: a sequence has a wrong length, or a number is not finite.
    """
    if not all(map(isfinite, (*wrench, *preferred, *least, *largest))):
        raise ValueError("wrench, preferred thrusts and limits must be finite")
    w = [s * x for s, x in zip(SCALE, wrench, strict=True)]
    tolerance = ACCURACY * (1 + max(map(abs, w)))
    start = [T / FULL for T in preferred]
    limits = [(min(low, high) / FULL, high / FULL) for low, high in zip(least, largest, strict=True)]
    mu, shares, left = [0.0] * 6, _clip(start, limits), inf
    for rho in PRICES:
        mu = _next_multipliers(w, mu, rho, start, limits)
        clipped = _clip(_free_shares(mu, start), limits)
        before, left = left, hypot(*_missing(w, clipped))
        if left < before:
            shares = clipped
        if left >= before - tolerance:
            break
    thrusts = [min(max(FULL * s, min(a, b)), b) for s, a, b in zip(shares, least, largest, strict=True)]
    return thrusts, [
        x - sum(b * T for b, T in zip(row, thrusts, strict=True)) for x, row in zip(wrench, MATRIX, strict=True)
    ]


def _next_multipliers(
    w: list[float], centre: list[float], rho: float, start: list[float], limits: list[tuple[float, float]]
) -> list[float]:
    """Return the maximum of the dual around mu_k: the first Newton step that stays within a piece reaches it."""
    mu, before = centre, None
    for _ in range(STEPS):
        v = _free_shares(mu, start)
        pieces = [2 if x >= high else int(x > low) for x, (low, high) in zip(v, limits, strict=True)]
        gradient = [
            miss - (m - c) / rho for miss, m, c in zip(_missing(w, _clip(v, limits)), mu, centre, strict=True)
        ]
        if pieces == before or hypot(*gradient) <= ROUNDING:
            break
        before = pieces
        between = [column for column, piece in zip(COLUMNS, pieces, strict=True) if piece == 1]
        hessian = [[(a == b) / rho + sum(c[a] * c[b] for c in between) for b in range(6)] for a in range(6)]
        d = _solution(hessian, gradient, 1 / rho)
        t = _step(d, gradient, rho, v, limits)
        mu = [m + t * x for m, x in zip(mu, d, strict=True)]
    return mu


def _free_shares(mu: list[float], start: list[float]) -> list[float]:
    return [
        s + sum(c * m for c, m in zip(column, mu, strict=True)) for s, column in zip(start, COLUMNS, strict=True)
    ]


def _clip(v: list[float], limits: list[tuple[float, float]]) -> list[float]:
    return [min(max(x, low), high) for x, (low, high) in zip(v, limits, strict=True)]


def _missing(w: list[float], shares: list[float]) -> list[float]:
    return [x - sum(column[a] * s for column, s in zip(COLUMNS, shares, strict=True)) for a, x in enumerate(w)]


def _step(
    d: list[float], gradient: list[float], rho: float, v: list[float], limits: list[tuple[float, float]]
) -> float:
    """Return how far along d the dual grows: its slope falls linearly between kinks, where rotors meet limits."""
    slope, fall = sum(x * y for x, y in zip(d, gradient, strict=True)), sum(x * x for x in d) / rho
    least_fall = fall
    kinks: list[tuple[float, float]] = []
    for column, x, (low, high) in zip(COLUMNS, v, limits, strict=True):
        rate = sum(c * y for c, y in zip(column, d, strict=True))
        if rate == 0 or low == high:
            continue
        first, last = sorted(((low - x) / rate, (high - x) / rate))
        if last > 0:
            kinks.append((last, -rate * rate))
            if first > 0:
                kinks.append((first, rate * rate))
            else:
                fall += rate * rate
    t = 0.0
    for kink, change in sorted(kinks):
        if slope <= fall * (kink - t):
            break
        slope, fall, t = slope - fall * (kink - t), max(fall + change, least_fall), kink
    return t + slope / fall


def _solution(H: list[list[float]], g: list[float], least: float) -> list[float]:
    """Return x with H x = g by elimination; eigenvalues of H, thus pivots too, are at least what is given."""
    rows = [[*row, x] for row, x in zip(H, g, strict=True)]
    for k in range(6):
        rows[k][k] = max(rows[k][k], least)
        for i in range(k + 1, 6):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    x = [0.0] * 6
    for k in reversed(range(6)):
        x[k] = (rows[k][6] - sum(rows[k][i] * x[i] for i in range(k + 1, 6))) / rows[k][k]
    return x

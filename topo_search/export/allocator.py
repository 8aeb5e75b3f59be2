r"""Rotor thrusts for a desired wrench: bounded least squares for one platform, without other libraries.

.. math::

    \min_T \| T - T_0 \| \quad \text{over all } T_{min} \le T \le T_{max} \text{ that minimize } \| S (w - B T) \|

| symbol | meaning | shape | unit |
|---|---|---|---|
| w | wrench to exert on the platform: force, then torque about the centre of mass | (6,) | N, N m |
| B | `MATRIX`: wrench by thrusts | (6, N) | N and N m per N |
| T; T_0; T_min, T_max | thrusts; preferred ones; limits | (N,) | N |
| S | `SCALE`: weight of a missing newton or newton metre | (6,) | 1/N, 1/(N m) |

Axes are those of the platform, in level flight those of the task: x forward, y left, z up. (PX4 has y right and z
down: flip the signs of y and z of force and torque.) Columns are in the order of `rotors.csv`, with the names in
`NAMES`; they count from 0, PX4's motors from 1.

    from allocator import LARGEST, WEIGHT, allocate

    thrusts, missed = allocate((0, 0, WEIGHT, 0, 0, 0))  # hover
    largest = list(LARGEST)
    largest[5] = 0.0  # rotor 5 has failed
    thrusts, missed = allocate((1.5, 0, WEIGHT, 0, 0, 0.1), preferred=thrusts, largest=largest)

Rotor j turns at sqrt(thrusts[j] / THRUST_COEFFICIENT[j]) rad/s. A feasible wrench is met to rounding; otherwise
the nearest one is exerted, and `missed` is the difference. The result is deterministic, the number of steps is
bounded, and thrusts always stay within their limits. Needs Python 3.10 or later.

Method: each round moves six multipliers mu_k to the maximum of a dual, then raises rho; the best round is kept.

.. math:: \mu \cdot S w - \frac{\| \mu - \mu_k \|^2}{2 \rho} - \sum_j h_j((S B)_j \cdot \mu),
    \qquad h_j'(v) = \mathrm{clip}(T_{0j} + v, T_{min,j}, T_{max,j})

The dual is concave and piecewise quadratic: Newton's method with an exact line search ends in finitely many steps.
A round changes mu by rho S (w - B T), which is 0 once the wrench is met. Thrusts inside are in units of `FULL`.
"""

from collections.abc import Sequence
from math import hypot, inf, isfinite

PLATFORM: str = ""
"""Task and topology."""
NAMES: tuple[str, ...] = ()
"""Names of the rotors, in the order of the columns."""
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
THRUST_COEFFICIENT: tuple[float, ...] = ()
"""k_f [N s^2]."""

PRICES = (1e4, 1e6, 1e8, 1e10, 1e12, 1e12)
"""rho of each round. Most wrenches need two or three; multipliers are large near the edge of what is feasible."""
STEPS = 60
"""Largest number of Newton steps per round; all rounds together typically take eight."""
ACCURACY = 1e-12
"""Rounds end when |S (w - B T)| decreases by less than this times 1 + the largest component of S w."""
ROUNDING = 1e-16
"""Norm up to which a gradient counts as zero."""

COLUMNS = [[s * row[j] * FULL for s, row in zip(SCALE, MATRIX, strict=True)] for j in range(len(NAMES))]
"""Columns of S B, for thrusts in units of `FULL`."""


def allocate(
    wrench: Sequence[float],
    preferred: Sequence[float] = LEAST,
    least: Sequence[float] = LEAST,
    largest: Sequence[float] = LARGEST,
) -> tuple[list[float], list[float]]:
    """Return a thrust per rotor [N], and the part of the wrench that they miss, (6,) [N, N m].

    Args:
        wrench: force, then torque about the centre of mass, (6,) [N, N m].
        preferred: thrusts to stay close to, for instance the previous ones, so that motors change little [N].
        least: lower limits [N]; the upper limit wins where it is smaller.
        largest: upper limits [N]; 0 for a failed rotor.

    Raises:
        ValueError: a sequence has a wrong length, or a number is not finite.
    """
    if not all(map(isfinite, (*wrench, *preferred, *least, *largest))):
        raise ValueError("wrench, preferred thrusts and limits must be finite")
    w = [s * x for s, x in zip(SCALE, wrench, strict=True)]
    tolerance = ACCURACY * (1 + max(map(abs, w)))
    start = [T / FULL for T in preferred]
    limits = [(min(low, high) / FULL, high / FULL) for low, high in zip(least, largest, strict=True)]
    mu, shares, gap = [0.0] * 6, _clip(start, limits), inf
    for rho in PRICES:
        mu = _next_multipliers(w, mu, rho, start, limits)
        clipped = _clip(_free_shares(mu, start), limits)
        last_gap, gap = gap, hypot(*_missing(w, clipped))
        if gap < last_gap:
            shares = clipped
        if gap >= last_gap - tolerance:
            break
    thrusts = [min(max(FULL * s, min(a, b)), b) for s, a, b in zip(shares, least, largest, strict=True)]
    return thrusts, [
        x - sum(b * T for b, T in zip(row, thrusts, strict=True)) for x, row in zip(wrench, MATRIX, strict=True)
    ]


def _next_multipliers(
    w: list[float], centre: list[float], rho: float, start: list[float], limits: list[tuple[float, float]]
) -> list[float]:
    """Return the maximum of the dual around mu_k; a Newton step that stays within one piece reaches it."""
    mu, last_pieces = centre, None
    for _ in range(STEPS):
        v = _free_shares(mu, start)
        pieces = [2 if x >= high else int(x > low) for x, (low, high) in zip(v, limits, strict=True)]
        gradient = [
            miss - (m - c) / rho for miss, m, c in zip(_missing(w, _clip(v, limits)), mu, centre, strict=True)
        ]
        if pieces == last_pieces or hypot(*gradient) <= ROUNDING:
            break
        last_pieces = pieces
        unsaturated = [column for column, piece in zip(COLUMNS, pieces, strict=True) if piece == 1]
        hessian = [[(a == b) / rho + sum(c[a] * c[b] for c in unsaturated) for b in range(6)] for a in range(6)]
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
    """Return the step size that maximizes the dual along d.

    Its slope falls linearly between kinks, where rotors reach limits.
    """
    slope, curvature = sum(x * y for x, y in zip(d, gradient, strict=True)), sum(x * x for x in d) / rho
    least_curvature = curvature
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
                curvature += rate * rate
    t = 0.0
    for kink, change in sorted(kinks):
        if slope <= curvature * (kink - t):
            break
        slope, curvature, t = slope - curvature * (kink - t), max(curvature + change, least_curvature), kink
    return t + slope / curvature


def _solution(H: list[list[float]], g: list[float], smallest_eigenvalue: float) -> list[float]:
    """Solve H x = g by elimination; no pivot is smaller than the smallest eigenvalue."""
    rows = [[*row, x] for row, x in zip(H, g, strict=True)]
    for k in range(6):
        rows[k][k] = max(rows[k][k], smallest_eigenvalue)
        for i in range(k + 1, 6):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    x = [0.0] * 6
    for k in reversed(range(6)):
        x[k] = (rows[k][6] - sum(rows[k][i] * x[i] for i in range(k + 1, 6))) / rows[k][k]
    return x

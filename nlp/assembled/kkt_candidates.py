r"""The smoothed minimum of f over the KKT candidates of two envelopes, with hand-written derivatives, compiled.

The formulas are those of `nlp.symbols.clearance`, with `quadratic_candidates` for A = B and without F. Most
candidates have a negligible share in the log-sum-exp, and are not differentiated.

| symbol | meaning | shape |
|---|---|---|
| c = (C, D, E) | coefficients of f = A (eta^2 + gamma^2) + C eta gamma + D eta + E gamma | (3,) |
| eta, gamma | position of a candidate, a function of c | |
| d, d2 | derivatives by c of eta, gamma and f | (3,), (3, 3) |
| w | share of a candidate in the log-sum-exp | |

.. math::

    \psi = -\tfrac{1}{\beta} \log \sum e^{-\beta f}, \quad \partial \psi = \sum w \, \partial f, \quad
    \partial^2 \psi = \sum w \, (\partial^2 f - \beta \, \partial f \, \partial f^T)
                      + \beta \, \partial \psi \, \partial \psi^T
"""

import math

import numpy as np

from nlp.symbols.clearance import EPSILON
from topo_search.compiled_code import njit
from topo_search.model.arrays import Array

CANDIDATES = 9
"""The stationary point, two on the edges eta = 0, 1, two on the edges gamma = 0, 1, and the corners."""
NEGLIGIBLE = 1e-40
"""Share below which a candidate is neglected, as derivatives reach 1e20 for nearly parallel envelopes."""
ETA, GAMMA = 0, 1


@njit(cache=True)
def smooth_minimum(c: Array, A: float, beta: float) -> tuple[Array, Array, Array]:
    """Return psi (m,), its gradients (m, 3) and its Hessians (m, 3, 3).

    Args:
        c: C, D, E in the first columns, shape (m, 3 or more).
        A: coefficient of the squares [l_arm^2].
        beta: sharpness of the log-sum-exp.
    """
    value, gradient, hessian = np.empty(len(c)), np.zeros((len(c), 3)), np.zeros((len(c), 3, 3))
    candidates, f = np.empty((CANDIDATES, 2)), np.empty(CANDIDATES)
    df, d2f, d, d2 = np.empty(3), np.empty((3, 3)), np.empty((2, 3)), np.empty((2, 3, 3))
    for r in range(len(c)):
        C, D, E = c[r, :3]
        _find_candidates(C, D, E, A, candidates)
        for k in range(CANDIDATES):
            eta, gamma = candidates[k]
            f[k] = A * (eta * eta + gamma * gamma) + C * eta * gamma + D * eta + E * gamma
        f_min = f.min()
        total = 0.0
        for k in range(CANDIDATES):
            total += math.exp(-beta * (f[k] - f_min))
        value[r] = f_min - math.log(total) / beta
        for k in range(CANDIDATES):
            w = math.exp(-beta * (f[k] - f_min)) / total
            if w < NEGLIGIBLE:
                continue
            _differentiate(k, C, D, E, A, d, d2)
            _chain(candidates[k], C, D, E, A, d, d2, df, d2f)
            for a in range(3):
                gradient[r, a] += w * df[a]
                for b in range(3):
                    hessian[r, a, b] += w * (d2f[a, b] - beta * df[a] * df[b])
        for a in range(3):
            for b in range(3):
                hessian[r, a, b] += beta * gradient[r, a] * gradient[r, b]
    return value, gradient, hessian


@njit(cache=True, inner=True)
def _find_candidates(C: float, D: float, E: float, A: float, candidates: Array) -> None:
    """Write eta and gamma of all candidates."""
    inverse = _inverse(C, A)[0]
    candidates[0] = _clamp((C * E - 2 * A * D) * inverse)[0], _clamp((C * D - 2 * A * E) * inverse)[0]
    for k, end in enumerate((0.0, 1.0)):
        candidates[1 + k] = end, _clamp(_on_edge(C * end + E, A))[0]
        candidates[3 + k] = _clamp(_on_edge(C * end + D, A))[0], end
        candidates[5 + k] = end, 0.0
        candidates[7 + k] = end, 1.0


@njit(cache=True, inner=True)
def _differentiate(k: int, C: float, D: float, E: float, A: float, d: Array, d2: Array) -> None:
    """Write the derivatives of eta and gamma of candidate k."""
    d[:] = 0.0
    d2[:] = 0.0
    if k == 0:
        _stationary(C, D, E, A, 1, 2, d[ETA], d2[ETA])
        _stationary(C, E, D, A, 2, 1, d[GAMMA], d2[GAMMA])
    elif k < 5:
        side = GAMMA if k < 3 else ETA  # the variable along the edge; its linear coefficient is E or D
        end, linear, column = (k - 1, E, 2) if k < 3 else (k - 3, D, 1)
        _, slope, bend = _clamp(_on_edge(C * end + linear, A))
        t_linear = _on_edge(1.0, A)
        t_C = end * t_linear
        d[side, 0], d[side, column] = slope * t_C, slope * t_linear
        d2[side, 0, 0], d2[side, column, column] = bend * t_C**2, bend * t_linear**2
        d2[side, 0, column] = d2[side, column, 0] = bend * t_C * t_linear


@njit(cache=True, inner=True)
def _stationary(C: float, linear: float, other: float, A: float, i: int, j: int, d: Array, d2: Array) -> None:
    """Write the derivatives of the stationary point's eta, with `linear` and `other` D and E, at i and j in c.

    With D and E swapped they are gamma's.
    """
    k, k_C, k_CC = _inverse(C, A)
    minor = C * other - 2 * A * linear
    _, slope, bend = _clamp(minor * k)
    d[0], d[i], d[j] = other * k + minor * k_C, -2 * A * k, C * k
    for a in range(3):
        for b in range(3):
            d2[a, b] = bend * d[a] * d[b]
    d2[0, 0] += slope * (2 * other * k_C + minor * k_CC)
    mixed_linear, mixed_other = slope * -2 * A * k_C, slope * (k + C * k_C)
    d2[0, i] += mixed_linear
    d2[i, 0] += mixed_linear
    d2[0, j] += mixed_other
    d2[j, 0] += mixed_other
    for a in range(3):
        d[a] *= slope


@njit(cache=True, inner=True)
def _chain(
    candidate: Array, C: float, D: float, E: float, A: float, d: Array, d2: Array, df: Array, d2f: Array
) -> None:
    """Write the derivatives of f at a candidate from those of its position."""
    eta, gamma = candidate
    de, dg = d
    by_eta, by_gamma = 2 * A * eta + C * gamma + D, 2 * A * gamma + C * eta + E
    for a in range(3):
        df[a] = by_eta * de[a] + by_gamma * dg[a]
        for b in range(3):
            d2f[a, b] = by_eta * d2[ETA, a, b] + by_gamma * d2[GAMMA, a, b]
            d2f[a, b] += 2 * A * (de[a] * de[b] + dg[a] * dg[b]) + C * (de[a] * dg[b] + dg[a] * de[b])
    df[0] += eta * gamma
    df[1] += eta
    df[2] += gamma
    for a in range(3):
        mixed = gamma * de[a] + eta * dg[a], de[a], dg[a]
        for b in range(3):
            d2f[a, b] += mixed[b]
            d2f[b, a] += mixed[b]


@njit(cache=True, inner=True)
def _inverse(C: float, A: float) -> tuple[float, float, float]:
    """Return det / (det^2 + epsilon) of f's Hessian, det = 4 A^2 - C^2, with two derivatives by C."""
    det = 4 * A * A - C * C
    denominator = det * det + EPSILON
    first = (EPSILON - det * det) / denominator**2
    second = 2 * det * (det * det - 3 * EPSILON) / denominator**3
    return det / denominator, -2 * C * first, 4 * C * C * second - 2 * first


@njit(cache=True, inner=True)
def _on_edge(linear: float, A: float) -> float:
    return -linear * A / (2 * A * A + EPSILON)


@njit(cache=True, inner=True)
def _clamp(value: float) -> tuple[float, float, float]:
    """Return the smooth clamp to [0, 1], with two derivatives."""
    upper = math.sqrt((1.0 - value) ** 2 + EPSILON)
    s = 0.5 * (1.0 + value - upper)
    ds, d2s = 0.5 * (1.0 + (1.0 - value) / upper), -0.5 * EPSILON / upper**3
    lower = math.sqrt(s * s + EPSILON)
    dc, d2c = 0.5 * (1.0 + s / lower), 0.5 * EPSILON / lower**3
    return 0.5 * (s + lower), dc * ds, d2c * ds * ds + dc * d2s

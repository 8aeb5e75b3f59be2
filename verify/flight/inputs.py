"""The least inputs that produce a wrench: a quadratic program, with both its points.

    minimise |v|^2 / 2  such that  A v = b,  low <= v <= high

| symbol | meaning | shape |
|---|---|---|
| A, b | wrench map and wrench | (6, N), (6,) |
| y | multipliers; the best v for them is A^T y, clipped to the bounds | (6,) |
| L(y) | |v|^2 / 2 - y . (A v - b) at that v: never more than the least |v|^2 / 2 | |

L is concave, and its gradient b - A v. Newton's method finds where it vanishes: v is then the answer, proven.
"""

from __future__ import annotations

import numpy as np

from verify.bodies import Array
from verify.flight.programs import RESIDUAL, Box

STEPS = 100
"""Largest number of steps."""
DAMPING = 1e-12
"""Added to the matrix of a step, in units of its largest entry: some wrenches may have no free rotors."""
SHORTEST = 1e-3
"""Shortest share of a step; where none is short enough, the matrix is damped a hundred times as much."""
ARMIJO = 1e-4
"""Share of the promised gain that a step must bring."""


def least_inputs(A: Array, b: Array, box: Box) -> Array | None:
    """Return the least inputs, shape (N,), each equation met to RESIDUAL; None if they are not found."""

    def at(y: Array) -> tuple[Array, Array, float]:
        v = np.clip(y @ A, box.low, box.high)
        missing = b - A @ v
        return v, missing, float(v @ v / 2 + y @ missing)

    y = np.zeros(len(A))
    v, missing, value = at(y)
    damping = least = max(DAMPING * float(np.abs(A @ A.T).max()), 1e-300)
    for _ in range(STEPS):
        if np.abs(missing).max() <= RESIDUAL:
            return np.asarray(v)
        free = A[:, (y @ A >= box.low) & (y @ A <= box.high)]
        ahead = np.linalg.solve(free @ free.T + damping * np.eye(len(A)), missing)
        share = 1.0
        while share > SHORTEST:
            nearer = at(y + share * ahead)
            if nearer[2] >= value + ARMIJO * share * float(ahead @ missing):
                break
            share /= 2
        else:
            damping *= 100
            continue
        damping = max(damping / 10, least)
        y = y + share * ahead
        v, missing, value = nearer
    return None

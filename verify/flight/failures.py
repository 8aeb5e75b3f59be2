"""Torques that can be added with a rotor dead, so that attitude remains controllable.

The notation is that of `verify.flight.measured`. A dead rotor's bounds are both zero, whatever the least input.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verify.bodies import Array
from verify.flight.balls import largest_balls
from verify.flight.programs import Box, find_solutions

TOGETHER = 20
"""Polytopes that are looked at at once."""


@dataclass(frozen=True, eq=False)
class Left:
    """Remaining capability at a wrench, with each rotor dead."""

    yes: NDArray[np.bool_]
    """Proven to be possible, shape (N,)."""
    no: NDArray[np.bool_]
    """Proven to be impossible; neither: undecided."""
    lower: Array
    """Radius of the largest ball of torques that can be added, at least [l_arm m_t g]; 0 without a proof."""
    upper: Array
    """And at most."""


def remainder(A: Array, b: Array, box: Box) -> Left:
    """Return what is left of a wrench with each of the rotors dead, one at a time.

    Args:
        A: wrench map, shape (6, N).
        b: the wrench, shape (6,).
        box: bounds of the inputs of rotors that run, shape (N,) each.
    """
    N = A.shape[1]
    alive = 1.0 - np.eye(N)
    low, high = box.low * alive, box.high * alive
    reached = find_solutions(A, np.tile(b, (N, 1)), Box(low, high))
    lower, upper = np.zeros(N), np.where(reached.no, 0.0, np.inf)
    able = np.flatnonzero(reached.yes)
    for start in range(0, len(able), TOGETHER):
        dead = able[start : start + TOGETHER]
        made = reached.v[dead] @ A.T  # within the audit's tolerance of b, and produced exactly
        balls = largest_balls(A[3:], A[:3], made[:, 3:], made[:, :3], Box(low[dead], high[dead]))
        lower[dead], upper[dead] = [ball.lower for ball in balls], [max(ball.upper, 0.0) for ball in balls]
    return Left(reached.yes, reached.no, lower, upper)

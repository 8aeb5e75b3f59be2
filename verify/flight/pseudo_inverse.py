r"""Reserves of an allocator that only multiplies: inputs A^+ w, and nothing where one is beyond its limits.

| symbol | meaning | shape |
|---|---|---|
| A, A^+ | wrench map and its pseudo-inverse | (6, N), (N, 6) |
| b | wrench that is held, hover with its load | (6,) |
| E | wrenches of unit forces or torques that are added | (6, D) |
| v | A^+ b | (N,) |
| s_i | what is left of input i: the least of high_i - v_i and v_i - low_i | |

Input i is v_i + (A^+ E)_i d for an added d, so that the largest ball has the radius min_i s_i / |(A^+ E)_i|: no
program is needed. Wrenches that A A^+ does not return are not exerted at all. PX4 allocates so before it
desaturates.
"""

from __future__ import annotations

import math

import numpy as np

from topo_search.model.proven import TOLERANCE
from verify.bodies import Array
from verify.flight.balls import half_angles
from verify.flight.programs import Box

FORCES, TORQUES = np.eye(6)[:, :3], np.eye(6)[:, 3:]
"""Wrenches about the COM of forces and torques there."""
RANK = 1e-9
"""Singular values below this share of the largest are zero."""


class PseudoInverse:
    """The allocator.

    Args:
        A: wrench map, shape (6, N) [m_t g, l_arm m_t g].
        box: bounds of the inputs, shape (N,) each.
    """

    def __init__(self, A: Array, box: Box) -> None:
        self._A, self._box, self._inverse = A, box, np.linalg.pinv(A, rcond=RANK)

    def ball(self, b: Array, E: Array) -> float:
        """Return the radius of the largest ball of additions to b; 0 if there is none."""
        v, rows = self._inverse @ b, self._inverse @ E
        missed = self._A @ np.column_stack([v, rows]) - np.column_stack([b, E])
        left = np.minimum(self._box.high - v, v - self._box.low)
        if np.abs(missed).max() > TOLERANCE or left.min() < 0:
            return 0.0
        sizes = np.linalg.norm(rows, axis=1)
        moved = sizes > 0
        return float((left[moved] / sizes[moved]).min(initial=math.inf))

    def cap(self, b: Array) -> float:
        """Return the half-angle of the largest cap of forces as large as that of b around it, without torque [rad].

        Each limit of an input is a half-space of forces.
        """
        if self.ball(b, FORCES) == 0:
            return 0.0
        v, rows = self._inverse @ b, self._inverse @ FORCES
        sizes = np.linalg.norm(rows, axis=1)
        moved = sizes > 0
        normals = rows[moved] / sizes[moved, None]
        up, down = (side[moved] / sizes[moved] for side in (self._box.high - v, v - self._box.low))
        return min(float(half_angles(n, h, b[:3]).min()) for n, h in ((normals, up), (-normals, down)))

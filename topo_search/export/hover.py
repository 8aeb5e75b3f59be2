"""Forces and torques that can be added to hover, by linear programs over the thrusts."""

import math
from dataclasses import dataclass

import numpy as np

from topo_search.model.arrays import Array


@dataclass(frozen=True, eq=False)
class Hover:
    """Rotors that hover a platform in the attitude of its task."""

    B: Array
    """Wrench about the centre of mass per thrust, (6, N)."""
    largest_thrust: Array
    """Largest thrust of each rotor, (N,) [N]."""
    least_share: float
    """Smallest thrust of a running rotor over the largest."""
    weight: float
    arm: float
    """l_arm, the scale of torques [m]."""

    def load_factor(self, wrench: Array) -> float:
        """Return the largest multiple of a wrench about the COM, (6,), that can be added; inf for zero."""
        if not wrench.any():
            return math.inf
        from scipy.optimize import linprog  # slow to load, and few commands need it

        N = self.B.shape[1]
        hover = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        scale = np.repeat([1.0, self.arm], 3) * self.weight
        norm = float(np.linalg.norm(wrench / scale))
        A = np.column_stack([self.B * self.largest_thrust / scale[:, None], -wrench / scale / norm])
        bounds = [(self.least_share, 1)] * N + [(0, None)]
        solution = linprog(np.append(np.zeros(N), -1.0), A_eq=A, b_eq=hover, bounds=bounds)
        return float(solution.x[-1]) / norm + 0.0 if solution.status == 0 else 0.0  # never -0.0

    def weakest_force(self) -> tuple[float, Array]:
        """Return the weakest horizontal force that can be added at the COM [N], and its direction, (3,), of 24."""
        forces, directions = [], 24
        for k in range(directions):
            angle = 2 * math.pi * k / directions
            d = np.array([math.cos(angle), math.sin(angle), 0.0])
            forces.append((self.load_factor(np.append(d, np.zeros(3))), k, d))
        force, _, d = min(forces, key=lambda candidate: candidate[:2])
        return force, d

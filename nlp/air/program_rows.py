"""Air speeds at points of regions as rows of a program.

| symbol | meaning | shape | unit |
|---|---|---|---|
| y | local vectors: p_i - p'_E, x_i, y_i, z_i; p_j - p'_E and z_j of the ball's module j | (6, 3) | l_arm, - |
| u | inputs of module i in the point's load case | (r,) | u_hover |
| q | the point from module i in its frame (`nlp.air.jets`) | (3,) | l_arm |

A row is the sum of the modules' speeds at its point. A module's speed is a function of (y, u), the same in all
topologies; the chain rule gives its derivatives by the unknowns.
"""

import math

import casadi as ca
import numpy as np

from nlp.air.fastest import TARGET_SHARE, SpeedPoint
from nlp.air.jets import JETS, ROUNDED, JetConstants, curvature, find_factors, jet_of, point_of_ball, speed
from nlp.assembled.problem import AssembledProblem
from nlp.requirements.statement import FROM_TIP, TIP, X_I, Y_I, Z_I, Z_J, LocalVector, PlatformVector
from topo_search.compiled_code import njit
from topo_search.model import Array, Indices, ResolvedTask

VECTORS = (FROM_TIP, X_I, Y_I, Z_I, LocalVector(PlatformVector("p", 1), TIP), Z_J)
"""y."""


class SpeedRows:
    """Air speeds at points of regions, as rows appended to an assembled program."""

    def __init__(self, program: AssembledProblem, task: ResolvedTask, points: tuple[SpeedPoint, ...]) -> None:
        """Find the patterns of the derivatives; a row depends on the inputs of its own load case only."""
        n, g, m, size = program.n, program.g, len(points), program.size
        self._program, self._jet = program, jet_of(task.module, task.air_density, task.gravity)
        i, j = np.tile(np.arange(n), m), np.repeat([max(0, point.module) for point in points], n)
        self._plus, self._minus = program.layout.endpoints(VECTORS, np.stack([i, j]))
        limits = [task.exposure[point.exposure].speed or math.inf for point in points]
        numbers = [
            [*point.from_tip, *point.direction, point.radius, 1 / limit]
            for point, limit in zip(points, limits, strict=True)
        ]
        self._numbers = np.repeat(numbers, n, axis=0)
        module = n * np.repeat([point.case for point in points], n) + i
        self._inputs = len(self._jet.rotors) * module[:, None] + np.arange(len(self._jet.rotors))
        x = np.concatenate([np.tile(np.arange(g), (m * n, 1)), g + self._inputs], axis=1)
        self._rows, self._upper = np.repeat(np.arange(m), n), np.triu_indices(x.shape[1])
        first, second = self._upper
        self.jacobian_pattern, self._in_jacobian = _pattern(m, size, self._rows[:, None], x)
        self.hessian_pattern, self._in_hessian = _pattern(size, size, x[:, first], x[:, second])
        self._bends = np.flatnonzero(second < g)
        self.lower, self.upper = np.zeros(m), np.full(m, math.inf)

    def values(self, variables: Array) -> Array:
        """Return the rows, each of which must be at least zero."""
        return np.asarray(TARGET_SHARE - np.bincount(self._rows, self._derive(0, variables)[0]))

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of the Jacobian of the rows."""
        _, gradient, _ = self._derive(1, variables)
        slopes = np.einsum("rxy,ry->rx", self._chain(), gradient)
        return np.asarray(-np.bincount(self._in_jacobian, slopes.ravel()))

    def hessian(self, variables: Array, multipliers: Array) -> Array:
        """Return the entries of the Hessian of the sum of rows times multipliers."""
        _, gradient, hessian = self._derive(2, variables)
        platform, dy, weights = self._program.platform, self._chain(), -multipliers[self._rows]
        first, second = self._upper
        entries = weights[:, None] * (dy @ hessian @ dy.transpose(0, 2, 1))[:, first, second]
        by_V, by_vectors = np.zeros_like(platform.V), weights[:, None, None] * gradient[:, :18].reshape(-1, 6, 3)
        np.add.at(by_V, self._plus, by_vectors)
        np.subtract.at(by_V, self._minus, by_vectors)
        H = platform.curvature(by_V)
        entries[0, self._bends] += H[first[self._bends], second[self._bends]]
        return np.asarray(np.bincount(self._in_hessian, entries.ravel()), dtype=float)

    def _derive(self, order: int, variables: Array) -> tuple[Array, Array, Array]:
        """Return every module's speed over the limit at each point, with derivatives by (y, u)."""
        platform, u = self._program.platform_at(variables)
        y = platform.V[self._plus] - platform.V[self._minus]
        return derive_speeds(order, self._jet, y, u.ravel()[self._inputs], self._numbers)

    def _chain(self) -> Array:
        """Return the derivatives of (y, u) by the geometric unknowns and u, shape (m n, g + r, 18 + r)."""
        dV, g, r = self._program.platform.dV, self._program.g, len(self._jet.rotors)
        dy = np.zeros((len(self._rows), g + r, 18 + r))
        dy[:, :g, :18] = (dV[self._plus] - dV[self._minus]).transpose(0, 2, 1, 3).reshape(-1, g, 18)
        dy[:, g:, 18:] = np.eye(r)
        return dy


@njit(cache=True)
def derive_speeds(order: int, jet: JetConstants, y: Array, u: Array, numbers: Array) -> tuple[Array, Array, Array]:
    """Return speeds over limits, with derivatives by (y, u) up to an order.

    Args:
        order: 0, 1 or 2.
        jet: jet of the modules.
        y: local vectors, shape (m, 6, 3).
        u: inputs, shape (m, r).
        numbers: `from_tip`, `direction`, `radius` and reciprocal limit of each point, shape (m, 8).
    """
    m, rotors = u.shape
    count = 18 + rotors
    values, gradients = np.empty(m), np.zeros((m if order else 0, count))
    hessians = np.zeros((m if order > 1 else 0, count, count))
    x, q, slopes, second = np.empty(3), np.empty(3), np.empty(3 + rotors), np.empty((3 + rotors, 3 + rotors))
    C, dC = np.empty(rotors), np.empty((rotors if order else 0, 3))
    by_ball, by_y, d = np.empty((3, 6)), np.zeros((3 + rotors, count)), np.empty(3)
    for r in range(m):
        point_of_ball(numbers[r, :3], numbers[r, 6], numbers[r, 3:6], y[r, 4], y[r, 5], x, by_ball)
        for a in range(3):
            d[a] = x[a] - y[r, 0, a]
        for a in range(3):
            q[a] = y[r, 1 + a, 0] * d[0] + y[r, 1 + a, 1] * d[1] + y[r, 1 + a, 2] * d[2]
        find_factors(jet, q, ROUNDED, C, dC)
        inverse_limit = numbers[r, 7]
        values[r] = inverse_limit * speed(jet, C, dC, u[r], slopes if order else slopes[:0])
        if order == 0:
            continue
        for a in range(3):
            for b in range(3):
                by_y[a, b] = -y[r, 1 + a, b]
                by_y[a, 3 + 3 * a + b] = d[b]
            for c in range(6):
                by_y[a, 12 + c] = 0.0
                for b in range(3):
                    by_y[a, 12 + c] += y[r, 1 + a, b] * by_ball[b, c]
        for k in range(rotors):
            by_y[3 + k, 18 + k] = 1.0
        gradients[r] = inverse_limit * (slopes @ by_y)
        if order == 1:
            continue
        curvature(jet, q, u[r], second)
        H = hessians[r]
        H[:] = by_y.T @ second @ by_y
        for a in range(3):
            for b in range(3):
                H[b, 3 + 3 * a + b] -= slopes[a]
                H[3 + 3 * a + b, b] -= slopes[a]
                for c in range(6):
                    H[3 + 3 * a + b, 12 + c] += slopes[a] * by_ball[b, c]
                    H[12 + c, 3 + 3 * a + b] += slopes[a] * by_ball[b, c]
        if numbers[r, 6] > 0.0:
            _add_curvature_of_point(numbers[r], y[r], slopes, H)
        for a in range(count):
            for b in range(count):
                H[a, b] *= inverse_limit
    return values, gradients, hessians


@njit(cache=True, inner=True)
def _add_curvature_of_point(numbers: Array, y: Array, slopes: Array, H: Array) -> None:
    """Add the curvature of a speed due to the motion of its point, by differences as in `nlp.air.jets`."""
    x, above, below = np.empty(3), np.empty((3, 6)), np.empty((3, 6))
    for c in range(6):
        vector, axis = 4 + c // 3, c % 3
        middle = y[vector, axis]
        y[vector, axis] = middle + JETS.difference
        point_of_ball(numbers[:3], numbers[6], numbers[3:6], y[4], y[5], x, above)
        y[vector, axis] = middle - JETS.difference
        point_of_ball(numbers[:3], numbers[6], numbers[3:6], y[4], y[5], x, below)
        y[vector, axis] = middle
        for a in range(3):
            for b in range(3):
                for column in range(6):
                    bend = (above[b, column] - below[b, column]) / (2 * JETS.difference)
                    H[12 + c, 12 + column] += slopes[a] * y[1 + a, b] * bend


def _pattern(rows: int, columns: int, i: Indices, j: Indices) -> tuple[ca.Sparsity, Indices]:
    """Return CasADi's pattern of entries (i, j), which may repeat, and the position of each in it."""
    entries, positions = np.unique((i + rows * j).ravel(), return_inverse=True)
    return ca.Sparsity.triplet(rows, columns, entries % rows, entries // rows), positions

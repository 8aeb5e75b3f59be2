"""The formulas of `nlp.requirements` with gradients and Hessians by their local vectors.

CasADi differentiates them, once per process rather than per topology. Pairs of envelopes, the most frequent, are
differentiated by hand (`nlp.assembled.kkt_candidates`): CasADi would take nine times as long for them, a fifth of a
solve of 40 modules.

| symbol | meaning | shape | unit |
|---|---|---|---|
| y | the s local vectors of each of m clearances | (m, s, 3) | l_arm, - |
| w = p_i - p_j, z_i, z_j | local vectors of a pair of envelopes | (m, 3) each | l_arm, - |
| C, D, E, F | variable coefficients of f_air; A = B = l_air^2 - dr_air^2 | (m,) each | l_arm^2 |

Torques of angular accelerations are terms of the balances. J a, with the inertia J about the COM and an
acceleration a, is a sum of functions: of o_i and the axes of each module with its joints, of p_E, and of a rod with
mass (`nlp.symbols.platform`).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from nlp.assembled.kkt_candidates import smooth_minimum
from nlp.assembled.platform import AssembledPlatform, Layout
from nlp.numbers.masses import RigidBody, RodMass
from nlp.requirements.balances import angular_accelerations
from nlp.requirements.bodies import Air
from nlp.requirements.modules import AirflowClearance
from nlp.requirements.statement import COM, FROM_COM, FROM_TIP, X_I, Y_I, Z_I, Formula, LocalVector, PlatformVector
from nlp.symbols.platform import body_inertia, point_inertia, rod_inertia_beyond_ends
from topo_search.model import Array, Indices, ResolvedTask, Vector

MAX_BUFFERS = 15
"""Largest number of cached buffers per expression: one per number of columns."""
Derivatives = tuple[Array, ...]
"""Values (m,), gradients (m, s, 3) and Hessians (m, 3 s, 3 s) by y."""
Derived = Callable[[Array], Derivatives]
"""A function of local vectors of shape (m, s, 3) with its derivatives."""


class Term:
    """m clearances of one kind, with the indices of their derivatives."""

    def __init__(
        self,
        derived: Derived,
        vectors: Iterable[LocalVector],
        subjects: Indices,
        layout: Layout,
        margin: float = 0.0,
    ) -> None:
        """Index the derivatives.

        Args:
            derived: values and derivatives by the local vectors.
            vectors: the local vectors.
            subjects: modules i and j of each clearance, shape (2, m).
            layout: layout of V.
            margin: required clearance beyond zero [l_arm].
        """
        self._derived, self.margin = derived, margin
        self.plus, self.minus = layout.endpoints(vectors, subjects)
        self.m, involved = len(self.plus), np.concatenate([self.plus, self.minus], axis=1)
        self.moving = layout.moved[involved].any(axis=1)
        """Mask of unknowns that move a vector of each clearance, shape (m, g)."""
        self.changing = self.moving & ~layout.turned[involved].all(axis=1)  # rigid turns change nothing
        """Mask of unknowns that change each clearance, shape (m, g)."""

    def evaluate(self, platform: AssembledPlatform) -> Derivatives:
        """Return values and derivatives by the local vectors."""
        return self._derived(platform.V.take(self.plus, 0) - platform.V.take(self.minus, 0))


class Mapped:
    """A scalar CasADi expression of local vectors, evaluated with derivatives for many subjects at once."""

    def __init__(self, y: Sequence[ca.SX], expression: ca.SX) -> None:
        variables = ca.vertcat(*y)
        hessian, gradient = ca.hessian(expression, variables)
        results = [expression, ca.densify(gradient), ca.densify(hessian)]
        self._size = variables.numel()
        self._function = ca.Function("term", [variables], results)
        self._buffers: dict[int, tuple[Any, Any, Array, Derivatives]] = {}

    def __call__(self, y: Array) -> Derivatives:
        """Return values, gradients and Hessians."""
        m = len(y)
        if m not in self._buffers:
            while len(self._buffers) >= MAX_BUFFERS:  # evict the oldest
                del self._buffers[next(iter(self._buffers))]
            self._buffers[m] = self._buffer(m)
        _, trigger, inputs, outputs = self._buffers[m]
        inputs[...] = y.reshape(m, -1)
        trigger()
        return tuple(output.copy() for output in outputs)

    def _buffer(self, m: int) -> tuple[Any, Any, Array, Derivatives]:
        """Return CasADi's buffer of the mapped function with its input and output arrays."""
        function: Any = self._function.map(m)
        buffer, trigger = function.buffer()
        inputs = np.zeros((m, self._size))
        outputs = np.zeros(m), np.zeros((m, self._size // 3, 3)), np.zeros((m, self._size, self._size))
        buffer.set_arg(0, inputs.data)
        for number, output in enumerate(outputs):
            buffer.set_res(number, output.data)
        return (function, buffer), trigger, inputs, outputs  # the trigger does not keep them alive


@cache
def derived_rows(formula: Formula, beta: float) -> tuple[Derived, ...]:
    """Return every row of a formula's smooth form with its derivatives."""
    if isinstance(formula, AirflowClearance) and formula.body == formula.air:
        return (_envelope_pair(formula.air, beta),)
    y = [ca.SX.sym("y", 3) for _ in formula.local_vectors]
    return tuple(Mapped(y, row) for row in ca.vertsplit(formula.smooth(y, ca.SX(beta))))


def _envelope_pair(air: Air, beta: float) -> Derived:
    """Return the smooth clearance of two airflow envelopes, with y = (w, z_i, z_j), as a function of C, D, E and F.

    Each of these is a constant plus a multiple of the dot product of two vectors of y; Q has the multiples.
    """
    l, r_0, dr = air.length, 2 * air.start_radius, air.growth
    A, scale = l**2 - dr**2, 2 * (r_0 + 2 * dr)
    constants = np.array([-2 * dr**2, -2 * r_0 * dr, -2 * r_0 * dr, -(r_0**2)])
    first, second = np.array([1, 0, 0, 0]), np.array([2, 1, 2, 0])
    numbers, multiples = np.array([-2 * l**2, -2 * l, 2 * l, 1.0]), np.zeros((4, 3, 3))
    np.add.at(multiples, ([*range(4)] * 2, [*first, *second], [*second, *first]), np.tile(numbers, 2))
    Q, same_axis = multiples.reshape(4, 9), np.eye(3)[:, None, :]

    def differentiate(y: Array) -> Derivatives:
        m = len(y)
        dots = np.einsum("rka,rka->rk", y.take(first, 1), y.take(second, 1))
        coefficients = numbers * dots + constants
        psi, by_CDE, curved = smooth_minimum(coefficients, A, beta)
        values = (psi + coefficients[:, 3]) / scale  # F is the same for all candidates
        weighted = ((by_CDE @ Q[:3] + Q[3]) / scale).reshape(m, 3, 3)
        by_y = (Q[:3].reshape(9, 3) @ y).reshape(m, 3, 9)
        direct = (weighted[:, :, None, :, None] * same_axis).reshape(m, 9, 9)
        return values, weighted @ y, by_y.transpose(0, 2, 1) @ (curved / scale) @ by_y + direct

    return differentiate


O_I = LocalVector(PlatformVector("p", 0), COM)
"""o_i."""


def inertia_terms(task: ResolvedTask, layout: Layout) -> Iterator[tuple[int, Term]]:
    """Yield the terms of angular accelerations, each with the row of the balances that it is subtracted from."""
    n, m_E, rod = task.n, layout.masses.tip, layout.masses.rod
    modules_by_body = dict[RigidBody, list[int]]()
    for i in range(n):
        modules_by_body.setdefault(layout.masses.body(i), []).append(i)
    holder = np.full((2, 1), rod.module)
    for k, (x, y, z) in enumerate(angular_accelerations(task).tolist()):
        for axis in range(3) if any((x, y, z)) else ():
            row, a = 6 * k + 3 + axis, (x / n, y / n, z / n)
            for body, modules in modules_by_body.items():
                subjects = np.tile(modules, (2, 1))
                yield row, Term(_of_body(body, a, axis), (O_I, X_I, Y_I, Z_I), subjects, layout)
            of_tip = _of_tip((m_E * x / n, m_E * y / n, m_E * z / n), axis)
            yield row, Term(of_tip, (FROM_COM,), holder, layout)
            if rod.mass:
                yield row, Term(_of_rod(rod, a, axis), (FROM_TIP, X_I, Y_I), holder, layout)


@cache
def _of_body(body: RigidBody, a: Vector, axis: int) -> Derived:
    """Return a component of a module's part of J a, as a function of o_i and its axes."""
    y = [ca.SX.sym("y", 3) for _ in range(4)]
    return Mapped(y, (body_inertia(y[0], ca.horzcat(*y[1:]), body) @ ca.DM(a))[axis])


@cache
def _of_rod(rod: RodMass, a: Vector, axis: int) -> Derived:
    """Return a component of a rod's part of J a beyond its end masses, as a function of p_i - p'_E, x_i and y_i."""
    y = [ca.SX.sym("y", 3) for _ in range(3)]
    d = -y[0] - rod.foot[0] * y[1] - rod.foot[1] * y[2]
    return Mapped(y, (rod_inertia_beyond_ends(d, rod) @ ca.DM(a))[axis])


@cache
def _of_tip(a: Vector, axis: int) -> Derived:
    """Return a component of a unit point mass's part of J a, as a function of its position."""
    y = ca.SX.sym("y", 3)
    return Mapped([y], (point_inertia(y) @ ca.DM(a))[axis])

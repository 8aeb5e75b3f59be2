"""The formulas of `nlp.requirements` with gradients and Hessians by their local vectors.

Those of pairs, of which there are most, are derived by hand (`nlp.assembled.kkt_candidates`), the others by CasADi,
once a process and not once a topology.

| symbol | meaning | shape | unit |
|---|---|---|---|
| y | the s local vectors of each of m clearances | (m, s, 3) | l_arm, - |
| w = p_i - p_j, z_i, z_j | those of a pair of envelopes | (m, 3) each | l_arm, - |
| C, D, E, F | coefficients of f_air that vary; A = B = l_air^2 - dr_air^2 | (m,) each | l_arm^2 |

Torques that angular accelerations take, as terms of the balances.

J a, of the inertia J about the COM and an acceleration a, is a sum over the modules with their joints, of functions
of o_i and their axes, of one of p_E, and of one of the rod that counts (`nlp.symbols.platform`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from nlp.assembled.kkt_candidates import smooth_least
from nlp.assembled.local_vectors import Indices, PlatformVectors, VectorLayout, differences, dot
from nlp.numbers.masses import Body, Masses, RodMass
from nlp.requirements.balances import turns
from nlp.requirements.bodies import Air
from nlp.requirements.modules import BesideAirflow
from nlp.requirements.statement import (
    COM,
    FROM_COM,
    FROM_TIP,
    X_I,
    Y_I,
    Z_I,
    Distance,
    Formula,
    LocalVector,
    PlatformVector,
)
from nlp.symbols.platform import beside_halves, of_body, spread
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit
from topo_search.model.value import Vector

Jet = list[Array]
"""Values (m,), then as far as asked for gradients (m, s, 3) and Hessians (m, 3 s, 3 s) by y."""
KEPT = 30
"""Largest number of buffers of one expression, one for each order and number of columns in use."""
Derived = Callable[[int, Array], Jet]
"""derived(order, y); order 0, 1 or 2."""


class Term:
    """m clearances of one kind, with the places of their derivatives."""

    def __init__(
        self,
        derived: Derived,
        vectors: Iterable[LocalVector],
        subjects: Indices,
        layout: VectorLayout,
        margin: float = 0.0,
    ) -> None:
        """Find the places.

        Args:
            derived: values and derivatives by the local vectors.
            vectors: those local vectors.
            subjects: modules i and j of each clearance, shape (2, m).
            layout: where vectors stand.
            margin: required clearance beyond zero [l_arm].
        """
        self._derived, self.margin = derived, margin
        self.plus, self.minus = layout.endpoints(vectors, subjects)
        self.m, involved = len(self.plus), np.concatenate([self.plus, self.minus], axis=1)
        moving, turning = layout.moved[involved].any(axis=1), layout.turned[involved].all(axis=1)
        self.rows, self.columns = np.nonzero(moving & ~turning)  # what turns as one stays as it is
        self.starts = np.concatenate([[0], np.cumsum(moving.sum(axis=1))])
        self.moving = np.nonzero(moving)[1]

    def derive(self, order: int, at: PlatformVectors) -> Jet:
        """Return values, and derivatives by the local vectors up to an order."""
        return self._derived(order, differences(at.V, self.plus, self.minus))


class Mapped:
    """A scalar CasADi expression of one column, evaluated with its derivatives for many columns at once."""

    def __init__(self, variables: ca.SX, expression: ca.SX) -> None:
        hessian, gradient = ca.hessian(expression, variables)
        results = [expression, ca.densify(gradient), ca.densify(hessian)]
        self._size = variables.numel()
        self._functions = [ca.Function("term", [variables], results[: order + 1]) for order in range(3)]
        self._buffers: dict[tuple[int, int], tuple[Any, Any, Array, Jet]] = {}

    def __call__(self, order: int, columns: Array) -> Jet:
        """Return values, and gradients and Hessians up to an order, for columns of shape (m, size)."""
        m = len(columns)
        if (order, m) not in self._buffers:
            while len(self._buffers) >= KEPT:  # the oldest goes first
                del self._buffers[next(iter(self._buffers))]
            self._buffers[order, m] = self._buffer(order, m)
        _, trigger, inputs, outputs = self._buffers[order, m]
        inputs[...] = columns
        trigger()
        return [output.copy() for output in outputs]

    def _buffer(self, order: int, m: int) -> tuple[Any, Any, Array, Jet]:
        """Return CasADi's buffer of the mapped function with the arrays that it reads and writes."""
        function: Any = self._functions[order].map(m)
        buffer, trigger = function.buffer()
        inputs = np.zeros((m, self._size))
        outputs = [np.zeros((m, *(self._size,) * axes)) for axes in range(order + 1)]
        buffer.set_arg(0, inputs.data)
        for number, output in enumerate(outputs):
            buffer.set_res(number, output.data)
        return (function, buffer), trigger, inputs, outputs  # the trigger keeps neither alive


def _envelope_pair(air: Air, beta: float) -> tuple[Derived]:
    """Return the smooth clearance of two airflow envelopes, of w, z_i, z_j.

    f depends on them through C, D, E and F alone, and on F by addition.
    """
    length, r_air, dr_air = air
    A = length**2 - dr_air**2
    sizes = length, dr_air, 2 * r_air, 4 * (r_air + dr_air)

    def differentiate(order: int, y: Array) -> Jet:
        c, base = _coefficients(y, *sizes)
        psi, by_c, curved = smooth_least(c, A, beta, order)
        jet = [(psi + base) / sizes[-1]]
        if order >= 1:
            jet.append(_gradients(y, by_c, *sizes))
        if order >= 2:
            jet.append(_hessians(y, by_c, curved, *sizes))
        return jet

    return (differentiate,)


@njit(cache=True)
def _coefficients(y: Array, length: float, dr_air: float, r_0: float, scale: float) -> tuple[Array, Array]:
    """Return C, D, E, shape (m, 3), and F, shape (m,)."""
    CDE, F = np.empty((len(y), 3)), np.empty(len(y))
    for r in range(len(y)):
        w, z_i, z_j = y[r]
        CDE[r, 0] = -2 * (length**2 * dot(z_i, z_j) + dr_air**2)
        CDE[r, 1] = -2 * (length * dot(z_i, w) + r_0 * dr_air)
        CDE[r, 2] = 2 * (length * dot(z_j, w) - r_0 * dr_air)
        F[r] = dot(w, w) - r_0**2
    return CDE, F


@njit(cache=True)
def _gradients(y: Array, by_CDE: Array, length: float, dr_air: float, r_0: float, scale: float) -> Array:
    """Return the gradients by y; C, D, E and F are bilinear."""
    gradients = np.empty_like(y)
    for r in range(len(y)):
        C, D, E = by_CDE[r]
        for axis in range(3):
            w, z_i, z_j = y[r, 0, axis], y[r, 1, axis], y[r, 2, axis]
            gradients[r, 0, axis] = (2 * w - 2 * length * (D * z_i - E * z_j)) / scale
            gradients[r, 1, axis] = -2 * length * (length * C * z_j + D * w) / scale
            gradients[r, 2, axis] = -2 * length * (length * C * z_i - E * w) / scale
    return gradients


@njit(cache=True)
def _hessians(
    y: Array, by_CDE: Array, curved: Array, length: float, dr_air: float, r_0: float, scale: float
) -> Array:
    """Return the Hessians by y; `curved` is the Hessian by C, D, E."""
    hessians = np.zeros((len(y), 9, 9))
    G = np.zeros((3, 9))  # gradients of C, D, E by y
    for r in range(len(y)):
        for axis in range(3):
            w, z_i, z_j = y[r, 0, axis], y[r, 1, axis], y[r, 2, axis]
            G[0, 3 + axis], G[0, 6 + axis] = -2 * length**2 * z_j, -2 * length**2 * z_i
            G[1, axis], G[1, 3 + axis] = -2 * length * z_i, -2 * length * w
            G[2, axis], G[2, 6 + axis] = 2 * length * z_j, 2 * length * w
        H = hessians[r]
        for one in range(9):
            a, b, c = G[0, one] / scale, G[1, one] / scale, G[2, one] / scale
            by_C = a * curved[r, 0, 0] + b * curved[r, 1, 0] + c * curved[r, 2, 0]
            by_D = a * curved[r, 0, 1] + b * curved[r, 1, 1] + c * curved[r, 2, 1]
            by_E = a * curved[r, 0, 2] + b * curved[r, 1, 2] + c * curved[r, 2, 2]
            for other in range(9):
                H[one, other] = by_C * G[0, other] + by_D * G[1, other] + by_E * G[2, other]
        C, D, E = by_CDE[r]
        for axis in range(3):
            w, i, j = axis, 3 + axis, 6 + axis
            H[w, w] += 2 / scale
            for row, column, value in (
                (i, j, -2 * length**2 * C / scale),
                (w, i, -2 * length * D / scale),
                (w, j, 2 * length * E / scale),
            ):
                H[row, column] += value
                H[column, row] += value
    return hessians


def _distance(formula: Distance) -> tuple[Derived]:
    """Return (||w||^2 - d^2) / (2 d), of w."""
    d = formula.least

    def differentiate(order: int, y: Array) -> Jet:
        w = y[:, 0]
        jet: Jet = [(np.einsum("ra,ra->r", w, w) - d**2) / (2 * d)]
        if order >= 1:
            jet.append(y / d)
        if order >= 2:
            jet.append(np.tile(np.eye(3) / d, (len(w), 1, 1)))
        return jet

    return (differentiate,)


@cache
def derived_rows(formula: Formula, beta: float) -> tuple[Derived, ...]:
    """Return every row of a formula's smooth form with its derivatives.

    The most frequent and the simplest rows have derivatives by hand.
    """
    if isinstance(formula, Distance):
        return _distance(formula)
    if isinstance(formula, BesideAirflow) and isinstance(formula.body, Air):
        return _envelope_pair(formula.air, beta)
    y = [ca.SX.sym("y", 3) for _ in formula.local_vectors]
    rows = ca.vertsplit(formula.smooth(y, ca.SX(beta)))
    return tuple(derive(y, row) for row in rows)


def derive(y: Sequence[ca.SX], row: ca.SX) -> Derived:
    """Return an expression of local vectors with its derivatives."""
    mapped = Mapped(ca.vertcat(*y), row)

    def differentiate(order: int, y: Array) -> Jet:
        jet = mapped(order, y.reshape(len(y), -1))
        if order >= 1:
            jet[1] = jet[1].reshape(y.shape)
        return jet

    return differentiate


PLACE = LocalVector(PlatformVector("p", 0), COM)
"""o_i."""


def turning_terms(task: ResolvedTask, carried: Masses, layout: VectorLayout) -> Iterator[tuple[int, Term]]:
    """Yield the rows of the balances that an acceleration changes, and the terms whose sums are taken off them."""
    n, m_E, rod = task.n, carried.tip, carried.rod
    alike = dict[Body, list[int]]()
    for i in range(n):
        alike.setdefault(carried.body(i), []).append(i)
    holder = np.full((2, 1), rod.module)
    for k, (x, y, z) in enumerate(turns(task).tolist()):
        for axis in range(3) if any((x, y, z)) else ():
            row, a = 6 * k + 3 + axis, (x / n, y / n, z / n)
            for body, same in alike.items():
                subjects = np.tile(same, (2, 1))
                yield row, Term(_of_body(body, a, axis), (PLACE, X_I, Y_I, Z_I), subjects, layout)
            of_tip = _of_tip((m_E * x / n, m_E * y / n, m_E * z / n), axis)
            yield row, Term(of_tip, (FROM_COM,), holder, layout)
            if rod.mass:
                yield row, Term(_of_rod(rod, a, axis), (FROM_TIP, X_I, Y_I), holder, layout)


@cache
def _of_body(body: Body, a: Vector, axis: int) -> Derived:
    """Return a component of a module's part of J a, of o_i and its axes."""
    y = [ca.SX.sym("y", 3) for _ in range(4)]
    return derive(y, (of_body(y[0], ca.horzcat(*y[1:]), body) @ ca.DM(a))[axis])


@cache
def _of_rod(rod: RodMass, a: Vector, axis: int) -> Derived:
    """Return a component of what a rod adds to its halves, of p_i - p'_E and the axes x and y of its module."""
    y = [ca.SX.sym("y", 3) for _ in range(3)]
    d = -y[0] - rod.foot[0] * y[1] - rod.foot[1] * y[2]
    return derive(y, (beside_halves(d, rod) @ ca.DM(a))[axis])


@cache
def _of_tip(a: Vector, axis: int) -> Derived:
    """Return a component of the part of a point of unit mass, of its place."""
    y = ca.SX.sym("y", 3)
    return derive([y], (spread(y) @ ca.DM(a))[axis])

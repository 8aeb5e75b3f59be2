"""Clearances as functions of local vectors, with gradients and Hessians.

The formulas are those of `nlp.envelope` and `nlp.exposure`. Those of pairs, of which there are most, are derived by
hand (`nlp.assembled.candidates`), those of exposure by CasADi, once a process and not once a topology.

| symbol | meaning | shape | unit |
|---|---|---|---|
| y | the s local vectors of each of m clearances | (m, s, 3) | l_arm, - |
| w = p_i - p_j, z_i, z_j | those of a pair of envelopes | (m, 3) each | l_arm, - |
| C, D, E, F | coefficients of f_air that vary; A = B = l_air^2 - dr_air^2 | (m,) each | l_arm^2 |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numba import njit

from nlp.assembled.candidates import smooth_least
from nlp.assembled.carried import Differences
from nlp.assembled.vectors import dot
from nlp.envelope import Ball, ConeSphere, clearance, clearance_of_all
from nlp.exposure import exposure_clearances
from nlp.units import Units
from topo_search.model import AirflowEnvelope, Directional, Exterior, Local, Module, needs_offset
from topo_search.model.airflow_room import part_cover
from topo_search.model.arrays import Array

Jet = list[Array]
"""Values (m,), then as far as asked for gradients (m, s, 3) and Hessians (m, 3 s, 3 s) by y."""
KEPT = 30
"""Most buffers of one expression, one for each order and number of columns in use."""
Formula = Callable[[int, Array], Jet]
"""formula(order, y); order 0, 1 or 2."""


@dataclass(frozen=True)
class Term:
    """m clearances of one kind."""

    formula: Formula
    vectors: Differences


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


@cache
def airflow_formula(length: float, r_air: float, dr_air: float, beta: float) -> Formula:
    """Return the smooth clearance of two airflow envelopes as a formula of w, z_i, z_j.

    f depends on them through C, D, E and F alone, and on F by addition.
    """
    A = length**2 - dr_air**2
    sizes = length, dr_air, 2 * r_air, 4 * (r_air + dr_air)

    def formula(order: int, y: Array) -> Jet:
        c, base = _coefficients(y, *sizes)
        psi, by_c, curved = smooth_least(c, A, beta, order)
        jet = [(psi + base) / sizes[-1]]
        if order >= 1:
            jet.append(_gradients(y, by_c, *sizes))
        if order >= 2:
            jet.append(_hessians(y, by_c, curved, *sizes))
        return jet

    return formula


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


@cache
def distance_formula(distance: float) -> Formula:
    """Return (||w||^2 - distance^2) / (2 distance) as a formula of w; see `nlp.problem.distance_gap`."""

    def formula(order: int, y: Array) -> Jet:
        w = y[:, 0]
        jet: Jet = [(np.einsum("ra,ra->r", w, w) - distance**2) / (2 * distance)]
        if order >= 1:
            jet.append(y / distance)
        if order >= 2:
            jet.append(np.tile(np.eye(3) / distance, (len(w), 1, 1)))
        return jet

    return formula


@cache
def parts_formula(module: Module, unit: Units, beta: float) -> Formula:
    """Return the smooth clearance of i's parts from j's airflow as a formula of p_i - p_j, x_i, y_i, z_i, z_j."""
    w, x, y, z, z_j = (ca.SX.sym(name, 3) for name in ("w", "x", "y", "z", "z_j"))
    balls, R = part_cover(module), ca.horzcat(x, y, z)
    parts = [
        Ball(w + R @ ca.DM(place), radius)
        for place, radius in zip(balls.centres / unit.length, (balls.radii / unit.length).tolist(), strict=True)
    ]
    gap = clearance_of_all(_envelope(module.envelope, unit, ca.SX.zeros(3), z_j), parts, ca.SX(beta))
    return _joined(Mapped(ca.vertcat(w, x, y, z, z_j), gap))


@cache
def tip_formula(air: AirflowEnvelope, rod_radius: float, unit: Units, beta: float) -> Formula:
    """Return the smooth clearance of the end-effector from an airflow as a formula of p_i - p'_E, z_i."""
    q, z = ca.SX.sym("q", 3), ca.SX.sym("z", 3)
    tip = Ball(ca.SX.zeros(3), rod_radius / unit.length)
    return _joined(Mapped(ca.vertcat(q, z), clearance(_envelope(air, unit, q, z), tip, ca.SX(beta))))


def _envelope(air: AirflowEnvelope, unit: Units, o: ca.SX, z: ca.SX) -> ConeSphere:
    return ConeSphere(o, -air.length / unit.length * z, air.start_radius / unit.length, air.growth / unit.length)


@cache
def exposure_formulas(
    requirement: Local | Directional | Exterior, air: AirflowEnvelope, unit: Units, beta: float
) -> tuple[Formula, ...]:
    """Return each row of an exposure requirement as a formula of p_i - p'_E, z_i and, if it needs it, p_E."""
    q, z, p_EB = ca.SX.sym("q", 3), ca.SX.sym("z", 3), ca.SX.sym("p_E", 3)
    envelope = _envelope(air, unit, q, z)
    gaps = exposure_clearances(requirement, envelope, p_E=ca.SX.zeros(3), p_EB=p_EB, beta=ca.SX(beta), unit=unit)
    rows = [row for _, gap in gaps for row in ca.vertsplit(gap)]
    variables = ca.vertcat(q, z, p_EB) if needs_offset(requirement) else ca.vertcat(q, z)
    mapped = [Mapped(variables, row) for row in rows]
    return tuple(_joined(formula) for formula in mapped)


def _joined(mapped: Mapped) -> Formula:
    def formula(order: int, y: Array) -> Jet:
        jet = mapped(order, y.reshape(len(y), -1))
        if order >= 1:
            jet[1] = jet[1].reshape(y.shape)
        return jet

    return formula

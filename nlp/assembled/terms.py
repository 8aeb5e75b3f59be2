"""Clearances as functions of local vectors, with gradients and Hessians.

The formulas are those of `nlp.envelope` and `nlp.exposure`, derived by CasADi once a process, not once a topology.

| symbol | meaning | shape | unit |
|---|---|---|---|
| w_0 = p_i - p_j, z_i, z_j | local vectors of a pair of envelopes | (m, 3) each | l_arm, - |
| C, D, E, F | coefficients of f_air that vary; A = B = l_air^2 - dr_air^2 | (m,) each | l_arm^2 |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from nlp.assembled.local_vectors import LocalVector
from nlp.envelope import ConeSphere, quadratic_candidates
from nlp.exposure import exposure_clearances
from nlp.smooth import log_sum_exp
from nlp.units import Units
from topo_search.model import Directional, Exterior, Local, ResolvedTask, needs_offset
from topo_search.model.arrays import Array

Jet = list[Array]
"""Values (m,), then as far as asked for gradients (m, 3 s) and Hessians (m, 3 s, 3 s) by s local vectors."""
KEPT = 30
"""Most buffers of one expression, one for each order and number of columns in use."""
Formula = Callable[..., Jet]
"""formula(order, *vectors) with the vectors' values, shape (m, 3) each; order 0, 1 or 2."""


@dataclass(frozen=True)
class Term:
    """m clearances of one kind."""

    formula: Formula
    vectors: tuple[LocalVector, ...]


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
    """Return the smooth clearance of two airflow envelopes as a formula of w_0, z_i, z_j.

    f depends on them through C, D, E and F alone, and on F by addition, so that CasADi derives a function of
    three numbers and the chain rule does the rest.
    """
    CDE = ca.SX.sym("CDE", 3)
    A = length**2 - dr_air**2
    psi = Mapped(CDE, log_sum_exp(quadratic_candidates(A, A, CDE[0], CDE[1], CDE[2], 0.0), beta))
    r_0, scale = 2 * r_air, 4 * (r_air + dr_air)

    def formula(order: int, w_0: Array, z_i: Array, z_j: Array) -> Jet:
        C = -2 * (length**2 * _dot(z_i, z_j) + dr_air**2)
        D = -2 * (length * _dot(z_i, w_0) + r_0 * dr_air)
        E = 2 * (length * _dot(z_j, w_0) - r_0 * dr_air)
        jet = psi(order, np.stack((C, D, E), axis=-1))
        result = [(jet[0] + _dot(w_0, w_0) - r_0**2) / scale]
        if order >= 1:
            G = np.zeros((len(w_0), 3, 9))  # gradients of C, D, E by (w_0, z_i, z_j)
            G[:, 0, 3:6], G[:, 0, 6:9] = -2 * length**2 * z_j, -2 * length**2 * z_i
            G[:, 1, 0:3], G[:, 1, 3:6] = -2 * length * z_i, -2 * length * w_0
            G[:, 2, 0:3], G[:, 2, 6:9] = 2 * length * z_j, 2 * length * w_0
            gradient = (jet[1][:, None] @ G)[:, 0]
            gradient[:, :3] += 2 * w_0
            result.append(gradient / scale)
        if order >= 2:
            by_C, by_D, by_E = jet[1].T
            H = G.transpose(0, 2, 1) @ jet[2] @ G
            for axis in range(3):  # C, D, E and F are bilinear
                w, i, j = axis, 3 + axis, 6 + axis
                H[:, w, w] += 2
                for row, column, weight in (
                    (i, j, -2 * length**2 * by_C),
                    (w, i, -2 * length * by_D),
                    (w, j, 2 * length * by_E),
                ):
                    H[:, row, column] += weight
                    H[:, column, row] += weight
            result.append(H / scale)
        return result

    return formula


@cache
def distance_formula(distance: float) -> Formula:
    """Return (||w||^2 - distance^2) / (2 distance) as a formula of w; see `nlp.problem.distance_gap`."""

    def formula(order: int, w: Array) -> Jet:
        hessians = np.broadcast_to(np.eye(3) / distance, (len(w), 3, 3))
        return [(_dot(w, w) - distance**2) / (2 * distance), w / distance, hessians][: order + 1]

    return formula


@cache
def exposure_formulas(
    requirement: Local | Directional | Exterior, task: ResolvedTask, beta: float
) -> tuple[Formula, ...]:
    """Return each row of an exposure requirement as a formula of p_i - p'_E, z_i and, if it needs it, p_E."""
    unit, air = Units.of(task), task.module.envelope
    q, z, p_EB = ca.SX.sym("q", 3), ca.SX.sym("z", 3), ca.SX.sym("p_E", 3)
    envelope = ConeSphere(
        q, -air.length / unit.length * z, air.start_radius / unit.length, air.growth / unit.length
    )
    gaps = exposure_clearances(requirement, envelope, p_E=ca.SX.zeros(3), p_EB=p_EB, beta=ca.SX(beta), unit=unit)
    rows = [row for _, gap in gaps for row in ca.vertsplit(gap)]
    variables = ca.vertcat(q, z, p_EB) if needs_offset(requirement) else ca.vertcat(q, z)
    mapped = [Mapped(variables, row) for row in rows]
    return tuple(_joined(formula) for formula in mapped)


def _joined(mapped: Mapped) -> Formula:
    return lambda order, *vectors: mapped(order, np.concatenate(vectors, axis=1))


def _dot(a: Array, b: Array) -> Array:
    result: Array = np.einsum("...i,...i->...", a, b)
    return result

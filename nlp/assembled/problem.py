"""Objective, constraints and derivatives of `nlp.problem`, assembled from their nonzero entries.

| symbol | meaning | shape |
|---|---|---|
| x | geometric unknowns: theta, then p'_E unless the task fixes it | (g,) |
| u | inputs of every load case, r rotors a module | (K, r n) |
| mu | multipliers of the balances | (K, 6) |
| V, A | vectors of the platform and wrenches of its rotors (`nlp.assembled.platform`) | |

All quantities are dimensionless, and variables are in the order of `nlp.problem.Variables`. The rows are the
balances, then the clearances, term by term.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from nlp.assembled.chain_rule import add_curvature, slopes
from nlp.assembled.platform import CROSS, AssembledPlatform, Layout
from nlp.assembled.terms import Derivatives, Term, derived_rows, inertia_terms
from nlp.requirements import Requirement
from nlp.units import Units
from topo_search.model import Array, Indices, ResolvedTask, Topology


class RowBlock(Protocol):
    """Rows of a program as functions of all unknowns; derivatives are entries of their patterns."""

    lower: Array
    """Lower bounds, shape (m,)."""
    upper: Array
    jacobian_pattern: ca.Sparsity
    hessian_pattern: ca.Sparsity
    """Upper triangle."""

    def values(self, variables: Array) -> Array | ca.DM:
        """Return the rows, shape (m,)."""

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of the Jacobian of the rows."""

    def hessian(self, variables: Array, multipliers: Array) -> Array:
        """Return the entries of the Hessian of the sum of rows times multipliers."""


class RequiredLoads(NamedTuple):
    """Required wrenches of all load cases, linear in p'_E and p_COM."""

    wrenches: Array
    """Forces and torques, shape (6 K,)."""
    levers: Array
    """Matrix from p'_E and p_COM to the torques of the forces there, shape (6 K, 6)."""

    @classmethod
    def of(cls, task: ResolvedTask) -> RequiredLoads:
        """Return the dimensionless loads of a task."""
        unit, K = Units.of(task), len(task.load_cases)
        at_tip, at_com = [c.at_end_effector for c in task.load_cases], [c.at_com for c in task.load_cases]
        f_E, f_C = (np.array([w.force for w in wrenches]) / (task.n * unit.force) for wrenches in (at_tip, at_com))
        tau = (np.array([w.torque for w in at_tip]) + np.array([w.torque for w in at_com])) / (task.n * unit.torque)
        levers = np.tensordot(np.stack([f_E, f_C], axis=1), CROSS, 1).transpose(0, 2, 1, 3)
        levers = np.concatenate([np.zeros_like(levers), levers], axis=1).reshape(6 * K, 6)
        return cls(np.hstack([f_E + f_C, tau]).ravel(), levers)


class AssembledProblem:
    """The numeric program of one task and topology, with some of its clearances."""

    def __init__(
        self, task: ResolvedTask, topology: Topology, requirements: Iterable[Requirement], beta: float
    ) -> None:
        """Build the index arrays of the program.

        Args:
            task: the task.
            topology: the tree.
            requirements: the clearances (4) to (9), or those that are near.
            beta: sharpness of the log-sum-exp.
        """
        self.n, self.K = topology.n, len(task.load_cases)
        self.layout = layout = Layout(task, topology)
        self.g = layout.g
        self.size = self.g + task.rotor_count * self.K
        self.loads = RequiredLoads.of(task)
        weights = np.array([case.weight for case in task.load_cases])
        self._weights = weights / (task.rotor_count * weights.sum())
        self._terms = [
            Term(derived, formula.local_vectors, requirement.subjects.T, layout, requirement.margin)
            for requirement in requirements
            for formula in (requirement.formulas if requirement.subjects.size else ())
            for derived in derived_rows(formula, beta)
        ]
        margins = [np.full(term.m, term.margin) for term in self._terms]
        self._index(list(inertia_terms(task, layout)))
        self.lower = np.concatenate([np.zeros(6 * self.K), *margins])
        self.upper = np.concatenate([np.zeros(6 * self.K), np.full(self.rows - 6 * self.K, math.inf)])
        self._x = np.full(self.g, math.nan)
        self._jets: list[Derivatives] | None = None
        self._appended: list[tuple[RowBlock, slice, Indices, Indices]] = []

    def _index(self, inertial: list[tuple[int, Term]]) -> None:
        """Find the patterns of the derivatives; `inertial` terms are subtracted from rows of the balances."""
        K, g, moves = self.K, self.g, self.layout.rotor_moves > 0
        rotors = len(moves)
        changing = np.concatenate([np.ones((6 * K, g), dtype=bool), *(term.changing for term in self._terms)])
        self.rows = len(changing)
        self._inertial_rows = np.array([row for row, term in inertial for _ in range(term.m)], dtype=np.intp)
        self._terms += (term for _, term in inertial)
        self._changing = changing.T
        self._mixed = np.flatnonzero(moves)
        self._by_angles = np.nonzero(np.hstack([moves, np.ones((rotors, 1), dtype=bool)]))[1] < self.n + 2
        """True for entries of a load case's inputs with angles; the others are on the diagonal."""
        balances_by_inputs = ca.diagcat(*[ca.Sparsity.dense(6, rotors)] * K)
        clearances_by_inputs = ca.Sparsity(self.rows - 6 * K, rotors * K)
        by_inputs = ca.vertcat(balances_by_inputs, clearances_by_inputs)
        self.jacobian_pattern = ca.horzcat(_pattern(self._changing), by_inputs)
        mixed = np.zeros((rotors, g), dtype=bool)
        mixed[:, : self.n + 2] = moves
        inputs = ca.vertcat(ca.horzcat(*[_pattern(mixed)] * K), ca.Sparsity.diag(rotors * K))
        geometry = ca.vertcat(ca.Sparsity.upper(g), ca.Sparsity(rotors * K, g))
        self.hessian_pattern = ca.horzcat(geometry, inputs)
        self._triangle = np.tril_indices(g)  # transposed: the upper triangle, column by column

    def append(self, rows: RowBlock) -> None:
        """Append rows to the program, and find the positions of their entries among the existing ones."""
        above, below, own_pattern = self.jacobian_pattern, rows.jacobian_pattern, self.hessian_pattern
        self.jacobian_pattern = ca.vertcat(above, below)
        self.hessian_pattern = own_pattern.unite(rows.hessian_pattern)
        first = ca.DM(above, list(range(above.nnz())))
        second = ca.DM(below, list(range(above.nnz(), self.jacobian_pattern.nnz())))
        order = np.array(ca.vertcat(first, second).nonzeros(), dtype=np.intp)
        entries = [self.hessian_pattern.get_nz(part.find()) for part in (own_pattern, rows.hessian_pattern)]
        indices = slice(self.rows, self.rows + len(rows.lower))
        self._appended.append((rows, indices, order, np.concatenate(entries).astype(np.intp)))
        self.rows = indices.stop
        self.lower, self.upper = np.append(self.lower, rows.lower), np.append(self.upper, rows.upper)

    def platform_at(self, variables: Array) -> tuple[AssembledPlatform, Array]:
        """Return the platform and the inputs; the platform is cached until the geometry changes."""
        x = variables[: self.g]
        if not (x == self._x).all():
            self._x = x.copy()
            self.platform, self._jets = AssembledPlatform(self.layout, self._x), None
        return self.platform, variables[self.g :].reshape(self.K, -1)

    def _derive(self, platform: AssembledPlatform) -> list[Derivatives]:
        self._jets = self._jets or [term.evaluate(platform) for term in self._terms]
        return self._jets

    def objective(self, variables: Array) -> float:
        """Return (1)."""
        u = variables[self.g :].reshape(self.K, -1)
        return float(self._weights @ np.einsum("kr,kr->k", u, u))

    def gradient(self, variables: Array) -> Array:
        """Return the gradient of (1)."""
        u = variables[self.g :].reshape(self.K, -1)
        return np.concatenate([np.zeros(self.g), (2 * self._weights[:, None] * u).ravel()])

    def constraints(self, variables: Array) -> Array:
        """Return (2) to (9)."""
        platform, u = self.platform_at(variables)
        balances = (u @ platform.A).ravel() - (self.loads.wrenches + self.loads.levers @ platform.V[-3:-1].ravel())
        values = [balances, *(value for value, _, _ in self._derive(platform))]
        appended = [np.asarray(rows.values(variables), dtype=float).ravel() for rows, _, _, _ in self._appended]
        return np.concatenate([self._subtract_inertial(np.concatenate(values)), *appended])

    def _subtract_inertial(self, rows: Array) -> Array:
        count = len(rows) - len(self._inertial_rows)
        np.subtract.at(rows, self._inertial_rows, rows[count:])
        return rows[:count]

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of the Jacobian of (2) to (9), in the order of `jacobian_pattern`."""
        platform, u = self.platform_at(variables)
        balances = -self.loads.levers @ platform.dV[-3:-1].transpose(0, 2, 1).reshape(6, -1)
        balances[:, : self.n + 2] += (u @ platform.dA).transpose(1, 0, 2).reshape(6 * self.K, -1)
        rows = [balances]
        for term, (_, gradient, _) in zip(self._terms, self._derive(platform), strict=True):
            rows.append(slopes(gradient, term.plus, term.minus, platform.dV, term.changing))
        by_geometry = self._subtract_inertial(np.concatenate(rows))
        result = np.concatenate([by_geometry.T[self._changing], *[platform.A.ravel()] * self.K])
        for appended, _, order, _ in self._appended:
            result = np.concatenate([result, appended.jacobian(variables)])[order]
        return result

    def hessian(self, variables: Array, objective_factor: float, multipliers: Array) -> Array:
        """Return the entries of the Lagrangian's Hessian, in the order of `hessian_pattern` (upper triangle)."""
        platform, u = self.platform_at(variables)
        K, count = self.K, self.rows - sum(len(rows.lower) for rows, _, _, _ in self._appended)
        mu = multipliers[: 6 * K].reshape(K, 6)
        weights = np.concatenate([multipliers[6 * K : count], -multipliers[self._inertial_rows]])
        by_V, curved, row = np.zeros_like(platform.V), np.zeros((self.g, self.g)), 0
        by_V[-3:-1] -= (mu.ravel() @ self.loads.levers).reshape(2, 3)
        for term, (_, gradient, hessian) in zip(self._terms, self._derive(platform), strict=True):
            w = weights[row : row + term.m]
            add_curvature(w, gradient, hessian, term.plus, term.minus, platform.dV, term.moving, by_V, curved)
            row += term.m
        H = curved + platform.curvature(by_V, u.T @ mu)
        by_inputs = np.repeat(2 * objective_factor * self._weights[:, None], len(self._by_angles), axis=1)
        by_inputs[:, self._by_angles] = mu @ platform.dA.reshape(6, -1).take(self._mixed, 1)
        result = np.concatenate([H.T[self._triangle], by_inputs.ravel()])
        for rows, indices, _, entries in self._appended:
            added = rows.hessian(variables, multipliers[indices])
            result = np.bincount(entries, np.concatenate([result, added])).astype(float)
        return result


def _pattern(transposed: Array) -> ca.Sparsity:
    """Return CasADi's pattern of the nonzero entries of a matrix, given its transposed mask."""
    columns, rows = np.nonzero(transposed)
    starts = np.searchsorted(columns, np.arange(len(transposed) + 1))
    return ca.Sparsity(transposed.shape[1], len(transposed), starts.tolist(), rows.tolist())

"""Objective, constraints and derivatives of `nlp.problem`, put together where they are not zero.

| symbol | meaning | shape |
|---|---|---|
| x | geometric unknowns: theta, then p'_E unless the task fixes it | (g,) |
| u | inputs of every load case | (K, 4n) |
| mu | multipliers of the balances | (K, 6) |
| V, A | vectors of the platform, wrenches of its rotors; see `nlp.assembled.platform` | |
| y | local vectors of all terms, one below the other | (L, 3) |

All dimensionless, variables in the order of `nlp.problem.Variables`. The rows are the balances, then the
clearances, term by term.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from nlp.assembled.platform import CROSS, Indices, Layout, Platform
from nlp.assembled.terms import Jet, Term, derived_rows, turning_terms
from nlp.requirements import Requirement
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array

if TYPE_CHECKING:
    from nlp.assembled.air import SpeedRows
    from nlp.user_constraints.rows import DerivedRows


class AssembledProblem:
    """The program of one task and topology with some of its clearances, as numbers."""

    def __init__(
        self, task: ResolvedTask, topology: Topology, requirements: Iterable[Requirement], beta: float
    ) -> None:
        """Index the program; no symbol of the topology is built.

        Args:
            task: the task.
            topology: the tree.
            requirements: the clearances (4) to (9), or as many of them as are near.
            beta: sharpness of the log-sum-exp.
        """
        unit = Units.of(task)
        self.n, self.K = topology.n, len(task.load_cases)
        self.layout = layout = Layout(task, topology)
        self.g = layout.g
        self.size = self.g + 4 * self.n * self.K
        tip, com = [c.at_end_effector for c in task.load_cases], [c.at_com for c in task.load_cases]
        f_E, f_C = (np.array([w.force for w in side]) / (self.n * unit.force) for side in (tip, com))
        tau = (np.array([w.torque for w in tip]) + np.array([w.torque for w in com])) / (self.n * unit.torque)
        self._wrenches = np.hstack([f_E + f_C, tau]).ravel()
        levers = np.tensordot(np.stack([f_E, f_C], axis=1), CROSS, 1).transpose(0, 2, 1, 3)
        self._levers = np.concatenate([np.zeros_like(levers), levers], axis=1).reshape(6 * self.K, 6)
        """From p'_E and p_COM to the wrenches of the forces that are asked for there."""
        weights = np.array([case.weight for case in task.load_cases])
        self._weights = weights / (4 * self.n * weights.sum())
        self._terms = [
            Term(derived, formula.local_vectors, asked.subjects.T, layout, asked.margin)
            for asked in requirements
            for formula in (asked.formulas if asked.subjects.size else ())
            for derived in derived_rows(formula, beta)
        ]
        margins = [np.full(term.m, term.margin) for term in self._terms]
        turned, turning = [], list(turning_terms(task, layout))
        for row, term in turning:
            turned += [row] * term.m
        self._index(turned, [term for _, term in turning])
        self.lower = np.concatenate([np.zeros(6 * self.K), *margins])
        self.upper = np.concatenate([np.zeros(6 * self.K), np.full(self.rows - 6 * self.K, math.inf)])
        self._x = np.full(self.g, math.nan)
        self._further: list[tuple[DerivedRows | SpeedRows, slice, Indices, Indices]] = []

    def _index(self, turned: list[int], turning: list[Term]) -> None:
        """Find where derivatives are not zero; `turning` terms are taken off the rows `turned` of the balances."""
        n, K, g = self.n, self.K, self.g
        slopes = np.concatenate([np.ones((6 * K, g), dtype=bool), *(term.slopes for term in self._terms)])
        self.rows, self._turned = len(slopes), np.array(turned, dtype=np.intp)
        self._terms += turning
        self._plus, self._minus = (
            np.concatenate([np.empty(0, np.intp), *(getattr(term, side).ravel() for term in self._terms)])
            for side in ("plus", "minus")
        )
        counts = [term.plus.shape[1] for term in self._terms for _ in range(term.m)]
        self._starts = np.cumsum([0, *counts])[:-1]
        self._slopes = slopes.T
        self._mixed = np.ones((4 * n, n + 3), dtype=bool)
        self._mixed[:, :-1] = np.repeat(self.layout.tree.moves.T, 4, axis=0)
        balances_by_inputs = ca.diagcat(*[ca.Sparsity.dense(6, 4 * n)] * K)
        clearances_by_inputs = ca.Sparsity(self.rows - 6 * K, 4 * n * K)
        by_inputs = ca.vertcat(balances_by_inputs, clearances_by_inputs)
        self.jacobian_pattern = ca.horzcat(_pattern(self._slopes), by_inputs)
        mixed = np.zeros((4 * n, g), dtype=bool)
        mixed[:, : n + 2] = self._mixed[:, :-1]
        inputs = ca.vertcat(ca.horzcat(*[_pattern(mixed)] * K), ca.Sparsity.diag(4 * n * K))
        geometry = ca.vertcat(ca.Sparsity.upper(g), ca.Sparsity(4 * n * K, g))
        self.hessian_pattern = ca.horzcat(geometry, inputs)
        self._triangle = np.tril_indices(g)  # transposed: of the upper triangle, column by column

    def append(self, rows: DerivedRows | SpeedRows) -> None:
        """Append rows below those of the program, and find where their entries go among those so far."""
        above, below, before = self.jacobian_pattern, rows.jacobian_pattern, self.hessian_pattern
        self.jacobian_pattern = ca.vertcat(above, below)
        self.hessian_pattern = before.unite(rows.hessian_pattern)
        first = ca.DM(above, list(range(above.nnz())))
        second = ca.DM(below, list(range(above.nnz(), self.jacobian_pattern.nnz())))
        order = np.array(ca.vertcat(first, second).nonzeros(), dtype=np.intp)
        entries = [self.hessian_pattern.get_nz(part.find()) for part in (before, rows.hessian_pattern)]
        mine = slice(self.rows, self.rows + len(rows.lower))
        self._further.append((rows, mine, order, np.concatenate(entries).astype(np.intp)))
        self.rows = mine.stop
        self.lower, self.upper = np.append(self.lower, rows.lower), np.append(self.upper, rows.upper)

    def at(self, variables: Array) -> tuple[Platform, Array]:
        """Return the platform and the inputs; the platform is kept until the geometry changes."""
        x = variables[: self.g]
        if not np.array_equal(x, self._x):
            self._x = x.copy()
            self.platform = Platform(self.layout, self._x)
        return self.platform, variables[self.g :].reshape(self.K, -1)

    def objective(self, variables: Array) -> float:
        """Return (1)."""
        u = variables[self.g :].reshape(self.K, -1)
        return float(self._weights @ np.einsum("kr,kr->k", u, u))

    def gradient(self, variables: Array) -> Array:
        """Return the gradient of (1)."""
        u = variables[self.g :].reshape(self.K, -1)
        return np.concatenate([np.zeros(self.g), (2 * self._weights[:, None] * u).ravel()])

    def _derive(self, order: int, at: Platform) -> list[Jet]:
        """Return values, and derivatives by their local vectors up to an order, of all terms."""
        y, jets, first = at.V[self._plus] - at.V[self._minus], [], 0
        for term in self._terms:
            last = first + term.plus.size
            jets.append(term.derived(order, y[first:last].reshape(*term.plus.shape, 3)))
            first = last
        return jets

    def constraints(self, variables: Array) -> Array:
        """Return (2) to (9)."""
        at, u = self.at(variables)
        asked = self._wrenches + self._levers @ at.V[-3:-1].ravel()
        values = [(u @ at.A).ravel() - asked, *(values for (values,) in self._derive(0, at))]
        further = [np.asarray(rows.values(variables), dtype=float).ravel() for rows, _, _, _ in self._further]
        return np.concatenate([self._take_off_turning(np.concatenate(values)), *further])

    def _take_off_turning(self, rows: Array) -> Array:
        own = len(rows) - len(self._turned)
        np.subtract.at(rows, self._turned, rows[own:])
        return rows[:own]

    def jacobian(self, variables: Array) -> Array:
        """Return the Jacobian of (2) to (9), its entries in the order of `jacobian_pattern`."""
        at, u = self.at(variables)
        balances = -self._levers @ at.dV[-3:-1].reshape(6, -1)
        balances[:, : self.n + 2] += (u @ at.dA.reshape(4 * self.n, -1)).reshape(6 * self.K, -1)
        gradients = np.concatenate([np.empty((0, 3)), *(jet[1].reshape(-1, 3) for jet in self._derive(1, at))])
        each = np.einsum("la,lag->lg", gradients, at.dV[self._plus] - at.dV[self._minus])
        by_geometry = self._take_off_turning(np.vstack([balances, np.add.reduceat(each, self._starts)]))
        result = np.concatenate([by_geometry.T[self._slopes], *[at.A.ravel()] * self.K])
        for rows, _, order, _ in self._further:
            result = np.concatenate([result, rows.jacobian(variables)])[order]
        return result

    def hessian(self, variables: Array, of_objective: float, multipliers: Array) -> Array:
        """Return the Hessian of the Lagrangian, its entries in the order of `hessian_pattern` (upper triangle)."""
        at, u = self.at(variables)
        K, own = self.K, self.rows - sum(len(rows.lower) for rows, _, _, _ in self._further)
        mu = multipliers[: 6 * K].reshape(K, 6)
        weights = np.concatenate([multipliers[6 * K : own], -multipliers[self._turned]])
        dy, first, row = at.dV[self._plus] - at.dV[self._minus], 0, 0
        gradients, bent = np.empty((len(dy), 3)), np.empty((3 * len(dy), self.g))
        for term, (_, gradient, hessian) in zip(self._terms, self._derive(2, at), strict=True):
            last, weight = first + term.plus.size, weights[row : row + term.m, None, None]
            gradients[first:last] = (weight * gradient).reshape(-1, 3)
            each = (weight * hessian) @ dy[first:last].reshape(term.m, -1, self.g)
            bent[3 * first : 3 * last] = each.reshape(-1, self.g)
            first, row = last, row + term.m
        by_V = spread(gradients, self._plus, self._minus, len(at.V))
        by_V[-3:-1] -= (mu.ravel() @ self._levers).reshape(2, 3)
        H = at.bend(by_V, u.T @ mu) + dy.reshape(-1, self.g).T @ bent
        mixed = np.empty((K, *self._mixed.shape))
        mixed[:, :, :-1] = np.tensordot(mu, at.dA, (1, 1))
        mixed[:, :, -1] = 2 * of_objective * self._weights[:, None]
        result = np.concatenate([H.T[self._triangle], mixed[:, self._mixed].ravel()])
        for rows, mine, _, entries in self._further:
            added = rows.hessian(variables, multipliers[mine])
            result = np.bincount(entries, np.concatenate([result, added])).astype(float)
        return result


def spread(gradients: Array, plus: Indices, minus: Indices, count: int) -> Array:
    """Return the gradient by V (count, 3) of a function with a gradient by local vectors, shape (L, 3)."""
    sides = [np.bincount(plus, side, count) - np.bincount(minus, side, count) for side in gradients.T]
    return np.stack(sides, axis=1)


def _pattern(filled: Array) -> ca.Sparsity:
    """Return CasADi's pattern of a matrix that is not zero where its transpose is True."""
    columns, rows = np.nonzero(filled)
    starts = np.searchsorted(columns, np.arange(len(filled) + 1))
    return ca.Sparsity(filled.shape[1], len(filled), starts.tolist(), rows.tolist())

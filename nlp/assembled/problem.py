"""Objective, constraints and derivatives of `nlp.problem`, put together where they are not zero.

| symbol | meaning | shape |
|---|---|---|
| x | geometric unknowns: theta, then p'_E unless the task fixes it | (g,) |
| u | inputs of every load case | (K, n, 4) |
| A | wrench of every rotor at unit input; see `nlp.assembled.balance` | (n, 4, 6) |

All dimensionless, variables in the order of `nlp.problem.Variables`. The rows are the balances, then the
clearances, term by term.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from nlp.assembled.balance import add_bends, balances, by_inputs, by_point, rotors, slopes
from nlp.assembled.local_vectors import (
    Indices,
    PlatformVectors,
    VectorLayout,
    add_curvature,
    add_gradients,
    chain_rule,
    links_at,
)
from nlp.assembled.terms import Term, derived_rows, turning_terms
from nlp.numbers.geometry import torque_map
from nlp.numbers.kinematics import tree_of
from nlp.numbers.masses import masses
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
        module, unit = task.module, Units.of(task)
        self.n, self.K = topology.n, len(task.load_cases)
        self._tree, self._l_c = tree_of(topology), module.connector_distance / unit.length
        self.parents = self._tree.parent
        self._fixed = task.end_effector.fixed_position
        self._torque_map = torque_map(module)
        self.g = self.n + 2 + (3 if self._fixed is None else 0)
        self.size = self.g + 4 * self.n * self.K
        self._masses = masses(module, task.end_effector, topology)
        if self._fixed is not None:
            self._from_bodies = self._masses.lever * np.array(self._fixed) / unit.length
        tip, com = [c.at_end_effector for c in task.load_cases], [c.at_com for c in task.load_cases]
        self._f_E, self._f_C = (np.array([w.force for w in side]) / (self.n * unit.force) for side in (tip, com))
        self._tau = (np.array([w.torque for w in tip]) + np.array([w.torque for w in com])) / (self.n * unit.torque)
        weights = np.array([case.weight for case in task.load_cases])
        self._weights = weights / (4 * self.n * weights.sum())
        self.layout = layout = VectorLayout(self._tree.moves, free=self._fixed is None)
        self._clearances = [term for requirement in requirements for term in _terms(requirement, layout, beta)]
        self._turning = list(turning_terms(task, self._masses, layout))
        self._index()
        margins = [np.full(term.m, term.margin) for term in self._clearances]
        self.lower = np.concatenate([np.zeros(6 * self.K), *margins])
        self.upper = np.concatenate([np.zeros(6 * self.K), np.full(self.rows - 6 * self.K, math.inf)])
        self._x = np.full(self.g, math.nan)
        self._further: list[tuple[DerivedRows | SpeedRows, slice, Indices, Indices]] = []

    def _index(self) -> None:
        """Find where derivatives are not zero."""
        n, K, g = self.n, self.K, self.g
        rows, columns = (index.ravel() for index in np.indices((6 * K, g)))
        self.rows = 6 * K
        for term in self._clearances:
            rows = np.concatenate([rows, self.rows + term.rows])
            columns = np.concatenate([columns, term.columns])
            self.rows += term.m
        self._by_geometry = np.lexsort((rows, columns))
        by_geometry = _pattern(self.rows, g, rows[self._by_geometry], columns[self._by_geometry])
        balances_by_inputs = ca.diagcat(*[ca.Sparsity.dense(6, 4 * n)] * K)
        clearances_by_inputs = ca.Sparsity(self.rows - 6 * K, 4 * n * K)
        self.jacobian_pattern = ca.horzcat(by_geometry, ca.vertcat(balances_by_inputs, clearances_by_inputs))

        moving = self._tree.moves.T
        self._starts = np.concatenate([[0], np.cumsum(moving.sum(axis=1))])
        self._angles = np.nonzero(moving)[1]
        rotor, angle = np.nonzero(np.repeat(moving, 4, axis=0))
        mixed = ca.horzcat(*[_pattern(g, 4 * n, angle, rotor)] * K)
        inputs = ca.Sparsity.diag(4 * n * K)
        geometry = ca.vertcat(ca.Sparsity.upper(g), ca.Sparsity(4 * n * K, g))
        self.hessian_pattern = ca.horzcat(geometry, ca.vertcat(mixed, inputs))
        self._columns, self._rows = np.tril_indices(g)  # of the upper triangle, column by column

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

    def at(self, variables: Array) -> tuple[PlatformVectors, Array]:
        """Return the platform and the inputs; the platform is kept until the geometry changes."""
        x = variables[: self.g]
        if not np.array_equal(x, self._x):
            self._x = x.copy()
            angles, tip = self._x[: self.n + 2], self._x[self.n + 2 :]
            links, free = links_at(angles, self._tree, self._l_c), self._fixed is None
            tip = tip if free else self._from_bodies
            self.platform = PlatformVectors(links, self._tree.moves, tip, self._masses, free=free)
            self._A = rotors(links.R, links.p, self._torque_map)
        return self.platform, variables[self.g :].reshape(self.K, self.n, 4)

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
        at, u = self.at(variables)
        balance = balances(self._A, u, at.p_E, at.p_COM, self._f_E, self._f_C, self._tau).ravel()
        for row, term in self._turning:
            balance[row] -= term.derive(0, at)[0].sum()
        values = [term.derive(0, at)[0] for term in self._clearances]
        further = [np.asarray(rows.values(variables), dtype=float).ravel() for rows, _, _, _ in self._further]
        return np.concatenate([balance, *values, *further])

    def jacobian(self, variables: Array) -> Array:
        """Return the Jacobian of (2) to (9), its entries in the order of `jacobian_pattern`."""
        at, u = self.at(variables)
        links, dp_E, dp_COM = at.links, at.dV[self.n], at.dV[self.n + 1]
        by_geometry = slopes(self._A, u, links.omega, links.v, self.parents, self._f_E, self._f_C, dp_E, dp_COM)
        for row, term in self._turning:
            _, gradient = term.derive(1, at)
            slope = chain_rule(gradient, term.plus, term.minus, at.dV, term.rows, term.columns)
            np.subtract.at(by_geometry.reshape(-1, self.g)[row], term.columns, slope)
        entries = [by_geometry.ravel()]
        for term in self._clearances:
            _, gradient = term.derive(1, at)
            entries.append(chain_rule(gradient, term.plus, term.minus, at.dV, term.rows, term.columns))
        result = np.concatenate([np.concatenate(entries)[self._by_geometry], *[self._A.ravel()] * self.K])
        for rows, _, order, _ in self._further:
            result = np.concatenate([result, rows.jacobian(variables)])[order]
        return result

    def hessian(self, variables: Array, of_objective: float, multipliers: Array) -> Array:
        """Return the Hessian of the Lagrangian, its entries in the order of `hessian_pattern` (upper triangle)."""
        at, u = self.at(variables)
        n, K, A = self.n, self.K, self._A
        omega, v, p = at.links.omega, at.links.v, at.links.p
        mu = multipliers[: 6 * K].reshape(K, 6)
        H = np.zeros((self.g, self.g))
        to = np.zeros_like(at.V)
        to[n], to[n + 1] = by_point(mu, self._f_E), by_point(mu, self._f_C)
        weighted = [(np.full(term.m, -multipliers[row]), term) for row, term in self._turning]
        row = 6 * K
        for term in self._clearances:
            weighted.append((multipliers[row : row + term.m], term))
            row += term.m
        for weights, term in weighted:
            _, gradient, hessian = term.derive(2, at)
            add_gradients(weights, gradient, term.plus, term.minus, to)
            add_curvature(weights, hessian, term.plus, term.minus, at.dV, term.starts, term.moving, H)
        g_p, g_axes = at.push_to_modules(to)
        add_bends(A, u, mu, omega, v, self.parents, p, at.axes, g_p, g_axes, H)
        diagonal = 2 * of_objective * self._weights
        inputs = by_inputs(A, mu, omega, v, self._starts, self._angles, diagonal)
        result = np.concatenate([H[self._rows, self._columns], inputs])
        for rows, mine, _, entries in self._further:
            added = rows.hessian(variables, multipliers[mine])
            result = np.bincount(entries, np.concatenate([result, added])).astype(float)
        return result


def _terms(requirement: Requirement, layout: VectorLayout, beta: float) -> Iterator[Term]:
    """Yield the terms of a requirement."""
    subjects = requirement.subjects.T
    if not subjects.size:
        return
    for formula in requirement.formulas:
        for derived in derived_rows(formula, beta):
            yield Term(derived, formula.local_vectors, subjects, layout, requirement.margin)


def _pattern(rows: int, columns: int, i: Indices, j: Indices) -> ca.Sparsity:
    """Return CasADi's pattern of entries (i, j), which come column by column as its own do."""
    starts = np.searchsorted(j, np.arange(columns + 1))
    return ca.Sparsity(rows, columns, starts.tolist(), i.tolist())

"""Objective, constraints and derivatives of `nlp.problem`, put together where they are not zero.

| symbol | meaning | shape |
|---|---|---|
| x | geometric unknowns: theta, then p'_E unless the task fixes it | (g,) |
| u | inputs, load case by load case | (K, 4n) |
| A | wrench of every rotor at unit input, a row a rotor, about W's origin | (4n, 6) |
| b_k | the asked wrench | (6,) |
| mu_k | multipliers of load case k's balance A^T u_k = b_k | (6,) |

All dimensionless, variables in the order of `nlp.problem.Variables`. The rows are the balances, then the
clearances, term by term.
"""

from __future__ import annotations

import math
from itertools import combinations

import casadi as ca
import numpy as np

from nlp.assembled.carried import (
    Carried,
    Differences,
    Indices,
    Mask,
    Platform,
    add_curvature,
    add_gradients,
    chain_rule,
)
from nlp.assembled.chain import Chain, Links, cross, skew
from nlp.assembled.terms import Term, airflow_formula, distance_formula, exposure_formulas
from nlp.units import Units
from nlp.wrench import torque_map
from topo_search.model import LEAST_OFFSET, ResolvedTask, Topology, needs_offset
from topo_search.model.arrays import Array


class Clearances:
    """A term with the places of its derivatives."""

    def __init__(self, term: Term, moved: Mask, n: int) -> None:
        """Find them; `moved`: see `Carried`."""
        self.formula, self.vectors = term.formula, term.vectors
        self.plus, self.minus = term.vectors.plus, term.vectors.minus
        self.m = len(self.plus)
        moving = term.vectors.moving(moved)
        self.rows, self.columns = np.nonzero(moving & ~term.vectors.turned_as_one(moved, n))
        self.starts = np.concatenate([[0], np.cumsum(moving.sum(axis=1))])
        self.moving = np.nonzero(moving)[1]


class Assembly:
    """The program of one task and topology with some pairs of envelopes, as numbers."""

    def __init__(self, task: ResolvedTask, topology: Topology, pairs: Indices, beta: float) -> None:
        """Index the program; no symbol of the topology is built.

        Args:
            task: the task.
            topology: the tree.
            pairs: envelope pairs to keep apart, shape (m, 2); ignored in the ablation.
            beta: sharpness of the log-sum-exp.
        """
        module, unit = task.module, Units.of(task)
        self.n, self.K = topology.n, len(task.load_cases)
        self._chain = Chain(topology, module.connector_distance / unit.length)
        self._m_E = task.end_effector.mass / module.mass
        self._fixed = task.end_effector.fixed_position
        self._torque_map = np.array(torque_map(module)).T
        self.g = self.n + 2 + (3 if self._fixed is None else 0)
        self.size = self.g + 4 * self.n * self.K
        self._p_EB = None if self._fixed is None else np.array(self._fixed) / unit.length
        tip, com = [c.at_end_effector for c in task.load_cases], [c.at_com for c in task.load_cases]
        self._f_E, self._f_C = (np.array([w.force for w in side]) / unit.force for side in (tip, com))
        self._skew_E, self._skew_C = skew(self._f_E), skew(self._f_C)
        self._tau = (np.array([w.torque for w in tip]) + np.array([w.torque for w in com])) / unit.torque
        weights = np.array([case.weight for case in task.load_cases])
        self._weights = weights / (4 * self.n * weights.sum())
        moved = Carried(self.n).moved(self._chain.moves.astype(bool), free=self._fixed is None)
        self._clearances = [Clearances(term, moved, self.n) for term in _terms(task, topology, pairs, beta)]
        self._index()
        margin = task.search.margin / unit.length
        self.lower = np.concatenate([np.zeros(6 * self.K), np.full(self.rows - 6 * self.K, margin)])
        if any(needs_offset(requirement) for requirement in task.exposure):
            self.lower[-1] = 0.0  # the last term: no clearance, so no margin
        self.upper = np.concatenate([np.zeros(6 * self.K), np.full(self.rows - 6 * self.K, math.inf)])
        self._x = np.full(self.g, math.nan)

    def _index(self) -> None:
        """Find where derivatives are not zero."""
        n, K, g = self.n, self.K, self.g
        rotors, moves = np.arange(4 * n), self._chain.moves.astype(bool)
        rows, columns = (index.ravel() for index in np.indices((6 * K, g)))
        self.rows = 6 * K
        for placed in self._clearances:
            rows = np.concatenate([rows, self.rows + placed.rows])
            columns = np.concatenate([columns, placed.columns])
            self.rows += placed.m
        k, axis, rotor = (index.ravel() for index in np.meshgrid(np.arange(K), np.arange(6), rotors, indexing="ij"))
        rows = np.concatenate([rows, 6 * k + axis])
        columns = np.concatenate([columns, g + 4 * n * k + rotor])
        self.jacobian_pattern, self._j_order = _pattern(self.rows, self.size, rows, columns)

        self._h_upper = np.triu_indices(g)
        self._h_angle, self._h_rotor = np.nonzero(np.repeat(moves, 4, axis=1))
        inputs = g + np.arange(4 * n * K)
        rows = np.concatenate([self._h_upper[0], np.tile(self._h_angle, K), inputs])
        mixed = [g + 4 * n * case + self._h_rotor for case in range(K)]
        columns = np.concatenate([self._h_upper[1], *mixed, inputs])
        self.hessian_pattern, self._h_order = _pattern(self.size, self.size, rows, columns)

    def _at(self, variables: Array) -> tuple[Platform, Array]:
        """Return the platform and the inputs; the platform is kept until the geometry changes."""
        x = variables[: self.g]
        if not np.array_equal(x, self._x):
            self._x = x.copy()
            self._platform = self._placed(self._x)
            self._A = self._rotors(self._platform.links)
        return self._platform, variables[self.g :].reshape(self.K, -1)

    def _placed(self, x: Array) -> Platform:
        n, m_E = self.n, self._m_E
        links = self._chain.at(x[: n + 2])
        centroid = links.p.mean(axis=0)
        p_E = x[n + 2 :] if self._p_EB is None else centroid + (n + m_E) / n * self._p_EB
        return Platform(links, p_E, m_E, free=self._p_EB is None)

    def _rotors(self, links: Links) -> Array:
        """Return A."""
        A = np.empty((self.n, 4, 6))
        A[:, :, :3] = links.z[:, None] / 4
        A[:, :, 3:] = cross(links.p, links.z)[:, None] / 4 + self._torque_map @ links.R.transpose(0, 2, 1)
        rows: Array = A.reshape(-1, 6)
        return rows

    def objective(self, variables: Array) -> float:
        """Return (1)."""
        u = variables[self.g :].reshape(self.K, -1)
        return float(self._weights @ np.einsum("kr,kr->k", u, u))

    def gradient(self, variables: Array) -> Array:
        """Return the gradient of (1)."""
        u = variables[self.g :].reshape(self.K, -1)
        return np.concatenate([np.zeros(self.g), (2 * self._weights[:, None] * u).ravel()])

    def constraints(self, variables: Array) -> Array:
        """Return (2) to (7)."""
        at, u = self._at(variables)
        balance = u @ self._A
        balance[:, :3] -= self._f_E + self._f_C
        balance[:, 3:] -= self._tau + cross(at.p_E, self._f_E) + cross(at.p_COM, self._f_C)
        values = [placed.formula(0, placed.vectors.values(at))[0] for placed in self._clearances]
        return np.concatenate([balance.ravel() / self.n, *values])

    def jacobian(self, variables: Array) -> Array:
        """Return the Jacobian of (2) to (7), its entries in the order of `jacobian_pattern`."""
        at, u = self._at(variables)
        n, K, links = self.n, self.K, at.links
        dp_E, dp_COM = at.dV[n].T, at.dV[n + 1].T
        balance = np.zeros((K, 6, self.g))
        wrenches = u.reshape(K, n, 4).transpose(1, 0, 2) @ self._A.reshape(n, 4, 6)  # of module i in load case k
        balance[:, :, : n + 2] = links.turned(links.outward(wrenches)).transpose(1, 2, 0)
        balance[:, 3:] += self._skew_E @ dp_E + self._skew_C @ dp_COM
        entries = [balance.ravel() / n]
        for placed in self._clearances:
            _, gradient = placed.formula(1, placed.vectors.values(at))
            entries.append(chain_rule(gradient, placed.plus, placed.minus, at.dV, placed.rows, placed.columns))
        by_u = np.tile((self._A.T / n).ravel(), K)
        ordered: Array = np.concatenate([*entries, by_u])[self._j_order]
        return ordered

    def hessian(self, variables: Array, of_objective: float, multipliers: Array) -> Array:
        """Return the Hessian of the Lagrangian, its entries in the order of `hessian_pattern` (upper triangle)."""
        at, u = self._at(variables)
        n, K, links, A = self.n, self.K, at.links, self._A.reshape(self.n, 4, 6)
        mu = multipliers[: 6 * K].reshape(K, 6) / n
        H = np.zeros((self.g, self.g))
        torques = mu[:, 3:]
        to = np.zeros_like(at.V)
        to[n] += cross(torques, self._f_E).sum(axis=0)
        to[n + 1] += cross(torques, self._f_C).sum(axis=0)
        row = 6 * K
        for placed in self._clearances:
            _, gradient, hessian = placed.formula(2, placed.vectors.values(at))
            multiplier = multipliers[row : row + placed.m, None, None]
            row += placed.m
            add_gradients(multiplier * gradient, placed.plus, placed.minus, to)
            add_curvature(multiplier * hessian, placed.plus, placed.minus, at.dV, placed.starts, placed.moving, H)
        g_p = at.pushed_to_modules(to)
        by_A = (u.T @ mu).reshape(n, 4, 6)
        AY = A.transpose(0, 2, 1) @ by_A
        T = AY[:, :3, :3] + AY[:, 3:, 3:] + _outer(links.p, g_p) + _outer(links.z, to[n + 2 : 2 * n + 2])
        H[: n + 2, : n + 2] += links.curvature(T, AY[:, :3, 3:], g_p)
        by_angle = links.work(mu) @ self._A.T  # (n+2, K, 4n): mu_k . X_j a
        mixed = by_angle[self._h_angle, :, self._h_rotor].T.ravel()
        by_u = np.repeat(2 * of_objective * self._weights, 4 * n)
        entries: Array = np.concatenate([H[self._h_upper], mixed, by_u])[self._h_order]
        return entries


def _terms(task: ResolvedTask, topology: Topology, pairs: Indices, beta: float) -> list[Term]:
    """Return the clearances of (4) to (7) in the order of the page."""
    n, unit, air = topology.n, Units.of(task), task.module.envelope
    carried, everyone = Carried(n), np.arange(n)
    axis, nothing, offset = carried.axis, carried.nothing, (carried.tip, carried.com)
    bolted, all_pairs = topology.bolted, list(combinations(range(n), 2))
    terms: list[Term] = []
    if task.search.interference == "airflow":
        length, r_air, dr_air = (value / unit.length for value in (air.length, air.start_radius, air.growth))
        i, j = pairs.T
        if len(pairs):
            vectors = Differences.of((i, j), (axis(i), nothing), (axis(j), nothing))
            terms.append(Term(airflow_formula(length, r_air, dr_air, beta), vectors))
        distance, separated = task.centre_distance, [pair for pair in all_pairs if pair not in bolted]
    else:
        distance, separated = task.separation, all_pairs
    if distance is not None:
        i, j = np.array(separated, dtype=np.intp).reshape(-1, 2).T
        terms.append(Term(distance_formula(distance / unit.length), Differences.of((i, j))))
    if task.exclusion_radius is not None:
        d_E = task.exclusion_radius / unit.length
        terms.append(Term(distance_formula(d_E), Differences.of((everyone, carried.tip))))
    for requirement in task.exposure:
        seen = [(everyone, carried.tip), (axis(everyone), nothing)]
        vectors = Differences.of(*seen, *([offset] if needs_offset(requirement) else []))
        terms += [Term(formula, vectors) for formula in exposure_formulas(requirement, task, beta)]
    if any(needs_offset(requirement) for requirement in task.exposure):
        terms.append(Term(distance_formula(LEAST_OFFSET), Differences.of(offset)))
    return terms


def _pattern(rows: int, columns: int, i: Indices, j: Indices) -> tuple[ca.Sparsity, Indices]:
    """Return CasADi's pattern (column by column) and the order that brings entries (i, j) into it."""
    order = np.lexsort((i, j))
    return ca.Sparsity.triplet(rows, columns, i[order].tolist(), j[order].tolist()), order


def _outer(x: Array, y: Array) -> Array:
    products: Array = x[:, :, None] * y[:, None, :]
    return products

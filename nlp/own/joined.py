"""A program in numbers with further rows after its own, which CasADi derives."""

from __future__ import annotations

from typing import Any, Protocol

import casadi as ca
import numpy as np

from topo_search.model.arrays import Array


class Assembled(Protocol):
    """A program in numbers, as Ipopt is handed it (`nlp.assembled`)."""

    size: int
    rows: int
    lower: Array
    upper: Array
    jacobian_pattern: ca.Sparsity
    hessian_pattern: ca.Sparsity

    def objective(self, variables: Array) -> float:
        """Return the objective."""

    def gradient(self, variables: Array) -> Array:
        """Return its gradient."""

    def constraints(self, variables: Array) -> Array:
        """Return the rows."""

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of their Jacobian."""

    def hessian(self, variables: Array, of_objective: float, multipliers: Array) -> Array:
        """Return the entries of the Hessian of the Lagrangian."""


class Rows(Protocol):
    """Rows of a program as expressions of all its unknowns."""

    @property
    def x(self) -> ca.SX:
        """The unknowns."""

    @property
    def g(self) -> ca.SX:
        """The rows."""

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest value of each."""


class JoinedProgram:
    """A program in numbers with other rows below its own; their derivatives are CasADi's."""

    def __init__(self, program: Assembled, own: Rows) -> None:
        """Derive the rows, and find where entries go."""
        self._program = program
        x, multipliers = own.x, ca.SX.sym("multipliers", own.g.numel())
        jacobian = ca.jacobian(own.g, x)
        hessian = ca.triu(ca.hessian(ca.dot(multipliers, own.g), x)[0])
        self._g = ca.Function("g", [x], [own.g])
        self._jacobian = ca.Function("jacobian", [x], [jacobian])
        self._hessian = ca.Function("hessian", [x, multipliers], [hessian])
        lower, upper = own.bounds
        self.size, self.rows = program.size, program.rows + len(lower)
        self.lower = np.concatenate([program.lower, lower])
        self.upper = np.concatenate([program.upper, upper])
        above, below = program.jacobian_pattern, jacobian.sparsity()
        self.jacobian_pattern = ca.vertcat(above, below)
        counted = [
            ca.DM(part, list(range(first, first + part.nnz())))
            for part, first in ((above, 0), (below, above.nnz()))
        ]
        self._order = np.array(ca.vertcat(*counted).nonzeros(), dtype=np.intp)
        self.hessian_pattern = program.hessian_pattern.unite(hessian.sparsity())
        self._places = [
            _places(self.hessian_pattern, part) for part in (program.hessian_pattern, hessian.sparsity())
        ]

    def objective(self, variables: Array) -> float:
        """Return that of the program."""
        return self._program.objective(variables)

    def gradient(self, variables: Array) -> Array:
        """Return that of the program."""
        return self._program.gradient(variables)

    def constraints(self, variables: Array) -> Array:
        """Return all rows."""
        own = np.asarray(self._g(variables), dtype=float).ravel()
        return np.concatenate([self._program.constraints(variables), own])

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of their Jacobian."""
        own = np.array(self._jacobian(variables).nonzeros())
        result: Array = np.concatenate([self._program.jacobian(variables), own])[self._order]
        return result

    def hessian(self, variables: Array, of_objective: float, multipliers: Array) -> Array:
        """Return the entries of the Hessian of the Lagrangian."""
        m = self._program.rows
        entries = np.zeros(self.hessian_pattern.nnz())
        entries[self._places[0]] = self._program.hessian(variables, of_objective, multipliers[:m])
        entries[self._places[1]] += np.array(self._hessian(variables, multipliers[m:]).nonzeros())
        return entries


def _places(whole: ca.Sparsity, part: ca.Sparsity) -> Any:
    """Return where the entries of a pattern are among those of one that holds it."""
    return np.array(whole.get_nz(part.find()), dtype=np.intp)

"""Expressions as rows of a program, which CasADi differentiates."""

import casadi as ca
import numpy as np

from topo_search.model.arrays import Array


class DerivedRows:
    """Expressions as rows of a program, with derivatives by CasADi."""

    def __init__(self, x: ca.SX, g: ca.SX, lower: Array, upper: Array) -> None:
        """Differentiate the rows g by the unknowns x."""
        multipliers = ca.SX.sym("multipliers", g.numel())
        self.values = ca.Function("g", [x], [g])
        self.lower, self.upper = lower, upper
        self._jacobian = ca.Function("jacobian", [x], [ca.jacobian(g, x)])
        hessian = ca.triu(ca.hessian(ca.dot(multipliers, g), x)[0])
        self._hessian = ca.Function("hessian", [x, multipliers], [hessian])
        self.jacobian_pattern = self._jacobian.sparsity_out(0)
        self.hessian_pattern = self._hessian.sparsity_out(0)

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of the Jacobian of the rows."""
        return np.array(self._jacobian(variables).nonzeros())

    def hessian(self, variables: Array, multipliers: Array) -> Array:
        """Return the entries of the Hessian of the sum of rows times multipliers."""
        return np.array(self._hessian(variables, multipliers).nonzeros())

"""The page as one CasADi graph: the fastest for few modules, the slowest to build for many."""

from __future__ import annotations

import casadi as ca

from nlp.ipopt import BETA, OPTIONS, Answer, answer_of
from nlp.point import Point
from nlp.problem import problem, variable_bounds
from topo_search.model import ResolvedTask, Topology

HOPELESS = {"ipopt.max_resto_iter": 4}
"""A start that restores feasibility for longer is given up: of 200 starts of 25 trees on push, 57 of the 59 that
reach the best known effort remain, and all together take 29 % less time."""


class GraphProgram:
    """The nonlinear program of one task and topology as one graph."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        """Build the graph: the expensive part, done once."""
        self._task, self._topology = task, topology
        stated = problem(task, topology)
        constraints = stated.constraints
        self._bounds = {
            "lbg": ca.vertcat(*(ca.DM.ones(c.expression.shape) * c.lower for c in constraints)),
            "ubg": ca.vertcat(*(ca.DM.ones(c.expression.shape) * c.upper for c in constraints)),
        }
        rows = ca.vertcat(*(constraint.expression for constraint in constraints))
        nlp = {"x": stated.variables.vector(), "p": stated.beta, "f": stated.objective, "g": rows}
        self._solver = ca.nlpsol("topology", "ipopt", nlp, {**OPTIONS, **HOPELESS})

    def solve(self, start: Point) -> Answer:
        """Return the point that Ipopt reaches from a start, whatever it says of it."""
        lower, upper = variable_bounds(self._task, self._topology, start.alpha)
        x0 = ca.DM(start.pack())
        result = self._solver(x0=x0, p=ca.DM(BETA), lbx=ca.DM(lower), ubx=ca.DM(upper), **self._bounds)
        return answer_of(self._solver, result, self._task, self._topology)

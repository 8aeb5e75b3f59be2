"""The problem handed to Ipopt: compiled once a topology, solved from many starts."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlp.point import Point
from nlp.problem import problem
from topo_search.model import ResolvedTask, Topology

BETA = 200.0
"""Sharpness of the log-sum-exp: it asks for log(9)/200 = 0.011 l_arm^2 more than the exact minimum at most."""
OPTIONS: dict[str, int | float | str] = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 300,  # a limit in iterations, not in time: the answer must not depend on the machine's speed
    "mu_strategy": "adaptive",
    "bound_relax_factor": 0.0,  # inputs and angles end inside their bounds, not 1e-8 outside
}


@dataclass(frozen=True)
class Answer:
    """What Ipopt says after one start."""

    point: Point
    status: str
    iterations: int


class Program:
    """The nonlinear program of one task and topology, ready to be solved from any start."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        """Build the program: the expensive part, done once."""
        self._task, self._topology = task, topology
        stated = problem(task, topology)
        rows = ca.vertcat(*(constraint.expression for constraint in stated.constraints))
        constraints = stated.constraints
        self._bounds = {
            "lbx": ca.DM(stated.lower),
            "ubx": ca.DM(stated.upper),
            "lbg": ca.vertcat(*(ca.DM.ones(c.expression.shape) * c.lower for c in constraints)),
            "ubg": ca.vertcat(*(ca.DM.ones(c.expression.shape) * c.upper for c in constraints)),
        }
        nlp = {"x": stated.variables.vector(), "p": stated.beta, "f": stated.objective, "g": rows}
        options = {"print_time": False, **{f"ipopt.{name}": value for name, value in OPTIONS.items()}}
        self._solver = ca.nlpsol("topology", "ipopt", nlp, options)

    def solve(self, start: Point) -> Answer:
        """Return the point that Ipopt reaches from a start, whatever it says of it."""
        result = self._solver(x0=ca.DM(start.pack()), p=ca.DM(BETA), **self._bounds)
        stats = self._solver.stats()
        x = np.asarray(result["x"], dtype=float).ravel()
        point = Point.unpack(self._task, self._topology, x)
        return Answer(point, str(stats["return_status"]), int(stats["iter_count"]))

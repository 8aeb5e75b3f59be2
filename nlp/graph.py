"""The page as one CasADi graph: the fastest for few modules, the slowest to build for many."""

from __future__ import annotations

from collections.abc import Set
from functools import cached_property

import casadi as ca

from nlp import names
from nlp.evaluate import Violation, violations, worst
from nlp.finish import finish
from nlp.ipopt import BETA, OPTIONS, Answer, answer_of
from nlp.memory import ipopt
from nlp.point import Point
from nlp.problem import Problem, problem, variable_bounds
from topo_search.model import ResolvedTask, Topology

HOPELESS = {"ipopt.max_resto_iter": 4}
"""A start that restores feasibility for longer is given up: of 200 starts of 25 trees on push, 57 of the 59 that
reach the best known effort remain, and all together take 29 % less time."""
_Ready = tuple[ca.Function, dict[str, ca.DM]]
"""Ipopt with a program, and the bounds of its rows."""


class GraphProgram:
    """The nonlinear program of one task and topology as one graph.

    Hardly any design that meets all else has a rotor or the end-effector in some airflow, but to state that takes
    as much as all else together. So it is left out at first, and the whole page is built and solved where what is
    reached without lacks nothing else: from there and, if that leads to no design, from the start again.
    """

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        """Build the graph: the expensive part, done once."""
        self._task, self._topology = task, topology
        parts = {names.rotor_airflow(i, j) for i, j in topology.unbolted}
        self._left_out: Set[str] = parts | {names.tip_airflow(i) for i in range(topology.n)}
        self._most = _solver(problem(task, topology, beside_airflow=False))

    def solve(self, start: Point) -> Answer:
        """Return the point that Ipopt reaches from a start, whatever it says of it."""
        answer = self._solve(self._most, start)
        if not answer.finite:
            return answer
        checks = violations(finish(answer.point))
        stated = [check for check in checks if check.name not in self._left_out]
        if not worst(stated).met or self._keep_their_margin(checks):
            return answer
        iterations, best = answer.iterations, (_rank(worst(checks)), answer)
        for origin in (answer.point, start):
            again = self._solve(self._whole, origin)
            iterations += again.iterations
            if not again.finite:
                continue
            reached = worst(violations(finish(again.point)))
            if reached.met:
                return Answer(again.point, again.status, iterations)
            best = min(best, (_rank(reached), again), key=lambda one: one[0])
        return Answer(best[1].point, best[1].status, iterations)

    def _keep_their_margin(self, checks: list[Violation]) -> bool:
        margin = self._task.search.margin / self._task.module.arm_length
        return all(check.scaled <= -margin for check in checks if check.name in self._left_out)

    @cached_property
    def _whole(self) -> _Ready:
        return _solver(problem(self._task, self._topology))

    def _solve(self, ready: _Ready, start: Point) -> Answer:
        solver, bounds = ready
        lower, upper = variable_bounds(self._task, self._topology, start.alpha)
        x0 = ca.DM(start.pack())
        result = solver(x0=x0, p=ca.DM(BETA), lbx=ca.DM(lower), ubx=ca.DM(upper), **bounds)
        return answer_of(solver, result, self._task, self._topology)


def _solver(stated: Problem) -> _Ready:
    constraints = stated.constraints
    bounds = {
        "lbg": ca.vertcat(*(ca.DM.ones(c.expression.shape) * c.lower for c in constraints)),
        "ubg": ca.vertcat(*(ca.DM.ones(c.expression.shape) * c.upper for c in constraints)),
    }
    rows = ca.vertcat(*(constraint.expression for constraint in constraints))
    nlp = {"x": stated.variables.vector(), "p": stated.beta, "f": stated.objective, "g": rows}
    return ipopt("topology", nlp, {**OPTIONS, **HOPELESS}), bounds


def _rank(reached: Violation) -> tuple[bool, float]:
    return not reached.met, reached.rank

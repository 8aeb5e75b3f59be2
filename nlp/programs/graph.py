"""The printed problem as one CasADi graph: the fastest for few modules, the slowest to build for many."""

from __future__ import annotations

from collections.abc import Set
from functools import cached_property

import casadi as ca

from nlp.numbers.evaluate import Violation, worst
from nlp.numbers.point import Point
from nlp.own import OwnConstraints, OwnRows, finished, judged, rows_of
from nlp.problem import Problem, problem
from nlp.programs.ipopt import BETA, OPTIONS, IpoptResult, answer_of
from nlp.programs.memory import ipopt
from nlp.requirements import clearances, variable_bounds
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

    def __init__(self, task: ResolvedTask, topology: Topology, own: OwnConstraints = ()) -> None:
        """Build the graph: the expensive part, done once."""
        self._task, self._topology, self._own = task, topology, own
        beside = (requirement for requirement in clearances(task, topology) if requirement.beside)
        self._left_out: Set[str] = {name for requirement in beside for name, _, _ in requirement.rows()}
        self._most = _solver(problem(task, topology, beside_airflow=False), rows_of(own, task, topology))

    def solve(self, start: Point) -> IpoptResult:
        """Return the point that Ipopt reaches from a start, whatever it says of it."""
        answer = self._solve(self._most, start)
        if not answer.finite:
            return answer
        checks = judged(finished(answer.point, self._own), self._own)
        stated = [check for check in checks if check.name not in self._left_out]
        if not worst(stated).met or self._keep_their_margin(checks):
            return answer
        iterations, best = answer.iterations, (_rank(worst(checks)), answer)
        for origin in (answer.point, start):
            again = self._solve(self._whole, origin)
            iterations += again.iterations
            if not again.finite:
                continue
            reached = worst(judged(finished(again.point, self._own), self._own))
            if reached.met:
                return IpoptResult(again.point, again.status, iterations)
            best = min(best, (_rank(reached), again), key=lambda one: one[0])
        return IpoptResult(best[1].point, best[1].status, iterations)

    def _keep_their_margin(self, checks: list[Violation]) -> bool:
        margin = self._task.search.margin / self._task.module.arm_length
        return all(check.scaled <= -margin for check in checks if check.name in self._left_out)

    @cached_property
    def _whole(self) -> _Ready:
        own = rows_of(self._own, self._task, self._topology)
        return _solver(problem(self._task, self._topology), own)

    def _solve(self, ready: _Ready, start: Point) -> IpoptResult:
        solver, bounds = ready
        lower, upper = variable_bounds(self._task, self._topology, start.alpha)
        x0 = ca.DM(start.pack())
        result = solver(x0=x0, p=ca.DM(BETA), lbx=ca.DM(lower), ubx=ca.DM(upper), **bounds)
        return answer_of(solver, result, self._task, self._topology)


def _solver(stated: Problem, own: OwnRows) -> _Ready:
    constraints, x = stated.constraints, stated.variables.vector()
    rows = [constraint.expression for constraint in constraints]
    lower = [ca.DM.ones(c.expression.shape) * c.lower for c in constraints]
    upper = [ca.DM.ones(c.expression.shape) * c.upper for c in constraints]
    if own:
        rows.append(own.values(x))
        lower.append(ca.DM(own.bounds[0]))
        upper.append(ca.DM(own.bounds[1]))
    nlp = {"x": x, "p": stated.beta, "f": stated.objective, "g": ca.vertcat(*rows)}
    bounds = {"lbg": ca.vertcat(*lower), "ubg": ca.vertcat(*upper)}
    return ipopt("topology", nlp, {**OPTIONS, **HOPELESS}), bounds


def _rank(reached: Violation) -> tuple[bool, float]:
    return not reached.met, reached.rank

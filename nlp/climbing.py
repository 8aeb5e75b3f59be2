r"""The largest value of a maximised quantity near a design: the value is one more unknown of the program.

.. math::

    \max_{x, u, \sigma} \sigma \quad \text{subject to} \quad A(x) u_k = w_k(x) + (\sigma - 1) d_k(x)
    \quad \text{and all other constraints}

| symbol | meaning |
|---|---|
| sigma | value over its unit, `Quantity.scale` |
| w_k, d_k | required wrench of load case k at one unit, and its increase by another |

Wrenches are linear in the value (`topo_search.model.maximized`), so T of one and of two units give both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from nlp.assembled.problem import AssembledProblem, RequiredLoads
from nlp.evaluation import correct_point
from nlp.features import pseudo_inverse_constraints
from nlp.ipopt import result_of
from nlp.lazy_solve import LAZY, most_violated, with_all_corners, with_some_corners
from nlp.numbers.point import Point, weigh_rod
from nlp.program import MOVE_LIMITS, ROUND_OPTIONS, AssembledProgram, run_ipopt
from nlp.rows import UserConstraints
from nlp.solving import design_of
from nlp.start_result import StartResult
from topo_search.model import Array, Design, ResolvedTask, SolverRecord
from topo_search.model.corners import to_corners
from topo_search.model.maximized import task_at, unit_of
from topo_search.own_constraint import OwnConstraint

FIRST = 1e-3
"""Initial value of a design that holds none, in units of the quantity."""
SOLVES = 40
"""Largest number of solves, each with the corner that the one before violates most."""
RODS = 10
"""Largest number of solves with the mass of the rod that the one before found."""
SLACK = 1e-6
"""Share of a value that is given up, so that the corrected inputs produce its wrenches."""


class RaisedProblem:
    """A program with one more unknown, sigma, the last one, which it maximises; or at a given sigma the program."""

    def __init__(
        self, program: AssembledProblem, once: ResolvedTask, twice: ResolvedTask, *, raises: bool = True
    ) -> None:
        """Take the program, its task at one and at two units of the quantity, and whether it maximises sigma."""
        self._raises = raises
        self._program, self._once = program, RequiredLoads.of(once)
        self._slope = RequiredLoads(*(b - a for a, b in zip(self._once, RequiredLoads.of(twice), strict=True)))
        self.size, self.rows, balances = program.size + 1, program.rows, 6 * program.K
        self.lower, self.upper = program.lower, program.upper
        by_sigma = ca.vertcat(ca.Sparsity.dense(balances, 1), ca.Sparsity(self.rows - balances, 1))
        self.jacobian_pattern = ca.horzcat(program.jacobian_pattern, by_sigma)
        mixed = ca.vertcat(ca.Sparsity.dense(program.g, 1), ca.Sparsity(self.size - program.g, 1))
        self.hessian_pattern = ca.horzcat(ca.vertcat(program.hessian_pattern, ca.Sparsity(1, program.size)), mixed)

    def _at(self, variables: Array) -> Array:
        """Set the program's loads to those of sigma, and return its own unknowns."""
        pairs = zip(self._once, self._slope, strict=True)
        self._program.loads = RequiredLoads(*(once + (variables[-1] - 1.0) * slope for once, slope in pairs))
        return variables[:-1]

    def objective(self, variables: Array) -> float:
        """Return -sigma, or the effort."""
        return -float(variables[-1]) if self._raises else self._program.objective(variables[:-1])

    def gradient(self, variables: Array) -> Array:
        """Return its gradient."""
        if self._raises:
            return np.append(np.zeros(self._program.size), -1.0)
        return np.append(self._program.gradient(variables[:-1]), 0.0)

    def constraints(self, variables: Array) -> Array:
        """Return the rows of the program at sigma."""
        return self._program.constraints(self._at(variables))

    def jacobian(self, variables: Array) -> Array:
        """Return their Jacobian."""
        own = self._at(variables)
        entries, (platform, _) = self._program.jacobian(own), self._program.platform_at(own)
        by_sigma = self._slope.wrenches + self._slope.levers @ platform.V[-3:-1].ravel()
        return np.concatenate([entries, -by_sigma])

    def hessian(self, variables: Array, objective_factor: float, multipliers: Array) -> Array:
        """Return the Hessian of the Lagrangian; sigma has none."""
        own, weight = self._at(variables), 0.0 if self._raises else objective_factor
        entries, (platform, _) = self._program.hessian(own, weight, multipliers), self._program.platform_at(own)
        by_levers = multipliers[: 6 * self._program.K] @ self._slope.levers
        mixed = by_levers @ platform.dV[-3:-1].transpose(0, 2, 1).reshape(6, -1)
        return np.concatenate([entries, -mixed])


def climb(
    task: ResolvedTask,
    design: Design,
    constraints: Sequence[OwnConstraint] = (),
    *,
    value: float | None = None,
    turns: bool = True,
) -> Design:
    """Return the design of the largest value near one, or of least effort at a value, for the task that asks it.

    Corners join the program once a result violates them, as in `nlp.lazy_solve`. The design itself is returned if
    no better one is found.

    Args:
        task: the task with a maximised quantity, before it asks for a value.
        design: a design for some value.
        constraints: the user's constraints beyond the task.
        value: value that a design of least effort has; None for the largest one.
        turns: whether the platform may turn about the vertical.
    """
    user_constraints = (*constraints, *pseudo_inverse_constraints(task))
    best, point, record = design, Point.of(design), SolverRecord.model_validate(design.solver)
    for _ in range(RODS):
        rod = point.task.end_effector.counted_rod
        raised = _raise(task.with_rod(rod), point, user_constraints, value, turns)
        if raised is None:
            break
        point = correct_point(weigh_rod(raised.point), user_constraints)
        weighed = StartResult.from_point(0, point, raised.result, constraints=user_constraints)
        if weighed.worst.met or best is design:
            best = design_of(weighed if weighed.worst.met else raised, record, constraints)
        if weighed.worst.met:
            break
    return best


def _raise(
    task: ResolvedTask, point: Point, constraints: UserConstraints, value: float | None, turns: bool
) -> StartResult | None:
    unit = unit_of(task)
    once, twice = (to_corners(task_at(task, at)) for at in (unit, 2 * unit))
    cases = zip(once.case_labels, once.load_cases, twice.load_cases, strict=True)
    changing = [label for label, a, b in cases if a != b and label not in once.declared.case_labels]
    labels = {*changing[:: math.ceil(len(changing) / LAZY.at_once) or 1]}
    sigma = max(point.task.search.reached or 0.0, FIRST * unit) / unit if value is None else value / unit
    start = replace(with_all_corners(point, to_corners(task_at(task, sigma * unit)), constraints), task=once)
    for _ in range(SOLVES):
        some = with_some_corners(start, labels)
        program = AssembledProgram(some.task, some.topology, constraints)
        assembled, lower, upper = program.assemble(some, MOVE_LIMITS.polish)
        if not turns:
            lower[0] = upper[0] = some.pack()[0]
        other = with_some_corners(replace(start, task=twice), labels).task
        solver, solution = run_ipopt(
            RaisedProblem(assembled, some.task, other, raises=value is None),
            {**ROUND_OPTIONS.near_start, **ROUND_OPTIONS.warm, **ROUND_OPTIONS.exact},
            np.append(some.pack(), sigma),
            np.append(lower, 0.0 if value is None else sigma),
            np.append(upper, np.inf if value is None else sigma),
        )
        sigma = float(solution["x"][-1])
        if not math.isfinite(sigma):
            return None
        at_sigma = to_corners(task_at(task, sigma * (1 - SLACK) * unit))
        some_task = with_some_corners(replace(start, task=at_sigma), labels).task
        result = result_of(solver, {"x": solution["x"][:-1]}, some_task, point.topology)
        if not result.finite:
            return None
        whole = with_all_corners(correct_point(result.point, constraints), at_sigma, constraints)
        raised = StartResult.from_point(0, whole, replace(result, point=whole), constraints=constraints)
        if raised.worst.met:
            return raised
        if not (corners := most_violated(whole, some_task)):
            return None
        labels, start = labels | corners, replace(whole, task=once)
    return None

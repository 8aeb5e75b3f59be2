"""The assembled program in Ipopt's hands, with envelope pairs added as they are needed."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np

from nlp.assembled.assembly import Assembly
from nlp.assembled.callbacks import Evaluated
from nlp.assembled.local_vectors import Indices
from nlp.geometry import Swept, clearance
from nlp.ipopt import BETA, OPTIONS, Answer, answer_of
from nlp.point import Point
from nlp.problem import variable_bounds
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array

NEAR = 3.0
"""Pairs of envelopes closer than this are kept apart from the beginning [l_arm]."""
ROUNDS = 8
"""Times that pairs are added before the answer stands as it is; the evaluation then judges it."""
ORDERING: dict[str, int] = {"ipopt.mumps_permuting_scaling": 0, "ipopt.mumps_pivot_order": 0}
"""Approximate minimum degree without prior permutation: half the time of MUMPS's own choice at 40 modules."""


class AssembledProgram:
    """The nonlinear program of one task and topology, solved with the pairs of envelopes that matter."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        """Keep what a solve needs; nothing expensive is built."""
        self._task, self._topology = task, topology
        self._pairs = np.array(list(combinations(range(topology.n), 2)), dtype=np.intp).reshape(-1, 2)

    def solve(self, start: Point) -> Answer:
        """Return the point that Ipopt reaches from a start, its last status word, and its iterations in all.

        A pair that the answer violates is added, with its likes within NEAR, and Ipopt goes on from the answer; so
        no pair is left out for good unless it is clear at the end.
        """
        near = NEAR * self._task.module.arm_length
        kept = self._gaps(start) < near
        answer = self._solve_with(self._pairs[kept], start)
        for _ in range(ROUNDS):
            gaps = self._gaps(answer.point)
            if answer.status == "Infeasible_Problem_Detected" or not np.any(gaps[~kept] < 0):
                break
            kept |= gaps < near
            further = self._solve_with(self._pairs[kept], answer.point)
            answer = replace(further, iterations=answer.iterations + further.iterations)
        return answer

    def _gaps(self, point: Point) -> Array:
        """Return the clearance of every pair [m]."""
        air, (R, p) = self._task.module.envelope, point.poses
        d = -air.length * R[:, :, 2]
        one, other = (Swept(p[side], d[side], air.start_radius, air.growth) for side in self._pairs.T)
        return clearance(one, other)

    def _solve_with(self, pairs: Indices, start: Point) -> Answer:
        assembly = Assembly(self._task, self._topology, pairs, BETA)
        solver, functions = _ipopt(assembly)
        lower, upper = variable_bounds(self._task, self._topology)
        result = solver(
            x0=ca.DM(start.pack()),
            lbx=ca.DM(lower),
            ubx=ca.DM(upper),
            lbg=ca.DM(assembly.lower),
            ubg=ca.DM(assembly.upper),
        )
        for function in functions:
            if function.error is not None:
                raise function.error
        return answer_of(solver, result, self._task, self._topology)


def _ipopt(assembly: Assembly) -> tuple[ca.Function, tuple[Evaluated, ...]]:
    """Return Ipopt and an assembly's functions that it calls, named as CasADi names them."""
    x, rows, scalar = ca.Sparsity.dense(assembly.size), ca.Sparsity.dense(assembly.rows), ca.Sparsity.dense(1)
    given = {"x": x, "p": ca.Sparsity.dense(0)}
    nlp = Evaluated(
        "nlp", given, {"f": scalar, "g": rows}, lambda x, _: (assembly.objective(x), assembly.constraints(x))
    )
    grad_f = Evaluated(
        "nlp_grad_f",
        given,
        {"f": scalar, "grad_f_x": x},
        lambda x, _: (assembly.objective(x), assembly.gradient(x)),
    )
    jac_g = Evaluated(
        "nlp_jac_g",
        given,
        {"g": rows, "jac_g_x": assembly.jacobian_pattern},
        lambda x, _: (assembly.constraints(x), assembly.jacobian(x)),
    )
    hess_lag = Evaluated(
        "nlp_hess_l",
        {**given, "lam_f": scalar, "lam_g": rows},
        {"triu_hess_gamma_x_x": assembly.hessian_pattern},
        lambda x, _, lam_f, lam_g: (assembly.hessian(x, lam_f[0], lam_g),),
    )
    derivatives: dict[str, Any] = {"grad_f": grad_f, "jac_g": jac_g, "hess_lag": hess_lag, "no_nlp_grad": True}
    solver = ca.nlpsol("assembled", "ipopt", nlp, {**OPTIONS, **ORDERING, **derivatives})
    return solver, (nlp, grad_f, jac_g, hess_lag)

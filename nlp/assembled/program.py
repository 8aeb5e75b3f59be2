"""The assembled program in Ipopt's hands: rounds with move limits, and the pairs of envelopes that are near."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np

from nlp.assembled.assembly import Assembly
from nlp.assembled.callbacks import Evaluated
from nlp.assembled.local_vectors import Mask
from nlp.evaluate import violations, worst
from nlp.finish import finish
from nlp.geometry import Swept, clearance
from nlp.ipopt import BETA, OPTIONS, Answer, answer_of
from nlp.point import Point
from nlp.problem import variable_bounds
from topo_search.model import ResolvedTask, Topology

Options = dict[str, int | float | str]

MOVE_LIMIT = 0.2
"""Most that a hinge turns in one round [rad]: less than it takes an envelope to slip through another."""
NEAR = 6.0
"""Pairs of envelopes closer than this are kept apart in a round [l_arm]."""
ROUNDS = 12
"""Most rounds; the evaluation judges what is reached by then."""
GAIN = 1e-4
"""Relative decrease of the effort, or of the worst violation, without which there is no further round."""
MUMPS: Options = {"ipopt.mumps_permuting_scaling": 0, "ipopt.mumps_pivot_order": 0}
"""Approximate minimum degree without prior permutation: half the time of MUMPS's own choice at 40 modules."""
WARM: Options = {
    "ipopt.mu_strategy": "monotone",
    "ipopt.mu_init": 1e-3,
    "ipopt.bound_push": 1e-6,  # stay where the last round ended
    "ipopt.bound_frac": 1e-6,
    "ipopt.max_iter": 100,
}
"""Rounds are short and begin near where they end."""


class AssembledProgram:
    """The nonlinear program of one task and topology, solved in rounds with move limits on the hinges."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        """Keep what a solve needs; nothing expensive is built."""
        self._task, self._topology = task, topology
        self._pairs = np.array(list(combinations(range(topology.n), 2)), dtype=np.intp).reshape(-1, 2)

    def solve(self, start: Point) -> Answer:
        """Return the best point of all rounds, with the iterations of all rounds.

        Ipopt's steps are long, and on a large platform a hinge's small turn sweeps an envelope through others, to
        where no step leads back from. So a round turns no hinge by more than MOVE_LIMIT, and the next one goes on
        from its end with the pairs that are near then. Pairs that are not in the last round are judged with all
        others when the answer is.
        """
        point, iterations = start, 0
        best, least = start, _merit(start)
        before = least
        for _ in range(ROUNDS):
            answer = self._round(point)
            point, iterations = answer.point, iterations + answer.iterations
            if not np.all(np.isfinite(point.pack())):  # an evaluation failed; what was reached before stands
                break
            merit = _merit(point)
            if merit < least:
                best, least = point, merit
            if merit[0] == before[0] and merit[1] > (1 - GAIN) * before[1]:
                break
            before = merit
        return Answer(best, answer.status, iterations)

    def near(self, point: Point) -> Mask:
        """Return which of all pairs (i, j), i < j, a round from here keeps apart, shape (n (n-1) / 2,)."""
        air, (R, p) = self._task.module.envelope, point.poses
        d = -air.length * R[:, :, 2]
        one, other = (Swept(p[side], d[side], air.start_radius, air.growth) for side in self._pairs.T)
        near: Mask = clearance(one, other) < NEAR * self._task.module.arm_length
        return near

    def _round(self, start: Point) -> Answer:
        assembly = Assembly(self._task, self._topology, self._pairs[self.near(start)], BETA)
        solver, functions = _ipopt(assembly)
        lower, upper = (np.array(side) for side in variable_bounds(self._task, self._topology))
        hinges = slice(3, 3 + len(start.alpha))
        lower[hinges] = np.maximum(lower[hinges], start.alpha - MOVE_LIMIT)
        upper[hinges] = np.minimum(upper[hinges], start.alpha + MOVE_LIMIT)
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


def _merit(point: Point) -> tuple[bool, float]:
    """Return (not a design, effort or worst violation): the less, the better."""
    reason = worst(violations(finish(point)))
    weights = np.array([case.weight for case in point.task.load_cases])
    effort = float(weights @ np.einsum("kiq,kiq->k", point.u, point.u))
    return not reason.met, effort if reason.met else reason.rank


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
    solver = ca.nlpsol("assembled", "ipopt", nlp, {**OPTIONS, **WARM, **MUMPS, **derivatives})
    return solver, (nlp, grad_f, jac_g, hess_lag)

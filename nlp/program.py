"""The assembled program and its solves by Ipopt: rounds with move limits, each with the clearances that are near.

CasADi calls functions of NumPy arrays without copying.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from nlp.assembled.problem import AssembledProblem
from nlp.evaluation import correct_point, violations, worst
from nlp.features import rows_of
from nlp.ipopt import BETA, OPTIONS, IpoptResult, ipopt, result_of
from nlp.numbers.point import Point
from nlp.requirements import clearances, variable_bounds
from nlp.requirements.balances import WRENCH_TOLERANCE
from nlp.requirements.modules import BETWEEN_MODULES
from nlp.rows import Selections, UserConstraints
from topo_search.model import Array, ResolvedTask, Topology

Function = Callable[..., Array | float]
"""Function of all inputs that returns one output."""
Patterns = dict[str, ca.Sparsity]
"""Patterns of inputs or outputs, by name."""


class PythonFunction(ca.Callback):
    """A CasADi function evaluated by Python functions, with nonzero entries as inputs and outputs."""

    def __init__(self, name: str, inputs: Patterns, outputs: Patterns, functions: Sequence[Function]) -> None:
        """Create the function; inputs and outputs have the names that CasADi's solvers expect."""
        super().__init__()
        self._inputs, self._outputs, self._functions = inputs, outputs, functions
        self.error: Exception | None = None
        """Exception of a Python function, re-raised after the solve."""
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return len(self._inputs)

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return len(self._outputs)

    def get_name_in(self, index: int) -> str:
        """Return an input's name."""
        return list(self._inputs)[index]

    def get_name_out(self, index: int) -> str:
        """Return an output's name."""
        return list(self._outputs)[index]

    def get_sparsity_in(self, index: int) -> ca.Sparsity:
        """Return an input's pattern."""
        return list(self._inputs.values())[index]

    def get_sparsity_out(self, index: int) -> ca.Sparsity:
        """Return an output's pattern."""
        return list(self._outputs.values())[index]

    def has_eval_buffer(self) -> bool:
        """Return True, so that CasADi passes its memory instead of matrices."""
        return True

    def eval_buffer(self, inputs: Sequence[Any], outputs: Sequence[Any]) -> int:
        """Evaluate; CasADi owns the memory, and passes None for empty or unused arrays."""
        arrays = [None if memory is None else np.frombuffer(memory) for memory in inputs]
        try:
            for memory, function in zip(outputs, self._functions, strict=True):
                if memory is not None:
                    np.frombuffer(memory)[:] = function(*arrays)
        except Exception as error:
            self.error = error  # Ipopt treats an exception as a failed evaluation, and continues
            raise
        return 0


IpoptOptions = Mapping[str, int | float | str]


class MoveLimits(NamedTuple):
    """Settings of the rounds of a solve and their move limits."""

    first: float = 0.5
    """Largest turn of a hinge in the first round [rad]."""
    bold: float = 1.0
    """Largest turn in a round before it, on small platforms, which is discarded unless it ends in a design [rad].

    With 10 and 15 modules it yields as many designs in a tenth less time; with 20 it saves no time.
    """
    bold_up_to: int = 15
    """Largest number of modules for such a round."""
    polish: float = 1.0
    """Largest turn of a hinge in a polish [rad]."""
    growth: float = 2.0
    """Factor of the move limit after a round with a design; after a lost design, the divisor is its square."""
    minimum: float = 0.04
    """Move limit below which a round that lost the design is not repeated [rad]."""
    rounds: int = 14
    """Largest number of rounds."""
    min_gain: float = 1e-4
    """Smallest relative decrease of the effort that leads to a further round."""
    min_decrease: float = 0.1
    """Smallest relative decrease of the worst violation that leads to a further round, one exception aside."""


MOVE_LIMITS = MoveLimits()


class RoundOptions(NamedTuple):
    """Options of Ipopt for rounds."""

    mumps: IpoptOptions = MappingProxyType({"ipopt.mumps_permuting_scaling": 0, "ipopt.mumps_pivot_order": 0})
    """Approximate minimum degree ordering without permutation: half the time of MUMPS's default at 40 modules."""
    near_start: IpoptOptions = MappingProxyType(
        {"ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6, "ipopt.max_iter": 100, "ipopt.tol": 1e-6}
    )
    """For all rounds, which are short and start from the previous one."""
    warm: IpoptOptions = MappingProxyType({"ipopt.mu_strategy": "monotone", "ipopt.mu_init": 1e-5})
    """For rounds that start from a design."""
    next_to_minimum: IpoptOptions = MappingProxyType({"ipopt.mu_init": 1e-6})
    """For a polish of a minimum of the search with additional rows."""
    exact: IpoptOptions = MappingProxyType({"ipopt.tol": 1e-8})
    """For a polish, whose result is final."""


ROUND_OPTIONS = RoundOptions()


class AssembledProgram:
    """The nonlinear program of one task and topology, solved in rounds with move limits on the hinges."""

    def __init__(
        self,
        task: ResolvedTask,
        topology: Topology,
        constraints: UserConstraints = (),
        selections: Selections = MappingProxyType({}),
    ) -> None:
        """Store the arguments; `selections` say what has rows of each kind of lazy rows."""
        self._task, self._topology, self._constraints = task, topology, constraints
        self._lazy = {kind: selection for kind, selection in selections.items() if selection is not None}
        fixed = task.search.hinge_set_deg is not None  # then clearances between modules are constant
        requirements = clearances(task, topology)
        self._clearances = tuple(r for r in requirements if not (fixed and r.equation in BETWEEN_MODULES))

    def solve(self, start: Point) -> IpoptResult:
        """Return the best point of all rounds, with the iterations of all rounds.

        Ipopt takes long steps, and on a large platform a small turn of a hinge sweeps an envelope through others,
        from where no step leads back. So a round turns no hinge by more than a limit, and the next one starts from
        its result with the pairs that are near there. As in a trust region, the limit grows as long as rounds end
        in designs; a round that loses the design is discarded and repeated with a smaller limit, and so is a bold
        first one that finds none. Pairs that are not in the last round are checked with all others afterwards.
        """
        limit = MOVE_LIMITS.bold if self._topology.n <= MOVE_LIMITS.bold_up_to else MOVE_LIMITS.first
        point, merit, iterations, patience = start, self._merit(start), 0, 1
        status = "no round ended"
        for _ in range(MOVE_LIMITS.rounds):
            options = {**ROUND_OPTIONS.near_start, **ROUND_OPTIONS.warm} if merit.met else ROUND_OPTIONS.near_start
            result = self._round(point, limit, options)
            status, iterations = result.status, iterations + result.iterations
            if not result.finite:  # keep the previous result
                break
            reached = self._merit(result.point)
            if not reached.met and (merit.met or limit > MOVE_LIMITS.first):
                limit = limit / MOVE_LIMITS.growth**2 if merit.met else MOVE_LIMITS.first
                if limit < MOVE_LIMITS.minimum:
                    break
                continue
            turned = np.max(np.abs(result.point.alpha - point.alpha), initial=0.0)
            became_feasible = reached.met and not merit.met
            gain = 1.0 - reached.amount / merit.amount if merit.amount > 0.0 else 0.0
            if became_feasible or gain > 0.0:
                point, merit = result.point, reached
            if merit.met:
                if turned < 0.98 * limit or (not became_feasible and gain < MOVE_LIMITS.min_gain):
                    break  # a minimum inside the limit, or almost no gain
                limit *= MOVE_LIMITS.growth
            elif not gain >= MOVE_LIMITS.min_decrease:  # also if a user constraint is NaN
                if not patience:
                    break
                patience, limit = patience - 1, limit / MOVE_LIMITS.growth
        return IpoptResult(point, status, iterations)

    def polish(self, start: Point) -> IpoptResult:
        """Solve from a point close to a minimum of the search."""
        if not (self._constraints or self._lazy):
            options = {**ROUND_OPTIONS.near_start, **ROUND_OPTIONS.warm, **ROUND_OPTIONS.exact}
            return self._round(start, MOVE_LIMITS.polish, options)
        if not self._constraints and all(kind.one_round for kind in self._lazy):
            options = {**ROUND_OPTIONS.near_start, **ROUND_OPTIONS.warm, **ROUND_OPTIONS.next_to_minimum}
            return self._round(start, MOVE_LIMITS.bold, options)
        # the search did not see these rows, so the solution may be far from the point
        return self.solve(start)

    def _round(self, start: Point, limit: float, options: IpoptOptions) -> IpoptResult:
        program, lower, upper = self.assemble(start, limit)
        solver, solution = run_ipopt(program, options, start.pack(), lower, upper)
        return result_of(solver, solution, self._task, self._topology)

    def assemble(self, start: Point, limit: float) -> tuple[AssembledProblem, Array, Array]:
        """Return the problem with the pairs that are near a point, and bounds that turn no hinge beyond a limit."""
        requirements = [requirement.restrict(start.vectors) for requirement in self._clearances]
        program = AssembledProblem(self._task, self._topology, requirements, BETA)
        for kind, selection in self._lazy.items():
            program.append(kind.rows(program, self._task, self._topology, selection))
        if self._constraints:
            program.append(rows_of(self._constraints, self._task, self._topology).derived)
        lower, upper = (np.array(side) for side in variable_bounds(self._task, self._topology, start.alpha))
        hinges = slice(3, 3 + len(start.alpha))
        middle = np.clip(start.alpha, lower[hinges], upper[hinges])
        lower[hinges] = np.maximum(lower[hinges], middle - limit)
        upper[hinges] = np.minimum(upper[hinges], middle + limit)
        return program, lower, upper

    def _merit(self, point: Point) -> _Merit:
        reason = worst(violations(correct_point(point, self._constraints), self._constraints))
        return _Merit(reason.met, point.objective if reason.met else reason.rank)


@dataclass(frozen=True)
class _Merit:
    """Merit of a point."""

    met: bool
    """True if it is a design."""
    amount: float
    """Effort of a design, else the worst violation."""


def run_ipopt(
    program: Any, options: IpoptOptions, start: Array, lower: Array, upper: Array
) -> tuple[ca.Function, dict[str, ca.DM]]:
    """Run Ipopt on a problem, and return it with its solution.

    Args:
        program: an `AssembledProblem`, or another one with its functions and patterns.
        options: Ipopt's options beyond those of all solves.
        start: initial values, shape (size,).
        lower: lower bounds on the unknowns.
        upper: upper bounds.
    """
    x, rows, scalar = ca.Sparsity.dense(program.size), ca.Sparsity.dense(program.rows), ca.Sparsity.dense(1)
    inputs = {"x": x, "p": ca.Sparsity.dense(0)}
    f: tuple[Function, ...] = (lambda x, _: program.objective(x), lambda x, _: program.gradient(x))
    g: tuple[Function, ...] = (lambda x, _: program.constraints(x), lambda x, _: program.jacobian(x))
    nlp = PythonFunction("nlp", inputs, {"f": scalar, "g": rows}, (f[0], g[0]))
    grad_f = PythonFunction("nlp_grad_f", inputs, {"f": scalar, "grad_f_x": x}, f)
    jac_g = PythonFunction("nlp_jac_g", inputs, {"g": rows, "jac_g_x": program.jacobian_pattern}, g)
    hess_lag = PythonFunction(
        "nlp_hess_l",
        {**inputs, "lam_f": scalar, "lam_g": rows},
        {"triu_hess_gamma_x_x": program.hessian_pattern},
        [lambda x, _, lam_f, lam_g: program.hessian(x, lam_f[0], lam_g)],
    )
    derivatives: dict[str, Any] = {"grad_f": grad_f, "jac_g": jac_g, "hess_lag": hess_lag, "no_nlp_grad": True}
    solver = ipopt("assembled", nlp, {**OPTIONS, **options, **ROUND_OPTIONS.mumps, **derivatives})
    is_equation = program.lower == program.upper
    # a single module has fewer unknowns than equations, most of them redundant, which Ipopt refuses
    play = WRENCH_TOLERANCE / 2 * is_equation if is_equation.sum() > (lower < upper).sum() else 0.0
    bounds = {"lbx": lower, "ubx": upper, "lbg": program.lower - play, "ubg": program.upper + play}
    solution = solver(x0=ca.DM(start), **{name: ca.DM(values) for name, values in bounds.items()})
    for function in (nlp, grad_f, jac_g, hess_lag):
        if function.error is not None:
            raise function.error
    return solver, solution

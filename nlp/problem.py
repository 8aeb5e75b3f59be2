r"""The inner problem of one topology, as printed in the paper (Eq. opti).

Tests compare the compiled programs that a search solves with it.

Variables, dimensionless (lengths in l_arm, forces in m g, inputs in u_hover; `nlp.units`):

| symbol | meaning | shape |
|---|---|---|
| root | psi, alpha_0, alpha_1: orientation of the root | (3,) |
| alpha | hinge angles alpha_i | (n-1,) |
| p'_E | end-effector position in W | (3,) |
| u_k | squared rotor speeds of load case k, of r rotors a module | (r n,) each |

.. math::

    \min_{u, \alpha, p'_E} \quad & \sum_k \lambda_k \|u_k\|^2                                        & (1) \\
    \text{s.t.} \quad & \sum_{iq} f_{iq} a_{iq} = f_E + f_C                  \quad \forall k         & (2) \\
    & \sum_{iq} (f_{iq}\, p_{iq} \times a_{iq} + \tau_{iq} a_{iq})
      = \tau_E + p'_E \times f_E + \tau_C + p_{COM} \times f_C               \quad \forall k         & (3) \\
    & \tilde\phi_{ij}(\beta) \ge 0                                           \quad \forall i < j     & (4) \\
    & \|p_i - p_j\| \ge d                          \quad \forall i < j \text{ not bolted together}   & (5) \\
    & \tilde\phi_{j,\mathrm{parts}(i)}(\beta) \ge 0  \quad \forall i \ne j \text{ not bolted together}   & (6) \\
    & \|p_i - p'_E\| \ge d_E                                                 \quad \forall i         & (7) \\
    & \|c - p'_E\| \le L, \ \angle(p'_E - c, a) \le \theta, \text{ rod clear of solid regions}
      \quad \exists c \text{ free connector}                                                         & (7) \\
    & \tilde\phi_{i,\mathrm{tip}}(\beta) \ge 0                                 \quad \forall i         & (8) \\
    & \tilde\phi_{i,\mathrm{sph}}(\beta),\ \tilde\phi_{i,\mathrm{cap}}(\beta) \ge 0,
      \text{ hulls and the cone}                                                   \quad \forall i         & (9) \\
    & u_{min} \le u_k \le \rho u_{max}, \quad \alpha_{min,i} \le \alpha_i \le \alpha_{max,i}              & (10)

(3) is the paper's torque balance about the origin of W instead of the COM. It is the same constraint, since it
differs by p_COM x (2), but much sparser. (5), (6) and (8) are this project's body clearance. In (5) d is so large
that rigid parts cannot touch. (6) keeps the parts of module i that are outside its own envelope out of the airflow
of module j; they are covered by balls, first those around the rotors (`topo_search.model.room`). (8) keeps the
end-effector, a ball as thick as its rod, out of all airflow; without (7) it may be inside a module, and (8) is left
out, too. With body clearance the range of alpha_i is +-pi/2 without angles at which rotors touch the bolted module
or any parts are in its airflow (`topo_search.model.room`); if several ranges remain, a hinge stays in the one where
it starts. Without body clearance the range is +-pi/2, as in the paper. In the paper's ablation (5) holds for all
pairs, with the separation as d, and (4), (6) and (8) are left out. d_E is the paper's l_c, or the task's stand-off
if larger. L is the largest reach of the rod, and theta its largest angle with the task's axis a; the paper limits
neither. Except for its tip, the rod keeps out
of all solid regions (`nlp.requirements.rod`). rho is the share of u_max that the task allows; it is 1 in the paper.
u_min is the minimum input of the task; it is 0 in the paper. Both bounds of a dead rotor's input are 0. Every
clearance of (4) to (9) includes the margin.

Each requirement is defined in `nlp.requirements`, with its exact value and its name. Ipopt gets scaled values: (1)
is divided by r n sum_k lambda_k, which makes it the weighted mean of the squared inputs over u_hover^2; (2) and (3)
are divided by n, which makes them multiples of the weight; the bounds of (10) are in u_hover, where rho u_max is
the maximum thrust-to-weight ratio; (5) and (7) are (||.||^2 - d^2) / (2 d), and (4), (6), (8) and (9) log-sum-exps
over twice the sum of the end radii, so all of them are lengths in l_arm near contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from nlp import names
from nlp.numbers.masses import masses
from nlp.requirements import clearances, variable_bounds
from nlp.requirements.balances import angular_accelerations
from nlp.symbols.platform import Pose, platform_inertia, poses, required_wrench, tip_and_com, wrench_map
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology


@dataclass(frozen=True)
class Constraint:
    """A named group of rows, `lower <= expression <= upper`, dimensionless."""

    name: str
    expression: ca.SX
    lower: float
    upper: float = math.inf


@dataclass(frozen=True)
class Variables:
    """The unknowns of the problem."""

    root: ca.SX
    alpha: ca.SX
    tip: ca.SX
    """p'_E; empty if the task fixes the position from the COM."""
    u: list[ca.SX]

    @classmethod
    def of(cls, task: ResolvedTask, topology: Topology) -> Variables:
        """Return the unknowns of a task and topology."""
        n, position = topology.n, task.end_effector.fixed_position
        return cls(
            root=ca.SX.sym("root", 3),
            alpha=ca.SX.sym("alpha", n - 1),
            tip=ca.SX.sym("tip", 3 if position is None else 0),
            u=[ca.SX.sym(f"u_{k}", task.rotor_count) for k in range(len(task.load_cases))],
        )

    def platform(self, task: ResolvedTask, topology: Topology) -> tuple[list[Pose], ca.SX, ca.SX]:
        """Return the poses of all modules, p'_E and p_COM."""
        l_c = (task.connector_distances / Units.of(task).length).tolist()
        modules = poses(topology, self.root, self.alpha, l_c)
        return modules, *tip_and_com(task, topology, modules, self.tip)

    def vector(self) -> ca.SX:
        """Return all unknowns as one column."""
        return ca.vertcat(self.root, self.alpha, self.tip, *self.u)


@dataclass(frozen=True)
class Problem:
    """The nonlinear program of one task and topology."""

    variables: Variables
    beta: ca.SX
    """Sharpness of the log-sum-exp; a parameter of the program."""
    objective: ca.SX
    constraints: list[Constraint]
    lower: list[float]
    upper: list[float]
    """Bounds on the variables, in the order of `variables.vector()`; a solve narrows those of hinges."""


def problem(task: ResolvedTask, topology: Topology) -> Problem:
    """Return the nonlinear program of a task for one topology.

    Args:
        task: the task.
        topology: the tree.
    """
    n, unit = topology.n, Units.of(task)
    variables, beta = Variables.of(task, topology), ca.SX.sym("beta")

    # the platform
    modules, tip, p_COM = variables.platform(task, topology)
    vectors = {axis: [pose.R[:, column] for pose in modules] for column, axis in enumerate("xyz")}
    vectors |= {"p": [pose.p for pose in modules], "p'_E": [tip], "p_COM": [p_COM]}

    # (1) objective
    weights = [case.weight for case in task.load_cases]
    effort = ca.SX(0)
    for weight, u_k in zip(weights, variables.u, strict=True):
        effort += weight * ca.sumsqr(u_k)
    objective = effort / (task.rotor_count * sum(weights))

    # (2)-(3) wrench balance of every load case
    carried = masses(task, topology)
    J = platform_inertia([pose.p - p_COM for pose in modules], [pose.R for pose in modules], tip - p_COM, carried)
    A = wrench_map([pose.R for pose in modules], [pose.p for pose in modules], task)
    constraints: list[Constraint] = []
    turns = angular_accelerations(task)
    for u_k, label, case, turn in zip(variables.u, task.case_labels, task.load_cases, turns, strict=True):
        residual = A @ u_k - required_wrench(case, unit, tip=tip, p_COM=p_COM)
        residual[3:] -= J @ ca.DM(turn)
        constraints.append(Constraint(names.force(label), residual[:3] / n, 0.0, 0.0))
        constraints.append(Constraint(names.torque(label), residual[3:] / n, 0.0, 0.0))

    # (4)-(9) clearances
    for requirement in clearances(task, topology):
        for name, subject, formula in requirement.rows():
            gap = formula.smooth([vector.at(vectors, subject) for vector in formula.local_vectors], beta)
            constraints.append(Constraint(name, gap, requirement.margin))

    # (10) bounds
    return Problem(variables, beta, objective, constraints, *variable_bounds(task, topology))

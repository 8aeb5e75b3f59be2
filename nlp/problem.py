r"""The inner problem of one topology, as the paper prints it (paper, Eq. opti).

Variables, dimensionless (lengths in l_arm, forces in m g, inputs in u_hover; `nlp.units`):

| symbol | meaning | shape |
|---|---|---|
| root | psi, alpha_0, alpha_1: orientation of the root | (3,) |
| alpha | hinge angles alpha_i | (n-1,) |
| p'_E | end-effector position in W | (3,) |
| u_k | squared rotor speeds of load case k | (4n,) each |

.. math::

    \min_{u, \alpha, p'_E} \quad & \sum_k \lambda_k \|u_k\|^2                                        & (1) \\
    \text{s.t.} \quad & \sum_{iq} f_{iq} z_i = f_E + f_C                     \quad \forall k         & (2) \\
    & \sum_{iq} (f_{iq}\, p_{iq} \times z_i + \tau_{iq} z_i)
      = \tau_E + p'_E \times f_E + \tau_C + p_{COM} \times f_C               \quad \forall k         & (3) \\
    & \tilde\phi_{ij}(\beta) \ge 0                                           \quad \forall i < j     & (4) \\
    & \|p_i - p_j\| \ge d                          \quad \forall i < j \text{ not bolted together}   & (5) \\
    & \tilde\phi_{j,\mathrm{parts}(i)}(\beta) \ge 0  \quad \forall i \ne j \text{ not bolted together}   & (6) \\
    & \|p_i - p'_E\| \ge d_E                                                 \quad \forall i         & (7) \\
    & \tilde\phi_{i,\mathrm{tip}}(\beta) \ge 0                                 \quad \forall i         & (8) \\
    & \tilde\phi_{i,\mathrm{sph}}(\beta),\ \tilde\phi_{i,\mathrm{cap}}(\beta) \ge 0,
      \text{ hulls and the cone}                                                   \quad \forall i         & (9) \\
    & u_{min} \le u_k \le \rho u_{max}, \quad \alpha_{min,i} \le \alpha_i \le \alpha_{max,i}              & (10)

(3) is the paper's torque balance about the origin of W instead of the COM: the same constraint, since it differs
from it by p_COM x (2), and much sparser. (5), (6) and (8) are this project's body clearance. In (5) d is so large
that no rigid parts can touch. (6) keeps the parts of module i, as far as they are outside its own envelope, out of
the airflow of module j: balls that cover them, first those around the rotors (`topo_search.model.airflow_room`).
(8) keeps the end-effector, a ball as thick as its rod, out of all airflow; where (7) is left out, so that it may
be inside a module, so is (8). With body clearance the range of alpha_i is what is left of +-pi/2 by the rotors of
bolted modules, which must not touch the other module (`topo_search.model.folds`), and by all their parts, which
must keep out of the other's airflow. Of several ranges a hinge keeps to the one that it starts in. Without body
clearance the range is +-pi/2, as in the paper. In the paper's ablation (5) holds for all pairs, with the
separation as d, in place of (4), and (6) and (8) are left out. d_E is the paper's l_c, or the task's stand-off
where that is larger; rho is the share of u_max that the task allows, in the paper 1. Every clearance of (4) to (9)
keeps the margin. u_min is the least input of the task, in the paper 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import casadi as ca

from nlp import hinges, names
from nlp.envelope import Ball, ConeSphere, clearance, clearance_of_all
from nlp.exposure import exposure_clearances
from nlp.kinematics import Pose, poses
from nlp.units import Units
from nlp.wrench import force_residual, scaled, torque_residual
from topo_search.model import LEAST_OFFSET, ResolvedTask, Topology, needs_offset
from topo_search.model.airflow_room import part_cover
from topo_search.model.arrays import Array


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
    p_E: ca.SX
    """p'_E; empty when the task fixes the position from the COM."""
    u: list[ca.SX]

    def vector(self) -> ca.SX:
        """Return all unknowns as one column."""
        return ca.vertcat(self.root, self.alpha, self.p_E, *self.u)


@dataclass(frozen=True)
class Problem:
    """The whole nonlinear program of one task and topology."""

    variables: Variables
    beta: ca.SX
    """Sharpness of the log-sum-exp; a parameter of the program."""
    objective: ca.SX
    constraints: list[Constraint]
    lower: list[float]
    upper: list[float]
    """Bounds on the variables, in the order of `variables.vector()`; hinges have closer ones from a start on."""


def problem(task: ResolvedTask, topology: Topology, *, beside_airflow: bool = True) -> Problem:
    """Return the nonlinear program of a task for one topology.

    Args:
        task: the task.
        topology: the tree.
        beside_airflow: whether (6) and (8) are stated; most points that meet all others meet them.
    """
    n, K = topology.n, len(task.load_cases)
    module, unit = task.module, Units.of(task)
    l_c = module.connector_distance / unit.length
    m_E = task.end_effector.mass / module.mass

    # variables
    position = task.end_effector.fixed_position
    variables = Variables(
        root=ca.SX.sym("root", 3),
        alpha=ca.SX.sym("alpha", n - 1),
        p_E=ca.SX.sym("p_E", 3 if position is None else 0),
        u=[ca.SX.sym(f"u_{k}", 4 * n) for k in range(K)],
    )
    beta = ca.SX.sym("beta")

    # the platform
    modules = poses(topology, variables.root, variables.alpha, l_c)
    centroid = ca.sum2(ca.horzcat(*(pose.p for pose in modules))) / n
    p_E = variables.p_E
    if position is not None:  # given from the COM, which it moves: p'_E = centroid + (m_t / n m) p_E
        p_E = centroid + (n + m_E) / n * scaled(position, unit.length)
    p_COM = (m_E * p_E + n * centroid) / (n + m_E)

    # (1) objective
    weights = [case.weight for case in task.load_cases]
    effort = ca.SX(0)
    for weight, u_k in zip(weights, variables.u, strict=True):
        effort += weight * ca.sumsqr(u_k)
    objective = effort / (4 * n * sum(weights))

    # (2)-(3) wrench balance of every load case
    constraints: list[Constraint] = []
    for label, case, u_k in zip(task.case_labels, task.load_cases, variables.u, strict=True):
        force = force_residual(case, modules, u_k, unit)
        torque = torque_residual(case, modules, u_k, unit, p_E=p_E, p_COM=p_COM, module=module)
        constraints.append(Constraint(names.force(label), force / n, 0.0, 0.0))
        constraints.append(Constraint(names.torque(label), torque / n, 0.0, 0.0))

    # (4)-(9) clearances
    margin = task.search.margin / unit.length
    clear = _clearances(
        task, topology, modules, p_E=p_E, p_EB=p_E - p_COM, beta=beta, unit=unit, beside=beside_airflow
    )
    for name, gap in clear:
        constraints.append(Constraint(name, gap, margin))
    if any(needs_offset(requirement) for requirement in task.exposure):
        gap = distance_gap(p_E - p_COM, LEAST_OFFSET)
        constraints.append(Constraint(names.OFFSET, gap, 0.0))

    # (10) bounds
    return Problem(variables, beta, objective, constraints, *variable_bounds(task, topology))


def variable_bounds(
    task: ResolvedTask, topology: Topology, alpha: Array | None = None
) -> tuple[list[float], list[float]]:
    """Return (10): lower and upper bounds on the variables, in the order of `Variables.vector()`.

    Hinges keep to the ranges nearest to alpha (n-1,) [rad]; without, to what holds all of their ranges.
    """
    n, K = topology.n, len(task.load_cases)
    free, right = (-math.inf, math.inf), (-math.pi / 2, math.pi / 2)
    bounds = [free, free, free] if task.search.root == "free" else [(0.0, 0.0), right, right]
    bounds += zip(*hinges.ranges(task, topology, alpha), strict=True)
    bounds += [free] * (3 if task.end_effector.fixed_position is None else 0)
    bounds += [(task.min_thrust_to_weight, task.max_thrust_to_weight)] * (4 * n * K)
    lower, upper = (list(side) for side in zip(*bounds, strict=True))
    return lower, upper


def _clearances(
    task: ResolvedTask,
    topology: Topology,
    modules: list[Pose],
    *,
    p_E: ca.SX,
    p_EB: ca.SX,
    beta: ca.SX,
    unit: Units,
    beside: bool,
) -> Iterator[tuple[str, ca.SX]]:
    """Yield the name and the expression of every clearance, in l_arm near contact; `beside`: see `problem`."""
    beside = beside and task.body_clearance is not None
    air = task.module.envelope
    length, r_air, dr_air = (value / unit.length for value in (air.length, air.start_radius, air.growth))
    envelopes = [ConeSphere(pose.p, -length * pose.z, r_air, dr_air) for pose in modules]
    pairs = list(combinations(range(topology.n), 2))

    if task.search.interference == "airflow":  # (4)
        for i, j in pairs:
            yield names.airflow(i, j), clearance(envelopes[i], envelopes[j], beta)
        distance, separated = task.centre_distance, [pair for pair in pairs if pair not in topology.bolted]
    else:
        distance, separated = task.separation, pairs
    if distance is not None:  # (5)
        for i, j in separated:
            gap = distance_gap(modules[i].p - modules[j].p, distance / unit.length)
            yield names.separation(i, j), gap
    if beside:  # (6)
        balls = part_cover(task.module)
        places, radii = (values / unit.length for values in balls)
        for i, j in topology.unbolted:
            pose = modules[i]
            parts = [Ball(pose.p + pose.R @ ca.DM(x), r) for x, r in zip(places, radii.tolist(), strict=True)]
            yield names.rotor_airflow(i, j), clearance_of_all(envelopes[j], parts, beta)
    if task.exclusion_radius is not None:  # (7)
        for i, pose in enumerate(modules):
            gap = distance_gap(pose.p - p_E, task.exclusion_radius / unit.length)
            yield names.exclusion(i), gap
    if beside and task.tip_radius is not None:  # (8)
        tip = Ball(p_E, task.tip_radius / unit.length)
        for i, envelope in enumerate(envelopes):
            yield names.tip_airflow(i), clearance(envelope, tip, beta)
    for number, requirement in enumerate(task.exposure):  # (9)
        for i, envelope in enumerate(envelopes):
            gaps = exposure_clearances(requirement, envelope, p_E=p_E, p_EB=p_EB, beta=beta, unit=unit)
            for segment, gap in gaps:
                yield names.exposure(number, requirement, i, segment), gap


def distance_gap(offset: ca.SX, distance: float) -> ca.SX:
    """Return ||offset|| - distance, smooth everywhere and exact to first order at contact.

    A margin m is kept to first order too: the distance is short of it by m^2 / (2 distance).
    """
    return (ca.dot(offset, offset) - distance**2) / (2 * distance)

"""Forces and torques that no platform makes, whatever its angles, and failures of a rotor that none survives.

What is asked counts as produced to within the audit's tolerance.

| symbol | meaning | shape | unit |
|---|---|---|---|
| n, K | modules, load cases | | |
| F_k | total force of load case k; the rows of F | (3,) | N |
| nu_k | a direction for load case k, at most 1 long | (3,) | |
| z_i | thrust axis of module i | (3,) | |
| T | largest thrust that the task allows a module, over m g | | |
| W | weight of the platform | | N |
| s_q | share of rotor q in the thrust of one module | | |
| k | drag torque of a rotor over its thrust and the arm, k_tau / (k_f l_arm) | | |

Torques beyond the reach of all rotors.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | centre of mass of modules and joints | (3,) | m |
| q | end-effector position from c | (3,) | m |
| M | mass of modules and joints, m_t - m_E | | kg |
| tau_k | torque that load case k asks for, at the end-effector and at the COM | (3,) | N m |
| f_E, f_C | its forces at the end-effector and at the COM | (3,) | N |
| g_k | force that q has as its lever, f_E + (m_E / m_t) f_C | (3,) | N |
| d_ij | joints between the modules i and j | | |

About c the rotors must produce tau_k + q x g_k, since the COM is at (m_E / m_t) q. Whatever q is, its part along
g_k is that of tau_k.

The distance of module i from the modules' centroid is (2 l_c / n) sum_j d_ij at most, that of its rotors l_arm
more; joints shift c from the centroid a little. A rotor at o with
thrust f has the torque f o x z about c, and its drag (k_tau / k_f) f along z.

The reach is far from tight: no platform has all its modules at the longest levers, all thrusts across them and
turning the same way. So a torque that is not refused here need not be possible.

The residuals of a torque about the COM and about the end-effector, both at most e, differ by the force's residual
with the lever from one to the other, (M / m_t) q; c is (m_E / m_t) q beside the COM, on the same line. So about c
the residual is e (1 + 2 m_E / M) at most, wherever the end-effector is.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from nlp import names
from nlp.bounds.duality import greatest, multipliers
from nlp.bounds.effort import growth, least_sizes, total_forces
from nlp.bounds.refutation import (
    Refutation,
    bodies_mass,
    largest_thrust,
    modules,
    off_centre,
    tolerated_force,
    unseen_thrust,
)
from nlp.units import Units
from topo_search.model import LoadCase, ResolvedTask, Topology
from topo_search.model.proven import TOLERANCE, excess_texts, lower_text


class ForceProof(NamedTuple):
    """Settings of the proofs about forces."""

    rounding: float = 1e-12
    """Share of the forces that is left to rounding."""
    softened: float = 0.01
    """Knee of phi in the search for a proof, in its largest multiplier: nearly that of a thrust without cost."""
    weakest_drag: float = 1e-3
    """Least k with which the argument about one module is made: its shares are then known to a hundredth."""


FORCES = ForceProof()


def one_force(task: ResolvedTask) -> Refutation | None:
    """All rotors together pull with 4 n k_f rho u_max at most, whatever the angles."""
    required = least_sizes(task)
    k, most = int(np.argmax(required)), largest_thrust(task)
    if required[k] * (1 - FORCES.rounding) - tolerated_force(task) <= most + unseen_thrust(task):
        return None
    case, (needed, given) = task.case_labels[k], excess_texts(float(required[k]), most)
    return Refutation(
        names.force(case),
        float(required[k] - most),
        "N",
        f"{case} needs {excess_texts(required[k] / most, 1.0, 3)[0]} times what {modules(task)} can lift: "
        f"all rotors at full thrust give {given} N at most, the load case needs {needed} N",
    )


def axes(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """One module has one thrust axis, and the axes of a straight chain lie in the plane across its parallel hinges.

    If forces F_k, the rows of F, were all produced to within r along d dimensions, the other singular values of F
    would have sum_{j > d} sigma_j^2 <= K r^2.
    """
    if task.n == 1:
        d, reason = 1, "a single module thrusts along one axis"
    elif task.n == 2 or (topology is not None and _is_straight(topology)):
        d, reason = 2, f"the thrust axes of {task.n} modules in a straight chain lie in one plane"
    else:
        return None
    F = total_forces(task)
    apart = float(np.sqrt(np.sum(np.linalg.svd(F, compute_uv=False)[d:] ** 2)) - np.linalg.norm(growth(task)))
    missed = max(0.0, apart) / math.sqrt(len(F))
    if missed <= tolerated_force(task) + FORCES.rounding * float(np.linalg.norm(F)):
        return None
    return Refutation(
        "load cases, forces",
        missed,
        "N",
        f"{reason}, but the forces of the load cases do not: "
        f"at least one is missed by {lower_text(missed, 4)} N or more",
    )


@lru_cache(maxsize=32)
def all_forces(task: ResolvedTask) -> Refutation | None:
    """All load cases share the angles, which limits what the rotors give along directions nu_k, summed over them.

    Module i gives sum_k s_ik nu_k . z_i, no more than its largest thrust times the greatest sum_k max(nu_k . z, 0)
    over all unit z, whatever the nu_k; the load cases ask for sum_k nu_k . F_k.
    """
    F, T = total_forces(task), task.max_thrust_to_weight
    if len(F) == 1:
        return None
    f = F / (task.n * Units.of(task).force)
    nu = multipliers(f / T, np.full(len(f), FORCES.softened / 2), 1.0, largest=1.0)
    lengths = np.linalg.norm(nu, axis=1)
    if not lengths.max() > 0:
        return None
    nu, lengths = nu / lengths.max(), lengths / lengths.max()
    required = float(np.sum(nu * F)) + min(0.0, float(np.sum(nu * growth(task))))
    most = largest_thrust(task) * greatest(lambda z: np.sum(np.maximum(z @ nu.T, 0.0), axis=-1))
    # inputs a little below zero pull the other way, along every nu_k at once
    unseen = tolerated_force(task) * lengths.sum() + unseen_thrust(task) * (1 + lengths.sum()) * len(F)
    if required - unseen - FORCES.rounding * float(np.sum(np.abs(nu) * np.abs(F))) <= most:
        return None
    needed, given = excess_texts(required, most)
    serving = np.flatnonzero(lengths > FORCES.softened)
    cases = ", ".join(task.case_labels[k].removeprefix("load case ") for k in serving)
    return Refutation(
        f"load cases {cases}, forces",
        required - most,
        "N",
        f"no fixed angles let {modules(task)} produce the load cases {cases}: summed along one direction each, "
        f"all rotors at full thrust give {given} N at most, the load cases need {needed} N",
    )


def _is_straight(topology: Topology) -> bool:
    """Return whether every module is bolted at opposite ports at most: then all hinge axes are parallel."""
    ports: dict[int, set[int]] = {}
    for h, i, a, b in topology.edges():
        ports.setdefault(h, set()).add(a % 2)
        ports.setdefault(i, set()).add(b % 2)
    return all(len(axes) == 1 for axes in ports.values())


def failures(task: ResolvedTask) -> Refutation | None:
    """Return why no platform of the task's size hovers with any one rotor dead, if that is asked for.

    With one rotor dead all others pull with (4 n - 1) k_f u_max at most; `peak_input` does not bind them. One
    module pulls along one axis, about which only the drag of rotors turns it. With rotor q dead that is balanced if
    the one across has half of the thrust, s = s' + s'': so the centre of mass is half an arm away from the middle,
    to the side across. With that rotor dead instead it would have to be as far to the other side.
    """
    if task.flight.rotor_out == "none":
        return None
    module, W, n = task.module, task.force_unit(task.n), task.n
    name = "hover, any rotor dead"
    most = (4 * n - 1) * module.thrust_coefficient * module.max_input(task.gravity)
    if most * (1 + 2 * TOLERANCE) < W * (1 - 2 * TOLERANCE):
        weight, pull = excess_texts(W, most)
        return Refutation(
            name,
            W - most,
            "N",
            f"flight.rotor_out: {modules(task)} cannot hover with a rotor dead: all others at their limit pull "
            f"with {pull} N at most, the weight is {weight} N",
        )
    if n == 1 and module.torque_coefficient >= FORCES.weakest_drag * module.thrust_coefficient * module.arm_length:
        return Refutation(
            name,
            1.0,
            "rotors",
            "flight.rotor_out: one module cannot hover with any of its rotors dead: the centre of mass would have "
            "to be half an arm away from its middle, towards the rotor across from the dead one, whichever it is",
        )
    return None


class TorqueProof(NamedTuple):
    """Settings of the proofs about torques."""

    rounding: float = 1e-9
    """Share of a torque that is left to rounding."""
    least_force: float = 1e-6
    """Size of g_k under which its direction is not trusted, in m_t g and in the forces that it is the sum of."""


TORQUES = TorqueProof()


def torque_reach(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """All rotors at their limit, each at its longest lever, against the torque of every load case.

    Of all trees a straight chain has the largest sum of distances, sum_ij d_ij = n (n^2 - 1) / 3.
    """
    if task.heaviest_rod:  # whose weight turns a platform about any point, by a lever that is not known
        return None
    import networkx as nx

    n, module = task.n, task.module
    distances = n * (n**2 - 1) // 3 if topology is None else 2 * nx.wiener_index(topology.graph())
    lever = 2 * module.connector_distance * distances / n**2 + off_centre(task) + module.arm_length
    most = largest_thrust(task) * (lever + module.torque_coefficient / module.thrust_coefficient)
    required = [_least_torque(task, case) for case in task.load_cases]
    k = int(np.argmax(required))
    share = 1 + unseen_thrust(task) / largest_thrust(task)
    if required[k] * (1 - TORQUES.rounding) - _torque_tolerance(task, task.load_cases[k]) <= most * share:
        return None
    case, (needed, given) = task.case_labels[k], excess_texts(required[k], most)
    return Refutation(
        names.torque(case),
        required[k] - most,
        "N m",
        f"{case} needs a torque of at least {needed} N m about the centre of {modules(task)}: "
        f"all rotors at full thrust, as far out as they can be, give {given} N m at most",
    )


def _torque_tolerance(task: ResolvedTask, case: LoadCase) -> float:
    """Return by how much the torque about c may miss what is asked without the audit's saying so [N m]."""
    n, mass = task.n, bodies_mass(task)
    unseen = TOLERANCE * task.torque_unit(n) * (1 + 2 * task.end_effector.mass / mass)
    if task.end_effector.fixed_position is None:
        return unseen
    tip, com = np.array(case.at_end_effector.force), np.array(case.at_com.force)
    g = float(np.linalg.norm(tip + task.end_effector.mass / task.total_mass(n) * com))
    return unseen + TOLERANCE * task.module.arm_length * task.total_mass(n) / mass * g


def _least_torque(task: ResolvedTask, case: LoadCase) -> float:
    """Return the least torque about c that a load case can ask for [N m]."""
    n, tip, com = task.n, case.at_end_effector, case.at_com
    tau = np.add(tip.torque, com.torque)
    g = np.add(tip.force, np.multiply(task.end_effector.mass / task.total_mass(n), com.force))
    position, size = task.end_effector.fixed_position, float(np.linalg.norm(g))
    if position is not None:
        q = np.multiply(task.total_mass(n) / bodies_mass(task), position)
        return float(np.linalg.norm(tau + np.cross(q, g)))
    if size == 0:
        return float(np.linalg.norm(tau))
    forces = float(np.linalg.norm(tip.force) + np.linalg.norm(com.force))
    return abs(float(tau @ g)) / size if size > TORQUES.least_force * max(task.force_unit(n), forces) else 0.0

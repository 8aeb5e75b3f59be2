"""Forces and torques that no platform produces at any angles, and rotor failures that none survives.

A wrench counts as produced within the audit's tolerance.

| symbol | meaning | shape | unit |
|---|---|---|---|
| n, K | modules, load cases | | |
| F_k | total force of load case k; the rows of F | (3,) | N |
| nu_k | a direction for load case k, of length at most 1 | (3,) | |
| z_i | thrust axis of module i | (3,) | |
| T | largest thrust that the task allows a module, over m g | | |
| W | weight of the platform | | N |
| s_q | share of rotor q in the thrust of one module | | |
| k | drag torque of a rotor over its thrust and the arm, k_tau / (k_f l_arm) | | |

For torques:

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | centre of mass of modules and joints | (3,) | m |
| q | end-effector position from c | (3,) | m |
| M | mass of modules and joints, m_t - m_E | | kg |
| tau_k | torque of load case k, at the end-effector and at the COM | (3,) | N m |
| f_E, f_C | forces of the load case at the end-effector and at the COM | (3,) | N |
| g_k | force with the lever q, f_E + (m_E / m_t) f_C | (3,) | N |
| d_ij | joints between the modules i and j | | |

About c the rotors must produce tau_k + q x g_k, since the COM is at (m_E / m_t) q. For any q, its component along
g_k is that of tau_k.

The distance of module i from the modules' centroid is at most (2 l_c / n) sum_j d_ij, that of its rotors l_arm
more; joints shift c slightly from the centroid. A rotor at o with thrust f has the torque f o x z about c, and its
drag (k_tau / k_f) f along z.

The limit is far from tight: no platform has all its modules at the longest levers, with all thrusts perpendicular
to them and all torques in the same direction. So a torque that is not refuted here need not be possible.

The residuals of a torque about the COM and about the end-effector, both at most e, differ by the force's residual
with the lever from one to the other, (M / m_t) q; c is (m_E / m_t) q from the COM, on the same line. So about c the
residual is at most e (1 + 2 m_E / M), wherever the end-effector is.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from nlp import names
from nlp.bounds.duality import multipliers, sphere_maximum
from nlp.bounds.effort import heaviest_extra, least_force_norms, rod_force_change, total_forces
from nlp.bounds.refutation import (
    Refutation,
    bodies_mass,
    centre_offset,
    largest_drag,
    largest_thrust,
    longest_arm,
    size_text,
    thrust_shares,
    tolerated_force,
    tolerated_thrust,
)
from nlp.units import Units
from topo_search.model import Array, LoadCase, ResolvedTask, Topology
from topo_search.model.proven import TOLERANCE, excess_texts, lower_text


class ForceProof(NamedTuple):
    """Settings of the proofs about forces."""

    rounding: float = 1e-12
    """Allowance for rounding, over the forces."""
    smoothing: float = 0.01
    """Knee of phi in the search for a proof, over its largest multiplier: thrust has almost no cost."""
    min_drag: float = 1e-3
    """Least k for the argument about one module: its shares are then accurate to a hundredth."""


FORCES = ForceProof()


def refute_lift(task: ResolvedTask) -> Refutation | None:
    """Refute a force beyond the thrust of all rotors, r n k_f rho u_max at any angles."""
    required = least_force_norms(task)
    k, max_thrust = int(np.argmax(required)), largest_thrust(task)
    if required[k] * (1 - FORCES.rounding) - tolerated_force(task) <= max_thrust + tolerated_thrust(task):
        return None
    case, (required_text, limit_text) = task.case_labels[k], excess_texts(float(required[k]), max_thrust)
    return Refutation(
        names.force(case),
        float(required[k] - max_thrust),
        "N",
        f"{case} needs {excess_texts(required[k] / max_thrust, 1.0, 3)[0]} times what {size_text(task)} can lift: "
        f"all rotors at full thrust give {limit_text} N at most, the load case needs {required_text} N",
    )


def refute_axes(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Refute forces that span more directions than the thrust axes of a module, a flat lattice or a straight chain.

    The first two have one axis, if their rotors are parallel; those of a straight chain lie in the plane
    perpendicular to its parallel hinges.

    If forces F_k, the rows of F, were all produced to within r along d dimensions, the other singular values of F
    would have sum_{j > d} sigma_j^2 <= K r^2.
    """
    if any(kind.rotor_table.tilt > 0 for kind in task.types):
        return None
    if task.n == 1 or task.search.lattice is not None:
        d, reason = 1, f"{'a flat lattice' if task.n > 1 else 'a single module'} thrusts along one axis"
    elif task.n == 2 or (topology is not None and _is_straight(topology)):
        d, reason = 2, f"the thrust axes of {task.n} modules in a straight chain lie in one plane"
    else:
        return None
    F = total_forces(task)
    singular_values = np.linalg.svd(F, compute_uv=False)
    distance = float(np.sqrt(np.sum(singular_values[d:] ** 2)) - np.linalg.norm(rod_force_change(task)))
    error = max(0.0, distance) / math.sqrt(len(F))
    if error <= tolerated_force(task) + FORCES.rounding * float(np.linalg.norm(F)):
        return None
    return Refutation(
        "load cases, forces",
        error,
        "N",
        f"{reason}, but the forces of the load cases do not: without leaning between them, "
        f"at least one is missed by {lower_text(error, 4)} N or more",
    )


@lru_cache(maxsize=32)
def refute_forces(task: ResolvedTask) -> Refutation | None:
    """Refute forces that no common angles and attitude produce, by their sum along one direction nu_k each.

    For any nu_k, module i contributes sum_k s_ik nu_k . z_i, at most its largest thrust times the greatest
    sum_k max(nu_k . z, 0) over all unit z; the load cases require sum_k nu_k . F_k.
    """
    F = total_forces(task)
    nu = sum_directions(task, F) if len(F) > 1 else np.zeros_like(F)
    if not nu.any():
        return None
    lengths = np.linalg.norm(nu, axis=1)
    required = float(np.sum(nu * F)) + min(0.0, float(np.sum(nu * rod_force_change(task))))
    limit, tolerance = largest_sum(task, nu), sum_tolerance(task, nu)
    if required - tolerance - FORCES.rounding * float(np.sum(np.abs(nu) * np.abs(F))) <= limit:
        return None
    required_text, limit_text = excess_texts(required, limit)
    involved = np.flatnonzero(lengths > FORCES.smoothing)
    cases = ", ".join(task.case_labels[k].removeprefix("load case ") for k in involved)
    return Refutation(
        f"load cases {cases}, forces",
        required - limit,
        "N",
        f"no fixed angles let {size_text(task)} produce the load cases {cases} without leaning: summed along one "
        f"direction each, all rotors at full thrust give {limit_text} N at most, the cases need {required_text} N",
    )


def sum_directions(task: ResolvedTask, F: Array) -> Array:
    """Return good directions nu_k of a sum of forces F (K, 3) [N], the longest one of length 1; or zeros."""
    f, T = F / (task.n * Units.of(task).force), task.max_thrust_to_weight
    nu = multipliers(f / T, np.full(len(f), FORCES.smoothing / 2), 1.0, largest=1.0)
    return np.asarray(nu / (np.linalg.norm(nu, axis=1).max() or 1.0))


def largest_sum(task: ResolvedTask, nu: Array) -> float:
    """Return an upper bound on the sum of forces along one direction nu_k each [N]."""
    return largest_thrust(task) * sphere_maximum(lambda z: np.sum(np.maximum(z @ nu.T, 0.0), axis=-1))


def sum_tolerance(task: ResolvedTask, nu: Array) -> float:
    """Return the audit's tolerance of that sum [N]."""
    total = float(np.linalg.norm(nu, axis=1).sum())
    # inputs slightly below zero act in the opposite direction, along every nu_k at once
    return tolerated_force(task) * total + tolerated_thrust(task) * (1 + total) * len(nu)


def _is_straight(topology: Topology) -> bool:
    """Return whether every module has joints only at opposite ports, so that all hinge axes are parallel."""
    ports: dict[int, set[int]] = {}
    for h, i, a, b in topology.edges():
        ports.setdefault(h, set()).add(a % 2)
        ports.setdefault(i, set()).add(b % 2)
    return all(len(parities) == 1 for parities in ports.values())


def refute_failures(task: ResolvedTask) -> Refutation | None:
    """Refute hover with any one rotor dead, if the task requires it.

    With one rotor dead all others produce at most (r n - 1) k_f u_max; `peak_input` does not apply to them. One
    module has one thrust axis, about which only the drag of rotors has a torque. With rotor q dead that is balanced
    if the opposite rotor has half of the thrust, s = s' + s''; so the centre of mass is half an arm from the
    middle, towards that rotor. With that rotor dead instead, it would have to be equally far on the other side.
    """
    if task.flight.rotor_out == "none":
        return None
    module, W, n = task.module, task.force_unit(task.n), task.n
    name = "hover, any rotor dead"
    all_shares = thrust_shares(task)
    running = sum(count * float(shares.sum()) for shares, count in all_shares)
    running -= max(float(shares.max(initial=0.0)) for shares, _ in all_shares)
    limit = running * module.thrust_coefficient * module.max_input(task.gravity)
    if limit * (1 + 2 * TOLERANCE) < W * (1 - 2 * TOLERANCE):
        weight_text, limit_text = excess_texts(W, limit)
        return Refutation(
            name,
            W - limit,
            "N",
            f"flight.rotor_out: {size_text(task)} cannot hover with a rotor dead: all others at their limit pull "
            f"with {limit_text} N at most, the weight is {weight_text} N",
        )
    if (
        n == 1
        and not task.module_types
        and module.rotors is None
        and module.torque_coefficient >= FORCES.min_drag * module.thrust_coefficient * module.arm_length
    ):
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
    """Allowance for rounding, over a torque."""
    min_force: float = 1e-6
    """Least |g_k| with a reliable direction, over m_t g and over the forces that add up to it."""


TORQUES = TorqueProof()


def refute_torque(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Refute a torque beyond that of all rotors at their limit, each at its longest lever.

    A straight chain has the largest sum of distances of all trees, sum_ij d_ij = n (n^2 - 1) / 3.
    """
    if heaviest_extra(task):  # its weight has a torque about any point, with an unknown lever
        return None
    n = task.n
    distances = n * (n**2 - 1) // 3 if topology is None else int(topology.distances.sum())
    if task.module_types:  # the outermost modules may have most of the thrust
        distances = n * n * (n - 1) // 2 if topology is None else n * int(topology.distances.sum(axis=1).max())
    lever = 2 * task.longest_connector * distances / n**2 + centre_offset(task) + longest_arm(task)
    limit = largest_thrust(task) * (lever + largest_drag(task))
    required = [_least_torque(task, case) for case in task.load_cases]
    k = int(np.argmax(required))
    share = 1 + tolerated_thrust(task) / largest_thrust(task)
    if required[k] * (1 - TORQUES.rounding) - _torque_tolerance(task, task.load_cases[k]) <= limit * share:
        return None
    case, (required_text, limit_text) = task.case_labels[k], excess_texts(required[k], limit)
    return Refutation(
        names.torque(case),
        required[k] - limit,
        "N m",
        f"{case} needs a torque of at least {required_text} N m about the centre of {size_text(task)}: "
        f"all rotors at full thrust, as far out as they can be, give {limit_text} N m at most",
    )


def _torque_tolerance(task: ResolvedTask, case: LoadCase) -> float:
    """Return the audit's tolerance of the torque about c [N m]."""
    n, mass = task.n, bodies_mass(task)
    tolerance = TOLERANCE * task.torque_unit(n) * (1 + 2 * task.end_effector.mass / mass)
    if task.end_effector.fixed_position is None:
        return tolerance
    tip, com = np.array(case.at_end_effector.force), np.array(case.at_com.force)
    g = float(np.linalg.norm(tip + task.end_effector.mass / task.total_mass(n) * com))
    return tolerance + TOLERANCE * task.module.arm_length * task.total_mass(n) / mass * g


def _least_torque(task: ResolvedTask, case: LoadCase) -> float:
    """Return the least torque about c that a load case requires over all q [N m]."""
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
    return abs(float(tau @ g)) / size if size > TORQUES.min_force * max(task.force_unit(n), forces) else 0.0

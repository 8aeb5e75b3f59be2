"""Forces that no thrusts of a platform make, whatever its angles, and failures of a rotor that none survives.

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
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from nlp import names
from nlp.bounds.duality import multipliers
from nlp.bounds.effort import growth, least_sizes, total_forces
from nlp.bounds.refutation import Refutation, largest_thrust, modules, tolerated_force, unseen_thrust
from nlp.bounds.sphere import greatest
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.proven import excess_texts, lower_text
from topo_search.model.tolerances import TOLERANCE

ROUNDING = 1e-12
"""Share of the forces that is left to rounding."""
SOFTENED = 0.01
"""Knee of phi in the search for a proof, in its largest multiplier: nearly that of a thrust without cost."""
WEAKEST_DRAG = 1e-3
"""Least k with which the argument about one module is made: its shares are then known to a hundredth."""


def one_force(task: ResolvedTask) -> Refutation | None:
    """All rotors together pull with 4 n k_f rho u_max at most, whatever the angles."""
    asked = least_sizes(task)
    k, most = int(np.argmax(asked)), largest_thrust(task)
    if asked[k] * (1 - ROUNDING) - tolerated_force(task) <= most + unseen_thrust(task):
        return None
    case, (needed, given) = task.case_labels[k], excess_texts(float(asked[k]), most)
    return Refutation(
        names.force(case),
        float(asked[k] - most),
        "N",
        f"{case} needs {excess_texts(asked[k] / most, 1.0, 3)[0]} times what {modules(task)} can lift: "
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
    if missed <= tolerated_force(task) + ROUNDING * float(np.linalg.norm(F)):
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
    nu = multipliers(f / T, np.full(len(f), SOFTENED / 2), 1.0, largest=1.0)
    lengths = np.linalg.norm(nu, axis=1)
    if not lengths.max() > 0:
        return None
    nu, lengths = nu / lengths.max(), lengths / lengths.max()
    asked = float(np.sum(nu * F)) + min(0.0, float(np.sum(nu * growth(task))))
    most = largest_thrust(task) * greatest(lambda z: np.sum(np.maximum(z @ nu.T, 0.0), axis=-1))
    # inputs a little below zero pull the other way, along every nu_k at once
    unseen = tolerated_force(task) * lengths.sum() + unseen_thrust(task) * (1 + lengths.sum()) * len(F)
    if asked - unseen - ROUNDING * float(np.sum(np.abs(nu) * np.abs(F))) <= most:
        return None
    needed, given = excess_texts(asked, most)
    serving = np.flatnonzero(lengths > SOFTENED)
    cases = ", ".join(task.case_labels[k].removeprefix("load case ") for k in serving)
    return Refutation(
        f"load cases {cases}, forces",
        asked - most,
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
    if n == 1 and module.torque_coefficient >= WEAKEST_DRAG * module.thrust_coefficient * module.arm_length:
        return Refutation(
            name,
            1.0,
            "rotors",
            "flight.rotor_out: one module cannot hover with any of its rotors dead: the centre of mass would have "
            "to be half an arm away from its middle, towards the rotor across from the dead one, whichever it is",
        )
    return None

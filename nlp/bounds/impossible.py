"""Proofs that no topology of a size, or no design of one topology, can do a task.

Every rule leaves out all that it does not name, so what it refuses cannot be done with the rest either. An asked
force counts as produced to within the audit's tolerance.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from nlp import names
from nlp.bounds.duality import multipliers
from nlp.bounds.effort import total_forces
from nlp.bounds.sphere import greatest
from nlp.units import Units
from topo_search.model import Infeasible, ResolvedTask, Topology

TOLERANCE = 1e-6
"""Largest wrench residual of a design that passes its audit [m_t g]."""
SOFTENED = 0.01
"""Knee of phi in the search for a proof, in its largest multiplier: nearly that of a thrust without cost."""


def prove_impossible(task: ResolvedTask, topology: Topology | None = None) -> Infeasible | None:
    """Return the proof that the topology, or without one every topology of the task's size, fails, if there is one.

    Raises:
        ValueError: a topology of another size.
    """
    if topology is not None and task.n != topology.n:
        raise ValueError(f"`task.n == topology.n` must hold, but got {task.n} != {topology.n}")
    return _one_force(task) or _axes(task, topology) or _all_forces(task)


def _one_force(task: ResolvedTask) -> Infeasible | None:
    """All rotors together pull with 4 n k_f u_max at most, whatever the angles."""
    asked = np.linalg.norm(total_forces(task), axis=1)
    k, most = int(np.argmax(asked)), _largest_thrust(task)
    if asked[k] - TOLERANCE * task.force_unit(task.n) <= most:
        return None
    return _proof(
        names.force(k),
        float(asked[k] - most),
        f"{_modules(task)} can lift {asked[k] / most:.3g} times less than load case {k} asks: "
        f"all rotors at their limit pull with {most:.4g} N, the load case needs {asked[k]:.4g} N",
    )


def _axes(task: ResolvedTask, topology: Topology | None) -> Infeasible | None:
    """One module has one thrust axis, and the axes of a straight chain lie in the plane across its parallel hinges.

    If forces F_k, the rows of F, were all produced to within r along d dimensions, the other singular values of F
    would have sum_{j > d} sigma_j^2 <= K r^2.
    """
    if task.n == 1:
        d, reason = 1, "one module pulls along one axis"
    elif task.n == 2 or (topology is not None and _straight(topology)):
        d, reason = 2, f"the thrust axes of {task.n} modules in a straight chain lie in one plane"
    else:
        return None
    F = total_forces(task)
    missed = float(np.sqrt(np.sum(np.linalg.svd(F, compute_uv=False)[d:] ** 2) / len(F)))
    if missed <= TOLERANCE * task.force_unit(task.n):
        return None
    return _proof(
        "load cases, forces",
        missed,
        f"{reason}, but the forces of the load cases do not: one of them is missed by {missed:.4g} N at least",
        topology,
    )


@lru_cache(maxsize=32)
def _all_forces(task: ResolvedTask) -> Infeasible | None:
    """All load cases share the angles, which limits what the rotors give along directions nu_k, summed over them.

    Module i gives sum_k s_ik nu_k . z_i, no more than its largest thrust times the greatest sum_k max(nu_k . z, 0)
    over all unit z, whatever the nu_k; the load cases ask for sum_k nu_k . F_k.
    """
    F, T = total_forces(task), task.module.max_thrust_to_weight
    if len(F) == 1:
        return None
    f = F / (task.n * Units.of(task).force)
    nu = multipliers(f / T, np.full(len(f), SOFTENED / 2), 1.0, largest=1.0)
    lengths = np.linalg.norm(nu, axis=1)
    if not lengths.max() > 0:
        return None
    nu, lengths = nu / lengths.max(), lengths / lengths.max()
    asked = float(np.sum(nu * F))
    most = _largest_thrust(task) * greatest(lambda z: np.sum(np.maximum(z @ nu.T, 0.0), axis=-1))
    if asked - TOLERANCE * task.force_unit(task.n) * lengths.sum() <= most:
        return None
    cases = ", ".join(str(k) for k in np.flatnonzero(lengths > SOFTENED))
    return _proof(
        f"load cases {cases}, forces",
        asked - most,
        f"{_modules(task)} cannot serve the load cases {cases} with the same angles: summed along one direction "
        f"each, all rotors at their limit pull with {most:.4g} N, the load cases need {asked:.4g} N",
    )


def _straight(topology: Topology) -> bool:
    """Return whether every module is bolted at opposite ports at most: then all hinge axes are parallel."""
    ports: dict[int, set[int]] = {}
    for h, i, a, b in topology.edges():
        ports.setdefault(h, set()).add(a % 2)
        ports.setdefault(i, set()).add(b % 2)
    return all(len(axes) == 1 for axes in ports.values())


def _largest_thrust(task: ResolvedTask) -> float:
    """Return 4 n k_f u_max [N]."""
    return 4 * task.n * task.module.thrust_coefficient * task.module.max_input(task.gravity)


def _modules(task: ResolvedTask) -> str:
    return "one module" if task.n == 1 else f"{task.n} modules"


def _proof(name: str, violation: float, message: str, topology: Topology | None = None) -> Infeasible:
    return Infeasible(
        topology=topology,
        topology_key=topology and topology.key,
        status="impossible",
        worst_constraint=name,
        violation=violation,
        unit="N",
        message=message,
    )

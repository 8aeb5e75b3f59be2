"""What holds for every topology: a lower bound on the control effort, and proofs that a size cannot do a task."""

from __future__ import annotations

import numpy as np

from topo_search.model import Infeasible, ResolvedTask
from topo_search.model.arrays import Array


def total_forces(task: ResolvedTask) -> Array:
    """Return F_k = f_E + f_C of every load case, shape (K, 3) [N]."""
    return np.array([np.add(case.at_end_effector.force, case.at_com.force) for case in task.load_cases])


def lower_bound(task: ResolvedTask) -> float:
    """Return a bound that no design of the task's size undercuts, J >= (trace Q^(1/2))^2 / (4 n k_f^2) [rad^4/s^4].

    Drop torques, bounds and geometry. With s_ik the thrust of module i in load case k, its four rotors share it
    at best equally, ||u_ik||^2 >= s_ik^2 / (4 k_f^2), and F_k = Z s_k with Z = [z_1 .. z_n]. For fixed Z the least
    ||s_k||^2 is F_k^T M^+ F_k with M = Z Z^T, trace M = n. With Q = sum_k lambda_k F_k F_k^T, minimising
    trace(M^+ Q) over all positive semidefinite M of trace n gives (trace Q^(1/2))^2 / n, at M ~ Q^(1/2).
    """
    F = total_forces(task)
    weights = np.array([case.weight for case in task.load_cases])
    eigenvalues = np.linalg.eigvalsh((F.T * weights) @ F)
    root_trace = np.sqrt(np.clip(eigenvalues, 0.0, None)).sum()
    return float(root_trace**2 / (4 * task.n * task.module.thrust_coefficient**2))


def prove_impossible(task: ResolvedTask) -> Infeasible | None:
    """Return the proof that no topology of the task's size can do it, if there is one.

    All rotors together pull with 4 n k_f u_max at most, whatever the angles.
    """
    asked = np.linalg.norm(total_forces(task), axis=1)
    k = int(np.argmax(asked))
    most = 4 * task.n * task.module.thrust_coefficient * task.module.max_input(task.gravity)
    if asked[k] <= most:
        return None
    modules = "one module" if task.n == 1 else f"{task.n} modules"
    return Infeasible(
        topology=None,
        topology_key=None,
        status="impossible",
        worst_constraint=f"load case {k}, force",
        violation=float(asked[k] - most),
        unit="N",
        message=(
            f"{modules} can lift {asked[k] / most:.3g} times less than load case {k} asks: "
            f"all rotors at their limit pull with {most:.4g} N, the load case needs {asked[k]:.4g} N"
        ),
    )

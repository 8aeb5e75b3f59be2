"""Proofs that a task is impossible for all topologies of a size, or for one topology.

Every rule drops the requirements that it does not name, so a task that it refutes is impossible with these as well.
"""

from nlp.bounds.air import refute_airspeed
from nlp.bounds.effort import lightest_task
from nlp.bounds.reach import refute_path, refute_reach, refute_rotors, refute_stand_off
from nlp.bounds.refutation import Refutation, size_text
from nlp.bounds.rigid import refute_rigid
from nlp.bounds.wrenches import refute_axes, refute_failures, refute_forces, refute_lift, refute_torque
from topo_search.model import Infeasible, ResolvedTask, Topology


def prove_impossible(task: ResolvedTask, topology: Topology | None = None) -> Infeasible | None:
    """Return a proof that the task is impossible for its size, or for the given topology; None without one.

    Raises:
        ValueError: The topology has another size.
    """
    if topology is not None and task.n != topology.n:
        raise ValueError(f"`task.n == topology.n` must hold, but got {task.n} != {topology.n}")
    given, declared, task = task.declared, task.declared.lightest, lightest_task(task)
    forces = refute_lift(task) or refute_axes(task) or refute_forces(task) or refute_failures(declared)
    refutation = forces or refute_reach(task) or refute_rotors(task) or refute_airspeed(declared)
    refutation, concerned = refutation or _refute_shape(task), None
    if refutation is None and topology is not None:
        refutation = refute_axes(task, topology) or refute_rigid(given, topology) or _refute_shape(task, topology)
        concerned = topology
    if refutation is None:
        return None
    return Infeasible(
        topology=concerned,
        topology_key=concerned and concerned.key,
        status="impossible",
        worst_constraint=refutation.name,
        violation=refutation.amount,
        unit=refutation.unit,
        message=_reserve_prefix(declared, concerned) + refutation.message,
    )


def _reserve_prefix(task: ResolvedTask, topology: Topology | None) -> str:
    """Return a prefix that names the reserve without which nothing refutes the task, or an empty string."""
    for field in ("force_reserve", "torque_reserve"):
        without = task.model_copy(update={"flight": task.flight.model_copy(update={field: 0.0})})
        if getattr(task.flight, field) and prove_impossible(without, topology) is None:
            subject = size_text(task) if topology is None else topology.key
            return f"flight.{field}: no platform of {subject} has so much reserve: "
    return ""


def _refute_shape(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Refute the task by the shape of the tree at any hinge angles; without a tree, by that of every tree.

    In a lattice, neighbours at the ends of a path may be bolted together.
    """
    path = None if task.search.lattice is not None else refute_path(task, topology)
    return refute_torque(task, topology) or path or refute_stand_off(task, topology)

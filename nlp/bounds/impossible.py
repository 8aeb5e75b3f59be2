"""Proofs that no topology of a size, or no design of one topology, can do a task.

Every rule leaves out all that it does not name, so what it refuses cannot be done with the rest either.
"""

from __future__ import annotations

from nlp.bounds.air import windy
from nlp.bounds.forces import all_forces, axes, failures, one_force
from nlp.bounds.paths import crowded_path
from nlp.bounds.reach import out_of_reach, rotors_overlap, stand_off
from nlp.bounds.refutation import Refutation, modules
from nlp.bounds.torques import torque_reach
from topo_search.model import Infeasible, ResolvedTask, Topology
from topo_search.model.corners import to_corners


def prove_impossible(task: ResolvedTask, topology: Topology | None = None) -> Infeasible | None:
    """Return the proof that no topology of the task's size, or not this one, can do the task, if there is one.

    Raises:
        ValueError: a topology of another size.
    """
    if topology is not None and task.n != topology.n:
        raise ValueError(f"`task.n == topology.n` must hold, but got {task.n} != {topology.n}")
    stated = task.declared.lightest
    task = to_corners(stated, inner=True)
    forces = one_force(task) or axes(task) or all_forces(task) or failures(stated)
    refutation, concerned = (
        forces or out_of_reach(task) or rotors_overlap(task) or windy(stated) or _shape(task),
        None,
    )
    if refutation is None and topology is not None:
        refutation, concerned = axes(task, topology) or _shape(task, topology), topology
    if refutation is None:
        return None
    return Infeasible(
        topology=concerned,
        topology_key=concerned and concerned.key,
        status="impossible",
        worst_constraint=refutation.name,
        violation=refutation.amount,
        unit=refutation.unit,
        message=_reserve_at_fault(stated, concerned) + refutation.message,
    )


def _reserve_at_fault(task: ResolvedTask, topology: Topology | None) -> str:
    """Return words that name the reserve without which nothing refutes the task; none if there is no such one."""
    for field in ("force_reserve", "torque_reserve"):
        without = task.model_copy(update={"flight": task.flight.model_copy(update={field: 0.0})})
        if getattr(task.flight, field) and prove_impossible(without, topology) is None:
            what = modules(task) if topology is None else topology.key
            return f"flight.{field}: no platform of {what} has so much reserve: "
    return ""


def _shape(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Return what the shape of one tree rules out at any hinge angles; without one, that of every tree."""
    return torque_reach(task, topology) or crowded_path(task, topology) or stand_off(task, topology)

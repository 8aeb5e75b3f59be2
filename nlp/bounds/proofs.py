"""Proofs that no topology of a size, or no design of one topology, can do a task.

Every rule leaves out all that it does not name, so what it refuses cannot be done with the rest either.

The branch and bound of one tree is loaded when it is used: it is compiled, and other commands need not load it.
"""

from __future__ import annotations

from collections.abc import Callable

from nlp.bounds.air import windy
from nlp.bounds.effort import lightest_cases
from nlp.bounds.reach import crowded_path, out_of_reach, rotors_overlap, stand_off
from nlp.bounds.refutation import Refutation, modules
from nlp.bounds.wrenches import all_forces, axes, failures, one_force, torque_reach
from topo_search.model import Chunk, Infeasible, ResolvedTask, Topology
from topo_search.model.proof import Problem


def prove_impossible(task: ResolvedTask, topology: Topology | None = None) -> Infeasible | None:
    """Return the proof that no topology of the task's size, or not this one, can do the task, if there is one.

    Raises:
        ValueError: a topology of another size.
    """
    if topology is not None and task.n != topology.n:
        raise ValueError(f"`task.n == topology.n` must hold, but got {task.n} != {topology.n}")
    declared, task = task.declared.lightest, lightest_cases(task)
    forces = one_force(task) or axes(task) or all_forces(task) or failures(declared)
    refutation, concerned = (
        forces or out_of_reach(task) or rotors_overlap(task) or windy(declared) or _shape(task),
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
        message=_reserve_at_fault(declared, concerned) + refutation.message,
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


def prove_chunk(
    task: ResolvedTask,
    topology: Topology,
    number: int,
    cut: float,
    problem: Problem = "task",
    *,
    most_boxes: int | None = None,
) -> Chunk:
    """Search one chunk of a tree's angles for designs that cost less than a cut.

    Args:
        task: the task.
        topology: the tree.
        number: of the chunk.
        cut: effort [rad^4/s^4].
        problem: which designs it is about (`topo_search.model.proof`).
        most_boxes: after which the chunk is left open; default: `nlp.bounds.branch.proof.MAX_BOXES`.

    Raises:
        ValueError: there is no such chunk.
    """
    from nlp.bounds.branch import proof

    most = proof.MAX_BOXES if most_boxes is None else most_boxes
    return proof.prove_chunk(task, topology, number, cut, problem, most_boxes=most)


def prepare_proof(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile the code of a proof before workers need it; `tell` gets a message if that takes a while."""
    from nlp.bounds.branch import proof

    proof.prepare(task, tell)

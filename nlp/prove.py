"""The branch and bound of one tree, loaded when it is used: it is compiled, and other commands need not load it."""

from __future__ import annotations

from collections.abc import Callable

from topo_search.model import Chunk, ResolvedTask, Topology
from topo_search.model.proof import Problem


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
        most_boxes: after which the chunk is left open; default: `nlp.bounds.branch.proof.MOST_BOXES`.

    Raises:
        ValueError: there is no such chunk.
    """
    from nlp.bounds.branch import proof

    most = proof.MOST_BOXES if most_boxes is None else most_boxes
    return proof.prove_chunk(task, topology, number, cut, problem, most_boxes=most)


def prepare_proof(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile what a proof takes, so that no worker has to; `tell` is told if that takes a while."""
    from nlp.bounds.branch import proof

    proof.prepare(task, tell)

"""The proof of one tree, chunk by chunk; chunks (`topo_search.model.proof`) are searched independently.

The search is imported on use: it is compiled, and other commands need not load it.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np

from nlp.bounds.branch.arrays import centre, effort_unit, hinge_angles, is_symmetric, reroot, to_arrays, whole_box
from topo_search.model import Array, Chunk, ResolvedTask, Topology
from topo_search.model.proof import CHUNK_SPLITS, Problem, chunk_count, most_effort
from topo_search.model.topology import straight_chain

MAX_BOXES = 4_000_000
"""Limit on the boxes of one chunk; beyond it the chunk stays open."""
CUT_MARGIN = 1e-12
"""Relative amount by which a bound must exceed the cut, for the rounding of units."""


def prove_chunk(
    task: ResolvedTask,
    topology: Topology,
    number: int,
    cut: float,
    problem: Problem = "task",
    *,
    most_boxes: int = MAX_BOXES,
) -> Chunk:
    """Search one chunk of a tree's angles for designs that cost less than a cut.

    Args:
        task: task.
        topology: tree.
        number: number of the chunk.
        cut: effort [rad^4/s^4]; from `most_effort` on, the chunk is searched for any design.
        problem: designs that the proof covers (`topo_search.model.proof`).
        most_boxes: limit on the number of boxes; beyond it the chunk stays open.

    Raises:
        ValueError: No chunk has this number.
    """
    from nlp.bounds.branch.search import BOX_LIMIT, CLOSED, search

    n = topology.n
    if not 0 <= number < chunk_count(n):
        raise ValueError(f"`0 <= number < {chunk_count(n)}` must hold, but got {number}")
    tree = reroot(topology, centre(task, topology))
    lower, upper = chunk_box(task, n, number)
    weighted = cut < most_effort(task)
    if not weighted and is_symmetric(task, problem):
        lower[0] = upper[0] = 0.0
    if np.any(lower > upper):  # no combination of the set's hinge angles is in the chunk
        return Chunk.of(number, "closed", b"")
    cut_in_units = cut / effort_unit(task) * (1 + CUT_MARGIN)
    result = search(to_arrays(task, tree, problem, weighted=weighted), lower, upper, cut_in_units, most_boxes)
    outcome: Literal["closed", "many", "stuck"] = "stuck"
    if result.outcome == CLOSED:
        outcome = "closed"
    elif result.outcome == BOX_LIMIT:
        outcome = "many"
    open_box = () if outcome == "closed" else (tuple(result.lower.tolist()), tuple(result.upper.tolist()))
    corners = tuple(np.flatnonzero(result.active_cases[len(task.load_cases) :]).tolist())
    return Chunk.of(number, outcome, np.asarray(result.record).tobytes(), open_box, corners)


def chunk_box(task: ResolvedTask, n: int, number: int) -> tuple[Array, Array]:
    """Return the least and greatest angles of a chunk, shape (n + 2,) [rad]; an empty one begins at infinity."""
    from nlp.bounds.branch.search import halves

    angles, (lower, upper) = hinge_angles(task), whole_box(task, n)
    for split in range(CHUNK_SPLITS if n > 1 else 0):
        axis = 3 + split % (n - 1)
        lower_end, upper_begin = halves(angles, lower[axis], upper[axis])
        if number >> (CHUNK_SPLITS - 1 - split) & 1:
            lower[axis] = upper_begin
        else:
            upper[axis] = lower_end
    return lower, upper


def prepare(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile the search of a chunk unless its cache is up to date; `tell` gets a message if that takes long."""
    from nlp.bounds.branch.search import search
    from topo_search.compiled_code import is_cached

    if not is_cached(search):
        tell("compiling the prover (once per installation, about two minutes)")
    prove_chunk(task, straight_chain(task.n), 0, 0.0, most_boxes=1)

"""The proof of one tree, chunk by chunk: each is searched by itself, here or elsewhere.

What a chunk is, `topo_search.model.proof` says.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from nlp.bounds.branch.arrays import (
    centre,
    effort_unit,
    hinge_angles,
    reroot,
    to_arrays,
    whole_box,
)
from nlp.bounds.branch.search import CLOSED, MANY, halves, search
from nlp.numbers import cholesky
from topo_search.model import Chunk, ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import is_kept, refresh
from topo_search.model.proof import CHUNK_SPLITS, Problem, chunk_count
from topo_search.model.topology import straight_chain

refresh(search, Path(__file__).parent, Path(cholesky.__file__))

MOST_BOXES = 4_000_000
"""Boxes of one chunk, after which it is left open."""
ABOVE = 1e-12
"""Share by which a bound must exceed the cut, for the rounding of units."""


def prove_chunk(
    task: ResolvedTask,
    topology: Topology,
    number: int,
    cut: float,
    problem: Problem = "task",
    *,
    most_boxes: int = MOST_BOXES,
) -> Chunk:
    """Search one chunk of a tree's angles for designs that cost less than a cut.

    Args:
        task: the task.
        topology: the tree.
        number: of the chunk.
        cut: effort [rad^4/s^4].
        problem: which designs it is about.
        most_boxes: after which the chunk is left open.

    Raises:
        ValueError: there is no such chunk.
    """
    n = topology.n
    if not 0 <= number < chunk_count(n):
        raise ValueError(f"`0 <= number < {chunk_count(n)}` must hold, but got {number}")
    tree = reroot(topology, centre(task, topology))
    lower, upper = chunk_box(task, n, number)
    if np.any(lower > upper):  # no combination of a set of hinge angles is in it
        return Chunk.of(number, "closed", b"")
    result = search(to_arrays(task, tree, problem), lower, upper, cut / effort_unit(task) * (1 + ABOVE), most_boxes)
    outcome: Literal["closed", "many", "stuck"] = "stuck"
    if result.how == CLOSED:
        outcome = "closed"
    elif result.how == MANY:
        outcome = "many"
    stuck = () if outcome == "closed" else (tuple(result.lower.tolist()), tuple(result.upper.tolist()))
    corners = tuple(np.flatnonzero(result.used[len(task.load_cases) :]).tolist())
    return Chunk.of(number, outcome, np.asarray(result.record).tobytes(), stuck, corners)


def chunk_box(task: ResolvedTask, n: int, number: int) -> tuple[Array, Array]:
    """Return the box of a chunk, from and to, shape (n + 2,) each [rad]; one without angles begins at infinity."""
    angles, (lower, upper) = hinge_angles(task), whole_box(task, n)
    for split in range(CHUNK_SPLITS if n > 1 else 0):
        axis = 3 + split % (n - 1)
        end, begin = halves(angles, lower[axis], upper[axis])
        if number >> (CHUNK_SPLITS - 1 - split) & 1:
            lower[axis] = begin
        else:
            upper[axis] = end
    return lower, upper


def prepare(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile the search of a chunk, unless it is kept and up to date; `tell` is told if it takes a while."""
    if not is_kept(search):
        tell("compiling the prover (once per installation, about two minutes)")
    prove_chunk(task, straight_chain(task.n), 0, 0.0, most_boxes=1)

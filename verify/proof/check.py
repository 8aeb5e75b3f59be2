"""The check of one chunk of a proof."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from topo_search.model import CheckedChunk, Chunk, ResolvedTask, Topology, proven
from topo_search.model.compiled_code import is_kept, refresh
from topo_search.model.proof import CHUNK_SPLITS, Problem, chunk_count, proof_task
from topo_search.model.topology import straight_chain
from verify.bodies import Array
from verify.proof import replay
from verify.proof.platform import all_angles, angles_around, angles_of_hinges, effort_unit, numbers, reroot

refresh(replay.replay, Path(__file__).parent, Path(proven.__file__))

MOST_MODULES = 12
"""The allowances for rounding hold for so many (`verify.proof.dual`)."""
REASONS = {
    replay.ENDS_EARLY: "the record ends before it",
    replay.GOES_ON: "the record continues after the last box",
    replay.NO_SUCH_ANGLE: "the record halves an unknown angle, or one without width",
    replay.TOO_DEEP: "the record halves it more often than a number can be",
    replay.NOT_BOUNDED: "no bound excludes it",
    replay.NOT_CROWDED: "no two modules are too close everywhere in it",
}
"""Faults of a box, by the outcome of its replay."""


def check_chunk(
    task: ResolvedTask, topology: Topology, root_module: int, cut: float, chunk: Chunk, problem: Problem = "task"
) -> CheckedChunk:
    """Check that no design of one chunk of a tree's angles costs less than a cut.

    Args:
        task: the task.
        topology: the tree.
        root_module: the module that angles are counted from.
        cut: effort [rad^4/s^4].
        chunk: its number and its record; all else is found here.
        problem: which designs the proof is about.
    """
    n = topology.n
    if fault := _unfit(task, n, root_module, chunk, problem):
        return CheckedChunk(number=chunk.number, fault=fault)
    try:
        record = np.frombuffer(chunk.record, np.uint8)
    except ValueError as error:
        return CheckedChunk(number=chunk.number, fault=str(error))
    lower, upper = chunk_box(task, n, chunk.number)
    if np.any(lower > upper) and not len(record):  # no angles of the task's set are in the chunk
        return CheckedChunk(number=chunk.number, fault=None)
    data = numbers(task, reroot(topology, root_module), problem, chunk.corners)
    # a bound in these units is off from one in SI by a few roundings
    replayed = replay.replay(data, lower, upper, cut / effort_unit(task) * (1 + 1e-12), record)
    fault = None
    if replayed.how != replay.HELD:
        where = _words(replayed.lower, replayed.upper)
        fault = f"box {replayed.position + 1} of {len(record)}: {REASONS[replayed.how]} ({where})"
    return CheckedChunk(number=chunk.number, fault=fault, boxes=len(record), halved=replayed.extra)


def prepare_check(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile the check of a chunk, unless it is kept and up to date; `tell` is told if it takes a while."""
    if not is_kept(replay.replay):
        tell("compiling the checker of proofs (once per installation, about two minutes)")
    check_chunk(task, straight_chain(task.n), 0, 0.0, Chunk.of(0, "closed", b"", ()))


def chunk_box(task: ResolvedTask, n: int, number: int) -> tuple[Array, Array]:
    """Return the box of a chunk, from and to, shape (n + 2,) [rad]: the chunks together are all angles.

    A chunk without any angle of the task's set has a box that ends before it begins.
    """
    (lower, upper), angles = all_angles(task, n), angles_of_hinges(task)
    for split in range(CHUNK_SPLITS if n > 1 else 0):
        a = 3 + split % (n - 1)
        below, beyond = angles_around(angles, (lower[a] + upper[a]) / 2)
        if number >> (CHUNK_SPLITS - 1 - split) & 1 == 0:
            upper[a] = below
        else:
            lower[a] = beyond
    return lower, upper


def _unfit(task: ResolvedTask, n: int, root_module: int, chunk: Chunk, problem: Problem) -> str | None:
    """Say what keeps a chunk from being looked at."""
    if not 1 <= n <= MOST_MODULES:
        return f"a check takes 1 to {MOST_MODULES} modules, but the tree has {n}"
    if task.n != n:
        return f"the task has {task.n} modules, but the tree {n}"
    if chunk.number >= chunk_count(n):
        return f"there is no chunk {chunk.number}"
    if root_module >= n or (task.search.root == "paper" and root_module != 0):
        return f"angles cannot be counted from module {root_module}"
    if chunk.outcome != "closed":
        return "it is not closed"
    if max(chunk.corners, default=-1) >= len(proof_task(task, problem).load_cases) - len(task.load_cases):
        return f"there is no corner {max(chunk.corners)}"
    return None


def _words(lower: Array, upper: Array) -> str:
    names = ("psi", "alpha_0", "alpha_1", *(f"hinge {i}" for i in range(1, len(lower) - 2)))
    ranges = zip(names, np.degrees(lower), np.degrees(upper), strict=True)
    return ", ".join(f"{name} {low:.4g} to {high:.4g} deg" for name, low, high in ranges if math.isfinite(low))

"""The check of one chunk of a proof."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from topo_search.compiled_code import is_cached, refresh
from topo_search.model import Array, CheckedChunk, Chunk, ResolvedTask, Topology, proven
from topo_search.model.proof import CHUNK_SPLITS, Problem, chunk_count, most_effort, proof_task
from topo_search.model.topology import straight_chain
from verify.proof import platform, replay

refresh(replay.replay, Path(__file__).parent, Path(proven.__file__))

MAX_MODULES = 12
"""Largest number of modules for which the allowances for rounding hold (`verify.proof.dual`)."""
REASONS = {
    replay.TOO_SHORT: "the record ends before it",
    replay.TOO_LONG: "the record continues after the last box",
    replay.INVALID_ANGLE: "the record halves an unknown angle, or one without width",
    replay.TOO_DEEP: "the record halves it more often than a number can be",
    replay.NOT_BOUNDED: "no bound excludes it",
    replay.NOT_CROWDED: "no two modules are too close everywhere in it",
}
"""Fault of a box for each outcome of a replay."""


def check_chunk(
    task: ResolvedTask, topology: Topology, root_module: int, cut: float, chunk: Chunk, problem: Problem = "task"
) -> CheckedChunk:
    """Check that no design of one chunk of a tree's angles costs less than a cut.

    Args:
        task: task.
        topology: tree.
        root_module: module at which the proof roots the tree.
        cut: effort [rad^4/s^4]; from `most_effort` on, that there is no design.
        chunk: chunk with its number and record; nothing else of the proof is used.
        problem: designs that the proof covers.
    """
    n = topology.n
    if fault := _invalid_input(task, n, root_module, chunk, problem):
        return CheckedChunk(number=chunk.number, fault=fault)
    try:
        record = np.frombuffer(chunk.record, np.uint8)
    except ValueError as error:
        return CheckedChunk(number=chunk.number, fault=str(error))
    lower, upper = chunk_box(task, n, chunk.number)
    weighted = cut < most_effort(task)
    if not weighted and platform.turns_about_vertical(task, problem):
        lower[0], upper[0] = 0.0, 0.0
    if np.any(lower > upper) and not len(record):  # no combination of the set's hinge angles is in the chunk
        return CheckedChunk(number=chunk.number, fault=None)
    tree = platform.reroot(topology, root_module)
    problem_arrays = platform.to_arrays(task, tree, problem, chunk.corners, weighted=weighted)
    # 1e-12: a bound in these units differs from one in SI by a few roundings
    replayed = replay.replay(problem_arrays, lower, upper, cut / platform.effort_unit(task) * (1 + 1e-12), record)
    fault = None
    if replayed.outcome != replay.VALID:
        where = _box_text(replayed.lower, replayed.upper)
        fault = f"box {replayed.position + 1} of {len(record)}: {REASONS[replayed.outcome]} ({where})"
    return CheckedChunk(number=chunk.number, fault=fault, boxes=len(record), halved=replayed.halved)


def prepare_check(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile the check of a chunk unless its cache is up to date; `tell` gets a message if that takes long."""
    if not is_cached(replay.replay):
        tell("compiling the checker of proofs (once per installation, about two minutes)")
    check_chunk(task, straight_chain(task.n), 0, 0.0, Chunk.of(0, "closed", b"", ()))


def chunk_box(task: ResolvedTask, n: int, number: int) -> tuple[Array, Array]:
    """Return the least and greatest angles of a chunk, shape (n + 2,) [rad]; all chunks together cover all angles.

    A chunk without any angle of the task's set has least angles above the greatest.
    """
    (lower, upper), angles = platform.whole_box(task, n), platform.hinge_angles(task)
    for split in range(CHUNK_SPLITS if n > 1 else 0):
        axis = 3 + split % (n - 1)
        lower_end, upper_begin = platform.angles_around(angles, (lower[axis] + upper[axis]) / 2)
        if number >> (CHUNK_SPLITS - 1 - split) & 1 == 0:
            upper[axis] = lower_end
        else:
            lower[axis] = upper_begin
    return lower, upper


def _invalid_input(task: ResolvedTask, n: int, root_module: int, chunk: Chunk, problem: Problem) -> str | None:
    """Return why a chunk cannot be checked, or None."""
    if not 1 <= n <= MAX_MODULES:
        return f"a check takes 1 to {MAX_MODULES} modules, but the tree has {n}"
    if task.n != n:
        return f"the task has {task.n} modules, but the tree {n}"
    if chunk.number >= chunk_count(n):
        return f"there is no chunk {chunk.number}"
    if root_module >= n or (task.search.root_ranges and root_module != 0):
        return f"angles cannot be counted from module {root_module}"
    if chunk.outcome != "closed":
        return "it is not closed"
    disc = task.search.maximize == "force_reserve" and task.flight.directions == "horizontal"
    for x, y, z in task.search.towards:
        if math.hypot(x, y, z) > 1 + 1e-12 or (disc and z != 0.0):
            return "a reserve is asked for beyond its ball or disc"
    if max(chunk.corners, default=-1) >= len(proof_task(task, problem).load_cases) - len(task.load_cases):
        return f"there is no corner {max(chunk.corners)}"
    return None


def _box_text(lower: Array, upper: Array) -> str:
    names = ("psi", "alpha_0", "alpha_1", *(f"hinge {i}" for i in range(1, len(lower) - 2)))
    ranges = zip(names, np.degrees(lower), np.degrees(upper), strict=True)
    return ", ".join(f"{name} {low:.4g} to {high:.4g} deg" for name, low, high in ranges if math.isfinite(low))

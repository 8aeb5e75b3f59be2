"""Proof of one tree by branch and bound: every chunk of its angles, and how each was divided.

A record has a byte a box, depth first, the lower half before the upper one: 0, excluded by a bound; 1, two
modules are too close everywhere in it; 2 + a, halved along angle a. Angles are psi, alpha_0, alpha_1 and the
hinges of the tree as it hangs from `root_module`: breadth first, ports in order.
"""

from __future__ import annotations

import base64
import zlib
from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.corners import CorneredTask, to_corners
from topo_search.model.load_case import Wrench
from topo_search.model.task import ResolvedTask
from topo_search.model.topology import Topology
from topo_search.model.value import OMIT_EMPTY, Index, Number, Value

CHUNK_SPLITS = 6
"""All hinges are halved in turn, so many times in all; chunk c is what the bits of c choose, the highest first."""

Text = Annotated[str, Field(strict=True)]
Ended = Literal["closed", "many", "stuck"]
Aim = Literal["excluded", "within"]
Problem = Literal["task", "solver"]
"""Designs that a proof is about: `task`, all that an audit may call clear; `solver`, those that meet the solver's
requirements besides: where envelopes or centres need a distance R, d^2 >= R^2 + 2 R margin (`search.margin`), and
of centres R is `centre_distance` in place of `body_clearance`; and of reserves all corners around the balls. What
holds of the first holds of the second."""


def proof_task(task: ResolvedTask, problem: Problem) -> ResolvedTask:
    """Return the task that a proof bounds: with sets of wrenches and reserves written out as corners.

    Of the balls of reserves `solver` has the corners around them, `task` points of the balls themselves.
    Angular accelerations and the torque required with a rotor dead are left out, and where `search.peak_input`
    is less than 1 all reserves and failures.
    """
    alone = task.with_fields("flight", rotor_out_torque=None)
    cornered = to_corners(alone, inner=problem == "task" or task.search.peak_input < 1)
    if not isinstance(cornered, CorneredTask):
        return task
    known = dict[tuple[int | None, Wrench, Wrench], int]()
    for c, (_, case, dead, acceleration) in enumerate(cornered.corners):
        if not any(acceleration):
            known.setdefault((dead, case.at_end_effector, case.at_com), c)  # hover may be a load case, too
    return cornered.with_corners(known.values())


def chunk_count(n: int) -> int:
    """Return how many chunks a tree of n modules has; one without a hinge has one."""
    return 1 if n == 1 else 2**CHUNK_SPLITS


class Chunk(Value):
    """Result of one chunk of a tree's angles."""

    number: Index
    outcome: Ended
    """`closed`: all of it is excluded; `many`: too many boxes; `stuck`: the smallest of boxes is not excluded."""
    boxes: Index
    packed: Text
    """The record, compressed by zlib, in Base64; empty unless the chunk is closed."""
    stuck: tuple[tuple[Number, ...], tuple[Number, ...]] | None = None
    """The box that the search stopped at, from and to [rad]."""
    corners: Annotated[tuple[Index, ...], OMIT_EMPTY] = ()
    """Wrenches without weight that its boxes are bounded with, by their numbers in `proof_task`: for a check a hint
    that saves time, for any of them will do."""

    @classmethod
    def of(
        cls,
        number: int,
        outcome: Ended,
        record: bytes,
        stuck: tuple[tuple[float, ...], ...] = (),
        corners: tuple[int, ...] = (),
    ) -> Chunk:
        """Return a chunk with its record packed; of one that is not closed the record proves nothing."""
        packed = base64.b64encode(zlib.compress(record, 9)).decode() if outcome == "closed" else ""
        box = None if not stuck else (stuck[0], stuck[1])
        return cls(number=number, outcome=outcome, boxes=len(record), packed=packed, stuck=box, corners=corners)

    @property
    def record(self) -> bytes:
        """The record; ValueError if it is none."""
        most_bytes = 1 << 28  # this program writes no longer record
        try:
            unpacking = zlib.decompressobj()
            record = unpacking.decompress(base64.b64decode(self.packed, validate=True), most_bytes)
        except (zlib.error, ValueError):
            raise ValueError(f"the record of chunk {self.number} cannot be unpacked") from None
        if not unpacking.eof:
            raise ValueError(f"the record of chunk {self.number} is longer than {most_bytes:,} boxes, or cut off")
        return record


class CheckedChunk(Value):
    """Result of checking one chunk."""

    number: Index
    fault: Text | None
    """Why it is refused; None: it holds."""
    boxes: Index = 0
    """Number of boxes in the record."""
    halved: Index = 0
    """Boxes that the check cut smaller than the record does, to settle them."""


class Proof(Value):
    """Proof about one tree: no design of it costs less than `cut`, once every chunk is closed."""

    format: Literal["topo-search/proof"] = "topo-search/proof"
    version: Literal[1] = 1
    task: ResolvedTask
    topology_key: Text
    root_module: Index
    """The module of the key's tree that the angles of the boxes are counted from."""
    aim: Aim
    """`excluded`: the cut is the effort of the run's best; `within`: it is `gap` under the tree's own best, or
    under the run's where no more can be proven."""
    gap: Number
    problem: Problem = "task"
    """Designs that the proof is about."""
    cut: Number
    """Effort [rad^4/s^4]."""
    chunks: tuple[Chunk, ...] = ()

    @property
    def topology(self) -> Topology:
        """The tree that the key names; ValueError if it names none."""
        return Topology.from_key(self.topology_key)

    @property
    def boxes(self) -> int:
        """Number of boxes looked at."""
        return sum(chunk.boxes for chunk in self.chunks)

    @property
    def complete(self) -> bool:
        """True if every chunk is closed."""
        closed = {chunk.number for chunk in self.chunks if chunk.outcome == "closed"}
        return closed == set(range(chunk_count(self.task.n)))

    @property
    def open_at(self) -> Chunk | None:
        """The first chunk that cannot be closed."""
        return next((chunk for chunk in self.chunks if chunk.outcome != "closed"), None)

    @property
    def without_chunks(self) -> Proof:
        """The same with nothing searched."""
        return self.model_copy(update={"chunks": ()})

    def due_chunks(self) -> list[int]:
        """Return the chunks that were not looked at."""
        done = {chunk.number for chunk in self.chunks}
        return [number for number in range(chunk_count(self.task.n)) if number not in done]

    def with_chunk(self, chunk: Chunk) -> Proof:
        """Return the proof with one more chunk, in order."""
        chunks = sorted((*self.chunks, chunk), key=lambda each: each.number)
        return self.model_copy(update={"chunks": tuple(chunks)})

"""Proof for one tree by branch and bound: all chunks of its angles, and how each was divided into boxes.

A record has one byte per box, depth first, lower half before upper half: 0: excluded by a bound; 1: two modules are
too close everywhere in the box; 2 + a: halved along angle a. Angles are psi, alpha_0, alpha_1 and the hinges of the
tree rooted at `root_module`: breadth first, ports in order.

A proof at the cut `most_effort` shows that there is no design at all. If what it bounds is symmetric about the
vertical, its boxes have psi = 0.
"""

from __future__ import annotations

import base64
import zlib
from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.corners import CorneredTask, to_corners
from topo_search.model.end_effector import CountedRod
from topo_search.model.kinds import OMIT_EMPTY, Index, Number
from topo_search.model.load_case import LoadCase, Wrench
from topo_search.model.proven import TOLERANCE
from topo_search.model.task import ResolvedTask
from topo_search.model.topology import Topology
from topo_search.model.value import Value

CHUNK_SPLITS = 6
"""Number of halvings, of all hinges in turn, that give the chunks; the bits of c select chunk c, highest first."""

Text = Annotated[str, Field(strict=True)]
Outcome = Literal["closed", "many", "stuck"]
Aim = Literal["excluded", "within"]
Problem = Literal["task", "solver"]
"""Designs that a proof covers: `task`: all that an audit may call clear; `solver`: those that also meet the
solver's stricter requirements. There envelopes or centres at a required distance R keep d^2 >= R^2 + 2 R margin
(`search.margin`), R for centres is `centre_distance` instead of `body_clearance`, and reserves include all corners
around the balls. A proof for the first holds for the second."""


def proof_task(task: ResolvedTask, problem: Problem) -> ResolvedTask:
    """Return the task that a proof bounds, with sets of wrenches and reserves expanded to corners.

    For balls of reserves, `solver` has the corners around them and `task` points of the balls themselves. Angular
    accelerations and the torque required with a dead rotor are dropped, and all reserves and failures if
    `search.peak_input` is less than 1. If the rod has mass, the task is that of the lightest platform, without
    corners that the heaviest one lacks.
    """
    light, heaviest_cases = _expand(task.lightest, problem), cases_with_heaviest_rod(task, problem)
    if not isinstance(light, CorneredTask):
        return light
    first_numbers = dict[tuple[int | None, Wrench, Wrench], int]()
    for c, (label, case, dead, acceleration) in enumerate(light.corners):
        if not any(acceleration) and label in heaviest_cases:
            first_numbers.setdefault((dead, case.at_end_effector, case.at_com), c)  # hover may also be a load case
    return light.with_corners(first_numbers.values())


def cases_with_heaviest_rod(task: ResolvedTask, problem: Problem) -> dict[str, LoadCase]:
    """Return load cases and corners by label, for a platform with the heaviest rod of a clear design.

    With a rod of a share s of that mass, s times such a wrench plus 1 - s times the one without a rod is required
    too, or lies among required ones.
    """
    mass = task.lightest.heaviest_rod
    rod = CountedRod(module=0, port=0, mass=mass) if mass else None
    heaviest = _expand(task.with_rod(rod), problem)
    return dict(zip(heaviest.case_labels, heaviest.load_cases, strict=True))


def _expand(task: ResolvedTask, problem: Problem) -> ResolvedTask:
    bare_task = task.with_fields("flight", rotor_out_torque=None)
    cornered = to_corners(bare_task, inner=problem == "task" or task.search.peak_input < 1)
    return cornered if isinstance(cornered, CorneredTask) else task


def most_effort(task: ResolvedTask) -> float:
    """Return an effort above that of any inputs in a clear audit [rad^4/s^4].

    A proof at this cut excludes all designs: no inputs produce all wrenches, whatever the weights of load cases.
    """
    weight = sum(case.weight for case in task.load_cases)
    return task.rotor_count * weight * (task.max_input * (1 + 3 * TOLERANCE)) ** 2


def chunk_count(n: int) -> int:
    """Return the number of chunks of a tree of n modules; a single module has one."""
    return 1 if n == 1 else 2**CHUNK_SPLITS


class Chunk(Value):
    """Result for one chunk of a tree's angles."""

    number: Index
    outcome: Outcome
    """`closed`: all boxes are excluded; `many`: too many boxes; `stuck`: a box of minimum size is not excluded."""
    boxes: Index
    """Number of boxes in the record."""
    packed: Text
    """Record, compressed by zlib, in Base64; empty unless the chunk is closed."""
    stuck: tuple[tuple[Number, ...], tuple[Number, ...]] | None = None
    """Box at which the search stopped: lower and upper corner [rad]."""
    corners: Annotated[tuple[Index, ...], OMIT_EMPTY] = ()
    """Numbers in `proof_task` of the corners used for the bounds: a hint that saves time in a check, which is valid
    with any corners."""

    @classmethod
    def of(
        cls,
        number: int,
        outcome: Outcome,
        record: bytes,
        stuck: tuple[tuple[float, ...], ...] = (),
        corners: tuple[int, ...] = (),
    ) -> Chunk:
        """Return a chunk with its record packed; the record is dropped unless the chunk is closed."""
        packed = base64.b64encode(zlib.compress(record, 9)).decode() if outcome == "closed" else ""
        box = None if not stuck else (stuck[0], stuck[1])
        return cls(number=number, outcome=outcome, boxes=len(record), packed=packed, stuck=box, corners=corners)

    @property
    def record(self) -> bytes:
        """Record of the chunk; ValueError if it is invalid."""
        most_bytes = 1 << 28  # longer than any record that this program writes
        try:
            unpacking = zlib.decompressobj()
            record = unpacking.decompress(base64.b64decode(self.packed, validate=True), most_bytes)
        except (zlib.error, ValueError):
            raise ValueError(f"the record of chunk {self.number} cannot be unpacked") from None
        if not unpacking.eof:
            raise ValueError(f"the record of chunk {self.number} is longer than {most_bytes:,} boxes, or cut off")
        return record


class CheckedChunk(Value):
    """Result of checking a chunk."""

    number: Index
    fault: Text | None
    """Reason for rejection; None if the chunk is valid."""
    boxes: Index = 0
    """Number of boxes in the record."""
    halved: Index = 0
    """Number of boxes that the check had to halve further than the record."""


class Proof(Value):
    """Proof for one tree: no design needs less effort than `cut`, once every chunk is closed.

    If a quantity is maximised, its task is T(s), its cut `most_effort`, and no design holds the value s.
    """

    format: Literal["topo-search/proof"] = "topo-search/proof"
    version: Literal[1] = 1
    task: ResolvedTask
    topology_key: Text
    root_module: Index
    """Module of the key's tree that is the root for the angles of the boxes."""
    aim: Aim
    """`excluded`: the cut is the effort of the run's best design; `within`: it is `gap` below that of the tree's
    best design, or of the run's if no more can be proven."""
    gap: Number
    """Gap to be proven."""
    problem: Problem = "task"
    """Designs that the proof covers."""
    cut: Number
    """Effort below which designs are excluded [rad^4/s^4]."""
    chunks: tuple[Chunk, ...] = ()

    @property
    def topology(self) -> Topology:
        """Tree of the key; ValueError for an invalid key."""
        return Topology.from_key(self.topology_key)

    @property
    def bound(self) -> float:
        """Effort that every design needs [rad^4/s^4], or value of the maximised quantity that none holds."""
        value = self.task.search.reached
        return self.cut if value is None else value

    @property
    def level(self) -> float:
        """The greater, the more is proven: `cut`, or the negative of a value that no design holds."""
        return self.cut if self.task.search.reached is None else -self.bound

    @property
    def boxes(self) -> int:
        """Number of boxes in all chunks."""
        return sum(chunk.boxes for chunk in self.chunks)

    @property
    def complete(self) -> bool:
        """True if every chunk is closed."""
        closed = {chunk.number for chunk in self.chunks if chunk.outcome == "closed"}
        return closed == set(range(chunk_count(self.task.n)))

    @property
    def open_at(self) -> Chunk | None:
        """First chunk that cannot be closed."""
        return next((chunk for chunk in self.chunks if chunk.outcome != "closed"), None)

    @property
    def without_chunks(self) -> Proof:
        """Proof without chunks."""
        return self.model_copy(update={"chunks": ()})

    def due_chunks(self) -> list[int]:
        """Return the numbers of the chunks without a result."""
        finished = {chunk.number for chunk in self.chunks}
        return [number for number in range(chunk_count(self.task.n)) if number not in finished]

    def with_chunk(self, chunk: Chunk) -> Proof:
        """Return the proof with a chunk inserted in order."""
        chunks = sorted((*self.chunks, chunk), key=lambda chunk: chunk.number)
        return self.model_copy(update={"chunks": tuple(chunks)})

"""What a run goes through, with the processor time that each step is expected to take.

The expectations are rough: they say how long a run is about to take, and how the parts of it compare. `time_left`
corrects them by what the steps really take.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from topo_search.model import ResolvedTask

PhaseName = Literal["proving", "searching", "polishing", "auditing", "relaxing", "writing"]

WAKING = 2.5
"""Time until the first worker has loaded what it computes with [s]."""
REDUCED_UP_TO = 20
"""Modules up to which a start is a few cheap descents, and Ipopt takes up the best ends of all."""
REDUCED_SECONDS = 0.08, 0.012
"""Processor time of a candidate of twelve modules at most, and of each of its starts, with three load cases [s]."""
START_SECONDS = 0.135
"""Processor time of one start of twelve modules and three load cases [s]."""
AUDIT_SECONDS = 0.6
"""Processor time of the audit of five modules [s]."""
PROVING_SECONDS = 0.5
"""Time for the lower bound of a size, and whether it is proven impossible [s]."""
CHUNK_SECONDS = 0.4
"""Processor time of a chunk of a proof by branch and bound, three and five modules [s]."""
WRITING_SECONDS = 1.5
"""Time for all files and the page [s]."""


@dataclass(frozen=True)
class Phase:
    """A part of a run, made of steps of about the same length."""

    name: PhaseName
    n: int
    """Modules."""
    steps: int
    """How many candidates, or designs."""
    starts: int = 0
    """Of each candidate when the phase is over; 0 where nothing is solved."""
    seconds: float = 0.0
    """Expected processor time of a step [s]."""
    alone: bool = False
    """Whether the steps follow each other in one process."""

    @property
    def same(self) -> tuple[PhaseName, int, int]:
        """What a phase that is planned, and the one that comes, have in common."""
        return self.name, self.n, self.starts


@dataclass(frozen=True)
class Plan:
    """What a run is going to do."""

    phases: tuple[Phase, ...]
    workers: int | None
    """How many steps are taken at a time; None where that is not known."""
    time_limit: float = math.inf
    """Of all that is solved [s]; audits come after it."""

    @property
    def solves(self) -> bool:
        """Whether any candidate is solved."""
        return any(phase.starts for phase in self.phases)

    @property
    def seconds(self) -> float:
        """About how long it takes [s]."""
        waking = WAKING if any(not phase.alone for phase in self.phases) else 0.0
        solving, other = (
            sum(duration(phase, self.workers or 1) for phase in self.phases if bool(phase.starts) is solves)
            for solves in (True, False)
        )
        return min(self.time_limit, waking + solving) + other


def duration(phase: Phase, workers: int) -> float:
    """Return how long a phase is expected to take [s]."""
    return phase.seconds * phase.steps / (1 if phase.alone else max(1, min(workers, phase.steps)))


def solving_seconds(task: ResolvedTask, starts: int) -> float:
    """Return the expected processor time of one candidate from so many starts [s]."""
    cases = (1 + len(task.load_cases)) / 4
    if task.n <= REDUCED_UP_TO:
        candidate, start = REDUCED_SECONDS
        return cases * max(1.0, task.n / 12) * (candidate + starts * start)
    growth: float = (task.n / 12) ** 2
    return cases * starts * START_SECONDS * growth


def audit_phase(n: int, designs: int) -> Phase:
    """Return the phase that audits designs of n modules."""
    return Phase("auditing", n, designs, seconds=AUDIT_SECONDS * (n / 5) ** 1.5)


def proof_phase(n: int) -> Phase:
    """Return the phase that bounds the effort of a size, or proves it impossible."""
    return Phase("proving", n, 1, seconds=PROVING_SECONDS, alone=True)


WRITING = Phase("writing", 0, 1, seconds=WRITING_SECONDS, alone=True)
"""The phase that writes all files, and the page."""

"""What every way of searching is: a generator that proposes rounds of candidates and is sent their results.

A strategy knows no workers and no files. It is deterministic, and learns from whole rounds alone: started again
with the results that it had, it makes the same proposals. So a run that was killed is replayed from its ledger, and
neither the number of workers nor their speed changes what is proposed.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Protocol

from topo_search.topologies import Candidate


@dataclass(frozen=True)
class Proposal:
    """A candidate that is to have been solved from its first starts."""

    candidate: Candidate
    starts: int
    """Number of starts in all; those that were tried in earlier rounds are not tried again."""
    near: tuple[str, ...] = ()
    """Keys of candidates of earlier rounds, whose designs are carried over in place of as many of the next starts.

    None of them is in this round: how far it had come would depend on which job ends first.
    """


@dataclass(frozen=True)
class Scored:
    """What became of a candidate after so many starts."""

    key: str
    starts: int
    """Number of starts that need no more solving: tried, replaced by designs carried over, or given up."""
    status: str
    """feasible, infeasible, impossible or failed."""
    objective: float | None
    """J of the best design [rad^4/s^4]."""
    violation: float | None
    """How far the closest start was from feasible, in the task's own units; None where there is a design."""


class Round(Protocol):
    """The proposals of one round, drawn one by one; a list is one. No candidate comes twice."""

    def __iter__(self) -> Iterator[Proposal]:
        """Yield the proposals."""
        ...

    def __len__(self) -> int:
        """Return their number."""
        ...


class Stage(list[Proposal]):
    """A round that goes over earlier candidates once more, all from as many starts; whoever watches is told."""


Strategy = Generator[Round, list[Scored], None]
"""Yields rounds; is sent what became of each round's proposals, in their order."""

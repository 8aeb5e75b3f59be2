"""What every way of searching is: a generator that proposes candidates and asks what became of them.

A strategy knows no workers and no files. It is deterministic, and learns results in the order of its proposals,
whichever job ended first: started again with the results that it had, it makes the same proposals. So a run that
was killed is replayed from its ledger, and neither the number of workers nor their speed changes what is proposed.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from topo_search.topologies import Candidate


@dataclass(frozen=True)
class Proposal:
    """A candidate that is to have been solved from its first starts."""

    candidate: Candidate
    starts: int
    """Number of starts in all; those that were tried before are not tried again."""
    near: tuple[str, ...] = ()
    """Keys of candidates whose designs are carried over in place of as many of the next starts.

    The result of each was asked for, and none of them is proposed again before that of this one is: how far it had
    come would depend on which job ends first.
    """


@dataclass(frozen=True)
class Stage:
    """So many candidates are proposed next; whoever watches is told."""

    candidates: int
    starts: int
    """Of each, at most."""
    again: bool = False
    """Whether they were proposed before, from fewer starts."""


@dataclass(frozen=True)
class Results:
    """What became of the next proposals is asked for; nothing is proposed before it is known."""

    number: int
    """Of the proposals, the earliest of those whose result was not asked for yet."""


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


Step = Proposal | Stage | Results
"""What a strategy yields."""
Strategy = Generator[Step, list[Scored], None]
"""Is sent the results that it asks for, in the order of their proposals, and nothing else."""

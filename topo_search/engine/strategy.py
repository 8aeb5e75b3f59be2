"""The border between a search strategy and the solver that it asks for the results of candidates.

A strategy is a function that submits proposals to a `CandidateSolver` and collects their results. It knows neither
workers nor files. It is deterministic, and collects results in the order of its proposals, whichever job ended
first: with the same results it makes the same proposals. So a run that was killed repeats its proposals from the
ledger, and neither the number of workers nor their speed changes what is proposed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from topo_search.topologies import Candidate


@dataclass(frozen=True)
class Proposal:
    """A candidate that is to have been solved from its first starts."""

    candidate: Candidate
    starts: int
    """Number of starts in all; those that were tried before are not tried again."""
    near: tuple[str, ...] = ()
    """Keys of candidates whose designs are carried over in place of as many of the next starts.

    The result of each has been collected, and none of them is proposed again before that of this one is: how far it
    had come would depend on which job ends first.
    """


@dataclass(frozen=True)
class Scored:
    """The result of a candidate after a number of starts."""

    key: str
    starts: int
    """Number of starts that need no more solving: tried, replaced by designs carried over, or given up."""
    status: str
    """feasible, infeasible, impossible or failed."""
    objective: float | None
    """J of the best design [rad^4/s^4]."""
    violation: float | None
    """How far the closest start was from feasible, in the task's own units; None where there is a design."""


class TimeUp(Exception):
    """The time limit is reached before a result."""


class CandidateSolver(Protocol):
    """Solves proposals, and returns their results in the order of submission."""

    def begin_stage(self, candidates: int, starts: int, *, again: bool = False) -> None:
        """Announce how many candidates come next, and from how many starts at most.

        Args:
            candidates: how many.
            starts: of each, at most.
            again: whether they were proposed before, from fewer starts.
        """
        ...

    def submit(self, proposal: Proposal) -> None:
        """Solve a proposal. Returns at once unless many wait for a worker.

        Raises:
            TimeUp: the time limit is reached.
        """
        ...

    def results(self, number: int) -> list[Scored]:
        """Wait for the results of the earliest proposals that were not collected, and return them in order.

        Raises:
            TimeUp: the time limit is reached.
        """
        ...

"""Search strategies: the border between them and the solver, and the exhaustive one.

A strategy is a function that submits proposals to a `CandidateSolver` and collects their results. It knows neither
workers nor files. It is deterministic, and collects results in the order of its proposals, whichever job ended
first: with the same results it makes the same proposals. So a run that was killed repeats its proposals from the
ledger, and neither the number of workers nor their speed changes what is proposed.

An exhaustive search gives all candidates the same number of starts: after a few starts a tree's best effort says
little about what more of them will find, and giving more to those that are ahead finds the best ones less surely
than giving as much to all (`tests/benchmarks/budget.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from topo_search.engine.jobs import rounds
from topo_search.engine.space import Space
from topo_search.model.proven import SOLVER_PRECISION
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


PRUNED_AFTER = 32
"""Number of candidates proposed ahead of the results that may rule them out."""

Bound = Callable[[Candidate], float]
"""Lower bound on the objective of a candidate."""


def exhaustive_search(
    solver: CandidateSolver, space: Space, *, starts: int, timed: bool, bound: Bound | None = None
) -> None:
    """Solve every candidate.

    Args:
        solver: solves the proposals.
        space: the candidates.
        starts: number of starts of each candidate.
        timed: whether there is a time limit: then all are solved from one start first, then from more.
        bound: with it candidates come in the order of their bounds, and one that can be no better than the best
            design so far is not proposed, nor from more starts.
    """
    first, *later = (part.stop for part in rounds(starts, starts, timed=timed))
    solver.begin_stage(space.count(), first)
    if bound is None:
        candidates = []
        for candidate in space.candidates():  # there may be millions: enumerated as they are solved
            candidates.append(candidate)
            solver.submit(Proposal(candidate, first))
        scores = solver.results(len(candidates))
    else:
        candidates, scores = _solve_in_order_of_bounds(solver, space, first, bound)
    least = _least(scores)
    for stop in later:
        candidates = [
            candidate
            for candidate, score in zip(candidates, scores, strict=True)
            if score.status in ("feasible", "infeasible") and (bound is None or may_beat(least, bound(candidate)))
        ]
        if candidates:
            solver.begin_stage(len(candidates), stop, again=True)
        for candidate in candidates:
            solver.submit(Proposal(candidate, stop))
        scores = solver.results(len(candidates))
        least = min(least, _least(scores))


def may_beat(objective: float, bound: float) -> bool:
    """Whether an objective that cannot go below a bound can be less than another by more than rounding."""
    return bound < objective * (1.0 - SOLVER_PRECISION)


def _solve_in_order_of_bounds(
    solver: CandidateSolver, space: Space, starts: int, bound: Bound
) -> tuple[list[Candidate], list[Scored]]:
    """Solve candidates in the order of their bounds, as long as they may beat the best."""
    candidates: list[Candidate] = []
    scores: list[Scored] = []
    least = math.inf
    for candidate in sorted(space.candidates(), key=lambda candidate: (bound(candidate), candidate.key)):
        if len(candidates) - len(scores) == PRUNED_AFTER:
            scores += solver.results(1)
            least = min(least, _least(scores[-1:]))
        if not may_beat(least, bound(candidate)):
            break
        candidates.append(candidate)
        solver.submit(Proposal(candidate, starts))
    scores += solver.results(len(candidates) - len(scores))
    return candidates, scores


def _least(scores: Iterable[Scored]) -> float:
    """Return the least objective."""
    return min((score.objective for score in scores if score.objective is not None), default=math.inf)

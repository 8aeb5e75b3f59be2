"""Starts that follow promise: many candidates from few starts, the best of them from more (successive halving)."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence

from topo_search.engine.strategy import Scored

FEW = 2
"""Starts of a new candidate, if its sampler does not say otherwise."""
SHARE = 4
"""Starts are doubled while a candidate is among the best 1/4, 1/16, ... of all, if its sampler promotes."""
CERTAIN = 5
"""So many of the best are given all starts in the end; all are if every candidate was proposed."""

NOT_PROMISING = 2
"""First number of the rank of candidates that are given no more starts."""

Rank = tuple[int, float]
"""Orders candidates: those with a design by objective, then those without by violation, then all others."""


def rank(score: Scored) -> Rank:
    """Return how a candidate stands."""
    if score.objective is not None:
        return 0, score.objective
    if score.status == "infeasible" and score.violation is not None:
        return 1, score.violation
    return NOT_PROMISING, 0.0


def steps(starts: int, few: int) -> Iterator[int]:
    """Yield the numbers of starts from few to all, each for fewer candidates than the one before."""
    step = few
    while step < starts:
        yield step
        step *= 2
    yield starts


def goes_on(score: Scored, others: Sequence[Rank], step: int) -> bool:
    """Whether a candidate is given more starts.

    Args:
        score: what became of it after the first `step` steps.
        others: how all candidates stand, itself among them, in ascending order.
        step: 1 after the first step.
    """
    own = rank(score)
    return own[0] < NOT_PROMISING and bisect_left(others, own) < len(others) // SHARE**step

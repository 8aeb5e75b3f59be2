"""Exhaustive search: every candidate of one size is solved from the same number of starts.

All get the same: after a few starts a tree's best effort says little of what more of them will find, and giving
more to those that are ahead finds the best ones less surely than giving as much to all
(`tests/benchmarks/budget.py`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Iterable

from topo_search.engine.space import Space
from topo_search.engine.starts import rounds
from topo_search.engine.strategy import Proposal, Results, Scored, Stage, Step, Strategy
from topo_search.model.proven import SOLVER_PRECISION
from topo_search.topologies import Candidate

PRUNED_AFTER = 32
"""Candidates that are proposed ahead of what is known to be ruled out."""

Bound = Callable[[Candidate], float]
"""What no objective of a candidate can go below."""


def exhaustive_search(space: Space, *, starts: int, timed: bool, bound: Bound | None = None) -> Strategy:
    """Propose every candidate.

    Args:
        space: the candidates.
        starts: number of starts of each candidate.
        timed: whether there is a time limit: then all are solved from one start first, then from more.
        bound: with it candidates come in the order of their bounds, and one that can be no better than the best
            design so far is not proposed, nor from more starts.
    """
    first, *later = (part.stop for part in rounds(starts, starts, timed=timed))
    yield Stage(space.count(), first)
    if bound is None:
        candidates = []
        for candidate in space.candidates():  # drawn as workers become free: there may be millions
            candidates.append(candidate)
            yield Proposal(candidate, first)
        scores = yield Results(len(candidates))
    else:
        candidates, scores = yield from _in_order_of_bounds(space, first, bound)
    least = _least(scores)
    for stop in later:
        candidates = [
            candidate
            for candidate, score in zip(candidates, scores, strict=True)
            if score.status in ("feasible", "infeasible") and (bound is None or may_beat(least, bound(candidate)))
        ]
        if candidates:
            yield Stage(len(candidates), stop, again=True)
        yield from (Proposal(candidate, stop) for candidate in candidates)
        scores = yield Results(len(candidates))
        least = min(least, _least(scores))


def may_beat(objective: float, bound: float) -> bool:
    """Whether an objective that cannot go below a bound can be less than another by more than rounding."""
    return bound < objective * (1.0 - SOLVER_PRECISION)


def _in_order_of_bounds(
    space: Space, starts: int, bound: Bound
) -> Generator[Step, list[Scored], tuple[list[Candidate], list[Scored]]]:
    """Propose candidates in the order of their bounds, as long as they may beat the best; return them all."""
    waiting = deque(sorted(space.candidates(), key=lambda candidate: (bound(candidate), candidate.key)))
    candidates: list[Candidate] = []
    scores: list[Scored] = []
    least = math.inf
    while waiting and may_beat(least, bound(waiting[0])):
        if len(candidates) - len(scores) < PRUNED_AFTER:
            candidates.append(waiting.popleft())
            yield Proposal(candidates[-1], starts)
        else:
            scores += yield Results(1)
            least = min(least, _least(scores[-1:]))
    scores += yield Results(len(candidates) - len(scores))
    return candidates, scores


def _least(scores: Iterable[Scored]) -> float:
    """Return the least objective."""
    return min((score.objective for score in scores if score.objective is not None), default=math.inf)

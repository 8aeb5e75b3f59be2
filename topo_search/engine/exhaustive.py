"""Exhaustive search: every candidate of one size is solved from the same number of starts.

All get the same: after a few starts a tree's best effort says little of what more of them will find, and giving
more to those that are ahead finds the best ones less surely than giving as much to all
(`tests/benchmarks/budget.py`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator

from topo_search.engine.space import Space
from topo_search.engine.starts import rounds
from topo_search.engine.strategy import Proposal, Round, Scored, Stage, Strategy
from topo_search.model.proven import SOLVER_PRECISION
from topo_search.topologies import Candidate

PRUNED_AFTER = 32
"""Candidates that are proposed before it is looked at what they rule out."""

Bound = Callable[[Candidate], float]
"""What no objective of a candidate can go below."""


class Everything:
    """The round of all candidates, drawn once, as workers become free, so that there may be millions."""

    def __init__(self, space: Space, starts: int) -> None:
        self.drawn: list[Candidate] = []
        self._space = space
        self._starts = starts

    def __iter__(self) -> Iterator[Proposal]:
        """Yield a proposal for every candidate."""
        for candidate in self._space.candidates():
            self.drawn.append(candidate)
            yield Proposal(candidate, self._starts)

    def __len__(self) -> int:
        """Return the number of candidates."""
        return self._space.count()


def exhaustive(space: Space, *, starts: int, timed: bool, bound: Bound | None = None) -> Strategy:
    """Propose every candidate.

    Args:
        space: the candidates.
        starts: number of starts of each candidate.
        timed: whether there is a time limit: then all are solved from one start first, then from more.
        bound: with it candidates come in the order of their bounds, and one that can be no better than the best
            design so far is not proposed, nor from more starts.
    """
    first, *later = (part.stop for part in rounds(starts, starts, timed=timed))
    if bound is None:
        everything = Everything(space, first)
        scores = yield everything
        candidates = everything.drawn
    else:
        candidates, scores = yield from _in_order_of_bounds(space, first, bound)
    least = _least(scores)
    for stop in later:
        candidates = [
            candidate
            for candidate, score in zip(candidates, scores, strict=True)
            if score.status in ("feasible", "infeasible") and (bound is None or may_beat(least, bound(candidate)))
        ]
        scores = yield Stage(Proposal(candidate, stop) for candidate in candidates)
        least = min(least, _least(scores))


def may_beat(objective: float, bound: float) -> bool:
    """Whether an objective that cannot go below a bound can be less than another by more than rounding."""
    return bound < objective * (1.0 - SOLVER_PRECISION)


def _in_order_of_bounds(
    space: Space, starts: int, bound: Bound
) -> Generator[Round, list[Scored], tuple[list[Candidate], list[Scored]]]:
    """Propose candidates in the order of their bounds, as long as they may beat the best; return them all."""
    waiting = deque(sorted(space.candidates(), key=lambda candidate: (bound(candidate), candidate.key)))
    candidates: list[Candidate] = []
    scores: list[Scored] = []
    least = math.inf
    while waiting and may_beat(least, bound(waiting[0])):
        block = [waiting.popleft() for _ in range(min(PRUNED_AFTER, len(waiting)))]
        found = yield [Proposal(candidate, starts) for candidate in block]
        candidates += block
        scores += found
        least = min(least, _least(found))
    return candidates, scores


def _least(scores: Iterable[Scored]) -> float:
    """Return the least objective."""
    return min((score.objective for score in scores if score.objective is not None), default=math.inf)

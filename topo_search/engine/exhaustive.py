"""Exhaustive search: every candidate of one size is solved from the same number of starts.

All get the same: after a few starts a tree's best effort says little about what more of them will find, and giving
more to those that are ahead finds the best ones less surely than giving as much to all
(`tests/benchmarks/budget.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from topo_search.engine.space import Space
from topo_search.engine.starts import rounds
from topo_search.engine.strategy import CandidateSolver, Proposal, Scored
from topo_search.model.proven import SOLVER_PRECISION
from topo_search.topologies import Candidate

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

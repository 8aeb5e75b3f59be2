"""What became of the candidates that were proposed, kept as it comes: a search of N trials asks for it N times."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import defaultdict
from typing import NamedTuple

from topo_search.engine.strategy import Scored

IMPOSSIBLE = 1.0e6
"""Violation of a candidate that is proven impossible, behind all for which no design was found."""


class Idea(NamedTuple):
    """What may be proposed."""

    key: str
    """Of the candidate."""
    warm_starts: tuple[str, ...] = ()
    """Keys of the candidates whose designs are carried over to it."""
    again: bool = False
    """Whether it was proposed before and is to have more starts."""


class Merit(NamedTuple):
    """What a trial led to, in its order: less is better, and the earlier one wins a tie."""

    violation: float
    """By how much a design was missed; 0 with one."""
    objective: float
    """Infinite without a design."""
    number: int
    """Of the trial."""
    key: str
    """Of its candidate."""
    status: str
    """What became of it."""

    @property
    def has_design(self) -> bool:
        """Whether the trial led to a design."""
        return math.isfinite(self.objective)


class Trials:
    """The trials of a search."""

    def __init__(self) -> None:
        self.proposed: set[str] = set()
        """Keys of all candidates that have a trial."""
        self.running: dict[int, Idea] = {}
        """Trials that are not over, by number."""
        self.lent: dict[str, set[str]] = defaultdict(set)
        """By key, whose designs were carried over to a candidate."""
        self.failed: set[str] = set()
        """Keys of candidates of which a trial failed: that says nothing of them."""
        self.completed = 0
        """How many trials said something."""
        self.starts: dict[str, int] = {}
        """Starts so far of each candidate of which a trial said something, by key."""
        self.ranking: list[Merit] = []
        """The best trial of each of these candidates, in the order of their merit."""
        self._best: dict[str, Merit] = {}

    def ask(self, number: int, idea: Idea) -> None:
        """Note that an idea is proposed in a trial."""
        self.proposed.add(idea.key)
        self.running[number] = idea
        self.lent[idea.key].update(idea.warm_starts)

    def tell(self, number: int, score: Scored) -> None:
        """Note what a trial led to."""
        del self.running[number]
        if score.status == "failed":
            self.failed.add(score.key)
            return
        self.completed += 1
        self.starts[score.key] = score.starts
        merit = Merit(violation(score), value(score), number, score.key, score.status)
        known = self._best.get(score.key)
        if known is None or merit < known:
            if known is not None:
                del self.ranking[bisect_left(self.ranking, known)]
            insort(self.ranking, merit)
            self._best[score.key] = merit


def value(score: Scored) -> float:
    """Return what a trial that did not fail is worth; less is better."""
    return math.inf if score.objective is None else score.objective


def violation(score: Scored) -> float:
    """Return by how much a design was missed: 0 with one."""
    if score.objective is not None:
        return 0.0
    return score.violation if score.status == "infeasible" and score.violation is not None else IMPOSSIBLE

"""Trees as rows of whole numbers of fixed length: every row is a tree, and every tree is a row.

| symbol | meaning | range |
|---|---|---|
| k | module, in the order of growth; module 0 is the root | 1..n-1 |
| free ports | those of the k modules so far, oldest first, each one's from its port of entry on | 2k + 2 |
| port k | which free port module k is joined to | 0..2k+1 |
| spin k | parity of kappa[k]; only with connectors of any port | 0, 1 |

Nothing has to be repaired, for there are 2k + 2 free ports whatever was chosen before. Many rows are one candidate.

Starts follow promise: many candidates have few starts, the best of them more (successive halving). What became of
the trials is kept in order as it comes, for a search of N trials asks for it N times.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from topo_search.engine.strategy import Scored
from topo_search.model import Topology
from topo_search.model.topology import ROOT, Joint
from topo_search.topologies import Connectors

FEW = 2
"""Starts of a new candidate, if its sampler does not say otherwise."""
SHARE = 4
"""Starts are doubled while a candidate is among the best 1/4, 1/16, ... of all, if its sampler promotes."""
CERTAIN = 5
"""So many of the best are given all starts in the end; all are if every candidate was proposed."""
IMPOSSIBLE = 1.0e6
"""Violation of a candidate that is proven impossible or failed, behind all for which no design was found."""
Rank = tuple[float, float]
"""Orders candidates by violation, 0 with a design, then by objective."""


def ranges(n: int, connectors: Connectors) -> dict[str, int]:
    """Return the names of the numbers that make a tree of n modules, and how many values each can have."""
    numbers = {_port(k): 2 * k + 2 for k in range(1, n)}
    if connectors == "any":
        numbers |= {_spin(k): 2 for k in range(1, n)}
    return numbers


def decode(numbers: Mapping[str, int], n: int) -> Topology:
    """Return the tree that a row of numbers makes."""
    joints: list[Joint] = [ROOT]
    free = [(0, port) for port in range(4)]
    for k in range(1, n):
        h, a = free.pop(numbers[_port(k)])
        b = (a + 2 - numbers.get(_spin(k), 0)) % 4
        joints.append((h, a, b))
        free.extend((k, (b + slot) % 4) for slot in (1, 2, 3))
    return Topology(tuple(joints))


def encode(topology: Topology, connectors: Connectors) -> dict[str, int]:
    """Return a row of numbers that makes a tree with the same key."""
    joints = Topology.from_key(topology.key).joints
    numbers: dict[str, int] = {}
    free = [(0, port) for port in range(4)]
    for k, (h, a, b) in enumerate(joints[1:], start=1):
        numbers[_port(k)] = free.index((h, a))
        if connectors == "any":
            numbers[_spin(k)] = (a + 2 - b) % 2
        free.remove((h, a))
        free.extend((k, (b + slot) % 4) for slot in (1, 2, 3))
    return numbers


def _port(k: int) -> str:
    return f"port {k}"


def _spin(k: int) -> str:
    return f"spin {k}"


def rank(score: Scored) -> Rank:
    """Return how a candidate stands."""
    return violation(score), value(score)


def steps(starts: int, few: int) -> Iterator[int]:
    """Yield the numbers of starts from few to all, each for fewer candidates than the one before."""
    step = few
    while step < starts:
        yield step
        step *= 2
    yield starts


def goes_on(score: Scored, others: Sequence[Rank], step: int) -> bool:
    """True if a candidate is given more starts.

    Args:
        score: what became of it after the first `step` steps.
        others: how all candidates stand, itself among them, in ascending order.
        step: 1 after the first step.
    """
    own = rank(score)
    return own[0] < IMPOSSIBLE and bisect_left(others, own) < len(others) // SHARE**step


class Idea(NamedTuple):
    """Possible proposal."""

    key: str
    """Key of the candidate."""
    warm_starts: tuple[str, ...] = ()
    """Keys of the candidates whose designs are carried over to it."""
    again: bool = False
    """True if it was proposed before and is to have more starts."""


class Merit(NamedTuple):
    """Result of a trial, in the order of merit: less is better, and the earlier one wins a tie."""

    violation: float
    """Violation of the best start; 0 with one."""
    objective: float
    """Infinite without a design."""
    number: int
    """Number of the trial."""
    key: str
    """Key of the trial's candidate."""
    status: str
    """Outcome of the trial."""

    @property
    def has_design(self) -> bool:
        """True if the trial led to a design."""
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
        """Number of trials that said something."""
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
        merit = Merit(*rank(score), number, score.key, score.status)
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

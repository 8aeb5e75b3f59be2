"""Trials of trees: their encoding, their outcomes, and the Optuna sampler that proposes whole trees.

Trees are rows of whole numbers of fixed length: every row is a tree, and every tree is a row.

| symbol | meaning | range |
|---|---|---|
| k | module, in the order of growth; module 0 is the root | 1..n-1 |
| free ports | those of the k modules so far, oldest first, each one's from its port of entry on | 2k + 2 |
| port k | which free port module k is joined to | 0..2k+1 |
| spin k | parity of kappa[k]; only with connectors of any port | 0, 1 |

Nothing has to be repaired, for there are 2k + 2 free ports whatever was chosen before. Many rows are one candidate.

Starts follow promise: many candidates have few starts, the best of them more (successive halving). What became of
the trials is kept in order as it comes, for a search of N trials asks for it N times.

Each sampler proposes a whole tree, one that was proposed before only for more starts. A sampler learns of the
trials through its arguments; the study keeps them for Optuna's own samplers and for the journal. A trial without a
design has a constraint above zero there, so that Optuna ranks it behind all others.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from bisect import bisect_left, insort
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from random import Random
from typing import Any, NamedTuple

from optuna import Study
from optuna.distributions import BaseDistribution, CategoricalDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial

from topo_search.engine.strategy import Candidates, Tried
from topo_search.model import Topology
from topo_search.model.topology import ROOT, Joint
from topo_search.topologies import Connectors


@dataclass(frozen=True)
class Halving:
    """Settings of successive halving."""

    few: int = 2
    """Starts of a new candidate, if its sampler does not say otherwise."""
    share: int = 4
    """Starts are doubled while a candidate is among the best 1/4, 1/16, ... of all, if its sampler promotes."""
    certain: int = 5
    """So many of the best are given all starts in the end; all are if every candidate was proposed."""
    draws: int = 64
    """Known trees drawn in a row after which one is drawn uniformly from all that are left."""
    fresh: int = 8
    """Uniform draws that a search, or a population after a restart, begins with."""


HALVING = Halving()
IMPOSSIBLE = 1.0e6
"""Violation of a candidate that is proven impossible or failed, behind all for which no design was found."""
Rank = tuple[float, float]
"""Orders candidates by violation, 0 with a design, then by objective."""


def ranges(n: int, connectors: Connectors) -> dict[str, int]:
    """Return the names of the numbers that make a tree of n modules, and how many values each can have."""
    spins = {f"spin {k}": 2 for k in range(1, n)} if connectors == "any" else {}
    return {f"port {k}": 2 * k + 2 for k in range(1, n)} | spins


def decode(numbers: Mapping[str, int], n: int) -> Topology:
    """Return the tree that a row of numbers makes."""
    joints: list[Joint] = [ROOT]
    free = [(0, port) for port in range(4)]
    for k in range(1, n):
        h, a = free.pop(numbers[f"port {k}"])
        b = (a + 2 - numbers.get(f"spin {k}", 0)) % 4
        joints.append((h, a, b))
        free.extend((k, (b + slot) % 4) for slot in (1, 2, 3))
    return Topology(tuple(joints))


def encode(topology: Topology, connectors: Connectors) -> dict[str, int]:
    """Return a row of numbers that makes a tree with the same key."""
    joints = Topology.from_key(topology.key).joints
    numbers: dict[str, int] = {}
    free = [(0, port) for port in range(4)]
    for k, (h, a, b) in enumerate(joints[1:], start=1):
        numbers[f"port {k}"] = free.index((h, a))
        if connectors == "any":
            numbers[f"spin {k}"] = (a + 2 - b) % 2
        free.remove((h, a))
        free.extend((k, (b + slot) % 4) for slot in (1, 2, 3))
    return numbers


def rank(score: Tried) -> Rank:
    """Return how a candidate stands."""
    return violation(score), value(score)


def steps(starts: int, few: int) -> Iterator[int]:
    """Yield the numbers of starts from few to all, each for fewer candidates than the one before."""
    step = few
    while step < starts:
        yield step
        step *= 2
    yield starts


def goes_on(score: Tried, others: Sequence[Rank], step: int) -> bool:
    """True if a candidate is given more starts.

    Args:
        score: its outcome after the first `step` steps.
        others: how all candidates stand, itself among them, in ascending order.
        step: 1 after the first step.
    """
    own_rank = rank(score)
    return own_rank[0] < IMPOSSIBLE and bisect_left(others, own_rank) < len(others) // HALVING.share**step


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


def value(score: Tried) -> float:
    """Return what a trial that did not fail is worth; less is better."""
    return math.inf if score.objective is None else score.objective


def violation(score: Tried) -> float:
    """Return by how much a design was missed: 0 with one."""
    if score.objective is not None:
        return 0.0
    return score.violation if score.status == "infeasible" and score.violation is not None else IMPOSSIBLE


class TreeSampler(BaseSampler):
    """Draws the numbers of a tree's encoding together, in the form that its candidate's key has."""

    few = HALVING.few
    """Starts of a new candidate."""
    promotes = True
    """True if candidates that do well are given more starts at once."""

    def __init__(self, space: Candidates, seed: int) -> None:
        self.space = space
        self.random = Random(seed)
        self.connectors = space.connectors
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
        self._merits: dict[str, Merit] = {}
        self.values = ranges(space.n, self.connectors)
        """Number of values that each number that makes a tree can have."""
        self.distributions: dict[str, BaseDistribution] = {
            name: CategoricalDistribution(range(values)) for name, values in self.values.items()
        }
        """The numbers that make a tree, as Optuna's `ask` takes them."""

    @abstractmethod
    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield candidates for a trial until there is no idea left; known ones are passed over, if not meant again.

        Args:
            study: what Optuna's own samplers take.
            trial: the one to propose for.
        """

    def note_idea(self, number: int, idea: Idea) -> None:
        """Take note of what is proposed in a trial."""
        self.proposed.add(idea.key)
        self.running[number] = idea
        self.lent[idea.key].update(idea.warm_starts)

    def note_score(self, number: int, score: Tried) -> None:
        """Take note of what a trial of this sampler led to."""
        del self.running[number]
        if score.status == "failed":
            self.failed.add(score.key)
            return
        self.completed += 1
        self.starts[score.key] = score.starts
        merit = Merit(*rank(score), number, score.key, score.status)
        known = self._merits.get(score.key)
        if known is None or merit < known:
            if known is not None:
                del self.ranking[bisect_left(self.ranking, known)]
            insort(self.ranking, merit)
            self._merits[score.key] = merit

    def uniform(self) -> Idea:
        """Return a candidate drawn uniformly from all."""
        (topology,) = self.space.sample(1, self.random.getrandbits(64))
        return Idea(topology.key)

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """Return the numbers that make a tree."""
        return self.distributions

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return the numbers of a tree that is drawn, and take note of it."""
        for idea in islice(self.ideas(study, trial), HALVING.draws):
            if idea.again or idea.key not in self.proposed:
                break
        else:
            idea = self._draw_unknown()
        self.note_idea(trial.number, idea)
        return dict(encode(Topology.from_key(idea.key), self.connectors))

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Refuse to draw a number of its own."""
        raise ValueError(f"only {', '.join(self.distributions)} can be drawn, but got {param_name!r}")

    def _draw_unknown(self) -> Idea:
        """Return a candidate drawn uniformly from those without a trial; they are listed if there are few."""
        for _ in range(HALVING.draws):
            idea = self.uniform()
            if idea.key not in self.proposed:
                return idea
        left = [other.key for other in self.space.candidates() if other.key not in self.proposed]
        return Idea(self.random.choice(left))

"""Trials of trees: their encoding, their results, and the base class of samplers that propose whole trees.

A tree is encoded as a row of integers of fixed length: every row is a tree, and every tree has a row.

| symbol | meaning | range |
|---|---|---|
| k | module, in the order of growth; module 0 is the root | 1..n-1 |
| free ports | those of the first k modules, oldest module first, each from its port of entry on | 2k + 2 |
| port k | index of the free port to which module k is joined | 0..2k+1 |
| spin k | parity of kappa[k]; only if any connectors may be joined | 0, 1 |
| type k | index of module k's type among the types of modules k..n-1, in order; only of several types | 0..n-1-k |

Rows need no repair: there are 2k + 2 free ports, and n - k types, whatever was chosen before. Many rows encode the
same candidate.

Starts are allotted by successive halving: many candidates get few starts, the best of them more. The ranking of the
trials is updated with every result, since a search of N trials reads it N times.

A sampler proposes whole trees, and repeats one only for more starts. It learns results through `note_score`; the
study keeps them for Optuna's own samplers and for the journal. There a trial without a design violates a
constraint, so that Optuna ranks it behind all others.
"""

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

    first_starts: int = 2
    """Default number of starts of a new candidate."""
    reduction: int = 4
    """Starts are doubled while a candidate is among the best 1/4, 1/16, ... of all, if its sampler promotes."""
    finalists: int = 5
    """Number of best candidates that get all starts in the end; all do if every candidate was proposed."""
    max_rejections: int = 64
    """Rejected draws in a row after which a new tree is drawn uniformly."""
    uniform_draws: int = 8
    """Number of uniform draws at the beginning of a search, or of a population."""


HALVING = Halving()
IMPOSSIBLE = 1.0e6
"""Violation of a candidate that is proven impossible or failed: larger than that of any infeasible one."""
Rank = tuple[float, float]
"""Sort key of candidates: violation, 0 with a design, then objective."""


def ranges(n: int, connectors: Connectors, counts: Sequence[int] = ()) -> dict[str, int]:
    """Return the names of the numbers that encode a tree of n modules, with the number of values of each.

    Args:
        n: number of modules.
        connectors: `aligned`, or `any`.
        counts: number of modules of each type; none without types.
    """
    spins = {f"spin {k}": 2 for k in range(1, n)} if connectors == "any" else {}
    types = {f"type {k}": n - k for k in range(n - 1)} if len(counts) > 1 else {}
    return {f"port {k}": 2 * k + 2 for k in range(1, n)} | spins | types


def decode(numbers: Mapping[str, int], n: int, counts: Sequence[int] = ()) -> Topology:
    """Return the tree that a row encodes; `counts` as for `ranges`."""
    joints: list[Joint] = [ROOT]
    free = [(0, port) for port in range(4)]
    for k in range(1, n):
        h, a = free.pop(numbers[f"port {k}"])
        b = (a + 2 - numbers.get(f"spin {k}", 0)) % 4
        joints.append((h, a, b))
        free.extend((k, (b + slot) % 4) for slot in (1, 2, 3))
    left = [kind for kind, count in enumerate(counts) for _ in range(count)]
    types = [left.pop(numbers.get(f"type {k}", 0)) for k in range(len(left))]
    return Topology(tuple(joints), types=tuple(types))


def encode(topology: Topology, connectors: Connectors) -> dict[str, int]:
    """Return a row that encodes a tree with the same key."""
    tree = Topology.from_key(topology.key)
    joints, left = tree.joints, sorted(tree.types)
    numbers: dict[str, int] = {}
    free = [(0, port) for port in range(4)]
    for k, (h, a, b) in enumerate(joints[1:], start=1):
        numbers[f"port {k}"] = free.index((h, a))
        if connectors == "any":
            numbers[f"spin {k}"] = (a + 2 - b) % 2
        free.remove((h, a))
        free.extend((k, (b + slot) % 4) for slot in (1, 2, 3))
    for k, kind in enumerate(tree.types[:-1] if left[:1] != left[-1:] else ()):
        numbers[f"type {k}"] = left.index(kind)
        left.remove(kind)
    return numbers


def rank(score: Tried) -> Rank:
    """Return a candidate's sort key."""
    return violation(score), value(score)


def steps(starts: int, first_starts: int) -> Iterator[int]:
    """Yield the ladder of numbers of starts: doubled from the first to all."""
    step = first_starts
    while step < starts:
        yield step
        step *= 2
    yield starts


def is_promoted(score: Tried, ranking: Sequence[Rank], step: int) -> bool:
    """True if a candidate gets more starts.

    Args:
        score: its result after `step` steps of the ladder.
        ranking: sort keys of all candidates, including itself, in ascending order.
        step: number of steps, 1 after the first.
    """
    score_rank = rank(score)
    return score_rank[0] < IMPOSSIBLE and bisect_left(ranking, score_rank) < len(ranking) // HALVING.reduction**step


class Idea(NamedTuple):
    """Possible proposal."""

    key: str
    """Key of the candidate."""
    warm_starts: tuple[str, ...] = ()
    """Keys of the candidates whose designs are carried over."""
    is_repeat: bool = False
    """True if it was proposed before and gets more starts."""


class Merit(NamedTuple):
    """Result of a trial as a sort key: lower is better, and the earlier one wins a tie."""

    violation: float
    """Violation of the best start; 0 with a design."""
    objective: float
    """Objective; infinite without a design."""
    number: int
    """Number of the trial."""
    key: str
    """Key of the trial's candidate."""
    status: str
    """Status of the candidate after the trial."""


def value(score: Tried) -> float:
    """Return the number that a sampler minimises; infinite without a design."""
    return math.inf if score.merit is None else score.merit


def violation(score: Tried) -> float:
    """Return the violation of a trial; 0 with a design."""
    if score.objective is not None:
        return 0.0
    return score.violation if score.status == "infeasible" and score.violation is not None else IMPOSSIBLE


class TreeSampler(BaseSampler):
    """Base class of samplers that draw all numbers of a tree together, as the encoding of its candidate's key."""

    first_starts = HALVING.first_starts
    """Number of starts of a new candidate."""
    promotes = True
    """True if good candidates get more starts immediately."""

    def __init__(self, space: Candidates, seed: int) -> None:
        self.space = space
        self.random = Random(seed)
        self.connectors = space.connectors
        self.proposed: set[str] = set()
        """Keys of all candidates that have a trial."""
        self.running: dict[int, Idea] = {}
        """Running trials by number."""
        self.warm_started: dict[str, set[str]] = defaultdict(set)
        """For each candidate's key, the keys of candidates whose designs were carried over to it."""
        self.failed: set[str] = set()
        """Keys of candidates with a failed trial, which says nothing about them."""
        self.completed = 0
        """Number of trials that ended without a failure."""
        self.starts: dict[str, int] = {}
        """Starts so far of each candidate with a completed trial, by key."""
        self.ranking: list[Merit] = []
        """The best trial of each of these candidates, in ascending order."""
        self._merits: dict[str, Merit] = {}
        self.values = ranges(space.n, self.connectors, space.counts)
        """Number of values of each number that encodes a tree."""
        self.distributions: dict[str, BaseDistribution] = {
            name: CategoricalDistribution(range(values)) for name, values in self.values.items()
        }
        """The numbers that encode a tree, as Optuna's `ask` takes them."""

    @abstractmethod
    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield candidates for a trial, most promising first; known ones are rejected unless they are repeats.

        Args:
            study: the study, for Optuna's own samplers.
            trial: the trial that needs a candidate.
        """

    def note_idea(self, number: int, idea: Idea) -> None:
        """Record the proposal of a trial."""
        self.proposed.add(idea.key)
        self.running[number] = idea
        self.warm_started[idea.key].update(idea.warm_starts)

    def note_score(self, number: int, score: Tried) -> None:
        """Record the result of a trial of this sampler."""
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
        """Return a candidate drawn uniformly from all candidates."""
        (topology,) = self.space.sample(1, self.random.getrandbits(64))
        return Idea(topology.key)

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """Return the numbers that encode a tree."""
        return self.distributions

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return the numbers of a proposed tree, and record the proposal."""
        for idea in islice(self.ideas(study, trial), HALVING.max_rejections):
            if idea.is_repeat or idea.key not in self.proposed:
                break
        else:
            idea = self._draw_new()
        self.note_idea(trial.number, idea)
        return dict(encode(Topology.from_key(idea.key), self.connectors))

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Refuse to draw a number on its own; ValueError."""
        raise ValueError(f"only {', '.join(self.distributions)} can be drawn, but got {param_name!r}")

    def _draw_new(self) -> Idea:
        """Return a candidate drawn uniformly from those without a trial, which are enumerated if they are rare."""
        for _ in range(HALVING.max_rejections):
            idea = self.uniform()
            if idea.key not in self.proposed:
                return idea
        new = [candidate.key for candidate in self.space.candidates() if candidate.key not in self.proposed]
        return Idea(self.random.choice(new))

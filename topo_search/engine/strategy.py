"""Search strategies: what they have in common, the exhaustive one, their candidates, and samplers of a user's own.

A strategy proposes candidates, and takes their results in the order of its proposals, whichever job ended first.
It knows neither workers nor files, and it is deterministic: with the same results it makes the same proposals. So a
run that was killed repeats its proposals from the ledger, and neither the number of workers nor their speed changes
what is proposed.

An exhaustive search gives all candidates the same number of starts: after a few starts, a tree's best effort says
little about what more starts will find, and giving more to the trees ahead finds the best designs less surely than
giving the same to all (`tests/benchmarks/budget.py`).

`search` takes an `OwnSampler` as `sampler=`: a `SamplerFactory`, which makes an Optuna sampler or a
`TopologySampler`, with a name and a version.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from random import Random
from typing import Any, NamedTuple, Protocol, runtime_checkable

from topo_search.engine.workers import rounds
from topo_search.model import ResolvedTask, Topology
from topo_search.model.design import Versioned
from topo_search.protocols import require_stated
from topo_search.topologies import Candidate, Family, Root, Symmetry


@dataclass(frozen=True, slots=True)
class Proposal:
    """A candidate that is to have been solved from its first starts."""

    candidate: Candidate
    starts: int
    """Number of starts in all; those that were tried before are not tried again."""
    near: tuple[str, ...] = ()
    """Keys of candidates whose designs are carried over in place of as many of the next starts.

    The result of each was taken, and none of them is proposed again before that of this one is: how far it had come
    would depend on which job ends first.
    """


@dataclass(frozen=True)
class Tried:
    """The result of a candidate after a number of starts."""

    key: str
    """Key of its topology."""
    starts: int
    """Number of starts that need no more solving: tried, replaced by designs carried over, or given up."""
    status: str
    """feasible, infeasible, impossible or failed."""
    objective: float | None
    """J of the best design [rad^4/s^4]."""
    violation: float | None
    """Distance of the closest start from feasible, in the task's own units; None where there is a design."""


class Stage(NamedTuple):
    """The proposals of a strategy that come next."""

    candidates: int
    """At most."""
    starts: int
    """Most starts of a candidate."""
    again: bool = False
    """True if they were proposed before, from fewer starts."""


class Strategy(ABC):
    """Proposes candidates, and learns from their results."""

    stage: Stage | None = None
    """That of the latest proposal."""
    over = False
    """True if no more will be proposed, and all results were taken."""

    def __init__(self) -> None:
        self._open = deque[Proposal]()
        """Proposals whose results were not taken."""

    def propose(self, result_of: Callable[[Proposal], Tried | None]) -> Iterator[Proposal | None]:
        """Yield proposals; None as long as the next one depends on results that are not known.

        Args:
            result_of: returns the result of a proposal, once it is known.
        """
        self._result_of = result_of
        for proposal in self.proposals():
            if proposal is not None:
                self._open.append(proposal)
            yield proposal
        self.over = True

    @abstractmethod
    def proposals(self) -> Iterator[Proposal | None]:
        """Yield what `propose` does."""

    def results(self, number: int) -> Generator[None, None, list[Tried]]:
        """Return so many results in the order of their proposals, once they are known (with `yield from`)."""
        results = list[Tried]()
        while len(results) < number:
            if (result := self._result_of(self._open[0])) is None:
                yield None
            else:
                self._open.popleft()
                results.append(result)
        return results


class ExhaustiveSearch(Strategy):
    """Solves every candidate."""

    ahead = 32
    """Number of candidates proposed ahead of the results that may rule them out."""

    def __init__(self, space: Candidates, *, starts: int, timed: bool, bound: float = -math.inf) -> None:
        """Begin a search.

        Args:
            space: the candidates.
            starts: number of starts of each candidate.
            timed: whether there is a time limit: then all are solved from one start first, then from more.
            bound: lower bound on all objectives; a design that meets it ends the search.
        """
        super().__init__()
        self._space = space
        self._stops = [part.stop for part in rounds(starts, starts, timed=timed)]
        self._bound = bound

    def proposals(self) -> Iterator[Proposal | None]:
        """Yield every candidate, then those that may still win from more starts."""
        bound, (first, *later) = self._bound, self._stops
        self.stage = Stage(self._space.count(), first)
        candidates, scores, least = list[Candidate](), list[Tried](), math.inf
        for candidate in self._space.candidates():  # there may be millions: enumerated as they are solved
            if math.isfinite(bound) and len(candidates) - len(scores) == self.ahead:
                scores += yield from self.results(1)
                least = min(least, _least(scores[-1:]))
            if not may_beat(least, bound):
                break
            candidates.append(candidate)
            yield Proposal(candidate, first)
        scores += yield from self.results(len(candidates) - len(scores))
        for stop in later:
            least = min(least, _least(scores))
            candidates = [
                candidate
                for candidate, score in zip(candidates, scores, strict=True)
                if score.status in ("feasible", "infeasible") and may_beat(least, bound)
            ]
            if candidates:
                self.stage = Stage(len(candidates), stop, again=True)
            for candidate in candidates:
                yield Proposal(candidate, stop)
            scores = yield from self.results(len(candidates))


def may_beat(objective: float, bound: float) -> bool:
    """True if an objective with this lower bound can save more of another than is worth a search."""
    return bound < objective * (1.0 - 1e-5)  # a bound's allowance for tolerances is mostly less


def _least(scores: Iterable[Tried]) -> float:
    return min((score.objective for score in scores if score.objective is not None), default=math.inf)


class Candidates(Family):
    """The trees of one number of modules that a search may propose: all candidates for a task."""

    def __init__(self, task: ResolvedTask, symmetry: Symmetry, *, rooted: bool = False) -> None:
        """Take the number of modules, the connectors and the root from a task.

        Args:
            task: the task.
            symmetry: symmetry under which trees are one candidate.
            rooted: whether trees that differ in their root alone are candidates of their own, though it is free.
        """
        root: Root = "paper" if rooted else task.search.root
        super().__init__(task.n, symmetry=symmetry, connectors=task.search.connectors, root=root, task=task)
        self.task = task


class Listed(Candidates):
    """Candidates that somebody listed: each is solved as it stands, and stands for itself."""

    def __init__(self, task: ResolvedTask, keys: Sequence[str]) -> None:
        """Take the keys of trees of the task's size, in ascending order."""
        super().__init__(task, "none")
        self.keys = keys

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate, in ascending order of keys."""
        return (Candidate(key, 1) for key in self.keys)

    def count(self) -> int:
        """Return the number of candidates."""
        return len(self.keys)

    @property
    def classes(self) -> int:
        """The number of candidates: none stands for another one."""
        return len(self.keys)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate that a topology is; ValueError if it was not listed."""
        if topology.key not in self.keys:
            raise ValueError(f"{topology.key} is not one of the {len(self.keys)} given topologies")
        return Candidate(topology.key, 1)

    def draws(self, seed: int) -> Iterator[Topology]:
        """Yield candidates, drawn independently and uniformly, without end."""
        random = Random(seed)
        return (Topology.from_key(random.choices(self.keys)[0]) for _ in repeat(None))


@runtime_checkable
class TopologySampler(Protocol):
    """Proposes trees one by one.

    To continue a stopped run, its proposals are replayed: the same arguments must give the same proposal.
    """

    def propose(self, candidates: Candidates, tried: Sequence[Tried], random: Random, /) -> Topology | str:
        """Return a tree to solve, or its key.

        Args:
            candidates: the available trees.
            tried: results of completed rounds, in the order of the proposals; a tree with several solves has
                several rows.
            random: the only random generator to use.

        A tree that was proposed before is rejected and another one requested; after 64 in a row one is drawn.
        """


class SamplerFactory(Protocol):
    """Makes a sampler for one number of modules."""

    def __call__(self, seed: int, /) -> Any:
        """Return a `TopologySampler`, or an Optuna sampler, which receives the fixed-length encoding of trees."""


@dataclass(frozen=True)
class OwnSampler:
    """A sampler of your own, with the name and version that identify its runs."""

    name: str
    make: SamplerFactory
    version: str | None = None
    """Change it when its proposals change. A run with an unversioned sampler is not resumed."""

    def __post_init__(self) -> None:
        """Check the fields; ValueError names the rule and the value."""
        if not callable(self.make):
            raise ValueError(f"make must be a function that returns a sampler for a seed, but got {self.make!r}")
        require_stated(self)

    @property
    def stated(self) -> Versioned:
        """Record of it in a run's folder."""
        return Versioned(name=self.name, version=self.version)

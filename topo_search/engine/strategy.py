"""Search strategies: what they have in common, the exhaustive one, their candidates, and samplers of a user's own.

A strategy is asked for proposals and told their results in the order of its proposals, whichever job ended first.
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
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from random import Random
from typing import Any, NamedTuple, Protocol, runtime_checkable

from topo_search.engine.workers import rounds
from topo_search.model import ResolvedTask, Topology
from topo_search.model.design import Versioned
from topo_search.protocols import require_stated
from topo_search.topologies import (
    Candidate,
    Quotient,
    Symmetry,
    candidate_key,
    candidate_of,
    candidates,
    count,
    quotient_of,
    sample,
)
from topo_search.topologies.rooted import Root


@dataclass(frozen=True)
class Proposal:
    """A candidate that is to have been solved from its first starts."""

    candidate: Candidate
    starts: int
    """Number of starts in all; those that were tried before are not tried again."""
    near: tuple[str, ...] = ()
    """Keys of candidates whose designs are carried over in place of as many of the next starts.

    The result of each was told, and none of them is proposed again before that of this one is: how far it had come
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
    """True if no more will be proposed, and all results were told."""

    def __init__(self) -> None:
        self._results = deque[Tried]()
        self._proposals = self.proposals()

    def ask(self) -> Proposal | None:
        """Return the next proposal; None if it depends on results that were not told, or if there is no more."""
        for proposal in self._proposals:
            return proposal
        self.over = True
        return None

    def tell(self, scored: Tried) -> None:
        """Take the result of the earliest proposal whose result was not told."""
        self._results.append(scored)

    @abstractmethod
    def proposals(self) -> Iterator[Proposal | None]:
        """Yield what `ask` returns."""

    def results(self, number: int) -> Generator[None, None, list[Tried]]:
        """Return so many results in the order of their proposals, once they were told (with `yield from`)."""
        while len(self._results) < number:
            yield None
        return [self._results.popleft() for _ in range(number)]


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


@dataclass(frozen=True)
class Candidates:
    """The trees of one number of modules that a search may propose: all candidates for a task."""

    task: ResolvedTask
    """It fixes the number of modules, the connectors and the root."""
    symmetry: Symmetry
    """Symmetry under which trees are one candidate."""
    rooted: bool = False
    """True if trees that differ in their root alone are candidates of their own, though the root is free."""

    @property
    def n(self) -> int:
        """The number of modules."""
        return self.task.n

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate, in ascending order of keys."""
        return candidates(self.n, **self._family)

    def count(self) -> int:
        """Return the number of candidates, by closed form."""
        return count(self.n, **self._family)

    @property
    def classes(self) -> int:
        """The number of classes of the exact quotient, which the orbits of all candidates add up to."""
        exact: Symmetry = "none" if self.symmetry == "none" or self._root == "paper" else "c2"
        return count(self.n, symmetry=exact, connectors=self.task.search.connectors, root=self._root)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate that stands for a topology."""
        return candidate_of(topology, **self._family)

    def key_of(self, topology: Topology) -> str:
        """Return the key of the candidate that stands for a topology, sooner than the candidate."""
        return candidate_key(topology, quotient=self._quotient, connectors=self.task.search.connectors)

    def twin_of(self, topology: Topology) -> Candidate:
        """Return the candidate that differs in the sense of all rotors alone, which may be the topology's own.

        Rotor drag torques are small, and so is what its optimum differs by. With the paper's root it stands
        otherwise in the world, and there is only itself; nor is there without symmetry, where half turns are
        candidates of their own.
        """
        turned = self._root != "paper" and self.symmetry != "none"
        return self.candidate_of(with_spins_reversed(topology) if turned else topology)

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m candidates, drawn independently and uniformly."""
        return sample(self.n, m, seed, **self._family)

    @property
    def _root(self) -> Root:
        return "paper" if self.rooted else self.task.search.root

    @cached_property
    def _quotient(self) -> Quotient:
        # kept, as finding a task's symmetries takes as long as a key
        return quotient_of(self.n, **self._family)

    @property
    def _family(self) -> dict[str, Any]:
        """Arguments that define which trees are candidates, and which of them are one."""
        search = self.task.search
        return {"symmetry": self.symmetry, "connectors": search.connectors, "root": self._root, "task": self.task}


def with_spins_reversed(topology: Topology) -> Topology:
    """Return the tree whose rotors all turn the other way: every joint sits one port further on."""
    first, *joints = topology.joints
    return Topology((first, *((h, (a + 1) % 4, (b + 1) % 4) for h, a, b in joints)))


@dataclass(frozen=True)
class Listed(Candidates):
    """Candidates that somebody listed: each is solved as it stands, and stands for itself."""

    keys: tuple[str, ...] = ()
    """In ascending order, all of trees of this size."""

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

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m candidates, drawn independently and uniformly."""
        return [Topology.from_key(key) for key in Random(seed).choices(self.keys, k=m)]


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
        ...


class SamplerFactory(Protocol):
    """Makes a sampler for one number of modules."""

    def __call__(self, seed: int, /) -> Any:
        """Return a `TopologySampler`, or an Optuna sampler, which receives the fixed-length encoding of trees."""
        ...


@dataclass(frozen=True)
class OwnSampler:
    """A sampler of your own, with the name and version that identify its runs."""

    name: str
    make: SamplerFactory
    version: str | None = None
    """Change it when its proposals change. A run with an unversioned sampler is never resumed."""

    def __post_init__(self) -> None:
        """Check the fields; ValueError names the rule and the value."""
        if not callable(self.make):
            raise ValueError(f"make must be a function that returns a sampler for a seed, but got {self.make!r}")
        require_stated(self)

    @property
    def stated(self) -> Versioned:
        """Record of it in a run's folder."""
        return Versioned(name=self.name, version=self.version)

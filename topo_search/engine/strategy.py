"""Search strategies: their interface, the exhaustive search, their candidates, and the user's samplers.

A strategy proposes candidates and receives their results in the order of its proposals, whichever job finishes
first. It knows neither workers nor files, and it is deterministic: the same results lead to the same proposals. So
a killed run replays its proposals from the ledger, and the number and speed of workers do not affect the proposals.

An exhaustive search gives all candidates the same number of starts: after a few starts, a tree's best effort says
little about what more starts will find, and giving more to the leading trees finds the best designs less reliably
than giving the same to all (`tests/benchmarks/budget.py`).

`search` takes an `OwnSampler` as `sampler=`: a `SamplerFactory` with a name and a version, which makes an Optuna
sampler or a `TopologySampler`.
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
    """A candidate to solve from its first `starts` starts."""

    candidate: Candidate
    starts: int
    """Total number of starts; those already solved are not repeated."""
    warm_starts: tuple[str, ...] = ()
    """Keys of candidates whose designs are carried over, each replacing one of the next starts.

    The strategy has received their results, and does not propose them again before the result of this proposal:
    else their state would depend on which job finishes first.
    """


@dataclass(frozen=True)
class Tried:
    """The result of a candidate after a number of starts."""

    key: str
    """Key of its topology."""
    starts: int
    """Number of starts that are settled: solved, replaced by a warm start, or given up."""
    status: str
    """feasible, infeasible, impossible or failed."""
    objective: float | None
    """J of the best design [rad^4/s^4]; None without a design."""
    violation: float | None
    """Smallest violation of all starts, in the task's own units; None with a design."""


class Stage(NamedTuple):
    """A series of proposals, for the progress display."""

    candidates: int
    """Largest number of candidates."""
    starts: int
    """Largest number of starts of a candidate."""
    is_repeat: bool = False
    """True if the candidates were proposed before, with fewer starts."""


class Strategy(ABC):
    """Proposes candidates and learns from their results."""

    stage: Stage | None = None
    """Stage of the latest proposal."""
    is_finished = False
    """True after the last proposal, once all results were received."""

    def __init__(self) -> None:
        self._open = deque[Proposal]()
        """Proposals whose results were not received yet."""

    def propose(self, result_of: Callable[[Proposal], Tried | None]) -> Iterator[Proposal | None]:
        """Yield proposals; None while the next one depends on results that are not known yet.

        Args:
            result_of: returns the result of a proposal; None while it is not known.
        """
        self._result_of = result_of
        for proposal in self.proposals():
            if proposal is not None:
                self._open.append(proposal)
            yield proposal
        self.is_finished = True

    @abstractmethod
    def proposals(self) -> Iterator[Proposal | None]:
        """Yield the proposals; same as `propose`."""

    def results(self, number: int) -> Generator[None, None, list[Tried]]:
        """Return the next `number` results in the order of their proposals (with `yield from`)."""
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

    lookahead = 32
    """Number of candidates proposed before the results that may prune them are known."""

    def __init__(self, space: Candidates, *, starts: int, timed: bool, bound: float = -math.inf) -> None:
        """Set up the search.

        Args:
            space: the candidates.
            starts: number of starts of each candidate.
            timed: whether there is a time limit; then all are solved from one start first, then from more.
            bound: lower bound of all objectives; a design that reaches it ends the search.
        """
        super().__init__()
        self._space = space
        self._stops = [part.stop for part in rounds(starts, starts, timed=timed)]
        self._bound = bound

    def proposals(self) -> Iterator[Proposal | None]:
        """Yield every candidate, then those that may still win with more starts."""
        bound, (first, *later) = self._bound, self._stops
        self.stage = Stage(self._space.count(), first)
        candidates, scores, best = list[Candidate](), list[Tried](), math.inf
        for candidate in self._space.candidates():  # there may be millions: enumerated as they are solved
            if math.isfinite(bound) and len(candidates) - len(scores) == self.lookahead:
                scores += yield from self.results(1)
                best = min(best, _best_objective(scores[-1:]))
            if not may_beat(best, bound):
                break
            candidates.append(candidate)
            yield Proposal(candidate, first)
        scores += yield from self.results(len(candidates) - len(scores))
        for stop in later:
            best = min(best, _best_objective(scores))
            candidates = [
                candidate
                for candidate, score in zip(candidates, scores, strict=True)
                if score.status in ("feasible", "infeasible") and may_beat(best, bound)
            ]
            if candidates:
                self.stage = Stage(len(candidates), stop, is_repeat=True)
            for candidate in candidates:
                yield Proposal(candidate, stop)
            scores = yield from self.results(len(candidates))


def may_beat(objective: float, bound: float) -> bool:
    """True if a lower bound allows a design that is noticeably better than an objective."""
    return bound < objective * (1.0 - 1e-5)  # mostly exceeds the bound's allowance for tolerances


def _best_objective(scores: Iterable[Tried]) -> float:
    return min((score.objective for score in scores if score.objective is not None), default=math.inf)


class Candidates(Family):
    """The candidates for a task: the trees of one size that a search may propose."""

    def __init__(self, task: ResolvedTask, symmetry: Symmetry, *, rooted: bool = False) -> None:
        """Take the number of modules, the connectors and the root from a task.

        Args:
            task: the task.
            symmetry: symmetry under which trees are merged into one candidate.
            rooted: whether trees that differ only in their root are separate candidates, even if the root is free.
        """
        root: Root = "paper" if rooted else task.search.root
        super().__init__(task.n, symmetry=symmetry, connectors=task.search.connectors, root=root, task=task)
        self.task = task


class ListedCandidates(Candidates):
    """Candidates from a user's list: each is solved with its given root and represents only itself."""

    def __init__(self, task: ResolvedTask, keys: Sequence[str]) -> None:
        """Set the keys of trees of the task's size, in ascending order."""
        super().__init__(task, "none")
        self.keys = keys

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate, in ascending order of keys."""
        return (Candidate(key, 1) for key in self.keys)

    def count(self) -> int:
        """Return the number of candidates."""
        return len(self.keys)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate of a topology; ValueError if it is not listed."""
        if topology.key not in self.keys:
            raise ValueError(f"{topology.key} is not one of the {len(self.keys)} listed topologies")
        return Candidate(topology.key, 1)

    def draws(self, seed: int) -> Iterator[Topology]:
        """Yield an endless series of candidates, drawn independently and uniformly."""
        random = Random(seed)
        return (Topology.from_key(random.choices(self.keys)[0]) for _ in repeat(None))


@runtime_checkable
class TopologySampler(Protocol):
    """Proposes trees one by one.

    A stopped run is resumed by replaying its proposals: the same arguments must give the same proposal.
    """

    def propose(self, candidates: Candidates, tried: Sequence[Tried], random: Random, /) -> Topology | str:
        """Return a tree to solve, or its key.

        Args:
            candidates: the available trees.
            tried: the known results, in the order of the proposals, one for each solve of a tree.
            random: the only random generator to use.

        A tree that was proposed before is rejected, and the sampler is called again; after 64 rejections in a row a
        tree is drawn uniformly.
        """


SamplerFactory = Callable[[int], Any]
"""Function that makes a sampler from a seed, for one number of modules.

The sampler is a `TopologySampler`, or an Optuna sampler, which works on the fixed-length encoding of trees.
"""


@dataclass(frozen=True)
class OwnSampler:
    """Your own sampler, with the name and version that identify its runs."""

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
        """The sampler's record in a run's folder."""
        return Versioned(name=self.name, version=self.version)

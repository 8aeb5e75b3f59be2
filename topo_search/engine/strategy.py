"""Search strategies: their interface, the exhaustive search, and their candidates.

A strategy is asked for proposals and told their results, in the order of its proposals, whichever job finishes
first. It knows neither workers nor files, and it is deterministic: the same results lead to the same proposals. So
a killed run is resumed by telling it the results of the ledger, and the number and speed of workers do not matter.

An exhaustive search gives all candidates the same number of starts: after a few starts, a tree's best effort says
little about what more starts will find, and giving more to the leading trees finds the best designs less reliably
than giving the same to all (`tests/benchmarks/budget.py`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

from topo_search.engine.workers import start_ranges
from topo_search.model import ResolvedTask
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
    reach: float = 0.0
    """Value of the maximised quantity that a design must exceed."""


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
    value: float | None = None
    """Value of the maximised quantity; None without a design, or if effort is minimised."""

    @property
    def merit(self) -> float | None:
        """Number that samplers minimise: the effort, or minus the maximised value; None without a design."""
        return self.objective if self.value is None else -self.value


class Stage(NamedTuple):
    """A series of proposals, for the progress display."""

    candidates: int
    """Largest number of candidates."""
    starts: int
    """Largest number of starts of a candidate."""
    is_repeat: bool = False
    """True if the candidates were proposed before, with fewer starts."""


WAIT: Final = "wait"
"""Answer of a strategy whose next proposal depends on results that it was not told yet."""


class Strategy(ABC):
    """Proposes candidates and learns from their results."""

    stage: Stage | None = None
    """Stage of the latest proposal."""

    def __init__(self) -> None:
        self._results = list[Tried]()
        """Results that were told and not used yet."""

    @abstractmethod
    def ask(self) -> Proposal | Literal["wait"] | None:
        """Return the next proposal; WAIT if results must be told before it; None after the last result."""

    def tell(self, result: Tried) -> None:
        """Take the result of the earliest proposal without one."""
        self._results.append(result)


class ExhaustiveSearch(Strategy):
    """Solves every candidate, then with more starts those that may still win."""

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
        self._stops = deque(part.stop for part in start_ranges(starts, starts, timed=timed))
        self._candidates = space.candidates()  # there may be millions: enumerated as they are solved
        self._proposed = list[Candidate]()
        self._best, self._bound, self._prunes = math.inf, bound, math.isfinite(bound)
        self.stage = Stage(space.count(), self._stops[0])

    def ask(self) -> Proposal | Literal["wait"] | None:
        """Propose the next candidate of a stage, or begin the next stage."""
        while self._stops:
            latest = len(self._proposed) - self.lookahead
            if self._prunes and latest >= 0:
                if latest >= len(self._results):
                    return WAIT
                self._best = min(self._best, _best_objective([self._results[latest]]))
            if may_beat(self._best, self._bound) and (candidate := next(self._candidates, None)) is not None:
                self._proposed.append(candidate)
                return Proposal(candidate, self._stops[0])
            if len(self._results) < len(self._proposed):
                return WAIT
            self._end_stage()
        return None

    def _end_stage(self) -> None:
        """Select the candidates that may still win for the next stage, if there is one."""
        self._best = min(self._best, _best_objective(self._results))
        remaining = [
            candidate
            for candidate, result in zip(self._proposed, self._results, strict=True)
            if result.status in ("feasible", "infeasible") and may_beat(self._best, self._bound)
        ]
        self._candidates, self._proposed, self._results = iter(remaining), [], []
        self._prunes = False  # the remaining candidates are few
        self._stops.popleft()
        if self._stops and remaining:
            self.stage = Stage(len(remaining), self._stops[0], is_repeat=True)


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
        root: Root = "paper" if rooted or task.search.root_ranges else "free"
        super().__init__(task.n, symmetry=symmetry, connectors=task.search.connectors, root=root, task=task)
        self.task = task


SamplerFactory = Callable[[int], Any]
"""Function that makes a sampler from a seed, for one number of modules.

The sampler is a `TopologySampler` of `topo_search.engine.own_sampler`, or an Optuna sampler, which works on the
fixed-length encoding of trees.
"""

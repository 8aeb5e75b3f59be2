"""Starts of the reduced search, and what Ipopt makes of the best of their ends.

A start is a handful of cheap descents from draws of its own. The best of those of all starts that are searched
together go on at high prices, and the best of their distinct ends are polished by Ipopt on the whole problem.
Starts that ended at the same place share the design. What no start leads to is searched for deeper, before a tree
counts as infeasible.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nlp.assembled import polish_with
from nlp.corners import take_in_corners, with_all, without_corners
from nlp.ipopt import IpoptResult
from nlp.numbers.point import Point
from nlp.own import OwnConstraints, correct_point
from nlp.reduced.arrays import ReducedProblem, to_arrays
from nlp.reduced.draws import draws
from nlp.reduced.search import FIRST, LEAST_KEPT, SAME_AFTER, SECOND, STIFF, End, Phase, ends, point_of
from nlp.start_result import StartResult
from nlp.starts.random_starts import generator
from nlp.starts.warm_start import warm_start
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.corners import CorneredTask

DRAWS = 8
"""Draws of a start."""
POLISHED = 2
"""Distinct ends that are polished; more of them as long as none has become a design."""
MOST_POLISHED = 6
"""Most that are polished."""
POLISHED_OWN, MOST_POLISHED_OWN = 8, 16
"""Those with own constraints, which the descents do not know: the best of them need not be near the best end."""
POLISHED_CORNERED = 8
"""Distinct ends that are polished of a task with reserves or failures; there all ends of the first phase go on.

The merit of such an end says little about its design: on `survives-a-rotor` with three modules and no ball, rod or
exclusion the seven best of 61 ends become designs 1.5 % worse than those of 31 others.
"""
MOST_MISSED = 0.02
"""What an end may miss and is still polished, unless it is the best [l_arm, m_t g, l_arm m_t g].

On push, push-two-paths and push-exterior-60 with five and seven modules, ends that became designs missed 0.0063 at
most; for one that misses more Ipopt takes five times the iterations to end nowhere.
"""
ACCEPTED = 0.01
"""What an end may miss and is still polished before those that miss more [l_arm, m_t g, l_arm m_t g]."""
DEEP_AT = 3
"""The start with which a deep search is made, unless one of the starts solved with it leads to a design."""
DEEP = 100
"""Most starts of a deep search."""
DEEP_BATCH = 2
"""Starts of a batch of a deep search, a module."""
DEEP_PAYS = 0.02
"""Relative decrease of the merit by the later half of a deep search without which it ends."""
DEEP_FOUND = 0.005
"""What an end may miss to end a deep search at once [l_arm, m_t g, l_arm m_t g]."""
NOT_POLISHED = "not polished"
"""Status of starts whose end was not among the best."""


@dataclass(frozen=True)
class _Place:
    """One end, reached from some starts."""

    end: End
    starts: tuple[int, ...]

    @property
    def rank(self) -> tuple[bool, float]:
        """Those that miss little first, then by merit."""
        return self.end.missing > ACCEPTED, self.end.merit


class _Ends(NamedTuple):
    """Where starts ended."""

    best: list[_Place]
    """The best distinct ends."""
    others: list[_Place]
    """Where the rest had come to when they were given up."""


class _Search:
    """The reduced search and the polish of one task and topology."""

    def __init__(self, task: ResolvedTask, topology: Topology, seed: int, own: OwnConstraints) -> None:
        self._task, self._topology, self._seed, self._own = task, topology, seed, own
        self._stated: ReducedProblem = to_arrays(task, topology)
        self._plain = without_corners(task)
        self._cornered = isinstance(task, CorneredTask)

    def of_starts(self, starts: Sequence[int]) -> _Ends:
        """Return the ends of some starts."""
        return self._ends(starts, f"{self._seed}", (FIRST, SECOND))

    def of_source(self, start: int, source: Design) -> list[_Place]:
        """Return the end of a design that is carried over."""
        rng = generator(self._plain, self._topology, start, self._seed)
        point = warm_start(self._plain, self._topology, source=source, rng=rng)
        best, _ = ends(self._stated, point.pack()[None, : len(self._stated.lower)])
        return [_Place(end, (start,)) for end in best]

    def deep_places(self) -> list[_Place]:
        """Return the best distinct ends of many starts at high prices, whose hinges turn either way.

        They come in batches. The search ends when one misses next to nothing, or when its later half brought the
        merit down by little.
        """
        found: list[_Place] = []
        least: list[float] = []  # of the merits after each batch
        size = DEEP_BATCH * self._topology.n
        for batch in range(0, DEEP, size):
            starts = range(batch, min(batch + size, DEEP))
            found += self._ends(starts, f"{self._seed} deep", STIFF, anyhow=True).best
            if min(place.end.missing for place in found) <= DEEP_FOUND:
                break
            least.append(min(place.end.merit for place in found))
            half = least[(len(least) - 1) // 2]
            if len(least) > 1 and half - least[-1] < DEEP_PAYS * abs(half):
                break
        return found

    def _ends(
        self, starts: Sequence[int], seed: str, phases: tuple[Phase, Phase], *, anyhow: bool = False
    ) -> _Ends:
        own = [DRAWS * start + k for start in starts for k in range(DRAWS)]
        drawn = draws(self._task, self._topology, self._stated, own, seed, anyhow=anyhow)
        least = MOST_POLISHED_OWN if self._own else LEAST_KEPT
        if self._cornered and not anyhow:
            least = len(drawn)
        best, others = ends(self._stated, drawn, phases, least=least)
        return _Ends(*([_Place(end, _starts(end, starts)) for end in side] for side in (best, others)))

    def polish(self, places: list[_Place]) -> Iterator[StartResult]:
        """Yield the results of the best distinct places, one for each of their starts."""
        tried, met = 0, False
        enough, most = (POLISHED_OWN, MOST_POLISHED_OWN) if self._own else (POLISHED, MOST_POLISHED)
        if self._cornered:
            enough, most = POLISHED_CORNERED, max(most, POLISHED_CORNERED)
        for place in _one_of_each(places)[:most]:
            if tried >= enough and met:
                return
            if tried and place.end.missing > MOST_MISSED:
                continue
            outcome = take_in_corners(
                self._task, place.starts[0], self._origin(place), polish_with(self._own), self._own
            )
            tried, met = tried + 1, met or outcome.worst.met
            yield from (replace(outcome, start=start) for start in place.starts)

    def without_polish(self, start: int, place: _Place) -> StartResult:
        """Return the result of a start where its end left it."""
        point = with_all(correct_point(self._origin(place), self._own), self._task, self._own)
        return StartResult.at(start, point, IpoptResult(point, NOT_POLISHED, 0), own=self._own)

    def _origin(self, place: _Place) -> Point:
        """Return an end as a point of the task with the corners that counted there."""
        task, counted = self._plain, place.end.counting[len(self._plain.load_cases) :]
        if isinstance(self._task, CorneredTask):
            task = self._task.with_corners(np.flatnonzero(counted).tolist())
        return point_of(task, self._topology, self._stated, place.end)


def solve_starts(
    task: ResolvedTask,
    topology: Topology,
    *,
    starts: range,
    seed: int,
    near: Sequence[Design],
    own: OwnConstraints = (),
) -> list[StartResult]:
    """Return the outcome of each start, and of each design carried over.

    Args:
        task: the task; `reason_against` must have none.
        topology: the tree.
        starts: indices of the starts.
        seed: draws them, with the task, the topology and the index.
        near: designs carried over, as the starts -1, -2, ...
        own: own constraints, which the polish alone knows: so it has more ends.
    """
    search = _Search(task, topology, seed, own)
    best = [place for k, source in enumerate(near) for place in search.of_source(-1 - k, source)]
    others: list[_Place] = []
    if starts:
        reached = search.of_starts(starts)
        best, others = best + reached.best, reached.others
    found = list(search.polish(best))
    if DEEP_AT in starts and not any(outcome.worst.met for outcome in found):
        found += [replace(outcome, start=DEEP_AT) for outcome in search.polish(search.deep_places())]
    outcomes: dict[int, StartResult] = {}
    for outcome in sorted(found, key=lambda outcome: outcome.rank):
        outcomes.setdefault(outcome.start, outcome)
    for place in sorted(best, key=lambda place: place.rank) + others:
        for start in place.starts:
            if start not in outcomes:
                outcomes[start] = search.without_polish(start, place)
    return [outcomes[start] for start in (*range(-1, -1 - len(near), -1), *starts)]


def _starts(end: End, starts: Sequence[int]) -> tuple[int, ...]:
    """Return the starts whose draws ended at an end."""
    return tuple(dict.fromkeys(starts[draw // DRAWS] for draw in end.starts))


def _one_of_each(places: list[_Place]) -> list[_Place]:
    """Return places, the best first, one for all whose merits agree."""
    result: list[_Place] = []
    for place in sorted(places, key=lambda place: (*place.rank, place.starts)):
        last = result[-1] if result else None
        alike = last is not None and last.rank[0] == place.rank[0]
        if last is not None and alike and place.end.merit - last.end.merit <= SAME_AFTER * abs(place.end.merit):
            result[-1] = _Place(last.end, tuple(dict.fromkeys(last.starts + place.starts)))
        else:
            result.append(place)
    return result

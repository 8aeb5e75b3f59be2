"""Starts of the reduced search, and what Ipopt makes of the best of their ends.

A start is a handful of cheap descents from draws of its own, so that starts do not depend on one another. Of the
distinct ends of all starts the best are polished by Ipopt on the whole problem; starts that ended at the same place
share the design. What no start leads to is searched for deeper, before a tree counts as infeasible.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from nlp.assembled import AssembledProgram
from nlp.finish import finish
from nlp.ipopt import Answer
from nlp.neighbour import carried_over
from nlp.reduced.draws import draws
from nlp.reduced.search import FIRST, SAME_AFTER, SECOND, STIFF, End, Phase, ends, point_of
from nlp.reduced.stated import Stated, state
from nlp.starts import generator
from nlp.trial import Trial
from topo_search.model import Design, ResolvedTask, Topology

DRAWS = 8
"""Draws of a start."""
POLISHED = 2
"""Distinct ends that are polished; more of them as long as none has become a design."""
HOPED = 6
"""Most that are polished."""
HOPELESS = 0.02
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


class _Search:
    """The reduced search and the polish of one task and topology."""

    def __init__(self, task: ResolvedTask, topology: Topology, seed: int) -> None:
        self._task, self._topology, self._seed = task, topology, seed
        self._stated: Stated = state(task, topology)
        self._program = AssembledProgram(task, topology)

    def of_start(self, start: int) -> list[_Place]:
        """Return the best distinct ends of a start."""
        return self._ends(start, f"{self._seed}", (FIRST, SECOND))

    def of_donor(self, start: int, donor: Design) -> list[_Place]:
        """Return the end of a design that is carried over."""
        rng = generator(self._task, self._topology, start, self._seed)
        point = carried_over(self._task, self._topology, donor=donor, rng=rng)
        best = ends(self._stated, point.pack()[None, : len(self._stated.lower)])
        return [_Place(end, (start,)) for end in best]

    def deep(self) -> list[_Place]:
        """Return the best distinct ends of many starts at high prices, whose hinges turn either way.

        They come in batches. The search ends when one misses next to nothing, or when its later half brought the
        merit down by little.
        """
        found: list[_Place] = []
        least: list[float] = []  # of the merits after each batch
        size = DEEP_BATCH * self._topology.n
        for batch in range(0, DEEP, size):
            for start in range(batch, min(batch + size, DEEP)):
                found += self._ends(start, f"{self._seed} deep", STIFF, anyhow=True)
            if min(place.end.missing for place in found) <= DEEP_FOUND:
                break
            least.append(min(place.end.merit for place in found))
            half = least[(len(least) - 1) // 2]
            if len(least) > 1 and half - least[-1] < DEEP_PAYS * abs(half):
                break
        return found

    def _ends(self, start: int, seed: str, phases: tuple[Phase, Phase], *, anyhow: bool = False) -> list[_Place]:
        own = range(DRAWS * start, DRAWS * (start + 1))
        drawn = draws(self._task, self._topology, self._stated, own, seed, anyhow=anyhow)
        best = ends(self._stated, drawn, phases)
        return [_Place(end, (start,)) for end in best]

    def polished(self, places: list[_Place]) -> Iterator[Trial]:
        """Yield the trials of the best distinct places, one for each of their starts."""
        tried, met = 0, False
        for place in _distinct(places)[:HOPED]:
            if tried >= POLISHED and met:
                return
            if tried and place.end.missing > HOPELESS:
                continue
            origin = point_of(self._task, self._topology, self._stated, place.end.x)
            trial = Trial.of(place.starts[0], origin, self._program.polish(origin))
            tried, met = tried + 1, met or trial.worst.met
            yield from (Trial(start, trial.answer, trial.point, trial.worst) for start in place.starts)

    def unpolished(self, place: _Place) -> Trial:
        """Return the trial of a start where its end left it."""
        point = finish(point_of(self._task, self._topology, self._stated, place.end.x))
        return Trial.at(place.starts[0], point, Answer(point, NOT_POLISHED, 0))


def trials(
    task: ResolvedTask, topology: Topology, *, starts: range, seed: int, near: Sequence[Design]
) -> list[Trial]:
    """Return the outcome of each start, and of each design carried over.

    Args:
        task: the task; `reason_against` must have none.
        topology: the tree.
        starts: indices of the starts.
        seed: draws them, with the task, the topology and the index.
        near: designs carried over, as the starts -1, -2, ...
    """
    search = _Search(task, topology, seed)
    places = {-1 - k: search.of_donor(-1 - k, donor) for k, donor in enumerate(near)}
    places |= {start: search.of_start(start) for start in starts}
    found = list(search.polished([place for own in places.values() for place in own]))
    if DEEP_AT in starts and not any(trial.worst.met for trial in found):
        found += [
            Trial(DEEP_AT, trial.answer, trial.point, trial.worst) for trial in search.polished(search.deep())
        ]
    best: dict[int, Trial] = {}
    for trial in sorted(found, key=lambda trial: trial.rank):
        best.setdefault(trial.start, trial)
    for start, own in places.items():
        if start not in best:
            best[start] = search.unpolished(min(own, key=lambda place: place.rank))
    return [best[start] for start in places]


def _distinct(places: list[_Place]) -> list[_Place]:
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

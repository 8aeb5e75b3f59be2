"""The reduced search of many starts, and the polish of its best local minima by Ipopt.

A start is a handful of cheap descents from draws of its own. The best of those of all starts that are searched
together go on at high prices, and the best of their distinct minima are polished by Ipopt on the whole problem.
Starts that ended at the same minimum share the design. What no start leads to is searched for deeper, before a tree
counts as infeasible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nlp.airspeed import fastest
from nlp.assembled import AssembledProgram
from nlp.assembled.air import derive_speeds
from nlp.corners import judge, take_in_corners, without_corners
from nlp.joints import Limits
from nlp.numbers.jets import climb
from nlp.numbers.point import Point
from nlp.reduced.arrays import ReducedProblem, to_arrays
from nlp.reduced.search import (
    FIRST,
    SECOND,
    SELECTION,
    STIFF,
    LocalMinimum,
    Phase,
    descend_all,
    local_minima,
    point_of,
)
from nlp.start_result import StartResult
from nlp.starts.random_starts import generator
from nlp.starts.reduced_starts import draws, place_starts
from nlp.starts.warm_start import warm_start
from nlp.units import Units
from nlp.user_constraints import UserConstraints, correct_point
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.compiled_code import is_kept
from topo_search.model.corners import CorneredTask
from topo_search.model.topology import straight_chain

DRAWS = 8
"""Number of draws per start."""


class Polish(NamedTuple):
    """Number of the best distinct local minima that are polished."""

    enough: int
    """Number after which the polish ends once one has become a design."""
    most: int


class Polishing(NamedTuple):
    """Which local minima become designs."""

    plain: Polish = Polish(enough=2, most=6)
    limited: Polish = Polish(enough=2, most=2)
    """Where air is limited, whose rows make Ipopt slow."""
    cornered: Polish = Polish(enough=8, most=8)
    """For tasks with reserves or failures, of which all local minima of the first phase go on.

    The merit of such a minimum says little about its design: on `survives-a-rotor` with three modules and no ball,
    rod or exclusion the seven best of 61 minima become designs 1.5 % worse than those of 31 others.
    """
    constrained: Polish = Polish(enough=8, most=16)
    """For the user's constraints, which descents do not know: the best design may be far from the best minimum."""
    every: Polish = Polish(enough=256, most=256)
    """Where all local optima are sought that cost little enough."""
    most_missed: float = 0.02
    """Largest violation at which a local minimum is polished, unless it is the best [l_arm, m_t g, l_arm m_t g].

    On push, push-two-paths and push-exterior-60 with five and seven modules, minima that became designs missed
    0.0063 at most; for one that misses more Ipopt takes five times the iterations to end nowhere.
    """
    air_missed: float = 0.005
    """The same where air is limited, and of the best, too, but for designs carried over.

    On push-local below 2 and 3 m/s with four modules, the best minima of trees with a design missed 0.0004 at most.
    """
    worth: float = 1.05
    """Largest merit, over the least effort of a design, of a minimum that is polished where air is limited."""
    first_up_to: float = 0.01
    """Largest violation at which a local minimum is polished before worse ones [l_arm, m_t g, l_arm m_t g]."""


POLISHING = Polishing()


class DeepSearch(NamedTuple):
    """A search at high prices, in batches, where no start leads to a design."""

    start: int = 3
    """The start that makes it, unless one of the starts solved with it leads to a design."""
    most_starts: int = 100
    batch: int = 2
    """Starts a batch, for each module."""
    gain: float = 0.02
    """Least relative decrease of the merit by the later half of the batches; the search ends with less."""
    most_missed: float = 0.1
    """Largest violation of the starts' best local minimum at which the search is made, where air is limited.

    The search gave none of 119 trees of push, push-local and push-exterior-60 with five to eight modules a design.
    """
    close: float = 0.005
    """Largest violation of a local minimum that ends the search at once [l_arm, m_t g, l_arm m_t g]."""


DEEP = DeepSearch()
NOT_POLISHED = "not polished"
"""Status of starts whose minimum was not among the best."""


Minima = list[LocalMinimum]


class ReducedSearch:
    """The reduced search and the polish of one task and topology."""

    def __init__(
        self,
        task: ResolvedTask,
        topology: Topology,
        seed: int,
        constraints: UserConstraints,
        most_effort: float | None = None,
    ) -> None:
        """State them; `seed` draws the starts, and all minima up to `most_effort` are polished [rad^4/s^4]."""
        self._task, self._topology, self._seed, self._constraints = task, topology, seed, constraints
        self.problem: ReducedProblem = to_arrays(task, topology)
        self.effort_unit = 4 * topology.n * sum(case.weight for case in task.load_cases) * Units.of(task).input ** 2
        """Effort of a merit of 1 [rad^4/s^4]."""
        self._plain = without_corners(task)
        self._cornered = isinstance(task, CorneredTask)
        self._limited = _limits_air(task)
        self._most_merit = None if most_effort is None else most_effort / self.effort_unit

    def of_starts(self, starts: Sequence[int]) -> tuple[Minima, Minima]:
        """Return the best distinct local minima that starts reach, and points where the rest was given up.

        Each names the starts that reached it.
        """
        return self._descend(starts, f"{self._seed}", (FIRST, SECOND))

    def of_sources(self, near: Sequence[Design]) -> list[LocalMinimum]:
        """Return the local minima that carried-over designs lead to, as the starts -1, -2, ..."""
        minima = []
        for start, source in zip(range(-1, -1 - len(near), -1), near, strict=True):
            rng = generator(self._plain, self._topology, start, self._seed)
            point = warm_start(self._plain, self._topology, source=source, rng=rng)
            best, _ = local_minima(self.problem, point.pack()[None, : len(self.problem.lower)])
            minima += [replace(minimum, starts=(start,)) for minimum in best]
        return minima

    def deep_minima(self, missing: float) -> list[LocalMinimum]:
        """Return the best distinct local minima of many starts at high prices, whose hinges turn either way.

        They come in batches. The search ends when one misses next to nothing, or when its later half brought the
        merit down by little. Where air is limited, whose rows cost more, there is one batch, and none if `missing`,
        the least violation of other starts, is large.
        """
        minima: list[LocalMinimum] = []
        if self._limited and missing > DEEP.most_missed:
            return minima
        least: list[float] = []  # of the merits after each batch
        size = DEEP.batch * self._topology.n
        for batch in range(0, DEEP.most_starts, size):
            starts = range(batch, min(batch + size, DEEP.most_starts))
            minima += self._descend(starts, f"{self._seed} deep", STIFF, anyhow=True)[0]
            if self._limited or min(minimum.missing for minimum in minima) <= DEEP.close:
                break
            least.append(min(minimum.merit for minimum in minima))
            half = least[(len(least) - 1) // 2]
            if len(least) > 1 and half - least[-1] < DEEP.gain * abs(half):
                break
        return minima

    def _descend(
        self, starts: Sequence[int], seed: str, phases: tuple[Phase, Phase], *, anyhow: bool = False
    ) -> tuple[Minima, Minima]:
        numbers = [DRAWS * start + k for start in starts for k in range(DRAWS)]
        drawn = draws(self._task, self._topology, self.problem, numbers, seed, anyhow=anyhow)
        least = POLISHING.constrained.most if self._constraints else SELECTION.least_kept
        if (self._cornered and not anyhow) or self._most_merit is not None:
            least = len(drawn)
        halved = SELECTION.least_halved_in_air if self._limited else SELECTION.least_halved
        best, others = local_minima(self.problem, drawn, phases, least=least, least_halved=halved)
        best, others = ([replace(each, starts=_starts(each, starts)) for each in side] for side in (best, others))
        return best, others

    def polish(self, minima: list[LocalMinimum], plain: Polish | None = None) -> Iterator[StartResult]:
        """Yield the results of the best distinct minima, one for each of their starts.

        Args:
            minima: the minima.
            plain: how many are polished where the descents know all that the task asks for.
        """
        tried, least = 0, math.inf
        plain = plain or (POLISHING.limited if self._limited else POLISHING.plain)
        which = POLISHING.constrained if self._constraints else POLISHING.cornered if self._cornered else plain
        if self._most_merit is not None:
            minima, which = [each for each in minima if each.merit <= self._most_merit], POLISHING.every
        limited = self._limited and self._most_merit is None
        if limited:
            minima = [each for each in minima if each.missing <= POLISHING.air_missed or each.starts[0] < 0]
        for minimum in _one_of_each(minima)[: which.most]:
            if tried >= which.enough and least < math.inf:
                return
            costly = limited and minimum.merit > POLISHING.worth * least
            if tried and (costly or minimum.missing > POLISHING.most_missed):
                continue
            outcome = take_in_corners(self._task, minimum.starts[0], self._origin(minimum), self._constraints)
            tried += 1
            if outcome.worst.met:
                least = min(least, outcome.objective / self.effort_unit)
            yield from (replace(outcome, start=start) for start in minimum.starts)

    def without_polish(self, minimum: LocalMinimum) -> StartResult:
        """Return the result of the best start of a minimum where its descent left it."""
        point = correct_point(self._origin(minimum), self._constraints)
        return judge(self._task, minimum.starts[0], point, NOT_POLISHED, self._constraints)

    def _origin(self, minimum: LocalMinimum) -> Point:
        """Return a local minimum as a point of the task with the corners that counted there."""
        task, counted = self._plain, minimum.counting[len(self._plain.load_cases) :]
        if isinstance(self._task, CorneredTask):
            task = self._task.with_corners(np.flatnonzero(counted).tolist())
        return point_of(task, self._topology, self.problem, minimum)


def compile_reduced(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile what the reduced search needs, unless that is kept: who solves loads it.

    Args:
        task: a task that the reduced search expresses.
        tell: is told if it takes a while.
    """
    limited = _limits_air(task)
    needed = (place_starts, descend_all, *((climb, derive_speeds) if limited else ()))
    if all(map(is_kept, needed)):
        return
    tell("compiling the solver (once per installation, about two minutes)")
    tree = straight_chain(task.n)
    problem = to_arrays(task, tree)
    best, _ = local_minima(problem, draws(task, tree, problem, range(1), "compile"))
    point = point_of(without_corners(task), tree, problem, best[0])
    if limited:  # the polish states air speeds
        points = sorted({at for fast in fastest(point) for at in fast.points})
        AssembledProgram(point.task, tree, (), Limits(None, (), tuple(points))).polish(point)


def solve_starts(
    task: ResolvedTask,
    topology: Topology,
    starts: range,
    seed: int,
    near: Sequence[Design],
    *,
    constraints: UserConstraints = (),
    most_effort: float | None = None,
) -> list[StartResult]:
    """Return the outcome of each start, and of each design carried over; or all minima that cost little enough.

    Args:
        task: the task; `reason_against` must have none.
        topology: the tree.
        starts: indices of the starts.
        seed: draws them, with the task, the topology and the index.
        near: designs carried over, as the starts -1, -2, ...
        constraints: constraints of the user, which the polish alone knows: so it takes more minima.
        most_effort: effort up to which every distinct minimum is polished and returned [rad^4/s^4].
    """
    search = ReducedSearch(task, topology, seed, constraints, most_effort)
    best = search.of_sources(near)
    if most_effort is not None:
        return list(search.polish(best + search.of_starts(starts)[0]))
    others: list[LocalMinimum] = []
    if starts:
        reached, others = search.of_starts(starts)
        best += reached
    polished = list(search.polish(best))
    if DEEP.start in starts and not any(outcome.worst.met for outcome in polished):
        deep = search.deep_minima(min(minimum.missing for minimum in best))
        polished += [replace(outcome, start=DEEP.start) for outcome in search.polish(deep)]
    outcomes: dict[int, StartResult] = {}
    for outcome in sorted(polished, key=lambda outcome: outcome.rank):
        outcomes.setdefault(outcome.start, outcome)
    for minimum in sorted(best, key=_rank) + others:
        if rest := set(minimum.starts) - outcomes.keys():
            outcome = search.without_polish(minimum)
            outcomes |= {start: replace(outcome, start=start) for start in rest}
    return [outcomes[start] for start in (*range(-1, -1 - len(near), -1), *starts)]


def _limits_air(task: ResolvedTask) -> bool:
    return any(exposure.speed is not None for exposure in task.exposure)


def _starts(minimum: LocalMinimum, starts: Sequence[int]) -> tuple[int, ...]:
    return tuple(dict.fromkeys(starts[draw // DRAWS] for draw in minimum.starts))


def _rank(minimum: LocalMinimum) -> tuple[bool, float]:
    return minimum.missing > POLISHING.first_up_to, minimum.merit  # those that miss little first


def _one_of_each(minima: list[LocalMinimum]) -> list[LocalMinimum]:
    """Return minima, the best first, one for all whose merits agree."""
    result: list[LocalMinimum] = []
    for minimum in sorted(minima, key=lambda minimum: (*_rank(minimum), minimum.starts)):
        last = result[-1] if result else None
        alike = last is not None and _rank(last)[0] == _rank(minimum)[0]
        if last is not None and alike and minimum.merit - last.merit <= SELECTION.same_after * abs(minimum.merit):
            result[-1] = replace(last, starts=tuple(dict.fromkeys(last.starts + minimum.starts)))
        else:
            result.append(minimum)
    return result

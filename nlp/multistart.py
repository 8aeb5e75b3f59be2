"""The reduced search of many starts, and the polish of its best local minima by Ipopt.

A start is a handful of cheap descents from random points. The best descents of all starts that are searched
together continue at high prices, and Ipopt polishes the best of their distinct minima on the full problem. Starts
that reach the same minimum share its design. If no start leads to a design, a deeper search runs with the fourth
start (`DEEP`) before a tree counts as infeasible. Where a task asks for a value of a maximised quantity, any design
will do, and all starts descend at high prices from the first.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from nlp.evaluation import correct_point
from nlp.features import LAZY_ROWS
from nlp.lazy_solve import judge, solve_lazily, without_corners
from nlp.numbers.point import Point
from nlp.program import AssembledProgram
from nlp.reduced.arrays import ReducedProblem, to_arrays
from nlp.reduced.descent import descend
from nlp.reduced.search import FIRST, SECOND, SELECTION, STIFF, Descent, local_minima, merge, point_of
from nlp.rows import UserConstraints
from nlp.start_result import StartResult
from nlp.starts.reduced_starts import draw_starts, place_starts
from nlp.units import Units
from topo_search.compiled_code import is_cached
from topo_search.model import CorneredTask, ResolvedTask, Topology
from topo_search.model.topology import straight_chain

DRAWS = 8
"""Number of random points per start."""


class PolishLimits(NamedTuple):
    """Limits on how many of the best distinct local minima are polished."""

    stop_after: int
    """Number after which polishing stops if one of them has become a design."""
    maximum: int


class Polishing(NamedTuple):
    """Settings of the polish, by kind of task."""

    plain: PolishLimits = PolishLimits(stop_after=2, maximum=6)
    in_air: PolishLimits = PolishLimits(stop_after=2, maximum=2)
    """With limits on air speed, whose rows slow Ipopt down."""
    cornered: PolishLimits = PolishLimits(stop_after=8, maximum=8)
    """For tasks with reserves or failures, whose first-phase minima all continue.

    The merit of such a minimum says little about its design: on `survives-a-rotor` with three modules and no ball,
    rod or exclusion the seven best of 61 minima become designs 1.5 % worse than those of 31 others.
    """
    constrained: PolishLimits = PolishLimits(stop_after=8, maximum=16)
    """For user constraints, which descents do not see: the best design may be far from the best minimum."""
    every: PolishLimits = PolishLimits(stop_after=256, maximum=256)
    """For a search of all local optima up to an effort."""
    max_violation: float = 0.02
    """Largest violation of a local minimum that is polished; the best one always is [l_arm, m_t g, l_arm m_t g].

    On push, push-two-paths and push-exterior-60 with five and seven modules, minima that became designs violated
    constraints by 0.0063 at most. On worse ones Ipopt takes five times the iterations and fails.
    """
    max_violation_in_air: float = 0.005
    """The same with limits on air speed; it also holds for the best one, but not for designs carried over.

    On push-local below 2 and 3 m/s with four modules, the best minima of trees with a design violated constraints
    by 0.0004 at most.
    """
    max_merit_ratio: float = 1.05
    """Largest merit of a polished minimum with limits on air speed, relative to the least effort of a design."""
    small_violation: float = 0.01
    """Largest violation at which a local minimum is polished before worse ones [l_arm, m_t g, l_arm m_t g]."""


POLISHING = Polishing()


class DeepSearch(NamedTuple):
    """Settings of the search at high prices, in batches, that runs if no start leads to a design."""

    start: int = 3
    """Index of the start that runs it, unless one of the starts solved together leads to a design."""
    max_starts: int = 100
    batch: int = 2
    """Starts per batch and module."""
    gain: float = 0.02
    """Relative decrease of the merit by the later half of the batches below which the search stops."""
    max_violation: float = 0.1
    """Largest violation of the best local minimum at which the search runs, with limits on air speed.

    Above it the search found no design for any of 119 trees of push, push-local and push-exterior-60 with five to
    eight modules.
    """
    close: float = 0.005
    """Largest violation of a local minimum that stops the search at once [l_arm, m_t g, l_arm m_t g]."""


DEEP = DeepSearch()
NOT_POLISHED = "not polished"
"""Status of a start whose minimum was not among the best."""


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
        """Set up the search: `seed` seeds the starts, all minima up to `most_effort` [rad^4/s^4] are polished."""
        self._task, self._topology, self._seed, self._constraints = task, topology, seed, constraints
        self.problem: ReducedProblem = to_arrays(task, topology)
        weights = sum(case.weight for case in task.load_cases)
        self.effort_unit = task.rotor_count * weights * Units.of(task).input ** 2
        """Effort at a merit of 1 [rad^4/s^4]."""
        self._plain = without_corners(task)
        self._cornered = isinstance(task, CorneredTask)
        self._in_air = any(exposure.speed is not None for exposure in task.exposure)
        self._max_merit = None if most_effort is None else most_effort / self.effort_unit

    def minima_of_starts(self, starts: Sequence[int], *, deep: bool = False) -> tuple[list[Descent], list[Descent]]:
        """Return the best distinct local minima that the starts reach, and where the other descents were stopped.

        Each names the starts that reached it.

        Args:
            starts: indices of the starts.
            deep: descend at high prices, from draws of their own, whose hinges turn either way.
        """
        seed = f"{self._seed} deep" if deep else f"{self._seed}"
        draw_ids = [DRAWS * start + k for start in starts for k in range(DRAWS)]
        points = draw_starts(self._task, self._topology, self.problem, draw_ids, seed, random_signs=deep)
        min_minima = POLISHING.constrained.maximum if self._constraints else SELECTION.min_minima
        if (self._cornered and not deep) or self._max_merit is not None:
            min_minima = len(points)
        phases, enough = STIFF if deep else (FIRST, SECOND), SELECTION.min_starts
        enough = SELECTION.min_starts_in_air if self._in_air else enough
        best, stopped = local_minima(self.problem, points, phases, min_minima=min_minima, min_starts=enough)
        return _with_starts(best, starts), _with_starts(stopped, starts)

    def minima_of_points(self, points: Mapping[int, Point]) -> list[Descent]:
        """Return the local minima reached from points of designs carried over, by the index of their start."""
        minima = []
        for start, point in points.items():
            best, _ = local_minima(self.problem, point.pack()[None, : len(self.problem.lower)])
            minima += [replace(minimum, starts=(start,)) for minimum in best]
        return minima

    def deep_minima(self, least_violation: float, first: int) -> list[Descent]:
        """Return the best distinct local minima of many starts at high prices, with hinges turned either way.

        The search runs in batches from the start `first`. It stops when a minimum violates next to nothing, or when
        the later half of the batches hardly decreased the merit. With limits on air speed, whose rows cost more, it
        runs one batch, and none if `least_violation`, that of the other starts, is large.
        """
        minima: list[Descent] = []
        if self._in_air and least_violation > DEEP.max_violation:
            return minima
        least_merits: list[float] = []  # after each batch
        size = DEEP.batch * self._topology.n
        for batch in range(first, first + DEEP.max_starts, size):
            starts = range(batch, min(batch + size, first + DEEP.max_starts))
            minima += self.minima_of_starts(starts, deep=True)[0]
            if self._in_air or min(minimum.violation for minimum in minima) <= DEEP.close:
                break
            least_merits.append(min(minimum.merit for minimum in minima))
            half = least_merits[(len(least_merits) - 1) // 2]
            if len(least_merits) > 1 and half - least_merits[-1] < DEEP.gain * abs(half):
                break
        return minima

    def polish(self, minima: list[Descent], plain: PolishLimits | None = None) -> Iterator[StartResult]:
        """Yield the results of the best distinct minima, once for each of their starts.

        Args:
            minima: the local minima.
            plain: how many to polish if the descents see every requirement of the task.
        """
        polished, least_effort = 0, math.inf
        plain = plain or (POLISHING.in_air if self._in_air else POLISHING.plain)
        polish = POLISHING.constrained if self._constraints else POLISHING.cornered if self._cornered else plain
        if self._max_merit is not None:
            minima, polish = [m for m in minima if m.merit <= self._max_merit], POLISHING.every
        in_air = self._in_air and self._max_merit is None
        if in_air:
            minima = [m for m in minima if m.violation <= POLISHING.max_violation_in_air or m.starts[0] < 0]
        for minimum in _merge(minima)[: polish.maximum]:
            if polished >= polish.stop_after and least_effort < math.inf:
                return
            costly = in_air and minimum.merit > POLISHING.max_merit_ratio * least_effort
            if polished and (costly or minimum.violation > POLISHING.max_violation):
                continue
            result = solve_lazily(self._task, minimum.starts[0], self._origin(minimum), self._constraints)
            polished += 1
            if result.worst.met:
                least_effort = min(least_effort, result.objective / self.effort_unit)
            yield from (replace(result, start=start) for start in minimum.starts)

    def without_polish(self, minimum: Descent) -> StartResult:
        """Return the result of a minimum's best start, at the point that its descent reached."""
        point = correct_point(self._origin(minimum), self._constraints)
        return judge(self._task, minimum.starts[0], point, NOT_POLISHED, self._constraints)

    def _origin(self, minimum: Descent) -> Point:
        """Return a local minimum as a point of the task with the corners that were active there."""
        task, active = self._plain, minimum.active[len(self._plain.load_cases) :]
        if isinstance(self._task, CorneredTask):
            task = self._task.with_corners(np.flatnonzero(active).tolist())
        return point_of(task, self._topology, self.problem, minimum)


def compile_reduced(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile the reduced search, unless its compiled code is cached.

    Args:
        task: a task that the reduced search expresses.
        tell: called with a message before compiling.
    """
    lazy_rows = {kind: functions for kind in LAZY_ROWS if (functions := kind.functions(task))}
    if all(map(is_cached, (place_starts, descend, *chain.from_iterable(lazy_rows.values())))):
        return
    tell("compiling the solver (once per installation, about a minute)")
    types = tuple(k for k, kind in enumerate(task.module_types) for _ in range(kind.count))
    tree = replace(straight_chain(task.n), types=types)
    task = task.on(tree)
    problem = to_arrays(task, tree)
    best, _ = local_minima(problem, draw_starts(task, tree, problem, range(1), "compile"))
    point = point_of(without_corners(task), tree, problem, best[0])
    if lazy_rows:  # with rows for all that they limit
        selections = {kind: kind.select(point, everything=True) for kind in lazy_rows}
        AssembledProgram(point.task, tree, (), selections).polish(point)


def solve_starts(
    task: ResolvedTask,
    topology: Topology,
    starts: range,
    seed: int,
    carried: Mapping[int, Point],
    *,
    constraints: UserConstraints = (),
    most_effort: float | None = None,
) -> list[StartResult]:
    """Return the result of each start and of each design carried over, or of all minima up to an effort.

    Args:
        task: the task; `reason_against` must return None for it.
        topology: the tree.
        starts: indices of the starts.
        seed: seeds them, with the task, the topology and the index.
        carried: points of designs carried over, by the index of their start, -1, -2, ...
        constraints: the user's constraints; only the polish sees them, so more minima are polished.
        most_effort: effort up to which every distinct minimum is polished and returned [rad^4/s^4].
    """
    search = ReducedSearch(task, topology, seed, constraints, most_effort)
    best = search.minima_of_points(carried)
    if most_effort is not None:
        return list(search.polish(best + search.minima_of_starts(starts)[0]))
    stopped, asked = list[Descent](), task.search.reached is not None
    if starts:
        reached, stopped = search.minima_of_starts(starts, deep=asked)
        best += reached
    polished = list(search.polish(best))
    if DEEP.start in starts and not any(result.worst.met for result in polished):
        deep = search.deep_minima(min(minimum.violation for minimum in best), starts.stop if asked else 0)
        polished += [replace(result, start=DEEP.start) for result in search.polish(deep)]
    by_start: dict[int, StartResult] = {}
    for result in sorted(polished, key=lambda result: result.rank):
        by_start.setdefault(result.start, result)
    for minimum in sorted(best, key=_rank) + stopped:
        if unpolished := set(minimum.starts) - by_start.keys():
            result = search.without_polish(minimum)
            by_start |= {start: replace(result, start=start) for start in unpolished}
    return [by_start[start] for start in (*carried, *starts)]


def _with_starts(minima: list[Descent], starts: Sequence[int]) -> list[Descent]:
    return [replace(m, starts=tuple(dict.fromkeys(starts[draw // DRAWS] for draw in m.starts))) for m in minima]


def _rank(minimum: Descent) -> tuple[bool, float]:
    return minimum.violation > POLISHING.small_violation, minimum.merit  # small violations first


def _merge(minima: list[Descent]) -> list[Descent]:
    """Return the minima, the best first, with those of equal merit merged."""
    ordered = sorted(minima, key=lambda minimum: (minimum.merit, minimum.starts))
    small, large = ([m for m in ordered if _rank(m)[0] == is_large] for is_large in (False, True))
    return merge(small, SELECTION.same_merit_after) + merge(large, SELECTION.same_merit_after)

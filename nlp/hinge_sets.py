"""Hinge angles from a set: from the local optima of free angles to the best combination of angles near them.

With the hinges fixed, what is left of the problem is the root's orientation, the end-effector and the inputs. The
effort of an optimum of free angles is taken as the least that combinations near it cost: a bound of its own
neighbourhood, and so of the whole set as far as all local optima are known. In the order of their efforts, from
every optimum that costs less than the best combination so far, the nearest angles below and above of each hinge are
combined; where there are few combinations in all, each is tried. Then one hinge, two, or more where hinges are few,
turn to the next angles, as long as that costs less, and one where all combinations up to an effort are sought, from
each of them. How clear modules are of each other depends on hinges alone, so that combinations in which they are
not are left out without a solve.

The compiled search solves a combination in milliseconds, and Ipopt makes the best of them exact. Tasks that it does
not express are solved by Ipopt alone, with fewer combinations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, combinations, islice, product
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from nlp.corners import take_in_corners, with_some
from nlp.evaluation import correct
from nlp.multistart import POLISHING, Polish, ReducedSearch
from nlp.numbers.geometry import signs, turns
from nlp.numbers.point import Point
from nlp.reduced import reason_against
from nlp.reduced.search import SELECTION, LocalMinimum, local_minima
from nlp.requirements.modules import module_clearances
from nlp.start_result import StartResult
from nlp.user_constraints import UserConstraints
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array


class SetSearch(NamedTuple):
    """The search for combinations of a set of hinge angles."""

    complete_up_to: int = 256
    """Largest number of combinations tried near one optimum, and of moves from the best.

    If there are no more in all, each is tried; else as many hinges take either angle as make no more, those whose
    angles are farthest from the set, and the others take the nearest."""
    widest: int = 3
    """Largest number of angles on each side of a hinge's angle to seek clear combinations among."""
    most_missed: float = 0.1
    """Largest violation of a free-angle end near which combinations are sought [l_arm, m_t g, l_arm m_t g, rad]."""
    polish: Polish = Polish(enough=4, most=8)
    """Number of the best combinations that Ipopt makes exact: their order may change slightly."""


SEARCH = SetSearch()


MOST_REDUCED, MOST_WHOLE = 4096, 48
"""Largest numbers of combinations solved for one tree, by the compiled search and by Ipopt."""

Places = tuple[int, ...]
"""Indices into the set of a combination's angles."""
End = TypeVar("End", LocalMinimum, StartResult)


@dataclass(frozen=True)
class _Solved(Generic[End]):
    """A combination with its hinges fixed, solved."""

    start: int
    places: Places
    rank: tuple[bool, float]
    """True if it misses anything; its effort, plus a price of what it misses [rad^4/s^4]."""
    x: Array
    """Unknowns at its end, which begin with those of a reduced search."""
    end: End


Solve = Callable[[int, Array, Places], _Solved[End]]
"""Solves a combination for a start, from unknowns of which the hinges do not count."""


class _Set:
    """The angles that the hinges of a tree may have, as folds, and the combinations that leave modules clear."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        self.hinges = topology.n - 1
        self._task, self._topology, self._signs = task, topology, signs(topology)
        self._between = list(module_clearances(task, topology))
        self._folds = np.array([fold for fold, _ in turns(task, task.search.margin)])

    def angles(self, places: Places) -> Array:
        """Return the hinge angles of a combination, shape (n-1,) [rad]."""
        return np.asarray(self._signs * self._folds[list(places)])

    def near(self, alpha: Array) -> list[Places]:
        """Return clear combinations near angles alpha (n-1,), all if they are few.

        Else there is one angle on each side of a hinge's, or more where no combination of fewer is clear.
        """
        count = len(self._folds)
        if count**self.hinges <= SEARCH.complete_up_to:
            return self._clear(product(range(count), repeat=self.hinges))
        phi = self._signs * alpha
        above, off = np.searchsorted(self._folds, phi), np.abs(self._folds[:, None] - phi)
        order = np.argsort(-off.min(axis=0), kind="stable")
        for width in range(1, SEARCH.widest + 1):
            either = order[: int(math.log(SEARCH.complete_up_to, 2 * width))]
            sides = [[fold] for fold in np.argmin(off, axis=0).tolist()]
            for hinge in either.tolist():
                sides[hinge] = list(range(max(0, above[hinge] - width), min(count, above[hinge] + width)))
            if combinations := self._clear(product(*sides)):
                return combinations
        return []

    def _clear(self, listed: Iterable[Places]) -> list[Places]:
        """Return the combinations in which modules keep clear of each other: that depends on hinges alone."""
        return [places for places in listed if self._is_clear(places)]

    def _is_clear(self, places: Places) -> bool:
        nowhere, still = np.zeros(3), np.zeros((0, self._topology.n, 4))
        vectors = Point(self._task, self._topology, nowhere, self.angles(places), nowhere, still).vectors
        return all(np.all(each.gaps(vectors) >= each.margin) for each in self._between)

    def moves(self, places: Places, at_once: int) -> Iterator[Places]:
        """Yield clear combinations with up to `at_once` hinges a step away, or more hinges where moves are few."""
        counts = accumulate(math.comb(self.hinges, k) * 2**k for k in range(1, self.hinges + 1))
        most = max(at_once, sum(count <= SEARCH.complete_up_to for count in counts))
        for moved in (each for k in range(1, most + 1) for each in combinations(range(self.hinges), k)):
            for steps in product((-1, 1), repeat=len(moved)):
                other = np.array(places)
                other[list(moved)] += steps
                inside = np.all((other >= 0) & (other < len(self._folds)))
                if inside and self._is_clear(to := tuple(other.tolist())):
                    yield to


def solve_on_set(
    task: ResolvedTask,
    topology: Topology,
    free: Sequence[StartResult],
    constraints: UserConstraints = (),
    most_effort: float | None = None,
) -> list[StartResult]:
    """Return the outcome of each start with hinge angles from the task's set, or else with any, judged by the task.

    With an effort it is every combination near local optima of free angles that costs no more.

    Args:
        task: a task with a set of hinge angles, and with its corners.
        topology: the tree.
        free: where the starts ended with any angles.
        constraints: constraints of the user, which Ipopt alone knows.
        most_effort: that effort [rad^4/s^4].
    """
    if most_effort is not None:
        numbered = [replace(one, start=k) for k, one in enumerate(free)]  # a start may lead to several
        results, _ = _near_optima(task, topology, numbered, constraints, most_effort)
        return [replace(one, start=free[one.start].start) for one in results]
    results, starts = _near_optima(task, topology, free, constraints)
    outcomes = {}
    for one in free:
        held = StartResult.at(one.start, replace(one.point, task=task), one.result, one.corners, constraints)
        reached = [replace(each, start=one.start) for each in results if one.start in starts[each.start]]
        outcomes[one.start] = min([held, *reached], key=lambda each: each.rank)
    return list(outcomes.values())


def _near_optima(
    task: ResolvedTask,
    topology: Topology,
    free: Sequence[StartResult],
    constraints: UserConstraints,
    most_effort: float | None = None,
) -> tuple[list[StartResult], dict[int, list[int]]]:
    """Return the best combinations near optima, or all up to an effort, and the starts that led to each optimum."""
    near = [one for one in free if one.worst.scaled <= SEARCH.most_missed]
    optima: dict[int, StartResult] = {}
    starts: dict[int, list[int]] = {}
    for one in sorted(near, key=lambda each: each.objective):
        last = next(reversed(optima.values()), None)
        if last is None or one.objective - last.objective > SELECTION.same_after * one.objective:
            optima[one.start], starts[one.start] = one, []
        starts[next(reversed(optima))].append(one.start)
    solve = _solve_whole if reason_against(task) else _solve_reduced
    return solve(task, topology, list(optima.values()), constraints, most_effort), starts


def _search(
    angles: _Set, optima: Sequence[StartResult], solve: Solve[End], most: int, most_effort: float
) -> list[_Solved[End]]:
    """Return combinations that were solved, the best first, each as it ended best.

    Args:
        angles: the set.
        optima: ends of free angles, the least effort first.
        solve: solves a combination.
        most: combinations to solve.
        most_effort: of optima and combinations whose neighbours are sought even if a better one is known
            [rad^4/s^4].
    """
    outcomes: dict[Places, _Solved[End]] = {}
    solved = 0

    def attempt(start: int, x: Array, places: Places) -> _Solved[End]:
        nonlocal solved
        one, solved = solve(start, x, places), solved + 1
        outcomes[places] = min(outcomes.get(places, one), one, key=lambda each: each.rank)
        return one

    best: _Solved[End] | None = None
    for optimum in optima:
        if best is not None and max(best.rank, (False, most_effort)) <= (False, optimum.objective):
            break
        for places in islice(angles.near(optimum.point.alpha), max(0, most - solved)):
            one = attempt(optimum.start, optimum.point.pack(), places)
            if best is None or one.rank < best.rank:
                best = one
    tried = set[Places]()
    while best is not None:
        at, best = best, None
        tried.add(at.places)
        for places in angles.moves(at.places, 2):
            if places not in tried and solved < most:
                tried.add(places)
                one = attempt(at.start, at.x, places)
                if one.rank < at.rank:
                    best = one
                    break
    within = [one for one in outcomes.values() if one.rank <= (False, most_effort)]
    for at in within:
        for places in angles.moves(at.places, 1):
            if places not in outcomes and solved < most:
                one = attempt(at.start, at.x, places)
                if one.rank <= (False, most_effort):
                    within.append(one)
    return sorted(outcomes.values(), key=lambda each: (each.rank, each.places))


def _solve_reduced(
    task: ResolvedTask,
    topology: Topology,
    optima: Sequence[StartResult],
    constraints: UserConstraints,
    most_effort: float | None,
) -> list[StartResult]:
    """Return the best combinations that the compiled search finds, made exact."""
    search, angles = ReducedSearch(task, topology, 0, constraints, most_effort), _Set(task, topology)
    problem, hinges = search.problem, slice(3, topology.n + 2)

    def solve(start: int, x: Array, places: Places) -> _Solved[LocalMinimum]:
        x, lower, upper = x[: len(problem.lower)].copy(), problem.lower.copy(), problem.upper.copy()
        for each in (x, lower, upper):
            each[hinges] = angles.angles(places)
        ((end, *_), _) = local_minima(problem._replace(lower=lower, upper=upper), x[None])
        end = replace(end, starts=(start,))
        return _Solved(
            start, places, (end.missing > POLISHING.first_up_to, search.effort_unit * end.merit), end.x, end
        )

    combinations = _search(angles, optima, solve, MOST_REDUCED, most_effort or 0.0)
    return list(search.polish([each.end for each in combinations], SEARCH.polish))


def _solve_whole(
    task: ResolvedTask,
    topology: Topology,
    optima: Sequence[StartResult],
    constraints: UserConstraints,
    most_effort: float | None,
) -> list[StartResult]:
    """Return the best combinations that Ipopt finds."""
    angles, free = _Set(task, topology), {one.start: one for one in optima}

    def solve(start: int, x: Array, places: Places) -> _Solved[StartResult]:
        known = replace(free[start].point, task=task, root=x[:3], alpha=angles.angles(places))
        origin = with_some(correct(known, refit=True), free[start].corners)
        end = take_in_corners(task, start, origin, constraints)
        return _Solved(start, places, end.rank[:2], end.point.pack(), end)

    return [each.end for each in _search(angles, optima, solve, MOST_WHOLE, most_effort or 0.0)]

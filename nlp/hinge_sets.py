"""Hinge angles from a set: the best combinations of angles near the local optima of free angles.

With the hinges fixed, the unknowns are the root's orientation, the end-effector and the inputs. The effort of a
free-angle optimum is used as a lower bound on combinations near it, and so on the whole set if all local optima are
known. In order of effort, every optimum below the best combination so far is rounded: each hinge takes the nearest
angles below and above, or if there are few combinations in all, every one is tried. Then a local search turns one
or two hinges, or more if there are few, to the next angles as long as the effort decreases. If all combinations up
to an effort are wanted, one hinge at a time is turned from each of them. Clearances between modules depend only on
hinges, so combinations that violate them are skipped without a solve.

The compiled search solves a combination in milliseconds, and Ipopt makes the best ones exact. Tasks that the
compiled search does not express are solved by Ipopt only, with fewer combinations.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, combinations, islice, product
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from nlp.evaluation import correct
from nlp.lazy_solve import solve_lazily, with_some_corners
from nlp.multistart import POLISHING, PolishLimits, ReducedSearch
from nlp.numbers.geometry import allowed_folds, signs
from nlp.numbers.point import Point
from nlp.reduced import reason_against
from nlp.reduced.search import SELECTION, Descent, local_minima
from nlp.requirements.modules import module_clearances
from nlp.rows import UserConstraints
from nlp.start_result import StartResult
from topo_search.model import Array, ResolvedTask, Topology


class SetSearch(NamedTuple):
    """Settings of the search over combinations of hinge angles."""

    complete_up_to: int = 256
    """Largest number of combinations tried near one optimum, and of moves from the best.

    If the set has no more in all, each is tried. Otherwise the hinges whose angles are farthest from the set take
    both neighbours, as many hinges as this limit allows, and the others take the nearest angle."""
    widest: int = 3
    """Largest number of angles on each side of a hinge's angle."""
    max_violation: float = 0.1
    """Largest violation of a free-angle result that is rounded to the set [l_arm, m_t g, l_arm m_t g, rad]."""
    nearest: int = 4
    """Number of combinations nearest to a design that Ipopt solves from the design itself."""
    polish: PolishLimits = PolishLimits(stop_after=4, maximum=8)
    """Limits on the combinations that Ipopt makes exact, which may change their order slightly."""


SEARCH = SetSearch()


MAX_REDUCED, MAX_FULL = 4096, 48
"""Largest number of combinations solved for one tree by the compiled search, and by Ipopt."""

Combination = tuple[int, ...]
"""Index into the set for each hinge."""
Results = Sequence[StartResult]
Minimum = TypeVar("Minimum", Descent, StartResult)


@dataclass(frozen=True)
class _Solution(Generic[Minimum]):
    """Result of a solve with fixed hinges."""

    start: int
    combination: Combination
    rank: tuple[bool, float]
    """True if it is infeasible; its effort plus priced violations [rad^4/s^4]."""
    x: Array
    """Unknowns of the result; the first ones are those of a reduced search."""
    minimum: Minimum


Solve = Callable[[int, Array, Combination], _Solution[Minimum]]
"""Solves a combination for a start, from unknowns whose hinge angles are ignored."""


class _Set:
    """The allowed angles of the hinges of a tree, as folds, and the combinations whose modules are clear."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        self.hinges = topology.n - 1
        self._task, self._topology, self._signs = task, topology, signs(topology)
        self._clearances = list(module_clearances(task, topology))
        self._folds = np.array([fold for fold, _ in allowed_folds(task, task.search.margin)])

    def angles(self, combination: Combination) -> Array:
        """Return the hinge angles of a combination, shape (n-1,) [rad]."""
        return np.asarray(self._signs * self._folds[list(combination)])

    def neighbours(self, alpha: Array) -> list[Combination]:
        """Return clear combinations near angles alpha (n-1,), or all if they are few.

        A hinge takes one angle on each side of its own, or more if no such combination is clear. If none is, the
        nearest combination is moved until it is.
        """
        count = len(self._folds)
        if count**self.hinges <= SEARCH.complete_up_to:
            return self._clear(product(range(count), repeat=self.hinges))
        phi = self._signs * alpha
        above, distance = np.searchsorted(self._folds, phi), np.abs(self._folds[:, None] - phi)
        order = np.argsort(-distance.min(axis=0), kind="stable")
        for width in range(1, SEARCH.widest + 1):
            both_sides = order[: int(math.log(SEARCH.complete_up_to, 2 * width))]
            sides = [[fold] for fold in np.argmin(distance, axis=0).tolist()]
            for hinge in both_sides.tolist():
                sides[hinge] = list(range(max(0, above[hinge] - width), min(count, above[hinge] + width)))
            if combinations := self._clear(product(*sides)):
                return combinations
        return self._separate(tuple(np.argmin(distance, axis=0).tolist()))

    def _clear(self, combinations: Iterable[Combination]) -> list[Combination]:
        return [combination for combination in combinations if self._slack(combination) >= 0]

    def _slack(self, combination: Combination) -> float:
        """Return by how much the nearest modules exceed their smallest distance [m]."""
        origin, no_inputs = np.zeros(3), np.zeros((0, self._topology.n, 0))
        vectors = Point(self._task, self._topology, origin, self.angles(combination), origin, no_inputs).vectors
        slacks = (float(np.min(one.gaps(vectors) - one.margin, initial=math.inf)) for one in self._clearances)
        return min(slacks, default=math.inf)

    def _separate(self, combination: Combination) -> list[Combination]:
        """Return the clear combination that steepest ascent of the slack reaches; an empty list if none."""
        slack = self._slack(combination)
        while slack < 0:
            best = max(self._steps(combination, 2), key=self._slack)
            before, slack, combination = slack, self._slack(best), best
            if slack <= before:
                return []
        return [combination]

    def moves(self, combination: Combination, at_once: int) -> Iterator[Combination]:
        """Yield the clear combinations among `_steps`."""
        return (neighbour for neighbour in self._steps(combination, at_once) if self._slack(neighbour) >= 0)

    def _steps(self, combination: Combination, at_once: int) -> Iterator[Combination]:
        """Yield combinations with up to `at_once` hinges moved by one angle, or more if moves are few."""
        counts = accumulate(math.comb(self.hinges, k) * 2**k for k in range(1, self.hinges + 1))
        max_hinges = max(at_once, sum(count <= SEARCH.complete_up_to for count in counts))
        for hinges in (subset for k in range(1, max_hinges + 1) for subset in combinations(range(self.hinges), k)):
            for steps in product((-1, 1), repeat=len(hinges)):
                indices = np.array(combination)
                indices[list(hinges)] += steps
                if np.all((indices >= 0) & (indices < len(self._folds))):
                    yield tuple(indices.tolist())


def solve_on_set(
    task: ResolvedTask, topology: Topology, free: Results, constraints: UserConstraints, most_effort: float | None
) -> list[StartResult]:
    """Return the result of each start with hinge angles from the task's set, or if there is none, with free angles.

    With `most_effort` return every combination near free-angle optima up to that effort.

    Args:
        task: a task with a set of hinge angles, and with its corners.
        topology: the tree.
        free: results of the starts with free angles.
        constraints: the user's constraints, which only Ipopt sees.
        most_effort: largest effort of a combination [rad^4/s^4].
    """
    if most_effort is not None:
        numbered = [replace(result, start=k) for k, result in enumerate(free)]  # a start may have several results
        results, _ = near_optima(task, topology, numbered, constraints, most_effort)
        return [replace(result, start=free[result.start].start) for result in results]
    results, starts = near_optima(task, topology, free, constraints)
    by_start = {}
    for end in free:
        point = replace(end.point, task=task)
        unrounded = StartResult.from_point(end.start, point, end.result, end.corners, constraints)
        rounded = [replace(result, start=end.start) for result in results if end.start in starts[result.start]]
        by_start[end.start] = min([unrounded, *rounded], key=lambda result: result.rank)
    return list(by_start.values())


def near_optima(
    task: ResolvedTask,
    topology: Topology,
    free: Results,
    constraints: UserConstraints,
    most_effort: float | None = None,
) -> tuple[list[StartResult], dict[int, list[int]]]:
    """Return the best combinations near free-angle optima, or all up to an effort, and each optimum's starts."""
    rounded = [result for result in free if result.worst.scaled <= SEARCH.max_violation]
    optima: dict[int, StartResult] = {}
    starts: dict[int, list[int]] = {}
    for result in sorted(rounded, key=lambda result: result.objective):
        last = next(reversed(optima.values()), None)
        if last is None or result.objective - last.objective > SELECTION.same_merit_after * result.objective:
            optima[result.start], starts[result.start] = result, []
        starts[next(reversed(optima))].append(result.start)
    solve = _solve_full if reason_against(task) else _solve_reduced
    return solve(task, topology, list(optima.values()), constraints, most_effort), starts


def _search(
    angles: _Set, optima: Sequence[StartResult], solve: Solve[Minimum], max_solves: int, most_effort: float
) -> list[_Solution[Minimum]]:
    """Return the best solution of every combination that was solved, the best first.

    Args:
        angles: the set.
        optima: free-angle optima in order of effort.
        solve: solves a combination.
        max_solves: largest number of combinations to solve.
        most_effort: effort up to which neighbours of optima and combinations are tried even if a better combination
            is known [rad^4/s^4].
    """
    solutions: dict[Combination, _Solution[Minimum]] = {}
    solved = 0

    def attempt(start: int, x: Array, combination: Combination) -> _Solution[Minimum]:
        nonlocal solved
        solution, solved = solve(start, x, combination), solved + 1
        if combination not in solutions or solution.rank < solutions[combination].rank:
            solutions[combination] = solution
        return solution

    best: _Solution[Minimum] | None = None
    for optimum in optima:
        if best is not None and max(best.rank, (False, most_effort)) <= (False, optimum.objective):
            break
        for combination in islice(angles.neighbours(optimum.point.alpha), max(0, max_solves - solved)):
            solution = attempt(optimum.start, optimum.point.pack(), combination)
            if best is None or solution.rank < best.rank:
                best = solution
    tried = set[Combination]()
    while best is not None:
        current, best = best, None
        tried.add(current.combination)
        for combination in angles.moves(current.combination, 2):
            if combination not in tried and solved < max_solves:
                tried.add(combination)
                solution = attempt(current.start, current.x, combination)
                if solution.rank < current.rank:
                    best = solution
                    break
    cheap = [solution for solution in solutions.values() if solution.rank <= (False, most_effort)]
    for current in cheap:
        for combination in angles.moves(current.combination, 1):
            if combination not in solutions and solved < max_solves:
                solution = attempt(current.start, current.x, combination)
                if solution.rank <= (False, most_effort):
                    cheap.append(solution)
    return sorted(solutions.values(), key=lambda solution: (solution.rank, solution.combination))


def _solve_reduced(
    task: ResolvedTask, topology: Topology, optima: Results, constraints: UserConstraints, most_effort: float | None
) -> list[StartResult]:
    """Return the best combinations that the compiled search finds, made exact."""
    search, angles = ReducedSearch(task, topology, 0, constraints, most_effort), _Set(task, topology)
    problem, hinges = search.problem, slice(3, topology.n + 2)

    def solve(start: int, x: Array, combination: Combination) -> _Solution[Descent]:
        x, lower, upper = x[: len(problem.lower)].copy(), problem.lower.copy(), problem.upper.copy()
        for array in (x, lower, upper):
            array[hinges] = angles.angles(combination)
        ((minimum, *_), _) = local_minima(problem._replace(lower=lower, upper=upper), x[None])
        rank = minimum.violation > POLISHING.small_violation, search.effort_unit * minimum.merit
        return _Solution(start, combination, rank, minimum.x, replace(minimum, starts=(start,)))

    solutions = _search(angles, optima, solve, MAX_REDUCED, most_effort or 0.0)
    return list(search.polish([solution.minimum for solution in solutions], SEARCH.polish))


def _solve_full(
    task: ResolvedTask, topology: Topology, optima: Results, constraints: UserConstraints, most_effort: float | None
) -> list[StartResult]:
    """Return the best combinations that Ipopt finds."""
    angles, free = _Set(task, topology), {result.start: result for result in optima}

    def solve(start: int, x: Array, combination: Combination) -> _Solution[StartResult]:
        origin = replace(free[start].point, task=task, root=x[:3])
        result = _solve_from(origin, angles.angles(combination), free[start], constraints)
        return _Solution(start, combination, result.rank[:2], result.point.pack(), result)

    return [solution.minimum for solution in _search(angles, optima, solve, MAX_FULL, most_effort or 0.0)]


def solve_nearest(
    task: ResolvedTask, topology: Topology, optimum: StartResult, constraints: UserConstraints = ()
) -> list[StartResult]:
    """Return the results of Ipopt from an optimum with the clear combinations nearest to its angles."""
    angles, alpha, origin = _Set(task, topology), optimum.point.alpha, replace(optimum.point, task=task)
    nearby = [angles.angles(combination) for combination in angles.neighbours(alpha)]
    nearest = sorted(nearby, key=lambda turned: float(np.linalg.norm(turned - alpha)))[: SEARCH.nearest]
    return [_solve_from(origin, turned, optimum, constraints) for turned in nearest]


def _solve_from(origin: Point, alpha: Array, free: StartResult, constraints: UserConstraints) -> StartResult:
    """Return the result of Ipopt with fixed hinges from a point, with the corners of a free-angle optimum."""
    fitted = correct(replace(origin, alpha=alpha), refit=True)
    return solve_lazily(origin.task, free.start, with_some_corners(fitted, free.corners), constraints)

"""Depth first through the boxes of one chunk, against a fixed cut.

The record has a byte a box, in the order of the search, the lower half first: DUAL, a bound excludes it; SPLIT + a,
it is halved along angle a; CROWDED, two modules are too close everywhere in it. Which modules, or which
multipliers, whoever checks it finds for himself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp.bounds.branch import box, frames, multipliers, slopes, worst_vertex
from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.crowded import ALL_OVER, AT_MIDDLE, crowding
from nlp.bounds.branch.multipliers import copy
from nlp.bounds.branch.vertices import Vertices, blank_vertices
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

DUAL, CROWDED, SPLIT = 0, 1, 2
CLOSED, MANY, OPEN = 0, 1, 2
"""Outcomes of a search: all boxes excluded, too many boxes examined, or one found that cannot be excluded."""


class Branching(NamedTuple):
    """How boxes are halved, and how hard multipliers are searched for."""

    widest: float = 0.9
    """Width of a box that is halved without a bound [rad]."""
    least_width: float = 2e-4
    """A box narrower than this in all angles that is not excluded ends the search [rad]."""
    aspect: float = 2.0
    """Largest width of any angle, over that of the one that is split."""
    steps: int = 2
    """Newton steps for a box, from its parent's multipliers."""
    flattened: int = 2
    """Newton steps after those, for what D falls by towards its vertices."""
    fine: float = 0.5
    """Hinges are halved to this while two modules are too close at the middle and psi is whole [rad]."""
    narrow: float = 0.01
    """A box narrower than this in all angles is tried again from the start [rad]."""
    many_steps: int = 40
    """Newton steps of that second trial: a parent's multipliers may have been led astray."""
    ridge: float = 2.0
    """Ridge of multipliers of force, over n / 24 sum_a rho_a^2: how much D curves over the box."""
    levered: float = 10.0
    """Ridge of multipliers of torque, in that of force: levers are longer than l_arm."""
    least_square: float = 1e-4
    """Least sum_a rho_a^2 in a ridge [rad^2]."""
    enough: float = 1.3
    """Share of the cut at which the search for multipliers ends: where no balance can be met they have no end."""
    slope: float = 0.25
    """Weight of D's slope in the gain of a split, relative to the loss to remainders."""


BRANCHING = Branching()


class Boxes(NamedTuple):
    """Boxes that wait, the last one first, and what is known of them."""

    lower: Array
    """Least angles, shape (depth, A) [rad]."""
    upper: Array
    y: Array
    """Multipliers of the box that they are halves of, shape (depth, K, 6)."""
    sigma: Array
    bounded: NDArray[np.bool_]
    """True if that had a bound."""
    moved: NDArray[np.bool_]
    """True if it was halved along a hinge."""
    used: NDArray[np.bool_]
    """Load cases and corners that any box was excluded with, shape (K,)."""


class Workspace(NamedTuple):
    """Arrays for one box."""

    roots: Array
    """Root orientations at the middle and at the 8 vertices, shape (9, 3, 3)."""
    at: Array
    """Its middle, shape (A,) [rad]."""
    rho: Array
    """Its half widths."""
    gain: Array
    middle: frames.Frames
    axes: frames.Axes
    vertices: frames.Frames
    weightless: bool
    """True if some load case has no weight."""
    first: Array
    """Multipliers of parallel thrusts, shape (K, 6)."""
    y: Array
    sigma: Array
    search: multipliers.Workspace
    slopes: slopes.Slopes
    lifted: Vertices
    sums: box.Sums


class SearchResult(NamedTuple):
    """Result of a search."""

    how: int
    record: NDArray[np.uint8]
    lower: Array
    """The box that is not excluded, if it was for that."""
    upper: Array
    used: NDArray[np.bool_]
    """Load cases and corners that any box was excluded with, shape (K,)."""


@njit(cache=True)
def search(problem: BranchProblem, lower: Array, upper: Array, cut: float, most_boxes: int) -> SearchResult:
    """Exclude all of a box, or say where it cannot be done.

    Args:
        problem: the task and the tree.
        lower: least angles, shape (A,) [rad].
        upper: greatest angles.
        cut: in effort units.
        most_boxes: after which it is given up.
    """
    waiting, work = _boxes(problem, lower, upper), _workspace(problem)
    lo, hi, used, whole_rho = waiting.lower, waiting.upper, waiting.used, (upper[0] - lower[0]) / 2
    waiting.y[0] = work.first
    record, boxes, left = np.empty(1024, np.uint8), 0, 1
    while left > 0:
        left -= 1
        if boxes == most_boxes:
            return SearchResult(MANY, record[:boxes], lo[left].copy(), hi[left].copy(), used)
        what = _settle(problem, waiting, work, left, cut, whole_rho)
        if boxes == len(record):
            longer = np.empty(2 * boxes, np.uint8)
            longer[:boxes] = record
            record = longer
        record[boxes] = max(what, 0)
        boxes += 1
        if what < 0:
            return SearchResult(OPEN, record[:boxes], lo[left].copy(), hi[left].copy(), used)
        if what >= SPLIT:
            left += 2
    return SearchResult(CLOSED, record[:boxes], lower, upper, used)


@njit(cache=True)
def _boxes(problem: BranchProblem, lower: Array, upper: Array) -> Boxes:
    """Return the one box that waits at first."""
    K, A, W = len(problem.loads.f), len(lower), len(problem.walls.normal)
    depth = 64 * A
    waiting = Boxes(
        np.empty((depth, A)),
        np.empty((depth, A)),
        np.zeros((depth, K, 6)),
        np.zeros((depth, W)),
        np.zeros(depth, np.bool_),
        np.ones(depth, np.bool_),
        np.zeros(K, np.bool_),
    )
    waiting.lower[0], waiting.upper[0] = lower, upper
    return waiting


@njit(cache=True)
def _workspace(problem: BranchProblem) -> Workspace:
    """Return arrays for one box at a time."""
    n, K, A, W = (
        len(problem.tree.parent),
        len(problem.loads.f),
        len(problem.tree.parent) + 2,
        len(problem.walls.normal),
    )
    first = np.zeros((K, 6))
    for k in range(K):
        for l in range(3):
            first[k, l] = 8 * problem.loads.weight[k] * problem.loads.f[k, l] / n
    return Workspace(
        np.zeros((9, 3, 3)),
        np.zeros(A),
        np.zeros(A),
        np.zeros(A),
        frames.blank(n),
        frames.Axes(np.zeros((A, 3)), np.zeros((A, 3))),
        frames.blank(problem.tree.first[-1]),
        problem.loads.weight.min() == 0.0,
        first,
        np.zeros((K, 6)),
        np.zeros(W),
        multipliers.workspace(problem),
        slopes.blank(n, A),
        blank_vertices(problem),
        box.sums(problem),
    )


@njit(cache=True, allocates=False)
def _settle(
    problem: BranchProblem,
    waiting: Boxes,
    work: Workspace,
    left: int,
    cut: float,
    whole_rho: float,
) -> int:
    """Return what the record has for a box, or -1 if it ends the search; its halves take its place."""
    lo, hi, at, rho, sums = waiting.lower[left], waiting.upper[left], work.at, work.rho, work.sums
    lifted = len(work.sigma) > 0 or work.weightless
    for a in range(len(at)):
        at[a], rho[a] = (lo[a] + hi[a]) / 2, (hi[a] - lo[a]) / 2
    frames.at_middle(problem.tree, problem.l_c, at, work.middle, work.axes)
    frames.at_vertices(problem.tree, problem.l_c, lo, hi, work.vertices)
    axis = _widest_angle(rho)
    copy(waiting.y[left], work.y)
    for r in range(len(work.sigma)):
        work.sigma[r] = waiting.sigma[left, r]
    if waiting.moved[left]:
        where = crowding(problem, work.middle, work.axes, work.vertices, rho, work.gain)
        if where == ALL_OVER:
            return CROWDED
        if where == AT_MIDDLE and rho[0] == whole_rho:
            axis = max(axis, _hinge_between(rho, work.gain))
    bound_due = axis < 0
    if bound_due:
        _roots(lo, hi, at, work.roots)
        excluded = waiting.bounded[left] and _reaches(problem, work, cut)
        if not excluded:
            multipliers.wrenches(problem, work.roots[0], work.middle, work.search)
            excluded = _lift(problem, work, cut) if lifted else _search(problem, work, cut)
        if excluded:
            for k in range(len(work.y)):
                waiting.used[k] |= box.counts(problem, work.y, k)
            return DUAL
        if _width(rho) < BRANCHING.least_width:
            return -1
        box.gains(problem, work.y, work.roots[0], work.middle, work.axes, rho, sums)
        for a in range(len(rho)):
            if lifted:
                work.gain[a] = sums.spread[a] * worst_vertex.evenness(work.lifted, a)
            else:
                work.gain[a] = BRANCHING.slope * abs(sums.slope[a]) * rho[a] + sums.spread[a]
        axis = _worst(rho, work.gain)
    _halve(problem, waiting, work, left, axis, bound_due)
    return SPLIT + axis


@njit(cache=True, allocates=False)
def _halve(problem: BranchProblem, waiting: Boxes, work: Workspace, left: int, axis: int, bounded: bool) -> None:
    """Put the halves of a box in its place, the upper one below the other."""
    for a in range(len(work.at)):
        waiting.lower[left + 1, a], waiting.upper[left + 1, a] = waiting.lower[left, a], waiting.upper[left, a]
    for half in range(left, left + 2):
        copy(work.y, waiting.y[half])
        for r in range(len(work.sigma)):
            waiting.sigma[half, r] = work.sigma[r]
        waiting.bounded[half], waiting.moved[half] = bounded, axis >= 3
    end = begin = work.at[axis]
    if axis >= 3:
        end, begin = halves(problem.angles, waiting.lower[left, axis], waiting.upper[left, axis])
    waiting.lower[left, axis], waiting.upper[left + 1, axis] = begin, end


@njit(cache=True)
def halves(angles: Array, lower: float, upper: float) -> tuple[float, float]:
    """Return where the lower half of an interval of hinge angles ends, and where the upper one begins [rad].

    Both are at the middle if any angle will do; else at angles that hinges may have, or the upper half is empty and
    begins at infinity.
    """
    middle = (lower + upper) / 2
    if len(angles) == 0:
        return middle, middle
    after = np.searchsorted(angles, middle, side="right")
    if after == len(angles) or angles[after] > upper:
        return upper, math.inf
    return angles[after - 1], angles[after]


@njit(cache=True, allocates=False)
def _search(problem: BranchProblem, work: Workspace, cut: float) -> bool:
    """Return whether multipliers exclude a box; y, its parent's, becomes those tried last."""
    rho, y, newton = work.rho, work.y, work.search
    square = 0.0
    for a in range(len(rho)):
        square += rho[a] ** 2
    ridge = BRANCHING.ridge * len(work.middle.p) / 24 * max(square, BRANCHING.least_square)
    _set_ridge(newton, ridge)
    if multipliers.value(problem, newton, work.first) > multipliers.value(problem, newton, y):
        copy(work.first, y)
    multipliers.improve(problem, newton, y, BRANCHING.steps, BRANCHING.enough * cut)
    slopes.fill(problem, work.roots[0], work.middle, work.axes, newton, work.slopes)
    slopes.flatten(problem, newton, work.slopes, rho, y, BRANCHING.flattened, BRANCHING.enough * cut)
    if _reaches(problem, work, cut):
        return True
    if _width(rho) >= BRANCHING.narrow:
        return False
    _set_ridge(newton, ridge)
    copy(work.first, y)
    multipliers.improve(problem, newton, y, BRANCHING.many_steps, BRANCHING.enough * cut)
    return _reaches(problem, work, cut)


@njit(cache=True, allocates=False)
def _lift(problem: BranchProblem, work: Workspace, cut: float) -> bool:
    """Return whether multipliers of its worst vertex exclude a box; y, its parent's, become those tried last."""
    if _climb(problem, work, cut, worst_vertex.SEARCH.steps):
        return True
    if _width(work.rho) >= BRANCHING.narrow:
        return False
    copy(work.first, work.y)
    for r in range(len(work.sigma)):
        work.sigma[r] = 0.0
    return _climb(problem, work, cut, BRANCHING.many_steps)


@njit(cache=True, allocates=False)
def _climb(problem: BranchProblem, work: Workspace, cut: float, steps: int) -> bool:
    """Search from y, by `steps` a stage at most, for multipliers that exclude a box; return whether they do."""
    lifted = work.lifted
    worst_vertex.begin(problem, work.roots, work.vertices, work.rho, cut, work.y, work.sigma, lifted)
    for stage in range(worst_vertex.SEARCH.stages):
        least, most = worst_vertex.climb(problem, work.search, lifted, cut, stage, steps)
        copy(lifted.y, work.y)
        for r in range(len(work.sigma)):
            work.sigma[r] = lifted.sigma[r]
        worst_vertex.finish(problem, work.search, work.y, work.sigma)
        if most < cut:
            break
        if least > cut and _reaches(problem, work, cut):
            return True
    return _reaches(problem, work, cut)


@njit(cache=True, allocates=False)
def _width(rho: Array) -> float:
    width = 0.0
    for a in range(len(rho)):
        width = max(width, 2 * rho[a])
    return width


@njit(cache=True, allocates=False)
def _reaches(problem: BranchProblem, work: Workspace, cut: float) -> bool:
    """Return whether the bound of a box reaches the cut."""
    bound = box.bound(
        problem,
        work.y,
        work.sigma,
        work.roots,
        work.middle,
        work.axes,
        work.vertices,
        work.rho,
        work.sums,
        cut,
    )
    return bool(bound >= cut)


@njit(cache=True, allocates=False)
def _set_ridge(newton: multipliers.Workspace, ridge: float) -> None:
    for l in range(3):
        newton.ridge[l], newton.ridge[3 + l] = ridge, BRANCHING.levered * ridge


@njit(cache=True, allocates=False)
def _widest_angle(rho: Array) -> int:
    """Return the angle to halve in a box that is too wide for a bound, hinges first, or -1."""
    axis = 3
    for a in range(3, len(rho)):
        if rho[a] > rho[axis]:
            axis = a
    if axis < len(rho) and 2 * rho[axis] > BRANCHING.widest:
        return axis
    axis = 0
    for a in range(1, 3):
        if rho[a] > rho[axis]:
            axis = a
    return axis if 2 * rho[axis] > BRANCHING.widest else -1


@njit(cache=True, allocates=False)
def _hinge_between(rho: Array, gain: Array) -> int:
    """Return the hinge that keeps two modules from being too close all over a box, or -1 if all are narrow."""
    axis, most = -1, -1.0
    for a in range(3, len(rho)):
        if 2 * rho[a] > BRANCHING.fine and gain[a] > most:
            axis, most = a, gain[a]
    return axis


@njit(cache=True, allocates=False)
def _worst(rho: Array, gain: Array) -> int:
    """Return the angle whose halves may gain the most, of those that are not far narrower than others."""
    least, axis, most = 0.0, 0, -math.inf
    for a in range(len(rho)):
        least = max(least, rho[a] / BRANCHING.aspect)
    for a in range(len(rho)):
        if rho[a] > least and gain[a] > most:
            axis, most = a, gain[a]
    return axis


@njit(cache=True, allocates=False)
def _roots(lower: Array, upper: Array, middle: Array, roots: Array) -> None:
    """Fill the root orientations at the middle and at the 8 vertices."""
    frames.root_frame(middle[0], middle[1], middle[2], roots[0])
    for v in range(8):
        psi = upper[0] if v & 4 else lower[0]
        alpha_0 = upper[1] if v & 2 else lower[1]
        alpha_1 = upper[2] if v & 1 else lower[2]
        frames.root_frame(psi, alpha_0, alpha_1, roots[1 + v])

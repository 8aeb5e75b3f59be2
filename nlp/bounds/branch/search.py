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
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

DUAL, CROWDED, SPLIT = 0, 1, 2
CLOSED, MANY, OPEN = 0, 1, 2
"""Outcomes of a search: all boxes excluded, too many boxes examined, or one found that cannot be excluded."""
WIDEST = 0.9
"""Boxes wider than this are halved without a bound [rad]."""
LEAST_WIDTH = 2e-4
"""A box narrower than this in all angles that is not excluded ends the search [rad]."""
ASPECT = 4.0
"""Largest width of any angle, over that of the one that is split."""
STEPS = 2
"""Newton steps for a box, from its parent's multipliers,"""
FLATTENED = 2
"""and then for what D falls by towards its vertices."""
FINE = 0.5
"""Hinges are halved to this while two modules are too close at the middle and psi is whole [rad]."""
NARROW = 0.01
"""A box narrower than this in all angles is tried again from the start [rad],"""
MANY_STEPS = 40
"""by so many steps: a parent's multipliers may have been led astray."""
RIDGE = 2.0
"""Ridge of the search for multipliers of force, over n / 24 sum_a rho_a^2: how much D curves over the box."""
LEVERED = 10.0
"""That of multipliers of torque, in it: levers are longer than l_arm."""
LEAST_SQUARE = 1e-4
"""That sum_a rho_a^2 counts as [rad^2]."""
ENOUGH = 1.3
"""Share of the cut at which the search for multipliers ends: where no balance can be met they have no end."""
SLOPE = 0.5
"""Weight of D's slope in the gain of a split, relative to the loss to remainders."""


class BoxFrames(NamedTuple):
    """Frames from which a box is bounded."""

    roots: Array
    """Root orientations at the middle and at the 8 vertices, shape (9, 3, 3)."""
    middle: frames.Frames
    axes: frames.Axes
    vertices: frames.Frames


class Found(NamedTuple):
    """Result of a search."""

    how: int
    record: NDArray[np.uint8]
    lower: Array
    """The box that is not excluded, if it was for that."""
    upper: Array
    used: NDArray[np.bool_]
    """Load cases and corners that any box was excluded with, shape (K,)."""


@njit(cache=True)
def search(problem: BranchProblem, lower: Array, upper: Array, cut: float, most_boxes: int) -> Found:
    """Exclude all of a box, or say where it cannot be done.

    Args:
        problem: the task and the tree.
        lower: least angles, shape (A,) [rad].
        upper: greatest angles.
        cut: in effort units.
        most_boxes: after which it is given up.
    """
    n, K, A, W = len(problem.tree.parent), len(problem.loads.f), len(lower), len(problem.walls.normal)
    depth = 64 * A
    lo, hi = np.empty((depth, A)), np.empty((depth, A))
    guesses, pressed, bounded = np.zeros((depth, K, 6)), np.zeros((depth, W)), np.zeros(depth, np.bool_)
    moved = np.ones(depth, np.bool_)
    lo[0], hi[0] = lower, upper
    first = np.zeros((K, 6))
    for k in range(K):  # that of parallel thrusts
        for l in range(3):
            first[k, l] = 8 * problem.loads.weight[k] * problem.loads.f[k, l] / n
    guesses[0] = first
    vertices, middle = frames.blank(problem.tree.first[-1]), frames.blank(n)
    axes = frames.Axes(np.zeros((A, 3)), np.zeros((A, 3)))
    at_box = BoxFrames(np.zeros((9, 3, 3)), middle, axes, vertices)
    work, flat, sums = multipliers.workspace(problem), slopes.blank(n, A), box.sums(problem)
    lifted = worst_vertex.blank(problem)
    gain, whole_rho, used = np.zeros(A), (upper[0] - lower[0]) / 2, np.zeros(K, np.bool_)
    record, boxes, left, y, sigma = np.empty(1024, np.uint8), 0, 1, np.zeros((K, 6)), np.zeros(W)
    while left > 0:
        if boxes == most_boxes:
            return Found(MANY, record[:boxes], lo[left - 1].copy(), hi[left - 1].copy(), used)
        if boxes == len(record):
            longer = np.empty(2 * boxes, np.uint8)
            longer[:boxes] = record
            record = longer
        left -= 1
        at, rho = (lo[left] + hi[left]) / 2, (hi[left] - lo[left]) / 2
        frames.at_middle(problem.tree, problem.l_c, at, middle, axes)
        frames.at_vertices(problem.tree, problem.l_c, lo[left], hi[left], vertices)
        boxes += 1
        axis = _widest_angle(rho)
        if moved[left]:
            where = crowding(problem, middle, axes, vertices, rho, gain)
            if where == ALL_OVER:
                record[boxes - 1] = CROWDED
                continue
            if where == AT_MIDDLE and rho[0] == whole_rho:
                axis = max(axis, _hinge_between(rho, gain))
        bound_due = axis < 0
        if bound_due:
            y[:], sigma[:] = guesses[left], pressed[left]
            _roots(lo[left], hi[left], at, at_box.roots)
            if _is_excluded(problem, at_box, rho, cut, first, bounded[left], y, sigma, work, flat, lifted, sums):
                record[boxes - 1] = DUAL
                for k in range(K):
                    used[k] |= np.any(y[k] != 0.0)
                continue
            if 2 * rho.max() < LEAST_WIDTH:
                return Found(OPEN, record[:boxes], lo[left].copy(), hi[left].copy(), used)
            axis = _worst(rho, sums.slope, sums.spread)
        record[boxes - 1] = SPLIT + axis
        lo[left + 1], hi[left + 1] = lo[left], hi[left]
        for half in range(left, left + 2):
            guesses[half], pressed[half] = y, sigma
        bounded[left] = bounded[left + 1] = bound_due
        moved[left] = moved[left + 1] = axis >= 3
        end, begin = at[axis], at[axis]
        if axis >= 3:
            end, begin = halves(problem.angles, lo[left, axis], hi[left, axis])
        lo[left, axis] = begin  # the upper half waits
        hi[left + 1, axis] = end
        left += 2
    return Found(CLOSED, record[:boxes], lower, upper, used)


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


@njit(cache=True, inline="always")
def _is_excluded(
    problem: BranchProblem,
    at_box: BoxFrames,
    rho: Array,
    cut: float,
    first: Array,
    inherited: bool,
    y: Array,
    sigma: Array,
    work: multipliers.Workspace,
    flat: slopes.Slopes,
    lifted: worst_vertex.Vertices,
    sums: box.Sums,
) -> bool:
    """Return whether multipliers exclude a box; y and sigma, its parent's if inherited, become those tried last."""
    roots, middle, axes, vertices = at_box
    if inherited and box.bound(problem, y, sigma, roots, middle, axes, vertices, rho, sums, cut) >= cut:
        return True
    multipliers.wrenches(problem, roots[0], middle, work)
    if len(sigma) > 0 or problem.loads.weight.min() == 0.0:
        worst_vertex.search_from_start(problem, roots, vertices, rho, cut, first, work, lifted)
        y[:], sigma[:] = lifted.y, lifted.sigma
        return bool(box.bound(problem, y, sigma, roots, middle, axes, vertices, rho, sums, cut) >= cut)
    ridge = RIDGE * len(middle.p) / 24 * max((rho**2).sum(), LEAST_SQUARE)
    work.ridge[:3], work.ridge[3:] = ridge, LEVERED * ridge
    if multipliers.value(problem, work, first) > multipliers.value(problem, work, y):
        y[:] = first
    multipliers.improve(problem, work, y, STEPS, ENOUGH * cut)
    if box.bound(problem, y, sigma, roots, middle, axes, vertices, rho, sums, cut) >= cut:
        return True
    slopes.fill(problem, roots[0], middle, axes, work, flat)
    slopes.flatten(problem, work, flat, rho, y, FLATTENED, ENOUGH * cut)
    if box.bound(problem, y, sigma, roots, middle, axes, vertices, rho, sums, cut) >= cut:
        return True
    if 2 * rho.max() >= NARROW:
        return False
    work.ridge[:3], work.ridge[3:] = ridge, LEVERED * ridge
    y[:] = first
    multipliers.improve(problem, work, y, MANY_STEPS, ENOUGH * cut)
    return bool(box.bound(problem, y, sigma, roots, middle, axes, vertices, rho, sums, cut) >= cut)


@njit(cache=True)
def _widest_angle(rho: Array) -> int:
    """Return the angle to halve in a box that is too wide for a bound, hinges first, or -1."""
    axis = 3
    for a in range(3, len(rho)):
        if rho[a] > rho[axis]:
            axis = a
    if axis < len(rho) and 2 * rho[axis] > WIDEST:
        return axis
    axis = 0
    for a in range(1, 3):
        if rho[a] > rho[axis]:
            axis = a
    return axis if 2 * rho[axis] > WIDEST else -1


@njit(cache=True)
def _hinge_between(rho: Array, gain: Array) -> int:
    """Return the hinge that keeps two modules from being too close all over a box, or -1 if all are narrow."""
    axis, most = -1, -1.0
    for a in range(3, len(rho)):
        if 2 * rho[a] > FINE and gain[a] > most:
            axis, most = a, gain[a]
    return axis


@njit(cache=True)
def _worst(rho: Array, slope: Array, spread: Array) -> int:
    """Return the angle whose halves may gain the most."""
    least, axis, most = rho.max() / ASPECT, 0, -math.inf
    for a in range(len(rho)):
        gain = SLOPE * abs(slope[a]) * rho[a] + spread[a]
        if rho[a] > least and gain > most:
            axis, most = a, gain
    return axis


@njit(cache=True)
def _roots(lower: Array, upper: Array, middle: Array, roots: Array) -> None:
    """Fill the root orientations at the middle and at the 8 vertices."""
    frames.root_frame(middle[0], middle[1], middle[2], roots[0])
    for v in range(8):
        psi = upper[0] if v & 4 else lower[0]
        alpha_0 = upper[1] if v & 2 else lower[1]
        alpha_1 = upper[2] if v & 1 else lower[2]
        frames.root_frame(psi, alpha_0, alpha_1, roots[1 + v])

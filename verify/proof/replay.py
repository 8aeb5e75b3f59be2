"""Goes through the record of a chunk, box by box, and finds a reason of its own for every box that it drops.

A record names no multipliers and no modules: those are found here. Where they do not do for a box, it is halved
here, and its halves are looked at; a box that is not settled so ends the replay.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.model.compiled_code import njit
from verify.bodies import Array
from verify.proof import arcs, ascent, dual
from verify.proof.arcs import Frames
from verify.proof.nearness import are_too_near
from verify.proof.platform import Numbers, angles_around
from verify.proof.points import Points, fill_point, fill_turns, workspace

BOUND, CROWDED, HALVED = 0, 1, 2
"""Meaning of a byte for a box (`topo_search.model.proof`); HALVED + a: along angle a."""
HELD, ENDS_EARLY, GOES_ON, NO_SUCH_ANGLE, TOO_DEEP, NOT_BOUNDED, NOT_CROWDED = range(7)
"""Outcomes of a replay."""
DEEPEST = 64
"""No angle is halved more often: doubles have no more digits."""
FIRST_STEPS = 8
"""Newton steps from the multipliers of the box before."""
PROMISING = 1.01
"""Share of the cut at which those end."""
MOST_EXTRA = 4000
"""Largest number of boxes that one box of the record is cut into here."""


class Replayed(NamedTuple):
    """Result of a replay."""

    how: int
    position: int
    """Position of the byte at which it ended."""
    extra: int
    """Number of boxes halved here."""
    lower: Array
    """The box that it ended at."""
    upper: Array


class Workspace(NamedTuple):
    """Arrays for one box."""

    corners: Array
    points: Array
    """(c, s) of the middle, shape (A, 1, 2)."""
    frames: Frames
    at_middle: Frames
    middle: Points
    vertices: Points
    sums: dual.Sums
    y: Array
    """The multipliers of the box before."""
    sigma: Array
    """And those of walls."""
    start: Array
    """The multipliers of parallel thrust."""
    open_air: Array
    """No walls, shape (W,)."""
    pair: NDArray[np.int64]


@njit(cache=True)
def replay(numbers: Numbers, lower: Array, upper: Array, cut: float, record: NDArray[np.uint8]) -> Replayed:
    """Check that a record leaves no part of a box in which a design costs less than a cut.

    Args:
        numbers: the task and the tree.
        lower: least angles, shape (A,) [rad].
        upper: greatest angles.
        cut: [lambda_max u_max^2].
        record: a byte a box, depth first, the lower half before the upper one.
    """
    A = len(lower)
    work, rho = _workspace(numbers), np.zeros(A)
    lo, hi = np.empty((DEEPEST * A + 2, A)), np.empty((DEEPEST * A + 2, A))
    lo[0], hi[0] = lower, upper
    waiting, extra = 1, 0
    for position in range(len(record)):
        if waiting == 0:
            return Replayed(GOES_ON, position, extra, lower, upper)
        waiting -= 1
        what = record[position]
        if what >= HALVED:
            a = what - HALVED
            if a >= A or not lo[waiting, a] < hi[waiting, a]:
                return Replayed(NO_SUCH_ANGLE, position, extra, lo[waiting].copy(), hi[waiting].copy())
            if waiting + 2 > DEEPEST * A:
                return Replayed(TOO_DEEP, position, extra, lo[waiting].copy(), hi[waiting].copy())
            _halve(numbers, lo, hi, waiting, a)
            waiting += 2
            continue
        base, used = waiting, 0
        waiting += 1
        while waiting > base:
            waiting -= 1
            rho[:] = (hi[waiting] - lo[waiting]) / 2
            a = _settle(numbers, what, lo[waiting], hi[waiting], rho, cut, work)
            if a < 0:
                continue
            used += 1
            if used > MOST_EXTRA or waiting + 2 > DEEPEST * A or rho[a] < 1e-9:
                how = NOT_CROWDED if what == CROWDED else NOT_BOUNDED
                return Replayed(how, position, extra + used, lo[waiting].copy(), hi[waiting].copy())
            _halve(numbers, lo, hi, waiting, a)
            waiting += 2
        extra += used
    if waiting > 0:
        return Replayed(ENDS_EARLY, len(record), extra, lo[waiting - 1].copy(), hi[waiting - 1].copy())
    return Replayed(HELD, len(record), extra, lower, upper)


@njit(cache=True, inline="always")
def _workspace(numbers: Numbers) -> Workspace:
    A, K = len(numbers.parent) + 2, len(numbers.f)
    frames, at_middle = arcs.frame_arrays(numbers, 3), arcs.frame_arrays(numbers, 1)
    start, open_air = np.zeros((K, 6)), np.zeros(len(numbers.normal))
    for k in range(K):  # n modules, four rotors each, all in parallel with the force: t = 2 lambda u
        start[k, :3] = 2 * numbers.weight[k] * numbers.f[k] / (4 * len(numbers.parent))
    return Workspace(
        np.zeros((A, 3, 2)),
        np.zeros((A, 1, 2)),
        frames,
        at_middle,
        workspace(numbers, 1, A),
        workspace(numbers, 2**A, 0),
        dual.sums(numbers, len(frames.p)),
        start.copy(),
        open_air.copy(),
        start,
        open_air,
        np.zeros(2, np.int64),
    )


@njit(cache=True)
def _halve(numbers: Numbers, lo: Array, hi: Array, at: int, a: int) -> None:
    """Put the two halves of a box in its place, the lower one on top; with a set they begin and end in it."""
    below = beyond = (lo[at, a] + hi[at, a]) / 2
    if a >= 3:
        below, beyond = angles_around(numbers.angles, below)
    lo[at + 1], hi[at + 1] = lo[at], hi[at]
    lo[at, a], hi[at + 1, a] = beyond, below


@njit(cache=True, inline="always")
def _settle(
    numbers: Numbers, what: int, lower: Array, upper: Array, rho: Array, cut: float, work: Workspace
) -> int:
    """Return -1 if a box can be dropped for the reason that is given for it, else the angle to halve it along."""
    widest, first = -1, 0 if what == BOUND else 3
    for a in range(first, len(rho)):
        if 2 * rho[a] > arcs.WIDEST and (widest < 0 or rho[a] > rho[widest]):
            widest = a
    if widest >= 0:
        return widest
    arcs.fill_corners(lower, upper, first, work.corners)
    for a in range(len(rho)):
        middle = (lower[a] + upper[a]) / 2
        work.points[a, 0, 0], work.points[a, 0, 1] = math.cos(middle), math.sin(middle)
    arcs.fill_frames(numbers, work.points, 1, work.at_middle)
    if what == CROWDED:
        if are_too_near(numbers, work.corners, work.at_middle, work.pair):
            return -1
        return _hinge_between(numbers, rho, work.pair[0], work.pair[1])
    middle, vertices, y, sigma = work.middle, work.vertices, work.y, work.sigma
    fill_point(numbers, work.points, work.at_middle, middle, 0)
    fill_turns(numbers, work.points, work.at_middle, rho, middle)
    ascent.begin(numbers, middle, rho, cut)
    if not ascent.value(numbers, middle, y, sigma, cut) > ascent.value(
        numbers, middle, work.start, work.open_air, cut
    ):
        y[:], sigma[:] = work.start, work.open_air
    enough, most = PROMISING * cut, ascent.ASCENT.most * cut
    ascent.climb(numbers, middle, y, sigma, cut, enough, most, FIRST_STEPS)
    if ascent.leave(numbers, middle, y, sigma):
        ascent.climb(numbers, middle, y, sigma, cut, enough, most, FIRST_STEPS)
    arcs.fill_frames(numbers, work.corners, 3, work.frames)
    if dual.bound(numbers, y, sigma, work.corners, work.frames, work.sums) >= cut:
        return -1
    axis = _steepest(numbers, work, rho)
    for v in range(len(vertices.D)):
        for a in range(len(rho)):
            work.points[a, 0] = work.corners[a, v >> a & 1]
        arcs.fill_frames(numbers, work.points, 1, work.at_middle)
        fill_point(numbers, work.points, work.at_middle, vertices, v)
    ascent.begin(numbers, vertices, rho, cut)
    y[:], sigma[:] = work.start, work.open_air
    ascent.lift(numbers, vertices, y, sigma, cut)
    if dual.bound(numbers, y, sigma, work.corners, work.frames, work.sums) >= cut:
        return -1
    y[:], sigma[:] = work.start, work.open_air
    return axis


@njit(cache=True)
def _hinge_between(numbers: Numbers, rho: Array, i: int, j: int) -> int:
    """Return the widest hinge between two modules."""
    axis = max(i, j) + 2
    while i != j:
        if i < j:
            i, j = j, i
        if rho[i + 2] > rho[axis]:
            axis = i + 2
        i = numbers.parent[i]
    return axis


@njit(cache=True)
def _steepest(numbers: Numbers, work: Workspace, rho: Array) -> int:
    """Return the angle that changes the bound the most, once slopes are filled."""
    at, turning = work.middle, work.middle.turning
    curve = np.zeros(len(rho))
    for k in range(len(work.y)):
        for j in range(at.a.shape[1]):
            t = (at.a[0, j] * work.y[k]).sum()
            u = min(max(t / (2 * at.weight[k]), numbers.u_min), 1.0)
            for angle in range(len(rho)):
                if turning.turned[angle, j // 4]:
                    change = (turning.change[angle, j] * work.y[k]).sum()
                    curve[angle] += change * change / (4 * at.weight[k]) + u * abs(t)
    axis, most = 0, -1.0
    for a in range(len(rho)):
        gain = abs(turning.slope[a]) * rho[a] / 2 + curve[a] * rho[a] ** 2
        if gain > most:
            axis, most = a, gain
    return axis

"""Replay of the record of a chunk, box by box, with an independent reason to exclude every box.

A record names neither multipliers nor modules: both are found here. If they do not exclude a box, it is halved
further here; the replay ends at a box that cannot be excluded this way either.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.compiled_code import njit
from topo_search.model import Array, Indices
from verify.proof import arcs, ascent, dual
from verify.proof.arcs import ArcFrames
from verify.proof.crowded import find_crowded_pair
from verify.proof.platform import ROTORS, CheckProblem, angles_around
from verify.proof.points import Points, empty_points, fill_point, fill_slopes

BOUND, CROWDED, SPLIT = 0, 1, 2
"""Meaning of the byte of a box (`topo_search.model.proof`); SPLIT + a: halved along angle a."""
VALID, TOO_SHORT, TOO_LONG, INVALID_ANGLE, TOO_DEEP, NOT_BOUNDED, NOT_CROWDED = range(7)
"""Outcomes of a replay."""
MAX_DEPTH = 64
"""Largest number of halvings of an angle: doubles have no more digits."""
STEPS = 8
"""Newton steps from the multipliers of the previous box."""
TARGET = 1.01
"""Value at which the search at the middle ends, over the cut."""
MAX_HALVED = 4000
"""Largest number of halvings within one box of the record."""


class Replayed(NamedTuple):
    """Result of a replay."""

    outcome: int
    position: int
    """Index of the byte at which the replay ended."""
    halved: int
    """Number of boxes halved beyond the record."""
    lower: Array
    """Least angles of the box at which the replay ended."""
    upper: Array


class ReplayWorkspace(NamedTuple):
    """Arrays for one box."""

    triangles: Array
    """Triangles of all angles, shape (A, 3, 2)."""
    middle_pairs: Array
    """(c, s) of the middle or of a vertex, shape (A, 1, 2)."""
    frames: ArcFrames
    """Frames for all combinations of triangle vertices of the hinges."""
    middle_frames: ArcFrames
    middle: Points
    vertices: Points
    bound: dual.DualWorkspace
    y: Array
    """Multipliers of the previous box, shape (K, 6)."""
    sigma: Array
    initial_y: Array
    """Multipliers of parallel thrust axes, shape (K, 6)."""
    initial_sigma: Array
    """Zeros, shape (W,)."""
    module_pair: Indices
    """Modules that were crowded in the previous box, shape (2,)."""


@njit(cache=True)
def replay(problem: CheckProblem, lower: Array, upper: Array, cut: float, record: NDArray[np.uint8]) -> Replayed:
    """Check that a record excludes all of a box: no design in it costs less than a cut.

    Args:
        problem: task and tree.
        lower: least angles, shape (A,) [rad].
        upper: greatest angles, shape (A,) [rad].
        cut: effort [lambda_max u_max^2].
        record: one byte per box, depth first, the lower half before the upper one.
    """
    A = len(lower)
    workspace, rho = _box_workspace(problem, lower[0] < upper[0]), np.zeros(A)
    lo, hi = np.empty((MAX_DEPTH * A + 2, A)), np.empty((MAX_DEPTH * A + 2, A))
    lo[0], hi[0] = lower, upper
    top, halved = 1, 0
    for position in range(len(record)):
        if top == 0:
            return Replayed(TOO_LONG, position, halved, lower, upper)
        top -= 1
        code = record[position]
        if code >= SPLIT:
            a = code - SPLIT
            if a >= A or not lo[top, a] < hi[top, a]:
                return Replayed(INVALID_ANGLE, position, halved, lo[top].copy(), hi[top].copy())
            if top + 2 > MAX_DEPTH * A:
                return Replayed(TOO_DEEP, position, halved, lo[top].copy(), hi[top].copy())
            _halve(problem, lo, hi, top, a)
            top += 2
            continue
        base, halved_here = top, 0
        top += 1
        while top > base:
            top -= 1
            rho[:] = (hi[top] - lo[top]) / 2
            a = _process_box(problem, code, lo[top], hi[top], rho, cut, workspace)
            if a < 0:
                continue
            halved_here += 1
            if halved_here > MAX_HALVED or top + 2 > MAX_DEPTH * A or rho[a] < 1e-9:
                outcome = NOT_CROWDED if code == CROWDED else NOT_BOUNDED
                return Replayed(outcome, position, halved + halved_here, lo[top].copy(), hi[top].copy())
            _halve(problem, lo, hi, top, a)
            top += 2
        halved += halved_here
    if top > 0:
        return Replayed(TOO_SHORT, len(record), halved, lo[top - 1].copy(), hi[top - 1].copy())
    return Replayed(VALID, len(record), halved, lower, upper)


@njit(cache=True, inner=True, inline="always")
def _box_workspace(problem: CheckProblem, turns: bool) -> ReplayWorkspace:
    """Return arrays for boxes with an interval of psi (`turns`), or with a single psi."""
    A, K = len(problem.parent) + 2, len(problem.f)
    frames, middle_frames = arcs.empty_frames(problem, 3), arcs.empty_frames(problem, 1)
    initial_y, initial_sigma = np.zeros((K, 6)), np.zeros(len(problem.wall_normal))
    for k in range(K):  # all rotors parallel to the force: t = 2 lambda u
        weight = problem.weight[k] if problem.weight.max() > 0.0 else 1.0 / K
        initial_y[k, :3] = 2 * weight * problem.f[k] / (ROTORS * len(problem.parent))
    return ReplayWorkspace(
        np.zeros((A, 3, 2)),
        np.zeros((A, 1, 2)),
        frames,
        middle_frames,
        empty_points(problem, 1, A),
        empty_points(problem, 2**A if turns else 2 ** (A - 1), 0),
        dual.bound_workspace(problem, len(frames.p), 27 if turns else 9),
        initial_y.copy(),
        initial_sigma.copy(),
        initial_y,
        initial_sigma,
        np.zeros(2, np.int64),
    )


@njit(cache=True, inner=True)
def _halve(problem: CheckProblem, lo: Array, hi: Array, top: int, a: int) -> None:
    """Replace the top box with its halves, the lower one on top, with limits from the set of hinge angles."""
    lower_end = upper_begin = (lo[top, a] + hi[top, a]) / 2
    if a >= 3:
        lower_end, upper_begin = angles_around(problem.hinge_angles, lower_end)
    lo[top + 1], hi[top + 1] = lo[top], hi[top]
    lo[top, a], hi[top + 1, a] = upper_begin, lower_end


@njit(cache=True, inner=True, inline="always")
def _process_box(
    problem: CheckProblem, code: int, lower: Array, upper: Array, rho: Array, cut: float, workspace: ReplayWorkspace
) -> int:
    """Return -1 if the reason given by the record excludes the box, else the angle to halve."""
    wide_axis, first_angle = -1, 0 if code == BOUND else 3
    for a in range(first_angle, len(rho)):
        if 2 * rho[a] > arcs.MAX_WIDTH and (wide_axis < 0 or rho[a] > rho[wide_axis]):
            wide_axis = a
    if wide_axis >= 0:
        return wide_axis
    arcs.fill_triangles(lower, upper, first_angle, workspace.triangles)
    for a in range(len(rho)):
        middle = (lower[a] + upper[a]) / 2
        workspace.middle_pairs[a, 0, 0], workspace.middle_pairs[a, 0, 1] = math.cos(middle), math.sin(middle)
    arcs.fill_frames(problem, workspace.middle_pairs, 1, workspace.middle_frames)
    if code == CROWDED:
        if find_crowded_pair(problem, workspace.triangles, workspace.middle_frames, workspace.module_pair):
            return -1
        return _crowded_hinge(problem, rho, workspace.module_pair[0], workspace.module_pair[1])
    A, vertices, y, sigma = len(rho), workspace.vertices, workspace.y, workspace.sigma
    counts = problem.weight.max() > 0.0
    if counts:  # else D at the middle grows without limit with the multipliers
        _maximize_at_middle(problem, rho, cut, workspace)
    arcs.fill_frames(problem, workspace.triangles, 3, workspace.frames)
    if dual.bound(problem, y, sigma, workspace.triangles, workspace.frames, workspace.bound) >= cut:
        return -1
    axis = _split_axis(problem, workspace, rho) if counts else int(np.argmax(rho))
    for v in range(len(vertices.D)):
        for a in range(len(rho)):
            workspace.middle_pairs[a, 0] = workspace.triangles[a, v >> (a + A - 1) % A & 1]  # psi has the last bit
        arcs.fill_frames(problem, workspace.middle_pairs, 1, workspace.middle_frames)
        fill_point(problem, workspace.middle_pairs, workspace.middle_frames, vertices, v)
    ascent.start(problem, vertices, rho, cut)
    y[:], sigma[:] = workspace.initial_y, workspace.initial_sigma
    ascent.maximize_at_vertices(problem, vertices, y, sigma, cut)
    if dual.bound(problem, y, sigma, workspace.triangles, workspace.frames, workspace.bound) >= cut:
        return -1
    y[:], sigma[:] = workspace.initial_y, workspace.initial_sigma
    return axis


@njit(cache=True, inner=True)
def _maximize_at_middle(problem: CheckProblem, rho: Array, cut: float, workspace: ReplayWorkspace) -> None:
    """Improve the multipliers of the previous box, or the initial ones, at the middle of a box."""
    middle, y, sigma = workspace.middle, workspace.y, workspace.sigma
    fill_point(problem, workspace.middle_pairs, workspace.middle_frames, middle, 0)
    fill_slopes(problem, workspace.middle_pairs, workspace.middle_frames, rho, middle)
    ascent.start(problem, middle, rho, cut)
    previous = ascent.smoothed_value(problem, middle, y, sigma, cut)
    initial = ascent.smoothed_value(problem, middle, workspace.initial_y, workspace.initial_sigma, cut)
    if not previous > initial:
        y[:], sigma[:] = workspace.initial_y, workspace.initial_sigma
    target, limit = TARGET * cut, ascent.ASCENT.stage_target * cut
    ascent.maximize(problem, middle, y, sigma, cut, target, limit, STEPS)
    if ascent.drop_idle_cases(problem, middle, y, sigma):
        ascent.maximize(problem, middle, y, sigma, cut, target, limit, STEPS)


@njit(cache=True, inner=True)
def _crowded_hinge(problem: CheckProblem, rho: Array, i: int, j: int) -> int:
    """Return the widest hinge on the path between two modules."""
    axis = max(i, j) + 2
    while i != j:
        if i < j:
            i, j = j, i
        if rho[i + 2] > rho[axis]:
            axis = i + 2
        i = problem.parent[i]
    return axis


@njit(cache=True, inner=True)
def _split_axis(problem: CheckProblem, workspace: ReplayWorkspace, rho: Array) -> int:
    """Return the angle with the largest effect on the bound, after the slopes are filled."""
    points, slopes = workspace.middle, workspace.middle.slopes
    curvature = np.zeros(len(rho))
    for k in range(len(workspace.y)):
        for j in range(points.a.shape[1]):
            t = (points.a[0, j] * workspace.y[k]).sum()
            u = min(max(t / (2 * points.weight[k]), problem.u_min), 1.0)
            for angle in range(len(rho)):
                if slopes.is_turned[angle, j // ROTORS]:
                    slope = (slopes.beta[angle, j] * workspace.y[k]).sum()
                    curvature[angle] += slope * slope / (4 * points.weight[k]) + u * abs(t)
    axis, largest_gain = 0, -1.0
    for a in range(len(rho)):
        gain = abs(slopes.g[a]) * rho[a] / 2 + curvature[a] * rho[a] ** 2
        if gain > largest_gain:
            axis, largest_gain = a, gain
    return axis

"""Depth-first search through the boxes of one chunk, against a fixed cut.

The record has one byte per box, in the order of the search, the lower half first. BOUND: a bound excludes the box;
CROWDED: two modules are too close everywhere in it; SPLIT + a: it is halved along angle a. The record names neither
modules nor multipliers: a checker finds its own.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp.bounds.branch import box, frames, multipliers, slopes, worst_vertex
from nlp.bounds.branch.arrays import BranchProblem
from nlp.bounds.branch.crowded import AT_MIDDLE, EVERYWHERE, crowding
from nlp.bounds.branch.multipliers import copy
from nlp.bounds.branch.vertices import VertexWorkspace, vertex_workspace
from nlp.numbers import cholesky, kinematics
from topo_search.compiled_code import njit, refresh
from topo_search.model import Array, Flags

BOUND, CROWDED, SPLIT = 0, 1, 2
CLOSED, BOX_LIMIT, STUCK = 0, 1, 2
"""Outcomes of a search: all boxes excluded, the limit on boxes reached, or a smallest box that is not excluded."""


class Branching(NamedTuple):
    """Settings of the splitting of boxes and of the search for multipliers."""

    max_bound_width: float = 0.9
    """Largest width of a box that is bounded; a wider one is halved at once [rad]."""
    min_width: float = 2e-4
    """Width of a smallest box: one narrower than this in all angles ends the search if not excluded [rad]."""
    max_aspect: float = 2.0
    """Largest ratio of the box's width to that of the angle that is split."""
    steps: int = 2
    """Newton steps per box, from its parent's multipliers."""
    flattening_steps: int = 2
    """Newton steps after those, which make D flatter towards the vertices."""
    crowded_width: float = 0.5
    """Width to which hinges are halved first while modules are crowded at the middle and psi is unsplit [rad]."""
    retry_width: float = 0.01
    """A box narrower than this in all angles is tried again from the initial multipliers [rad]."""
    retry_steps: int = 40
    """Newton steps of that second trial: a parent's multipliers may be a poor start."""
    ridge: float = 2.0
    """Ridge of multipliers of force, over n / 24 sum_a rho_a^2, for the curvature of D over the box."""
    torque_ridge: float = 10.0
    """Ridge of multipliers of torque over that of force: levers are longer than l_arm."""
    min_square: float = 1e-4
    """Least sum_a rho_a^2 in a ridge [rad^2]."""
    target: float = 1.3
    """D at which the search for multipliers ends, over the cut: they grow without limit if no balance exists."""
    slope_weight: float = 0.25
    """Weight of D's slope in the gain of a split, relative to the loss to remainders."""


BRANCHING = Branching()


class BoxStack(NamedTuple):
    """Stack of open boxes, the last one next."""

    lower: Array
    """Least angles, shape (depth, A) [rad]."""
    upper: Array
    y: Array
    """Multipliers of the parent box, shape (depth, K, 6)."""
    sigma: Array
    has_bound: Flags
    """True if the parent was bounded."""
    hinge_halved: Flags
    """True if the parent was halved along a hinge."""
    active_cases: Flags
    """Load cases and corners whose multipliers exclude some box, shape (K,)."""


class BoxWorkspace(NamedTuple):
    """Arrays for one box."""

    box: frames.BoxFrames
    gain: Array
    """Expected gain of halving each angle, shape (A,)."""
    weightless: bool
    """True if some load case has no weight."""
    initial_y: Array
    """Multipliers of parallel thrust axes, shape (K, 6)."""
    y: Array
    sigma: Array
    newton: multipliers.NewtonWorkspace
    slopes: slopes.Slopes
    vertex_search: VertexWorkspace
    bound: box.BoundWorkspace


class SearchResult(NamedTuple):
    """Result of a search."""

    outcome: int
    record: NDArray[np.uint8]
    lower: Array
    """Least angles of the box at which the search ended."""
    upper: Array
    active_cases: Flags
    """Load cases and corners whose multipliers exclude some box, shape (K,)."""


@njit(cache=True)
def search(problem: BranchProblem, lower: Array, upper: Array, cut: float, most_boxes: int) -> SearchResult:
    """Exclude a whole box of angles, or return the part where that failed.

    Args:
        problem: task and tree.
        lower: least angles, shape (A,) [rad].
        upper: greatest angles, shape (A,) [rad].
        cut: effort that every design in the box must be shown to exceed [effort units].
        most_boxes: limit on the number of boxes.
    """
    stack = _initial_stack(problem, lower, upper)
    workspace = _box_workspace(problem, 8 if lower[0] < upper[0] else 4)
    lo, hi, active_cases, whole_rho = stack.lower, stack.upper, stack.active_cases, (upper[0] - lower[0]) / 2
    stack.y[0] = workspace.initial_y
    record, boxes, top = np.empty(1024, np.uint8), 0, 1
    while top > 0:
        top -= 1
        if boxes == most_boxes:
            return SearchResult(BOX_LIMIT, record[:boxes], lo[top].copy(), hi[top].copy(), active_cases)
        code = _process_box(problem, stack, workspace, top, cut, whole_rho)
        if boxes == len(record):
            longer = np.empty(2 * boxes, np.uint8)
            longer[:boxes] = record
            record = longer
        record[boxes] = max(code, 0)
        boxes += 1
        if code < 0:
            return SearchResult(STUCK, record[:boxes], lo[top].copy(), hi[top].copy(), active_cases)
        if code >= SPLIT:
            top += 2
    return SearchResult(CLOSED, record[:boxes], lower, upper, active_cases)


@njit(cache=True, inner=True)
def _initial_stack(problem: BranchProblem, lower: Array, upper: Array) -> BoxStack:
    """Return the stack with the whole box on it."""
    K, A, W = len(problem.loads.f), len(lower), len(problem.walls.normal)
    depth = 64 * A
    stack = BoxStack(
        np.empty((depth, A)),
        np.empty((depth, A)),
        np.zeros((depth, K, 6)),
        np.zeros((depth, W)),
        np.zeros(depth, np.bool_),
        np.ones(depth, np.bool_),
        np.zeros(K, np.bool_),
    )
    stack.lower[0], stack.upper[0] = lower, upper
    return stack


@njit(cache=True, inner=True)
def _box_workspace(problem: BranchProblem, roots: int) -> BoxWorkspace:
    n, K, initial_y = len(problem.tree.parent), len(problem.loads.f), np.zeros((len(problem.loads.f), 6))
    for k in range(K):
        for l in range(3):
            initial_y[k, l] = 8 * problem.loads.weight[k] * problem.loads.f[k, l] / n
    return BoxWorkspace(
        frames.empty_box(problem.tree, roots),
        np.zeros(n + 2),
        problem.loads.weight.min() == 0.0,
        initial_y,
        np.zeros((K, 6)),
        np.zeros(len(problem.walls.normal)),
        multipliers.newton_workspace(problem),
        slopes.empty_slopes(n, n + 2),
        vertex_workspace(problem, roots),
        box.bound_workspace(problem, roots),
    )


@njit(cache=True, inner=True, allocates=False)
def _process_box(
    problem: BranchProblem, stack: BoxStack, workspace: BoxWorkspace, top: int, cut: float, whole_rho: float
) -> int:
    """Exclude or halve the top box; return its byte of the record, or -1 if it is too small to be halved."""
    lo, hi, rho, bound = stack.lower[top], stack.upper[top], workspace.box.rho, workspace.bound
    uses_vertices = len(workspace.sigma) > 0 or workspace.weightless
    frames.fill_box(problem.tree, problem.l_c, lo, hi, workspace.box)
    axis = _widest_angle(rho)
    copy(stack.y[top], workspace.y)
    for r in range(len(workspace.sigma)):
        workspace.sigma[r] = stack.sigma[top, r]
    if stack.hinge_halved[top]:
        where = crowding(problem, workspace.box, workspace.gain)
        if where == EVERYWHERE:
            return CROWDED
        if where == AT_MIDDLE and rho[0] == whole_rho:
            axis = max(axis, _crowded_hinge(rho, workspace.gain))
    needs_bound = axis < 0
    if needs_bound:
        frames.fill_roots(lo, hi, workspace.box)
        excluded = stack.has_bound[top] and _is_excluded(problem, workspace, cut)
        if not excluded:
            multipliers.fill_wrenches(problem, workspace.box, workspace.newton)
            if uses_vertices:
                excluded = _exclude_at_vertices(problem, workspace, cut)
            else:
                excluded = _exclude_at_middle(problem, workspace, cut)
        if excluded:
            for k in range(len(workspace.y)):
                stack.active_cases[k] |= box.is_active(problem, workspace.y, k)
            return BOUND
        if _max_width(rho) < BRANCHING.min_width:
            return -1
        box.add_rotor_gains(problem, workspace.y, workspace.box, bound)
        for a in range(len(rho)):
            if uses_vertices:
                workspace.gain[a] = bound.loss[a] * worst_vertex.evenness(workspace.vertex_search, a)
            else:
                workspace.gain[a] = BRANCHING.slope_weight * abs(bound.slope[a]) * rho[a] + bound.loss[a]
        axis = _split_axis(rho, workspace.gain)
    _halve(problem, stack, workspace, top, axis, needs_bound)
    return SPLIT + axis


@njit(cache=True, inner=True, allocates=False)
def _halve(
    problem: BranchProblem, stack: BoxStack, workspace: BoxWorkspace, top: int, axis: int, has_bound: bool
) -> None:
    """Replace the top box with its halves, the lower one on top."""
    for a in range(len(workspace.gain)):
        stack.lower[top + 1, a], stack.upper[top + 1, a] = stack.lower[top, a], stack.upper[top, a]
    for half in range(top, top + 2):
        copy(workspace.y, stack.y[half])
        for r in range(len(workspace.sigma)):
            stack.sigma[half, r] = workspace.sigma[r]
        stack.has_bound[half], stack.hinge_halved[half] = has_bound, axis >= 3
    lower_end = upper_begin = workspace.box.centre[axis]
    if axis >= 3:
        lower_end, upper_begin = halves(problem.hinge_angles, stack.lower[top, axis], stack.upper[top, axis])
    stack.lower[top, axis], stack.upper[top + 1, axis] = upper_begin, lower_end


@njit(cache=True)
def halves(angles: Array, lower: float, upper: float) -> tuple[float, float]:
    """Return the end of the lower half of an interval of hinge angles, and the beginning of the upper half [rad].

    Both are the middle without a set of hinge angles. With a set, they are angles of it; an empty upper half begins
    at infinity.
    """
    middle = (lower + upper) / 2
    if len(angles) == 0:
        return middle, middle
    index = np.searchsorted(angles, middle, side="right")
    if index == len(angles) or angles[index] > upper:
        return upper, math.inf
    return angles[index - 1], angles[index]


@njit(cache=True, inner=True, allocates=False)
def _exclude_at_middle(problem: BranchProblem, workspace: BoxWorkspace, cut: float) -> bool:
    """Improve y, the parent's multipliers, at the middle of a box; return whether they exclude the box."""
    rho, y, newton = workspace.box.rho, workspace.y, workspace.newton
    square = 0.0
    for a in range(len(rho)):
        square += rho[a] ** 2
    ridge = BRANCHING.ridge * len(problem.tree.parent) / 24 * max(square, BRANCHING.min_square)
    _set_ridge(newton, ridge)
    if multipliers.dual_value(problem, newton, workspace.initial_y) > multipliers.dual_value(problem, newton, y):
        copy(workspace.initial_y, y)
    multipliers.maximize(problem, newton, y, BRANCHING.steps, BRANCHING.target * cut)
    slopes.fill(problem, workspace.box, newton, workspace.slopes)
    slopes.flatten(problem, newton, workspace.slopes, rho, y, BRANCHING.flattening_steps, BRANCHING.target * cut)
    if _is_excluded(problem, workspace, cut):
        return True
    if _max_width(rho) >= BRANCHING.retry_width:
        return False
    _set_ridge(newton, ridge)
    copy(workspace.initial_y, y)
    multipliers.maximize(problem, newton, y, BRANCHING.retry_steps, BRANCHING.target * cut)
    return _is_excluded(problem, workspace, cut)


@njit(cache=True, inner=True, allocates=False)
def _exclude_at_vertices(problem: BranchProblem, workspace: BoxWorkspace, cut: float) -> bool:
    """Improve y and sigma, the parent's, at the worst vertex of a box; return whether they exclude the box."""
    if _maximize_at_vertices(problem, workspace, cut, worst_vertex.SEARCH.steps):
        return True
    if _max_width(workspace.box.rho) >= BRANCHING.retry_width:
        return False
    copy(workspace.initial_y, workspace.y)
    workspace.sigma[:] = 0.0
    return _maximize_at_vertices(problem, workspace, cut, BRANCHING.retry_steps)


@njit(cache=True, inner=True, allocates=False)
def _maximize_at_vertices(problem: BranchProblem, workspace: BoxWorkspace, cut: float, steps: int) -> bool:
    """Run the search at the worst vertex, `steps` a stage; return whether y and sigma exclude the box."""
    vertex_search, y, sigma = workspace.vertex_search, workspace.y, workspace.sigma
    worst_vertex.start(problem, workspace.box, cut, y, sigma, vertex_search)
    for stage in range(worst_vertex.SEARCH.stages):
        minimum, limit = worst_vertex.maximize(problem, workspace.newton, vertex_search, cut, stage, steps)
        copy(vertex_search.y, y)
        for r in range(len(sigma)):
            sigma[r] = vertex_search.sigma[r]
        worst_vertex.finish(problem, workspace.newton, y, sigma)
        if limit < cut:
            break
        if minimum > cut and _is_excluded(problem, workspace, cut):
            return True
    return _is_excluded(problem, workspace, cut)


@njit(cache=True, inner=True, allocates=False)
def _max_width(rho: Array) -> float:
    return float(2 * rho.max())


@njit(cache=True, inner=True, allocates=False)
def _is_excluded(problem: BranchProblem, workspace: BoxWorkspace, cut: float) -> bool:
    return bool(box.bound(problem, workspace.y, workspace.sigma, workspace.box, workspace.bound, cut) >= cut)


@njit(cache=True, inner=True, allocates=False)
def _set_ridge(newton: multipliers.NewtonWorkspace, ridge: float) -> None:
    for l in range(3):
        newton.ridge[l], newton.ridge[3 + l] = ridge, BRANCHING.torque_ridge * ridge


@njit(cache=True, inner=True, allocates=False)
def _widest_angle(rho: Array) -> int:
    """Return the angle to halve in a box that is too wide for a bound, hinges first; -1 if it is not too wide."""
    if len(rho) > 3:
        hinge = 3 + int(np.argmax(rho[3:]))
        if 2 * rho[hinge] > BRANCHING.max_bound_width:
            return hinge
    axis = int(np.argmax(rho[:3]))
    return axis if 2 * rho[axis] > BRANCHING.max_bound_width else -1


@njit(cache=True, inner=True, allocates=False)
def _crowded_hinge(rho: Array, gain: Array) -> int:
    """Return the hinge whose halves are most likely to be crowded everywhere, or -1 if all are narrow."""
    axis, largest_gain = -1, -1.0
    for a in range(3, len(rho)):
        if 2 * rho[a] > BRANCHING.crowded_width and gain[a] > largest_gain:
            axis, largest_gain = a, gain[a]
    return axis


@njit(cache=True, inner=True, allocates=False)
def _split_axis(rho: Array, gain: Array) -> int:
    """Return the angle with the largest gain, without those that are much narrower than others.

    After an overflow no gain is a number; the widest angle is split then, as one split forever overruns the stack.
    """
    widest = axis = int(np.argmax(rho))
    largest_gain = -math.inf
    for a in range(len(rho)):
        if rho[a] > rho[widest] / BRANCHING.max_aspect and gain[a] > largest_gain:
            axis, largest_gain = a, gain[a]
    return axis


refresh(search, Path(__file__).parent, Path(cholesky.__file__), Path(kinematics.__file__))

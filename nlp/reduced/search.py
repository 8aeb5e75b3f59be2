"""Descents of one topology from many starts, each a single random point here, and their local minima.

All starts descend at low prices of residuals and of missing clearance. After a few steps the worse half is stopped
(a rung of successive halving: Jamieson and Talwalkar, AISTATS 2016). Minima of equal merit are merged, and only the
best continue at high prices, with multipliers: they end close to minima of the printed problem.

A corner is a load case that must be possible and costs nothing. With a dead rotor, or around a reserve, there are
hundreds. Few of them are active, so a descent adds only those that its point violates; a corner that the rotors can
already produce has almost no gradient.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nlp.numbers.point import Point, fixed_end_effector
from nlp.reduced.arrays import ReducedProblem
from nlp.reduced.descent import DescentPhase, Evaluation, descend, estimates, evaluate, merit
from nlp.reduced.inputs import find_wrench, inertia, inputs, rotor_wrenches
from nlp.reduced.platform import platform
from nlp.units import Units
from topo_search.compiled_code import njit
from topo_search.model import Array, Flags, ResolvedTask, Topology


class CornerSettings(NamedTuple):
    """Settings of adding corners to a descent."""

    tolerance: float = 1e-6
    """Residual above which a corner is violated [m_t g, l_arm m_t g]."""
    at_once: int = 8
    """Largest number of corners added at once, no two of one set."""
    rounds: int = 3
    """Largest number of times that a round continues with corners violated at its end."""
    max_violation: float = 0.2
    """Largest violation, without corners, of a minimum whose corners are checked [l_arm, m_t g, l_arm m_t g]."""


CORNERS = CornerSettings()


@njit(cache=True)
def add_corners(problem: ReducedProblem, point: Evaluation, rho: float) -> tuple[Flags, float]:
    """Return the active load cases plus the most violated corners, and the largest residual of a corner.

    Args:
        problem: the task and topology.
        point: the point that is checked.
        rho: price of residuals.
    """
    if point.active.all():
        return point.active, 0.0
    cases, pose = problem.cases, platform(problem, point.x)
    K, A = len(cases.weight), rotor_wrenches(problem, pose)
    active, residuals = point.active.copy(), np.zeros(K)
    J = inertia(problem.rotors, pose)
    w, mu, u, set_of_mu = np.empty(6), np.zeros(6), np.empty(len(A)), -1
    for k in range(K):
        if active[k]:
            continue
        if cases.group[k] != set_of_mu:  # a warm start: corners of one set have similar inputs
            mu[:] = 0.0
            set_of_mu = cases.group[k]
        find_wrench(problem, pose, J, k, w)
        inputs(problem, A, k, w, rho, mu, u)
        for a in range(6):
            residuals[k] = max(residuals[k], abs(mu[a]) * cases.weight[k] / (2 * rho))
    worst, full = residuals.max(), np.zeros(cases.group.max() + 2, np.bool_)
    for _ in range(CORNERS.at_once):
        largest = -1
        for k in range(K):
            is_candidate = residuals[k] > CORNERS.tolerance and not full[cases.group[k]]
            if is_candidate and (largest < 0 or residuals[k] > residuals[largest]):
                largest = k
        if largest < 0:
            break
        active[largest] = full[cases.group[largest]] = True
    return active, worst


FIRST = DescentPhase(rho=300.0, sigma=30.0, rounds=1, steps=40, tolerance=1e-5)
SECOND = DescentPhase(rho=1e4, sigma=100.0, rounds=4, steps=15, tolerance=1e-7)
STIFF = FIRST._replace(sigma=3000.0), SECOND._replace(sigma=3000.0)
"""Both phases with clearance priced above any effort: low prices lead to cheap platforms with small violations, and
may pull a feasible platform back there."""


class Selection(NamedTuple):
    """Which starts and minima continue."""

    same_merit: float = 1e-5
    """Relative difference in merit below which two local minima of the first phase are merged."""
    same_merit_after: float = 1e-4
    """The same after the second phase."""
    share: float = 0.1
    """Number of minima that continue, the best first, as a share of the starts.

    Of 24 trees of eight modules on push all 22 designs are within 0.1 % of the best known effort, of 40 of seven 36
    of 37, with 0.1 as with 0.2; with 0.06 one more of seven modules is not, by 2.7 %.
    """
    min_minima: int = 3
    """Smallest number of distinct minima that continue."""
    halving_step: int = 8
    """Step after which the worse half of the starts is stopped."""
    min_starts: int = 64
    """Smallest number of starts that continue; this many or fewer are not halved.

    On push with seven and eight modules 160 starts, halved, reach about as many of the best known efforts as 128
    that are not, in 0.9 of the CPU time.
    """
    min_starts_in_air: int = 48
    """The same with limits on air speed, whose rows cost more.

    Over a box below three hovering modules at 2 m/s the mean effort of 15 searches (five seeds of three trees) is
    1.43 of the bound with 48 as with 64; with 32 it is 1.59.
    """


SELECTION = Selection()


@dataclass(frozen=True)
class Descent:
    """State of a descent; at its end a local minimum."""

    starts: tuple[int, ...]
    """Indices of the starts that reached it, the best one first."""
    x: Array
    """The unknowns."""
    active: Flags
    """The active load cases, shape (K,)."""
    mu: Array
    """Their dual unknowns, shape (K, 6)."""
    B: Array
    """Curvature of the Lagrangian, shape (N, N); zero before the first step."""
    merit: float = 0.0
    """Effort, as in the printed problem's objective, plus the priced violations."""
    violation: float = 0.0
    """Largest missing clearance [l_arm] or residual of a wrench [m_t g, l_arm m_t g]."""

    @classmethod
    def from_start(cls, starts: tuple[int, ...], x: Array, active: Flags) -> Descent:
        """Return a descent before its first step."""
        return cls(starts, x, active, np.zeros((len(active), 6)), np.zeros((len(x), len(x))))


def local_minima(
    problem: ReducedProblem,
    starts: Array,
    phases: tuple[DescentPhase, DescentPhase] = (FIRST, SECOND),
    *,
    min_minima: int = SELECTION.min_minima,
    min_starts: int = SELECTION.min_starts,
) -> tuple[list[Descent], list[Descent]]:
    """Return the best distinct local minima of the starts, by merit, and those that did not continue to phase two.

    Args:
        problem: the task and topology.
        starts: unknowns, shape (starts, N).
        phases: settings of the first and the second descent.
        min_minima: smallest number of distinct minima that continue, if there are that many.
        min_starts: smallest number of starts that remain when the worse half is stopped.
    """
    descents = [Descent.from_start((s,), x, problem.cases.group < 0) for s, x in enumerate(starts)]
    stopped, (first, second) = list[Descent](), phases
    if len(descents) > min_starts:
        few_steps, half = first._replace(steps=SELECTION.halving_step), max(min_starts, len(descents) // 2)
        ordered = _by_merit([_descend(problem, descent, few_steps) for descent in descents])
        descents, stopped = ordered[:half], merge(ordered[half:], SELECTION.same_merit)
        first = first._replace(steps=first.steps - SELECTION.halving_step)
    minima = merge(_by_merit([_descend(problem, descent, first) for descent in descents]), SELECTION.same_merit)
    count = max(min_minima, math.ceil(SELECTION.share * len(starts)))
    best = [Descent.from_start(minimum.starts, minimum.x, minimum.active) for minimum in minima[:count]]
    ends = [_descend(problem, descent, second) for descent in best]
    return merge(_by_merit(ends), SELECTION.same_merit_after), minima[count:] + stopped


def _by_merit(descents: list[Descent]) -> list[Descent]:
    return [descents[k] for k in np.argsort([descent.merit for descent in descents], kind="stable")]


def merge(descents: Iterable[Descent], same_merit: float) -> list[Descent]:
    """Return descents, in order of merit, with those of equal merit merged."""
    merged: list[Descent] = []
    for descent in descents:
        if merged and descent.merit - merged[-1].merit <= same_merit * abs(descent.merit):
            merged[-1] = replace(merged[-1], starts=tuple(dict.fromkeys(merged[-1].starts + descent.starts)))
        else:
            merged.append(descent)
    return merged


def point_of(task: ResolvedTask, topology: Topology, problem: ReducedProblem, minimum: Descent) -> Point:
    """Return a local minimum as a point, with the inputs of the second phase.

    Args:
        task: the task with the active corners of the minimum, and no others.
        topology: the tree.
        problem: the task and topology with all corners.
        minimum: the local minimum.
    """
    n, x = topology.n, minimum.x
    u = evaluate(problem, x, np.zeros((len(minimum.active), 6)), minimum.active, SECOND.rho).u
    root, alpha, unit = x[:3].copy(), x[3 : n + 2].copy(), Units.of(task)
    free = task.end_effector.fixed_position is None
    tip = x[n + 2 :] * unit.length if free else fixed_end_effector(task, topology, root, alpha)
    return Point(
        task,
        topology,
        root,
        alpha,
        tip,
        u[minimum.active].reshape(-1, n, task.rotors_per_module) * unit.input,
    )


def _descend(problem: ReducedProblem, descent: Descent, phase: DescentPhase) -> Descent:
    """Run one phase of a descent, which keeps its curvature."""
    x, mu, active, B = descent.x, descent.mu, descent.active, descent.B.copy()
    lower, unmet, rounds = problem.rows.lower, 0.0, phase.rounds
    multipliers = np.zeros(len(lower))
    has_corners = bool((problem.cases.group >= 0).any())
    if has_corners:  # corners are added after each round
        phase = phase._replace(rounds=1)
    for k in range(0, rounds, phase.rounds):
        point = descend(problem, x, mu, active, multipliers, B, phase)
        for _ in range(CORNERS.rounds if has_corners else 0):
            if violation(problem, point, phase.rho) > CORNERS.max_violation:
                break
            more, unmet = add_corners(problem, point, phase.rho)
            if unmet <= CORNERS.tolerance:
                break
            point = descend(problem, point.x, point.mu, more, multipliers, B, phase)
        x, mu, active = point.x, point.mu, point.active
        if k + phase.rounds < rounds:
            multipliers = estimates(point.g, lower, multipliers, phase.sigma)
    if unmet > CORNERS.tolerance:
        _, unmet = add_corners(problem, point, phase.rho)
    value = merit(point.V, point.g, lower, multipliers, phase.sigma)
    return Descent(descent.starts, x, active, mu, B, value, max(unmet, violation(problem, point, phase.rho)))


def violation(problem: ReducedProblem, point: Evaluation, rho: float) -> float:
    """Return the largest missing clearance or residual of an active load case."""
    residuals = np.abs(point.mu).max(axis=1) * problem.cases.weight / (2 * rho)  # the residual is mu / rho'
    missing = (problem.rows.lower - point.g).max(initial=0.0)
    return float(residuals.max(initial=missing, where=point.active))

"""Many cheap starts of one topology, and where they end.

All starts descend at low prices of residuals and of missing clearance; after a few steps the worse half is given up
(a rung of successive halving: Jamieson and Talwalkar, AISTATS 2016). Minima of one merit are one; only the best of
them descend on at high prices, with multipliers: what they reach is next to a minimum of the printed problem.

Selection of corners: few of them bind, so a descent takes in only those that it finds missed.

A corner is a load case that must be possible and costs nothing. With a rotor dead, or around a reserve, there are
hundreds; those that inputs within their limits produce have next to no gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nlp.numbers.point import Point, fixed_end_effector
from nlp.reduced.arrays import Indices, Mask, ReducedProblem
from nlp.reduced.descent import Evaluated, descend, estimates, evaluate, merit
from nlp.reduced.inputs import columns, effort, find_wrench, inertia, inputs
from nlp.reduced.platform import platform
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class CornerRounds(NamedTuple):
    """How corners are taken in, and where a descent begins."""

    missed: float = 1e-6
    """Residual from which a corner counts [m_t g, l_arm m_t g]."""
    at_once: int = 8
    """Largest number of corners taken in at once, no two of one set."""
    rounds: int = 3
    """Continuations of a round with corners that were missed at its end."""
    most_missed: float = 0.2
    """Largest violation, without corners, of a minimum that is evaluated with them [l_arm, m_t g, l_arm m_t g]."""
    least_curvature: float = 0.1
    """Initial curvature of the Lagrangian; more where the first slope is steep, so that a step is a radian."""


CORNERS = CornerRounds()


@njit(cache=True)
def initial_cases(problem: ReducedProblem) -> Mask:
    """Return which load cases count from the start, shape (K,)."""
    counting: Mask = problem.cases.group < 0
    return counting


@njit(cache=True)
def take_in(problem: ReducedProblem, at: Evaluated, rho: float) -> tuple[Mask, float]:
    """Return the load cases that count with the corners that are missed most, and by how much those are at most.

    Args:
        problem: the task and topology.
        at: where to look.
        rho: price of residuals.
    """
    if at.counting.all():
        return at.counting, 0.0
    cases, there = problem.cases, platform(problem, at.x)
    K, A = len(cases.effort), columns(problem, there)
    counting, residuals = at.counting.copy(), np.zeros(K)
    J = inertia(problem.rotors, there)
    w, mu, u, last = np.empty(6), np.zeros(6), np.empty(len(A)), -1
    for k in range(K):
        if counting[k]:
            continue
        if cases.group[k] != last:  # corners of one set have much the same inputs
            mu[:] = 0.0
            last = cases.group[k]
        find_wrench(problem, there, J, k, w)
        inputs(problem, A, k, w, rho, mu, u)
        for a in range(6):
            residuals[k] = max(residuals[k], abs(mu[a]) * cases.effort[k] / (2 * rho))
    worst, full = residuals.max(), np.zeros(cases.group.max() + 2, np.bool_)
    for _ in range(CORNERS.at_once):
        best = -1
        for k in range(K):
            if (
                residuals[k] > CORNERS.missed
                and not full[cases.group[k]]
                and (best < 0 or residuals[k] > residuals[best])
            ):
                best = k
        if best < 0:
            break
        counting[best] = full[cases.group[best]] = True
    return counting, worst


class Phase(NamedTuple):
    """Settings of a descent."""

    rho: float
    """Price of the wrenches' squared residuals."""
    sigma: float
    """Price of missing clearance."""
    rounds: int
    """Number of rounds, each with new multipliers."""
    steps: int
    """Largest number of steps per round."""
    enough: float
    """Decrease of the merit, over one more than it, of a step that is the last one of its round."""


FIRST = Phase(rho=300.0, sigma=30.0, rounds=1, steps=40, enough=1e-5)
SECOND = Phase(rho=1e4, sigma=100.0, rounds=4, steps=15, enough=1e-7)
STIFF = FIRST._replace(sigma=3000.0), SECOND._replace(sigma=3000.0)
"""Both phases where clearance counts for more than any effort: low prices lead to where some cheap platform misses
little, and may pull those back that miss nothing."""


class Selection(NamedTuple):
    """Which starts and minima go on."""

    same: float = 1e-5
    """Local minima of the first phase whose merits agree so far, relatively, are one."""
    same_after: float = 1e-4
    """Those of the second."""
    kept: float = 0.1
    """Share of the starts whose minima go on, the best ones first.

    Of 24 trees of eight modules on push all 22 designs are within 0.1 % of the best known effort, of 40 of seven 36
    of 37, with 0.1 as with 0.2; with 0.06 one more of seven modules is not, by 2.7 %.
    """
    least_kept: int = 3
    """Fewest distinct minima that go on."""
    halved_after: int = 8
    """Steps after which the worse half of the starts is given up."""
    least_halved: int = 64
    """Fewest starts that are left; so many or fewer all go on.

    On push with seven and eight modules 160 draws, halved, reach about as many of the best known efforts as 128
    that all go on, in 0.9 of the CPU time.
    """
    least_halved_in_air: int = 48
    """The same where air is limited, whose rows cost more.

    Over a box below three hovering modules at 2 m/s the mean effort of 15 searches (five seeds of three trees) is
    1.43 of the bound as with 64, with 32 it is 1.59.
    """


SELECTION = Selection()


class Descents(NamedTuple):
    """State of the starts."""

    x: Array
    """Unknowns, shape (s, N)."""
    counting: Mask
    """The load cases that count, shape (s, K)."""
    mu: Array
    """Their dual unknowns, shape (s, K, 6)."""
    B: Array
    """Curvature of the Lagrangians, shape (s, N, N); zero before the first step."""
    merit: Array
    """Shape (s,)."""
    missing: Array
    """As of an end, shape (s,)."""

    def of(self, places: Indices) -> Descents:
        """Return those at some places."""
        x, counting, mu, B, merit, missing = self
        return Descents(x[places], counting[places], mu[places], B[places], merit[places], missing[places])


@dataclass(frozen=True)
class LocalMinimum:
    """Point where some starts ended."""

    x: Array
    """The unknowns."""
    merit: float
    """Effort, as in the printed problem's objective, and the prices of what is missing."""
    missing: float
    """Largest missing clearance [l_arm] or residual of a wrench [m_t g, l_arm m_t g]."""
    starts: tuple[int, ...]
    """Places of the starts that ended here, the best one first."""
    counting: Mask
    """The load cases that counted, shape (K,)."""


def local_minima(
    problem: ReducedProblem,
    starts: Array,
    phases: tuple[Phase, Phase] = (FIRST, SECOND),
    *,
    least: int = SELECTION.least_kept,
    least_halved: int = SELECTION.least_halved,
) -> tuple[list[LocalMinimum], list[LocalMinimum]]:
    """Return the best distinct local minima of starts, by merit, and those of the first phase that did not go on.

    Args:
        problem: the task and topology.
        starts: unknowns, shape (starts, N).
        phases: how they descend.
        least: fewest distinct minima that go on, if there are as many.
        least_halved: fewest starts that are left when the worse half is given up.
    """
    begun = begin(starts, np.repeat(initial_cases(problem)[None], len(starts), axis=0))
    first, given_up = _halve(problem, begun, phases[0], least_halved)
    count = max(least, math.ceil(SELECTION.kept * len(starts)))
    kept = first[:count]
    again = begin(np.array([end.x for end in kept]), np.array([end.counting for end in kept]))
    second = descend_all(problem, again, phases[1])
    return _one_of_each(second, [end.starts for end in kept], SELECTION.same_after), first[count:] + given_up


def _halve(
    problem: ReducedProblem, begun: Descents, phase: Phase, least: int
) -> tuple[list[LocalMinimum], list[LocalMinimum]]:
    """Return the distinct minima of the better starts, and where the others were given up."""
    left, given_up = np.arange(len(begun.x)), list[LocalMinimum]()
    if len(left) > least:
        begun = descend_all(problem, begun, phase._replace(steps=SELECTION.halved_after))
        order, half = np.argsort(begun.merit, kind="stable"), max(least, len(left) // 2)
        given_up = _one_of_each(begun.of(order[half:]), [(s,) for s in left[order[half:]].tolist()], SELECTION.same)
        begun, left = begun.of(order[:half]), left[order[:half]]
        phase = phase._replace(steps=phase.steps - SELECTION.halved_after)
    begun = descend_all(problem, begun, phase)
    return _one_of_each(begun, [(s,) for s in left.tolist()], SELECTION.same), given_up


def _one_of_each(descents: Descents, starts: list[tuple[int, ...]], same: float) -> list[LocalMinimum]:
    """Return minima by merit, one for all whose merits agree."""
    result: list[LocalMinimum] = []
    merits = descents.merit
    for s in np.argsort(merits, kind="stable").tolist():
        if result and merits[s] - result[-1].merit <= same * abs(merits[s]):
            end = result.pop()
            result.append(replace(end, starts=end.starts + starts[s]))
        else:
            result.append(
                LocalMinimum(
                    descents.x[s], float(merits[s]), float(descents.missing[s]), starts[s], descents.counting[s]
                )
            )
    return result


def point_of(task: ResolvedTask, topology: Topology, problem: ReducedProblem, end: LocalMinimum) -> Point:
    """Return the point of an end, with the inputs of the second phase.

    Args:
        task: that of the end, with those of its corners that count alone.
        topology: the tree.
        problem: both, with all corners.
        end: where some starts ended.
    """
    n, K, x = topology.n, len(end.counting), end.x
    at, mu, u = platform(problem, x), np.zeros((K, 6)), np.empty((K, 4 * n))
    effort(problem, at, end.counting, SECOND.rho, mu, u, np.zeros(len(x)))
    root, alpha, unit = x[:3].copy(), x[3 : n + 2].copy(), Units.of(task)
    free = task.end_effector.fixed_position is None
    p_E = x[n + 2 :] * unit.length if free else fixed_end_effector(task, topology, root, alpha)
    return Point(task, topology, root, alpha, p_E, u[end.counting].reshape(-1, n, 4) * unit.input)


def begin(starts: Array, counting: Mask) -> Descents:
    """Return descents that have yet to begin.

    Args:
        starts: unknowns, shape (s, N).
        counting: the load cases that count from the start of each, shape (s, K).
    """
    (s, N), K = starts.shape, counting.shape[1]
    return Descents(starts, counting, np.zeros((s, K, 6)), np.zeros((s, N, N)), np.zeros(s), np.zeros(s))


@njit(cache=True)
def descend_all(problem: ReducedProblem, begun: Descents, phase: Phase) -> Descents:
    """Return where descents are after a phase.

    Args:
        problem: the task and topology.
        begun: where they are before; what they have learnt of the curvature is kept.
        phase: how they descend.
    """
    count, N = begun.x.shape
    m, K = len(problem.rows.least), len(problem.cases.effort)
    x, mu, curvature = np.empty((count, N)), np.empty((count, K, 6)), begun.B.copy()
    merits, missing = np.empty(count), np.zeros(count)
    counting = np.empty((count, K), np.bool_)
    for s in range(count):
        at, B = evaluate(problem, begun.x[s].copy(), begun.mu[s], begun.counting[s], phase.rho), curvature[s]
        multipliers = np.zeros(m)
        if B[0, 0] == 0.0:
            B[:] = max(CORNERS.least_curvature, np.max(np.abs(at.dV))) * np.eye(N)
        for k in range(phase.rounds):
            if k:
                multipliers = estimates(problem, at, multipliers, phase.sigma)
            at = descend(problem, at, multipliers, B, phase.rho, phase.sigma, phase.steps, phase.enough)
            for _ in range(CORNERS.rounds):
                if violation(problem, at, phase.rho) > CORNERS.most_missed:
                    break
                wanted, missing[s] = take_in(problem, at, phase.rho)
                if missing[s] <= CORNERS.missed:
                    break
                at = evaluate(problem, at.x, at.mu, wanted, phase.rho)
                at = descend(problem, at, multipliers, B, phase.rho, phase.sigma, phase.steps, phase.enough)
        if missing[s] > CORNERS.missed:
            _, missing[s] = take_in(problem, at, phase.rho)
        x[s], counting[s], mu[s] = at.x, at.counting, at.mu
        merits[s] = merit(problem, at, multipliers, phase.sigma)
        missing[s] = max(missing[s], violation(problem, at, phase.rho))
    return Descents(x, counting, mu, curvature, merits, missing)


@njit(cache=True)
def violation(problem: ReducedProblem, at: Evaluated, rho: float) -> float:
    """Return the largest missing clearance, or residual of a load case that counts."""
    most = 0.0
    for r in range(len(at.g)):
        most = max(most, problem.rows.least[r] - at.g[r])
    for k in range(len(at.mu)):  # the residual is mu / rho'
        for a in range(6 if at.counting[k] else 0):
            most = max(most, abs(at.mu[k, a]) * problem.cases.effort[k] / (2 * rho))
    return most

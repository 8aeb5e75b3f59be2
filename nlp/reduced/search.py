"""Many cheap starts of one topology, and where they end.

All starts descend at low prices of residuals and of missing clearance. Ends of one merit are one; only the best of
them descend on at high prices, with multipliers: what they reach is next to a minimum of the page.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from nlp.point import Point, fixed_end_effector
from nlp.reduced.descent import descend
from nlp.reduced.inputs import effort
from nlp.reduced.merit import estimates, evaluate, merit
from nlp.reduced.platform import moved, platform
from nlp.reduced.stated import Stated
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array

LEAST_CURVATURE = 0.1
"""Of the Lagrangian before anything is learnt; more where the first slope is steep, so that a step is a radian."""


class Phase(NamedTuple):
    """How a descent is made."""

    rho: float
    """Price of the wrenches' squared residuals."""
    sigma: float
    """Price of missing clearance."""
    rounds: int
    """How often it goes on with new multipliers, the first round counted."""
    steps: int
    """Most steps a round."""
    enough: float
    """Decrease of the merit, over one more than it, of a step that is the last one of its round."""


FIRST = Phase(rho=300.0, sigma=30.0, rounds=1, steps=40, enough=1e-5)
SECOND = Phase(rho=1e4, sigma=100.0, rounds=4, steps=15, enough=1e-7)
STIFF = FIRST._replace(sigma=3000.0), SECOND._replace(sigma=3000.0)
"""Both phases where clearance counts for more than any effort: low prices lead to where some cheap platform misses
little, and may pull those back that miss nothing."""
SAME = 1e-5
"""Ends of the first phase whose merits agree so far, relatively, are one."""
SAME_AFTER = 1e-4
"""Those of the second."""
KEPT = 0.3
"""Share of the starts whose ends go on, the best ones first.

Of 15 trees of five modules on push, searched from 50 starts with two seeds, none ends more than 0.05 % above the
best effort of 24 starts of Ipopt; with 0.1 four do.
"""
LEAST_KEPT = 3
"""Fewest distinct ends that go on, if there are as many."""


@dataclass(frozen=True)
class End:
    """Where some starts ended."""

    x: Array
    """The unknowns."""
    merit: float
    """Effort, as in the page's objective, and the prices of what is missing."""
    missing: float
    """Largest missing clearance [l_arm] or residual of a wrench [m_t g, l_arm m_t g]."""
    starts: tuple[int, ...]
    """Places of the starts that ended here, the best one first."""


def ends(stated: Stated, starts: Array, phases: tuple[Phase, Phase] = (FIRST, SECOND)) -> list[End]:
    """Return the best distinct ends of starts, by merit.

    Args:
        stated: the task and topology.
        starts: unknowns, shape (starts, N).
        phases: how they descend.
    """
    first = _distinct(descents(stated, starts, phases[0]), [(s,) for s in range(len(starts))], SAME)
    count = max(LEAST_KEPT, math.ceil(KEPT * len(starts)))
    kept = first[:count]
    second = descents(stated, np.array([end.x for end in kept]), phases[1])
    return _distinct(second, [end.starts for end in kept], SAME_AFTER)


def _distinct(found: tuple[Array, Array, Array], starts: list[tuple[int, ...]], same: float) -> list[End]:
    """Return ends by merit, one for all whose merits agree."""
    result: list[End] = []
    x, merits, missing = found
    for s in np.argsort(merits, kind="stable").tolist():
        if result and merits[s] - result[-1].merit <= same * abs(merits[s]):
            end = result.pop()
            result.append(End(end.x, end.merit, end.missing, end.starts + starts[s]))
        else:
            result.append(End(x[s], float(merits[s]), float(missing[s]), starts[s]))
    return result


def point_of(task: ResolvedTask, topology: Topology, stated: Stated, x: Array) -> Point:
    """Return the point of some unknowns, with the inputs of the second phase."""
    n, K = topology.n, len(task.load_cases)
    at, mu, u = platform(stated, x), np.zeros((K, 6)), np.empty((K, 4 * n))
    effort(stated, at, moved(stated, at), SECOND.rho, mu, u, np.zeros(len(x)))
    root, alpha, unit = x[:3].copy(), x[3 : n + 2].copy(), Units.of(task)
    free = task.end_effector.fixed_position is None
    p_E = x[n + 2 :] * unit.length if free else fixed_end_effector(task, topology, root, alpha)
    return Point(task, topology, root, alpha, p_E, u.reshape(K, n, 4) * unit.input)


@njit(cache=True)
def descents(stated: Stated, starts: Array, phase: Phase) -> tuple[Array, Array, Array]:
    """Return where some starts end, with merits and what is missing there: shapes (s, N), (s,) and (s,)."""
    count, N = starts.shape
    m, K = len(stated.rows.kind), len(stated.cases.effort)
    found, merits, missing = np.empty((count, N)), np.empty(count), np.zeros(count)
    for s in range(count):
        at = evaluate(stated, starts[s].copy(), np.zeros((K, 6)), phase.rho)
        multipliers, steepest = np.zeros(m), 0.0
        for l in range(N):
            steepest = max(steepest, abs(at.dV[l]))
        B = max(LEAST_CURVATURE, steepest) * np.eye(N)
        for k in range(phase.rounds):
            if k:
                multipliers = estimates(stated, at, multipliers, phase.sigma)
            at = descend(stated, at, multipliers, B, phase.rho, phase.sigma, phase.steps, phase.enough)
        found[s], merits[s] = at.x, merit(stated, at, multipliers, phase.sigma)
        for r in range(m):
            missing[s] = max(missing[s], stated.rows.least[r] - at.g[r])
        for k in range(K):  # the residual is mu / rho'
            for a in range(6):
                residual = abs(at.mu[k, a]) * stated.cases.effort[k] / (2 * phase.rho)
                missing[s] = max(missing[s], residual)
    return found, merits, missing

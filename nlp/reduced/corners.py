"""Selection of corners: few of them bind, so a descent takes in only those that it finds missed.

A corner is a load case that must be possible and costs nothing. With a rotor dead, or around a reserve, there are
hundreds; those that inputs within their limits produce have next to no gradient.
"""

from __future__ import annotations

import numpy as np

from nlp.reduced.arrays import Mask, ReducedProblem
from nlp.reduced.inputs import columns, find_wrench, inputs
from nlp.reduced.merit import Evaluated
from nlp.reduced.platform import platform
from topo_search.model.compiled_code import njit

MISSED = 1e-6
"""Residual from which a corner counts [m_t g, l_arm m_t g]."""
TAKEN = 8
"""Largest number of corners taken in at once, no two of one set."""


@njit(cache=True)
def initial_cases(stated: ReducedProblem) -> Mask:
    """Return which load cases count from the start, shape (K,)."""
    counting: Mask = stated.cases.group < 0
    return counting


@njit(cache=True)
def take_in(stated: ReducedProblem, at: Evaluated, rho: float) -> tuple[Mask, float]:
    """Return the load cases that count with the corners that are missed most, and by how much those are at most.

    Args:
        stated: the task and topology.
        at: where to look.
        rho: price of residuals.
    """
    if at.counting.all():
        return at.counting, 0.0
    cases, there = stated.cases, platform(stated, at.x)
    K, A = len(cases.effort), columns(stated, there)
    counting, residuals = at.counting.copy(), np.zeros(K)
    w, mu, u, last = np.empty(6), np.zeros(6), np.empty(len(A)), -1
    for k in range(K):
        if counting[k]:
            continue
        if cases.group[k] != last:  # corners of one set have much the same inputs
            mu[:] = 0.0
            last = cases.group[k]
        find_wrench(stated, there, k, w)
        inputs(stated, A, k, w, rho, mu, u)
        for a in range(6):
            residuals[k] = max(residuals[k], abs(mu[a]) * cases.effort[k] / (2 * rho))
    worst, full = residuals.max(), np.zeros(cases.group.max() + 2, np.bool_)
    for _ in range(TAKEN):
        best = -1
        for k in range(K):
            if residuals[k] > MISSED and not full[cases.group[k]] and (best < 0 or residuals[k] > residuals[best]):
                best = k
        if best < 0:
            break
        counting[best] = full[cases.group[best]] = True
    return counting, worst

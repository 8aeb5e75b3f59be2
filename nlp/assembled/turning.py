"""Torques that angular accelerations take, as terms of the balances.

J a, of the inertia J about the COM and an acceleration a, is a sum over the modules, of functions of o_i and their
axes, and of one of p_E (`nlp.symbols.inertia`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import casadi as ca
import numpy as np

from nlp.assembled.local_vectors import Differences, VectorLayout
from nlp.assembled.terms import Derived, Term, derive
from nlp.requirements.balances import turns
from nlp.requirements.statement import COM, FROM_COM, X_I, Y_I, Z_I, LocalVector, PlatformVector
from nlp.symbols.inertia import of_module, spread
from topo_search.model import Module, ResolvedTask
from topo_search.model.value import Vector

PLACE = LocalVector(PlatformVector("p", 0), COM)
"""o_i."""


def turning_terms(task: ResolvedTask, layout: VectorLayout) -> Iterator[tuple[int, Term]]:
    """Yield the rows of the balances that an acceleration changes, and the terms whose sums are taken off them."""
    n, m_E = task.n, task.end_effector.mass / task.module.mass
    every, tip = np.tile(np.arange(n), (2, 1)), np.zeros((2, 1), dtype=np.intp)
    modules = Differences.of(*(layout.ends(vector, every) for vector in (PLACE, X_I, Y_I, Z_I)))
    end_effector = Differences.of(layout.ends(FROM_COM, tip))
    for k, (x, y, z) in enumerate(turns(task).tolist()):
        for axis in range(3) if any((x, y, z)) else ():
            row = 6 * k + 3 + axis
            yield row, Term(_of_module(task.module, (x / n, y / n, z / n), axis), modules, 0.0)
            yield row, Term(_of_tip((m_E * x / n, m_E * y / n, m_E * z / n), axis), end_effector, 0.0)


@cache
def _of_module(module: Module, a: Vector, axis: int) -> Derived:
    """Return a component of a module's part of J a, of o_i and its axes."""
    y = [ca.SX.sym("y", 3) for _ in range(4)]
    torque = (spread(y[0]) + of_module(ca.horzcat(*y[1:]), module)) @ ca.DM(a)
    return derive(y, torque[axis])


@cache
def _of_tip(a: Vector, axis: int) -> Derived:
    """Return a component of the part of a point of unit mass, of its place."""
    y = ca.SX.sym("y", 3)
    return derive([y], (spread(y) @ ca.DM(a))[axis])

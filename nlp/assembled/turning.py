"""Torques that angular accelerations take, as terms of the balances.

J a, of the inertia J about the COM and an acceleration a, is a sum over the modules with their joints, of functions
of o_i and their axes, of one of p_E, and of one of the rod that counts (`nlp.symbols.inertia`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import casadi as ca
import numpy as np

from nlp.assembled.local_vectors import VectorLayout
from nlp.assembled.terms import Derived, Term, derive
from nlp.numbers.masses import Body, Masses, RodMass
from nlp.requirements.balances import turns
from nlp.requirements.statement import COM, FROM_COM, FROM_TIP, X_I, Y_I, Z_I, LocalVector, PlatformVector
from nlp.symbols.inertia import beside_halves, of_body, spread
from topo_search.model import ResolvedTask
from topo_search.model.value import Vector

PLACE = LocalVector(PlatformVector("p", 0), COM)
"""o_i."""


def turning_terms(task: ResolvedTask, carried: Masses, layout: VectorLayout) -> Iterator[tuple[int, Term]]:
    """Yield the rows of the balances that an acceleration changes, and the terms whose sums are taken off them."""
    n, m_E, rod = task.n, carried.tip, carried.rod
    alike = dict[Body, list[int]]()
    for i in range(n):
        alike.setdefault(carried.body(i), []).append(i)
    holder = np.full((2, 1), rod.module)
    for k, (x, y, z) in enumerate(turns(task).tolist()):
        for axis in range(3) if any((x, y, z)) else ():
            row, a = 6 * k + 3 + axis, (x / n, y / n, z / n)
            for body, same in alike.items():
                subjects = np.tile(same, (2, 1))
                yield row, Term(_of_body(body, a, axis), (PLACE, X_I, Y_I, Z_I), subjects, layout)
            of_tip = _of_tip((m_E * x / n, m_E * y / n, m_E * z / n), axis)
            yield row, Term(of_tip, (FROM_COM,), holder, layout)
            if rod.mass:
                yield row, Term(_of_rod(rod, a, axis), (FROM_TIP, X_I, Y_I), holder, layout)


@cache
def _of_body(body: Body, a: Vector, axis: int) -> Derived:
    """Return a component of a module's part of J a, of o_i and its axes."""
    y = [ca.SX.sym("y", 3) for _ in range(4)]
    return derive(y, (of_body(y[0], ca.horzcat(*y[1:]), body) @ ca.DM(a))[axis])


@cache
def _of_rod(rod: RodMass, a: Vector, axis: int) -> Derived:
    """Return a component of what a rod adds to its halves, of p_i - p'_E and the axes x and y of its module."""
    y = [ca.SX.sym("y", 3) for _ in range(3)]
    d = -y[0] - rod.foot[0] * y[1] - rod.foot[1] * y[2]
    return derive(y, (beside_halves(d, rod) @ ca.DM(a))[axis])


@cache
def _of_tip(a: Vector, axis: int) -> Derived:
    """Return a component of the part of a point of unit mass, of its place."""
    y = ca.SX.sym("y", 3)
    return derive([y], (spread(y) @ ca.DM(a))[axis])

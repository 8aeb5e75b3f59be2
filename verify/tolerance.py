r"""Proven bounds of a design's clearances as functions of the errors with which it is built.

| symbol | meaning | unit |
|---|---|---|
| delta | largest error of every hinge angle | rad |
| delta_p | largest error of every module's centre and of p_E, from where the hinges put them | l_arm |
| delta_e | how far the airflow may reach beyond its envelope | l_arm |
| A, B | the sides of a requirement; B may be a target volume, which goes with p_E | |
| X, r | centres and radii of balls whose hull a side is: the end balls of a cone-sphere, corners | l_arm |
| n | unit vector from A to B where they are nearest; any would do | |
| v, e | p_E from the COM, and its largest error | l_arm |
| kappa | largest change of v / \|v\|, where a requirement takes its direction from it | |

The root holds the end-effector and its target volumes, for p'_E is given from there. Whatever the errors, both
sides are hulls of balls again, and no clearance is less than the gap of a plane across n:

    clearance >= min over ends of n . (X_B - X_A) - r_A - r_B - (moves of X_A along n, and of X_B against it)

`verify.levers` bounds the moves, seen from the last module that the paths to both sides share: errors that both
have in common cancel. By Dunkl and Williams, kappa <= 2 e / (\|v\| + \|v'\|). For the allowed cone of an exterior
requirement, q = X - apex, w its part across the axis, m the inward normal and u a move of q,

    s(q + u) >= s(q) - \|u\|,    s(q + u) >= s(q) + m . u - \|u\|^2 cos(theta) / (2 \|w\|),

and a turn of the axis by a chord kappa changes s(q) by \|q\| kappa at most. Nothing is linearised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from topo_search.model import Design, needs_offset
from topo_search.model.audit import Kind
from verify.bodies import Array, Cone, ConeSphere
from verify.certificate import Solid, witnesses
from verify.hull_certificate import witness
from verify.hulls import Hull
from verify.kinematics import Platform
from verify.levers import Levers, Motion
from verify.requirements import Requirement, Scene

KINDS: tuple[Kind, ...] = ("airflow", "local", "directional", "exterior", "exclusion", "separation")
"""The kinds of requirements that have a bound."""
BOTH, CENTRE = np.array([0, 1]), np.array([0, 0])
"""Which two of the end balls of a module's envelope a side is the hull of."""


class Errors(NamedTuple):
    """Largest errors, in radians and l_arm."""

    delta: float = 0.0
    delta_p: float = 0.0
    delta_e: float = 0.0

    def times(self, factor: float) -> Errors:
        """Return all of them, larger by a factor."""
        return Errors(*(factor * error for error in self))


class Weakest(NamedTuple):
    """The pair with the least bound, and errors that bring its ends nearest to each other to first order."""

    bound: float
    """Of all clearances [l_arm]."""
    requirement: Requirement
    turns: Array
    """Signs of the hinges' errors, an example for each two ends, shape (examples, n-1)."""
    shifts: Array
    """Directions of the errors of the modules' centres, shape (n, 3)."""
    tip: Array
    """Direction of the error of p_E, shape (3,)."""


@dataclass(frozen=True, eq=False)
class _Group:
    """The N requirements of one kind."""

    requirements: Sequence[Requirement]
    ends: Array
    """BOTH or CENTRE."""
    gaps: Array
    """Without errors, for each end of A and of B, shape (N, 2, 2)."""
    n: Array
    """From A to B, or out of the cone, for each end of A, shape (N, 2, 3)."""
    of_A: Motion
    of_B: Motion | None
    """None if B goes with p_E."""
    envelopes: int
    """How many of the sides are airflow."""
    swing: Array
    """Distance over which an end of B (of A, in a cone) feels a change of p_E's direction, shape (N, 2)."""
    bend: Array | None = None
    """cos(theta) / (2 |w|) for each end of A, shape (N, 2); None unless B is a cone."""

    def bounds(self, errors: Errors, kappa: float) -> Array:
        """Return the least gaps with errors, shape (N, 2, 2)."""
        lost = self.of_A.along(errors.delta) + 2 * errors.delta_p
        if self.bend is not None:
            u = errors.delta * self.of_A.L + 2 * errors.delta_p
            lost = np.minimum(u, lost + self.bend * u * u) + kappa * np.where(self.swing > 0, self.swing + u, 0.0)
            gaps = self.gaps - lost[:, :, None]
        else:
            gaps = self.gaps - lost[:, :, None] - kappa * self.swing[:, None, :]
            if self.of_B is not None:
                gaps -= self.of_B.along(errors.delta)[:, None, :]
        return np.asarray(gaps - self.envelopes * errors.delta_e)


class Tolerance:
    """What errors leave of the clearances of a design."""

    def __init__(self, design: Design, found: Platform, scene: Scene, requirements: Sequence[Requirement]) -> None:
        """Measure every requirement of KINDS once; there must be one."""
        self._task, self._scene = design.task, scene
        envelopes = [solid.body for solid in scene.envelopes]
        l_c = design.task.module.connector_distance / scene.l_arm
        self._levers = Levers(
            design.topology,
            found.poses,
            np.array([(body.o, body.o + body.d) for body in envelopes]),
            l_c,
        )
        of_kind = [[r for r in requirements if r.kind == kind] for kind in KINDS]
        self._groups = [self._group(group) for group in of_kind if group]
        n = design.topology.n
        root = np.zeros(n, dtype=np.intp)
        self._arms = self._levers.motion(np.arange(n), root, CENTRE, np.zeros((n, 2, 3))).L[:, 0]
        self._share = design.task.module.mass / design.task.total_mass(n)
        self._offset = float(np.linalg.norm(scene.offset))

    def _group(self, group: list[Requirement]) -> _Group:
        return self._inside(group) if group[0].kind == "exterior" else self._apart(group)

    def _apart(self, group: list[Requirement]) -> _Group:
        """Return requirements of pairs of bodies."""
        kind, a = group[0].kind, np.array([r.a for r in group])
        of_solids = witnesses([(r.body, r.against) for r in group if isinstance(r.against, Solid)])
        at = [witness(r.body.body, r.against) if isinstance(r.against, Hull) else next(of_solids) for r in group]
        n = np.array([nearest.n for nearest in at])
        most_of_A = np.array([_ends(r.body.body, direction, 1) for r, direction in zip(group, n, strict=True)])
        least_of_B = np.array([_least(r.against, direction) for r, direction in zip(group, n, strict=True)])
        gaps = least_of_B[:, None, :] - most_of_A[:, :, None]
        n = np.repeat(n[:, None], 2, axis=1)
        swing = np.zeros((len(group), 2))
        for row, r in enumerate(group):
            if isinstance(r.against, Solid) and self._turns(r):
                swing[row, 1] = np.linalg.norm(r.against.body.d)
        between = kind in ("airflow", "separation")
        b = np.array([r.b for r in group]) if between else np.zeros_like(a)
        ends = CENTRE if kind in ("exclusion", "separation") else BOTH
        return _Group(
            group,
            ends,
            gaps,
            n,
            self._levers.motion(a, b, ends, n),
            self._levers.motion(b, a, ends, n) if between else None,
            {"airflow": 2, "local": 1, "directional": 1}.get(kind, 0),
            swing,
        )

    def _inside(self, group: list[Requirement]) -> _Group:
        """Return requirements of an allowed cone."""
        a = np.array([r.a for r in group])
        inside = [(r.body.body, r.against) for r in group if isinstance(r.against, Cone)]
        X = np.array([(body.o, body.o + body.d) for body, _ in inside])
        m = np.array([[cone.inward_normal(x) for x in ends] for (_, cone), ends in zip(inside, X, strict=True)])
        gaps = np.array(
            [cone.s(ends) - (body.r, body.r + body.dr) for (body, cone), ends in zip(inside, X, strict=True)]
        )
        q = X - np.array([cone.apex for _, cone in inside])[:, None]
        axes = np.array([cone.axis for _, cone in inside])[:, None]
        w = np.linalg.norm(q - np.sum(q * axes, axis=-1, keepdims=True) * axes, axis=-1)
        cos = np.array([cone.sin_cos[1] for _, cone in inside])
        turns = np.array([self._turns(r) for r in group])
        return _Group(
            group,
            BOTH,
            np.repeat(gaps[:, :, None], 2, axis=2),
            -m,
            self._levers.motion(a, np.zeros_like(a), BOTH, m),
            None,
            1,
            turns[:, None] * np.linalg.norm(q, axis=-1),
            cos[:, None] / (2 * np.maximum(w, 1e-9)),
        )

    def _turns(self, requirement: Requirement) -> bool:
        """Whether a requirement takes its direction from p_E."""
        exposed = requirement.kind in ("directional", "exterior")
        return exposed and needs_offset(self._task.exposure[requirement.b])

    def _kappa(self, errors: Errors) -> float:
        e = self._share * float(np.sum(errors.delta * self._arms + 2 * errors.delta_p))
        return min(2.0, 2 * e / (2 * self._offset - e)) if e < self._offset else 2.0

    def weakest(self, errors: Errors) -> Weakest:
        """Return the least bound of all clearances, with the pair that has it."""
        kappa, least = self._kappa(errors), []
        for number, group in enumerate(self._groups):
            bounds = group.bounds(errors, kappa).min(axis=2)
            row, end_A = divmod(int(np.argmin(bounds)), 2)
            least.append((float(bounds[row, end_A]), number, row, end_A))
        bound, number, row, end_A = min(least)
        group = self._groups[number]
        requirement, n = group.requirements[row], group.n[row, end_A]
        a, b = requirement.a, requirement.b
        shifts = np.zeros((len(self._scene.centres), 3))
        shifts[a], tip = n, -n
        held = 0 if group.of_B is None else b
        turns = np.array([self._levers.turns(a, held, end, n) for end in group.ends])
        if group.of_B is not None:
            shifts[b], tip = -n, np.zeros(3)
            against = np.array([self._levers.turns(b, a, end, n) for end in group.ends])
            turns = (turns[:, None] - against).reshape(4, -1)
        return Weakest(bound, requirement, np.unique(turns, axis=0), shifts, tip)


def _ends(body: ConeSphere, n: Array, side: int) -> tuple[float, float]:
    """Return how far both end balls reach along n (side 1), or where they begin (side -1)."""
    first = float(body.o @ n)
    return first + side * body.r, first + float(body.d @ n) + side * (body.r + body.dr)


def _least(against: Solid | Cone | Hull, n: Array) -> tuple[float, float]:
    """Return where both ends of a side begin along n; a region has but one."""
    if isinstance(against, Solid):
        return _ends(against.body, n, -1)
    assert isinstance(against, Hull)  # cones have bounds of their own
    first = float((against.mesh.vertices @ n).min())
    return first, first

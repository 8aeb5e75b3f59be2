r"""What a platform must be able to do beyond its load cases: reserves of force and torque around some of them.

| symbol | meaning | unit |
|---|---|---|
| r | radius of the ball, or of the horizontal disc, of what can be added | N, N m |

A ball is no polytope. A design keeps a reserve if all corners of a polytope around the ball can be added: a regular
icosahedron, or of a disc an octagon. Whoever proves that something is impossible may count on points of the ball
itself alone: `inner`. The audit measures the ball.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from topo_search.limits import LOAD_CASES
from topo_search.model.load_case import MOST, Broken, LoadCase, Wrench
from topo_search.model.tolerances import TOLERANCE
from topo_search.model.value import NonNegative, Value, Vector

if TYPE_CHECKING:
    from topo_search.model.task import ResolvedTask

SIDES = 8
"""Of the polygon around a disc: its corners are 8 % farther out."""
GOLDEN = (1 + math.sqrt(5)) / 2
ICOSAHEDRON = math.sqrt(3) * math.sqrt(1 + GOLDEN**2) / GOLDEN**2
"""Circumscribed over inscribed radius of a regular icosahedron: its corners are 26 % farther out than the ball."""
UNSEEN = 5 * TOLERANCE
"""By how much a reserve may be less than asked in what an audit calls clear, and more [m_t g, l_arm m_t g]."""
SAME = 1e-9
"""Share of the weight by which a force that carries it may be less."""


class AskedFlight(Value):
    """What a design must be able to do beyond its load cases; what is left out is measured and not asked for."""

    units: Literal["weight", "SI"] = "weight"
    """Of the reserves: `weight`: m_t g and l_arm m_t g; `SI`: N and N m."""
    around: Literal["hover", "all"] = "hover"
    """Where reserves are asked for: `hover`, or `all`: hover and every load case that carries the weight."""
    force_reserve: NonNegative = 0.0
    """Any force of this size can be added at the end-effector, the torque there as it is."""
    directions: Literal["all", "horizontal"] = "all"
    """Which forces: `all`, or `horizontal` ones, across z."""
    torque_reserve: NonNegative = 0.0
    """Any torque of this size can be added, the force as it is."""

    @property
    def asks(self) -> bool:
        """Whether anything is asked for."""
        return self.force_reserve > 0 or self.torque_reserve > 0

    def to_si(self, force_unit: float, torque_unit: float) -> AskedFlight:
        """Return the same in N and N m, given m_t g [N] and l_arm m_t g [N m]; where nothing is asked, nothing."""
        if not self.asks:
            return AskedFlight()
        if self.units == "SI":
            return self
        reserves = {
            "force_reserve": self.force_reserve * force_unit,
            "torque_reserve": self.torque_reserve * torque_unit,
        }
        return self.model_copy(update={"units": "SI", **reserves})


def centres(task: ResolvedTask) -> list[tuple[int, str, LoadCase]]:
    """Return where reserves are asked for: number (0: hover, k + 1: load case k), what it is called, its wrench."""
    weight = task.force_unit(task.n)
    hover = LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, weight)), weight=0.0)
    found = [(0, "hover", hover)] if task.flight.asks else []
    if task.flight.asks and task.flight.around == "all":
        for k, (label, case) in enumerate(zip(task.case_labels, task.load_cases, strict=True)):
            if case.at_com.force[2] >= weight * (1 - SAME):
                plain = {"name": None, "weight": 0.0, "cone": None, "vertices": ()}
                found.append((k + 1, label, case.model_copy(update=plain)))
    return found


def broken_reserves(asked: AskedFlight, cases: int, force_unit: float, torque_unit: float) -> Broken:
    """Yield what is wrong with reserves, for so many load cases and corners of their sets."""
    for field, r, unit in (
        ("force_reserve", asked.force_reserve, force_unit),
        ("torque_reserve", asked.torque_reserve, torque_unit),
    ):
        factor, of = (unit, " weights") if asked.units == "weight" else (1.0, "")
        if not r * factor <= MOST:
            yield ("flight", field), f"must be at most {MOST:g} N and N m, but got {r:g}{of}"
    around = len(_around(asked.directions == "horizontal")) * (asked.force_reserve > 0)
    around += len(_around(False)) * (asked.torque_reserve > 0)
    if around and (number := cases + around * (1 + cases * (asked.around == "all"))) > LOAD_CASES:
        text = f"must ask for at most {LOAD_CASES} wrenches with all load cases, but got up to {number:,}"
        yield ("flight",), text


def reserve_corners(task: ResolvedTask, *, inner: bool) -> list[tuple[str, LoadCase]]:
    """Return the corners around all reserves with what they are called, or points of the balls themselves."""
    asked, corners = task.flight, list[tuple[str, LoadCase]]()
    level = asked.directions == "horizontal"
    for _, label, case in centres(task):
        own = case.at_end_effector
        for field, r, unit, disc in (
            ("force", asked.force_reserve, task.force_unit(task.n), level),
            ("torque", asked.torque_reserve, task.torque_unit(task.n), False),
        ):
            size = max(0.0, r - UNSEEN * unit) if inner else r * _farther(disc)
            for number, v in enumerate(_around(disc) if r > 0 else ()):
                x, y, z = (a + size * b for a, b in zip(getattr(own, field), v, strict=True))
                wrench = own.model_copy(update={field: (x, y, z)})
                corner = case.model_copy(update={"end_effector": wrench})
                corners.append((f"{label}, {field} reserve {number}", corner))
    return corners


def _farther(disc: bool) -> float:
    """Return how much farther out corners are than what they are around."""
    return 1 / math.cos(math.pi / SIDES) if disc else ICOSAHEDRON


def _around(disc: bool) -> list[Vector]:
    """Return unit vectors to the corners."""
    if disc:
        angles = 2 * np.pi / SIDES * np.arange(SIDES)
        return [(float(np.cos(a)), float(np.sin(a)), 0.0) for a in angles]
    length = math.hypot(1.0, GOLDEN)
    a, b = 1 / length, GOLDEN / length
    signs = [(s, t) for s in (1.0, -1.0) for t in (1.0, -1.0)]
    return [v for s, t in signs for v in ((0.0, s * a, t * b), (s * a, t * b, 0.0), (t * b, 0.0, s * a))]

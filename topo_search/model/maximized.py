"""Quantities that a search can maximise: the task T(s) asks for the value s of one of them.

| quantity | T(s) | unit |
|---|---|---|
| `force_reserve`, `torque_reserve` | a ball, or disc, of radius s around the wrenches of `flight.around` | N, N m |
| `load` | the wrenches at the end-effector s times as large, and none | |
| `payload` | a mass s whose weight acts at the end-effector wherever a case carries the weight, and none | kg |

The weight that a load case carries is not scaled. For a fixed platform each case's set of inputs is convex and the
required wrenches are linear in s, so a platform that meets T(s) meets T of every smaller value. For loads and
payloads that holds because T(s) requires the value 0 as well, in cases without effort: a counterweighted platform
may carry 0.3 kg, but not 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

from topo_search.model.kinds import Vector, is_zero
from topo_search.model.load_case import LoadCase, Wrench
from topo_search.model.reserves import POINT_SUFFIXES, PointSuffix, carries, weight_cases
from topo_search.model.shape import unit
from topo_search.model.value import Broken, show

if TYPE_CHECKING:
    from topo_search.model.flight import CaseFlight
    from topo_search.model.task import ResolvedTask, Task

RESERVES = ("force_reserve", "torque_reserve")


def ring(number: int, elevation: float = 0.0) -> tuple[Vector, ...]:
    """Return unit vectors at an elevation above the horizontal [rad], evenly spread around the vertical."""
    angles = (2 * math.pi / number * k for k in range(number))
    c, s = math.cos(elevation), math.sin(elevation)
    return tuple((c * math.cos(angle), c * math.sin(angle), s) for angle in angles)


BALL = ((0.0, 0.0, 1.0), *(v for k in (60, 30, 0, -30, -60) for v in ring(12, math.radians(k))), (0.0, 0.0, -1.0))
"""Directions of a ball: both poles, and rings between them, because hover is symmetric about the vertical."""


class Quantity(NamedTuple):
    """A quantity to maximise."""

    words: str
    unit: str
    at: Callable[[ResolvedTask, float], ResolvedTask]
    """T(s) of a task and a value s."""
    scale: Callable[[ResolvedTask], float]
    """Value to which others are compared."""


def task_at(task: ResolvedTask, value: float) -> ResolvedTask:
    """Return T(s) of a task with `search.maximize`, for a value s in the quantity's unit."""
    assert task.search.maximize is not None
    return QUANTITIES[task.search.maximize].at(task, value).with_fields("search", reached=value)


def provable_at(task: ResolvedTask, value: float) -> ResolvedTask:
    """Return T(s) with the directions in which a proof asks for a maximised reserve."""
    spread = ring(16) if _is_disc(task) else BALL
    towards = spread if task.search.maximize in RESERVES else ()
    return task_at(task, value).with_fields("search", towards=towards)


def _is_disc(task: ResolvedTask) -> bool:
    return task.search.maximize == "force_reserve" and task.flight.directions == "horizontal"


def sample_directions(task: ResolvedTask, *, coarse: bool = False) -> tuple[Vector, ...]:
    """Return unit vectors in all directions of a maximised reserve, with the symmetries of a cube."""
    if _is_disc(task):
        return ring(8 if coarse else 64)
    steps = range(-1, 2) if coarse else range(-3, 4)
    cube = (v for v in product(steps, repeat=3) if max(map(abs, v)) == steps[-1])
    return tuple(unit((float(x), float(y), float(z))) for x, y, z in cube)


def unit_of(task: ResolvedTask) -> float:
    """Return the value that counts as one in the solver."""
    assert task.search.maximize is not None
    return QUANTITIES[task.search.maximize].scale(task)


def step_of(task: ResolvedTask, value: float) -> float:
    """Return the increase of a value that counts: a thousandth, of a tenth of the unit at least."""
    return 1e-3 * max(value, 0.1 * unit_of(task))


class ReserveBall(NamedTuple):
    """Ball, or disc, of a maximised reserve."""

    number: int
    """Number of the case around which it lies: 0 for hover, k + 1 for load case k."""
    label: str
    case: LoadCase
    point: PointSuffix
    size: str
    """Name of its radius in `CaseFlight`."""
    weakest: str
    """Name of the direction in which it ends first."""


def balls_of(task: ResolvedTask) -> list[ReserveBall]:
    """Return the balls of a task's maximised reserve."""
    kind, unit_name, points = "torque", "Nm", POINT_SUFFIXES["tip"]
    if task.search.maximize == "force_reserve":
        kind, unit_name, points = "force", "N", POINT_SUFFIXES[task.flight.at]
        kind = "horizontal" if _is_disc(task) else kind
    return [
        ReserveBall(number, label, case, point, f"{kind}_reserve{point}_{unit_name}", f"{kind}_weakest{point}")
        for number, label, case in weight_cases(task, task.flight.around)
        for point in points
    ]


def measure(task: ResolvedTask, cases: tuple[CaseFlight, ...]) -> tuple[float, tuple[Vector, ...]]:
    """Return the value of a maximised reserve, and the directions in which it ends first, one for each ball.

    Args:
        task: the task.
        cases: reserves of hover and of every load case, from an audit.
    """
    balls = [(cases[ball.number], ball) for ball in balls_of(task)]
    towards = (getattr(case, ball.weakest) for case, ball in balls)
    smallest = min(getattr(case, ball.size) or 0.0 for case, ball in balls)
    return smallest, tuple(dict.fromkeys(v for v in towards if v is not None))


def broken_maximize(task: Task) -> Broken:
    """Yield broken rules about the maximised quantity."""
    name, field = task.search.maximize, ("search", "maximize")
    if name is None:
        return
    if name in RESERVES:
        if task.search.reached is None and getattr(task.flight, name):
            yield ("flight", name), f"must be left out if it is maximised, but got {getattr(task.flight, name):g}"
        if getattr(task.goals, name):
            yield ("goals", name), f"must be left out if it is maximised, but got {show(getattr(task.goals, name))}"
        if task.flight.allocator != "optimal":
            rule = "must be `optimal` if a reserve is maximised"
            yield ("flight", "allocator"), f"{rule}, but got {show(task.flight.allocator)}"
    if name == "load" and task.search.reached is None and not any(map(_is_loaded, task.cases)):
        yield field, f"needs a load case with a wrench at the end-effector, but got {show(name)}"
    weight = task.force_unit(task.sizes[-1]) if task.sizes else 0.0
    if name == "payload" and not any(carries(case.to_si(weight, 1.0), weight) for case in task.cases):
        yield field, f"needs a load case that carries the weight, but got {show(name)}"


def _is_loaded(case: LoadCase) -> bool:
    wrenches = [case.at_end_effector, *(corner.at_end_effector for corner in case.corners)]
    return not all(is_zero(vector) for wrench in wrenches for vector in (wrench.force, wrench.torque))


def _without_load(task: ResolvedTask, number: int) -> LoadCase:
    """Return a load case without what acts at the end-effector, and without effort."""
    case = task.load_cases[number]
    plain = {"end_effector": None, "com": case.at_com, "cone": None, "vertices": (), "weight": 0.0}
    return case.model_copy(update={**plain, "name": f"unloaded {number}"})


def _force_reserve(task: ResolvedTask, value: float) -> ResolvedTask:
    return task.with_fields("flight", force_reserve=value)


def _torque_reserve(task: ResolvedTask, value: float) -> ResolvedTask:
    return task.with_fields("flight", torque_reserve=value)


def growing_cases(task: ResolvedTask) -> list[int]:
    """Return the numbers of the load cases whose wrenches grow with s; T(s) ends with those at 0, in that order."""
    if task.search.maximize == "load":
        return [number for number, case in enumerate(task.load_cases) if _is_loaded(case)]
    carry = weight_cases(task, "all")[1:] if task.search.maximize == "payload" else ()
    return [number - 1 for number, _, _ in carry]


def _load(task: ResolvedTask, value: float) -> ResolvedTask:
    cases = (case.scale_tool(value) for case in task.load_cases)
    bare = (_without_load(task, number) for number in growing_cases(task))
    return task.model_copy(update={"load_cases": (*cases, *bare)})


def _payload(task: ResolvedTask, value: float) -> ResolvedTask:
    cases, bare = list(task.load_cases), list[LoadCase]()
    for number in growing_cases(task):
        case = task.load_cases[number]
        wrenches = [_carry(wrench, value * task.gravity) for wrench in (case.at_end_effector, *case.vertices)]
        if case.cone is not None:  # its corners, as a cone has no weight
            wrenches += [_carry(corner.at_end_effector, value * task.gravity) for corner in case.corners]
        changes = {"end_effector": wrenches[0], "vertices": tuple(wrenches[1:]), "cone": None}
        cases[number] = case.model_copy(update=changes)
        bare.append(_without_load(task, number))
    return task.model_copy(update={"load_cases": (*cases, *bare)})


def _carry(wrench: Wrench, weight: float) -> Wrench:
    x, y, z = wrench.force
    return wrench.model_copy(update={"force": (x, y, z + weight)})


QUANTITIES = {
    "force_reserve": Quantity("force reserve", "N", _force_reserve, lambda task: task.force_unit(task.n)),
    "torque_reserve": Quantity("torque reserve", "N m", _torque_reserve, lambda task: task.torque_unit(task.n)),
    "load": Quantity("load", "times the task's", _load, lambda _: 1.0),
    "payload": Quantity("payload", "kg", _payload, lambda task: task.total_mass(task.n)),
}
"""Quantities by their name in `search.maximize`."""

"""Limits of a task that can be relaxed, and the task with one of them relaxed by a share.

A share x makes an upper limit (1 + x) times as large, and what is asked for (1 - x) times, rounded to the digits
that are printed: the relaxed task is the one that a user gets by writing the printed value into the task file,
defaults that depend on it included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from topo_search.model.exposure import Allowed, AnyExposure, Exterior, Local
from topo_search.model.load_case import LoadCase
from topo_search.model.task import Task
from topo_search.model.value import Vector

LEAST = 0.2
"""Share of what is asked for that is left at most of all relaxing."""
SHARES = (0.01, 0.02, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Changes that are tried."""


@dataclass(frozen=True)
class Relaxable:
    """One limit that can be relaxed."""

    limit: str
    """Name of the limit."""
    field: str
    """Field of the task."""
    more: str
    """Words for the change: `more thrust`."""
    most: float
    """Largest share."""
    relaxed: Callable[[float], Task]
    """The task with the limit relaxed by a share."""
    value: Callable[[Task], float | None]
    """Returns the limit; None where it is no single number."""
    unit: str = ""
    at_once: bool = False
    """True if there is nothing between the limit and none."""
    tightens: bool = False
    """True if it gets stricter: its designs are designs of the task as it is, which the search may miss there."""

    @property
    def shares(self) -> tuple[float, ...]:
        """The changes that are tried, in ascending order."""
        return (self.most,) if self.at_once else tuple(x for x in SHARES if x <= self.most)

    def change(self, share: float) -> str:
        """Say what a share is."""
        return self.more if self.at_once else f"{100 * share:.3g} % {self.more}"


def relaxable(task: Task, n: int) -> list[Relaxable]:
    """Return the limits of a task for n modules that can be relaxed without another module or another tree."""
    return [one for one in (*_module(task), *_search(task, n), *_exposure(task), *_flight(task)) if one.shares]


def _module(task: Task) -> Iterator[Relaxable]:
    module = task.module

    def strengthen(x: float) -> Task:
        if module.max_thrust is None:
            return _with(
                task, "module", max_thrust_to_weight=_round_to_print(module.max_thrust_to_weight * (1 + x))
            )
        thrust = _round_to_print(module.max_thrust * (1 + x))
        ratio = 4 * thrust / (module.mass * task.gravity)
        return _with(task, "module", max_thrust=thrust, max_thrust_to_weight=ratio)

    name, unit = ("max_thrust_to_weight", "") if module.max_thrust is None else ("max_thrust", "N")
    yield Relaxable(
        "rotor limits", f"module.{name}", "more thrust", 1.0, strengthen, attrgetter(f"module.{name}"), unit
    )
    yield _scale(
        task, "distance of module centres", "module", "connector_distance", 1.0, "longer connectors", unit="m"
    )


def _search(task: Task, n: int) -> Iterator[Relaxable]:
    if task.search.peak_input < 1:
        most = 1 / task.search.peak_input - 1
        yield _scale(task, "rotor inputs", "search", "peak_input", most, "larger share of the largest input")
    if task.search.root == "paper":
        yield _free(task, "orientation of the root", "search", "root", "free")
    if task.end_effector.fixed_position is not None:
        yield _free(task, "position of the end-effector", "end_effector", "position", "free")
    if (reach := task.largest_reach(n)) is not None:
        for limit, more, most in (
            ("reach of the rod", "more reach", 1.0),
            ("reach of the rod, tightened", "less reach", LEAST - 1),
        ):

            def change_reach(x: float, sign: float = math.copysign(1, most), reach: float = reach) -> Task:
                return _with(task, "end_effector", largest_reach=_round_to_print(reach * (1 + sign * x)))

            yield Relaxable(
                limit,
                "end_effector.largest_reach",
                more,
                abs(most),
                change_reach,
                lambda of: of.largest_reach(n),
                "m",
                tightens=most < 0,
            )
    if task.end_effector.stand_off:
        yield _scale(
            task,
            "stand-off",
            "end_effector",
            "stand_off",
            LEAST - 1,
            "less stand-off of the end-effector",
            unit="m",
        )


def _exposure(task: Task) -> Iterator[Relaxable]:
    for number, requirement in enumerate(task.exposure):

        def reduce(x: float, number: int = number, requirement: Any = requirement) -> Task:
            changed = requirement.model_copy(update=_shrink(requirement, x, task.module.region_envelope.length))
            return task.model_copy(
                update={"exposure": (*task.exposure[:number], changed, *task.exposure[number + 1 :])}
            )

        if requirement.speed is not None:

            def hasten(x: float, number: int = number, requirement: Any = requirement) -> Task:
                faster = requirement.model_copy(update={"speed": _round_to_print(requirement.speed * (1 + x))})
                return task.model_copy(
                    update={"exposure": (*task.exposure[:number], faster, *task.exposure[number + 1 :])}
                )

            limit = f"air over exposure {number} ({requirement.kind})"
            value = _entry(number, "speed")
            yield Relaxable(limit, f"exposure[{number}].speed", "faster air", 1.0, hasten, value, "m/s")
        limit = f"exposure {number} ({requirement.kind})"
        at = f"exposure[{number}]"
        if isinstance(requirement, Exterior):
            most = min(1.0, 90 / requirement.half_angle_deg - 1)
            value = _entry(number, "half_angle_deg")
            yield Relaxable(limit, f"{at}.half_angle_deg", "wider cone", most, reduce, value, "deg")
        elif isinstance(requirement, Allowed):
            yield Relaxable(
                limit, f"{at}.planes", "of the airflow's length as extra room", 1.0, reduce, lambda _: None
            )
        elif requirement.radius is not None:
            value = _entry(number, "radius")
            yield Relaxable(limit, f"{at}.radius", "smaller radius", 1 - LEAST, reduce, value, "m")
        elif isinstance(requirement, Local):
            shape = next(name for name in ("box", "vertices", "pieces") if getattr(requirement, name) is not None)
            yield Relaxable(limit, f"{at}.{shape}", "smaller region", 1 - LEAST, reduce, lambda _: None)


def _flight(task: Task) -> Iterator[Relaxable]:
    force, torque = ("N", "N m") if task.flight.units == "SI" else ("m_t g", "l_arm m_t g")
    for name, limit, unit in (
        ("force_reserve", "reserve of force", force),
        ("torque_reserve", "reserve of torque", torque),
        ("tilt_deg", "tilt held in hover", "deg"),
        ("com_error", "error of the centre of mass", "m"),
    ):
        if getattr(task.flight, name):
            yield _scale(task, limit, "flight", name, LEAST - 1, "less", unit=unit)
    if any(accelerations := task.flight.angular_acceleration):

        def slow(x: float) -> Task:
            return _with(
                task, "flight", angular_acceleration=tuple(_round_to_print(a * (1 - x)) for a in accelerations)
            )

        field = "flight.angular_acceleration"
        yield Relaxable("angular acceleration", field, "less", 1 - LEAST, slow, lambda _: None)
    for index, (name, what, unit) in enumerate((("joint_force", "force", "N"), ("joint_moment", "moment", "N m"))):
        if (most := task.joint_limits[index]) is not None:

            def raise_limit(x: float, name: str = name, most: float = most) -> Task:
                return _with(task, "flight", **{name: _round_to_print(most * (1 + x))})

            def bears(of: Task, index: int = index) -> float | None:
                return of.joint_limits[index]

            yield Relaxable(f"{what} in a joint", f"flight.{name}", f"larger {what}", 1.0, raise_limit, bears, unit)

    def lighten(x: float) -> Task:
        lighter = tuple(_lighten(case, 1 - x) for case in task.cases)
        return task.model_copy(update={"load_cases": lighter, "task_seed": None})

    if lighten(0.5).load_cases != task.cases:
        more = "less force and torque at the end-effector"
        yield Relaxable("load cases", "load_cases", more, 1 - LEAST, lighten, lambda _: None)


def _lighten(case: LoadCase, factor: float) -> LoadCase:
    """Return a load case with what it exerts at the end-effector scaled; the weight stays."""
    return case.model_copy(
        update={
            "end_effector": case.end_effector and case.end_effector.scale(factor, factor),
            "cone": case.cone and case.cone.scale(factor),
            "vertices": tuple(wrench.scale(factor, factor) for wrench in case.vertices),
        }
    )


def _shrink(requirement: AnyExposure, x: float, length: float) -> dict[str, Any]:
    """Return what of a requirement changes."""
    if isinstance(requirement, Exterior):
        return {"half_angle_deg": min(90.0, _round_to_print(requirement.half_angle_deg * (1 + x)))}
    if isinstance(requirement, Allowed):
        farther = (plane.model_copy(update={"offset": plane.offset + x * length}) for plane in requirement.planes)
        return {"planes": tuple(farther)}
    if requirement.radius is not None:
        return {"radius": _round_to_print(requirement.radius * (1 - x))}
    if isinstance(requirement, Local) and requirement.box is not None:
        return {"box": tuple((1 - x) * edge for edge in requirement.box)}
    if isinstance(requirement, Local) and requirement.pieces is not None:
        return {"pieces": tuple(_scale_points(points, 1 - x) for points in requirement.pieces)}
    return {"vertices": _scale_points(requirement.vertices or (), 1 - x)}


def _scale_points(points: tuple[Vector, ...], factor: float) -> tuple[Vector, ...]:
    return tuple((factor * x, factor * y, factor * z) for x, y, z in points)


def _round_to_print(value: float) -> float:
    """Return a number with the digits that `Relaxation.setting` prints."""
    return float(f"{value:.6g}")


def _with(task: Task, part: str, **fields: Any) -> Task:
    """Return the task with fields of one of its tables changed."""
    return task.model_copy(update={part: getattr(task, part).model_copy(update=fields)})


def _entry(number: int, name: str) -> Callable[[Task], float | None]:
    """Return what reads a field of an exposure requirement."""
    return lambda task: float(getattr(task.exposure[number], name))


def _scale(task: Task, limit: str, part: str, name: str, most: float, more: str, unit: str = "") -> Relaxable:
    """Return a limit that is one number: it grows if `most` is positive, else shrinks."""
    given, sign = float(getattr(getattr(task, part), name)), 1 if most > 0 else -1
    return Relaxable(
        limit,
        f"{part}.{name}",
        more,
        abs(most),
        lambda x: _with(task, part, **{name: _round_to_print(given * (1 + sign * x))}),
        attrgetter(f"{part}.{name}"),
        unit,
    )


def _free(task: Task, limit: str, part: str, name: str, free: str) -> Relaxable:
    """Return a limit that is there or not."""
    return Relaxable(
        limit,
        f'{part}.{name} = "{free}"',
        "freeing it",
        1.0,
        lambda _: _with(task, part, **{name: free}),
        lambda _: None,
        at_once=True,
    )

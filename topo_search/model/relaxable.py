"""Limits of a task that can be relaxed, and the task with one of them relaxed by a share.

A share x makes an upper limit (1 + x) times as large, and what is asked for (1 - x) times, rounded to the digits
that are printed: the relaxed task is the one that a user gets by writing the printed value into the task file,
defaults that depend on it included.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter, methodcaller
from typing import Any

from topo_search.model.exposure import Allowed, Exterior, Local
from topo_search.model.task import Task

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
    if module.max_thrust is None:
        yield _scale(task, "rotor limits", "module", "max_thrust_to_weight", 1.0, "more thrust")
    else:
        strongest = module.max_thrust

        def strengthen(x: float) -> Task:
            thrust = _round_to_print(strongest * (1 + x))
            ratio = 4 * thrust / (module.mass * task.gravity)
            return _with(task, "module", max_thrust=thrust, max_thrust_to_weight=ratio)

        value = attrgetter("module.max_thrust")
        yield Relaxable("rotor limits", "module.max_thrust", "more thrust", 1.0, strengthen, value, "N")
    yield _scale(task, "distance of module centres", "module", "connector_distance", 1.0, "longer connectors", "m")


def _search(task: Task, n: int) -> Iterator[Relaxable]:
    if task.search.peak_input < 1:
        most = 1 / task.search.peak_input - 1
        yield _scale(task, "rotor inputs", "search", "peak_input", most, "larger share of the largest input")
    if task.search.root == "paper":
        free_root = _with(task, "search", root="free")
        yield _free("orientation of the root", 'search.root = "free"', free_root)
    if task.search.hinge_set_deg is not None:
        given = "hinge_step_deg" if task.search.hinge_angles_deg is None else "hinge_angles_deg"
        any_angle = task.model_copy(update={"search": task.search.any_angle})
        yield _free("set of hinge angles", f"search.{given} left out", any_angle)
    if task.end_effector.fixed_position is not None:
        free_tip = _with(task, "end_effector", position="free")
        yield _free("position of the end-effector", 'end_effector.position = "free"', free_tip)
    if task.largest_reach(n) is not None:
        field, reach = ("end_effector", "largest_reach"), methodcaller("largest_reach", n)
        yield _scale(task, "reach of the rod", *field, 1.0, "more reach", "m", reach)
        shorter = _scale(task, "reach of the rod, tightened", *field, LEAST - 1, "less reach", "m", reach)
        yield replace(shorter, tightens=True)
    if task.end_effector.stand_off:
        less = "less stand-off of the end-effector"
        yield _scale(task, "stand-off", "end_effector", "stand_off", LEAST - 1, less, "m")


def _exposure(task: Task) -> Iterator[Relaxable]:
    for number, exposure in enumerate(task.exposure):
        if exposure.speed is not None:
            limit = f"air over exposure {number} ({exposure.kind})"
            yield _scale(task, limit, number, "speed", 1.0, "faster air", "m/s")
        limit = f"exposure {number} ({exposure.kind})"
        if isinstance(exposure, Exterior):
            most = min(1.0, 90 / exposure.half_angle_deg - 1)
            yield _scale(task, limit, number, "half_angle_deg", most, "wider cone", "deg")
        elif isinstance(exposure, Allowed):
            more, moved = "of the airflow's length as extra room", partial(_move_planes, task, number)
            yield Relaxable(limit, f"exposure[{number}].planes", more, 1.0, moved, lambda _: None)
        elif exposure.radius is not None:
            yield _scale(task, limit, number, "radius", LEAST - 1, "smaller radius", "m")
        elif isinstance(exposure, Local):
            shape = next(name for name in ("box", "vertices", "pieces") if getattr(exposure, name) is not None)
            field, reduced = f"exposure[{number}].{shape}", partial(_reduce, task, number, shape)
            yield Relaxable(limit, field, "smaller region", 1 - LEAST, reduced, lambda _: None)


def _move_planes(task: Task, number: int, x: float) -> Task:
    """Return the task with the planes of a requirement farther out, by a share of the airflow's length."""
    planes, length = attrgetter("planes")(task.exposure[number]), task.module.region_envelope.length
    farther = (plane.model_copy(update={"offset": plane.offset + x * length}) for plane in planes)
    return _with(task, number, planes=tuple(farther))


def _reduce(task: Task, number: int, shape: str, x: float) -> Task:
    return _with(task, number, **{shape: _times(getattr(task.exposure[number], shape), 1 - x)})


def _times(given: Any, factor: float) -> Any:
    return tuple(_times(each, factor) for each in given) if isinstance(given, tuple) else factor * given


def _flight(task: Task) -> Iterator[Relaxable]:
    force, torque = ("N", "N m") if task.flight.units == "SI" else ("m_t g", "l_arm m_t g")
    for name, limit, unit in (
        ("force_reserve", "reserve of force", force),
        ("torque_reserve", "reserve of torque", torque),
        ("tilt_deg", "tilt held in hover", "deg"),
        ("com_error", "error of the centre of mass", "m"),
    ):
        if getattr(task.flight, name):
            yield _scale(task, limit, "flight", name, LEAST - 1, "less", unit)
    if any(accelerations := task.flight.angular_acceleration):

        def slow(x: float) -> Task:
            slower = tuple(_round_to_print(a * (1 - x)) for a in accelerations)
            return _with(task, "flight", angular_acceleration=slower)

        field = "flight.angular_acceleration"
        yield Relaxable("angular acceleration", field, "less", 1 - LEAST, slow, lambda _: None)
    for index, (name, what, unit) in enumerate((("joint_force", "force", "N"), ("joint_moment", "moment", "N m"))):
        if task.joint_limits[index] is not None:

            def bears(of: Task, index: int = index) -> float | None:
                return of.joint_limits[index]

            yield _scale(task, f"{what} in a joint", "flight", name, 1.0, f"larger {what}", unit, bears)

    def lighten(x: float) -> Task:
        # the weight stays
        lighter = tuple(case.scale(1 - x, 1 - x).model_copy(update={"com": case.com}) for case in task.cases)
        return task.model_copy(update={"load_cases": lighter, "task_seed": None})

    if lighten(0.5).load_cases != task.cases:
        more = "less force and torque at the end-effector"
        yield Relaxable("load cases", "load_cases", more, 1 - LEAST, lighten, lambda _: None)


def _round_to_print(value: float) -> float:
    return float(f"{value:.6g}")  # as `Relaxation.setting` prints it


def _with(task: Task, part: str | int, **fields: Any) -> Task:
    """Return the task with fields of one of its tables changed, or of an exposure requirement by its number."""
    if isinstance(part, str):
        return task.model_copy(update={part: getattr(task, part).model_copy(update=fields)})
    changed = task.exposure[part].model_copy(update=fields)
    return task.model_copy(update={"exposure": (*task.exposure[:part], changed, *task.exposure[part + 1 :])})


def _scale(
    task: Task,
    limit: str,
    part: str | int,
    name: str,
    most: float,
    more: str,
    unit: str = "",
    value: Callable[[Task], float | None] | None = None,
) -> Relaxable:
    """Return a limit that is one number of a part, as of `_with`: it grows if `most` is positive, else shrinks.

    `value`: what the number is where the field itself may be left out; default: the field.
    """

    def field_value(of: Task) -> float:
        return float(getattr(of.exposure[part] if isinstance(part, int) else getattr(of, part), name))

    value = value or field_value
    given, sign = value(task) or 0.0, 1 if most > 0 else -1

    def change(x: float) -> Task:
        return _with(task, part, **{name: _round_to_print(given * (1 + sign * x))})

    field = f"{part}.{name}" if isinstance(part, str) else f"exposure[{part}].{name}"
    return Relaxable(limit, field, more, abs(most), change, value, unit)


def _free(limit: str, field: str, freed: Task) -> Relaxable:
    return Relaxable(limit, field, "freeing it", 1.0, lambda _: freed, lambda _: None, at_once=True)

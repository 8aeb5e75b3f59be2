"""Limits of a task that can be relaxed, and the task with each relaxed by a share.

A share x scales an upper limit by 1 + x, and a requirement by 1 - x, rounded to the printed digits. The relaxed
task is the one that a user gets by writing the printed value into the task file, including defaults that depend on
it.

What a task cannot give up is not relaxed: a solid region is an object of that size, where it is if the tip touches
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from pydantic import ValidationError

from topo_search.limits import length
from topo_search.model import ResolvedTask, Task
from topo_search.model.exposure import Plane
from topo_search.model.relaxed import Amount, Setting
from topo_search.model.shape import NOWHERE


@dataclass(frozen=True)
class Relaxing:
    """Settings of the search for limits to relax."""

    trees: int = 2
    """Number of closest trees for which limits are relaxed."""
    paired: int = 4
    """Number of a tree's limits, of those that came closest alone, that are relaxed in pairs."""
    remaining: float = 0.2
    """Share of a requirement that remains when it is relaxed the most."""
    shares: tuple[float, ...] = (0.01, 0.02, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
    """Ladder of shares."""


RELAXING = Relaxing()


@dataclass(frozen=True)
class Relaxable:
    """A limit that can be relaxed, or a pair of limits."""

    task: Task
    """The task as the user wrote it."""
    modules: int
    """Number of modules."""
    limit: str
    """Name of the limit."""
    field: str
    """Field of the task."""
    words: str
    """Change in words: `more thrust`."""
    largest_share: float
    change: Callable[[Task, float], Task]
    """Returns a task with the limit relaxed by a share."""
    value: Callable[[Task], Amount | None] = lambda _: None
    """Returns the limit's value in a task; None if it is not made of a few numbers."""
    unit: str = ""
    whole: float | None = None
    """Length whose share is added to the limit [m]; None: a share of the limit itself."""
    is_switch: bool = False
    """True if the limit can only be kept or dropped."""
    tightens: bool = False
    """True if the limit gets stricter: its designs also satisfy the original task, whose search may miss them."""
    also: Relaxable | None = None
    """The second limit of a pair."""

    @property
    def limits(self) -> tuple[Relaxable, ...]:
        """The limit, or both limits of a pair."""
        return (self,) if self.also is None else (self, self.also)

    @cached_property
    def shares(self) -> tuple[float, ...]:
        """The shares to try, in ascending order: those with which the task is valid."""
        largest = max(limit.largest_share for limit in self.limits)
        ladder = (largest,) if all(limit.is_switch for limit in self.limits) else RELAXING.shares
        return tuple(x for x in ladder if x <= largest and self._is_valid(x))

    def _is_valid(self, share: float) -> bool:
        try:
            self.task_at(share)
        except ValidationError:  # for example a plane farther away than `speed_within`
            return False
        return True

    def relax(self, share: float) -> Task:
        """Return the user's task with the limits relaxed by a share, each up to its largest one."""
        task = self.task
        for limit in self.limits:
            task = limit.change(task, min(share, limit.largest_share))
        return task

    def task_at(self, share: float) -> ResolvedTask:
        """Return the task with the limits relaxed by a share; ValidationError if other fields rule it out."""
        return self.relax(share).resolve(self.modules)

    def settings(self, share: float) -> list[Setting]:
        """Return how each limit changes by a share."""
        relaxed = self.relax(share)
        return [limit._setting(min(share, limit.largest_share), relaxed) for limit in self.limits]

    def _setting(self, share: float, relaxed: Task) -> Setting:
        amount = f"{100 * share:.3g} %" if self.whole is None else length(share * self.whole)
        return Setting(
            limit=self.limit,
            change=self.words if self.is_switch else f"{amount} {self.words}",
            field=self.field,
            share=share,
            given=self.value(self.task),
            enough=self.value(relaxed),
            unit=self.unit,
        )


def relaxable(task: Task, n: int) -> list[Relaxable]:
    """Return the limits of a task for n modules that can be relaxed without changing the module or the tree."""
    limits = (*_numbers(task, n), *_planes(task, n), *_switches(task, n), *_loads(task, n))
    return [limit for limit in limits if limit.shares]


def _numbers(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the limits that are scaled: numbers, and points of regions."""
    by_weight, shrink = float(task.module.max_thrust is None), RELAXING.remaining - 1
    force, torque = ("N", "N m") if task.flight.units == "SI" else ("m_t g", "l_arm m_t g")
    larger, built = 1 / task.search.peak_input - 1, shrink * bool(task.flight.tolerances)
    # part, field, limit, largest share (negative: the value shrinks), change in words, unit
    table: list[tuple[str | int, str, str, float, str, str]] = [
        ("module", "max_thrust_to_weight", "rotor limits", by_weight, "more thrust", ""),
        ("module", "max_thrust", "rotor limits", 1.0, "more thrust", "N"),
        ("module", "connector_distance", "distance of module centres", 1.0, "longer connectors", "m"),
        ("search", "peak_input", "rotor inputs", larger, "larger share of the largest input", ""),
        ("end_effector", "mass", "mass of the end-effector", shrink, "lighter end-effector", "kg"),
        ("end_effector", "largest_reach", "reach of the rod", 1.0, "more reach", "m"),
        ("end_effector", "largest_reach", "reach of the rod, tightened", shrink, "less reach", "m"),
        ("end_effector", "within_deg", "angle of the rod from its axis", 1.0, "wider angle", "deg"),
        ("end_effector", "stand_off", "stand-off", shrink, "less stand-off of the end-effector", "m"),
        ("flight", "force_reserve", "reserve of force", shrink, "less", force),
        ("flight", "torque_reserve", "reserve of torque", shrink, "less", torque),
        ("flight", "tilt_deg", "tilt held in hover", shrink, "less", "deg"),
        ("flight", "com_error", "error of the centre of mass", shrink, "less", "m"),
        ("flight", "angular_acceleration", "angular acceleration", shrink, "less", "rad/s^2"),
        ("flight", "joint_force", "force in a joint", 1.0, "larger force", "N"),
        ("flight", "joint_moment", "moment in a joint", 1.0, "larger moment", "N m"),
        ("tolerances", "hinge_angle_deg", "error of hinge angles", built, "less", "deg"),
        ("tolerances", "position", "error of positions", built, "less", "m"),
    ]
    for number, exposure in enumerate(task.exposure):
        limit = f"exposure {number} ({exposure.kind})"
        table.append((number, "speed", f"air over {limit}", 1.0, "faster air", "m/s"))
        if not exposure.solid:
            wider = min(1.0, 90 / getattr(exposure, "half_angle_deg", 90) - 1)
            table.append((number, "half_angle_deg", limit, wider, "wider cone", "deg"))
            table.append((number, "radius", limit, shrink, "smaller radius", "m"))
            table += [
                (number, name, limit, shrink, "smaller region", "m") for name in ("box", "vertices", "pieces")
            ]
    for part, name, limit, largest_share, words, unit in table:
        read = partial(_value, n, part, name)
        if (value := read(task)) and value != NOWHERE and largest_share:
            is_points = isinstance(value, tuple) and isinstance(value[0], tuple)
            yield Relaxable(
                task,
                n,
                limit,
                f"{part}.{name}" if isinstance(part, str) else f"exposure[{part}].{name}",
                words,
                abs(largest_share),
                partial(_scale, read, part, name, math.copysign(1.0, largest_share)),
                (lambda _: None) if is_points else read,
                unit,
                tightens=name == "largest_reach" and largest_share < 0,
            )


def _value(n: int, part: str | int, name: str, task: Task) -> Any:
    """Return the value of a field of a part (see `Task.with_fields`), or its default; None without either."""
    if name == "largest_reach":
        return task.largest_reach(n)
    if name == "within_deg":
        return task.end_effector.largest_angle_deg if task.end_effector.axis is not None else None
    if name in ("joint_force", "joint_moment"):
        return task.joint_limits[name == "joint_moment"]
    return getattr(getattr(task, part) if isinstance(part, str) else task.exposure[part], name, None)


def _scale(read: Callable[[Task], Any], part: str | int, name: str, sign: float, task: Task, share: float) -> Task:
    factor = 1 + sign * share
    fields = {name: _times(read(task), factor)}
    if name == "max_thrust":
        fields["max_thrust_to_weight"] = task.module.thrust_to_weight(fields[name], task.gravity)
    if part == "module":
        names = ("max_thrust", "max_thrust_to_weight") if "max_thrust" in name else (name,)
        scaled = (
            {own: value * factor for own in names if (value := getattr(kind, own)) is not None}
            for kind in task.module_types
        )
        types = (kind.model_copy(update=own) for kind, own in zip(task.module_types, scaled, strict=True))
        task = task.model_copy(update={"module_types": tuple(types)})
    return task.with_fields(part, **fields)


def _times(value: Any, factor: float) -> Any:
    """Return a number, or every number of a tuple, times a factor, with the digits of `Setting.words`."""
    if isinstance(value, tuple):
        return tuple(_times(x, factor) for x in value)
    return float(f"{value * factor:.6g}")


def _planes(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the room of airflow between planes, which move outwards, but for walls that the tip touches."""
    whole = task.module.region_envelopes[0].length
    for e, exposure in enumerate(task.exposure):
        movable = tuple(k for k, plane in enumerate(_planes_of(task, e)) if plane.offset or not exposure.solid)
        if movable:
            numbers, limit = ", ".join(map(str, movable)), f"exposure {e} ({exposure.kind})"
            field = f"exposure[{e}].planes[{numbers}].offset"
            read, move = partial(_offsets, e, movable), partial(_move_planes, e, movable, whole)
            yield Relaxable(task, n, limit, field, "more room", 1.0, move, read, "m", whole=whole)


def _offsets(e: int, movable: Sequence[int], task: Task) -> tuple[float, ...]:
    planes = _planes_of(task, e)
    return tuple(planes[k].offset for k in movable)


def _planes_of(task: Task, e: int) -> tuple[Plane, ...]:
    return getattr(task.exposure[e], "planes", ())


def _move_planes(e: int, movable: Sequence[int], whole: float, task: Task, share: float) -> Task:
    moved = [
        plane.model_copy(update={"offset": round(plane.offset + share * whole, 3)}) if k in movable else plane
        for k, plane in enumerate(_planes_of(task, e))
    ]
    return task.with_fields(e, planes=tuple(moved))


def _switches(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the limits that can only be kept or dropped."""

    def switch(limit: str, field: str, free: Callable[[Task], Task]) -> Relaxable:
        return Relaxable(task, n, limit, field, "freeing it", 1.0, lambda task, _: free(task), is_switch=True)

    if task.search.root_ranges:
        field = 'search.root = "free"' if task.search.root == "paper" else "search.root_orientation_deg left out"

        def free_root(task: Task) -> Task:
            return task.with_fields("search", root="free", root_orientation_deg=None)

        yield switch("orientation of the root", field, free_root)
    if task.search.hinge_set_deg is not None and task.search.lattice is None:
        field = "hinge_step_deg" if task.search.hinge_angles_deg is None else "hinge_angles_deg"
        free = {"search": task.search.any_angle}
        yield switch("set of hinge angles", f"search.{field} left out", lambda task: task.model_copy(update=free))
    if task.end_effector.fixed_position is not None:
        name, field = "position of the end-effector", 'end_effector.position = "free"'
        yield switch(name, field, lambda task: task.with_fields("end_effector", position="free"))


def _loads(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield what the load cases ask for at the end-effector, named by the one with the largest force or torque."""

    def size(k: int) -> tuple[float, float]:
        wrench = task.cases[k].at_end_effector
        return math.hypot(*wrench.force), math.hypot(*wrench.torque)

    def lighten(task: Task, share: float) -> Task:
        # the wrench at the centre of mass carries the weight and stays
        lighter = tuple(case.scale_tool(1 - share) for case in task.cases)
        return task.model_copy(update={"load_cases": lighter, "task_seed": None})

    if lighten(task, 0.5).load_cases == task.cases:
        return
    k = max(range(len(task.cases)), key=size)
    name, units = ("force", ("N", "m_t g")) if size(k)[0] else ("torque", ("N m", "l_arm m_t g"))
    yield Relaxable(
        task,
        n,
        "load cases",
        f"load_cases[{k}].end_effector.{name}",
        "less force and torque at the end-effector",
        1 - RELAXING.remaining,
        lighten,
        lambda task: getattr(task.cases[k].at_end_effector, name),
        units[task.cases[k].units == "weight"],
    )

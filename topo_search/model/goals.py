"""Goals besides control effort, which are bounds with several levels.

A design of least effort is at its bounds. So a goal is a bound, and the trade-off results from solving the task
once for each of its levels (the epsilon-constraint method).
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar, get_args

from pydantic import AfterValidator, Field

from topo_search.limits import LIMITS
from topo_search.model.kinds import OMIT_EMPTY, Angle, Flag, NonNegative, Positive, at_most
from topo_search.model.load_case import Failing
from topo_search.model.value import Broken, Value, show

if TYPE_CHECKING:
    from topo_search.model.task import Task


class Goal(NamedTuple):
    """Goal besides control effort."""

    field: str
    """Field of the task that its levels set."""
    unit: str
    """Unit of the field."""
    step: float
    """Largest difference that does not count, in `unit`."""
    sign: int = -1
    """1 if smaller is better, -1 if larger is better."""


GOALS = {
    "clearance": Goal("search.margin", "m", 1.0e-5),  # a tenth of the default margin; one optimum differs by less
    "stand_off": Goal("end_effector.stand_off", "m", 1.0e-4),
    "peak_input": Goal("search.peak_input", "u_max", 1.0e-5, 1),
    "force_reserve": Goal("flight.force_reserve", "N", 1.0e-4),
    "torque_reserve": Goal("flight.torque_reserve", "N m", 1.0e-5),
    "rotor_out": Goal("flight.rotor_out", "any one rotor dead", 0.5),  # counts cases that survive
    "joint_moment": Goal("flight.joint_moment", "N m", 1.0e-5, 1),
    "hinge_angle_deg": Goal("tolerances.hinge_angle_deg", "deg", 1.0e-3),
    "speed": Goal("exposure.speed", "m/s", 1.0e-3, 1),
}
"""Goals by their field in `Level`, in that order."""

Levels = TypeVar("Levels", bound=tuple[float | str, ...])


def _check_distinct(levels: Levels) -> Levels:
    if len(set(levels)) < len(levels):
        raise ValueError(f"must all be different, but got {show(levels)}")
    return levels


Bound = TypeVar("Bound")
AxisLevels = Annotated[tuple[Bound, ...], at_most(LIMITS.levels), AfterValidator(_check_distinct)]
"""Levels of a goal."""


class Level(NamedTuple):
    """One level of every goal, as in `Goals`; None if it is not a goal."""

    clearance: float | None
    stand_off: float | None
    peak_input: float | None
    force_reserve: float | None = None
    torque_reserve: float | None = None
    rotor_out: Failing | None = None
    joint_moment: float | None = None
    hinge_angle_deg: float | None = None
    speed: float | None = None

    @property
    def words(self) -> str:
        """Assignments of fields, as in a task file."""
        items = [(goal.field, value) for goal, value in zip(GOALS.values(), self, strict=True) if value is not None]
        texts = [f"{field} = {f'{v:g}' if isinstance(v, float) else show(v)}" for field, v in items]
        return ", ".join(texts) or "the task as it is"


class Goals(Value):
    """Goals besides control effort, as bounds: the task is solved at every combination of their levels."""

    clearance: AxisLevels[NonNegative] = ()
    """Levels of search.margin [m]."""
    stand_off: AxisLevels[Positive] = ()
    """Levels of end_effector.stand_off [m]."""
    peak_input: AxisLevels[Annotated[Positive, Field(le=1)]] = ()
    """Levels of search.peak_input."""
    force_reserve: Annotated[AxisLevels[NonNegative], OMIT_EMPTY] = ()
    """Levels of flight.force_reserve, in its units."""
    torque_reserve: Annotated[AxisLevels[NonNegative], OMIT_EMPTY] = ()
    """Levels of flight.torque_reserve, in its units."""
    rotor_out: Annotated[tuple[Failing, ...], AfterValidator(_check_distinct), OMIT_EMPTY] = ()
    """Levels of flight.rotor_out."""
    joint_moment: Annotated[AxisLevels[Positive], OMIT_EMPTY] = ()
    """Levels of flight.joint_moment [N m]."""
    hinge_angle_deg: Annotated[AxisLevels[Angle], OMIT_EMPTY] = ()
    """Levels of tolerances.hinge_angle_deg, which the clearances survive with all of [tolerances] [deg]."""
    speed: Annotated[AxisLevels[Positive], OMIT_EMPTY] = ()
    """Levels of the air speed in the regions of all exposures, in place of their `speed` [m/s]."""
    modules: Flag = False
    """True if fewer modules are a goal; requires a range of sizes and wrenches in SI."""

    def _broken_rules(self) -> Broken:
        if (number := math.prod(len(axis) for axis in self._axes)) > LIMITS.levels:
            yield (), f"must have at most {LIMITS.levels:,} combinations of levels, but got {number:,}"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the goals."""
        return tuple(name for name in type(self).model_fields if getattr(self, name))

    @property
    def levels(self) -> tuple[Level, ...]:
        """All combinations, the loosest first; the last goal changes fastest."""
        return tuple(Level(*levels) for levels in product(*self._axes))

    def level_before(self, number: int) -> int | None:
        """Return the number of the next looser level in a single goal; None for the first level."""
        step = 1
        for axis in reversed(self._axes):
            if number // step % len(axis):
                return number - step
            step *= len(axis)
        return None

    @property
    def _axes(self) -> tuple[list[Any], ...]:
        """Levels of each goal, the loosest first."""
        levels = [
            sorted(
                getattr(self, name),
                key=get_args(Failing).index if name == "rotor_out" else None,
                reverse=name in ("peak_input", "joint_moment", "speed"),
            )
            for name in Level._fields
        ]
        return tuple(axis or [None] for axis in levels)


def broken_goals(task: Task) -> Broken:
    """Yield broken rules about goals."""
    if task.goals.speed and not task.exposure:
        yield ("goals", "speed"), f"needs an exposure, but got {show(task.goals.speed)}"
    if task.goals.modules and len(task.sizes) == 1:
        yield ("goals", "modules"), f"needs a range of sizes, [fewest, most], but got modules = {task.modules}"
    if task.goals.names and len(task.sizes) > 1:
        rule = (
            'must be "SI" to compare efforts of several sizes, but got "weight", which grows with the size '
            "(carries_weight = true adds the weight of each)"
        )
        if task.load_cases == "ten-wrenches":
            yield ("load_cases",), f"units {rule}"
        else:
            for k, case in enumerate(task.load_cases):
                if case.units == "weight" and case.largest:
                    yield ("load_cases", k, "units"), rule

"""Options of the search, and goals besides control effort, which are bounds with several levels.

A design of least effort is at its bounds. So a goal is a bound, and the trade-off results from solving the task
once for each of its levels (the epsilon-constraint method).
"""

from __future__ import annotations

import math
from itertools import pairwise, product
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_args

from pydantic import AfterValidator, Field

from topo_search.limits import LIMITS
from topo_search.model.load_case import Failing
from topo_search.model.value import (
    OMIT_EMPTY,
    Angle,
    Broken,
    Flag,
    NonEmpty,
    NonNegative,
    Omitted,
    OneOf,
    Positive,
    Value,
    at_most,
    show,
)

BodyClearance = Annotated[Positive | Literal[False], OneOf("must be a length or false")]

MIN_STEP_DEG = 0.1
"""Smallest difference of two hinge angles of a set, and smallest step [deg]: the precision of brackets."""


def _check_apart(angles: tuple[float, ...]) -> tuple[float, ...]:
    for low, high in pairwise(sorted(angles)):
        if high - low < MIN_STEP_DEG:
            raise ValueError(f"must differ by {MIN_STEP_DEG:g} deg or more, but got {show([low, high])}")
    return tuple(angle + 0.0 for angle in angles)  # -0.0 becomes 0.0


Angles = Annotated[tuple[Angle, ...], at_most(LIMITS.hinge_angles), NonEmpty, AfterValidator(_check_apart)]


class Search(Value):
    """Options of the search and the solver."""

    root: Literal["free", "paper"] = "free"
    """`free`: any root orientation; `paper`: psi = 0 and both angles within +-90 deg."""
    connectors: Literal["aligned", "any"] = "aligned"
    """`aligned`: parent port a meets child port a + 2; `any`: any port of the child."""
    # Of 1,000 designs solved without a margin the worst overlaps by 8.5e-10 m; a margin of 1.1e-8 m would have made
    # all of them clear (tests/benchmarks/smooth_error.py). The default is much larger: it costs 0.013 % of the
    # effort where measured, and leaves room for larger modules and for checks less exact than the audit.
    margin: NonNegative = 1.0e-4
    """Clearance that the solver adds to every geometric requirement [m]."""
    interference: Literal["airflow", "parts", "separation"] = "airflow"
    """`airflow`: envelopes of two modules must not overlap; `parts`: they may merge, but rotors, hubs and arms stay
    out of other modules' envelopes; `separation`: the paper's ablation, a minimum distance of module centres."""
    separation: Positive | None = None
    """Minimum distance of module centres in the ablation [m]; default: 2 arm_length."""
    peak_input: Annotated[Positive, Field(le=1, exclude_if=lambda given: given == 1.0)] = 1.0
    """Largest squared speed of a rotor in a load case, as a share of u_max."""
    body_clearance: BodyClearance | None = None
    """Minimum distance of centres of modules not bolted together [m]; default: 2 (arm_length + rotor_radius); or
    false."""
    centre_margin: Omitted[NonNegative] = None
    """Margin of these centres [m] beyond what errors within [tolerances] take, at most `margin` in all; default: as
    much as `margin`. A run that raises `margin` for tolerances sets it."""
    hinge_step_deg: Omitted[Annotated[float, Field(strict=True, ge=MIN_STEP_DEG, le=90)]] = None
    """Hinge angles are multiples of this step within +-90 deg [deg]; default: any angle."""
    hinge_angles_deg: Omitted[Angles] = None
    """Hinge angles are these values of either sign [deg]; an alternative to a step."""

    @property
    def least_margin(self) -> float:
        """Smallest margin that every clearance between modules keeps, which the solver's proofs use [m]."""
        return self.margin if self.centre_margin is None else min(self.margin, self.centre_margin)

    @property
    def hinge_set_deg(self) -> tuple[float, ...] | None:
        """Allowed hinge angles in ascending order, both signs of each [deg]; None if any angle is allowed.

        A hinge angle [rad] is exactly `math.radians` of one of them.
        """
        angles = self.hinge_angles_deg
        if self.hinge_step_deg is not None:
            steps = math.floor(90 / self.hinge_step_deg * (1 + 1e-12))  # 90 is a multiple of 0.9 = 90 / 100
            angles = tuple(min(k * self.hinge_step_deg, 90.0) for k in range(steps + 1))
        if angles is None:
            return None
        return tuple(sorted({-angle for angle in angles if angle} | set(angles)))

    @property
    def any_angle(self) -> Search:
        """Options without a set of hinge angles."""
        return self.model_copy(update={"hinge_step_deg": None, "hinge_angles_deg": None})

    def _broken_rules(self) -> Broken:
        if self.hinge_step_deg is not None and self.hinge_angles_deg is not None:
            text = f"must be left out if hinge_angles_deg is given, but got {self.hinge_step_deg:g}"
            yield "hinge_step_deg", text
        if self.interference == "separation" and self.body_clearance:
            text = f'must be false or left out with interference = "separation", but got {self.body_clearance}'
            yield "body_clearance", text


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

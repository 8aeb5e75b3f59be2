"""Load cases: wrenches that rotors must produce at the end-effector, at the COM, or both; and reserves around them.

Gravity is included only in load cases with `carries_weight`. `f_E` is the force that the platform exerts at the
end-effector. To carry the weight is a load case like any other, or a part of one: the COM force [0, 0, m_t g].

A load case may be a cone of forces, covered by corners:

| symbol | meaning | shape |
|---|---|---|
| a, theta | the cone's axis, a unit vector, and its half-angle | (3,), rad |
| F | largest force | |
| m | sides of the polygon around the cone | |

The forces f with a . f <= F in a pyramid of m sides around the cone contain all forces of the cone up to the size
F. Their corners are zero and F (a + tan(theta) / cos(pi / m) e_j), with e_j at equal angles across the axis. If all
corners can be produced, so can all forces between them, because the wrenches of fixed angles are a convex set. The
cover is conservative: a corner is sqrt(1 + tan(theta)^2 / cos(pi / m)^2) times as large as F.

A task may also require reserves around some load cases, and flight with a dead rotor.

| symbol | meaning | unit |
|---|---|---|
| r | radius of the ball, or horizontal disc, of forces or torques that can be added | N, N m |
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from topo_search.limits import LIMITS
from topo_search.model.arrays import Array
from topo_search.model.exposure import Direction
from topo_search.model.shape import NOWHERE
from topo_search.model.value import (
    OMIT_EMPTY,
    Angle,
    Broken,
    Flag,
    NonNegative,
    Omitted,
    OneOf,
    Positive,
    PositiveOrZero,
    Value,
    Vector,
    at_most,
    omit_if,
    show,
)

if TYPE_CHECKING:
    from topo_search.model.task import ResolvedTask


class ForceCone(Value):
    """All forces up to a size within an angle of an axis."""

    axis: Direction
    """Axis of the cone, in the task frame."""
    half_angle_deg: Annotated[float, Field(strict=True, gt=0, le=60.0)]
    """theta: half-angle [deg]; above 60, corners would be more than twice as large as the cone's forces."""
    force: Positive
    """F: largest force, in the units of the load case."""

    @property
    def corners(self) -> tuple[Vector, ...]:
        """Corners that cover the cone, zero first, in the units of F."""
        m = 8  # the pyramid is then 8 % wider than the cone at its edges
        a = np.array(self.axis) / math.hypot(*self.axis)
        across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        across /= np.linalg.norm(across)
        angles = 2 * np.pi / m * np.arange(m)
        e = np.multiply.outer(np.cos(angles), across) + np.multiply.outer(np.sin(angles), np.cross(a, across))
        out = math.tan(math.radians(self.half_angle_deg)) / math.cos(math.pi / m)
        rim = self.force * (a + out * e)
        return ((0.0, 0.0, 0.0), *((float(x), float(y), float(z)) for x, y, z in rim))

    def scale(self, force_unit: float) -> ForceCone:
        """Return the cone with its force scaled."""
        return self.model_copy(update={"force": self.force * force_unit})


MAX_LOAD = 1e15
"""Largest component of a load case [N, N m]; derived numbers stay finite."""


def _name(name: str) -> str:
    if not re.fullmatch(r"\w[\w .+-]{0,38}[\w.+]|\w", name):
        raise ValueError("must be 1 to 40 letters, digits, spaces and any of . _ + -, a letter or digit first")
    return name


class Wrench(Value):
    """Force and torque in the task frame, in the units of the load case."""

    force: Vector = (0.0, 0.0, 0.0)
    torque: Vector = (0.0, 0.0, 0.0)

    def scale(self, force_unit: float, torque_unit: float) -> Wrench:
        """Return the wrench with force and torque scaled."""
        force, torque = (x * force_unit for x in self.force), (x * torque_unit for x in self.torque)
        return Wrench.model_validate({"force": tuple(force), "torque": tuple(torque)})


class LoadCase(Value):
    """Wrench that the platform must be able to exert, and the weight of its effort."""

    name: Omitted[Annotated[str, AfterValidator(_name)]] = None
    """Name that appears wherever the load case is mentioned."""
    units: Literal["weight", "SI"] = "weight"
    """`weight`: forces in m_t g, torques in l_arm m_t g; `SI`: N and N m."""
    end_effector: Wrench | None = None
    """f_E, tau_E: wrench exerted at the end-effector."""
    com: Wrench | None = None
    """f_C, tau_C: wrench exerted at the platform's centre of mass."""
    carries_weight: Annotated[Flag, OMIT_EMPTY] = False
    """True if the platform's weight [0, 0, m_t g] is added to f_C, for any number of modules."""
    grows: Omitted[Literal["weight", "all"]] = None
    """Part that scales with the platform's weight if a rod counts: `weight`, the part of f_C that carries it, or
    `all` for a case in units of weight. Set in designs, not in tasks."""
    weight: PositiveOrZero = 1.0
    """lambda_k: weight of this case's effort in the objective; 0: it must be possible but adds no effort."""
    cone: Omitted[ForceCone] = None
    """Also required: every force in this cone, in place of the force at the end-effector."""
    vertices: Annotated[tuple[Wrench, ...], at_most(LIMITS.load_cases, "vertices"), OMIT_EMPTY] = ()
    """Also required: every wrench in the convex hull of these and the one at the end-effector."""

    def _broken_rules(self) -> Broken:
        if not (self.end_effector or self.com or self.carries_weight or self.cone or self.vertices):
            yield (), "must have at least one of `end_effector`, `com` and `carries_weight`, but got none"

    @property
    def at_end_effector(self) -> Wrench:
        """Wrench at the end-effector; zero by default."""
        return self.end_effector or Wrench()

    @property
    def at_com(self) -> Wrench:
        """Wrench at the COM; zero by default."""
        return self.com or Wrench()

    @property
    def largest(self) -> float:
        """Largest absolute component of force or torque, without the carried weight."""
        wrenches = [self.at_end_effector, self.at_com, *(corner.at_end_effector for corner in self.corners)]
        return max(abs(x) for wrench in wrenches for x in (*wrench.force, *wrench.torque))

    @property
    def corners(self) -> tuple[LoadCase, ...]:
        """Corners of the set of wrenches other than the case's own wrench, as load cases without weight."""
        tool = self.at_end_effector
        cone = [tool.model_copy(update={"force": force}) for force in (self.cone.corners if self.cone else ())]
        others = dict.fromkeys(wrench for wrench in (*cone, *self.vertices) if wrench != tool)
        plain = {"name": None, "weight": 0.0, "cone": None, "vertices": ()}
        return tuple(self.model_copy(update={**plain, "end_effector": wrench}) for wrench in others)

    def to_si(self, force_unit: float, torque_unit: float, *, grows: bool = False) -> LoadCase:
        """Return the load case in N and N m, with the weight as a force, given m_t g [N] and l_arm m_t g [N m].

        `grows`: True if m_t depends on the design.
        """
        case = self
        if self.units == "weight":
            case = self.scale(force_unit, torque_unit).model_copy(update={"units": "SI"})
        if self.carries_weight:
            case = case._carry(force_unit).model_copy(update={"carries_weight": False})
        if grows and (self.units == "weight" or self.carries_weight):
            case = case.model_copy(update={"grows": "all" if self.units == "weight" else "weight"})
        return case

    def regrow(self, before: float, after: float) -> LoadCase:
        """Return the load case after a change of the platform's weight [N]."""
        if self.grows == "all":
            return self.scale(after / before, after / before)
        return self._carry(after - before) if self.grows == "weight" else self

    def scale(self, force_unit: float, torque_unit: float) -> LoadCase:
        """Return the load case with forces and torques scaled."""
        units = force_unit, torque_unit
        scaled = {
            "end_effector": self.end_effector and self.end_effector.scale(*units),
            "com": self.com and self.com.scale(*units),
            "cone": self.cone and self.cone.scale(force_unit),
            "vertices": tuple(wrench.scale(*units) for wrench in self.vertices),
        }
        return self.model_copy(update=scaled)

    def _carry(self, weight: float) -> LoadCase:
        x, y, z = self.at_com.force
        com = self.at_com.model_copy(update={"force": (x, y, z + weight)})
        return self.model_copy(update={"com": com})


def labels(cases: Sequence[LoadCase]) -> tuple[str, ...]:
    """Return the labels of load cases: their numbers, and names if they have any."""
    return tuple(f"load case {k}" + (f" ({case.name})" if case.name else "") for k, case in enumerate(cases))


def broken_rules(cases: Sequence[LoadCase], force_unit: float, torque_unit: float) -> Broken:
    """Yield the rules that load cases break, given m_t g [N] and l_arm m_t g [N m]."""
    for k, case in enumerate(cases):
        factor, units = (max(force_unit, torque_unit), " weights") if case.units == "weight" else (1.0, "")
        carried, weight = (force_unit, f" and the weight, {force_unit:.4g} N") if case.carries_weight else (0.0, "")
        if not case.largest * factor + carried <= MAX_LOAD:
            text = f"must be at most {MAX_LOAD:g} N and N m, but got {show(case.largest)}{units}{weight}"
            yield ("load_cases", k), text
    if (number := len(cases) + sum(len(case.corners) for case in cases)) > LIMITS.load_cases:
        rule = f"must have at most {LIMITS.load_cases} entries, corners of sets included"
        yield "load_cases", f"{rule}, but got {number:,}"
    names = [case.name for case in cases]
    for k, name in enumerate(names):
        if name is not None and (first := names.index(name)) < k:
            yield ("load_cases", k, "name"), f"must differ from that of load_cases[{first}], but got {show(name)}"
    if not any(case.weight for case in cases):
        yield "load_cases", "must have a weight greater than 0 in at least one entry, but got 0 in each"


def ten_wrenches(task_seed: int) -> tuple[LoadCase, ...]:
    """Return nine random end-effector wrenches and the hover case (paper, Sec. IV).

    Forces are uniform in [-0.2, 0.2], [-0.2, 0.2], [0.8, 1.2] m_t g, torques in +-0.2 l_arm m_t g, drawn from
    `numpy.random.default_rng(task_seed)`.
    """
    low, high = [-0.2, -0.2, 0.8, -0.2, -0.2, -0.2], [0.2, 0.2, 1.2, 0.2, 0.2, 0.2]
    rows = np.random.default_rng(task_seed).uniform(low, high, size=(9, 6)).tolist()
    drawn = [LoadCase(end_effector=Wrench(force=tuple(row[:3]), torque=tuple(row[3:]))) for row in rows]
    return (*drawn, LoadCase(com=Wrench(force=(0.0, 0.0, 1.0))))


AXIS_DISTANCE, DIAGONAL_DISTANCE = math.sqrt(5) / 2, math.sqrt(5 / 3)
"""Distances of the corners of a tetrakis hexahedron around the unit ball: the polar dual of a truncated octahedron,
whose circumradius is sqrt(5/2) and whose faces are sqrt(2) and sqrt(3/2) from the centre."""
LargestLoad = Annotated[Positive | Literal["rated"], OneOf('must be a number or "rated"')]
Failing = Literal["none", "hover", "all"]
PointSuffix = Literal["", "_com"]
POINT_SUFFIXES: dict[str, tuple[PointSuffix, ...]] = {"tip": ("",), "com": ("_com",), "both": ("", "_com")}
"""Suffixes of a force reserve's name in an audit, by `flight.at`: at the end-effector, at the centre of mass."""
AT: dict[PointSuffix, str] = {"": "", "_com": " at the centre of mass"}
"""Words for the point of action, after those for the reserve."""
ROTOR_OUT_TORQUE = 0.01
"""Default of `flight.rotor_out_torque` [l_arm m_t g]."""
ReserveCentre = tuple[int, str, LoadCase]
"""Centre of a reserve: number (0: hover, k + 1: load case k), label, load case."""


class AskedFlight(Value):
    """Capabilities required of a design beyond its load cases; all others are measured, but not required."""

    units: Literal["weight", "SI"] = "weight"
    """Units of the reserves: `weight`: m_t g and l_arm m_t g; `SI`: N and N m."""
    around: Literal["hover", "all"] = "hover"
    """Cases with required reserves: `hover`, or `all`: hover and every load case that carries the weight."""
    force_reserve: NonNegative = 0.0
    """Any force of this size can be added, with unchanged torque about its point of action."""
    at: Annotated[Literal["tip", "com", "both"], omit_if("tip")] = "tip"
    """Point of action of the force reserve: the end-effector (`tip`), the centre of mass, where gusts and position
    control act (`com`), or either (`both`)."""
    directions: Literal["all", "horizontal"] = "all"
    """Directions of the force reserve: `all`, or `horizontal`: in the xy plane."""
    torque_reserve: NonNegative = 0.0
    """Any torque of this size can be added, with unchanged force."""
    com_error: Annotated[NonNegative, omit_if(0.0)] = 0.0
    """Largest offset of the centre of mass along each axis of the body: hover, and the reserves, tilt and
    accelerations required here with all rotors alive, remain possible [m]."""
    tilt_deg: Annotated[Angle, omit_if(0.0)] = 0.0
    """Hover is possible at any tilt up to this, in every direction [deg]."""
    angular_acceleration: Annotated[tuple[NonNegative, NonNegative, NonNegative], omit_if(NOWHERE)] = NOWHERE
    """Angular acceleration about x, y and z of the body, one at a time, in both senses, with unchanged force
    [rad/s^2]."""
    allocator: Annotated[Literal["optimal", "pseudo-inverse"], omit_if("optimal")] = "optimal"
    """Inputs for the reserves, tilt and accelerations above: `optimal`: any feasible ones; `pseudo-inverse`: those
    of autopilots before they desaturate. Both are measured."""
    rotor_out: Annotated[Failing, omit_if("none")] = "none"
    """Required after any single rotor failure: `hover`, or `all`: also every load case that carries the weight."""
    rotor_out_torque: Omitted[NonNegative] = None
    """Any torque of this size can then be added, for attitude control; default: 0.01 l_arm m_t g."""
    joint_moment: Omitted[LargestLoad] = None
    """Largest moment in a joint, about its connector, in any load case [N m]; `rated`: module.joint_moment."""
    joint_force: Omitted[LargestLoad] = None
    """Largest force in a joint [N]; `rated`: module.joint_force."""
    grows: Annotated[Flag, OMIT_EMPTY] = False
    """True if reserves scale with the platform's weight if a rod counts. Set in designs, not in tasks."""
    tolerances: Omitted[Flag] = None
    """True if clearances must provably survive all errors within [tolerances], which costs effort like a margin;
    false: they are only measured; default: true for a new task with tolerances, false for older files."""

    @property
    def keeps_reserves(self) -> bool:
        """True if reserves are required with all rotors alive."""
        sizes = self.force_reserve, self.torque_reserve, self.com_error, *self.angular_acceleration
        return any(size > 0 for size in sizes)

    @property
    def asks(self) -> bool:
        """True if any capability is required."""
        options = {"units", "around", "at", "directions", "allocator", "grows"}
        return self != AskedFlight(**{name: getattr(self, name) for name in options})

    def to_si(self, force_unit: float, torque_unit: float, *, grows: bool = False) -> AskedFlight:
        """Return the requirements in N and N m, given m_t g [N] and l_arm m_t g [N m]; the default without any.

        `grows`: True if m_t depends on the design.
        """
        if not self.asks:
            return AskedFlight()
        f, t = (force_unit, torque_unit) if self.units == "weight" else (1.0, 1.0)
        changed: dict[str, object] = {
            "units": "SI",
            "force_reserve": self.force_reserve * f,
            "torque_reserve": self.torque_reserve * t,
            "grows": self.grows or (grows and self.units == "weight"),
        }
        if self.rotor_out != "none":
            torque = self.rotor_out_torque
            changed["rotor_out_torque"] = ROTOR_OUT_TORQUE * torque_unit if torque is None else torque * t
        return self.model_copy(update=changed)

    def regrow(self, ratio: float) -> AskedFlight:
        """Return the requirements for a platform whose weight is scaled by `ratio`."""
        if not self.grows:
            return self
        names = ("force_reserve", "torque_reserve", "rotor_out_torque")
        radii = {name: getattr(self, name) for name in names}
        return self.model_copy(update={name: r * ratio for name, r in radii.items() if r is not None})


def centres(task: ResolvedTask) -> list[ReserveCentre]:
    """Return the centres of the required reserves; none if no reserves are required."""
    return weight_cases(task, task.flight.around) if task.flight.keeps_reserves else []


def weight_cases(task: ResolvedTask, which: Literal["hover", "all"]) -> list[ReserveCentre]:
    """Return hover, or hover and every load case that carries the weight, all without effort."""
    weight = task.force_unit(task.n)
    hover = LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, weight)), weight=0.0)
    centres = [(0, "hover", hover)]
    if which == "all":
        for k, (label, case) in enumerate(zip(task.case_labels, task.load_cases, strict=True)):
            if case.at_com.force[2] >= weight * (1 - 1e-9):  # up to rounding
                plain = {"name": None, "weight": 0.0, "cone": None, "vertices": ()}
                centres.append((k + 1, label, case.model_copy(update=plain)))
    return centres


def broken_reserves(flight: AskedFlight, cases: int, n: int, force_unit: float, torque_unit: float) -> Broken:
    """Yield the rules that reserves break, given the number of load cases and corners, and n modules."""
    for field, r, unit in (
        ("force_reserve", flight.force_reserve, force_unit),
        ("torque_reserve", flight.torque_reserve, torque_unit),
        ("rotor_out_torque", flight.rotor_out_torque, torque_unit),
    ):
        factor, units = (unit, " weights") if flight.units == "weight" else (1.0, "")
        if r is not None and not r * factor <= MAX_LOAD:
            yield ("flight", field), f"must be at most {MAX_LOAD:g} N and N m, but got {r:g}{units}"
    wrenches = len(circumscribe(disc=flight.directions == "horizontal")) * (flight.force_reserve > 0)
    wrenches *= len(POINT_SUFFIXES[flight.at])
    wrenches += len(circumscribe(disc=False)) * (flight.torque_reserve > 0)
    wrenches += 2 * sum(map(bool, flight.angular_acceleration))
    wrenches *= 1 + cases * (flight.around == "all")
    wrenches += len(cap(math.radians(flight.tilt_deg), inner=False)) * (flight.tilt_deg > 0)
    if wrenches and (number := cases + wrenches) > LIMITS.load_cases:
        text = f"must ask for at most {LIMITS.load_cases} wrenches with all load cases, but got up to {number:,}"
        yield ("flight",), text
    failures = 4 * n * len(circumscribe(disc=False)) * (1 + cases * (flight.rotor_out == "all"))
    if flight.rotor_out != "none" and failures > LIMITS.failures:
        text = f"must ask for at most {LIMITS.failures:,} wrenches with a rotor dead, but got up to {failures:,}"
        yield ("flight", "rotor_out"), text


def box_corners(half: float) -> Array:
    """Return the corners of a cube centred at zero, shape (8, 3)."""
    return half * np.array(list(product((1.0, -1.0), repeat=3)))


def rotor_name(rotor: int) -> str:
    """Return the name of a rotor, given its number in module-major order."""
    return f"rotor {rotor % 4} of module {rotor // 4}"


def circumscribe(*, disc: bool) -> Array:
    """Return the corners of a polytope around the unit ball, or of a polygon around the unit disc, shape (c, 3)."""
    if disc:
        sides = 8  # corners of the polygon are then 8 % farther out
        angles, out = 2 * np.pi / sides * np.arange(sides), 1 / math.cos(math.pi / sides)
        return out * np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1)
    return np.concatenate(
        [AXIS_DISTANCE * np.eye(3), -AXIS_DISTANCE * np.eye(3), DIAGONAL_DISTANCE * box_corners(1 / math.sqrt(3))]
    )


def directions(*, disc: bool) -> Array:
    """Return unit vectors towards the corners of `circumscribe`, shape (c, 3)."""
    corners = circumscribe(disc=disc)
    return np.asarray(corners / np.linalg.norm(corners, axis=1, keepdims=True))


def cap(half_angle: float, *, inner: bool) -> Array:
    """Return the corners of a polytope around a cap of the unit sphere about z, or points on its rim, shape (c, 3).

    Its faces are planes that touch the cap at its rim and at its top, so that no corner is above the cap.
    """
    t, disc, z = half_angle, circumscribe(disc=True), np.array([0.0, 0.0, 1.0])
    if inner:
        return np.asarray(math.sin(t) * directions(disc=True) + math.cos(t) * z)
    return np.concatenate([math.sin(t) * disc + math.cos(t) * z, math.tan(t / 2) * disc + z])

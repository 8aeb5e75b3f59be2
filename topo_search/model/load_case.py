"""Load cases: wrenches that rotors must produce at the end-effector, at the COM, or both.

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
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field

from topo_search.limits import LIMITS
from topo_search.model.exposure import AnyExposure, Direction, object_beyond
from topo_search.model.kinds import OMIT_EMPTY, Flag, Omitted, Positive, PositiveOrZero, Vector, at_most, is_zero
from topo_search.model.shape import unit
from topo_search.model.value import Broken, Value, show


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


Failing = Literal["none", "hover", "all"]
"""Load cases that must be possible with any one rotor dead."""
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
    contact: Omitted[Literal["push", "pull"]] = None
    """`push`: an object fills the half-space beyond the end-effector on the side of the force at it; `pull`: on the
    other side. Rigid parts and rod stay out of it, air may enter. In designs it is an exposure requirement."""
    weight: PositiveOrZero = 1.0
    """lambda_k: weight of this case's effort in the objective; 0: it must be possible but adds no effort."""
    cone: Omitted[ForceCone] = None
    """Also required: every force in this cone, in place of the force at the end-effector."""
    vertices: Annotated[tuple[Wrench, ...], at_most(LIMITS.load_cases, "vertices"), OMIT_EMPTY] = ()
    """Also required: every wrench in the convex hull of these and the one at the end-effector."""

    def _broken_rules(self) -> Broken:
        if not (self.end_effector or self.com or self.carries_weight or self.cone or self.vertices):
            yield (), "must have at least one of `end_effector`, `com` and `carries_weight`, but got none"
        if self.contact is not None and is_zero(self.at_end_effector.force):
            yield "contact", f"must be left out without a force at the end-effector, but got {show(self.contact)}"

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

        Its contact is not part of it (see `objects`). `grows`: True if m_t depends on the design.
        """
        case = self.model_copy(update={"contact": None})
        if self.units == "weight":
            case = case.scale(force_unit, torque_unit).model_copy(update={"units": "SI"})
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

    def scale_tool(self, factor: float) -> LoadCase:
        """Return the load case with all that acts at the end-effector scaled; the force at the COM stays."""
        return self.scale(factor, factor).model_copy(update={"com": self.com})

    def _carry(self, weight: float) -> LoadCase:
        x, y, z = self.at_com.force
        com = self.at_com.model_copy(update={"force": (x, y, z + weight)})
        return self.model_copy(update={"com": com})


class Corner(NamedTuple):
    """Wrench that must be possible."""

    label: str
    """Name of the wrench."""
    case: LoadCase
    dead: int | None = None
    """Number of a dead rotor, in module-major order."""
    acceleration: Vector = (0.0, 0.0, 0.0)
    """Angular acceleration of the platform [rad/s^2]; adds inertia times acceleration to the torque."""


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


def objects(cases: Sequence[LoadCase]) -> tuple[AnyExposure, ...]:
    """Return the objects that load cases are in contact with, as regions; equal ones once."""
    numbers: dict[Vector, int] = {}
    for k, case in enumerate(cases):
        if case.contact is not None:
            side = 1.0 if case.contact == "push" else -1.0
            x, y, z = (side * component + 0.0 for component in unit(case.at_end_effector.force))
            numbers.setdefault((x, y, z), k)
    return tuple(object_beyond(outwards, k) for outwards, k in numbers.items())


def ten_wrenches(task_seed: int) -> tuple[LoadCase, ...]:
    """Return nine random end-effector wrenches and the hover case (paper, Sec. IV).

    Forces are uniform in [-0.2, 0.2], [-0.2, 0.2], [0.8, 1.2] m_t g, torques in +-0.2 l_arm m_t g, drawn from
    `numpy.random.default_rng(task_seed)`.
    """
    low, high = [-0.2, -0.2, 0.8, -0.2, -0.2, -0.2], [0.2, 0.2, 1.2, 0.2, 0.2, 0.2]
    rows = np.random.default_rng(task_seed).uniform(low, high, size=(9, 6)).tolist()
    drawn = [LoadCase(end_effector=Wrench(force=tuple(row[:3]), torque=tuple(row[3:]))) for row in rows]
    return (*drawn, LoadCase(com=Wrench(force=(0.0, 0.0, 1.0))))

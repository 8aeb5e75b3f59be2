"""Capabilities that a task requires beyond its load cases: reserves around them, and flight with a dead rotor.

| symbol | meaning | unit |
|---|---|---|
| r | radius of the ball, or horizontal disc, of forces or torques that can be added | N, N m |

A ball is not a polytope. A design keeps a reserve if all corners of a polytope around the ball can be added: a
tetrakis hexahedron, which is a cube with a low pyramid on each face, or an octagon around a disc. Both have all
mirror symmetries of a cube, so the task keeps its own. A tilt requires a spherical cap of forces, which a frustum
contains. If the centre of mass has errors, forces acting there have lever arms, and torques are linear in these:
the corners of the box of errors decide.
A proof of impossibility may only use points of ball and cap themselves: `inner`. The audit measures ball and cap.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from topo_search.limits import LIMITS
from topo_search.model.arrays import Array
from topo_search.model.goals import GOALS
from topo_search.model.kinds import OMIT_EMPTY, Angle, Flag, NonNegative, Omitted, OneOf, Positive, Vector, omit_if
from topo_search.model.load_case import MAX_LOAD, Corner, Failing, LoadCase, Wrench
from topo_search.model.proven import TOLERANCE
from topo_search.model.sensitivity import Tolerances
from topo_search.model.shape import NOWHERE
from topo_search.model.value import Broken, Value, show

if TYPE_CHECKING:
    from topo_search.model.task import ResolvedTask, Task

AUDIT_TOLERANCE = 5 * TOLERANCE
"""Tolerance of the audit on a reserve [m_t g, l_arm m_t g]."""
AXIS_DISTANCE, DIAGONAL_DISTANCE = math.sqrt(5) / 2, math.sqrt(5 / 3)
"""Distances of the corners of a tetrakis hexahedron around the unit ball: the polar dual of a truncated octahedron,
whose circumradius is sqrt(5/2) and whose faces are sqrt(2) and sqrt(3/2) from the centre."""
LargestLoad = Annotated[Positive | Literal["rated"], OneOf('must be a number or "rated"')]
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
    defaults: Annotated[Literal[True, False] | tuple[str, ...], OneOf("must be true or false"), omit_if(True)] = (
        True
    )
    """True if a task that carries the weight asks for what flying needs where it leaves a field of [flight],
    [tolerances] or module.min_input out; false: for nothing. A run lists the fields that were left out."""
    dropped: Annotated[tuple[str, ...], OMIT_EMPTY] = ()
    """Defaults of flying tasks that no design holds, so that this one was solved without. Set in designs."""
    tolerances: Omitted[Flag] = None
    """True if clearances must provably survive all errors within [tolerances], which costs effort like a margin;
    false: they are only measured; default: true for a new task with tolerances, false for older files."""

    @property
    def keeps_reserves(self) -> bool:
        """True if reserves are required with all rotors alive."""
        sizes = self.force_reserve, self.torque_reserve, self.com_error, *self.angular_acceleration
        return any(size > 0 for size in sizes)

    @property
    def filled(self) -> tuple[str, ...]:
        """Fields that the task left out and that have the default of flying tasks."""
        return self.defaults if isinstance(self.defaults, tuple) else ()

    @property
    def asks(self) -> bool:
        """True if any capability is required."""
        options = {"units", "around", "at", "directions", "allocator", "grows", "defaults", "dropped"}
        return self != AskedFlight(**{name: getattr(self, name) for name in options})

    def to_si(
        self, force_unit: float, torque_unit: float, *, grows: bool = False, maximized: bool = False
    ) -> AskedFlight:
        """Return the requirements in N and N m, given m_t g [N] and l_arm m_t g [N m]; the default without any.

        `grows`: True if m_t depends on the design; `maximized`: True if a reserve is still to be asked for.
        """
        if not self.asks and not maximized:
            return AskedFlight(dropped=self.dropped)
        f, t = (force_unit, torque_unit) if self.units == "weight" else (1.0, 1.0)
        f = force_unit if "flight.force_reserve" in self.filled else f
        changed: dict[str, object] = {
            "units": "SI",
            "defaults": True,
            "force_reserve": self.force_reserve * f,
            "torque_reserve": self.torque_reserve * t,
            "grows": self.grows or (grows and self.units == "weight"),
        }
        if self.rotor_out != "none":
            torque = self.rotor_out_torque
            changed["rotor_out_torque"] = ROTOR_OUT_TORQUE * torque_unit if torque is None else torque * t
        return self.model_copy(update=changed)

    def regrow(self, ratio: float, maximized: str | None) -> AskedFlight:
        """Return the requirements for a platform whose weight is scaled by `ratio`, but for a maximised field."""
        if not self.grows:
            return self
        names = {"force_reserve", "torque_reserve", "rotor_out_torque"} - {maximized}
        radii = {name: getattr(self, name) for name in names}
        return self.model_copy(update={name: r * ratio for name, r in radii.items() if r is not None})

    def broken_reserves(self, cases: int, rotors: int, force_unit: float, torque_unit: float) -> Broken:
        """Yield the rules that reserves break, given the numbers of load cases with corners, and of rotors."""
        for field, r, unit in (
            ("force_reserve", self.force_reserve, force_unit),
            ("torque_reserve", self.torque_reserve, torque_unit),
            ("rotor_out_torque", self.rotor_out_torque, torque_unit),
        ):
            factor, units = (unit, " weights") if self.units == "weight" else (1.0, "")
            if r is not None and not r * factor <= MAX_LOAD:
                yield ("flight", field), f"must be at most {MAX_LOAD:g} N and N m, but got {r:g}{units}"
        wrenches = len(circumscribe(disc=self.directions == "horizontal")) * (self.force_reserve > 0)
        wrenches *= len(POINT_SUFFIXES[self.at])
        wrenches += len(circumscribe(disc=False)) * (self.torque_reserve > 0)
        wrenches += 2 * sum(map(bool, self.angular_acceleration))
        wrenches *= 1 + cases * (self.around == "all")
        wrenches += len(cap(math.radians(self.tilt_deg), inner=False)) * (self.tilt_deg > 0)
        if wrenches and (number := cases + wrenches) > LIMITS.load_cases:
            rule = f"must ask for at most {LIMITS.load_cases} wrenches with all load cases"
            yield ("flight",), f"{rule}, but got up to {number:,}"
        failures = rotors * len(circumscribe(disc=False)) * (1 + cases * (self.rotor_out == "all"))
        if self.rotor_out != "none" and failures > LIMITS.failures:
            rule = f"must ask for at most {LIMITS.failures:,} wrenches with a rotor dead"
            yield ("flight", "rotor_out"), f"{rule}, but got up to {failures:,}"


def broken_flight(task: Task) -> Broken:
    """Yield contradictions and missing fields of the required capabilities."""
    torque = task.flight.rotor_out_torque
    if torque is not None and {task.flight.rotor_out, *task.goals.rotor_out} == {"none"}:
        yield ("flight", "rotor_out_torque"), f'must be left out if rotor_out = "none", but got {torque:g}'
    if task.flight.tolerances and task.tolerances == Tolerances() and not any(task.goals.hinge_angle_deg):
        rule = "must be false if all of [tolerances] (hinge_angle_deg, position, envelope) are 0"
        yield ("flight", "tolerances"), f"{rule}, but got true"
    if task.search.interference == "parts" and (task.flight.tolerances or any(task.goals.hinge_angle_deg)):
        rule = 'must be "airflow" if clearances must survive [tolerances], which is not proven for parts'
        yield ("search", "interference"), f'{rule}, but got "parts"'
    for name, goal in GOALS.items():
        part, field = goal.field.split(".")
        if part in ("flight", "tolerances") and getattr(task.goals, name):
            table = getattr(task, part)
            if (actual := getattr(table, field)) != type(table).model_fields[field].default:
                rule = f"must be left out if goals.{name} has levels of it"
                yield (part, field), f"{rule}, but got {show(actual)}"
    for field in ("joint_moment", "joint_force"):
        if getattr(task.flight, field) == "rated" and getattr(task.module, field) is None:
            yield ("module", field), f'must be given with flight.{field} = "rated", but is missing'


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
            if carries(case, weight):
                plain = {"name": None, "weight": 0.0, "cone": None, "vertices": ()}
                centres.append((k + 1, label, case.model_copy(update=plain)))
    return centres


def carries(case: LoadCase, weight: float) -> bool:
    """True if a load case in SI carries a weight [N], up to rounding."""
    return case.at_com.force[2] >= weight * (1 - 1e-9)


def box_corners(half: float) -> Array:
    """Return the corners of a cube centred at zero, shape (8, 3)."""
    return half * np.array(list(product((1.0, -1.0), repeat=3)))


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


def reserve_corners(task: ResolvedTask, *, inner: bool) -> list[list[Corner]]:
    """Return the corners of each reserve; points of the balls for the pseudo-inverse, which treats balls exactly.

    `inner`: points of balls and tilts, less the tolerance of the audit, and no accelerations.
    """
    flight, groups = task.flight, list[list[Corner]]()
    optimal, tolerance = flight.allocator == "optimal", AUDIT_TOLERANCE if inner else 0.0
    error, horizontal = flight.com_error - tolerance * task.module.arm_length, flight.directions == "horizontal"
    for _, label, case in centres(task):
        for field, point, r, unit, disc in (
            *(
                ("force", at, flight.force_reserve, task.force_unit(task.n), horizontal)
                for at in POINT_SUFFIXES[flight.at]
            ),
            ("torque", "", flight.torque_reserve, task.torque_unit(task.n), False),
        ):
            vectors = circumscribe(disc=disc)
            if inner or not optimal:
                r, vectors = max(0.0, r - AUDIT_TOLERANCE * unit), directions(disc=disc)
            if seen := task.search.towards and task.search.maximize == f"{field}_reserve":
                vectors = np.array(task.search.towards)
            if r > 0:
                corners = _corners(f"{label}, {field} reserve{AT[point]}", case, field, r * vectors, point)
                groups += [[corner] for corner in corners] if seen else [corners]
        if not inner:
            groups += [[corner] for corner in _acceleration_corners(label, case, flight.angular_acceleration)]
        groups += [[Corner(label, case)]] if error > 0 else []
    if (tilt := math.radians(flight.tilt_deg) - tolerance) > 0 and (inner or optimal):
        (_, label, case), weight = weight_cases(task, "hover")[0], task.force_unit(task.n)
        vectors = weight * (cap(tilt, inner=inner) - np.array([0.0, 0.0, 1.0]))
        groups.append(_corners(f"{label}, tilt", case, "force", vectors, "_com"))
    if error > 0:
        groups = [[off for corner in group for off in _off_centre(corner, error)] for group in groups]
    return groups


def failure_corners(task: ResolvedTask, *, inner: bool = False) -> list[list[Corner]]:
    """Return the wrenches required with each rotor dead: corners around the required torques, or the bare case.

    `inner`: only the bare case.
    """
    flight, groups = task.flight, list[list[Corner]]()
    if flight.rotor_out == "none":
        return groups
    is_placed = not task.module_types or task.types_of_nodes
    rotors = np.flatnonzero(task.input_limits) if is_placed else np.arange(task.rotor_count)
    torques = (0.0 if inner else flight.rotor_out_torque or 0.0) * circumscribe(disc=False)
    for _, label, case in weight_cases(task, flight.rotor_out):
        for rotor in rotors.tolist():
            i, q = divmod(rotor, task.rotors_per_module)
            words = f"{label}, rotor {q} of module {i} dead"
            corners = [Corner(words, case)]
            if torques.any():
                corners = _corners(f"{words}, torque", case, "torque", torques)
            groups.append([corner._replace(dead=rotor) for corner in corners])
    return groups


def _corners(words: str, case: LoadCase, field: str, vectors: Array, point: PointSuffix = "") -> list[Corner]:
    """Return a load case with vectors added to its force or torque, shape (c, 3) [N, N m]."""
    base, side = (case.at_com, "com") if point else (case.at_end_effector, "end_effector")
    corners = list[Corner]()
    for number, corner in enumerate((np.array(getattr(base, field)) + vectors).tolist()):
        x, y, z = corner
        wrench = base.model_copy(update={field: (x, y, z)})
        corners.append(Corner(f"{words} {number}", case.model_copy(update={side: wrench})))
    return corners


def _off_centre(corner: Corner, error: float) -> Iterator[Corner]:
    """Yield a corner with offsets of the centre of mass: the outline of the cube of errors, along the force."""
    com, offsets, numbers = corner.case.at_com, box_corners(error), np.arange(8)
    force = np.array(com.force)
    force[np.abs(force) <= 1e-12 * np.linalg.norm(force)] = 0.0
    if (components := np.count_nonzero(force)) > 1:
        numbers = np.flatnonzero(np.abs(np.sign(offsets * force).sum(axis=1)) < components)
    torques, first = np.unique(np.cross(offsets[numbers], force), axis=0, return_index=True)
    for number, torque in zip(numbers[first], torques, strict=True):
        x, y, z = np.add(com.torque, torque).tolist()
        case = corner.case.model_copy(update={"com": com.model_copy(update={"torque": (x, y, z)})})
        yield corner._replace(label=f"{corner.label}, centre of mass off {number}", case=case)


def _acceleration_corners(label: str, case: LoadCase, sizes: Vector) -> Iterator[Corner]:
    """Yield the corners of accelerations about x, y and z, in both senses [rad/s^2]."""
    for axis, size, unit in zip("xyz", sizes, np.eye(3), strict=True):
        for sign, a in (("+", size * unit), ("-", -size * unit)):
            if size:
                x, y, z = a.tolist()
                yield Corner(f"{label}, angular acceleration about {sign}{axis}", case, acceleration=(x, y, z))

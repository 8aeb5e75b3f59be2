"""Load cases that stand for a set of wrenches, as the single wrenches that decide about it.

For fixed angles the inputs of a load case are a convex set and wrenches are linear in them: if the corners of a set
of wrenches can be produced, so can all of it. A corner is a load case that must be possible and costs nothing. Few
of them bind, so that a solver may begin without any and take in those that it finds missed.

A ball is no polytope. A design keeps a reserve if all corners of a polytope around the ball can be added: a
tetrakis hexahedron, a cube with a low pyramid on each face, or of a disc an octagon. Both have every mirror of a
cube, so that a task that has one keeps it. A tilt asks for a cap of a sphere of forces, which a frustum holds.
Where the centre of mass may be off, forces that act there have levers, in which torques are linear: the corners of
the box of errors decide.
Whoever proves that something is impossible may count on points of ball and cap themselves alone: `inner`. The audit
measures ball and cap themselves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.load_case import (
    AT,
    PLACES,
    AskedFlight,
    LoadCase,
    Place,
    box_corners,
    cap,
    centres,
    centres_of,
    circumscribe,
    directions,
    rotor_name,
)
from topo_search.model.proven import TOLERANCE
from topo_search.model.task import ResolvedTask
from topo_search.model.value import Vector

UNSEEN = 5 * TOLERANCE
"""Tolerance of a reserve, to either side, in an audit [m_t g, l_arm m_t g]."""


class Corner(NamedTuple):
    """A wrench that must be possible."""

    label: str
    """Name of the wrench."""
    case: LoadCase
    dead: int | None = None
    """Rotor that does not run, counted module by module."""
    acceleration: Vector = (0.0, 0.0, 0.0)
    """Angular acceleration of the platform: its inertia times this is added to the torque [rad/s^2]."""


class CorneredTask(ResolvedTask):
    """A task whose sets of wrenches are written out: its own load cases first, then the corners of sets."""

    base: ResolvedTask
    """The task as it stands in a design."""
    corners: tuple[Corner, ...]
    """Corners that follow its own load cases."""
    groups: tuple[int, ...]
    """Number of the set that each corner belongs to."""

    @property
    def case_labels(self) -> tuple[str, ...]:
        """Names of the load cases and corners."""
        return (*self.base.case_labels, *(corner.label for corner in self.corners))

    @property
    def dead_rotors(self) -> tuple[int | None, ...]:
        """The rotor that does not run in each load case and corner."""
        return (*self.base.dead_rotors, *(corner.dead for corner in self.corners))

    @property
    def accelerations(self) -> tuple[Vector, ...]:
        """Angular acceleration of the platform in each load case and corner [rad/s^2]."""
        return (*self.base.accelerations, *(corner.acceleration for corner in self.corners))

    @property
    def declared(self) -> ResolvedTask:
        """The task as it stands in a design."""
        return self.base

    def with_corners(self, corners: Iterable[int]) -> CorneredTask:
        """Return the task with these of its corners alone."""
        kept = sorted(corners)
        return _with_corners(self.base, [self.corners[c] for c in kept], [self.groups[c] for c in kept])


@lru_cache(maxsize=32)
def to_corners(task: ResolvedTask, *, inner: bool = False) -> ResolvedTask:
    """Return the task with every set of wrenches, reserve and failure as corners; the task itself without any.

    Args:
        task: the task.
        inner: whether only what every clear design must be able to do is stated, for proofs: of reserves points of
            the balls themselves, with a rotor dead the case alone; neither where `search.peak_input` is less than
            1, a limit that they do not obey.
    """
    if isinstance(task, CorneredTask):
        return task
    sets = [[Corner(*corner)] for corner in corners_of(task)]
    if not inner or task.search.peak_input == 1:
        sets += reserve_corners(task, inner=inner)
        sets += failure_corners(task, inner=inner)
    if not sets:
        return task
    groups = [number for number, corners in enumerate(sets) for _ in corners]
    return _with_corners(task, [corner for corners in sets for corner in corners], groups)


def corners_of(task: ResolvedTask) -> list[tuple[str, LoadCase]]:
    """Return the corners of all sets of wrenches with what they are called."""
    return [
        (f"{label}, corner {number}", corner)
        for label, case in zip(task.case_labels, task.load_cases, strict=True)
        for number, corner in enumerate(case.corners)
    ]


def _with_corners(task: ResolvedTask, corners: list[Corner], groups: list[int]) -> CorneredTask:
    """Return a task that was checked before with corners written out, maybe more than a file may have."""
    single = (case.model_copy(update={"cone": None, "vertices": ()}) for case in task.load_cases)
    cases = (*single, *(corner.case for corner in corners))
    fields = {**dict(task), "load_cases": cases, "flight": AskedFlight()}
    return CorneredTask.model_construct(**fields, base=task, corners=tuple(corners), groups=tuple(groups))


def reserve_corners(task: ResolvedTask, *, inner: bool) -> list[list[Corner]]:
    """Return the corners around each reserve, or points of the balls themselves, as where rows have the balls.

    `inner`: points of balls and of the tilts themselves, what an audit may not see taken off, and no accelerations.
    """
    flight, groups = task.flight, list[list[Corner]]()
    optimal, unseen = flight.allocator == "optimal", UNSEEN if inner else 0.0
    error, level = flight.com_error - unseen * task.module.arm_length, flight.directions == "horizontal"
    for _, label, case in centres(task):
        for field, point, r, unit, disc in (
            *(("force", at, flight.force_reserve, task.force_unit(task.n), level) for at in PLACES[flight.at]),
            ("torque", "", flight.torque_reserve, task.torque_unit(task.n), False),
        ):
            around = circumscribe(disc=disc)
            if inner or not optimal:
                r, around = max(0.0, r - UNSEEN * unit), directions(disc=disc)
            if r > 0:
                groups.append(_corners(f"{label}, {field} reserve{AT[point]}", case, field, r * around, point))
        if not inner:
            groups += [[corner] for corner in _acceleration_corners(label, case, flight.angular_acceleration)]
        groups += [[Corner(label, case)]] if error > 0 else []
    if (tilt := math.radians(flight.tilt_deg) - unseen) > 0 and (inner or optimal):
        (_, label, case), weight = centres_of(task, "hover")[0], task.force_unit(task.n)
        around = weight * (cap(tilt, inner=inner) - np.array([0.0, 0.0, 1.0]))
        groups.append(_corners(f"{label}, tilt", case, "force", around, "_com"))
    if error > 0:
        groups = [[off for corner in group for off in _off_centre(corner, error)] for group in groups]
    return groups


def failure_corners(task: ResolvedTask, *, inner: bool = False) -> list[list[Corner]]:
    """Return what must be possible with each rotor dead: corners around the torques that are left, or the case.

    `inner`: the case alone.
    """
    flight, groups = task.flight, list[list[Corner]]()
    if flight.rotor_out == "none":
        return groups
    around = (0.0 if inner else flight.rotor_out_torque or 0.0) * circumscribe(disc=False)
    for _, label, case in centres_of(task, flight.rotor_out):
        for rotor in range(4 * task.n):
            words = f"{label}, {rotor_name(rotor)} dead"
            corners = [Corner(words, case)]
            if around.any():
                corners = _corners(f"{words}, torque", case, "torque", around)
            groups.append([corner._replace(dead=rotor) for corner in corners])
    return groups


def _corners(words: str, case: LoadCase, field: str, around: Array, point: Place = "") -> list[Corner]:
    """Return corners around a load case, in its force or torque at a place, shape (c, 3) [N, N m]."""
    given, side = (case.at_com, "com") if point else (case.at_end_effector, "end_effector")
    corners = list[Corner]()
    for number, corner in enumerate((np.array(getattr(given, field)) + around).tolist()):
        x, y, z = corner
        wrench = given.model_copy(update={field: (x, y, z)})
        corners.append(Corner(f"{words} {number}", case.model_copy(update={side: wrench})))
    return corners


def _off_centre(corner: Corner, error: float) -> Iterator[Corner]:
    """Yield a corner with its centre of mass off to every side: at the cube's outline, seen along the force."""
    com, offsets = corner.case.at_com, box_corners(error)
    force = np.array(com.force)
    force[np.abs(force) <= 1e-12 * np.linalg.norm(force)] = 0.0
    if (sides := np.count_nonzero(force)) > 1:
        offsets = offsets[np.abs(np.sign(offsets * force).sum(axis=1)) < sides]
    for number, torque in enumerate(np.unique(np.cross(offsets, force), axis=0)):
        x, y, z = np.add(com.torque, torque).tolist()
        case = corner.case.model_copy(update={"com": com.model_copy(update={"torque": (x, y, z)})})
        yield corner._replace(label=f"{corner.label}, centre of mass off {number}", case=case)


def _acceleration_corners(label: str, case: LoadCase, sizes: Vector) -> Iterator[Corner]:
    """Yield the corners of accelerations about x, y and z, either way [rad/s^2]."""
    for axis, size, unit in zip("xyz", sizes, np.eye(3), strict=True):
        for way, a in (("+", size * unit), ("-", -size * unit)):
            if size:
                x, y, z = a.tolist()
                yield Corner(f"{label}, angular acceleration about {way}{axis}", case, acceleration=(x, y, z))

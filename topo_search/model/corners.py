"""Sets of wrenches, reserves and rotor failures as single wrenches: corners.

For fixed angles the feasible inputs are a convex set and wrenches are linear in them: if all corners of a set of
wrenches can be produced, so can the whole set. A corner is a load case that must be possible and adds no effort.
Few corners are active, so a solver may start without any and add those that it violates.

A ball is not a polytope. A design keeps a reserve if all corners of a polytope around the ball can be added: a
tetrakis hexahedron, which is a cube with a low pyramid on each face, or an octagon around a disc. Both have all
mirror symmetries of a cube, so the task keeps its own. A tilt requires a spherical cap of forces, which a frustum
contains. If the centre of mass has errors, forces acting there have lever arms, and torques are linear in these:
the corners of the box of errors decide.
A proof of impossibility may only use points of ball and cap themselves: `inner`. The audit measures ball and cap.
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
    POINT_SUFFIXES,
    AskedFlight,
    LoadCase,
    PointSuffix,
    box_corners,
    cap,
    centres,
    circumscribe,
    directions,
    rotor_name,
    weight_cases,
)
from topo_search.model.proven import TOLERANCE
from topo_search.model.task import ResolvedTask
from topo_search.model.value import Vector

AUDIT_TOLERANCE = 5 * TOLERANCE
"""Tolerance of the audit on a reserve [m_t g, l_arm m_t g]."""


class Corner(NamedTuple):
    """Wrench that must be possible."""

    label: str
    """Name of the wrench."""
    case: LoadCase
    dead: int | None = None
    """Number of a dead rotor, in module-major order."""
    acceleration: Vector = (0.0, 0.0, 0.0)
    """Angular acceleration of the platform [rad/s^2]; adds inertia times acceleration to the torque."""


class CorneredTask(ResolvedTask):
    """Task whose sets of wrenches are expanded: its own load cases, then the corners of all sets."""

    base: ResolvedTask
    """Task without expansion, as in a design file."""
    corners: tuple[Corner, ...]
    """Corners, after the task's own load cases."""
    groups: tuple[int, ...]
    """Number of the set of each corner."""

    @property
    def case_labels(self) -> tuple[str, ...]:
        """Names of the load cases and corners."""
        return (*self.base.case_labels, *(corner.label for corner in self.corners))

    @property
    def dead_rotors(self) -> tuple[int | None, ...]:
        """Number of the dead rotor in each load case and corner, or None."""
        return (*self.base.dead_rotors, *(corner.dead for corner in self.corners))

    @property
    def accelerations(self) -> tuple[Vector, ...]:
        """Angular acceleration of the platform in each load case and corner [rad/s^2]."""
        return (*self.base.accelerations, *(corner.acceleration for corner in self.corners))

    @property
    def declared(self) -> ResolvedTask:
        """Task without expansion, as in a design file."""
        return self.base

    def with_corners(self, corners: Iterable[int]) -> CorneredTask:
        """Return the task with only these corners."""
        numbers = sorted(corners)
        return _with_corners(self.base, [self.corners[c] for c in numbers], [self.groups[c] for c in numbers])


@lru_cache(maxsize=32)
def to_corners(task: ResolvedTask, *, inner: bool = False) -> ResolvedTask:
    """Return the task with sets of wrenches, reserves and failures expanded to corners; itself if there are none.

    Args:
        task: the task.
        inner: True for only those wrenches that every clear design can produce, for proofs: points of the balls of
            reserves, and the bare load cases after a failure. Both are dropped if `search.peak_input` is less than
            1, because that limit does not apply to them.
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
    """Return the labelled corners of all sets of wrenches."""
    return [
        (f"{label}, corner {number}", corner)
        for label, case in zip(task.case_labels, task.load_cases, strict=True)
        for number, corner in enumerate(case.corners)
    ]


def _with_corners(task: ResolvedTask, corners: list[Corner], groups: list[int]) -> CorneredTask:
    """Return a task with corners as load cases, unvalidated: there may be more than in any file."""
    single = (case.model_copy(update={"cone": None, "vertices": ()}) for case in task.load_cases)
    cases = (*single, *(corner.case for corner in corners))
    fields = {**dict(task), "load_cases": cases, "flight": AskedFlight()}
    return CorneredTask.model_construct(**fields, base=task, corners=tuple(corners), groups=tuple(groups))


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
            if r > 0:
                groups.append(_corners(f"{label}, {field} reserve{AT[point]}", case, field, r * vectors, point))
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
    torques = (0.0 if inner else flight.rotor_out_torque or 0.0) * circumscribe(disc=False)
    for _, label, case in weight_cases(task, flight.rotor_out):
        for rotor in range(4 * task.n):
            words = f"{label}, {rotor_name(rotor)} dead"
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
    com, offsets = corner.case.at_com, box_corners(error)
    force = np.array(com.force)
    force[np.abs(force) <= 1e-12 * np.linalg.norm(force)] = 0.0
    if (components := np.count_nonzero(force)) > 1:
        offsets = offsets[np.abs(np.sign(offsets * force).sum(axis=1)) < components]
    for number, torque in enumerate(np.unique(np.cross(offsets, force), axis=0)):
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

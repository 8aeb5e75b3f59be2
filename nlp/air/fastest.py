"""Points of regions where air is fastest (`nlp.air.jets`), which become rows of a program.

The air speed at a point is the sum over all modules. A program has rows for points of the region where air is
fastest, added once a solve violates the limit there. Points of a ball move with a module, since otherwise the
platform would turn away from them at no cost; other points are fixed relative to the end-effector.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from nlp.numbers.point import Point
from nlp.requirements.exposure import hull_of
from topo_search.model.arrays import Array
from topo_search.model.shape import Capsule, Cone, Polytope, Shape

if TYPE_CHECKING:
    from nlp.air.jets import SpeedRegion

TARGET_SHARE = 0.997
"""Share of a limit that rows allow, so that faster air between their points is within the limit."""
ALLOWED_SHARE = 0.998
"""Share of a limit that a design may reach, so that the audit's bound over the whole region is within the limit."""
DEPTHS = np.concatenate([[0.0], np.geomspace(0.1, 60.0, 30)])
"""Depths where a search for the fastest air may start [l_arm]."""
DIRECTIONS = np.array(sorted(set(product((-1.0, 0.0, 1.0), repeat=3)) - {(0.0, 0.0, 0.0)}, key=np.linalg.norm))
"""Directions of the steps of the search, in the module's frame."""


TOWARDS_MODULE = 0.0, 0.0, 0.0
"""`SpeedPoint.direction` for the point of a ball near the module's axis and, among those, near the module."""


class SpeedPoint(NamedTuple):
    """A point of a region with a row in a program, in one load case."""

    case: int
    exposure: int
    from_tip: tuple[float, float, float]
    """The point, or the centre of its ball, from p'_E [l_arm]."""
    module: int = -1
    """Module that the point of the ball moves with; -1: no ball."""
    radius: float = 0.0
    """Radius of the ball [l_arm]."""
    direction: tuple[float, float, float] = TOWARDS_MODULE
    """Direction of the point from the centre: components towards the module's axis, across both, and along it."""


@dataclass(frozen=True)
class SpeedMaximum:
    """Fastest air over a region in one load case."""

    case: int
    exposure: int
    limit: float
    """[m/s]"""
    speed: float
    """[m/s]"""
    points: tuple[SpeedPoint, ...]
    """Points that get rows: fastest points near each module."""


def fastest(point: Point) -> Iterator[SpeedMaximum]:
    """Yield the fastest air over every region with a limit, in every load case."""
    task, l_arm = point.task, point.task.module.arm_length
    limited = [(number, exposure) for number, exposure in enumerate(task.exposure) if exposure.speed is not None]
    if not limited:
        return
    from nlp.air.jets import climb, jet_of  # compiled code, which other commands need not load

    (R, p), tip = point.poses, point.tip / l_arm
    p = p / l_arm - tip
    jet = jet_of(task.module, task.air_density, task.gravity)
    u = point.u / task.module.hover_input(task.gravity)
    for number, exposure in limited:
        regions = [
            region_of(shape.at(point.tip - point.p_COM), l_arm, exposure.speed_reach) for shape in exposure.shapes
        ]
        for case in range(len(task.declared.load_cases)):
            speeds, points = dict[SpeedPoint, float](), set[SpeedPoint]()
            for region in regions:
                maxima = climb(jet, R, p, u[case], region, DEPTHS, DIRECTIONS)
                for i, (*x, speed) in enumerate(maxima.tolist()):
                    if speed < 0.0:
                        continue
                    if not region.radius:
                        speeds[_point(case, number, np.array(x))] = speed
                        continue
                    on_path = _nearest_of_path(region, np.array(x))
                    points.add(_point(case, number, on_path, i, region.radius))
                    direction = _direction(on_path, region.radius, R[i, :, 2], p[i], np.array(x))
                    key = (np.array(x),) if direction is None else (on_path, i, region.radius, direction)
                    speeds[_point(case, number, *key)] = speed
            if not speeds:
                continue
            largest = max(speeds.values())
            points.update(point for point, speed in speeds.items() if speed > 0.9 * largest)
            yield SpeedMaximum(case, number, exposure.speed or math.inf, largest, tuple(sorted(points)))


def _nearest_of_path(region: SpeedRegion, x: Array) -> Array:
    along = (x - region.start) @ region.axis / max(float(region.axis @ region.axis), 1e-300)
    return np.asarray(region.start + np.clip(along, 0.0, 1.0) * region.axis)


def _point(case: int, exposure: int, from_tip: Array, *ball: Any) -> SpeedPoint:
    """Return a point, rounded so that equal points compare equal."""
    x, y, z = from_tip.round(6).tolist()
    return SpeedPoint(case, exposure, (x, y, z), *ball)


def _direction(centre: Array, radius: float, z: Array, p: Array, x: Array) -> tuple[float, ...] | None:
    """Return `SpeedPoint.direction` of a point of a ball; None if the module's axis meets the ball."""
    w = p + z * ((centre - p) @ z) - centre
    length = np.linalg.norm(w)
    if length <= radius:
        return None
    frame = np.array([w / length, np.cross(z, w) / length, z])
    return tuple((frame @ (x - centre) / radius).round(6).tolist())


def region_of(shape: Shape, l_arm: float, within: float | None) -> SpeedRegion:
    """Return the region of a shape with a fixed direction, cut off at a distance `within` [m] from p'_E."""
    from nlp.air.jets import SpeedRegion  # compiled code, which other commands need not load

    start, axis, radius, half_angle, planes = np.zeros(3), np.zeros(3), 0.0, 0.0, np.zeros((0, 3))
    match shape:
        case Capsule():
            start, axis, radius = np.array(shape.start), np.subtract(shape.end, shape.start) / l_arm, shape.radius
        case Polytope(corners=corners):
            hull = hull_of(corners)
            start = hull.corners.mean(axis=0)
            planes = hull.normals * (l_arm / (hull.offsets - hull.normals @ start))[:, None]
        case Cone():
            start, axis, half_angle = np.array(shape.apex), np.array(shape.axis), math.radians(shape.half_angle_deg)
        case _:
            raise NotImplementedError(f"no formula of air speeds for {type(shape).__name__}")
    return SpeedRegion(start / l_arm, axis, radius / l_arm, half_angle, planes, (within or math.inf) / l_arm)

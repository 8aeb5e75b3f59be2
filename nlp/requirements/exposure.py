"""The exposure requirements of a task as clearances; (9) of the printed problem."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from nlp import names
from nlp.requirements.air import Air
from nlp.requirements.distance import Distance
from nlp.requirements.end_effector import all_modules
from nlp.requirements.kinds import OFFSET
from nlp.requirements.regions import divide, to_cone, to_formula
from nlp.requirements.solid import PartBalls, PartsInCone, PartsOffCapsule, PartsOffCapsuleAlong, PartsOffHull
from nlp.requirements.statement import FROM_COM, Formula, Requirement
from nlp.units import Units
from topo_search.model import LEAST_OFFSET, AnyExposure, ResolvedTask, needs_offset, segment_of
from topo_search.model.shape import Capsule, Cone, Polytope, Shape


def exposure(task: ResolvedTask) -> Iterator[Requirement]:
    """Yield (9), and the least length of p_E where some direction is that of p_E."""
    unit, subjects = Units.of(task).length, all_modules(task.n)
    margin = task.search.margin / unit
    for number, asked in enumerate(task.exposure):
        formulas = tuple(
            to_formula(shape, Air.at_regions(task), unit, segment_of(asked, part))
            for part, shape in enumerate(asked.shapes)
        )
        if asked.geometry:
            yield Requirement(9, partial(_name, number, asked), subjects, formulas, margin)
        if asked.solid:
            balls = PartBalls.of(task)
            parts = tuple(
                _solid(shape, balls, unit, segment_of(asked, part)) for part, shape in enumerate(asked.shapes)
            )
            yield Requirement(9, partial(_solid_name, number), subjects, parts, margin)
    if any(needs_offset(asked) for asked in task.exposure):
        offset = Distance(FROM_COM, LEAST_OFFSET, OFFSET)
        yield Requirement(9, lambda *_: names.OFFSET, subjects[:1], (offset,), 0.0)  # no clearance: no margin


def _name(number: int, asked: AnyExposure, i: int, _: int, segment: int | None) -> str:
    return names.exposure(number, asked, i, segment)


def _solid_name(number: int, i: int, _: int, segment: int | None) -> str:
    return names.solid(number, i, segment)


def _solid(shape: Shape, balls: PartBalls, unit: float, segment: int | None) -> Formula:
    """Return what keeps rigid parts out of one solid shape; `unit`: l_arm [m]."""
    match shape:
        case Capsule(radius=radius, length=float(length)):
            return PartsOffCapsuleAlong(balls, radius / unit, length / unit)
        case Capsule(start=start, end=end):
            path = np.array(end) - np.array(start)
            return PartsOffCapsule(balls, shape.radius / unit, divide(start, unit), divide(path, unit), segment)
        case Polytope():
            return PartsOffHull(balls, tuple(divide(corner, unit) for corner in shape.corners), segment)
        case Cone():
            return PartsInCone(balls, to_cone(shape, unit), segment)

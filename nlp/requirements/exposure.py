"""Clearances at the end-effector: its exclusion, airflow beside it, exposure; (7) to (9) of the printed problem.

Those of its rod are in `nlp.requirements.rod`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from nlp import names
from nlp.requirements.bodies import Air, Body, PartBalls
from nlp.requirements.kinds import EXCLUSION, OFFSET
from nlp.requirements.regions import AtRegion, CapsuleRegion, to_formula
from nlp.requirements.statement import FROM_COM, FROM_TIP, Distance, Requirement, Subjects
from nlp.units import Units
from topo_search.model import LEAST_OFFSET, AnyExposure, ResolvedTask, needs_offset, segment_of


def end_effector_clearances(task: ResolvedTask) -> Iterator[Requirement]:
    """Yield the exclusion of (7), and (8)."""
    unit, subjects = Units.of(task).length, _all_modules(task.n)
    margin = task.search.margin / unit
    if task.exclusion_radius is not None:
        off = Distance(FROM_TIP, task.exclusion_radius / unit, EXCLUSION)
        yield Requirement(7, lambda i, *_: names.exclusion(i), subjects, (off,), margin)
    if task.tip_radius is not None:
        tip = AtRegion(Air.of(task), CapsuleRegion(task.tip_radius / unit))
        yield Requirement(8, lambda i, *_: names.tip_airflow(i), subjects, (tip,), margin)


def exposure(task: ResolvedTask) -> Iterator[Requirement]:
    """Yield (9), and the least length of p_E where some direction is that of p_E."""
    unit, subjects = Units.of(task).length, _all_modules(task.n)
    margin = task.search.margin / unit

    def formulas(asked: AnyExposure, body: Body) -> tuple[AtRegion, ...]:
        return tuple(to_formula(one, body, unit, segment_of(asked, k)) for k, one in enumerate(asked.shapes))

    for number, asked in enumerate(task.exposure):
        if asked.geometry:
            airflow = formulas(asked, Air.at_regions(task))
            yield Requirement(9, partial(_name, number, asked), subjects, airflow, margin)
        if asked.solid:
            parts = formulas(asked, PartBalls.of(task))
            yield Requirement(9, partial(_solid_name, number), subjects, parts, margin)
    if any(needs_offset(asked) for asked in task.exposure):
        offset = Distance(FROM_COM, LEAST_OFFSET, OFFSET)
        yield Requirement(9, lambda *_: names.OFFSET, subjects[:1], (offset,), 0.0)  # no clearance: no margin


def _all_modules(n: int) -> Subjects:
    """Return all modules, each by itself."""
    return np.repeat(np.arange(n)[:, None], 2, axis=1)


def _name(number: int, asked: AnyExposure, i: int, _: int, segment: int | None) -> str:
    return names.exposure(number, asked, i, segment)


def _solid_name(number: int, i: int, _: int, segment: int | None) -> str:
    return f"module {i} and solid exposure {number}" + ("" if segment is None else f", segment {segment}")

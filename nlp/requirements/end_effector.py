"""Clearances of modules from the end-effector: their centres and airflow; (7) and (8) of the printed problem."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlp import names
from nlp.requirements.air import Air
from nlp.requirements.distance import Distance
from nlp.requirements.kinds import EXCLUSION
from nlp.requirements.regions import OffBall
from nlp.requirements.statement import FROM_TIP, Requirement, Subjects
from nlp.units import Units
from topo_search.model import ResolvedTask


def all_modules(n: int) -> Subjects:
    """Return all modules, each by itself."""
    return np.repeat(np.arange(n)[:, None], 2, axis=1)


def end_effector_clearances(task: ResolvedTask) -> Iterator[Requirement]:
    """Yield (7) and (8)."""
    unit, subjects = Units.of(task).length, all_modules(task.n)
    margin = task.search.margin / unit
    if task.exclusion_radius is not None:
        off = Distance(FROM_TIP, task.exclusion_radius / unit, EXCLUSION)
        yield Requirement(7, lambda i, *_: names.exclusion(i), subjects, (off,), margin)
    if task.tip_radius is not None:
        tip = OffBall(Air.of(task), task.tip_radius / unit)
        yield Requirement(8, lambda i, *_: names.tip_airflow(i), subjects, (tip,), margin)

"""The front of a run with goals: audited designs of which none is better than another in everything.

| symbol | meaning | unit |
|---|---|---|
| J | control effort, to be small | rad^4/s^4 |
| clearance | least of all clearances that the solver holds, but for the end-effector's, to be large | m |
| stand-off | least distance of p_E from a module's centre, to be large | m |
| peak input | largest rotor input of all load cases over u_max, to be small | |
| modules | n, to be small | |

All are those of the audited design, not the level that it was found at: what costs no effort is given anyway.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from topo_search.model import Audit, Design
from topo_search.model.csv_text import harmless
from topo_search.model.goals import Level
from topo_search.study.folder import FRONT, RunFolder
from topo_search.study.row import Row

EFFORT = 1.0e-6
"""Share of J that makes no difference: the audit's own tolerance of it."""
CLEARANCE = 1.0e-5
"""Clearance that makes none [m]: a tenth of the default margin; solves of one optimum differ by less."""
STAND_OFF = 1.0e-4
"""Distance that makes none [m]."""
INPUT = 1.0e-5
"""Share of u_max that makes none."""
MODULE = 0.5
"""Number of modules that makes none."""

FRONT_COLUMNS = (
    "key",
    "modules",
    "objective",
    "lower_bound",
    "gap",
    "clearance",
    "stand_off",
    "peak_input",
    "audit",
    "level",
    "level_clearance",
    "level_stand_off",
    "level_peak_input",
    "design",
)
"""The columns of `front.csv`: what a design reaches, then the level that it was found at, and its file."""


@dataclass(frozen=True)
class Point:
    """A design of the front with what it reaches."""

    row: Row
    clearance: float | None
    """[m]; None where there is nothing to keep clear of."""
    stand_off: float | None
    """[m]; None if neither exclusion nor a stand-off is asked for."""
    peak_input: float
    """Over u_max."""
    number: int
    """Of the level that it was found at."""
    level: Level

    @property
    def folder(self) -> str:
        """The folder of its level, in that of the run."""
        return f"levels/{self.number}"

    @property
    def cells(self) -> dict[str, Any]:
        """Return its row of `front.csv`."""
        row = self.row
        values: dict[str, Any] = {
            **asdict(row),
            "clearance": self.clearance,
            "stand_off": self.stand_off,
            "peak_input": self.peak_input,
            "level": self.number,
            **{f"level_{name}": value for name, value in self.level._asdict().items()},
            "design": f"{self.folder}/designs/{row.key}.json",
        }
        return {name: values[name] for name in FRONT_COLUMNS}

    def costs(self, names: Sequence[str]) -> tuple[float, ...]:
        """Return J and the goals of these names in steps that make a difference, the smaller the better."""
        steps = {
            "clearance": -_or_infinite(self.clearance) / CLEARANCE,
            "stand_off": -_or_infinite(self.stand_off) / STAND_OFF,
            "peak_input": self.peak_input / INPUT,
            "modules": self.row.modules / MODULE,
        }
        effort = math.log(self.row.objective) / EFFORT if self.row.objective else -math.inf
        return (effort, *(steps[name] for name in names))


def front_of(folder: RunFolder) -> tuple[Point, ...]:
    """Return the front of a run with goals, the least effort first."""
    points = [point for number, level in enumerate(folder.levels()) for point in _audited(level, number)]
    return front(points, folder.request.task.goals.names)


def front(points: Sequence[Point], names: Sequence[str]) -> tuple[Point, ...]:
    """Return the points that no other one equals or betters in J and all goals of these names, least effort first.

    Differences of less than one step count as none: every point that is left out is better than some point of the
    front by two steps at most, in whatever it is better.
    """
    kept: list[tuple[tuple[float, ...], Point]] = []
    for point in sorted(points, key=lambda point: (*point.costs(names), point.number, point.row.key)):
        costs = point.costs(names)
        if not any(_covers(better, costs) for better, _ in kept):
            kept.append((costs, point))
    return tuple(
        point
        for place, (costs, point) in enumerate(kept)
        if not any(_covers(later, costs) for later, _ in kept[place + 1 :])
    )


def write_front(folder: RunFolder) -> None:
    """Write `front.csv`, and the design of least effort as `best.json`."""
    points = front_of(folder)
    table = io.StringIO()
    writer = csv.DictWriter(table, FRONT_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: harmless(cell) for name, cell in point.cells.items()} for point in points)
    folder.keep(FRONT, table.getvalue())
    if points:
        point = points[0]
        context = folder.request.levels[point.number].contexts(point.row.modules)[point.row.step]
        folder.keep("best.json", folder.ledger.design(context, point.row.key) or "")
    else:
        folder.drop("best.json")


def _audited(folder: RunFolder, number: int) -> Iterator[Point]:
    """Yield the designs of one level whose audit is clear."""
    request = folder.request
    for n in request.task.sizes:
        contexts = request.contexts(n)
        for row in folder.ledger.ranked(n):
            if not row.clear or request.level is None:
                continue
            design = folder.ledger.result(contexts[row.step], row.key)
            audit = folder.ledger.audit(contexts[row.step], row.key)
            if isinstance(design, Design) and audit is not None:
                yield _measured(row, design, Audit.model_validate_json(audit), number, request.level)


def _measured(row: Row, design: Design, audit: Audit, number: int, level: Level) -> Point:
    """Return what a design reaches."""
    task = design.task
    left_out = {"exclusion", "body", "rod", "rod-airflow"}
    if task.body_clearance is None:
        left_out.add("rotor-airflow")
    if task.search.interference == "separation":
        left_out.add("airflow")
    clearance = min((pair.analytic_m for pair in audit.pairs if pair.kind not in left_out), default=None)
    spare = min((pair.analytic_m for pair in audit.pairs if pair.kind == "exclusion"), default=None)
    return Point(
        row=row,
        clearance=clearance,
        stand_off=None if spare is None else spare + (task.exclusion_radius or 0.0),
        peak_input=float(design.inputs.max()) / task.module.max_input(task.gravity),
        number=number,
        level=level,
    )


def _covers(one: Sequence[float], other: Sequence[float]) -> bool:
    """Return whether the one is no worse than the other in anything, by more than a step."""
    return all(x <= y + 1 for x, y in zip(one, other, strict=True))


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None else value

"""The front of a run with goals: audited designs of which none is better than another in everything.

| symbol | meaning | unit |
|---|---|---|
| J | control effort, to be small | rad^4/s^4 |
| clearance | least of all clearances that the solver holds, but for the end-effector's, to be large | m |
| stand-off | least distance of p_E from a module's centre, to be large | m |
| peak input | largest rotor input of all load cases over u_max, to be small | |
| reserves | radii of the least balls of what can be added in hover, or around what is asked, to be large | N, N m |
| rotor out | what is proven to be possible with any one rotor dead: none, hover, all load cases | |
| joint moment | largest in a joint over all load cases, to be small | N m |
| hinge error | of every hinge angle, up to which clearances are proven to survive, to be large | deg |
| modules | n, to be small | |

All are those of the audited design, not the level that it was found at: what costs no effort is given anyway.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, get_args

from topo_search.model import Audit, Design, Flight, ResolvedTask
from topo_search.model.reserves import PLACES, Failing, centres_of
from topo_search.model.search import GOALS, Goal, Level
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row, proven_cell

FRONT_COLUMNS = (
    *("key", "modules", "objective", "lower_bound", "gap"),
    *GOALS,
    *("audit", "level"),
    *(f"level_{name}" for name in Level._fields),
    "design",
)
"""The columns of `front.csv`: what a design reaches, then the level that it was found at, and its file."""


@dataclass(frozen=True)
class FrontPoint:
    """A design of the front with what it reaches."""

    row: Row
    clearance: float | None
    """[m]; None where there is nothing to keep clear of."""
    stand_off: float | None
    """[m]; None if neither exclusion nor a stand-off is asked for."""
    peak_input: float
    """Over u_max."""
    number: int
    """Number of the level at which it was solved."""
    level: Level
    force_reserve: float | None = None
    """[N]; None where nothing is proven."""
    torque_reserve: float | None = None
    """[N m]"""
    rotor_out: Failing = "none"
    """Wrenches proven to be possible with any one rotor dead."""
    joint_moment: float | None = None
    """[N m]; None without joints."""
    hinge_angle_deg: float | None = None
    """[deg]; None where nothing is proven."""
    speed: float | None = None
    """Proven bound of the air speed over all regions [m/s]; None without regions."""

    @property
    def cells(self) -> dict[str, Any]:
        """Return its row of `front.csv`."""
        values: dict[str, Any] = {
            **asdict(self.row),
            **vars(self),
            "level": self.number,
            **{f"level_{name}": value for name, value in self.level._asdict().items()},
            "design": f"levels/{self.number}/designs/{self.row.key}.json",
        }
        return {name: values[name] for name in FRONT_COLUMNS}

    def costs(self, names: Sequence[str]) -> tuple[float, ...]:
        """Return J and the goals of these names in steps that make a difference, the smaller the better.

        A step of J is a share of it, the audit's own tolerance.
        """
        missing = dict.fromkeys(GOALS, 0.0) | {"clearance": math.inf, "stand_off": math.inf}
        values = missing | {name: value for name, value in vars(self).items() if value is not None}
        values |= {"modules": self.row.modules, "rotor_out": get_args(Failing).index(self.rotor_out)}
        effort = math.log(self.row.objective) / 1.0e-6 if self.row.objective else -math.inf
        table = GOALS | {"modules": Goal("modules", "", 0.5, 1)}
        goals = ((table[name], values[name]) for name in names)
        return (effort, *(goal.sign * value / goal.step for goal, value in goals))


def front_of(folder: RunFolder) -> tuple[FrontPoint, ...]:
    """Return the front of a run with goals, the least effort first."""
    points = [point for number, level in enumerate(folder.levels) for point in _clear_points(level, number)]
    return front(points, folder.request.task.goals.names)


def front(points: Sequence[FrontPoint], names: Sequence[str]) -> tuple[FrontPoint, ...]:
    """Return the points that no other one equals or betters in J and all goals of these names, least effort first.

    Differences of less than one step count as none: every point that is left out is better than some point of the
    front by two steps at most, in whatever it is better.
    """
    kept: list[tuple[tuple[float, ...], FrontPoint]] = []
    for point in sorted(points, key=lambda point: (*point.costs(names), point.number, point.row.key)):
        costs = point.costs(names)
        if not any(_covers(better, costs) for better, _ in kept):
            kept.append((costs, point))
    return tuple(
        point
        for index, (costs, point) in enumerate(kept)
        if not any(_covers(later, costs) for later, _ in kept[index + 1 :])
    )


def idle_goals(levels: Sequence[tuple[Level, float | None]], points: Sequence[FrontPoint]) -> list[str]:
    """Return a sentence for each goal of which no level binds: all give the same least effort.

    Args:
        levels: every level with the least J found there; None where there is none.
        points: the front, the least effort first.
    """
    sentences = []
    for index, (name, goal) in enumerate(GOALS.items()):
        groups = defaultdict[tuple[Any, ...], list[float | None]](list)
        for level, J in levels:
            groups[(*level[:index], *level[index + 1 :])].append(J)
        has_levels = any(level[index] is not None for level, _ in levels)
        if points and has_levels and all(map(_are_alike, groups.values())):
            has = proven_cell(name, points[0].cells[name], 4)
            sentences.append(
                f"no level of goals.{name} binds: each gives the same least control effort, whose design reaches "
                f"{has} ({goal.unit}); try levels of {goal.field} beyond that"
            )
    return sentences


def _are_alike(efforts: list[float | None]) -> bool:
    # starts of their own make efforts differ by less than 1e-4
    known = [J for J in efforts if J is not None]
    return len(known) == len(efforts) and (not known or max(known) <= min(known) * (1 + 1.0e-4))


def write_front(folder: RunFolder) -> None:
    """Write `front.csv`, and the design of least effort as `best.json`."""
    points = front_of(folder)
    folder.keep_table(RunFile.FRONT, FRONT_COLUMNS, (point.cells.values() for point in points))
    if points:
        point = points[0]
        folder.keep("best.json", folder.levels[point.number].text(point.row) or "")
    else:
        folder.drop("best.json")


def _clear_points(folder: RunFolder, number: int) -> Iterator[FrontPoint]:
    """Yield the designs of one level whose audit is clear."""
    level = folder.request.level
    for n in folder.request.task.sizes:
        for row in folder.ledger.ranking(n):
            if row.clear and level is not None:
                design, audit = folder.result_of(row)
                if design is not None and audit is not None:
                    yield _measure(row, design, audit, number, level)


def _measure(row: Row, design: Design, audit: Audit, number: int, level: Level) -> FrontPoint:
    """Return what a design reaches."""
    task = design.task
    left_out = {"exclusion", "body", "rod", "rod-airflow", "bracket-airflow", "bracket-rotor", "rod-region"}
    if not task.parts_off_airflow:
        left_out.add("rotor-airflow")
    if task.search.interference == "separation":
        left_out.add("airflow")
    clearance = min((pair.analytic_m for pair in audit.pairs if pair.kind not in left_out), default=None)
    spare = min((pair.analytic_m for pair in audit.pairs if pair.kind == "exclusion"), default=None)
    return FrontPoint(
        row=row,
        clearance=clearance,
        stand_off=None if spare is None else spare + (task.exclusion_radius or 0.0),
        peak_input=float(design.inputs.max()) / task.module.max_input(task.gravity),
        number=number,
        level=level,
        speed=None if audit.air is None else audit.air.region_m_s,
        **_of_flight(task, audit.flight),
    )


def _of_flight(task: ResolvedTask, flight: Flight | None) -> dict[str, Any]:
    """Return what a design reaches beyond its load cases: around what the task asks for, else around hover."""
    if flight is None:
        return {}
    level = task.flight.directions == "horizontal"
    numbers = [number for number, _, _ in centres_of(task, task.flight.around)]
    cases = [flight.cases[number] for number in numbers]
    names = [f"{'horizontal' if level else 'force'}_reserve{point}_N" for point in PLACES[task.flight.at]]
    forces: list[float | None] = [getattr(case, name) for case in cases for name in names]
    torques = [case.torque_reserve_Nm for case in cases]
    kept = {"all": flight.rotors_out_all, "hover": flight.rotors_out_hover}
    return {
        "force_reserve": min((force or 0.0 for force in forces), default=None),
        "torque_reserve": min((torque or 0.0 for torque in torques), default=None),
        "rotor_out": next((what for what, out in kept.items() if out.survive == out.of), "none"),
        "joint_moment": flight.joint_moment_Nm,
        "hinge_angle_deg": flight.hinge_tolerance_deg,
    }


def _covers(one: Sequence[float], other: Sequence[float]) -> bool:
    return all(x <= y + 1 for x, y in zip(one, other, strict=True))

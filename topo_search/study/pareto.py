"""The Pareto front of a run with goals: audited designs none of which dominates another.

| symbol | meaning | unit |
|---|---|---|
| J | control effort, minimized | rad^4/s^4 |
| value | value of `search.maximize`, if the task has it; maximized | its unit |
| clearance | smallest clearance of the solver's constraints, the end-effector's excepted; maximized | m |
| stand-off | smallest distance of p_E from a module's centre, maximized | m |
| peak input | largest rotor input of all load cases over u_max, minimized | |
| reserves | sizes of the force and the torque that can be added in any direction, maximized | N, N m |
| rotor out | what is proven to survive any single rotor failure: none, hover, all load cases | |
| joint moment | largest moment in a joint over all load cases, minimized | N m |
| hinge error | error of all hinge angles that is proven to lose no clearance, maximized | deg |
| modules | n, minimized | |

All values are those of the audited design, not the limits of its level, which it may exceed at no cost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, get_args

from topo_search.model import Audit, Design, Flight, ResolvedTask
from topo_search.model.goals import GOALS, Goal, Level
from topo_search.model.load_case import Failing
from topo_search.model.reserves import POINT_SUFFIXES, weight_cases
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row

if TYPE_CHECKING:
    from topo_search.study.answer import Answer

FRONT_COLUMNS = (
    *("key", "modules", "objective", "lower_bound", "gap"),
    *GOALS,
    *("audit", "level"),
    *(f"level_{name}" for name in Level._fields),
    *("design", "value"),
)
"""Columns of `front.csv`: a design's values, then the level at which it was solved, and its file."""


@dataclass(frozen=True)
class FrontPoint:
    """A design of the front and its values."""

    row: Row
    clearance: float | None
    """Smallest clearance [m]; None if no pair of parts is constrained."""
    stand_off: float | None
    """Smallest distance of p_E from a module's centre [m]; None without exclusion or stand-off in the task."""
    peak_input: float
    """Largest rotor input over u_max."""
    number: int
    """Number of the level at which it was solved."""
    level: Level
    force_reserve: float | None = None
    """Proven reserve of force [N]; None if nothing is proven."""
    torque_reserve: float | None = None
    """Proven reserve of torque [N m]; None if nothing is proven."""
    rotor_out: Failing = "none"
    """Load cases proven to survive any single rotor failure."""
    joint_moment: float | None = None
    """Largest moment in a joint [N m]; None without joints."""
    hinge_angle_deg: float | None = None
    """Error of all hinge angles proven to lose no clearance [deg]; None if nothing is proven."""
    speed: float | None = None
    """Proven bound of the air speed over all regions [m/s]; None without regions."""

    @property
    def cells(self) -> dict[str, Any]:
        """Its row of `front.csv`."""
        values: dict[str, Any] = {
            **asdict(self.row),
            **vars(self),
            "level": self.number,
            **{f"level_{name}": value for name, value in self.level._asdict().items()},
            "design": f"levels/{self.number}/designs/{self.row.key}.json",
        }
        return {name: values[name] for name in FRONT_COLUMNS}

    def costs(self, names: Sequence[str]) -> tuple[float, ...]:
        """Return J, or minus the maximised value, and the named goals in units of their steps, lower is better.

        A step of J is a share of J, the audit's tolerance; one of the value is the share by which it is raised.
        """
        missing = dict.fromkeys(GOALS, 0.0) | {"clearance": math.inf, "stand_off": math.inf}
        values = missing | {name: value for name, value in vars(self).items() if value is not None}
        values |= {"modules": self.row.modules, "rotor_out": get_args(Failing).index(self.rotor_out)}
        values["objective"] = first = _log(self.row.objective or 0.0) / 1.0e-6
        if self.row.value is not None:
            first = -_log(self.row.value) / 1.0e-3
        table = GOALS | {"modules": Goal("modules", "", 0.5, 1), "objective": Goal("J", "rad^4/s^4", 1.0, 1)}
        goals = ((table[name], values[name]) for name in names)
        return (first, *(goal.sign * value / goal.step for goal, value in goals))


def add_front(folder: RunFolder, answer: Answer) -> Answer:
    """Return the answer of a run with the front of its goals, if it has any."""
    return replace(answer, points=front_of(folder)) if answer.levels else answer


def front_of(folder: RunFolder) -> tuple[FrontPoint, ...]:
    """Return the front of a run with goals, best first; of a maximised value against the effort, too."""
    points = list[FrontPoint]()
    for number, level in enumerate(folder.levels):
        for row in (row for n in level.request.task.sizes for row in level.ledger.ranking(n) if row.clear):
            design, audit = level.result_of(row)
            if design is not None and audit is not None and level.request.level is not None:
                points.append(_front_point(row, design, audit, number, level.request.level))
    task = folder.request.task
    return front(points, task.goals.names if task.search.maximize is None else (*task.goals.names, "objective"))


def front(points: Sequence[FrontPoint], names: Sequence[str]) -> tuple[FrontPoint, ...]:
    """Return the points that no other point dominates in J, or the value, and the named goals, best first.

    Differences below one step do not count. A point that is left out beats some point of the front by at most two
    steps in any goal.
    """
    candidates: list[tuple[tuple[float, ...], FrontPoint]] = []
    for point in sorted(points, key=lambda point: (*point.costs(names), point.number, point.row.key)):
        costs = point.costs(names)
        if not any(_dominates(earlier, costs) for earlier, _ in candidates):
            candidates.append((costs, point))
    return tuple(
        point
        for index, (costs, point) in enumerate(candidates)
        if not any(_dominates(later, costs) for later, _ in candidates[index + 1 :])
    )


def write_front(folder: RunFolder) -> None:
    """Write `front.csv`, and the design of lowest effort as `best.json`, if the run has goals."""
    if not folder.request.task.goals.names:
        return
    points = front_of(folder)
    folder.write_table(RunFile.FRONT, FRONT_COLUMNS, (point.cells.values() for point in points))
    folder.write_file("best.json", folder.levels[points[0].number].design_text(points[0].row) if points else None)


def _front_point(row: Row, design: Design, audit: Audit, number: int, level: Level) -> FrontPoint:
    """Return a design with its values."""
    task = design.task
    excluded = {"exclusion", "body", "rod", "rod-airflow", "bracket-airflow", "bracket-rotor", "rod-region"}
    if not task.parts_off_airflow:
        excluded.add("rotor-airflow")
    if task.search.interference == "separation":
        excluded.add("airflow")
    clearance = min((pair.analytic_m for pair in audit.pairs if pair.kind not in excluded), default=None)
    limits = task.module.max_input(task.gravity) * task.input_shares  # 0: no rotor
    exclusion = min((pair.analytic_m for pair in audit.pairs if pair.kind == "exclusion"), default=None)
    return FrontPoint(
        row=row,
        clearance=clearance,
        stand_off=None if exclusion is None else exclusion + (task.exclusion_radius or 0.0),
        peak_input=float((design.inputs[:, limits > 0] / limits[limits > 0]).max()),
        number=number,
        level=level,
        speed=None if audit.air is None else audit.air.region_m_s,
        **_flight_values(task, audit.flight),
    )


def _flight_values(task: ResolvedTask, flight: Flight | None) -> dict[str, Any]:
    """Return a design's reserves, in the task's cases for reserves or else in hover, and its tolerances."""
    if flight is None:
        return {}
    is_level = task.flight.directions == "horizontal"
    numbers = [number for number, _, _ in weight_cases(task, task.flight.around)]
    cases = [flight.cases[number] for number in numbers]
    names = [
        f"{'horizontal' if is_level else 'force'}_reserve{point}_N" for point in POINT_SUFFIXES[task.flight.at]
    ]
    forces: list[float | None] = [getattr(case, name) for case in cases for name in names]
    torques = [case.torque_reserve_Nm for case in cases]
    rotors_out = {"all": flight.rotors_out_all, "hover": flight.rotors_out_hover}
    return {
        "force_reserve": min((force or 0.0 for force in forces), default=None),
        "torque_reserve": min((torque or 0.0 for torque in torques), default=None),
        "rotor_out": next((scope for scope, out in rotors_out.items() if out.survive == out.of), "none"),
        "joint_moment": flight.joint_moment_Nm,
        "hinge_angle_deg": flight.hinge_tolerance_deg,
    }


def _log(number: float) -> float:
    return math.log(number) if number > 0 else -math.inf


def _dominates(costs: Sequence[float], others: Sequence[float]) -> bool:
    return all(x <= y + 1 for x, y in zip(costs, others, strict=True))

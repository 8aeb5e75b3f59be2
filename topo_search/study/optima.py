"""Designs beside the best one: local optima that cost little more, and the front of a run with goals.

`optima/KEY-1.json`, `optima/KEY-2.json`, ... are the designs of a tree whose audits are clear, least effort first.
`optima.json` says what was sought, tree by tree, so that a stopped run goes on where it was.

The front consists of audited designs of which none is better than another in everything.

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
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import isclose
from typing import Any, Literal, get_args

from topo_search.engine import AuditDesign, Failed, Job, LocalOptima, audit_deadline
from topo_search.model import Audit, Design, Flight, ResolvedTask, Topology
from topo_search.model.files import to_json
from topo_search.model.load_case import PLACES, Failing, centres_of
from topo_search.model.proof import Text
from topo_search.model.proven import TOLERANCE
from topo_search.model.search import GOALS, Goal, Level
from topo_search.model.value import Index, Number, Value
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row, proven_cell, row_of
from topo_search.study.progress import solving_phase
from topo_search.study.request import Context
from topo_search.study.solving import Tools, audit_best

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
    points = list[FrontPoint]()
    for number, level in enumerate(folder.levels):
        for row in (row for n in level.request.task.sizes for row in level.ledger.ranking(n) if row.clear):
            design, audit = level.result_of(row)
            if design is not None and audit is not None and level.request.level is not None:
                points.append(_measure(row, design, audit, number, level.request.level))
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
        levels: every level with the least J found there; None without a design.
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


class TreeOptima(Value):
    """Local optima of one tree."""

    context: Text
    """Digest of task, margin, seed and versions."""
    starts: Index
    """Number of starts that they were sought from."""
    most_effort: Number
    """Largest effort that was looked for [rad^4/s^4]."""
    kept: Index
    """Number of designs with a clear audit."""
    not_clear: Index
    """Number of designs whose audit is not clear; they are not kept."""

    def answers(self, context: Context, starts: int, most_effort: float) -> bool:
        """True if nothing is left to do for as many starts and as much effort."""
        return self.context == context.name and self.starts >= starts and self.most_effort >= most_effort


class Optima(Value):
    """Record of the local optima of a run, as `optima.json` holds it."""

    format: Literal["topo-search/optima"] = "topo-search/optima"
    version: Literal[1] = 1
    trees: dict[Text, TreeOptima]
    """By key."""


def keep_optima(folder: RunFolder, n: int, percent: float, tools: Tools) -> None:
    """Keep every local optimum of n modules that costs at most so much more than the best, and is clear.

    Args:
        folder: of the run.
        n: number of modules.
        percent: largest effort over that of the best design.
        tools: what solves and audits.
    """
    ledger, request = folder.ledger, folder.request
    contexts, best = request.contexts(n), ledger.best_clear(n)
    if best is None or best.objective is None:
        return
    most = (1 + percent / 100) * best.objective
    record = read_record(folder)
    rows = {row.key: row for row in ledger.ranking(n) if row.objective is not None and row.objective <= most}
    jobs = list[Job]()
    for row in rows.values():
        context, held = contexts[row.step], record.trees.get(row.key)
        if held is not None and held.answers(context, request.starts, most):
            continue
        design = ledger.result(context, row.key)
        near = (design, *request.near) if isinstance(design, Design) else request.near
        topology = Topology.from_key(row.key)
        jobs.append(Job(context.task, topology, row.orbit, range(request.starts), context.seed, near))
    tools.observer.phase(solving_phase("polishing", contexts[0].task, len(jobs), request.starts))
    solved = tools.engine.run(
        partial(_solve_and_audit, tools.backends.local_optima, tools.backends.audit, most),
        jobs,
        deadline=lambda job: job.deadline + len(job.starts) * audit_deadline(n),
        until=tools.until,
    )
    gained = False
    for job, result in solved:
        row = rows[job.topology.key]
        tools.observer.settled(best)
        if isinstance(result, Failed):
            tools.observer.note(f"{row.key}: its local optima are unknown, {result.reason}")
            continue
        clear = [design for design, is_clear in result if is_clear]
        gained |= _take_better(folder, row, clear)
        before = record.trees.get(row.key)
        for k, design in enumerate(clear, start=1):
            folder.keep(f"{RunFile.OPTIMA}/{row.key}-{k}.json", to_json(design))
        for k in range(len(clear) + 1, (before.kept if before else 0) + 1):
            folder.drop(f"{RunFile.OPTIMA}/{row.key}-{k}.json")
        tree = TreeOptima(
            context=contexts[row.step].name,
            starts=request.starts,
            most_effort=most,
            kept=len(clear),
            not_clear=len(result) - len(clear),
        )
        record = record.model_copy(update={"trees": {**record.trees, row.key: tree}})
        folder.keep(RunFile.OPTIMA_RECORD, to_json(record))
    if gained:
        audit_best(folder, n, best.lower_bound or 0.0, tools)
    trees = [record.trees[key] for key in rows if key in record.trees]
    kept, not_clear = sum(tree.kept for tree in trees), sum(tree.not_clear for tree in trees)
    tools.observer.note(
        f"{n} modules: {kept} local optima of {len(trees)} trees within {percent:g} % of the best are in "
        f"{RunFile.OPTIMA}/" + (f"; {not_clear} more have no clear audit" if not_clear else "")
    )


def read_record(folder: RunFolder) -> Optima:
    """Return what is known of the local optima of a run."""
    return folder.read_own(RunFile.OPTIMA_RECORD, Optima) or Optima(trees={})


def clear_designs(folder: RunFolder, row: Row) -> list[Design]:
    """Return a candidate's design if its audit is clear, and its other local optima that are kept."""
    context = folder.request.contexts(row.modules)[row.step]
    design, held = folder.ledger.result(context, row.key), read_record(folder).trees.get(row.key)
    designs = [design] if row.clear and isinstance(design, Design) else []
    if held is None or held.context != context.name:
        return designs
    kept = (folder.read_own(f"{RunFile.OPTIMA}/{row.key}-{k}.json", Design) for k in range(1, held.kept + 1))
    known = [design.objective for design in designs]
    differ = (one for one in kept if one and not any(isclose(one.objective, J, rel_tol=TOLERANCE) for J in known))
    return [*designs, *differ]


def _take_better(folder: RunFolder, row: Row, clear: list[Design]) -> bool:
    """Put an optimum that costs less than its tree's design into the ledger; return whether there was one."""
    context = folder.request.contexts(row.modules)[row.step]
    held = folder.ledger.result(context, row.key)
    if not clear or not isinstance(held, Design) or clear[0].objective >= (1 - TOLERANCE) * held.objective:
        return False
    design = clear[0].model_copy(update={"solver": held.solver})
    bound = row.lower_bound or 0.0
    better = row_of(design, key=row.key, modules=row.modules, orbit=row.orbit, starts=row.asked, lower_bound=bound)
    folder.ledger.record(context, [(replace(better, margin=row.margin, step=row.step), design)])
    return True


def _solve_and_audit(
    local_optima: LocalOptima, audit: AuditDesign, most: float, job: Job
) -> list[tuple[Design, bool]]:
    """Return the local optima of a tree, and whether the audit of each is clear (in a worker)."""
    optima = local_optima(job.task, job.topology, starts=job.starts, seed=job.seed, near=job.near, most_effort=most)
    return [(design, audit(design).verdict == "clear") for design in optima]

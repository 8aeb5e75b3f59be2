"""Why there is no design: the limits that give the closest trees a design when relaxed one at a time.

Every answer is measured: the task with the relaxed limit is solved again from the first starts of the run, so a
user who writes the value into the task file gets the same design with a clear audit. The smallest sufficient share
is found by bisection on a ladder of round shares. This is not a proof: a share that is insufficient from these
starts may be sufficient from others. A failed solve does not count: the limit neither helps nor was tried in vain.

A share x scales an upper limit by 1 + x, and a requirement by 1 - x, rounded to the printed digits. The relaxed
task is the one that a user gets by writing the printed value into the task file, including defaults that depend on
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from heapq import nsmallest
from itertools import islice
from typing import Any

from pydantic import ValidationError

from topo_search.engine import Backends, Failed, Job, audit_deadline, scaled_violation
from topo_search.model import Infeasible, Relaxed, ResolvedTask, Task, Topology
from topo_search.model.exposure import Plane
from topo_search.model.files import to_json
from topo_search.model.relaxed import STARTS, Relaxation
from topo_search.model.shape import NOWHERE
from topo_search.study.answer import SizeAnswer
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.progress import solving_phase
from topo_search.study.request import LARGER_MARGINS, Margins, margins, with_margin
from topo_search.study.solving import Tools


@dataclass(frozen=True)
class Relaxing:
    """Settings of the search for limits to relax."""

    trees: int = 2
    """Number of closest trees for which limits are relaxed."""
    remaining: float = 0.2
    """Share of a requirement that remains when it is relaxed the most."""
    shares: tuple[float, ...] = (0.01, 0.02, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
    """Ladder of shares."""


RELAXING = Relaxing()


@dataclass(frozen=True)
class Relaxable:
    """A limit that can be relaxed."""

    modules: int
    """Number of modules."""
    limit: str
    """Name of the limit."""
    field: str
    """Field of the task."""
    words: str
    """Change in words: `more thrust`."""
    largest_share: float
    relaxed: Callable[[float], Task]
    """Returns the task with the limit relaxed by a share."""
    value: Callable[[Task], float | None] = lambda _: None
    """Returns the limit's value in a task; None if it is not a single number."""
    unit: str = ""
    is_switch: bool = False
    """True if the limit can only be kept or dropped."""
    tightens: bool = False
    """True if the limit gets stricter: its designs also satisfy the original task, whose search may miss them."""

    @cached_property
    def shares(self) -> tuple[float, ...]:
        """The shares to try, in ascending order: those with which the task is valid."""
        ladder = (self.largest_share,) if self.is_switch else RELAXING.shares
        return tuple(x for x in ladder if x <= self.largest_share and self._is_valid(x))

    def _is_valid(self, share: float) -> bool:
        try:
            self.task_at(share)
        except ValidationError:  # for example a plane farther away than `speed_within`
            return False
        return True

    def task_at(self, share: float) -> ResolvedTask:
        """Return the task with the limit relaxed by a share; ValidationError if other fields rule it out."""
        return self.relaxed(share).resolve(self.modules)

    def change(self, share: float) -> str:
        """Return the change by a share in words."""
        return self.words if self.is_switch else f"{100 * share:.3g} % {self.words}"


def relaxable(task: Task, n: int) -> list[Relaxable]:
    """Return the limits of a task for n modules that can be relaxed without changing the module or the tree."""
    limits = (*_numbers(task, n), *_switches(task, n), *_loads(task, n))
    return [limit for limit in limits if limit.shares]


def _numbers(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the limits that are numbers."""
    by_weight, shrink = float(task.module.max_thrust is None), RELAXING.remaining - 1
    force, torque = ("N", "N m") if task.flight.units == "SI" else ("m_t g", "l_arm m_t g")
    larger = 1 / task.search.peak_input - 1
    # part, field, limit, largest share (negative: the value shrinks), change in words, unit
    table: list[tuple[str | int, str, str, float, str, str]] = [
        ("module", "max_thrust_to_weight", "rotor limits", by_weight, "more thrust", ""),
        ("module", "max_thrust", "rotor limits", 1.0, "more thrust", "N"),
        ("module", "connector_distance", "distance of module centres", 1.0, "longer connectors", "m"),
        ("search", "peak_input", "rotor inputs", larger, "larger share of the largest input", ""),
        ("end_effector", "largest_reach", "reach of the rod", 1.0, "more reach", "m"),
        ("end_effector", "largest_reach", "reach of the rod, tightened", shrink, "less reach", "m"),
        ("end_effector", "stand_off", "stand-off", shrink, "less stand-off of the end-effector", "m"),
        ("flight", "force_reserve", "reserve of force", shrink, "less", force),
        ("flight", "torque_reserve", "reserve of torque", shrink, "less", torque),
        ("flight", "tilt_deg", "tilt held in hover", shrink, "less", "deg"),
        ("flight", "com_error", "error of the centre of mass", shrink, "less", "m"),
        ("flight", "angular_acceleration", "angular acceleration", shrink, "less", ""),
        ("flight", "joint_force", "force in a joint", 1.0, "larger force", "N"),
        ("flight", "joint_moment", "moment in a joint", 1.0, "larger moment", "N m"),
    ]
    for number, exposure in enumerate(task.exposure):
        limit = f"exposure {number} ({exposure.kind})"
        table.append((number, "speed", f"air over {limit}", 1.0, "faster air", "m/s"))
        for name, largest_share, words, unit in exposure.relaxable:
            table.append((number, name, limit, max(shrink, largest_share), words, unit))
    for part, name, limit, largest_share, words, unit in table:
        read_value = partial(_value, n, part, name)
        if (value := read_value(task)) and value != NOWHERE:
            field = f"{part}.{name}" if isinstance(part, str) else f"exposure[{part}].{name}"
            change = partial(_change, task, part, name, value, math.copysign(1.0, largest_share))
            read_number = (lambda _: None) if isinstance(value, tuple) else read_value
            tightens = name == "largest_reach" and largest_share < 0
            yield Relaxable(
                n, limit, field, words, abs(largest_share), change, read_number, unit, tightens=tightens
            )


def _value(n: int, part: str | int, name: str, task: Task) -> Any:
    """Return the value of a field of a part (see `Task.with_fields`), or its default; None without either."""
    if name == "largest_reach":
        return task.largest_reach(n)
    if name in ("joint_force", "joint_moment"):
        return task.joint_limits[name == "joint_moment"]
    return getattr(getattr(task, part) if isinstance(part, str) else task.exposure[part], name, None)


def _change(task: Task, part: str | int, name: str, value: Any, sign: float, share: float) -> Task:
    fields = {name: _relax_value(value, sign * share, task.module.region_envelope.length)}
    if name == "max_thrust":
        fields["max_thrust_to_weight"] = 4 * fields[name] / (task.module.mass * task.gravity)
    return task.with_fields(part, **fields)


def _relax_value(value: Any, share: float, length: float) -> Any:
    """Return a number scaled by 1 + share, with the digits of `Relaxation.setting`; in tuples every number.

    Planes move outwards by a share of the airflow's length.
    """
    if isinstance(value, tuple):
        return tuple(_relax_value(x, share, length) for x in value)
    if isinstance(value, Plane):
        return value.model_copy(update={"offset": value.offset + share * length})
    return float(f"{value * (1 + share):.6g}")


def _switches(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the limits that can only be kept or dropped."""
    search = task.search
    field_of_set = "hinge_step_deg" if search.hinge_angles_deg is None else "hinge_angles_deg"
    any_angle = task.model_copy(update={"search": search.any_angle})
    free_root = task.with_fields("search", root="free")
    free_tip = task.with_fields("end_effector", position="free")
    is_fixed = task.end_effector.fixed_position is not None
    for limit, field, applies, freed in (
        ("orientation of the root", 'search.root = "free"', search.root == "paper", free_root),
        ("set of hinge angles", f"search.{field_of_set} left out", search.hinge_set_deg is not None, any_angle),
        ("position of the end-effector", 'end_effector.position = "free"', is_fixed, free_tip),
    ):
        if applies:
            yield Relaxable(n, limit, field, "freeing it", 1.0, partial(_return_freed, freed), is_switch=True)


def _return_freed(freed: Task, _: float) -> Task:
    return freed


def _loads(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the load cases."""

    def lighten(x: float) -> Task:
        # the wrench at the centre of mass carries the weight and stays
        lighter = tuple(case.scale(1 - x, 1 - x).model_copy(update={"com": case.com}) for case in task.cases)
        return task.model_copy(update={"load_cases": lighter, "task_seed": None})

    if lighten(0.5).load_cases != task.cases:
        words = "less force and torque at the end-effector"
        yield Relaxable(n, "load cases", "load_cases", words, 1 - RELAXING.remaining, lighten)


@dataclass
class _Bisection:
    """Bisection for the smallest share of one limit that gives one tree a design with a clear audit."""

    topology: Topology
    limit: Relaxable
    sufficient: int
    """Rung of the smallest share that did; the ladder's length if none has yet."""
    insufficient: int = -1
    """Rung of the largest share that did not."""
    proven: bool = False
    """True if some share was skipped because the task is proven impossible with it."""
    failure: str | None = None
    """The change for which the solver or the audit failed, and why."""

    @property
    def rung(self) -> int | None:
        """Index of the next share to try; None when the bisection has ended."""
        if self.failure is not None or self.sufficient - self.insufficient == 1:
            return None
        last = len(self.limit.shares) - 1
        return last if self.sufficient > last else (self.sufficient + self.insufficient) // 2

    def task_at(self, rung: int) -> ResolvedTask:
        """Return the task with the limit relaxed to a rung."""
        return self.limit.task_at(self.limit.shares[rung])

    def change(self, rung: int) -> str:
        """Return the limit and its change at a rung in words."""
        return f"{self.limit.limit}: {self.limit.change(self.limit.shares[rung])}"

    def is_possible(self, backends: Backends) -> bool:
        """Advance past shares with which the task is proven impossible; return whether one is left to solve."""
        while (rung := self.rung) is not None:
            if backends.prove_impossible(self.task_at(rung)) is None:
                return True
            self.insufficient, self.proven = rung, True
        return False

    def relaxation(self, task: Task) -> Relaxation:
        """Return the record of the smallest sufficient share."""
        limit, share = self.limit, self.limit.shares[self.sufficient]
        return Relaxation(
            topology_key=self.topology.key,
            limit=limit.limit,
            change=limit.change(share),
            field=limit.field,
            share=share,
            given=limit.value(task),
            enough=limit.value(limit.relaxed(share)),
            unit=limit.unit,
            not_enough=None if self.insufficient < 0 else limit.shares[self.insufficient],
            tightens=limit.tightens,
        )


def relax(task: Task, topologies: Sequence[Topology], tools: Tools, *, starts: int, seed: int) -> Relaxed | None:
    """Return the limits that give trees without a design one when relaxed; None if the time was too short.

    Args:
        task: the task as the user wrote it.
        topologies: the closest trees, all of one size; only the first `RELAXING.trees` are used.
        tools: solver, audit, bounds, engine, observer and time limit.
        starts: number of starts of the run; at most STARTS of them are used.
        seed: seeds the random starts.
    """
    backends, observer = tools.backends, tools.observer
    trees, n = topologies[: RELAXING.trees], topologies[0].n
    searches = [_Bisection(tree, limit, len(limit.shares)) for tree in trees for limit in relaxable(task, n)]
    resolved, job_starts = task.resolve(n), range(min(starts, STARTS))
    proven = backends.prove_impossible(resolved) is not None  # otherwise no easier task is proven impossible

    def deadline(numbered_job: tuple[int, int, Job]) -> float:
        """Return the time after which solving and auditing with every margin count as hung [s]."""
        return (1 + LARGER_MARGINS) * (numbered_job[2].deadline + audit_deadline(n))

    timed_out = False
    while not timed_out:
        jobs = [
            (number, search.rung, Job(search.task_at(search.rung), search.topology, job_starts, seed))
            for number, search in enumerate(searches)
            if (not proven or search.is_possible(backends)) and search.rung is not None
        ]
        if not jobs:
            break
        observer.phase(solving_phase("relaxing", resolved, len(jobs), len(job_starts)))
        timed_out = True
        results = tools.engine.run(partial(_leads_to_design, backends), jobs, deadline=deadline, until=tools.until)
        for count, ((number, rung, _), outcome) in enumerate(results, 1):
            search = searches[number]
            if isinstance(outcome, Failed):
                search.failure = f"{search.change(rung)} ({outcome.reason})"
            elif outcome:
                search.sufficient = rung
            else:
                search.insufficient = rung
            observer.settled(None)
            timed_out = count < len(jobs)
    best = dict[str, Relaxation]()  # per helpful limit: those that only tighten first, then the smallest change
    helpful = [search.relaxation(task) for search in searches if search.sufficient < len(search.limit.shares)]
    for relaxation in sorted(helpful, key=lambda r: (not r.tightens, r.share, r.limit, r.topology_key)):
        best.setdefault(relaxation.limit, relaxation)
    if timed_out and not best:
        return None
    unhelpful = [search for search in searches if search.limit.limit not in best]
    untried = {search.limit.limit: search.failure for search in unhelpful if search.failure is not None}
    in_vain = {
        search.limit.limit: search.change(search.insufficient)
        + (" (still proven impossible)" if search.proven else "")
        for search in unhelpful
        if search.insufficient >= 0
    }
    return Relaxed(
        modules=n,
        starts=starts,
        relaxations=tuple(best.values())[:3],
        in_vain=tuple(sorted(words for limit, words in in_vain.items() if limit not in untried)),
        untried=tuple(sorted(untried.values())),
        topologies=tuple(tree.key for tree in trees),
    )


def _leads_to_design(backends: Backends, numbered_job: tuple[int, int, Job]) -> bool:
    """Return whether a job leads to a design with a clear audit, if need be with larger margins (in a worker)."""
    job = numbered_job[2]
    ladder = Margins([with_margin(job.task, margin) for margin in margins(job.task)])
    while True:
        design = backends.solve(replace(job, task=ladder.task))
        if isinstance(design, Infeasible):
            return False
        audit = backends.audit(design)
        if audit.verdict == "clear":
            return True
        if not ladder.raise_after(audit):
            return False


def find_causes(folder: RunFolder, tools: Tools) -> None:
    """Find and store the limits that prevent a design, if no size has one.

    Only the two largest sizes are examined, once their search is complete; a size where every candidate failed is
    skipped. Limits whose attempts failed are tried again.

    Args:
        folder: folder of a run without goals, or of its loosest level.
        tools: solver, audit, bounds, engine, observer and time limit.
    """
    request, ledger = folder.request, folder.ledger
    sizes = list(request.task.sizes)
    if any(row.feasible for n in sizes for row in ledger.ranking(n)):
        folder.remove_files(RunFile.RELAXED)
        return
    for n in sizes[-2:]:
        context, stored = request.contexts(n)[0], causes(folder, n)
        bound = ledger.bound(context)
        proven = bound is not None and bound[1] is not None
        is_complete = proven or ledger.is_complete(context, request.starts, request.trials)
        is_current = stored is not None and stored.starts >= request.starts and not stored.untried
        if not is_complete or is_current or not (trees := _closest_trees(folder, n, proven=proven)):
            continue
        relaxed = relax(request.task, trees, tools, starts=request.starts, seed=request.seed)
        if relaxed is not None:
            folder.write_file(f"{RunFile.RELAXED}/n{n}.json", to_json(relaxed))


def add_causes(folder: RunFolder, size: SizeAnswer) -> SizeAnswer:
    """Return the answer of a size with the limits that prevent a design, if it has none."""
    return size if size.feasible else replace(size, relaxed=causes(folder, size.modules))


def causes(folder: RunFolder, n: int) -> Relaxed | None:
    """Return the stored limits that prevent a design of n modules; None if they were not examined.

    Raises:
        BadInput: the file is damaged.
    """
    return folder.read_files(RunFile.RELAXED, Relaxed).get(f"n{n}.json")


def _closest_trees(folder: RunFolder, n: int, *, proven: bool) -> list[Topology]:
    """Return the trees with the smallest violations; if all are proven impossible, any trees."""
    request, rows = folder.request, list(folder.ledger.ranking(n))
    task = request.contexts(n)[0].task
    violations = [
        (scaled_violation(row.violation, row.unit or "", task), row.key)
        for row in rows
        if row.status == "infeasible" and row.violation is not None
    ]
    if violations:
        return [Topology.from_key(key) for _, key in nsmallest(RELAXING.trees, violations)]
    if proven:
        return list(dict.fromkeys(request.space(n).sample(RELAXING.trees, request.seed)))
    impossible = (row.key for row in rows if row.status == "impossible")
    return [Topology.from_key(key) for key in islice(impossible, RELAXING.trees)]

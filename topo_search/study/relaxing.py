"""Why there is no design: which single limit, relaxed on its own, gives the closest trees one, and by how little.

Every answer is measured: the task with the relaxed limit is solved again from the first starts of the run, so a
user who writes the value into the task file gets the same design, and its audit is clear. The least share is sought
by bisection in a ladder of round ones. Nothing is proven: a share that was not enough from these starts may be from
others. A solve that fails is no attempt: the limit neither helps nor is tried in vain.

A share x makes an upper limit (1 + x) times as large, and what is asked for (1 - x) times, rounded to the digits
that are printed: the relaxed task is the one that a user gets by writing the printed value into the task file,
defaults that depend on it included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from heapq import nsmallest
from itertools import islice
from typing import Any

from topo_search.engine import Backends, Failed, Job, audit_deadline, scaled_violation
from topo_search.model import Infeasible, Relaxed, ResolvedTask, Task, Topology
from topo_search.model.design import STARTS, Relaxation
from topo_search.model.exposure import Allowed, Exterior, Plane
from topo_search.model.files import to_json
from topo_search.model.shape import NOWHERE
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.progress import solving_phase
from topo_search.study.request import LARGER_MARGINS, Margins, margins, with_margin
from topo_search.study.solving import Tools


@dataclass(frozen=True)
class Relaxing:
    """Settings of the search for limits to relax."""

    trees: int = 2
    """The closest trees, for which limits are relaxed."""
    least: float = 0.2
    """Share of what is asked for that is left at most of all relaxing."""
    shares: tuple[float, ...] = (0.01, 0.02, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
    """Changes that are tried."""


RELAXING = Relaxing()


@dataclass(frozen=True)
class Relaxable:
    """One limit that can be relaxed."""

    limit: str
    """Name of the limit."""
    field: str
    """Field of the task."""
    more: str
    """Words for the change: `more thrust`."""
    most: float
    """Largest share."""
    relaxed: Callable[[float], Task]
    """The task with the limit relaxed by a share."""
    value: Callable[[Task], float | None] = lambda _: None
    """Returns the limit; None where it is no single number."""
    unit: str = ""
    at_once: bool = False
    """True if there is nothing between the limit and none."""
    tightens: bool = False
    """True if it gets stricter: its designs are designs of the task as it is, which the search may miss there."""

    @property
    def shares(self) -> tuple[float, ...]:
        """The changes that are tried, in ascending order."""
        return (self.most,) if self.at_once else tuple(x for x in RELAXING.shares if x <= self.most)

    def change(self, share: float) -> str:
        """Say what a share is."""
        return self.more if self.at_once else f"{100 * share:.3g} % {self.more}"


def relaxable(task: Task, n: int) -> list[Relaxable]:
    """Return the limits of a task for n modules that can be relaxed without another module or another tree."""
    limits = (*_numbers(task, n), *_switches(task), *_others(task))
    return [limit for limit in limits if limit.shares]


def _numbers(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the limits that are numbers: each with the largest share that it grows by, negative if it shrinks."""
    by_weight, least = float(task.module.max_thrust is None), RELAXING.least - 1
    force, torque = ("N", "N m") if task.flight.units == "SI" else ("m_t g", "l_arm m_t g")
    larger = 1 / task.search.peak_input - 1
    table: list[tuple[str | int, str, str, float, str, str]] = [
        ("module", "max_thrust_to_weight", "rotor limits", by_weight, "more thrust", ""),
        ("module", "max_thrust", "rotor limits", 1.0, "more thrust", "N"),
        ("module", "connector_distance", "distance of module centres", 1.0, "longer connectors", "m"),
        ("search", "peak_input", "rotor inputs", larger, "larger share of the largest input", ""),
        ("end_effector", "largest_reach", "reach of the rod", 1.0, "more reach", "m"),
        ("end_effector", "largest_reach", "reach of the rod, tightened", least, "less reach", "m"),
        ("end_effector", "stand_off", "stand-off", least, "less stand-off of the end-effector", "m"),
        ("flight", "force_reserve", "reserve of force", least, "less", force),
        ("flight", "torque_reserve", "reserve of torque", least, "less", torque),
        ("flight", "tilt_deg", "tilt held in hover", least, "less", "deg"),
        ("flight", "com_error", "error of the centre of mass", least, "less", "m"),
        ("flight", "angular_acceleration", "angular acceleration", least, "less", ""),
        ("flight", "joint_force", "force in a joint", 1.0, "larger force", "N"),
        ("flight", "joint_moment", "moment in a joint", 1.0, "larger moment", "N m"),
    ]
    for number, exposure in enumerate(task.exposure):
        limit = f"exposure {number} ({exposure.kind})"
        wider = min(1.0, 90 / exposure.half_angle_deg - 1) if isinstance(exposure, Exterior) else 0.0
        table += [
            (number, "speed", f"air over {limit}", 1.0, "faster air", "m/s"),
            (number, "half_angle_deg", limit, wider, "wider cone", "deg"),
            (number, "radius", limit, least, "smaller radius", "m"),
            *((number, shape, limit, least, "smaller region", "") for shape in ("box", "vertices", "pieces")),
        ]
    for part, name, limit, most, more, unit in table:
        value = partial(_value, n, part, name)
        if (given := value(task)) and given != NOWHERE:
            field = f"{part}.{name}" if isinstance(part, str) else f"exposure[{part}].{name}"
            change = partial(_change, task, part, name, given, math.copysign(1.0, most))
            number_of = (lambda _: None) if isinstance(given, tuple) else value
            tightens = name == "largest_reach" and most < 0
            yield Relaxable(limit, field, more, abs(most), change, number_of, unit, tightens=tightens)


def _value(n: int, part: str | int, name: str, task: Task) -> Any:
    """Return the value of a field of a part (see `Task.with_fields`), derived ones included, or None."""
    if name == "largest_reach":
        return task.largest_reach(n)
    if name in ("joint_force", "joint_moment"):
        return task.joint_limits[name == "joint_moment"]
    return getattr(getattr(task, part) if isinstance(part, str) else task.exposure[part], name, None)


def _change(task: Task, part: str | int, name: str, given: Any, sign: float, share: float) -> Task:
    fields = {name: _times(given, 1 + sign * share)}
    if name == "max_thrust":
        fields["max_thrust_to_weight"] = 4 * fields[name] / (task.module.mass * task.gravity)
    return task.with_fields(part, **fields)


def _times(given: Any, factor: float) -> Any:
    """Return a number, or all numbers in lists, scaled and rounded as `Relaxation.setting` prints them."""
    return tuple(_times(x, factor) for x in given) if isinstance(given, tuple) else float(f"{given * factor:.6g}")


def _switches(task: Task) -> Iterator[Relaxable]:
    """Yield the limits that are there or not."""
    search = task.search
    given = "hinge_step_deg" if search.hinge_angles_deg is None else "hinge_angles_deg"
    any_angle = task.model_copy(update={"search": search.any_angle})
    free_root = task.with_fields("search", root="free")
    free_tip = task.with_fields("end_effector", position="free")
    fixed = task.end_effector.fixed_position is not None
    for limit, field, holds, freed in (
        ("orientation of the root", 'search.root = "free"', search.root == "paper", free_root),
        ("set of hinge angles", f"search.{given} left out", search.hinge_set_deg is not None, any_angle),
        ("position of the end-effector", 'end_effector.position = "free"', fixed, free_tip),
    ):
        if holds:
            yield Relaxable(limit, field, "freeing it", 1.0, partial(_return_freed, freed), at_once=True)


def _return_freed(freed: Task, _: float) -> Task:
    return freed


def _others(task: Task) -> Iterator[Relaxable]:
    """Yield the planes of requirements, moved outwards by a share of the airflow's length, and the load cases."""
    for number, exposure in enumerate(task.exposure):
        if isinstance(exposure, Allowed):
            limit, more = f"exposure {number} ({exposure.kind})", "of the airflow's length as extra room"
            moved = partial(_move_planes, task, number, exposure.planes)
            yield Relaxable(limit, f"exposure[{number}].planes", more, 1.0, moved)

    def lighten(x: float) -> Task:
        # the weight stays
        lighter = tuple(case.scale(1 - x, 1 - x).model_copy(update={"com": case.com}) for case in task.cases)
        return task.model_copy(update={"load_cases": lighter, "task_seed": None})

    if lighten(0.5).load_cases != task.cases:
        more = "less force and torque at the end-effector"
        yield Relaxable("load cases", "load_cases", more, 1 - RELAXING.least, lighten)


def _move_planes(task: Task, number: int, planes: Sequence[Plane], x: float) -> Task:
    length = task.module.region_envelope.length
    farther = (plane.model_copy(update={"offset": plane.offset + x * length}) for plane in planes)
    return task.with_fields(number, planes=tuple(farther))


@dataclass
class _Attempt:
    """The search for the least share of one limit that gives one tree a design with a clear audit."""

    topology: Topology
    limit: Relaxable
    enough: int
    """Place in the ladder of the least share that did; the ladder's length while none has."""
    short: int = -1
    """Place of the largest share that was tried in vain."""
    proven: bool = False
    """True if a share was not solved, as the task is proven impossible with it."""
    failure: str | None = None
    """Why the solver or the audit gave no answer, with the change that was tried."""

    @property
    def rung(self) -> int | None:
        """Place of the share to try; None when nothing is left to try."""
        if self.failure is not None or self.enough - self.short == 1:
            return None
        last = len(self.limit.shares) - 1
        return last if self.enough > last else (self.enough + self.short) // 2

    def task_at(self, rung: int) -> ResolvedTask:
        """Return the task with the limit relaxed, as a user who changes the field gets it."""
        return self.limit.relaxed(self.limit.shares[rung]).resolve(self.topology.n)

    def change(self, rung: int) -> str:
        """Name the limit and a change of it."""
        return f"{self.limit.limit}: {self.limit.change(self.limit.shares[rung])}"

    def is_possible(self, backends: Backends) -> bool:
        """Return whether there is a share to solve; those with which the task is proven impossible are passed."""
        while (rung := self.rung) is not None:
            if backends.prove_impossible(self.task_at(rung)) is None:
                return True
            self.short, self.proven = rung, True
        return False

    def relaxation(self, task: Task) -> Relaxation:
        """Return what is known of the share that is enough."""
        limit, share = self.limit, self.limit.shares[self.enough]
        return Relaxation(
            topology_key=self.topology.key,
            limit=limit.limit,
            change=limit.change(share),
            field=limit.field,
            share=share,
            given=limit.value(task),
            enough=limit.value(limit.relaxed(share)),
            unit=limit.unit,
            not_enough=None if self.short < 0 else limit.shares[self.short],
            tightens=limit.tightens,
        )


def relax(task: Task, topologies: Sequence[Topology], tools: Tools, *, starts: int, seed: int) -> Relaxed | None:
    """Return which limits give topologies a design that have none; None if the time was over before.

    Args:
        task: the task as the user wrote it.
        topologies: the closest trees, all of one size; at most `trees` of them are looked at.
        tools: solver, audit, and proofs that spare both where even the relaxed task is impossible.
        starts: of the run; at most STARTS of them are used.
        seed: draws the starts.
    """
    backends, observer = tools.backends, tools.observer
    trees, n = topologies[: RELAXING.trees], topologies[0].n
    attempts = [_Attempt(tree, limit, len(limit.shares)) for tree in trees for limit in relaxable(task, n)]
    resolved, few = task.resolve(n), range(min(starts, STARTS))
    proven = backends.prove_impossible(resolved) is not None  # else what is easier is not either

    def deadline(numbered: tuple[int, int, Job]) -> float:
        """Return the time after which a solve and its audit, with every margin, count as hung [s]."""
        return (1 + LARGER_MARGINS) * (numbered[2].deadline + audit_deadline(n))

    over = False
    while not over:
        jobs = [
            (number, one.rung, Job(one.task_at(one.rung), one.topology, 1, few, seed))
            for number, one in enumerate(attempts)
            if (not proven or one.is_possible(backends)) and one.rung is not None
        ]
        if not jobs:
            break
        observer.phase(solving_phase("relaxing", resolved, len(jobs), len(few)))
        over = True
        ended = tools.engine.run(partial(_leads_to_a_design, backends), jobs, deadline=deadline, until=tools.until)
        for count, ((number, rung, _), outcome) in enumerate(ended, 1):
            attempt = attempts[number]
            if isinstance(outcome, Failed):
                attempt.failure = f"{attempt.change(rung)} ({outcome.reason})"
            elif outcome:
                attempt.enough = rung
            else:
                attempt.short = rung
            observer.settled(None)
            over = count < len(jobs)
    least = dict[str, Relaxation]()  # of every limit that helped: first what costs nothing, then the least change
    helpful = [one.relaxation(task) for one in attempts if one.enough < len(one.limit.shares)]
    for relaxed in sorted(helpful, key=lambda one: (not one.tightens, one.share, one.limit, one.topology_key)):
        least.setdefault(relaxed.limit, relaxed)
    if over and not least:
        return None
    others = [one for one in attempts if one.limit.limit not in least]
    untried = {one.limit.limit: one.failure for one in others if one.failure is not None}
    in_vain = {
        one.limit.limit: one.change(one.short) + (" (still proven impossible)" if one.proven else "")
        for one in others
        if one.short >= 0
    }
    return Relaxed(
        modules=n,
        starts=starts,
        relaxations=tuple(least.values())[:3],
        in_vain=tuple(sorted(words for limit, words in in_vain.items() if limit not in untried)),
        untried=tuple(sorted(untried.values())),
        topologies=tuple(tree.key for tree in trees),
    )


def _leads_to_a_design(backends: Backends, numbered: tuple[int, int, Job]) -> bool:
    """Return whether a job leads to a design whose audit is clear, with larger margins if need be (in a worker)."""
    job = numbered[2]
    raised = Margins([with_margin(job.task, margin) for margin in margins(job.task)])
    while True:
        design = backends.solve(raised.task, job.topology, starts=job.starts, seed=job.seed)
        if isinstance(design, Infeasible):
            return False
        audit = backends.audit(design)
        if audit.verdict == "clear":
            return True
        if not raised.raise_after(audit):
            return False


def find_causes(folder: RunFolder, tools: Tools) -> None:
    """Keep what gives the closest trees a design, of sizes that were searched to the end, if no size has any.

    Where every candidate failed nothing is known to bind. Limits that could not be tried are tried again.

    Args:
        folder: of a run without goals, or of its loosest level.
        tools: solver, audit and proofs.
    """
    request, ledger = folder.request, folder.ledger
    sizes = list(request.task.sizes)
    if any(row.feasible for n in sizes for row in ledger.ranking(n)):
        folder.drop_within(RunFile.RELAXED)
        return
    for n in sizes[-2:]:  # the largest alone
        context, kept = request.contexts(n)[0], causes(folder, n)
        bound = ledger.bound(context)
        proven = bound is not None and bound[1] is not None
        ended = proven or ledger.has_ended(context, request.starts, request.trials)
        tried = kept is not None and kept.starts >= request.starts and not kept.untried
        if not ended or tried or not (trees := _closest(folder, n, proven=proven)):
            continue
        relaxed = relax(request.task, trees, tools, starts=request.starts, seed=request.seed)
        if relaxed is not None:
            folder.keep(f"{RunFile.RELAXED}/n{n}.json", to_json(relaxed))


def causes(folder: RunFolder, n: int) -> Relaxed | None:
    """Return what gives the closest trees of n modules a design; None where that was not tried.

    Raises:
        BadInput: what was written of it is damaged.
    """
    return folder.read_within(RunFile.RELAXED, Relaxed).get(f"n{n}.json")


def _closest(folder: RunFolder, n: int, *, proven: bool) -> list[Topology]:
    """Return the trees that came closest to a design; of those that are proven impossible, any."""
    request, rows = folder.request, list(folder.ledger.ranking(n))
    task = request.contexts(n)[0].task
    missed = [
        (scaled_violation(row.violation, row.unit or "", task), row.key)
        for row in rows
        if row.status == "infeasible" and row.violation is not None
    ]
    if missed:
        return [Topology.from_key(key) for _, key in nsmallest(RELAXING.trees, missed)]
    if proven:
        return list(dict.fromkeys(request.space(n).sample(RELAXING.trees, request.seed)))
    impossible = (row.key for row in rows if row.status == "impossible")
    return [Topology.from_key(key) for key in islice(impossible, RELAXING.trees)]

"""Why there is no design: the limits, or pairs of limits, that give the closest trees a design when relaxed.

Every answer is measured: the task with the relaxed limit is solved again from the first starts of the run, so a
user who writes the value into the task file gets the same design with a clear audit. The smallest sufficient share
is found by bisection on a ladder of round shares. This is not a proof: a share that is insufficient from these
starts may be sufficient from others. A failed solve does not count: the limit neither helps nor was tried in vain.

A share x scales an upper limit by 1 + x, and a requirement by 1 - x, rounded to the printed digits. The relaxed
task is the one that a user gets by writing the printed value into the task file, including defaults that depend on
it. Pairs are tried if no limit suffices alone: of those that came closest, both by the same share, each up to its
own largest one.

What a task cannot give up is not relaxed: a solid region is an object of that size, where it is if the tip touches
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from heapq import nsmallest
from itertools import combinations, islice
from typing import Any

from pydantic import ValidationError

from topo_search.engine import Backends, Failed, Job, audit_deadline, scaled_violation
from topo_search.limits import length
from topo_search.model import Audit, Geometry, Infeasible, Relaxed, ResolvedTask, Task, Topology
from topo_search.model.exposure import Plane
from topo_search.model.files import to_json
from topo_search.model.relaxed import STARTS, Amount, Relaxation, Setting
from topo_search.model.shape import NOWHERE
from topo_search.study.answer import SizeAnswer
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row
from topo_search.study.progress import solving_phase
from topo_search.study.request import LARGER_MARGINS, Margins, margins, with_margin
from topo_search.study.solving import Tools


@dataclass(frozen=True)
class Relaxing:
    """Settings of the search for limits to relax."""

    trees: int = 2
    """Number of closest trees for which limits are relaxed."""
    paired: int = 4
    """Number of a tree's limits, of those that came closest alone, that are relaxed in pairs."""
    remaining: float = 0.2
    """Share of a requirement that remains when it is relaxed the most."""
    shares: tuple[float, ...] = (0.01, 0.02, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
    """Ladder of shares."""


RELAXING = Relaxing()


@dataclass(frozen=True)
class Relaxable:
    """A limit that can be relaxed, or a pair of limits."""

    task: Task
    """The task as the user wrote it."""
    modules: int
    """Number of modules."""
    limit: str
    """Name of the limit."""
    field: str
    """Field of the task."""
    words: str
    """Change in words: `more thrust`."""
    largest_share: float
    change: Callable[[Task, float], Task]
    """Returns a task with the limit relaxed by a share."""
    value: Callable[[Task], Amount | None] = lambda _: None
    """Returns the limit's value in a task; None if it is not made of a few numbers."""
    unit: str = ""
    whole: float | None = None
    """Length whose share is added to the limit [m]; None: a share of the limit itself."""
    is_switch: bool = False
    """True if the limit can only be kept or dropped."""
    tightens: bool = False
    """True if the limit gets stricter: its designs also satisfy the original task, whose search may miss them."""
    also: Relaxable | None = None
    """The second limit of a pair."""

    @property
    def limits(self) -> tuple[Relaxable, ...]:
        """The limit, or both limits of a pair."""
        return (self,) if self.also is None else (self, self.also)

    @cached_property
    def shares(self) -> tuple[float, ...]:
        """The shares to try, in ascending order: those with which the task is valid."""
        largest = max(limit.largest_share for limit in self.limits)
        ladder = (largest,) if all(limit.is_switch for limit in self.limits) else RELAXING.shares
        return tuple(x for x in ladder if x <= largest and self._is_valid(x))

    def _is_valid(self, share: float) -> bool:
        try:
            self.task_at(share)
        except ValidationError:  # for example a plane farther away than `speed_within`
            return False
        return True

    def relax(self, share: float) -> Task:
        """Return the user's task with the limits relaxed by a share, each up to its largest one."""
        task = self.task
        for limit in self.limits:
            task = limit.change(task, min(share, limit.largest_share))
        return task

    def task_at(self, share: float) -> ResolvedTask:
        """Return the task with the limits relaxed by a share; ValidationError if other fields rule it out."""
        return self.relax(share).resolve(self.modules)

    def settings(self, share: float) -> list[Setting]:
        """Return how each limit changes by a share."""
        relaxed = self.relax(share)
        return [limit._setting(min(share, limit.largest_share), relaxed) for limit in self.limits]

    def _setting(self, share: float, relaxed: Task) -> Setting:
        amount = f"{100 * share:.3g} %" if self.whole is None else length(share * self.whole)
        return Setting(
            limit=self.limit,
            change=self.words if self.is_switch else f"{amount} {self.words}",
            field=self.field,
            share=share,
            given=self.value(self.task),
            enough=self.value(relaxed),
            unit=self.unit,
        )


def relaxable(task: Task, n: int) -> list[Relaxable]:
    """Return the limits of a task for n modules that can be relaxed without changing the module or the tree."""
    limits = (*_numbers(task, n), *_planes(task, n), *_switches(task, n), *_loads(task, n))
    return [limit for limit in limits if limit.shares]


def _numbers(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the limits that are scaled: numbers, and points of regions."""
    by_weight, shrink = float(task.module.max_thrust is None), RELAXING.remaining - 1
    force, torque = ("N", "N m") if task.flight.units == "SI" else ("m_t g", "l_arm m_t g")
    larger, built = 1 / task.search.peak_input - 1, shrink * bool(task.flight.tolerances)
    # part, field, limit, largest share (negative: the value shrinks), change in words, unit
    table: list[tuple[str | int, str, str, float, str, str]] = [
        ("module", "max_thrust_to_weight", "rotor limits", by_weight, "more thrust", ""),
        ("module", "max_thrust", "rotor limits", 1.0, "more thrust", "N"),
        ("module", "connector_distance", "distance of module centres", 1.0, "longer connectors", "m"),
        ("search", "peak_input", "rotor inputs", larger, "larger share of the largest input", ""),
        ("end_effector", "mass", "mass of the end-effector", shrink, "lighter end-effector", "kg"),
        ("end_effector", "largest_reach", "reach of the rod", 1.0, "more reach", "m"),
        ("end_effector", "largest_reach", "reach of the rod, tightened", shrink, "less reach", "m"),
        ("end_effector", "within_deg", "angle of the rod from its axis", 1.0, "wider angle", "deg"),
        ("end_effector", "stand_off", "stand-off", shrink, "less stand-off of the end-effector", "m"),
        ("flight", "force_reserve", "reserve of force", shrink, "less", force),
        ("flight", "torque_reserve", "reserve of torque", shrink, "less", torque),
        ("flight", "tilt_deg", "tilt held in hover", shrink, "less", "deg"),
        ("flight", "com_error", "error of the centre of mass", shrink, "less", "m"),
        ("flight", "angular_acceleration", "angular acceleration", shrink, "less", "rad/s^2"),
        ("flight", "joint_force", "force in a joint", 1.0, "larger force", "N"),
        ("flight", "joint_moment", "moment in a joint", 1.0, "larger moment", "N m"),
        ("tolerances", "hinge_angle_deg", "error of hinge angles", built, "less", "deg"),
        ("tolerances", "position", "error of positions", built, "less", "m"),
    ]
    for number, exposure in enumerate(task.exposure):
        limit = f"exposure {number} ({exposure.kind})"
        table.append((number, "speed", f"air over {limit}", 1.0, "faster air", "m/s"))
        if not exposure.solid:
            wider = min(1.0, 90 / getattr(exposure, "half_angle_deg", 90) - 1)
            table.append((number, "half_angle_deg", limit, wider, "wider cone", "deg"))
            table.append((number, "radius", limit, shrink, "smaller radius", "m"))
            table += [
                (number, name, limit, shrink, "smaller region", "m") for name in ("box", "vertices", "pieces")
            ]
    for part, name, limit, largest_share, words, unit in table:
        read = partial(_value, n, part, name)
        if (value := read(task)) and value != NOWHERE and largest_share:
            is_points = isinstance(value, tuple) and isinstance(value[0], tuple)
            yield Relaxable(
                task,
                n,
                limit,
                f"{part}.{name}" if isinstance(part, str) else f"exposure[{part}].{name}",
                words,
                abs(largest_share),
                partial(_scale, read, part, name, math.copysign(1.0, largest_share)),
                (lambda _: None) if is_points else read,
                unit,
                tightens=name == "largest_reach" and largest_share < 0,
            )


def _value(n: int, part: str | int, name: str, task: Task) -> Any:
    """Return the value of a field of a part (see `Task.with_fields`), or its default; None without either."""
    if name == "largest_reach":
        return task.largest_reach(n)
    if name == "within_deg":
        return task.end_effector.largest_angle_deg if task.end_effector.axis is not None else None
    if name in ("joint_force", "joint_moment"):
        return task.joint_limits[name == "joint_moment"]
    return getattr(getattr(task, part) if isinstance(part, str) else task.exposure[part], name, None)


def _scale(read: Callable[[Task], Any], part: str | int, name: str, sign: float, task: Task, share: float) -> Task:
    fields = {name: _times(read(task), 1 + sign * share)}
    if name == "max_thrust":
        fields["max_thrust_to_weight"] = 4 * fields[name] / (task.module.mass * task.gravity)
    return task.with_fields(part, **fields)


def _times(value: Any, factor: float) -> Any:
    """Return a number, or every number of a tuple, times a factor, with the digits of `Setting.words`."""
    if isinstance(value, tuple):
        return tuple(_times(x, factor) for x in value)
    return float(f"{value * factor:.6g}")


def _planes(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the room of airflow between planes, which move outwards, but for walls that the tip touches."""
    whole = task.module.region_envelope.length
    for e, exposure in enumerate(task.exposure):
        movable = tuple(k for k, plane in enumerate(_planes_of(task, e)) if plane.offset or not exposure.solid)
        if movable:
            numbers, limit = ", ".join(map(str, movable)), f"exposure {e} ({exposure.kind})"
            field = f"exposure[{e}].planes[{numbers}].offset"
            read, move = partial(_offsets, e, movable), partial(_move_planes, e, movable, whole)
            yield Relaxable(task, n, limit, field, "more room", 1.0, move, read, "m", whole=whole)


def _offsets(e: int, movable: Sequence[int], task: Task) -> tuple[float, ...]:
    planes = _planes_of(task, e)
    return tuple(planes[k].offset for k in movable)


def _planes_of(task: Task, e: int) -> tuple[Plane, ...]:
    return getattr(task.exposure[e], "planes", ())


def _move_planes(e: int, movable: Sequence[int], whole: float, task: Task, share: float) -> Task:
    moved = [
        plane.model_copy(update={"offset": round(plane.offset + share * whole, 3)}) if k in movable else plane
        for k, plane in enumerate(_planes_of(task, e))
    ]
    return task.with_fields(e, planes=tuple(moved))


def _switches(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield the limits that can only be kept or dropped."""
    search = task.search
    field_of_set = "hinge_step_deg" if search.hinge_angles_deg is None else "hinge_angles_deg"
    is_fixed = task.end_effector.fixed_position is not None
    freed: tuple[tuple[str, str, bool, Callable[[Task, float], Task]], ...] = (
        (
            "orientation of the root",
            'search.root = "free"',
            search.root == "paper",
            lambda task, _: task.with_fields("search", root="free"),
        ),
        (
            "set of hinge angles",
            f"search.{field_of_set} left out",
            search.hinge_set_deg is not None,
            lambda task, _: task.model_copy(update={"search": task.search.any_angle}),
        ),
        (
            "position of the end-effector",
            'end_effector.position = "free"',
            is_fixed,
            lambda task, _: task.with_fields("end_effector", position="free"),
        ),
    )
    for limit, field, applies, free in freed:
        if applies:
            yield Relaxable(task, n, limit, field, "freeing it", 1.0, free, is_switch=True)


def _loads(task: Task, n: int) -> Iterator[Relaxable]:
    """Yield what the load cases ask for at the end-effector, named by the one with the largest force or torque."""

    def size(k: int) -> tuple[float, float]:
        wrench = task.cases[k].at_end_effector
        return math.hypot(*wrench.force), math.hypot(*wrench.torque)

    def lighten(task: Task, share: float) -> Task:
        # the wrench at the centre of mass carries the weight and stays
        lighter = tuple(
            case.scale(1 - share, 1 - share).model_copy(update={"com": case.com}) for case in task.cases
        )
        return task.model_copy(update={"load_cases": lighter, "task_seed": None})

    if lighten(task, 0.5).load_cases == task.cases:
        return
    k = max(range(len(task.cases)), key=size)
    name, units = ("force", ("N", "m_t g")) if size(k)[0] else ("torque", ("N m", "l_arm m_t g"))
    yield Relaxable(
        task,
        n,
        "load cases",
        f"load_cases[{k}].end_effector.{name}",
        "less force and torque at the end-effector",
        1 - RELAXING.remaining,
        lighten,
        lambda task: getattr(task.cases[k].at_end_effector, name),
        units[task.cases[k].units == "weight"],
    )


@dataclass
class _Bisection:
    """Bisection for the smallest share of a limit, or a pair, that gives one tree a design with a clear audit."""

    topology: Topology
    limit: Relaxable
    insufficient: int = -1
    """Rung of the largest share that did not."""
    violation: float = math.inf
    """What a design misses at that rung, scaled as in `scaled_violation`."""
    proven: bool = False
    """True if some share was skipped because the task is proven impossible with it."""
    failure: str | None = None
    """The change for which the solver or the audit failed, and why."""

    def __post_init__(self) -> None:
        self.sufficient = len(self.limit.shares)
        """Rung of the smallest share that did; the ladder's length if none has yet."""

    @property
    def helps(self) -> bool:
        """True if some share is sufficient."""
        return self.sufficient < len(self.limit.shares)

    @property
    def rung(self) -> int | None:
        """Index of the next share to try; None when the bisection has ended."""
        if self.failure is not None or self.sufficient - self.insufficient == 1:
            return None
        return (self.sufficient + self.insufficient) // 2 if self.helps else len(self.limit.shares) - 1

    def task_at(self, rung: int) -> ResolvedTask:
        """Return the task with the limit relaxed to a rung."""
        return self.limit.task_at(self.limit.shares[rung])

    def change(self, rung: int) -> str:
        """Return the limit and its change at a rung in words."""
        settings = self.limit.settings(self.limit.shares[rung])
        return " with ".join(f"{setting.limit}: {setting.change}" for setting in settings)

    def is_possible(self, backends: Backends) -> bool:
        """Advance past shares with which the task is proven impossible; return whether one is left to solve."""
        while (rung := self.rung) is not None:
            task = self.task_at(rung)
            if (proof := backends.prove_impossible(task)) is None:
                return True
            self.insufficient, self.proven = rung, True
            self.violation = scaled_violation(proof.violation, proof.unit, task)
        return False

    def relaxation(self) -> Relaxation:
        """Return the record of the smallest sufficient share."""
        first, *also = self.limit.settings(self.limit.shares[self.sufficient])
        return Relaxation(
            **dict(first),
            topology_key=self.topology.key,
            not_enough=None if self.insufficient < 0 else self.limit.shares[self.insufficient],
            tightens=self.limit.tightens,
            also=tuple(also),
        )


def _pairs(searches: Sequence[_Bisection]) -> Iterator[_Bisection]:
    """Yield the pairs of each tree's limits that came closest to a design alone."""
    for tree in dict.fromkeys(search.topology for search in searches):
        tried = (search for search in searches if search.topology == tree and search.insufficient >= 0)
        closest = nsmallest(RELAXING.paired, tried, key=lambda search: search.violation)
        for first, second in combinations((search.limit for search in closest), 2):
            pair = replace(first, also=second)
            if first.field != second.field and pair.shares:
                yield _Bisection(tree, pair)


def relax(
    task: Task,
    topologies: Sequence[Topology],
    tools: Tools,
    *,
    starts: int,
    seed: int,
    kept: Collection[str] = (),
) -> Relaxed | None:
    """Return the limits that give trees without a design one when relaxed; None if the time was too short.

    Args:
        task: the task as the user wrote it.
        topologies: the closest trees, all of one size; only the first `RELAXING.trees` are used.
        tools: solver, audit, bounds, engine, observer and time limit.
        starts: number of starts of the run; at most STARTS of them are used.
        seed: seeds the random starts.
        kept: fields that are not relaxed, because an answer without them exists; then only single limits are
            relaxed, for one tree.
    """
    trees, n = topologies[: 1 if kept else RELAXING.trees], topologies[0].n
    job_starts, resolved = range(min(starts, STARTS)), task.resolve(n)
    proven = tools.backends.prove_impossible(resolved) is not None  # otherwise no easier task is proven impossible
    limits = [limit for limit in relaxable(task, n) if limit.field not in kept]
    searches = [_Bisection(tree, limit) for tree in trees for limit in limits]
    ended = _bisect(searches, tools, resolved, job_starts, seed, proven=proven)
    if ended and not kept and not any(search.helps for search in searches):
        pairs = [*_pairs(searches)]
        ended = _bisect(pairs, tools, resolved, job_starts, seed, proven=proven)
        searches += pairs
    best = dict[str, Relaxation]()  # per helpful limit: those that only tighten first, then the smallest change
    helpful = [search.relaxation() for search in searches if search.helps]
    for relaxation in sorted(helpful, key=lambda r: (not r.tightens, r.share, r.limits, r.topology_key)):
        best.setdefault(relaxation.limits, relaxation)
    if not ended and not best:
        return None
    single = [search for search in searches if search.limit.also is None and search.limit.limit not in best]
    untried = {search.limit.limit: search.failure for search in single if search.failure is not None}
    in_vain = {
        search.limit.limit: search.change(search.insufficient)
        + (" (still proven impossible)" if search.proven else "")
        for search in single
        if search.insufficient >= 0
    }
    return Relaxed(
        modules=n,
        starts=starts,
        relaxations=tuple(best.values())[:3],
        in_vain=tuple(sorted(words for limit, words in in_vain.items() if limit not in untried)),
        untried=tuple(sorted(untried.values())),
        topologies=tuple(tree.key for tree in trees),
        pairs=len({search.limit.limits for search in searches if search.limit.also and not search.helps}),
    )


def _bisect(
    searches: Sequence[_Bisection], tools: Tools, task: ResolvedTask, starts: range, seed: int, *, proven: bool
) -> bool:
    """Bisect the shares of all searches at once; return whether the time was enough.

    `proven`: the task itself is proven impossible, so tasks with small shares may be, too.
    """
    backends, observer = tools.backends, tools.observer

    def deadline(numbered_job: tuple[int, int, Job]) -> float:
        """Return the time after which solving and auditing with every margin count as hung [s]."""
        return (1 + LARGER_MARGINS) * (numbered_job[2].deadline + audit_deadline(task.n))

    while True:
        jobs = [
            (number, search.rung, Job(search.task_at(search.rung), search.topology, starts, seed))
            for number, search in enumerate(searches)
            if (not proven or search.is_possible(backends)) and search.rung is not None
        ]
        if not jobs:
            return True
        observer.phase(solving_phase("relaxing", task, len(jobs), len(starts)))
        unsettled = len(jobs)
        results = tools.engine.run(partial(_measure_miss, backends), jobs, deadline=deadline, until=tools.until)
        for (number, rung, _), outcome in results:
            search = searches[number]
            if isinstance(outcome, Failed):
                search.failure = f"{search.change(rung)} ({outcome.reason})"
            elif outcome is None:
                search.sufficient = rung
            else:
                search.insufficient, search.violation = rung, outcome
            unsettled -= 1
            observer.settled(None)
        if unsettled:
            return False


def _measure_miss(backends: Backends, numbered_job: tuple[int, int, Job]) -> float | None:
    """Return what a job's design misses (`scaled_violation`); None if it has a clear audit (in a worker).

    The audit may need larger margins; a design that fails it with all of them misses 0.
    """
    job = numbered_job[2]
    ladder = Margins([with_margin(job.task, margin) for margin in margins(job.task)])
    while True:
        design = backends.solve(replace(job, task=ladder.task))
        if isinstance(design, Infeasible):
            return scaled_violation(design.violation, design.unit, job.task)
        audit = backends.audit(design)
        if audit.verdict == "clear":
            return None
        if not ladder.raise_after(audit):
            return 0.0


def find_causes(folder: RunFolder, tools: Tools) -> None:
    """Find and store limits and nearest miss, if no size has a design that holds the defaults of flying tasks.

    Limits are relaxed for the two largest sizes only, once their search is complete; a size where every candidate
    failed is skipped. Limits whose attempts failed are tried again.

    Args:
        folder: folder of a run without goals, or of its loosest level.
        tools: solver, audit, bounds, engine, observer and time limit.
    """
    request, ledger = folder.request, folder.ledger
    sizes = list(request.task.sizes)
    if any(row.feasible for n in sizes for row in ledger.ranking(n)):
        if folder.asked is not None:
            find_causes(folder.asked.levels[0], tools)
            return
        folder.remove_files(RunFile.RELAXED)
        folder.write_file(RunFile.CLOSEST, None)
        folder.write_file(RunFile.CLOSEST_AUDIT, None)
        return
    _keep_closest(folder, tools)
    for n in sizes[-2:]:
        context, stored = request.contexts(n)[0], causes(folder, n)
        bound = ledger.bound(context)
        proven = bound is not None and bound[1] is not None
        is_complete = proven or ledger.is_complete(context, request.starts, request.trials)
        is_current = stored is not None and stored.starts >= request.starts and not stored.untried
        if not is_complete or is_current or not (trees := _closest_trees(folder, n, proven=proven)):
            continue
        kept = request.task.flight.filled
        relaxed = relax(request.task, trees, tools, starts=request.starts, seed=request.seed, kept=kept)
        if relaxed is not None:
            folder.write_file(f"{RunFile.RELAXED}/n{n}.json", to_json(relaxed))


def _keep_closest(folder: RunFolder, tools: Tools) -> None:
    """Store the platform with the smallest violation of all sizes, and its audit."""
    misses = [miss for n in folder.request.task.sizes for miss in _misses(folder, n)]
    if not misses:
        return
    row = min(misses)[-1]
    result = folder.ledger.result(folder.request.contexts(row.modules)[row.step], row.key)
    closest = result.closest if isinstance(result, Infeasible) else None
    if closest is None or folder.read_file(RunFile.CLOSEST, Geometry) == closest:
        return
    audit = tools.engine.run_one(tools.backends.audit, closest, deadline=audit_deadline(row.modules))
    if isinstance(audit, Audit):
        folder.write_file(RunFile.CLOSEST, to_json(closest))
        folder.write_file(RunFile.CLOSEST_AUDIT, to_json(audit))


def _misses(folder: RunFolder, n: int) -> Iterator[tuple[float, str, Row]]:
    """Yield the scaled violation and the key of every candidate of a size that missed something, with its row."""
    task = folder.request.contexts(n)[0].task
    for row in folder.ledger.ranking(n):
        if row.status == "infeasible" and row.violation is not None:
            yield scaled_violation(row.violation, row.unit or "", task), row.key, row


def add_causes(folder: RunFolder, size: SizeAnswer) -> SizeAnswer:
    """Return the answer of a size with the limits that prevent a design, or one that holds the defaults."""
    if size.feasible and folder.request.asked is None:
        return size
    return replace(size, relaxed=causes(folder, size.modules))


def causes(folder: RunFolder, n: int) -> Relaxed | None:
    """Return the stored limits that prevent a design of n modules; None if they were not examined.

    Raises:
        BadInput: the file is damaged.
    """
    return folder.read_files(RunFile.RELAXED, Relaxed).get(f"n{n}.json")


def _closest_trees(folder: RunFolder, n: int, *, proven: bool) -> list[Topology]:
    """Return the trees with the smallest violations; if all are proven impossible, any trees."""
    request = folder.request
    if closest := nsmallest(RELAXING.trees, _misses(folder, n)):
        return [Topology.from_key(key) for _, key, _ in closest]
    if proven:
        return list(dict.fromkeys(request.space(n).sample(RELAXING.trees, request.seed)))
    impossible = (row.key for row in folder.ledger.ranking(n) if row.status == "impossible")
    return [Topology.from_key(key) for key in islice(impossible, RELAXING.trees)]

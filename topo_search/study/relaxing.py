"""Why there is no design: the limits, or pairs of limits, that give the closest trees a design when relaxed.

Every answer is measured: the task with the relaxed limit is solved again from the first starts of the run, so a
user who writes the value into the task file gets the same design with a clear audit. The smallest sufficient share
is found by bisection on a ladder of round shares. This is not a proof: a share that is insufficient from these
starts may be sufficient from others. A failed solve does not count: the limit neither helps nor was tried in vain.

Pairs are tried if no limit suffices alone: of those that came closest, both by the same share, each up to its
own largest one.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from heapq import nsmallest
from itertools import combinations, islice

from topo_search.engine import Backends, Failed, Job
from topo_search.engine.workers import audit_deadline, scaled_violation
from topo_search.model import Audit, Geometry, Infeasible, Relaxed, ResolvedTask, Task, Topology
from topo_search.model.files import to_json
from topo_search.model.relaxed import STARTS, Relaxation
from topo_search.study.answer import SizeAnswer
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row
from topo_search.study.progress import solving_phase
from topo_search.study.relaxable_limits import RELAXING, Relaxable, relaxable
from topo_search.study.request import LARGER_MARGINS, Margins
from topo_search.study.solving import Tools


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
    task: Task, topologies: Sequence[Topology], tools: Tools, *, starts: int, seed: int, kept: Collection[str] = ()
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
    ladder = Margins.of(job.task)
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

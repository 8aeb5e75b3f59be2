"""Why there is no design: which single limit, relaxed on its own, gives the closest trees one, and by how little.

Every answer is measured: the task with the relaxed limit is solved again from the first starts of the run, so a
user who writes the value into the task file gets the same design, and its audit is clear. The least share is sought
by bisection in a ladder of round ones. Nothing is proven: a share that was not enough from these starts may be from
others. A solve that fails is no attempt: the limit neither helps nor is tried in vain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from heapq import nsmallest
from itertools import islice

from topo_search.engine import Backends, Failed, Job, audit_deadline, scaled_violation
from topo_search.model import Infeasible, Relaxed, ResolvedTask, Task, Topology
from topo_search.model.design import STARTS, Relaxation
from topo_search.model.files import to_json
from topo_search.model.relaxable import Relaxable, relaxable
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.progress import Phase, solving_seconds
from topo_search.study.request import LARGER_MARGINS, Margins, margins, with_margin
from topo_search.study.solving import Tools

TREES = 2
"""The closest trees, for which limits are relaxed."""


@dataclass
class _Attempt:
    """One limit of one tree, as far as it was tried."""

    task: Task
    topology: Topology
    limit: Relaxable
    enough: int | None = None
    """Place in the ladder of the least share that led to a design with a clear audit."""
    short: int = -1
    """Place of the largest share that was tried in vain."""
    proven: bool = False
    """True if a share was not solved, as the task is proven impossible with it."""
    failure: str | None = None
    """Why the solver or the audit gave no answer, with the change that was tried."""

    @property
    def next(self) -> int | None:
        """Place of the share to try; None when nothing is left to try."""
        last = len(self.limit.shares) - 1
        if self.failure is not None:
            return None
        if self.enough is None:
            return last if self.short < last else None
        return (self.enough + self.short) // 2 if self.enough - self.short > 1 else None

    def task_at(self, rung: int) -> ResolvedTask:
        """Return the task with the limit relaxed, as a user who changes the field gets it."""
        return self.limit.relaxed(self.limit.shares[rung]).resolve(self.topology.n)

    def change(self, rung: int) -> str:
        """Name the limit and a change of it."""
        return f"{self.limit.limit}: {self.limit.change(self.limit.shares[rung])}"

    def take(self, rung: int, outcome: bool | Failed) -> None:
        """Take up whether a share led to a design with a clear audit."""
        if isinstance(outcome, Failed):
            self.failure = f"{self.change(rung)} ({outcome.reason})"
        elif outcome:
            self.enough = rung
        else:
            self.short = rung

    def relaxation(self, rung: int) -> Relaxation:
        """Return what is known of a share that is enough."""
        limit, share = self.limit, self.limit.shares[rung]
        return Relaxation(
            topology_key=self.topology.key,
            limit=limit.limit,
            change=limit.change(share),
            field=limit.field,
            share=share,
            given=limit.value(self.task),
            enough=limit.value(limit.relaxed(share)),
            unit=limit.unit,
            not_enough=None if self.short < 0 else limit.shares[self.short],
            tightens=limit.tightens,
        )


def relax(task: Task, topologies: Sequence[Topology], tools: Tools, *, starts: int, seed: int) -> Relaxed | None:
    """Return which limits give topologies a design that have none; None if the time was over before.

    Args:
        task: the task as the user wrote it.
        topologies: the closest trees, all of one size; at most TREES of them are looked at.
        tools: solver, audit, and proofs that spare both where even the relaxed task is impossible.
        starts: of the run; at most STARTS of them are used.
        seed: draws the starts.
    """
    backends, observer = tools.backends, tools.observer
    trees, n = topologies[:TREES], topologies[0].n
    attempts = [_Attempt(task, tree, limit) for tree in trees for limit in relaxable(task, n)]
    resolved, few = task.resolve(n), range(min(starts, STARTS))
    proven = backends.prove_impossible(resolved) is not None  # else what is easier is not either

    def deadline(numbered: tuple[int, int, Job]) -> float:
        """Return the time after which a solve and its audit, with every margin, count as hung [s]."""
        return (1 + LARGER_MARGINS) * (numbered[2].deadline + audit_deadline(n))

    over = False
    while not over and (due := _possible_attempts(attempts, backends if proven else None)):
        observer.phase(Phase("relaxing", n, len(due), len(few), solving_seconds(resolved, len(few))))
        jobs = [(k, rung, Job(attempts[k].task_at(rung), attempts[k].topology, 1, few, seed)) for k, rung in due]
        over = True
        ended = tools.engine.run(partial(_leads_to_a_design, backends), jobs, deadline=deadline, until=tools.until)
        for count, ((k, rung, _), outcome) in enumerate(ended, 1):
            attempts[k].take(rung, outcome)
            observer.settled(None)
            over = count < len(jobs)
    helpful = _least(attempts)
    if over and not helpful:
        return None
    others = [one for one in attempts if one.limit.limit not in {helped.limit for helped in helpful}]
    untried = {one.limit.limit: one.failure for one in others if one.failure is not None}
    in_vain = {
        one.limit.limit: one.change(one.short) + (" (still proven impossible)" if one.proven else "")
        for one in others
        if one.short >= 0
    }
    return Relaxed(
        modules=n,
        starts=starts,
        relaxations=tuple(helpful[:3]),
        in_vain=tuple(sorted(words for limit, words in in_vain.items() if limit not in untried)),
        untried=tuple(sorted(untried.values())),
        topologies=tuple(tree.key for tree in trees),
    )


def _possible_attempts(attempts: list[_Attempt], backends: Backends | None) -> list[tuple[int, int]]:
    """Return which attempts to solve with which place of their ladders; with proofs, those that may be possible."""
    due = list[tuple[int, int]]()
    for number, attempt in enumerate(attempts):
        while (rung := attempt.next) is not None:
            if backends is None or backends.prove_impossible(attempt.task_at(rung)) is None:
                due.append((number, rung))
                break
            attempt.take(rung, False)
            attempt.proven = True
    return due


def _least(attempts: list[_Attempt]) -> list[Relaxation]:
    """Return the least change of every limit that helped: first what costs nothing, then the least change."""
    helpful = [one.relaxation(one.enough) for one in attempts if one.enough is not None]
    least = dict[str, Relaxation]()
    for one in sorted(helpful, key=lambda one: (not one.tightens, one.share, one.limit, one.topology_key)):
        least.setdefault(one.limit, one)
    return list(least.values())


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
        return [Topology.from_key(key) for _, key in nsmallest(TREES, missed)]
    if proven:
        return list(dict.fromkeys(request.space(n).sample(TREES, request.seed)))
    impossible = (row.key for row in rows if row.status == "impossible")
    return [Topology.from_key(key) for key in islice(impossible, TREES)]

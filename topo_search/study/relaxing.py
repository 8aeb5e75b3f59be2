"""Why there is no design: which limit of the task, relaxed alone, gives the closest trees one, and by how little.

Every answer is measured: the task with the relaxed limit is solved again, from a few starts and from the design
found with more of it. The least share is sought by bisection in a ladder of round ones. Nothing is proven: a share
that was not enough from these starts may be from others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from topo_search.engine import Backends, Engine, Failed, Job, Solve
from topo_search.model import Design, Infeasible, ResolvedTask, Topology
from topo_search.model.relaxable import Relaxable, relaxable
from topo_search.model.relaxation import Relaxation, Relaxed
from topo_search.study.observer import Observer
from topo_search.study.phases import Phase, solving_seconds

TREES = 2
"""The closest trees, for which limits are relaxed."""
STARTS = 4
"""Most starts of each solve."""
KEPT = 3
"""Most relaxations that are told."""


@dataclass
class _Attempt:
    """One limit of one tree, as far as it was tried."""

    topology: Topology
    limit: Relaxable
    enough: int | None = None
    """Place of the least share that is known to be enough."""
    short: int = -1
    """Place of the largest share that was tried in vain."""
    design: Design | None = None
    """With the share that is enough."""

    @property
    def next(self) -> int | None:
        """Place of the share to try; None when nothing is left to try."""
        last = len(self.limit.shares) - 1
        if self.enough is None:
            return last if self.short < last else None
        return (self.enough + self.short) // 2 if self.enough - self.short > 1 else None

    def take(self, place: int, outcome: Design | Infeasible | Failed) -> None:
        """Take up what came of a share."""
        if isinstance(outcome, Design):
            self.enough, self.design = place, outcome
        else:
            self.short = place

    def relaxation(self, task: ResolvedTask) -> Relaxation | None:
        """Return what was found out; None if nothing was enough."""
        if self.enough is None:
            return None
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
        )


def relax(
    task: ResolvedTask,
    topologies: Sequence[Topology],
    *,
    starts: int,
    seed: int,
    backends: Backends,
    engine: Engine,
    observer: Observer,
    until: float = math.inf,
) -> Relaxed | None:
    """Return which limits give topologies a design that have none; None if the time was over before.

    Args:
        task: the task as it is.
        topologies: the closest trees, at most TREES of them are looked at.
        starts: of the run; at most STARTS of them are used.
        seed: draws the starts.
        backends: the solver, and proofs that spare it where even the relaxed task is impossible.
        engine: where it runs.
        observer: is told of the progress.
        until: time.monotonic() at which to stop, with what was found by then.
    """
    attempts = [_Attempt(topology, limit) for topology in topologies[:TREES] for limit in relaxable(task)]
    few = range(min(starts, STARTS))
    proven = backends.prove_impossible(task) is not None  # else what is easier is not either
    while jobs := _possible_attempts(attempts, backends if proven else None):
        observer.phase(Phase("relaxing", task.n, len(jobs), len(few), solving_seconds(task, len(few))))
        numbered = [(number, place, _job(attempts[number], place, few, seed)) for number, place in jobs]
        ended = engine.run(
            partial(_solve, backends.solve), numbered, deadline=lambda job: job[2].deadline, until=until
        )
        count = 0
        for (number, place, _), outcome in ended:
            attempts[number].take(place, outcome)
            observer.settled(None)
            count += 1
        if count < len(jobs):  # the time is over
            if not any(attempt.design for attempt in attempts):
                return None
            break
    found = [one for attempt in attempts if (one := attempt.relaxation(task)) is not None]
    helped = {attempt.limit.field for attempt in attempts if attempt.enough is not None}
    in_vain = {
        attempt.limit.field: f"{attempt.limit.limit}: {attempt.limit.change(attempt.limit.shares[-1])}"
        for attempt in attempts
        if attempt.limit.field not in helped and attempt.short >= 0
    }
    return Relaxed(modules=task.n, starts=starts, relaxations=_best(found), in_vain=tuple(sorted(in_vain.values())))


def _possible_attempts(attempts: list[_Attempt], backends: Backends | None) -> list[tuple[int, int]]:
    """Return which attempts to solve with which place of their ladders; with proofs, those that may be possible."""
    due = list[tuple[int, int]]()
    for number, attempt in enumerate(attempts):
        while (place := attempt.next) is not None:
            task = attempt.limit.relaxed(attempt.limit.shares[place])
            proof = None if backends is None else backends.prove_impossible(task)
            if proof is None:
                due.append((number, place))
                break
            attempt.take(place, proof)
    return due


def _best(found: list[Relaxation]) -> tuple[Relaxation, ...]:
    """Return the least change of every limit, the least first."""
    least: dict[str, Relaxation] = {}
    for one in sorted(found, key=lambda one: (one.share, one.field, one.topology_key)):
        least.setdefault(one.field, one)
    return tuple(least.values())[:KEPT]


def _job(attempt: _Attempt, place: int, starts: range, seed: int) -> Job:
    """Return the solve of a task with one limit relaxed."""
    near = () if attempt.design is None else (attempt.design,)
    task = attempt.limit.relaxed(attempt.limit.shares[place])
    return Job(task, attempt.topology, 1, starts, seed, near)


def _solve(solve: Solve, numbered: tuple[int, int, Job]) -> Design | Infeasible:
    """Solve one of them (in a worker)."""
    job = numbered[2]
    return solve(job.task, job.topology, starts=job.starts, seed=job.seed, near=job.near)

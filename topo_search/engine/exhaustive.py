"""Exhaustive search: every candidate of one size is solved, whatever becomes of the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

from topo_search.engine.verbs import Outcome, Solve
from topo_search.engine.workers import Workers, solve_deadline
from topo_search.model import Design, Infeasible, ResolvedTask, Topology
from topo_search.topologies import Candidate


@dataclass(frozen=True)
class Job:
    """One candidate with the starts that it is still to be solved from."""

    task: ResolvedTask
    topology: Topology
    orbit: int
    """Number of classes of the exact quotient that the candidate stands for."""
    starts: range
    seed: int

    @property
    def deadline(self) -> float:
        """The time after which it counts as hung [s]."""
        return solve_deadline(self.topology.n, len(self.starts))


def exhaustive(
    task: ResolvedTask,
    candidates: Iterable[Candidate],
    *,
    starts: int,
    seed: int,
    tried: Callable[[str], int],
    solve: Solve,
    workers: Workers,
    until: float = math.inf,
) -> Iterator[tuple[Job, Outcome]]:
    """Yield every candidate as it ends, in any order.

    Args:
        task: the task for one number of modules.
        candidates: all of them; drawn as workers become free, so that there may be millions.
        starts: number of starts of each candidate.
        seed: draws the starts.
        tried: how many starts of the candidate with this key need no more solving.
        solve: the solver.
        workers: where it runs.
        until: time.monotonic() at which to stop.
    """

    def jobs() -> Iterator[Job]:
        for candidate in candidates:
            first = tried(candidate.key)
            if first < starts:
                yield Job(task, candidate.topology, candidate.orbit, range(first, starts), seed)

    yield from solved(jobs(), solve=solve, workers=workers, until=until)


def solved(
    jobs: Iterable[Job], *, solve: Solve, workers: Workers, until: float = math.inf
) -> Iterator[tuple[Job, Outcome]]:
    """Yield every job with its outcome as it ends, in any order."""
    return workers.run(partial(_solve, solve), jobs, deadline=lambda job: job.deadline, until=until)


def _solve(solve: Solve, job: Job) -> Design | Infeasible:
    """Solve one job (in a worker)."""
    return solve(job.task, job.topology, starts=job.starts, seed=job.seed)

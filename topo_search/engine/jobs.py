"""Jobs, and what the search asks of those who run them: worker processes, on one machine or on many."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

from topo_search.engine.backends import Failed, Outcome, Solve
from topo_search.model import Design, Infeasible, ResolvedTask, Topology

J = TypeVar("J")
R = TypeVar("R")


class WorkersLost(RuntimeError):
    """There is no worker: none lives long enough to take a job, or nobody answers where they should be."""


class Engine(Protocol):
    """Runs pure functions elsewhere; which engine it is, and how fast, changes nothing in what they return."""

    def run(
        self,
        function: Callable[[J], R],
        jobs: Iterable[J | None],
        *,
        deadline: Callable[[J], float],
        until: float = math.inf,
    ) -> Iterator[tuple[J, R | Failed]]:
        """Yield (job, result) as jobs end, in any order; `jobs` is drawn from only seconds ahead of the workers.

        A job that crashes its process or passes its deadline is tried twice, then comes back as Failed.

        Args:
            function: importable and pure.
            jobs: picklable values, drawn lazily; None where there is none before another result was yielded.
            deadline: seconds that a job may take.
            until: time.monotonic() at which to stop: what runs then is dropped and no more is begun.

        Raises:
            WorkersLost: there is nobody to take a job.
        """
        ...

    def run_one(
        self, function: Callable[[J], R], job: J, *, deadline: float, until: float = math.inf
    ) -> R | Failed:
        """Return the result of a single job."""
        for _, result in self.run(function, [job], deadline=lambda _: deadline, until=until):
            return result
        return Failed("timeout", "time limit reached")


def solve_deadline(n: int, starts: int) -> float:
    """Return the time after which a solve counts as hung [s]: far above what one takes (n = 5: 1 s a start)."""
    return 120.0 + starts * max(20.0, 0.2 * n**2)


def audit_deadline(n: int) -> float:
    """Return the time after which an audit counts as hung [s]: far above what one takes (n = 100: seconds)."""
    return 300.0 + 0.2 * n**2


@dataclass(frozen=True)
class Job:
    """One candidate with the starts that it is still to be solved from."""

    task: ResolvedTask
    topology: Topology
    orbit: int
    """Number of classes of the exact quotient that the candidate stands for."""
    starts: range
    seed: int
    near: tuple[Design, ...] = ()
    """Designs that are carried over, each as a start of its own before the others."""

    @property
    def deadline(self) -> float:
        """The time after which it counts as hung [s]."""
        return solve_deadline(self.topology.n, len(self.near) + len(self.starts))


def solve_jobs(
    jobs: Iterable[Job | None], *, solve: Solve, engine: Engine, until: float = math.inf
) -> Iterator[tuple[Job, Outcome]]:
    """Yield every job with its outcome as it ends, in any order; jobs are drawn as workers become free.

    Args:
        jobs: what is to be solved; None where that depends on what becomes of those before.
        solve: the solver.
        engine: where it runs.
        until: time.monotonic() at which to stop.
    """
    return engine.run(partial(_solve, solve), jobs, deadline=lambda job: job.deadline, until=until)


def _solve(solve: Solve, job: Job) -> Design | Infeasible:
    """Solve one job (in a worker)."""
    return solve(job.task, job.topology, starts=job.starts, seed=job.seed, near=job.near)

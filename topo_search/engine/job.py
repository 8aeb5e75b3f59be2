"""Jobs: one candidate with the starts that it is still to be solved from, solved in a worker."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial

from topo_search.engine.backends import Outcome, Solve
from topo_search.engine.engine import Engine
from topo_search.engine.workers import solve_deadline
from topo_search.model import Design, Infeasible, ResolvedTask, Topology


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

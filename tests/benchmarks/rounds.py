"""Simulated utilization of many workers with the sampler `moves`, by number of pending proposals.

    OMP_NUM_THREADS=1 python tests/benchmarks/rounds.py ten-wrenches --modules 12 [--jobs N] [--workers N]

Times of jobs are measured: some uniformly drawn trees are solved from as many starts as `moves` gives a new tree.
Proposals come from `moves` as in a run, as soon as a worker is free and the results that it learns from are known,
and their CPU time is measured as well. Each candidate then gets the time and the result of one of the measured
jobs, drawn by its key, so that nothing else is solved. The final solves from more starts are left out. Utilization
is the share of the workers' time in which they have a job, until the last proposal and until the end of the last
job.
"""

from __future__ import annotations

import argparse
import heapq
import time
from collections import deque
from contextlib import suppress
from random import Random
from typing import NamedTuple

import nlp
from topo_search.engine import Candidates, Proposal, Tried
from topo_search.engine.proposals import OptunaSearch
from topo_search.engine.proposals.moves import BREEDING
from topo_search.engine.workers import scaled_violation
from topo_search.model import Design, ResolvedTask
from topo_search.model.task_file import read_task


class Job(NamedTuple):
    """CPU time and result of a solve."""

    seconds: float
    status: str
    objective: float | None
    violation: float | None


class Utilization(NamedTuple):
    """Result of a simulation."""

    proposed: float
    """Share of the workers' time in which they have a job, until the last proposal."""
    ended: float
    """Likewise, until the end of the last job."""
    proposing: float
    """CPU time of the proposals [s]."""
    solving: float
    """CPU time of the jobs [s]."""
    number: int
    """Number of proposals."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="ten-wrenches")
    parser.add_argument("--modules", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=12, help="number of jobs to measure")
    parser.add_argument("--workers", type=int, default=64)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--rounds", type=int, nargs="+", default=[64, 128, 256, 384])
    arguments = parser.parse_args()
    task = read_task(arguments.example, (f"modules={arguments.modules}",)).resolve(arguments.modules)
    space = Candidates(task, "task")
    print(f"{task.name}, n = {task.n}, {arguments.trials} trees, {arguments.workers} workers")
    columns = "busy till the last proposal | till the end"
    print(f"| pending at a time | starts; CPU s, at most | {columns} | a proposal, CPU ms | of the jobs' CPU |")
    print("|---|---|---|---|---|---|")
    jobs_by_starts: dict[int, list[Job]] = {}
    for size in arguments.rounds:
        starts = BREEDING.many_starts if size >= BREEDING.many_open else 1
        if starts not in jobs_by_starts:
            jobs_by_starts[starts] = measure_jobs(space, task, arguments.jobs, starts)
        jobs, seconds = jobs_by_starts[starts], [job.seconds for job in jobs_by_starts[starts]]
        result = simulate(space, jobs, size, arguments.trials, arguments.workers)
        milliseconds, share = 1e3 * result.proposing / result.number, result.proposing / result.solving
        cells = f"{size} | {starts}; {sum(seconds) / len(seconds):.2f}, {max(seconds):.2f}"
        print(
            f"| {cells} | {result.proposed:.0%} | {result.ended:.0%} | {milliseconds:.1f} | {share:.1%} |",
            flush=True,
        )


def measure_jobs(space: Candidates, task: ResolvedTask, number: int, starts: int) -> list[Job]:
    """Solve trees and return time and result of each; the first, which loads code, does not count."""
    jobs = []
    for tree in space.sample(number + 1, 0):
        started = time.process_time()
        outcome = nlp.solve(task, tree, starts=range(starts), seed=0)
        seconds = time.process_time() - started
        if isinstance(outcome, Design):
            jobs.append(Job(seconds, "feasible", outcome.objective, None))
        else:
            violation = scaled_violation(outcome.violation, outcome.unit, task)
            jobs.append(Job(seconds, outcome.status, None, violation))
    return jobs[1:]


class SimulatedWorkers:
    """Workers whose jobs take the measured times; also adds up the CPU time of the search in between."""

    def __init__(self, jobs: list[Job], workers: int) -> None:
        self.jobs, self.now, self.proposing = jobs, 0.0, 0.0
        self.spans: list[tuple[float, float]] = []
        self.free = [0.0] * workers
        self._uncollected: deque[tuple[float, Tried]] = deque()
        self._since = time.process_time()

    def submit(self, proposal: Proposal, *, again: bool) -> None:
        """Give a proposal to the first free worker; stop when candidates are repeated."""
        if again:
            raise StopIteration
        self._pass_time()
        key, starts = proposal.candidate.key, proposal.starts
        job = Random(f"{key} {starts}").choice(self.jobs)
        self.now = max(self.now, self.free[0])  # the proposal waits for a free worker
        end = self.now + job.seconds
        heapq.heapreplace(self.free, end)
        self.spans.append((self.now, end))
        self._uncollected.append((end, Tried(key, starts, job.status, job.objective, job.violation)))
        self._since = time.process_time()

    def results(self, number: int) -> list[Tried]:
        """Return the next results, after the time at which they are known."""
        self._pass_time()
        finished = [self._uncollected.popleft() for _ in range(number)]
        self.now = max(self.now, *(end for end, _ in finished))
        self._since = time.process_time()
        return [score for _, score in finished]

    def _pass_time(self) -> None:
        elapsed = time.process_time() - self._since
        self.now, self.proposing = self.now + elapsed, self.proposing + elapsed


def simulate(space: Candidates, jobs: list[Job], size: int, trials: int, workers: int) -> Utilization:
    """Return the utilization of workers that take jobs in the order of the proposals."""
    starts = nlp.default_starts(space.task)
    search = OptunaSearch(space, sampler="moves", trials=trials, round_size=size, starts=starts, seed=0)
    solver = SimulatedWorkers(jobs, workers)
    with suppress(StopIteration):
        while (proposal := search.ask()) is not None:
            if isinstance(proposal, Proposal):
                solver.submit(proposal, again=search.stage is not None and search.stage.is_repeat)
            else:
                search.tell(*solver.results(1))
    spans = solver.spans
    last, end = max(start for start, _ in spans), max(solver.free)
    shares = (sum(min(b, until) - a for a, b in spans) / (workers * until) for until in (last, end))
    return Utilization(*shares, solver.proposing, sum(b - a for a, b in spans), len(spans))


if __name__ == "__main__":
    main()

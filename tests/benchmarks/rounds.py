"""How busy many workers are with what `moves` proposes, by how many proposals may be unsolved: a simulation.

    OMP_NUM_THREADS=1 python tests/benchmarks/rounds.py ten-wrenches --modules 12 [--jobs N] [--workers N]

What a job takes is measured: some uniformly drawn trees are solved from as many starts as `moves` gives a new
tree. What is proposed is asked of `moves` as a run asks it, as soon as a worker is free and the results that it
learns from are known, and the CPU time of each proposal is measured too. Each candidate takes what one of the
measured jobs took, drawn by its key, and leads to what that led to, so that no more is solved. What is solved from
more starts in the end, as in an exhaustive search, is left out. Busy is the share of the time that all workers
together have a job: until the last proposal is made, and until the last job has ended.
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
from topo_search.engine import Candidates, Proposal, Tried, scaled_violation
from topo_search.engine.proposals import OptunaSearch
from topo_search.engine.proposals.moves import BREEDING
from topo_search.model import Design, ResolvedTask
from topo_search.model.files import read_task


class Job(NamedTuple):
    """What a solve took and led to."""

    seconds: float
    status: str
    objective: float | None
    violation: float | None


class Busy(NamedTuple):
    """What a simulation came to."""

    proposed: float
    """Share of the workers' time in which they have a job, until the last proposal is made."""
    ended: float
    """The same until the last job has ended."""
    proposing: float
    """CPU time of the proposals [s]."""
    solving: float
    """CPU time of the jobs [s]."""
    number: int
    """Of the proposals."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="ten-wrenches")
    parser.add_argument("--modules", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=12, help="that are measured")
    parser.add_argument("--workers", type=int, default=64)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--rounds", type=int, nargs="+", default=[64, 128, 256, 384])
    arguments = parser.parse_args()
    task = read_task(arguments.example, (f"modules={arguments.modules}",)).resolve(arguments.modules)
    space = Candidates(task, "task")
    print(f"{task.name}, n = {task.n}, {arguments.trials} trees, {arguments.workers} workers")
    busy = "busy till the last proposal | till the end"
    print(f"| unsolved at a time | starts; CPU s, at most | {busy} | a proposal, CPU ms | of the jobs' CPU |")
    print("|---|---|---|---|---|---|")
    kept: dict[int, list[Job]] = {}
    for size in arguments.rounds:
        few = BREEDING.many_starts if size >= BREEDING.many_open else 1
        if few not in kept:
            kept[few] = measured(space, task, arguments.jobs, few)
        jobs, seconds = kept[few], [job.seconds for job in kept[few]]
        came = simulated(space, jobs, size, arguments.trials, arguments.workers)
        each, share = 1e3 * came.proposing / came.number, came.proposing / came.solving
        cells = f"{size} | {few}; {sum(seconds) / len(seconds):.2f}, {max(seconds):.2f}"
        print(f"| {cells} | {came.proposed:.0%} | {came.ended:.0%} | {each:.1f} | {share:.1%} |", flush=True)


def measured(space: Candidates, task: ResolvedTask, number: int, starts: int) -> list[Job]:
    """Return what solves of trees take and lead to; the first, which loads code, does not count."""
    jobs = []
    for tree in space.sample(number + 1, 0):
        began = time.process_time()
        outcome = nlp.solve(task, tree, starts=range(starts), seed=0)
        seconds = time.process_time() - began
        if isinstance(outcome, Design):
            jobs.append(Job(seconds, "feasible", outcome.objective, None))
        else:
            missed = scaled_violation(outcome.violation, outcome.unit, task)
            jobs.append(Job(seconds, outcome.status, None, missed))
    return jobs[1:]


class SimulatedWorkers:
    """Takes as long as measured jobs do, and keeps the time that the search itself takes in between."""

    def __init__(self, jobs: list[Job], workers: int) -> None:
        self.jobs, self.now, self.proposing = jobs, 0.0, 0.0
        self.spans: list[tuple[float, float]] = []
        self.free = [0.0] * workers
        self._uncollected: deque[tuple[float, Tried]] = deque()
        self._since = time.process_time()

    def submit(self, proposal: Proposal, *, again: bool) -> None:
        """Give a proposal to the worker that is free first; stop where candidates come again."""
        if again:
            raise StopIteration
        self._pass_time()
        key, starts = proposal.candidate.key, proposal.starts
        job = Random(f"{key} {starts}").choice(self.jobs)
        self.now = max(self.now, self.free[0])  # what no worker is free for is not asked for yet
        end = self.now + job.seconds
        heapq.heapreplace(self.free, end)
        self.spans.append((self.now, end))
        self._uncollected.append((end, Tried(key, starts, job.status, job.objective, job.violation)))
        self._since = time.process_time()

    def results(self, number: int) -> list[Tried]:
        """Wait for results."""
        self._pass_time()
        ended = [self._uncollected.popleft() for _ in range(number)]
        self.now = max(self.now, *(end for end, _ in ended))
        self._since = time.process_time()
        return [score for _, score in ended]

    def _pass_time(self) -> None:
        spent = time.process_time() - self._since
        self.now, self.proposing = self.now + spent, self.proposing + spent


def simulated(space: Candidates, jobs: list[Job], size: int, trials: int, workers: int) -> Busy:
    """Return how busy workers are that take jobs in the order in which they are proposed."""
    starts = nlp.default_starts(space.task)
    search = OptunaSearch(space, sampler="moves", trials=trials, round_size=size, starts=starts, seed=0)
    solver = SimulatedWorkers(jobs, workers)
    with suppress(StopIteration):
        for proposal in search.propose(lambda _: solver.results(1)[0]):
            if proposal is not None:
                solver.submit(proposal, again=search.stage is not None and search.stage.is_repeat)
    spans = solver.spans
    last, end = max(began for began, _ in spans), max(solver.free)
    shares = (sum(min(b, until) - a for a, b in spans) / (workers * until) for until in (last, end))
    return Busy(*shares, solver.proposing, sum(b - a for a, b in spans), len(spans))


if __name__ == "__main__":
    main()

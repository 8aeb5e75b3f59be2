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
from random import Random
from typing import NamedTuple

import nlp
from topo_search.engine import Proposal, Results, Scored, Space, scaled_violation
from topo_search.engine.proposals import optuna_study
from topo_search.engine.proposals.moves import AT_ONCE, MANY
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
    space = Space(task, "task")
    print(f"{task.name}, n = {task.n}, {arguments.trials} trees, {arguments.workers} workers")
    busy = "busy till the last proposal | till the end"
    print(f"| unsolved at a time | starts; CPU s, at most | {busy} | a proposal, CPU ms | of the jobs' CPU |")
    print("|---|---|---|---|---|---|")
    kept: dict[int, list[Job]] = {}
    for size in arguments.rounds:
        few = AT_ONCE if size >= MANY else 1
        if few not in kept:
            kept[few] = measured(space, task, arguments.jobs, few)
        jobs, seconds = kept[few], [job.seconds for job in kept[few]]
        came = simulated(space, jobs, size, arguments.trials, arguments.workers)
        each, share = 1e3 * came.proposing / came.number, came.proposing / came.solving
        cells = f"{size} | {few}; {sum(seconds) / len(seconds):.2f}, {max(seconds):.2f}"
        print(f"| {cells} | {came.proposed:.0%} | {came.ended:.0%} | {each:.1f} | {share:.1%} |", flush=True)


def measured(space: Space, task: ResolvedTask, number: int, starts: int) -> list[Job]:
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


def simulated(space: Space, jobs: list[Job], size: int, trials: int, workers: int) -> Busy:
    """Return how busy workers are that take jobs in the order in which they are proposed."""
    strategy = optuna_study(
        space, sampler="moves", trials=trials, round_size=size, starts=nlp.default_starts(space.task), seed=0
    )
    now = proposing = 0.0
    spans: list[tuple[float, float]] = []
    free = [0.0] * workers
    waiting: deque[tuple[float, Scored]] = deque()
    results: list[Scored] | None = None
    while True:
        began = time.process_time()
        step = next(strategy) if results is None else strategy.send(results)
        spent = time.process_time() - began
        now, proposing, results = now + spent, proposing + spent, None
        if isinstance(step, Results):
            told = [waiting.popleft() for _ in range(step.number)]
            now, results = max(now, *(end for end, _ in told)), [score for _, score in told]
        elif isinstance(step, Proposal):
            key, starts = step.candidate.key, step.starts
            job = Random(f"{key} {starts}").choice(jobs)
            now = max(now, free[0])  # what no worker is free for is not asked for yet
            heapq.heapreplace(free, now + job.seconds)
            spans.append((now, now + job.seconds))
            waiting.append((now + job.seconds, Scored(key, starts, job.status, job.objective, job.violation)))
        elif step.again:
            break
    last, end = max(began for began, _ in spans), max(free)
    shares = (sum(min(b, until) - a for a, b in spans) / (workers * until) for until in (last, end))
    return Busy(*shares, proposing, sum(b - a for a, b in spans), len(spans))


if __name__ == "__main__":
    main()

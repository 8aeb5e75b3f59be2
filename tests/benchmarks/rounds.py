"""How busy many workers are with what `moves` proposes, by the size of a round: a simulation.

    OMP_NUM_THREADS=1 python tests/benchmarks/rounds.py ten-wrenches --modules 12 [--jobs N] [--workers N]

What a job takes is measured: some uniformly drawn trees are solved from one start each. What is proposed is asked
of `moves` as a run asks it, one candidate after the other while workers solve those before, and the CPU time of
each proposal is measured too. Each candidate takes what one of the measured jobs took, drawn by its key, and leads
to what that led to, so that no more is solved. A round begins when all of the one before have ended. What is solved
from more starts in the end, as in an exhaustive search, is left out.
"""

from __future__ import annotations

import argparse
import heapq
import time
from random import Random
from typing import NamedTuple

import nlp
from topo_search.engine import Proposal, Scored, Space, Stage, scaled_violation
from topo_search.engine.proposals import optuna_study
from topo_search.model import Design, ResolvedTask
from topo_search.model.files import read_task

SIZES = (64, 192)
"""Beyond the trials after which `moves` gives a population up, rounds are mostly uniform draws."""
STARTS = 4
"""Most starts of a tree."""


class Job(NamedTuple):
    """What a solve took and led to."""

    seconds: float
    status: str
    objective: float | None
    violation: float | None


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("example", nargs="?", default="ten-wrenches")
    parser.add_argument("--modules", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=12, help="that are measured")
    parser.add_argument("--workers", type=int, default=64)
    parser.add_argument("--trials", type=int, default=384)
    arguments = parser.parse_args()
    task = read_task(arguments.example, (f"modules={arguments.modules}",)).resolve(arguments.modules)
    space = Space(task, "task")
    jobs = measured(space, task, arguments.jobs)
    mean = sum(job.seconds for job in jobs) / len(jobs)
    print(f"{task.name}, n = {task.n}, {arguments.trials} trees; a job takes {1e3 * mean:.0f} ms", end=", ")
    print(f"at most {1e3 * max(job.seconds for job in jobs):.0f}; {arguments.workers} workers")
    print("| proposals a round | busy | a proposal, CPU ms | of the jobs' CPU |")
    print("|---|---|---|---|")
    for size in SIZES:
        busy, proposing, solving, number = simulated(space, jobs, size, arguments.trials, arguments.workers)
        print(f"| {size} | {busy:.0%} | {1e3 * proposing / number:.1f} | {proposing / solving:.1%} |", flush=True)


def measured(space: Space, task: ResolvedTask, number: int) -> list[Job]:
    """Return what solves of trees from one start take and lead to; the first, which loads code, does not count."""
    jobs = []
    for tree in space.sample(number + 1, 0):
        began = time.process_time()
        outcome = nlp.solve(task, tree, starts=range(1), seed=0)
        seconds = time.process_time() - began
        if isinstance(outcome, Design):
            jobs.append(Job(seconds, "feasible", outcome.objective, None))
        else:
            missed = scaled_violation(outcome.violation, outcome.unit, task)
            jobs.append(Job(seconds, outcome.status, None, missed))
    return jobs[1:]


def simulated(
    space: Space, jobs: list[Job], size: int, trials: int, workers: int
) -> tuple[float, float, float, int]:
    """Return the share of the time that workers have a job, CPU seconds of proposals and jobs, and their number."""
    strategy = optuna_study(space, sampler="moves", trials=trials, round_size=size, starts=STARTS, seed=0)
    now = proposing = solving = 0.0
    number = 0
    began = time.process_time()
    proposed = next(strategy)
    while not isinstance(proposed, Stage):
        free = [now] * workers
        drawn: list[tuple[Proposal, Job]] = []
        for proposal in proposed:
            spent = time.process_time() - began
            now, proposing, number = now + spent, proposing + spent, number + 1
            job = Random(f"{proposal.candidate.key} {proposal.starts}").choice(jobs)
            heapq.heappush(free, max(now, heapq.heappop(free)) + job.seconds)
            solving += job.seconds
            drawn.append((proposal, job))
            began = time.process_time()
        now = max(now, *free)
        scores = [
            Scored(proposal.candidate.key, proposal.starts, job.status, job.objective, job.violation)
            for proposal, job in drawn
        ]
        began = time.process_time()
        proposed = strategy.send(scores)
    return solving / (workers * now), proposing, solving, number


if __name__ == "__main__":
    main()

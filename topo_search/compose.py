"""Where solver, audit and search meet: the Python interface, and what the command line calls.

Call these from under `if __name__ == "__main__":` in a script, for they start worker processes.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import nlp
import verify
from topo_search.engine import (
    Failed,
    Job,
    Outcome,
    Verbs,
    Workers,
    audit_deadline,
    merge,
    scaled_violation,
    solved,
)
from topo_search.model import Audit, BadInput, Design, Fault, Infeasible, ResolvedTask, Task, Topology
from topo_search.model.files import read_task
from topo_search.study import LARGER_MARGINS, Answer, Observer, Request, Silent, larger_margin, run
from topo_search.topologies import Symmetry

VERBS = Verbs(
    solve=nlp.solve, audit=verify.audit, lower_bound=nlp.lower_bound, prove_impossible=nlp.prove_impossible
)

RUNS = Path("runs")
"""Where runs go unless another folder is named."""
PATIENCE = 3
"""Rounds of starts in a row without a gain after which more starts do not pay."""
GAIN = 1.0e-4
"""Relative decrease of the objective (or of the violation) that counts as one."""
LARGEST_TIMED_ROUND = 4
"""Starts a round under a time limit: the running round is lost when it ends."""


@dataclass(frozen=True)
class Solved:
    """What became of one topology."""

    outcome: Outcome
    audit: Audit | Failed | None
    """None if there is no design."""
    notes: tuple[str, ...]
    """What did not go straight."""

    @property
    def exit_status(self) -> int:
        """0: audited design; 1: a design that did not pass its audit; 3: no design."""
        if not isinstance(self.outcome, Design):
            return 3
        return 0 if isinstance(self.audit, Audit) and self.audit.verdict == "clear" else 1


def search(
    task: Task | str | Path,
    *,
    out: str | Path | None = None,
    symmetry: Symmetry = "task",
    starts: int | None = None,
    seed: int = 0,
    workers: int | None = None,
    time_limit: float = math.inf,
    observer: Observer | None = None,
) -> Answer:
    """Search every topology for the best design of a task, audit the best, and keep all of it in a folder.

    Args:
        task: a task, its file, or the name of a shipped example.
        out: the run's folder; default: `runs/NAME-HASH`.
        symmetry: which trees count as one candidate.
        starts: starts of each candidate; default: the solver's.
        seed: draws the starts.
        workers: worker processes; default: the cores available. They change nothing but the time it takes.
        time_limit: seconds after which no more is solved.
        observer: is told of the progress.

    Raises:
        BadInput: the task or the folder cannot be used.
    """
    request = Request(_task(task), symmetry, nlp.DEFAULT_STARTS if starts is None else starts, seed)
    path = RUNS / request.folder_name if out is None else Path(out)
    return run(
        request,
        path,
        VERBS,
        workers=workers or available_cores(),
        time_limit=time_limit,
        observer=observer or Silent(),
    )


def solve(
    task: Task | str | Path,
    topology: Topology,
    *,
    starts: int | None = None,
    seed: int = 0,
    time_limit: float | None = None,
    progress: Callable[[Outcome], None] = lambda _: None,
) -> Solved:
    """Find the best design of one topology and audit it, both in a child process.

    Without `starts` and `time_limit` it ends when three rounds of starts in a row did not pay.

    Args:
        task: a task, its file, or the name of a shipped example, of any number of modules.
        topology: the tree.
        starts: number of starts.
        seed: draws them.
        time_limit: seconds after which no more is solved.
        progress: is told the best outcome after each round.

    Raises:
        BadInput: the task cannot be used, or its connectors do not allow the topology.
    """
    resolved = _task(task).resolve(topology.n)
    if resolved.search.connectors == "aligned" and not topology.aligned:
        rule = f'{topology.key} needs search.connectors = "any", but the task has "aligned"'
        raise BadInput(resolved.name, [Fault("topology", rule)])
    until = math.inf if time_limit is None else time.monotonic() + time_limit
    proof = VERBS.prove_impossible(resolved)
    if proof is not None:
        return Solved(proof, None, ())
    notes: list[str] = []
    kept: tuple[Design, Audit | Failed] | None = None
    with Workers(1) as worker:
        for _ in range(LARGER_MARGINS + 1):
            rounds = _rounds(starts, timed=time_limit is not None)
            outcome = _best_of(resolved, topology, rounds, seed, worker, until, progress)
            if not isinstance(outcome, Design):
                break
            audit = worker.one(VERBS.audit, outcome, deadline=audit_deadline(topology.n))
            kept = outcome, audit
            if isinstance(audit, Failed):
                notes.append(f"the audit failed: {audit.reason}")
                break
            if audit.verdict == "clear" or time.monotonic() >= until:
                break
            notes.append(f"the audit of the design with margin {resolved.search.margin:g} m is {audit.verdict}")
            margin = larger_margin(resolved.search.margin)
            resolved = resolved.model_copy(update={"search": resolved.search.model_copy(update={"margin": margin})})
    best, verdict = kept or (outcome, None)
    return Solved(best, verdict, tuple(notes))


def audit(design: Design) -> Audit:
    """Return the exact audit of a design, made in this process."""
    return VERBS.audit(design)


def audits(designs: list[Design]) -> Iterator[Audit | Failed]:
    """Yield the audit of each design in turn, made in a child process."""
    with Workers(1) as worker:
        for design in designs:
            yield worker.one(VERBS.audit, design, deadline=audit_deadline(design.topology.n))


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _task(task: Task | str | Path) -> Task:
    return task if isinstance(task, Task) else read_task(task)


def _rounds(starts: int | None, *, timed: bool) -> Iterator[range]:
    """Yield the ranges of starts that are solved one after the other."""
    first = 0
    while starts is None or first < starts:
        size = min(max(1, first), LARGEST_TIMED_ROUND) if timed else starts or nlp.DEFAULT_STARTS
        stop = first + size if starts is None else min(first + size, starts)
        yield range(first, stop)
        first = stop


def _best_of(
    task: ResolvedTask,
    topology: Topology,
    rounds: Iterator[range],
    seed: int,
    worker: Workers,
    until: float,
    progress: Callable[[Outcome], None],
) -> Outcome:
    """Return the best outcome over rounds of starts, until they end, the time does, or they no longer pay."""
    best: Outcome = Failed("timeout", "the time limit came before the first start ended")
    idle = 0
    for starts in rounds:
        job = Job(task, topology, 1, starts, seed)
        outcome = next(
            (end for _, end in solved(iter([job]), solve=VERBS.solve, workers=worker, until=until)), None
        )
        if outcome is None:  # the time limit
            return best
        if isinstance(outcome, Failed):
            return outcome if isinstance(best, Failed) else best
        before, best = best, outcome if isinstance(best, Failed) else merge(best, outcome, task)
        progress(best)
        idle = 0 if _pays(before, best, task) else idle + 1
        if idle == PATIENCE and until == math.inf:
            return best
    return best


def _pays(before: Outcome, after: Design | Infeasible, task: ResolvedTask) -> bool:
    """Whether a round of starts brought a gain."""
    if isinstance(before, Design) and isinstance(after, Design):
        return before.objective - after.objective > GAIN * before.objective
    if isinstance(before, Infeasible) and isinstance(after, Infeasible):
        least, now = (scaled_violation(result.violation, result.unit, task) for result in (before, after))
        return least - now > GAIN * least
    return True

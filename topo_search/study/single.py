"""One topology: rounds of starts until they no longer pay, an audit, and larger margins if it is not clear."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from topo_search.engine import (
    Failed,
    Job,
    Outcome,
    Verbs,
    Workers,
    audit_deadline,
    merge,
    rounds,
    scaled_violation,
    solved,
)
from topo_search.model import Audit, Design, Infeasible, ResolvedTask, Topology
from topo_search.model.html import paragraph
from topo_search.study.identity import LARGER_MARGINS, larger_margin

PATIENCE = 3
"""Rounds of starts in a row without a gain after which more starts do not pay."""
GAIN = 1.0e-4
"""Relative decrease of the objective (or of the violation) that counts as one."""


@dataclass(frozen=True)
class Solved:
    """What became of one topology."""

    outcome: Outcome
    audit: Audit | Failed | None
    """None if there is no design."""
    notes: tuple[str, ...]
    """What did not go straight."""

    @property
    def design(self) -> Design | None:
        """The design, if there is one."""
        return self.outcome if isinstance(self.outcome, Design) else None

    def _repr_html_(self) -> str:
        """Show a notebook the design and its audit, or why there is none."""
        parts = [
            value._repr_html_() if isinstance(value, Design | Audit) else paragraph(_words(value))
            for value in (self.outcome, self.audit)
            if value is not None
        ]
        return "".join([*(paragraph(note) for note in self.notes), *parts])

    @property
    def exit_status(self) -> int:
        """0: audited design; 1: a design that did not pass its audit; 3: no design."""
        if not isinstance(self.outcome, Design):
            return 3
        return 0 if isinstance(self.audit, Audit) and self.audit.verdict == "clear" else 1


def _words(outcome: Infeasible | Failed) -> str:
    """Return why there is no result."""
    return outcome.message if isinstance(outcome, Infeasible) else f"failed: {outcome.reason}"


def solve_single(
    task: ResolvedTask,
    topology: Topology,
    verbs: Verbs,
    *,
    starts: int | None,
    round_size: int,
    seed: int,
    time_limit: float | None,
    progress: Callable[[Outcome], None],
) -> Solved:
    """Find the best design of one topology and audit it, both in a child process.

    Args:
        task: the task, resolved for the topology's size.
        topology: the tree.
        verbs: solver, audit and bounds.
        starts: number of starts; None: until PATIENCE rounds in a row did not pay, or the time is over.
        round_size: starts of a round without a time limit.
        seed: draws the starts.
        time_limit: seconds after which no more is solved.
        progress: is told the best outcome after each round.
    """
    until = math.inf if time_limit is None else time.monotonic() + time_limit
    proof = verbs.prove_impossible(task)
    if proof is not None:
        return Solved(proof, None, ())
    notes: list[str] = []
    kept: tuple[Design, Audit | Failed] | None = None
    with Workers(1) as worker:
        for _ in range(LARGER_MARGINS + 1):
            ranges = rounds(starts, starts or round_size, timed=time_limit is not None)
            outcome = _best_of(task, topology, ranges, seed, verbs, worker, until, progress)
            if not isinstance(outcome, Design):
                break
            audit = worker.one(verbs.audit, outcome, deadline=audit_deadline(topology.n))
            kept = outcome, audit
            if isinstance(audit, Failed):
                notes.append(f"the audit failed: {audit.reason}")
                break
            if audit.verdict == "clear" or time.monotonic() >= until:
                break
            notes.append(f"the audit of the design with margin {task.search.margin:g} m is {audit.verdict}")
            margin = larger_margin(task.search.margin)
            task = task.model_copy(update={"search": task.search.model_copy(update={"margin": margin})})
    best, verdict = kept or (outcome, None)
    return Solved(best, verdict, tuple(notes))


def _best_of(
    task: ResolvedTask,
    topology: Topology,
    ranges: Iterator[range],
    seed: int,
    verbs: Verbs,
    worker: Workers,
    until: float,
    progress: Callable[[Outcome], None],
) -> Outcome:
    """Return the best outcome over rounds of starts, until they end, the time does, or they no longer pay."""
    best: Outcome = Failed("timeout", "time limit reached before the first start ended")
    idle = 0
    for starts in ranges:
        job = Job(task, topology, 1, starts, seed)
        outcome = next((end for _, end in solved(iter([job]), solve=verbs.solve, engine=worker, until=until)), None)
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

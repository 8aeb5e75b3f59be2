"""Solving one topology: rounds of starts while they pay, then an audit, and larger margins if it is not clear."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from topo_search.engine import Backends, Engine, Failed, Job, Outcome
from topo_search.engine.workers import audit_deadline, merge, scaled_violation, start_ranges
from topo_search.model import Audit, Design, Infeasible, ResolvedTask, Task, Topology
from topo_search.model.html import paragraph
from topo_search.study.progress import SilentObserver
from topo_search.study.relaxing import relax
from topo_search.study.request import Margins
from topo_search.study.solving import Tools


@dataclass(frozen=True)
class Solved:
    """The result of solving one topology."""

    outcome: Outcome
    audit: Audit | Failed | None
    """None if there is no design."""
    notes: tuple[str, ...]
    """Remarks, such as audits that were not clear."""

    def __str__(self) -> str:
        """Return the design with its audit, or why there is none, in one line."""
        if not isinstance(self.outcome, Design):
            return _words(self.outcome)
        verdict = self.audit.verdict if isinstance(self.audit, Audit) else "failed"
        return f"{self.outcome.topology.key}, J = {self.outcome.objective:.6g} rad^4/s^4, audit {verdict}"

    __repr__ = __str__

    @property
    def found(self) -> bool:
        """True if there is a design with a clear audit."""
        return isinstance(self.audit, Audit) and self.audit.verdict == "clear"

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
        relaxed = self.outcome.relaxed if isinstance(self.outcome, Infeasible) else None
        remarks = (*self.notes, *(relaxed.sentences if relaxed else ()))
        return "".join([*(paragraph(note) for note in remarks), *parts])

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 0 for a clear design, 1 if its audit is not clear, 3 without a design."""
        if not isinstance(self.outcome, Design):
            return 3
        return 0 if self.found else 1


def _words(outcome: Infeasible | Failed) -> str:
    return outcome.message if isinstance(outcome, Infeasible) else f"failed: {outcome.reason}"


def solve_single(
    base_task: Task,
    topology: Topology,
    backends: Backends,
    *,
    starts: int | None,
    round_size: int,
    seed: int,
    time_limit: float | None,
    engine: Engine,
    progress: Callable[[Outcome], None],
    near: Sequence[Design] = (),
) -> Solved:
    """Find the best design of one topology and audit it.

    Args:
        base_task: the task, as the user wrote it.
        topology: the tree.
        backends: solver, audit and bounds.
        starts: number of starts; None: stop after three rounds without a gain, or at the time limit.
        round_size: number of starts in a round, if there is no time limit.
        seed: seeds the random starts.
        time_limit: seconds after which solving stops.
        engine: runs the jobs; affects only the time.
        progress: receives the best outcome after each round.
        near: designs that warm-start the first round, in addition to its starts.
    """
    until = math.inf if time_limit is None else time.monotonic() + time_limit
    tools = Tools(backends, engine, SilentObserver(), until)
    task = base_task.resolve(topology.n)
    ladder = Margins.of(task)
    notes: list[str] = []

    def explain(outcome: Infeasible) -> Infeasible:
        relaxed = relax(base_task, [topology], tools, starts=round_size if starts is None else starts, seed=seed)
        return outcome.model_copy(update={"relaxed": relaxed})

    def best_of(task: ResolvedTask) -> Outcome:
        """Return the best outcome over rounds of starts, until the starts, the time or the gains end."""
        best: Outcome = Failed("timeout", "time limit reached before the first start finished")
        idle_rounds = 0
        for part in start_ranges(starts, starts or round_size, timed=time_limit is not None):
            job = Job(task, topology, part, seed, () if part.start else tuple(near))
            outcome = next((outcome for _, outcome in tools.solve([job])), None)
            if outcome is None:  # time limit reached
                return best
            if isinstance(outcome, Failed):
                return outcome if isinstance(best, Failed) else best
            previous, best = best, outcome if isinstance(best, Failed) else merge(best, outcome, task)
            progress(best)
            idle_rounds = 0 if _has_gain(previous, best, task) else idle_rounds + 1
            if idle_rounds == 3 and until == math.inf:
                return best
        return best

    if (proof := backends.prove_impossible(task)) is not None:
        return Solved(explain(proof), None, ())
    solved: Solved | None = None
    while True:
        outcome = best_of(ladder.task)
        if not isinstance(outcome, Design):
            return solved or Solved(explain(outcome) if isinstance(outcome, Infeasible) else outcome, None, ())
        audit = engine.run_one(backends.audit, outcome, deadline=audit_deadline(topology.n))
        if isinstance(audit, Failed):
            return Solved(outcome, audit, (*notes, f"the audit failed: {audit.reason}"))
        if audit.verdict != "clear":
            notes.append(f"the audit of the design with margin {ladder.task.search.margin:g} m is {audit.verdict}")
        solved = Solved(outcome, audit, tuple(notes))
        if audit.verdict == "clear" or not ladder.raise_after(audit) or time.monotonic() >= until:
            return solved


def _has_gain(previous: Outcome, best: Design | Infeasible, task: ResolvedTask) -> bool:
    """True if a round of starts improved the best outcome."""
    gain = 1.0e-4  # smallest relative decrease of the objective, or of the violation, that counts
    if isinstance(previous, Design) and isinstance(best, Design):
        return previous.objective - best.objective > gain * previous.objective
    if isinstance(previous, Infeasible) and isinstance(best, Infeasible):
        before, after = (scaled_violation(result.violation, result.unit, task) for result in (previous, best))
        return before - after > gain * before
    return True

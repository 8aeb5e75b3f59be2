"""The margins that a design is solved with, one after another, until its audit is clear.

The margins that may be asked for follow from the task alone, so that rows of a run can be compared: its own, then
each ten times the one before; where the clearances must survive the tolerances, rungs that are closer, and an audit
says which of them is needed: the first that makes up for the clearance missing under the worst errors, or the last.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from topo_search.model import Audit, ResolvedTask

LARGER_MARGINS = 3
"""Repairs of a design that fails its audit, each with a larger margin."""
RUNG = 1.25
"""A margin over the one before where the clearances must survive the tolerances."""

Judge = Callable[[int, Sequence[str]], Iterable[tuple[str, Audit]] | None]
"""Solves designs with the margin of a step where need be, and returns the audits that are not clear; None: no time
is left."""


def larger_margin(margin: float) -> float:
    """Return the margin to try after one that an audit did not pass [m]."""
    return 10.0 * margin or 1.0e-4


def margins(task: ResolvedTask) -> list[float]:
    """Return the margins that designs of a task may be asked for [m], its own first, each larger than the last."""
    ladder = [task.search.margin]
    if not task.flight.tolerances:
        for _ in range(LARGER_MARGINS):
            ladder.append(larger_margin(ladder[-1]))
        return ladder
    errors, module, n = task.tolerances, task.module, task.n
    delta, shift = math.radians(errors.hinge_angle_deg), 2 * errors.position + 2 * errors.envelope
    # Of a platform stretched out: every hinge moves a far end of airflow by as much.
    farthest = 2 * n * (module.connector_distance + module.arm_length) + module.reach
    least = max(ladder[0], delta * module.arm_length + shift / 4)
    most = 2 * (shift + delta * n * farthest)
    steps = max(LARGER_MARGINS, math.ceil(math.log(most / least, RUNG)))
    return ladder + [least * RUNG**k for k in range(1, steps + 1)]


def with_margin(task: ResolvedTask, margin: float) -> ResolvedTask:
    """Return the same task with another margin [m]."""
    return task.model_copy(update={"search": task.search.model_copy(update={"margin": margin})})


def raise_margins(tasks: Sequence[ResolvedTask], names: Iterable[str], judge: Judge) -> None:
    """Solve designs whose audits are not clear again, with larger margins, `LARGER_MARGINS` times at most.

    What becomes of a design depends on itself alone.

    Args:
        tasks: the task with each of its `margins`, whose places are the steps.
        names: of designs, for `judge`.
        judge: is given a step and the designs that are due there.
    """
    due = dict.fromkeys(names, (0, 0))
    for step in range(len(tasks)):
        now = [name for name, (at, _) in due.items() if at == step]
        failing = judge(step, now) if now else ()
        if failing is None:
            return
        for name, audit in failing:
            raised = due[name][1] + 1
            if raised <= LARGER_MARGINS:
                due[name] = _next_step(tasks, step, audit), raised


def _next_step(tasks: Sequence[ResolvedTask], step: int, audit: Audit) -> int:
    """Return the step after one whose audit is not clear; beyond the last: no margin is large enough."""
    worst = None if audit.sensitivity is None else audit.sensitivity.tolerances
    if not tasks[step].flight.tolerances or worst is None:
        return step + 1
    pair = (worst.kind, worst.a, worst.b, worst.segment)
    kept = (one.analytic_m for one in audit.pairs if (one.kind, one.a, one.b, one.segment) == pair)
    needed = next(kept, tasks[step].search.margin) - worst.lower_m  # what the errors take from that pair
    return next(
        (k for k in range(step + 1, len(tasks)) if tasks[k].search.margin >= needed), max(step + 1, len(tasks) - 1)
    )

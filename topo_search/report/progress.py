"""Progress messages of a run: its plan, its stage, the best design so far and the time left."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from itertools import groupby

from topo_search.model.proven import gap_percent
from topo_search.report.wording import modules, quantity
from topo_search.study.ledger import Row
from topo_search.study.progress import Phase, Plan, TimeLeft

Words = Callable[[Row | None], str]
"""Words for the best design so far."""


def describe(incumbent: Row | None) -> str:
    """Return the best design so far in a few words."""
    if incumbent is None:
        return "no design yet"
    gap = "" if incumbent.gap is None else f", gap {gap_percent(incumbent.gap)}"
    return f"best {incumbent.key} J {incumbent.objective:.6g}{gap}"


def stage(phase: Phase) -> str:
    """Return the name of a stage, with its size."""
    return f"{phase.name} {modules(phase.n)}" if phase.n else phase.name


def announcement(phase: Phase) -> str:
    """Return what a stage is about to do."""
    if phase.name == "auditing":
        return f"{stage(phase)}: {quantity(phase.steps, 'design')}"
    if not phase.starts:
        return stage(phase) if phase.is_serial else f"{stage(phase)}: {quantity(phase.steps, 'part')}"
    return f"{stage(phase)}: {quantity(phase.steps, 'candidate')}, at most {quantity(phase.starts, 'start')} each"


def period(seconds: float) -> str:
    """Return a rough time."""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(seconds, 1.0):.0f} s"


def describe_plan(plan: Plan) -> str:
    """Return what a run is going to do, and about how long it takes."""
    solving = [phase for phase in plan.phases if phase.starts]
    audits = sum(phase.steps for phase in plan.phases if phase.name == "auditing")
    if not solving and not audits:
        return "plan: all candidates are solved and audited; only files are written"
    parts = []
    for n, phases in groupby(sorted(solving, key=lambda phase: phase.n), key=lambda phase: phase.n):
        of_size = list(phases)
        candidates = sum(phase.steps for phase in of_size if phase.starts == of_size[0].starts)
        most = max(phase.starts for phase in of_size)
        parts.append(f"{modules(n)}: {quantity(candidates, 'candidate')}, {quantity(most, 'start')} each")
    if audits:
        parts.append(f"audits of the best {audits}")
    names = list(dict.fromkeys(phase.name for phase in plan.phases))
    on = "" if plan.workers is None else f" on {quantity(plan.workers, 'worker')}"
    most_time = f", of which at most {period(plan.time_limit)} to solve" if math.isfinite(plan.time_limit) else ""
    return f"plan: {'; '.join(parts)}; {', '.join(names)}{on}: about {period(plan.seconds)}{most_time}"


class Lines:
    """Prints progress as plain lines for logs and notebooks.

    Example:
        >>> from topo_search import Lines, read_task, search
        >>> hover = "load_cases=[{com={force=[0.0,0.0,1.0]}}]"
        >>> answer = search(read_task("push", ("modules=2", hover)), out="hover-2", starts=1, observer=Lines())
        plan: all candidates are solved and audited; only files are written
        writing
    """

    def __init__(self, tell: Callable[[str], None] = print, words: Words = describe) -> None:
        """Take where lines go.

        Args:
            tell: is handed each line.
            words: of the best design so far.
        """
        self._tell, self._words = tell, words
        self._left = TimeLeft()
        self._phase: Phase | None = None
        self._done = 0
        self._last = time.monotonic()

    def plan(self, plan: Plan) -> None:
        """Print the plan."""
        self._left.plan(plan, time.monotonic())
        self._tell(describe_plan(plan))

    def phase(self, phase: Phase) -> None:
        """Print the stage that begins."""
        self._phase, self._done = phase, 0
        self._left.begin(phase, time.monotonic())
        self._tell(announcement(phase))

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """Print the progress, unless it was printed recently."""
        self._left.step(time.monotonic(), known=known)
        self._done += 1
        now = time.monotonic()
        if now - self._last < 10.0 or self._phase is None:  # [s]
            return
        self._last = now
        best = self._words(incumbent)
        parts = [f"{self._done} of {self._phase.steps}", *([best] if best else [])]
        self._tell(f"{stage(self._phase)}: {', '.join(parts)}, about {period(self._left(now))} left")

    def note(self, text: str) -> None:
        """Print a line."""
        self._tell(text)

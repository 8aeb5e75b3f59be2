"""Progress messages of a run: its plan, its stage, the best design so far and the remaining time."""

import math
import time
from collections.abc import Callable
from itertools import groupby

from topo_search.model.proven import gap_percent
from topo_search.report.wording import modules, quantity
from topo_search.study import Observer, Phase, Plan, Row, TimeLeft

Words = Callable[[Row | None], str]
"""Function that describes the best design so far in a few words."""


def describe(incumbent: Row | None) -> str:
    """Describe the best design so far in a few words."""
    if incumbent is None:
        return "no design yet"
    gap = "" if incumbent.gap is None else f", gap {gap_percent(incumbent.gap)}"
    number = f"J {incumbent.objective:.6g}" if incumbent.value is None else f"value {incumbent.value:.6g}"
    return f"best {incumbent.key} {number}{gap}"


def stage(phase: Phase) -> str:
    """Return the name of a stage with its number of modules."""
    return f"{phase.name} {modules(phase.n)}" if phase.n else phase.name


def announcement(phase: Phase) -> str:
    """Return the message at the beginning of a stage."""
    if phase.name == "auditing":
        return f"{stage(phase)}: {quantity(phase.steps, 'design')}"
    if not phase.starts:
        return stage(phase) if phase.is_serial else f"{stage(phase)}: {quantity(phase.steps, 'part')}"
    return f"{stage(phase)}: {quantity(phase.steps, 'candidate')}, at most {quantity(phase.starts, 'start')} each"


def period(seconds: float) -> str:
    """Return a rough duration in words."""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(seconds, 1.0):.0f} s"


def describe_plan(plan: Plan) -> str:
    """Return the plan of a run in one line, with an estimate of its duration."""
    solving = [phase for phase in plan.phases if phase.starts]
    audits = sum(phase.steps for phase in plan.phases if phase.name == "auditing")
    if not solving and not audits:
        return "plan: all candidates are solved and audited; only files are written"
    parts = []
    for n, phases in groupby(sorted(solving, key=lambda phase: phase.n), key=lambda phase: phase.n):
        phases_of_size = list(phases)
        candidates = sum(phase.steps for phase in phases_of_size if phase.starts == phases_of_size[0].starts)
        starts = max(phase.starts for phase in phases_of_size)
        parts.append(f"{modules(n)}: {quantity(candidates, 'candidate')}, {quantity(starts, 'start')} each")
    if audits:
        parts.append(f"audits of the best {audits}")
    names = list(dict.fromkeys(phase.name for phase in plan.phases))
    workers = "" if plan.workers is None else f" on {quantity(plan.workers, 'worker')}"
    time_limit = f", of which at most {period(plan.time_limit)} to solve" if math.isfinite(plan.time_limit) else ""
    return f"plan: {'; '.join(parts)}; {', '.join(names)}{workers}: about {period(plan.seconds)}{time_limit}"


class Follower(Observer):
    """Counts the steps of a run, and estimates the time that is left."""

    def __init__(self) -> None:
        self._time_left = TimeLeft()
        self._phase: Phase | None = None
        self._steps_done = 0
        self._incumbent: Row | None = None

    def plan(self, plan: Plan) -> None:
        """Begin a run."""
        self._time_left.plan(plan, time.monotonic())

    def phase(self, phase: Phase) -> None:
        """Begin a stage."""
        self._phase, self._steps_done = phase, 0
        self._time_left.begin(phase, time.monotonic())

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """Count a step."""
        self._incumbent, self._steps_done = incumbent, self._steps_done + 1
        self._time_left.step(time.monotonic(), known=known)

    @property
    def time_left(self) -> str:
        """The time that is left in words."""
        return f"about {period(self._time_left(time.monotonic()))} left"


class Lines(Follower):
    """Prints progress as plain lines for logs and notebooks.

    Example:
        >>> from topo_search import Lines, read_task, search
        >>> hover = "load_cases=[{com={force=[0.0,0.0,1.0]}}]"
        >>> answer = search(read_task("push", ("modules=2", hover)), out="hover-2", starts=1, observer=Lines())
        plan: all candidates are solved and audited; only files are written
        writing
    """

    def __init__(
        self, tell: Callable[[str], None] = print, words: Words = describe, *, every: float = 10.0
    ) -> None:
        """Create an observer that prints lines.

        Args:
            tell: Called with each line.
            words: Describes the best design so far.
            every: Time between the lines of a stage [s].
        """
        super().__init__()
        self._tell, self._words, self._every = tell, words, every
        self._last_print_s = time.monotonic()

    def plan(self, plan: Plan) -> None:
        """Print the plan."""
        super().plan(plan)
        self._tell(describe_plan(plan))

    def phase(self, phase: Phase) -> None:
        """Print the message at the beginning of a stage."""
        super().phase(phase)
        self._tell(announcement(phase))

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """Print the progress, unless a line was printed a short time ago."""
        super().settled(incumbent, known=known)
        now = time.monotonic()
        if now - self._last_print_s < self._every or self._phase is None:
            return
        self._last_print_s = now
        best = self._words(incumbent)
        parts = [f"{self._steps_done} of {self._phase.steps}", *([best] if best else [])]
        self._tell(f"{stage(self._phase)}: {', '.join(parts)}, {self.time_left}")

    def note(self, text: str) -> None:
        """Print a note."""
        self._tell(text)

"""The phases of a run, its plan, and how long they are expected to take."""

import math
from dataclasses import dataclass
from typing import Literal, Protocol

from topo_search.model import ResolvedTask
from topo_search.study.ledger import Row

PhaseName = Literal["proving", "searching", "polishing", "auditing", "relaxing", "writing"]

AUDIT_BATCH = 10
"""Number of designs in a batch of audits."""


@dataclass(frozen=True)
class Expected:
    """Expected times, and how far they are trusted."""

    startup_s: float = 2.5
    """Time until the first worker has loaded its libraries [s]."""
    reduced_modules: int = 20
    """Largest platform solved by the reduced search, where a start is cheap and Ipopt polishes only the best."""
    value_s: float = 0.007
    """Processor time of a start that seeks the largest value, over the cube of the number of modules [s]."""
    chunk_s: float = 0.4
    """Processor time of a chunk of a proof by branch and bound, for three and five modules [s]."""
    trusted_steps: float = 2.0
    """Number of steps for which they are trusted (`topo_search.study.time_left`)."""


EXPECTED = Expected()


@dataclass(frozen=True)
class Phase:
    """A part of a run whose steps take about the same time."""

    name: PhaseName
    n: int
    """Number of modules."""
    steps: int
    """Number of candidates, designs or chunks."""
    starts: int = 0
    """Starts of each candidate after the phase; 0 if nothing is solved."""
    seconds: float = 0.0
    """Expected processor time of a step [s]."""
    is_serial: bool = False
    """True if the steps run one after the other in one process."""

    @property
    def plan_key(self) -> tuple[PhaseName, int, int]:
        """Key that a phase shares with its planned one."""
        return self.name, self.n, self.starts


@dataclass(frozen=True)
class Plan:
    """The plan of a run."""

    phases: tuple[Phase, ...]
    workers: int | None
    """Number of steps that run at a time; None if unknown."""
    time_limit: float = math.inf
    """Time limit of solving [s]; audits follow it."""

    @property
    def solves(self) -> bool:
        """True if any candidate is solved."""
        return any(phase.starts for phase in self.phases)

    @property
    def seconds(self) -> float:
        """Expected duration [s]."""
        startup = EXPECTED.startup_s if any(not phase.is_serial for phase in self.phases) else 0.0
        solving, remainder = (
            sum(duration(phase, self.workers or 1) for phase in self.phases if bool(phase.starts) is solves)
            for solves in (True, False)
        )
        return min(self.time_limit, startup + solving) + remainder


def duration(phase: Phase, workers: int) -> float:
    """Return the expected duration of a phase [s]."""
    return phase.seconds * phase.steps / (1 if phase.is_serial else max(1, min(workers, phase.steps)))


def solving_seconds(task: ResolvedTask, starts: int) -> float:
    """Return the expected processor time of one candidate [s]."""
    if task.search.maximize is not None:
        return EXPECTED.value_s * starts * float(task.n**3)
    cases = (1 + len(task.load_cases)) / 4
    if task.n <= EXPECTED.reduced_modules:
        candidate, start = 0.08, 0.012  # for up to twelve modules and three load cases
        return cases * max(1.0, task.n / 12) * (candidate + starts * start)
    growth: float = (task.n / 12) ** 2
    return cases * starts * 0.135 * growth


def solving_phase(name: PhaseName, task: ResolvedTask, candidates: int, starts: int, before: int = 0) -> Phase:
    """Return the phase that solves candidates up to a number of starts, `before` of them already solved."""
    return Phase(name, task.n, candidates, starts, solving_seconds(task, starts - before))


def audit_phase(n: int, designs: int) -> Phase:
    """Return the phase that audits designs of n modules."""
    return Phase("auditing", n, designs, seconds=0.6 * (n / 5) ** 1.5)


def proof_phase(n: int) -> Phase:
    """Return the phase that bounds the effort of a size, or proves it impossible."""
    return Phase("proving", n, 1, seconds=0.5, is_serial=True)


WRITING = Phase("writing", 0, 1, seconds=5.0, is_serial=True)
"""The phase that writes all files, and the page."""


class Observer(Protocol):
    """Receives the progress of a run."""

    def plan(self, plan: Plan) -> None:
        """Called with the plan before the first phase."""
        return

    def phase(self, phase: Phase) -> None:
        """Called when a phase begins."""
        return

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """Called after each step of the phase.

        Args:
            incumbent: the best design so far; None if there is none yet.
            known: whether the result was already in the ledger.
        """
        return

    def note(self, text: str) -> None:
        """Called with a message for the user."""
        return


class SilentObserver(Observer):
    """An observer that ignores everything."""

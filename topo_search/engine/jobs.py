"""Jobs: what is solved or audited, by which functions, who runs them, and how outcomes of one candidate are merged.

The best of two ranges of starts is the best of their union. Infeasible ends are compared by their violation, scaled
so that units do not matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NotRequired, Protocol, TypedDict, TypeVar, Unpack

from topo_search.model import Audit, Design, Geometry, Infeasible, ResolvedTask, SolverRecord, Topology

AuditDesign = Callable[[Geometry], Audit]
Item = TypeVar("Item")
Result = TypeVar("Result")


class Given(TypedDict):
    """Arguments of a solve, beside task and topology."""

    starts: range
    """Indices of the starts."""
    seed: int
    """Draws them."""
    near: NotRequired[Sequence[Design]]
    """Designs of other topologies that can be carried over, each as one more start before these."""


class Solve(Protocol):
    """Solves one topology from some of its starts: a pure function that can be sent to another process.

    Start s is drawn from (task, topology, s, seed) alone: the best of two ranges is the best of their union.
    """

    def __call__(self, task: ResolvedTask, topology: Topology, **given: Unpack[Given]) -> Design | Infeasible:
        """Return the best design over the starts, or the start that came closest.

        Args:
            task: the task.
            topology: the tree.
            given: starts, seed and near.
        """
        ...


class LocalOptima(Protocol):
    """Finds all local optima of one topology that cost little enough: likewise a pure function."""

    def __call__(
        self, task: ResolvedTask, topology: Topology, *, most_effort: float, **given: Unpack[Given]
    ) -> list[Design]:
        """Return them, least effort first.

        Args: as of `Solve`, and
            most_effort: largest effort of a design [rad^4/s^4].
        """
        ...


@dataclass(frozen=True)
class Backends:
    """The functions that know the physics."""

    solve: Solve
    audit: AuditDesign
    lower_bound: Callable[[ResolvedTask], float]
    """Lower bound on the effort of designs of this task's size with a clear audit [rad^4/s^4]."""
    prove_impossible: Callable[[ResolvedTask], Infeasible | None]
    """A proof that no topology of this task's size can do it, if there is a simple one."""
    local_optima: LocalOptima


@dataclass(frozen=True)
class Failed:
    """A job that ended without an answer."""

    kind: Literal["crash", "timeout", "memory", "error"]
    reason: str
    """Cause in one line."""


Outcome = Design | Infeasible | Failed


class WorkersLost(RuntimeError):
    """There is no worker: none lives long enough to take a job, or nobody answers where they should be."""


class Engine(Protocol):
    """Runs pure functions elsewhere; which engine it is, and how fast, changes nothing in what they return."""

    def run(
        self,
        function: Callable[[Item], Result],
        jobs: Iterable[Item | None],
        *,
        deadline: Callable[[Item], float],
        until: float = math.inf,
    ) -> Generator[tuple[Item, Result | Failed], None, None]:
        """Yield (job, result) as jobs end, in any order; `jobs` is drawn from only seconds ahead of the workers.

        A job that crashes its process or passes its deadline is tried twice, then comes back as Failed.

        Args:
            function: importable and pure.
            jobs: picklable values, drawn lazily; None where there is none before another result was yielded.
            deadline: seconds that a job may take.
            until: time.monotonic() at which to stop: what runs then is dropped and no more is begun.

        Raises:
            WorkersLost: no worker can take a job.
        """
        ...

    def run_one(self, function: Callable[[Item], Result], job: Item, *, deadline: float) -> Result | Failed:
        """Return the result of a single job."""
        ((_, result),) = self.run(function, [job], deadline=lambda _: deadline)
        return result


def solve_deadline(n: int, starts: int) -> float:
    """Return the time after which a solve counts as hung [s]: far above what one takes (n = 5: 1 s a start)."""
    return 120.0 + starts * max(20.0, 0.2 * n**2)


def audit_deadline(n: int) -> float:
    """Return the time after which an audit counts as hung [s]: far above what one takes (n = 100: seconds)."""
    return 300.0 + 0.2 * n**2


@dataclass(frozen=True)
class Job:
    """One candidate with the starts that it is still to be solved from."""

    task: ResolvedTask
    topology: Topology
    orbit: int
    """Number of classes of the exact quotient that the candidate stands for."""
    starts: range
    seed: int
    near: tuple[Design, ...] = ()
    """Designs that are carried over, each as a start of its own before the others."""

    @property
    def deadline(self) -> float:
        """The time after which it counts as hung [s]."""
        return solve_deadline(self.topology.n, len(self.near) + len(self.starts))


def solve_job(solve: Solve, job: Job) -> Design | Infeasible:
    """Solve one job (in a worker)."""
    return solve(job.task, job.topology, starts=job.starts, seed=job.seed, near=job.near)


def audit_job(audit: AuditDesign, labelled: tuple[object, Geometry]) -> Audit:
    """Audit a design that comes with a label (in a worker)."""
    return audit(labelled[1])


def rounds(starts: int | None, size: int, *, timed: bool) -> Iterator[range]:
    """Yield the ranges of starts that are solved one after the other, short ones first where time may end.

    Args:
        starts: how many there are; None: without end.
        size: of a round without a time limit; with one, rounds grow from a single start.
        timed: whether there is a time limit.
    """
    first = 0
    while starts is None or first < starts:
        length = min(max(1, first), 4) if timed else size  # what runs when the time is over is lost
        stop = first + length if starts is None else min(first + length, starts)
        yield range(first, stop)
        first = stop


def record_of(result: Design | Infeasible) -> SolverRecord | None:
    """Return how a result came about, if it says so."""
    if isinstance(result, Infeasible) or result.solver is None:
        return result.solver if isinstance(result, Infeasible) else None
    return SolverRecord.model_validate(result.solver)


def merge(earlier: Design | Infeasible, later: Design | Infeasible, task: ResolvedTask) -> Design | Infeasible:
    """Return the better of two results of one candidate, with the starts of both counted; `earlier` wins a tie."""
    best = min(earlier, later, key=lambda result: _rank(result, task))
    records = [record for record in (record_of(earlier), record_of(later)) if record is not None]
    kept = record_of(best)
    if kept is None:
        return best
    record = kept.model_copy(
        update={
            "starts": sum(record.starts for record in records),
            "starts_feasible": sum(record.starts_feasible for record in records),
            "objectives": tuple(J for record in records for J in record.objectives),
            "seconds": sum(record.seconds for record in records),
        }
    )
    if isinstance(best, Design):
        return best.model_copy(update={"solver": record.model_dump(mode="json")})
    both = [result for result in (earlier, later) if isinstance(result, Infeasible)]
    return best.with_starts((shortfall for result in both for shortfall in result.shortfalls), record)


def _rank(result: Design | Infeasible, task: ResolvedTask) -> tuple[bool, float]:
    """Order designs by objective, before all that is infeasible, by violation."""
    if isinstance(result, Design):
        return False, result.objective
    return True, scaled_violation(result.violation, result.unit, task)


def scaled_violation(violation: float, unit: str, task: ResolvedTask) -> float:
    """Return a violation in the task's own units: m_t g, l_arm m_t g, l_arm, u_max, rad."""
    scales = {
        "N": task.force_unit(task.n),
        "N m": task.torque_unit(task.n),
        "m": task.module.arm_length,
        "rad^2/s^2": task.module.max_input(task.gravity),
    }
    return violation / scales.get(unit, 1.0)

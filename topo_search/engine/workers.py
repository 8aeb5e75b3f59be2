"""Jobs, and the worker processes that run them: children that may crash, hang or be killed without harm.

The best of two ranges of starts is the best of their union. Infeasible ends are compared by their violation, scaled
so that units do not matter.
"""

from __future__ import annotations

import math
import os
import pickle
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.machinery import ModuleSpec
from multiprocessing import popen_spawn_posix, resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import RLock
from types import FrameType
from typing import Any, Generic, Literal, NotRequired, Protocol, Self, TypedDict, TypeVar, Unpack

from pebble import ProcessExpired, ProcessPool

from topo_search.limits import LIMITS
from topo_search.model import Audit, Design, Geometry, Infeasible, ResolvedTask, SolverRecord, Topology
from topo_search.supervisor import (
    INTERRUPT_DELAY_S,
    ONE_THREAD,
    STOPS,
    call_pickled,
    die_with_parent,
    is_out_of_memory,
)

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


class LocalOptima(Protocol):
    """Finds all local optima of one topology that cost little enough: likewise a pure function."""

    def __call__(
        self, task: ResolvedTask, topology: Topology, *, most_effort: float, **given: Unpack[Given]
    ) -> list[Design]:
        """Return them, least effort first.

        Args: as of `Solve`, and
            most_effort: largest effort of a design [rad^4/s^4].
        """


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


Results = Generator[tuple[Item, Result | Failed], None, None]


@dataclass(frozen=True)
class Work(Generic[Item, Result]):
    """Jobs for an engine, the function that does them, and their deadlines."""

    function: Callable[[Item], Result]
    """Importable and pure."""
    jobs: Iterator[Item | None]
    """Picklable values, drawn lazily; None while the next job waits for another result."""
    deadline: Callable[[Item], float]
    """Seconds that a job may take."""
    until: float
    """time.monotonic() at which to stop: what runs then is dropped and no more is begun."""


class Engine(Protocol):
    """Runs pure functions elsewhere; which engine it is, and how fast, changes nothing in what they return."""

    def run(
        self,
        function: Callable[[Item], Result],
        jobs: Iterable[Item | None],
        *,
        deadline: Callable[[Item], float],
        until: float = math.inf,
    ) -> Results[Item, Result]:
        """Yield (job, result) as jobs end, in any order; `jobs` is drawn from only seconds ahead of the workers.

        A job that crashes its process or passes its deadline is tried twice, then comes back as Failed. Arguments
        are those of `Work`.

        Raises:
            WorkersLost: no worker can take a job.
        """
        return self.do(Work(function, iter(jobs), deadline, until))

    def do(self, work: Work[Item, Result]) -> Results[Item, Result]:
        """Yield what `run` does."""

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


class _Process(SpawnProcess):
    """A process that does not import the script that starts it."""

    _launch = threading.Lock()

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> popen_spawn_posix.Popen:
        script = sys.modules["__main__"]
        with _Process._launch:
            spec, script.__spec__ = script.__spec__, ModuleSpec("__main__", None)  # a name that is never imported
            try:
                return SpawnProcess._Popen(process_obj)
            finally:
                script.__spec__ = spec


class _KeepingContext(SpawnContext):
    """A way to start processes that keeps the locks it made.

    A pool that stops drops its locks before it ends its workers, which removes them from the system: a worker that
    is just starting would look for them in vain and end with a traceback.
    """

    Process = _Process

    def __init__(self) -> None:
        super().__init__()
        self._kept: list[object] = []

    def RLock(self) -> RLock:
        lock = super().RLock()
        self._kept.append(lock)
        return lock


@dataclass
class _Try(Generic[Item]):
    job: Item
    attempt: int = 1
    since: float = 0.0
    """time.monotonic() when it was handed to the pool."""


class _OneThread(Engine):
    """An engine whose jobs load libraries that then compute in one thread: more would change sums."""

    def __enter__(self) -> Self:
        self._environment = {name: os.environ.get(name) for name in ONE_THREAD}
        os.environ.update(ONE_THREAD)
        return self

    def __exit__(self, *raised: object) -> None:
        for name, value in self._environment.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class CallingProcess(_OneThread):
    """Runs jobs one by one in the process that calls: none has to start, but deadlines are not kept.

    A job that crashes or never ends takes its caller with it: it is for a single candidate, and for no user's code.
    """

    def do(self, work: Work[Item, Result]) -> Results[Item, Result]:
        """Yield (job, result) in order."""
        for job in work.jobs:
            if job is None or time.monotonic() >= work.until:
                return
            result: Result | Failed
            try:
                with _interrupts_repeated():
                    result = work.function(job)
            except Exception as error:  # noqa: BLE001 (as in a worker, it is the result of the job)
                result = _failure(error, work.deadline(job))
            yield job, result


class Workers(_OneThread):
    """A pool of worker processes, started with the first job and stopped at the end of the `with` block.

    A job that crashes its worker (segmentation fault, kill, out of memory) or passes its deadline is tried
    twice, then comes back as Failed; the other jobs go on. One worker is a process too, so that it can be stopped.
    """

    def __init__(self, count: int) -> None:
        if not 1 <= count <= LIMITS.workers:
            raise ValueError(f"`1 <= workers <= {LIMITS.workers}` must hold, but got {count:,}")
        self.count = count
        self._pool: ProcessPool | None = None
        self._context = _KeepingContext()
        self._breaks = 0

    def __exit__(self, *raised: object) -> None:
        self._stop()
        super().__exit__(*raised)
        if isinstance(error := raised[1], WorkersLost):  # its message says all; where it was noticed is no help
            raise error.with_traceback(None) from None

    def do(self, work: Work[Item, Result]) -> Results[Item, Result]:
        """Yield (job, result) as jobs end; at most two jobs a worker are drawn from `jobs` ahead."""
        waiting: deque[_Try[Item]] = deque()
        running: dict[Future[Any], _Try[Item]] = {}
        try:
            while time.monotonic() < work.until:
                if self._pool is not None and not self._pool.active:
                    self._break()
                    waiting.extendleft(running.values())
                    running.clear()
                while len(running) < 2 * self.count:
                    if not waiting:
                        if (job := next(work.jobs, None)) is None:
                            break
                        waiting.append(_Try(job))
                    since = time.monotonic()
                    future = self._submit(work, waiting[0].job)
                    if future is None:
                        break
                    running[future] = replace(waiting.popleft(), since=since)
                if not running and not waiting:
                    return
                ended = wait(running, min(1.0, max(0.0, work.until - time.monotonic())), FIRST_COMPLETED).done
                for future in ended:
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        continue  # stays in `running`; the pool is no longer active and is replaced above
                    trial = running.pop(future)
                    self._breaks = 0
                    allowed = work.deadline(trial.job)
                    early = time.monotonic() - trial.since < allowed
                    if early and isinstance(error, TimeoutError) and error.__cause__ is None:  # the pool's own
                        waiting.appendleft(trial)  # it reads the time of day, and that jumped
                        continue
                    result = pickle.loads(future.result()) if error is None else _failure(error, allowed)
                    killed = isinstance(result, Failed) and result.kind != "error"  # a pure function raises again
                    if killed and trial.attempt == 1:
                        waiting.appendleft(_Try(trial.job, trial.attempt + 1))
                    else:
                        yield trial.job, result
        finally:
            if running:
                self._stop()

    def _submit(self, work: Work[Item, Result], job: Item) -> Future[Any] | None:
        """Hand a job to the pool; None if the pool has just broken."""
        if self._pool is None:
            self._pool = ProcessPool(
                self.count, initializer=die_with_parent, initargs=(os.getpid(),), context=self._context
            )
            with _stops_deferred(), _interrupts_blocked():
                started = self._pool.active
            if not started:
                raise WorkersLost("no worker process could be started")
        try:
            call = pickle.dumps((work.function, job))
            future: Future[Any] = self._pool.schedule(call_pickled, args=(call,), timeout=work.deadline(job))
        except RuntimeError:
            if self._pool.active:
                raise
            return None
        return future

    def _break(self) -> None:
        """Give up a pool that lost an idle worker or could not start one."""
        self._stop()
        self._breaks += 1
        if self._breaks > 2:
            ended = "all worker processes ended before they finished a job: no memory?"
            raise WorkersLost(f"{self._breaks} times in a row {ended}")

    def _stop(self) -> None:
        if self._pool is not None:
            pool: Any = self._pool
            self._pool = None
            pool.stop()
            pool.join()


@contextmanager
def _interrupts_repeated() -> Iterator[None]:
    """Raise KeyboardInterrupt of a script again until it arrives here: CasADi takes it for a failed evaluation."""
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler  # a command is killed if it goes on
    ):
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        signal.setitimer(signal.ITIMER_REAL, INTERRUPT_DELAY_S)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGALRM)}
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C: workers, and the thread that replaces them, inherit that; the coordinator handles it.

    The resource tracker runs before that: its start unblocks Ctrl-C in the thread that starts it.
    """
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def _stops_deferred() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM wait until all processes stand.

    One that interrupts this thread between the start of a process and what it writes to it leaves a process behind
    that ends with a traceback.
    """
    if threading.current_thread() is not threading.main_thread():  # no signal interrupts this one
        yield
        return
    came: list[int] = []
    handled = {number: handler for number in STOPS if callable(handler := signal.getsignal(number))}
    for number in handled:
        signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in handled.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def _failure(error: BaseException, deadline: float) -> Failed:
    """Say what ended a job."""
    if isinstance(error, ProcessExpired):
        code = error.exitcode
        if code >= 0:
            return Failed("crash", f"the worker process ended with status {code}")
        return Failed("crash", f"the worker process was ended by {signal.Signals(-code).name}")
    if isinstance(error, TimeoutError):
        return Failed("timeout", f"still running at its deadline of {deadline:.0f} s")
    if is_out_of_memory(error):
        return Failed("memory", "out of memory")
    return Failed("error", " ".join(f"{type(error).__name__}: {error}".split()))

"""Jobs, and the worker processes that run them, which may crash, hang or be killed without harm.

The better of the results of two ranges of starts is the result of both. Infeasible results are compared by their
violation, scaled to the task's units.
"""

from __future__ import annotations

import math
import os
import pickle
import signal
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import current_process, popen_spawn_posix, resource_tracker, spawn
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any, Literal, Self, TypeVar

from topo_search.limits import LIMITS
from topo_search.model import Audit, Design, Geometry, Infeasible, ResolvedTask, SolverRecord, Topology
from topo_search.process import call_pickled, interrupt, prepare_child

if TYPE_CHECKING:
    from pebble import ProcessPool

AuditDesign = Callable[[Geometry], Audit]
Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Failed:
    """The result of a job that failed."""

    kind: Literal["crash", "timeout", "error"]
    reason: str
    """Cause in one line."""


Outcome = Design | Infeasible | Failed


class WorkersLost(RuntimeError):
    """No worker can run jobs: all die before they finish one, or cannot be reached."""


Call = Callable[[Item], Result]
Jobs = Iterable[Item | None]
Deadline = Callable[[Item], float]
Results = Generator[tuple[Item, Result | Failed], None, None]
Note = Callable[[str], None]
Preparation = Callable[[Item, Note], object]
"""Compiles code for a task; calls a function with a message before what takes long."""


class Engine(ABC):
    """Runs jobs; results depend neither on the engine nor on its speed."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End what the engine started."""
        return

    @abstractmethod
    def run(
        self, function: Call[Item, Result], jobs: Jobs[Item], *, deadline: Deadline[Item], until: float = math.inf
    ) -> Results[Item, Result]:
        """Yield (job, result) as jobs end, in any order.

        A job that crashes its worker or exceeds its deadline is tried twice, then its result is Failed.

        Args:
            function: importable, pure function.
            jobs: picklable values, drawn only seconds before a worker is free; None while the next job depends on
                the result of another one.
            deadline: returns the time after which a job counts as hung [s].
            until: time.monotonic() at which to stop: running jobs are dropped, and no more are started.

        Raises:
            WorkersLost: no worker can run jobs.
        """

    def run_one(self, function: Callable[[Item], Result], job: Item, *, deadline: float) -> Result | Failed:
        """Return the result of a single job."""
        ((_, result),) = self.run(function, [job], deadline=lambda _: deadline)
        return result

    def prepare(self, function: Preparation[Item], task: Item, note: Note) -> None:
        """Compile code before the first job, so that workers need not compile the same code at the same time."""
        function(task, note)


def solve_deadline(n: int, starts: int, corners: int = 0) -> float:
    """Return the time after which a solve counts as hung [s]: ten times the typical time or more.

    That is 1 s per start for n = 5, and 0.024 s per start, module and corner of a convex region.
    """
    return 120.0 + starts * (max(20.0, 0.2 * n**2) + 0.25 * n * corners)


def audit_deadline(n: int) -> float:
    """Return the time after which an audit counts as hung [s]: far above the typical time (n = 100: seconds)."""
    return 300.0 + 0.2 * n**2


@dataclass(frozen=True)
class Job:
    """A candidate and the starts from which to solve it."""

    task: ResolvedTask
    topology: Topology
    starts: range
    """Indices of the starts."""
    seed: int
    """Seed of the random starts."""
    near: tuple[Design, ...] = ()
    """Designs to carry over, each as an additional start before the others."""
    orbit: int = 1
    """Number of trees, up to exact symmetry, that the candidate stands for."""
    reach: float = 0.0
    """Value of a maximised quantity that a design must reach."""

    @property
    def deadline(self) -> float:
        """Time after which the job counts as hung [s]."""
        shapes = (shape for exposure in self.task.exposure for shape in exposure.shapes)
        corners = sum(len(shape.corners) for shape in shapes)
        return solve_deadline(self.topology.n, len(self.near) + len(self.starts), corners)


@dataclass(frozen=True)
class Backends:
    """The functions that compute the physics: pure, so that they can be sent to other processes."""

    solve: Callable[[Job], Design | Infeasible]
    """Returns the best design over the starts, or the result of the start with the smallest violation.

    The random points of start s depend only on (task, topology, s, seed), so results of ranges of starts can be
    merged.
    """
    audit: AuditDesign
    lower_bound: Callable[[ResolvedTask], float]
    """Returns a lower bound of the effort of all designs of this size with a clear audit [rad^4/s^4]."""
    prove_impossible: Callable[[ResolvedTask], Infeasible | None]
    """Returns a proof that no topology of this size can do the task, if there is a simple one."""
    local_optima: Callable[[Job, float], list[Design]]
    """Returns all local optima of one topology up to an effort [rad^4/s^4], lowest effort first."""


def audit_job(audit: AuditDesign, labelled: tuple[object, Geometry]) -> Audit:
    """Audit a design that comes with a label (in a worker)."""
    return audit(labelled[1])


def start_ranges(starts: int | None, size: int, *, timed: bool) -> Iterator[range]:
    """Yield the ranges of starts that are solved one after the other; with a time limit they grow from one start.

    Args:
        starts: total number of starts; None: unlimited.
        size: number of starts in a round, if there is no time limit.
        timed: whether there is a time limit.
    """
    first = 0
    while starts is None or first < starts:
        length = min(max(1, first), 4) if timed else size  # a round that runs at the time limit is lost
        stop = first + length if starts is None else min(first + length, starts)
        yield range(first, stop)
        first = stop


def record_of(result: Design | Infeasible) -> SolverRecord | None:
    """Return the solver's record of a result, if there is one."""
    if isinstance(result, Infeasible):
        return result.solver
    return None if result.solver is None else SolverRecord.model_validate(result.solver)


def merge(earlier: Design | Infeasible, later: Design | Infeasible, task: ResolvedTask) -> Design | Infeasible:
    """Return the better of two results of one candidate, with the starts of both counted; `earlier` wins a tie."""
    best = min(earlier, later, key=lambda result: _rank(result, task))
    records = [record for record in (record_of(earlier), record_of(later)) if record is not None]
    best_record = record_of(best)
    if best_record is None:
        return best
    sums = {
        "starts": sum(record.starts for record in records),
        "starts_feasible": sum(record.starts_feasible for record in records),
        "objectives": tuple(J for record in records for J in record.objectives),
        "seconds": sum(record.seconds for record in records),
    }
    record = best_record.model_copy(update=sums)
    if isinstance(best, Design):
        return best.model_copy(update={"solver": record.model_dump(mode="json")})
    results = [result for result in (earlier, later) if isinstance(result, Infeasible)]
    return best.with_starts((shortfall for result in results for shortfall in result.shortfalls), record)


def _rank(result: Design | Infeasible, task: ResolvedTask) -> tuple[float, ...]:
    if isinstance(result, Design):
        return False, *result.rank
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


class _Worker(SpawnProcess):
    """A process that ends at once when it has to, and does not import the script that started the run."""

    terminate = SpawnProcess.kill  # one that is still starting would print a traceback
    _launch = threading.Lock()

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> popen_spawn_posix.Popen:
        with _Worker._launch:
            standard, spawn.get_preparation_data = spawn.get_preparation_data, _preparation
            try:
                return SpawnProcess._Popen(process_obj)
            finally:
                spawn.get_preparation_data = standard


def _preparation(name: str) -> dict[str, Any]:
    """Return what a worker has to know, which is nothing of `__main__`, whatever that may be."""
    process = {"name": name, "authkey": current_process().authkey, "dir": os.getcwd(), "start_method": "spawn"}
    return {**process, "sys_path": sys.path, "sys_argv": sys.argv}


class _Context(SpawnContext):
    Process = _Worker


class CallingProcess(Engine):
    """Runs jobs one by one in the calling process, without the cost of starting another but without deadlines.

    A job that crashes or hangs takes the caller with it, so this is only for single candidates without user code.
    """

    def run(
        self, function: Call[Item, Result], jobs: Jobs[Item], *, deadline: Deadline[Item], until: float = math.inf
    ) -> Results[Item, Result]:
        """Yield (job, result) in order."""
        for job in jobs:
            if job is None or time.monotonic() >= until:
                return
            result: Result | Failed
            try:
                with _interrupts_arrive():
                    result = function(job)
            except Exception as error:  # noqa: BLE001 (as in a worker, it is the result of the job)
                result = _failure(error, deadline(job))
            yield job, result


class Workers(Engine):
    """A pool of worker processes, started with the first job and stopped at the end of the `with` block.

    A job that crashes its worker (segmentation fault, kill) or exceeds its deadline is tried twice, then its result
    is Failed; the other jobs go on. A single worker is a process too, so that it can be stopped.
    """

    def __init__(self, count: int) -> None:
        if not 1 <= count <= LIMITS.workers:
            raise ValueError(f"`1 <= workers <= {LIMITS.workers}` must hold, but got {count:,}")
        self.count = count
        self._pool: ProcessPool | None = None

    def run(
        self, function: Call[Item, Result], jobs: Jobs[Item], *, deadline: Deadline[Item], until: float = math.inf
    ) -> Results[Item, Result]:
        """Yield (job, result) as jobs end; at most two jobs per worker are drawn in advance."""
        pending, breaks = iter(jobs), 0
        waiting, running = deque[tuple[Item, bool]](), dict[Future[Any], tuple[Item, bool]]()
        try:
            while time.monotonic() < until:
                if self._pool is not None and not self._pool.active:  # it lost an idle worker, or could start none
                    self.stop()
                    if (breaks := breaks + 1) > 2:
                        rule = "times in a row worker processes ended before they finished a job"
                        raise WorkersLost(f"{breaks} {rule}")
                    waiting.extendleft(running.values())
                    running.clear()
                while len(running) < 2 * self.count:
                    if not waiting:
                        if (job := next(pending, None)) is None:
                            break
                        waiting.append((job, False))
                    job, pool = waiting[0][0], self._start_pool()
                    call = pickle.dumps((function, job))
                    try:
                        future: Future[Any] = pool.schedule(call_pickled, args=(call,), timeout=deadline(job))
                    except RuntimeError:  # the pool has just broken
                        break
                    running[future] = waiting.popleft()
                if not running and not waiting:
                    return
                timeout = min(1.0, max(0.0, until - time.monotonic()))
                for future in wait(running, timeout, FIRST_COMPLETED).done:
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        continue  # stays in `running`; the pool is no longer active and is replaced above
                    job, is_retry = running.pop(future)
                    breaks = 0
                    result = pickle.loads(future.result()) if error is None else _failure(error, deadline(job))
                    if isinstance(result, Failed) and result.kind != "error" and not is_retry:
                        waiting.appendleft((job, True))
                    else:
                        yield job, result
        finally:
            if running:
                self.stop()

    def _start_pool(self) -> ProcessPool:
        """Return the pool, started if necessary."""
        if self._pool is None:
            from pebble import ProcessPool  # slow to import, and many commands start no worker

            if current_process().daemon:
                advice = "start Dask workers with DASK_DISTRIBUTED__WORKER__DAEMON=False"
                raise WorkersLost(f"a daemonic process may start no workers: {advice}")
            start: dict[str, Any] = {"initializer": prepare_child, "initargs": (os.getpid(),)}
            self._pool = ProcessPool(self.count, context=_Context(), **start)
            try:
                with _interrupts_blocked():
                    self._pool.active  # noqa: B018 (starts it)
            except BrokenProcessPool as error:
                raise (error.__cause__ or error) from None
        return self._pool

    def stop(self) -> None:
        """End the worker processes."""
        if self._pool is not None:
            pool: Any = self._pool
            self._pool = None
            pool.stop()
            pool.join()


@contextmanager
def _interrupts_arrive() -> Iterator[None]:
    """Let Ctrl-C in a script arrive: CasADi treats KeyboardInterrupt as a failed evaluation."""
    is_default = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # a command has another handler
    if not is_default or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C, so that workers and the thread that replaces them inherit the mask; the coordinator handles it.

    The resource tracker must run before, since starting it unblocks Ctrl-C in this thread.
    """
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _failure(error: BaseException, deadline: float) -> Failed:
    """Return the failure that an exception of a job stands for."""
    from pebble import ProcessExpired

    if isinstance(error, ProcessExpired):
        code = error.exitcode
        end = f"ended with status {code}" if code >= 0 else f"was ended by {signal.Signals(-code).name}"
        return Failed("crash", f"the worker process {end}")
    if isinstance(error, TimeoutError):
        return Failed("timeout", f"still running at its deadline of {deadline:.0f} s")
    return Failed("error", " ".join(f"{type(error).__name__}: {error}".split()))

"""Worker processes: pure functions run in children that may crash, hang or be killed without harm to the rest."""

from __future__ import annotations

import math
import os
import pickle
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
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
from typing import Any, Generic, Self

from pebble import ProcessExpired, ProcessPool

from topo_search.engine.jobs import Engine, Failed, Item, Result, WorkersLost
from topo_search.limits import LIMITS
from topo_search.supervisor import AGAIN, ONE_THREAD, STOPS, call_pickled, die_with_parent, is_out_of_memory


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

    def run(
        self,
        function: Callable[[Item], Result],
        jobs: Iterable[Item | None],
        *,
        deadline: Callable[[Item], float],
        until: float = math.inf,
    ) -> Generator[tuple[Item, Result | Failed], None, None]:
        """Yield (job, result) in order."""
        for job in jobs:
            if job is None or time.monotonic() >= until:
                return
            result: Result | Failed
            try:
                with _interrupts_repeated():
                    result = function(job)
            except Exception as error:  # noqa: BLE001 (as in a worker, it is the result of the job)
                result = _failure(error, deadline(job))
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

    def run(
        self,
        function: Callable[[Item], Result],
        jobs: Iterable[Item | None],
        *,
        deadline: Callable[[Item], float],
        until: float = math.inf,
    ) -> Generator[tuple[Item, Result | Failed], None, None]:
        """Yield (job, result) as jobs end; at most two jobs a worker are drawn from `jobs` ahead."""
        waiting: deque[_Try[Item]] = deque()
        running: dict[Future[Any], _Try[Item]] = {}
        source = iter(jobs)
        try:
            while time.monotonic() < until:
                if self._pool is not None and not self._pool.active:
                    self._break()
                    waiting.extendleft(running.values())
                    running.clear()
                while len(running) < 2 * self.count:
                    if not waiting:
                        if (job := next(source, None)) is None:
                            break
                        waiting.append(_Try(job))
                    since = time.monotonic()
                    future = self._submit(function, waiting[0].job, deadline(waiting[0].job))
                    if future is None:
                        break
                    running[future] = replace(waiting.popleft(), since=since)
                if not running and not waiting:
                    return
                ended = wait(running, min(1.0, max(0.0, until - time.monotonic())), FIRST_COMPLETED).done
                for future in ended:
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        continue  # stays in `running`; the pool is no longer active and is replaced above
                    if isinstance(error, WorkersLost):
                        raise error
                    trial = running.pop(future)
                    self._breaks = 0
                    allowed = deadline(trial.job)
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

    def _submit(self, function: Callable[[Item], Result], job: Item, deadline: float) -> Future[Any] | None:
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
            call = pickle.dumps((function, job))
            future: Future[Any] = self._pool.schedule(call_pickled, args=(call,), timeout=deadline)
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
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
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

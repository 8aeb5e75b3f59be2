"""Supervision of a command, which runs in a child of the process that the user started.

Python handles signals only when native code returns, which may take minutes (Ipopt, FCL, SciPy, LLVM), and native
code that runs out of memory ends its process without a message. So the started process loads nothing: it waits for
its child, forwards Ctrl-C and SIGTERM, kills the child if it does not end, and reports why it crashed. Nothing is
lost: finished results are in the ledger, which survives a kill at any moment.

Every child process first makes sure that it cannot outlive its parent, and that its imports do not hang when memory
runs out. This module imports only the standard library, so that a child with too little memory for more can still
report that.
"""

from __future__ import annotations

import ctypes
import gc
import mmap
import os
import pickle
import resource
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from enum import IntEnum
from importlib.abc import MetaPathFinder
from types import FrameType
from typing import Any, NoReturn


class ExitStatus(IntEnum):
    """Exit statuses of commands, some of them from <sysexits.h>."""

    BAD_INPUT = 2
    OPEN = 4
    """A proof is not complete."""
    SOFTWARE = 70
    """EX_SOFTWARE."""
    OUT_OF_MEMORY = 71
    """EX_OSERR: the system has no memory or no processes left."""
    INPUT_OUTPUT = 74
    """EX_IOERR: the disk is full, or fails."""
    INTERRUPTED = 130
    """128 + SIGINT, as in shells."""


STOPS = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a command: Ctrl-C, and the one by which a job scheduler ends a job."""
INTERRUPT_DELAY_S = 0.05
"""Delay before another attempt to raise KeyboardInterrupt [s]."""


class Stop:
    """Handler of Ctrl-C and SIGTERM in a command: raises KeyboardInterrupt once, or ends the command at once."""

    def __init__(self, status_pipe: int | None = None) -> None:
        self._status_pipe = status_pipe
        """Write end of the pipe for the exit status; libraries do not inherit it."""
        self._is_raised = False
        self._is_ending = False
        self.signalled = False
        """True if a signal was received."""
        self.unwinds = False
        """True if the command handles KeyboardInterrupt; elsewhere, as in imports, it may be lost or misread."""

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        self.signalled = True
        if self.unwinds:
            if not self._is_raised:
                self._raise(frame)
            return
        if self._is_ending:  # this signal interrupted the handler of another, which ends the command
            return
        self._is_ending = True
        if not self._is_raised:
            tell("stopped")
        self.report_status(ExitStatus.INTERRUPTED)
        os._exit(ExitStatus.INTERRUPTED)

    def _raise(self, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, or try again later if CasADi would swallow it."""
        # CasADi, even when it calls our function, catches the exception and returns an incomplete result
        while frame and frame.f_globals.get("__name__", "").partition(".")[0] != "casadi":
            frame = frame.f_back
        if frame:
            signal.signal(signal.SIGALRM, self)
            signal.setitimer(signal.ITIMER_REAL, INTERRUPT_DELAY_S)
        else:
            self._is_raised = True
            raise KeyboardInterrupt

    def report_status(self, status: int) -> None:
        """Report the command's exit status to the waiting process, since this one may crash on exit."""
        if self._status_pipe is not None:
            os.write(self._status_pipe, bytes([status & 0xFF]))

    def handle(self) -> dict[signal.Signals, Any]:
        """Install this handler, except for ignored signals, and return the previous handlers."""
        handlers = {number: signal.getsignal(number) for number in STOPS}
        return {
            number: signal.signal(number, self)
            for number, handler in handlers.items()
            if handler is not signal.SIG_IGN
        }


def tell(text: str) -> None:
    """Print a line on stderr; skip it if stderr is blocked or closed, so that the command can still end."""
    try:
        poll = select.poll()
        poll.register(2, select.POLLOUT)
        if poll.poll(200.0):  # [ms] for a pipe to have room for the line
            os.write(2, f"{text}\n".encode(errors="backslashreplace"))
    except OSError:
        return  # stderr is full or closed


def supervise(command: Callable[[], object]) -> NoReturn:
    """Run a command in a child process, and end with its exit status."""
    _open_standard_streams()
    for name, number in ONE_THREAD.items():
        os.environ.setdefault(name, number)  # each thread takes memory, and several change sums
    signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
    parent = os.getpid()
    try:
        read_end, write_end = os.pipe()
        child = os.fork()
    except OSError as error:
        tell(f"no process can be started: {error.strerror}")
        os._exit(ExitStatus.OUT_OF_MEMORY)
    if child == 0:
        os.close(read_end)
        stop = Stop(write_end)
        stop.handle()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
        _run(command, parent, stop)
    os.close(write_end)
    os._exit(_wait(child, read_end))


def _wait(child: int, read_end: int) -> int:
    """Wait for the child, and return the exit status of the command."""
    signalled = False

    def send(number: int) -> None:
        with suppress(ProcessLookupError):  # the child has just ended
            os.kill(child, number)

    def kill(number: int, frame: FrameType | None) -> None:
        send(signal.SIGKILL)

    def forward(number: int, frame: FrameType | None) -> None:
        nonlocal signalled
        if not signalled:
            signalled = True
            signal.setitimer(signal.ITIMER_REAL, 2.5)  # time for the child to write its files before it is killed
        send(number)

    signal.signal(signal.SIGALRM, kill)
    for number in STOPS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, forward)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    received = os.read(read_end, 2)
    if received and status >= 0:
        return status
    if signalled:
        if not received:
            tell("stopped")
        return received[-1] if received else ExitStatus.INTERRUPTED
    return _explain_death(status)


def _explain_death(status: int) -> int:
    """Report why a command crashed, and return its exit status.

    Args:
        status: exit status that a library set, or -n if the process was ended by signal n.
    """
    limit = _address_space_limit()
    number = None if status >= 0 else signal.Signals(-status)
    cause = f"a library, with status {status}" if number is None else number.name
    # signals of failed allocations in native code: C++ and LLVM abort, other code uses a null pointer
    memory_signals = (signal.SIGABRT, signal.SIGBUS, signal.SIGILL, signal.SIGSEGV, signal.SIGTRAP)
    if limit is not None and (number is None or number in memory_signals):
        tell(f"out of memory: ended by {cause}, with a limit of {limit:.0f} MB (`ulimit -v`)")
        return ExitStatus.OUT_OF_MEMORY
    tell(f"ended by {cause}{', by hand or because memory ran out' if number == signal.SIGKILL else ''}")
    return ExitStatus.SOFTWARE if number is None else 128 + number


def _address_space_limit() -> float | None:
    """Return the limit of the address space [MB]; None: unlimited."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit / 2**20


def _run(command: Callable[[], object], parent: int, stop: Stop) -> NoReturn:
    """Run the command (in the child)."""
    _silence(stop)
    try:
        prepare_child(parent)
        command()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
        stop.report_status(status)
        if status == ExitStatus.OUT_OF_MEMORY:
            os._exit(status)  # as in `_end_out_of_memory`
        raise
    except BaseException as error:
        if stop.signalled:
            tell("stopped")
            stop.report_status(ExitStatus.INTERRUPTED)
            raise SystemExit(ExitStatus.INTERRUPTED) from None
        if is_out_of_memory(error):
            _end_out_of_memory(stop)
        stop.report_status(1)
        raise
    stop.report_status(0)
    raise SystemExit(0)


def _end_out_of_memory(stop: Stop) -> NoReturn:
    tell("out of memory")
    stop.report_status(ExitStatus.OUT_OF_MEMORY)
    os._exit(ExitStatus.OUT_OF_MEMORY)  # there may be too little memory to raise SystemExit


def _silence(stop: Stop) -> None:
    """Suppress tracebacks that only follow from a stop, and end the command if a thread runs out of memory."""
    unraisable_hook, thread_hook = sys.unraisablehook, threading.excepthook

    def ignore(hook_args: sys.UnraisableHookArgs) -> None:
        if not stop.signalled and not (hook_args.exc_value and is_out_of_memory(hook_args.exc_value)):
            unraisable_hook(hook_args)

    def end(hook_args: threading.ExceptHookArgs) -> None:
        if stop.signalled:
            return
        if hook_args.exc_value and is_out_of_memory(hook_args.exc_value):
            _end_out_of_memory(stop)
        thread_hook(hook_args)

    sys.unraisablehook, threading.excepthook = ignore, end
    # after a kill, Python's resource tracker would report what it cleans up
    sys.warnoptions.append("ignore:resource_tracker:UserWarning")


def is_out_of_memory(error: BaseException) -> bool:
    """True if an error or one of its causes means that memory ran out."""
    # in messages of C++, of threads that cannot be started, and of libraries that cannot be mapped
    phrases = (
        "bad_alloc",
        "can't start new thread",
        "cannot allocate memory",
        "failed to map segment",
        "out of memory",
    )
    current: BaseException | None = error
    visited: set[int] = set()
    while current is not None and id(current) not in visited:
        visited.add(id(current))
        if isinstance(current, MemoryError) or any(phrase in str(current).lower() for phrase in phrases):
            return True
        if (
            isinstance(current, SystemError) and _address_space_limit() is not None
        ):  # native code failed, unexplained
            return True
        # raised by imports that run out of memory; 32 MB are less than the arrays of one library
        if isinstance(current, TypeError) and _is_memory_below(32):
            return True
        current = current.__cause__ or current.__context__
    return False


def _is_memory_below(megabytes: int) -> bool:
    """True if the address space is limited and less than this of it is left."""
    if _address_space_limit() is None:
        return False
    try:
        mmap.mmap(-1, megabytes * 2**20).close()
    except OSError:
        return True
    return False


class _ImportGuard(MetaPathFinder):
    """Refuses to import NumPy and SciPy with too little memory, of which OpenBLAS would ask again forever."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name.partition(".")[0] in ("numpy", "scipy") and _is_memory_below(128):  # SciPy's library takes 95 MB
            raise MemoryError(f"too little memory to import {name}")


def _open_standard_streams() -> None:
    """Open standard streams that are closed, so that no other file gets their number and receives our output."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "r" if number == 0 else "w", closefd=False))  # noqa: SIM115


ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""Environment of a worker: workers share the cores, and several threads would change sums."""


def prepare_child(parent: int) -> None:
    """End this process when the process `parent` ends, immediately if it already has, and guard its imports.

    On other systems than Linux, a worker whose parent was killed ends when it next reads from the closed pipe.
    """
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        set_parent_death_signal = 1  # PR_SET_PDEATHSIG of <linux/prctl.h>
        if libc.prctl(set_parent_death_signal, signal.SIGKILL) != 0:
            code = ctypes.get_errno()
            raise OSError(code, f"prctl(PR_SET_PDEATHSIG): {os.strerror(code)}")
    if os.getppid() != parent:  # the parent ended before the call above
        os._exit(1)
    sys.meta_path.insert(0, _ImportGuard())
    gc.set_threshold(10_000)  # looking for cycles, which jobs hardly make, would take 2 % of a run


def call_pickled(call: bytes) -> bytes:
    """Call a pickled function with its job; imports count as part of the job."""
    function, job = pickle.loads(call)
    return pickle.dumps(function(job))


class Clock:
    """Stopwatch for the CPU time of this process."""

    def __init__(self) -> None:
        self._lap_start = time.process_time()

    def lap(self) -> float:
        """Return the CPU time since the last lap [s], and start the next lap."""
        now = time.process_time()
        seconds, self._lap_start = now - self._lap_start, now
        return seconds


def peak_mb() -> float:
    """Return the peak memory of this process [MB]."""
    if sys.platform != "linux":
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS
    with open("/proc/self/status") as status:  # not `ru_maxrss`, which on Linux includes the parent's memory
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) / 2**10

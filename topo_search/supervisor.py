"""A command runs in a child of the process that was started, which sees to it that it ends.

Python's own handling of signals waits until native code returns, which may take minutes (Ipopt, FCL, SciPy,
LLVM), and memory that runs out in native code ends a process without a word. So the process that was started loads
nothing: it waits for its child, passes Ctrl-C and SIGTERM on to it, kills it if it does not end by itself, and says
why it crashed. That loses nothing: whatever was finished is in the ledger, which survives that at any moment.

Every child process makes sure first that it cannot outlive the process that started it. This file loads only
Python's own library, so that a child that has too little memory for more can say so.
"""

from __future__ import annotations

import ctypes
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
from types import FrameType
from typing import Any, NoReturn


class ExitStatus(IntEnum):
    """Exit statuses of commands; some are those of <sysexits.h>."""

    BAD_INPUT = 2
    OPEN = 4
    """A proof is not complete."""
    SOFTWARE = 70
    """EX_SOFTWARE."""
    OUT_OF_MEMORY = 71
    """EX_OSERR: the system has no more memory, or no more processes."""
    INPUT_OUTPUT = 74
    """EX_IOERR: the disk is full, or fails."""
    INTERRUPTED = 130
    """128 + SIGINT, as shells have it."""


STOPS = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a command: Ctrl-C, and the one by which a scheduler ends a job."""
INTERRUPT_DELAY_S = 0.05
"""Delay after which KeyboardInterrupt is raised instead [s]."""


class Stop:
    """Handling of Ctrl-C and SIGTERM in a command: they unwind what there is to unwind, once, or end it at once."""

    def __init__(self, end: int | None = None) -> None:
        self._end = end
        """Write end of the pipe for the exit status; libraries do not inherit it."""
        self._raised = False
        self._ending = False
        self.signalled = False
        """True if one of them came."""
        self.unwinds = False
        """True if KeyboardInterrupt is waited for: elsewhere, as while modules load, it may be lost or mistaken."""

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        self.signalled = True
        if self.unwinds:
            if not self._raised:
                self._raise(frame)
            return
        if self._ending:  # a signal of several interrupted the handler of another, which is still to tell
            return
        self._ending = True
        if not self._raised:
            tell("stopped")
        self.report_status(ExitStatus.INTERRUPTED)
        os._exit(ExitStatus.INTERRUPTED)

    def _raise(self, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt; later where it would be swallowed, and half a result be taken for one."""
        # CasADi, also where it calls a function of ours, catches the exception and returns what it has
        while frame and frame.f_globals.get("__name__", "").partition(".")[0] != "casadi":
            frame = frame.f_back
        if frame:
            signal.signal(signal.SIGALRM, self)
            signal.setitimer(signal.ITIMER_REAL, INTERRUPT_DELAY_S)
        else:
            self._raised = True
            raise KeyboardInterrupt

    def report_status(self, status: int) -> None:
        """Tell the process that waits which status the command ends with: it may die on the way out."""
        if self._end is not None:
            os.write(self._end, bytes([status & 0xFF]))

    def handle(self) -> dict[signal.Signals, Any]:
        """Handle the signals from now on, but one that is ignored, and return what handled them before."""
        before = {number: signal.getsignal(number) for number in STOPS}
        return {
            number: signal.signal(number, self)
            for number, handler in before.items()
            if handler is not signal.SIG_IGN
        }


def tell(text: str) -> None:
    """Print a line on stderr if somebody takes it; a message that nobody takes keeps no command from ending."""
    try:
        poll = select.poll()
        poll.register(2, select.POLLOUT)
        if poll.poll(200.0):  # [ms] for a pipe to have room for the line
            os.write(2, f"{text}\n".encode(errors="backslashreplace"))
    except OSError:
        return  # stderr is full or gone: there is nobody left to tell


def supervise(command: Callable[[], object]) -> NoReturn:
    """Run a command in a child process, and end with its exit status."""
    _open_standard_streams()
    for name, number in ONE_THREAD.items():
        os.environ.setdefault(name, number)  # each thread would take memory, and threads change sums
    signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
    parent = os.getpid()
    try:
        read_end, end = os.pipe()
        child = os.fork()
    except OSError as error:
        tell(f"no process can be started: {error.strerror}")
        os._exit(ExitStatus.OUT_OF_MEMORY)
    if child == 0:
        os.close(read_end)
        stop = Stop(end)
        stop.handle()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
        _run(command, parent, stop)
    os.close(end)
    os._exit(_wait(child, read_end))


def _wait(child: int, read_end: int) -> int:
    """Wait for the child, and return the exit status of the command."""
    signalled = False

    def send(number: int) -> None:
        with suppress(ProcessLookupError):  # it has just ended
            os.kill(child, number)

    def kill(number: int, frame: FrameType | None) -> None:
        send(signal.SIGKILL)

    def pass_on(number: int, frame: FrameType | None) -> None:
        nonlocal signalled
        if not signalled:
            signalled = True
            signal.setitimer(signal.ITIMER_REAL, 2.5)  # time to write what it has, before it is killed
        send(number)

    signal.signal(signal.SIGALRM, kill)
    for number in STOPS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, pass_on)
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
        status: what a library ended the process with; -n: that it was ended by signal n.
    """
    limit = _limit()
    number = None if status >= 0 else signal.Signals(-status)
    by = f"a library, with status {status}" if number is None else number.name
    # native code ends so when an allocation fails: C++ and LLVM abort, others use a null pointer
    of_memory = (signal.SIGABRT, signal.SIGBUS, signal.SIGILL, signal.SIGSEGV, signal.SIGTRAP)
    if limit is not None and (number is None or number in of_memory):
        tell(f"out of memory: ended by {by}, with a limit of {limit:.0f} MB (`ulimit -v`)")
        return ExitStatus.OUT_OF_MEMORY
    tell(f"ended by {by}{', by hand or because memory ran out' if number == signal.SIGKILL else ''}")
    return ExitStatus.SOFTWARE if number is None else 128 + number


def _limit() -> float | None:
    """Return the address space that a process may have [MB]; None: as much as there is."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit / 2**20


def _run(command: Callable[[], object], parent: int, stop: Stop) -> NoReturn:
    """Run the command (in the child)."""
    _silence(stop)
    try:
        die_with_parent(parent)
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
    """Print no traceback of what only follows from a stop; a thread that has no memory ends the command."""
    unraisable, of_thread = sys.unraisablehook, threading.excepthook

    def ignore(hook_args: sys.UnraisableHookArgs) -> None:
        if not stop.signalled and not (hook_args.exc_value and is_out_of_memory(hook_args.exc_value)):
            unraisable(hook_args)

    def end(hook_args: threading.ExceptHookArgs) -> None:
        if stop.signalled:
            return
        if hook_args.exc_value and is_out_of_memory(hook_args.exc_value):
            _end_out_of_memory(stop)
        of_thread(hook_args)

    sys.unraisablehook, threading.excepthook = ignore, end
    # of a command that was killed, the process that tidies up after it would say what it tidies
    sys.warnoptions.append("ignore:resource_tracker:UserWarning")


def is_out_of_memory(error: BaseException) -> bool:
    """True if an error, or its cause, says that there is no more memory."""
    # messages of C++, of threads that cannot be started, and of libraries that cannot be mapped
    words = (
        "bad_alloc",
        "can't start new thread",
        "cannot allocate memory",
        "failed to map segment",
        "out of memory",
    )
    seen: BaseException | None = error
    known: set[int] = set()
    while seen is not None and id(seen) not in known:
        known.add(id(seen))
        if isinstance(seen, MemoryError) or any(word in str(seen).lower() for word in words):
            return True
        if isinstance(seen, SystemError) and _limit() is not None:  # native code failed, and does not know why
            return True
        if isinstance(seen, TypeError) and _is_cramped():  # an import that ran out of memory may end in one
            return True
        seen = seen.__cause__ or seen.__context__
    return False


def _is_cramped() -> bool:
    """True if the address space is limited and next to nothing of it is left."""
    if _limit() is None:
        return False
    try:
        mmap.mmap(-1, 32 * 2**20).close()  # the arrays of one library take more
    except OSError:
        return True
    return False


def _open_standard_streams() -> None:
    """Open streams that were closed, so that no file of ours takes their place and what is printed there."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free: this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "r" if number == 0 else "w", closefd=False))  # noqa: SIM115


ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""Environment of a worker: the cores are shared out between workers, and threads would change sums."""


def die_with_parent(parent: int) -> None:
    """End this process when its parent, whose id is given, ends; at once if it already has.

    On systems other than Linux a worker whose parent was killed ends when it next reads from the closed pipe.
    """
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        set_parent_death_signal = 1  # PR_SET_PDEATHSIG of <linux/prctl.h>
        if libc.prctl(set_parent_death_signal, signal.SIGKILL) != 0:
            code = ctypes.get_errno()
            raise OSError(code, f"prctl(PR_SET_PDEATHSIG): {os.strerror(code)}")
    if os.getppid() != parent:  # it ended before the line above
        os._exit(1)


def call_pickled(call: bytes) -> bytes:
    """Call a pickled function with its job: what that loads, and the time it takes, is part of the job."""
    function, job = pickle.loads(call)
    return pickle.dumps(function(job))


class Clock:
    """CPU seconds of this process since the last lap."""

    def __init__(self) -> None:
        self._began = time.process_time()

    def lap(self) -> float:
        """Return them, and begin the next."""
        now = time.process_time()
        seconds, self._began = now - self._began, now
        return seconds


def peak_mb() -> float:
    """Return the most memory that this process has held [MB]."""
    if sys.platform != "linux":
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS
    with open(
        "/proc/self/status"
    ) as status:  # not `ru_maxrss`, in which Linux counts the parent in that started it
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) / 2**10

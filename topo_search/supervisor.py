"""Supervision of a command, which runs in a child of the process that the user started.

Python handles signals only when native code returns, which may take minutes (Ipopt, FCL, SciPy, LLVM). So the
started process loads nothing: it waits for its child, forwards Ctrl-C and SIGTERM, and kills the child if it does
not end. Nothing is lost: finished results are in the ledger, which survives a kill at any moment.

It imports only the standard library, so that a command can be stopped while it loads.
"""

import atexit
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from enum import IntEnum
from types import FrameType
from typing import Any, NoReturn

from topo_search.process import interrupt, prepare_child, tell


class ExitStatus(IntEnum):
    """Exit statuses of commands, some of them from <sysexits.h>."""

    BAD_INPUT = 2
    OPEN = 4
    """A proof is not complete."""
    SOFTWARE = 70
    """EX_SOFTWARE."""
    INPUT_OUTPUT = 74
    """EX_IOERR: the disk is full, or fails."""
    INTERRUPTED = 130
    """128 + SIGINT, as in shells."""


STOPS = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a command: Ctrl-C, and the one by which a job scheduler ends a job."""


class Stop:
    """Handler of Ctrl-C and SIGTERM in a command: the first one ends it, by KeyboardInterrupt or at once."""

    def __init__(self) -> None:
        self.signalled = False
        """True if a signal was received."""
        self.unwinds = False
        """True if the command handles KeyboardInterrupt; elsewhere, as in imports, it may be lost or misread."""

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        if self.signalled:
            return
        self.signalled = True
        if self.unwinds:
            interrupt(number, frame)
        else:
            tell("stopped")
            os._exit(ExitStatus.INTERRUPTED)

    def handle(self) -> dict[signal.Signals, Any]:
        """Install this handler, except for ignored signals, and return the previous handlers."""
        handlers = {number: signal.getsignal(number) for number in STOPS}
        return {
            number: signal.signal(number, self)
            for number, handler in handlers.items()
            if handler is not signal.SIG_IGN
        }


def supervise(command: Callable[[], object]) -> NoReturn:
    """Run a command in a child process, and end with its exit status."""
    signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        stop = Stop()
        stop.handle()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
        _run(command, parent, stop)
    os._exit(_wait(child))


def _wait(child: int) -> int:
    """Wait for the child, and return the exit status of the command."""
    signalled = False

    def send(number: int) -> None:
        with suppress(ProcessLookupError):  # the child has just ended
            os.kill(child, number)

    def forward(number: int, frame: FrameType | None) -> None:
        nonlocal signalled
        if not signalled:
            signalled = True
            signal.setitimer(signal.ITIMER_REAL, 2.5)  # time for the child to write its files before it is killed
        send(number)

    signal.signal(signal.SIGALRM, lambda *_: send(signal.SIGKILL))
    for number in STOPS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, forward)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status >= 0:
        return status
    if signalled:
        tell("stopped")
        return ExitStatus.INTERRUPTED
    name = signal.Signals(-status).name
    tell(f"ended by {name}{', by hand or because memory ran out' if name == 'SIGKILL' else ''}")
    return 128 - status


def _run(command: Callable[[], object], parent: int, stop: Stop) -> NoReturn:
    """Run the command (in the child), and end without the clean-up of libraries, which may crash."""

    def unless_stopped(hook: Callable[[Any], object]) -> Callable[[Any], object]:
        """Suppress tracebacks that only follow from a stop."""
        return lambda arguments: None if stop.signalled else hook(arguments)

    sys.unraisablehook = unless_stopped(sys.unraisablehook)
    threading.excepthook = unless_stopped(threading.excepthook)
    # after a kill, Python's resource tracker would report what it cleans up
    sys.warnoptions.append("ignore:resource_tracker:UserWarning")
    status = 0
    try:
        prepare_child(parent)
        command()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # noqa: BLE001 (it ends the command)
        if stop.signalled:
            tell("stopped")
            status = ExitStatus.INTERRUPTED.value
        else:
            traceback.print_exc()
            status = 1
    if not stop.signalled:
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError):  # closed, full, or without a reader
            stream.flush()
    os._exit(status)

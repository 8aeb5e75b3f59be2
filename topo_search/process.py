"""A process of a command or a worker: how it is interrupted, and ends with its parent.

This module imports only the standard library, so that a command can be stopped while it loads.
"""

import ctypes
import gc
import os
import pickle
import select
import signal
import sys
from types import FrameType


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt (a signal handler); within CasADi, which would swallow it, try again later.

    Even when CasADi calls our function, it catches the exception and returns an incomplete result.
    """
    while frame and frame.f_globals.get("__name__", "").partition(".")[0] != "casadi":
        frame = frame.f_back
    if frame is None:
        raise KeyboardInterrupt
    signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.05)


def tell(text: str) -> None:
    """Print a line on stderr; skip it if stderr is blocked or closed, so that the command can still end."""
    try:
        poll = select.poll()
        poll.register(2, select.POLLOUT)
        if poll.poll(200.0):  # [ms] for a pipe to have room for the line
            os.write(2, f"{text}\n".encode(errors="backslashreplace"))
    except OSError:
        return  # stderr is full or closed


ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""Environment of a worker: workers share the cores, and several threads would change sums."""


def prepare_child(parent: int) -> None:
    """End this process when the process `parent` ends, and let libraries use one thread each.

    On other systems than Linux, a worker whose parent was killed ends when it next reads from the closed pipe.
    """
    os.environ.update(ONE_THREAD)
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        set_parent_death_signal = 1  # PR_SET_PDEATHSIG of <linux/prctl.h>
        if libc.prctl(set_parent_death_signal, signal.SIGKILL) != 0:
            code = ctypes.get_errno()
            raise OSError(code, f"prctl(PR_SET_PDEATHSIG): {os.strerror(code)}")
    if os.getppid() != parent:  # the parent ended before the call above
        os._exit(1)
    gc.set_threshold(10_000)  # looking for cycles, which jobs hardly make, would take 2 % of a run


def call_pickled(call: bytes) -> bytes:
    """Call a pickled function with its job; imports count as part of the job."""
    function, job = pickle.loads(call)
    return pickle.dumps(function(job))

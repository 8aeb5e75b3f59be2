"""First steps of every child process: it makes sure that it cannot outlive the process that started it.

It loads only Python's own library, so that a child that has too little memory for more can say so.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
from typing import Any

PR_SET_PDEATHSIG = 1
"""<linux/prctl.h>"""

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
        if libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL) != 0:
            code = ctypes.get_errno()
            raise OSError(code, f"prctl(PR_SET_PDEATHSIG): {os.strerror(code)}")
    if os.getppid() != parent:  # it ended before the line above
        os._exit(1)


def call_pickled(call: bytes, script: dict[str, str]) -> bytes:
    """Call a function with its job: what that loads, and takes to do so, is part of the job that may fail.

    Args:
        call: both, pickled.
        script: names the script that defines some of it, as `multiprocessing` does; may be empty.
    """
    if script:
        from multiprocessing import current_process  # a worker has loaded them, the supervisor never does
        from multiprocessing.spawn import prepare

        process: Any = current_process()
        process._inheriting = True  # as in a process that starts: the script may not start more of them
        try:
            prepare(script)
        finally:
            del process._inheriting
    function, job = pickle.loads(call)
    return pickle.dumps(function(job))

"""Jobs that behave and jobs that do not, in a module that workers on other machines can import as well."""

import os
import signal
import time
from pathlib import Path

LONG = 600.0
"""No honest job of these tests takes as long [s]."""


def square(x):
    return x * x


def misbehave(job):
    kind, x = job
    if kind == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    if kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "parent":
        os.kill(os.getppid(), signal.SIGKILL)
    if kind == "raise":
        raise ValueError("`x > 0` must hold,\nbut got x = 0")
    while kind == "hang":
        time.sleep(0.1)
    return x


def raise_memory_error():
    raise MemoryError


class TooLarge:
    """A job for which a worker has no memory, even before its function is called."""

    def __reduce__(self):
        return raise_memory_error, ()


def crash_once(path):
    """Die the first time, and leave a mark."""
    if not Path(path).exists():
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "survived"


def count_attempts(path):
    with Path(path).open("a") as stream:
        stream.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def environment(names):
    return {name: os.environ.get(name) for name in names}


def mark(folder, tell):
    tell("marking")
    report_pid((folder, 0.0))


def report_pid(job):
    path, seconds = job
    (Path(path) / str(os.getpid())).touch()
    time.sleep(seconds)
    return os.getpid()


def pause(job):
    time.sleep(job[1])


def timed(function, job):
    """A job's result, with the wall and the CPU time that it took [s]."""
    wall, own = time.perf_counter(), time.process_time()
    result = function(job)
    return result, time.perf_counter() - wall, time.process_time() - own

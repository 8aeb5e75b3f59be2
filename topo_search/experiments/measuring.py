"""CPU time and memory of a process."""

import resource
import sys
import time


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

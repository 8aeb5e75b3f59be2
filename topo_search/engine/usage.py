"""Resources that a process has used: CPU time and memory."""

from __future__ import annotations

import resource
import time
from pathlib import Path

STATUS = Path("/proc/self/status")
"""Memory of a process, as Linux reports it."""


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
    if STATUS.exists():
        # not `ru_maxrss`, in which Linux counts the parent in that started the process
        (peak,) = (line.split()[1] for line in STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(peak) / 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS

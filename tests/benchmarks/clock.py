"""Stopwatch for the CPU time of a benchmark."""

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

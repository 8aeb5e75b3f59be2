"""Measurements in child processes of their own, so that CPU time and peak memory are those of the measurement.

A measurement is a generator function that runs in the child. It first yields an empty row when it is ready to be
measured; then the parent requests one row at a time, and the child is idle in between. Requests to two children in
turn interleave them, so that other load on the machine affects both equally.
"""

from __future__ import annotations

import multiprocessing
import resource
import signal
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Self

from topo_search.experiments.study import peak_mb

Row = dict[str, Any]
Measurement = Callable[..., Iterator[Row]]


class Child:
    """A running measurement; iterates over its rows."""

    def __init__(self, measurement: Measurement, *args: object, cap: int | None = None) -> None:
        """Start the measurement.

        Args:
            measurement: the generator function, importable by name.
            args: its arguments.
            cap: CPU time after which the system ends the child, counted from its empty row [s]; None: no limit.
        """
        context = multiprocessing.get_context("spawn")
        self._pipe, child_pipe = context.Pipe()
        self._process = context.Process(target=_serve, args=(child_pipe, measurement, args, cap))
        self._process.start()
        child_pipe.close()
        self.capped = False
        """True if the cap ended the child."""

    def __iter__(self) -> Self:
        """Return self."""
        return self

    def __next__(self) -> Row:
        """Return the next row; `peak_mb` is the child's peak memory so far, unless the row has its own."""
        if self.capped:
            raise StopIteration
        try:
            self._pipe.send(True)
            row: Row | None = self._pipe.recv()
        except (EOFError, ConnectionError) as error:
            self._process.join()
            if self._process.exitcode != -signal.SIGXCPU:
                raise RuntimeError(f"a measurement ended with exit code {self._process.exitcode}") from error
            self.capped = True
            row = None
        if row is None:
            raise StopIteration
        return row

    def __enter__(self) -> Self:
        """Return self."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the child."""
        self._process.terminate()
        self._process.join()
        self._pipe.close()


def _serve(pipe: Connection, measurement: Measurement, args: tuple[object, ...], cap: int | None) -> None:
    rows = measurement(*args)
    next(rows)
    if cap is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (int(time.process_time()) + cap, resource.RLIM_INFINITY))
    row: Row | None = {}
    while row is not None and pipe.recv():
        row = next(rows, None)
        pipe.send(None if row is None else {"peak_mb": peak_mb(), **row})

"""Measurements in child processes of their own, so that CPU time and peak memory are nobody else's.

A measurement is a generator function that runs in the child. First it yields an empty row when it is ready to be
measured; then the parent asks for one row at a time, and the child rests in between. Two children asked in turn are
interleaved: what else the machine does meets both alike.
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

from topo_search.supervisor import peak_mb

Row = dict[str, Any]
Measurement = Callable[..., Iterator[Row]]


class Child:
    """A measurement under way; an iterator of its rows."""

    def __init__(self, measurement: Measurement, *args: object, cap: int | None = None) -> None:
        """Start it.

        Args:
            measurement: the generator function, importable by name.
            args: its arguments.
            cap: CPU seconds after which the system ends the child, counted from when it is ready.
        """
        context = multiprocessing.get_context("spawn")
        self._pipe, end = context.Pipe()
        self._process = context.Process(target=_serve, args=(end, measurement, args, cap))
        self._process.start()
        end.close()
        self.capped = False
        """Whether the cap ended it."""

    def __iter__(self) -> Self:
        """Return itself."""
        return self

    def __next__(self) -> Row:
        """Return the next row, with the child's peak memory so far in `peak_mb` unless it says so itself."""
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
        """Return itself."""
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

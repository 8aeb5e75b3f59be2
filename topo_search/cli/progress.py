"""How a run shows its progress: a bar on a terminal, a plain line now and then elsewhere; both on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from topo_search.cli.errors import note
from topo_search.model.proven import gap_percent
from topo_search.report.wording import counted, modules
from topo_search.study import Observer, Row

EVERY = 10.0
"""Least time between two plain lines [s]."""
Words = Callable[[Row | None], str]
"""What to say of the best design so far."""


def describe(incumbent: Row | None) -> str:
    """Return the best design so far in a few words."""
    if incumbent is None:
        return "no design yet"
    gap = "" if incumbent.gap is None else f", gap {gap_percent(incumbent.gap)}"
    return f"best {incumbent.key} J {incumbent.objective:.6g}{gap}"


def _nothing(incumbent: Row | None) -> str:
    """Say nothing: the designs are not of one task."""
    return ""


@contextmanager
def shown_progress(*, incumbent: bool = True) -> Iterator[Observer]:
    """Show the progress of a run on stderr while the block runs.

    Args:
        incumbent: whether there is a best design to speak of.
    """
    words = describe if incumbent else _nothing
    if sys.stderr.isatty():
        with Bar.shown(Console(stderr=True), words) as bar:
            yield bar
    else:
        yield Lines(words)


class Bar:
    """A progress bar for each size and round of starts, with the incumbent, its gap and the time left."""

    def __init__(self, progress: Progress, words: Words = describe) -> None:
        self._progress = progress
        self._words = words
        self._task = progress.add_task("", visible=False, incumbent="")

    @classmethod
    @contextmanager
    def shown(cls, console: Console, words: Words = describe) -> Iterator[Self]:
        """Show bars on a terminal while the block runs."""
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[incumbent]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=console) as progress:
            yield cls(progress, words)

    def size(self, n: int, candidates: int, starts: int) -> None:
        """Begin a bar."""
        self._task = self._progress.add_task(
            f"{modules(n)}, {counted(starts, 'start')}", total=candidates, incumbent=""
        )

    def settled(self, incumbent: Row | None) -> None:
        """Move the bar on."""
        self._progress.update(self._task, advance=1, incumbent=self._words(incumbent))

    def note(self, text: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(text, markup=False, highlight=False)


class Lines:
    """Plain lines, a few a minute."""

    def __init__(self, words: Words = describe) -> None:
        self._words = words
        self._done = self._candidates = 0
        self._began = self._last = time.monotonic()
        self._size = ""

    def size(self, n: int, candidates: int, starts: int) -> None:
        """Say how many candidates there are, and of how many starts."""
        self._size, self._done, self._candidates = modules(n), 0, candidates
        self._began = time.monotonic()
        note(f"{self._size}: {counted(candidates, 'candidate')}, at most {counted(starts, 'start')} each")

    def settled(self, incumbent: Row | None) -> None:
        """Say how far it is, unless that was said lately."""
        self._done += 1
        now = time.monotonic()
        if now - self._last < EVERY:
            return
        self._last = now
        left = (now - self._began) / self._done * (self._candidates - self._done)
        best = self._words(incumbent)
        told = [f"{self._done} of {self._candidates}", *([best] if best else []), f"about {left:.0f} s left"]
        note(f"{self._size}: {', '.join(told)}")

    def note(self, text: str) -> None:
        """Print a line."""
        note(text)

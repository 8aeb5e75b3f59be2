"""How a run shows its progress: a bar on a terminal, a plain line now and then elsewhere; both on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from topo_search.report.wording import counted, modules
from topo_search.study import Observer, Row

EVERY = 10.0
"""Least time between two plain lines [s]."""


@contextmanager
def shown_progress() -> Iterator[Observer]:
    """Show the progress of a run on stderr while the block runs."""
    if sys.stderr.isatty():
        with Bar.shown(Console(stderr=True)) as bar:
            yield bar
    else:
        yield Lines()


class Bar:
    """A progress bar for each size and round of starts, with the incumbent, its gap and the time left."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task = progress.add_task("", visible=False, incumbent="")

    @classmethod
    @contextmanager
    def shown(cls, console: Console) -> Iterator[Self]:
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
            yield cls(progress)

    def size(self, n: int, candidates: int, starts: int) -> None:
        """Begin a bar."""
        self._task = self._progress.add_task(
            f"{modules(n)}, {counted(starts, 'start')}", total=candidates, incumbent=""
        )

    def settled(self, incumbent: Row | None) -> None:
        """Move the bar on."""
        self._progress.update(self._task, advance=1, incumbent=describe(incumbent))

    def note(self, text: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(text, markup=False, highlight=False)


class Lines:
    """Plain lines, a few a minute."""

    def __init__(self) -> None:
        self._done = self._candidates = 0
        self._began = self._last = time.monotonic()
        self._size = ""

    def size(self, n: int, candidates: int, starts: int) -> None:
        """Say how many candidates there are, and of how many starts."""
        self._size, self._done, self._candidates = modules(n), 0, candidates
        self._began = time.monotonic()
        click.echo(f"{self._size}: {counted(candidates, 'candidate')}, {counted(starts, 'start')} each", err=True)

    def settled(self, incumbent: Row | None) -> None:
        """Say how far it is, unless that was said lately."""
        self._done += 1
        now = time.monotonic()
        if now - self._last < EVERY:
            return
        self._last = now
        left = (now - self._began) / self._done * (self._candidates - self._done)
        click.echo(
            f"{self._size}: {self._done} of {self._candidates}, {describe(incumbent)}, about {left:.0f} s left",
            err=True,
        )

    def note(self, text: str) -> None:
        """Print a line."""
        click.echo(text, err=True)


def describe(incumbent: Row | None) -> str:
    """Return the best design so far in a few words."""
    if incumbent is None:
        return "no design yet"
    gap = "" if incumbent.gap is None else f", gap {100 * incumbent.gap:.1f} %"
    return f"best {incumbent.key} J {incumbent.objective:.6g}{gap}"

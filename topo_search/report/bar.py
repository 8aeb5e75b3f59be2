"""Progress of a run as a line in a terminal."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Self

from rich.console import Console
from rich.progress import Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.progress_bar import ProgressBar
from rich.table import Column
from rich.text import Text

from topo_search.report.progress import Follower, Words, describe, describe_plan, stage
from topo_search.study import Phase, Plan, Row


class Bar(Follower):
    """One line: stage, share of the run that is over, steps, incumbent with its gap, time elapsed and left."""

    def __init__(self, console: Console, words: Words = describe) -> None:
        super().__init__()
        self._words = words
        self._start_time = time.monotonic()
        self._share = 0.0
        self._progress = Progress(
            TextColumn("{task.description}"),
            _Rendered(self._bar),
            TextColumn("{task.fields[steps]}"),
            TextColumn("{task.fields[incumbent]}", table_column=Column(ratio=1, no_wrap=True)),
            TimeElapsedColumn(),
            _Rendered(lambda: Text("" if self._phase is None else self.time_left)),
            console=console,
            transient=True,
            expand=True,
        )
        self._task = self._progress.add_task("loading", total=None, steps="", incumbent="")

    @classmethod
    @contextmanager
    def show(cls, console: Console, words: Words = describe) -> Iterator[Self]:
        """Show the line on a terminal while the block runs."""
        bar = cls(console, words)
        with bar._progress:
            yield bar

    def plan(self, plan: Plan) -> None:
        """Print the plan of the run."""
        super().plan(plan)
        self.note(describe_plan(plan))

    def phase(self, phase: Phase) -> None:
        """Name the stage, and count its steps."""
        super().phase(phase)
        steps = f"0/{phase.steps}" if phase.steps > 1 or not phase.is_serial else ""
        self._progress.update(self._task, description=stage(phase), steps=steps)

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """Count a step, and show the best design so far."""
        if self._phase is not None:
            super().settled(incumbent, known=known)
            steps = f"{self._steps_done}/{self._phase.steps}"
            self._progress.update(self._task, steps=steps, incumbent=self._words(incumbent))

    def note(self, text: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(text, markup=False, highlight=False)

    def _bar(self) -> ProgressBar:
        """Return a bar with the share of the time that is over; it moves during long steps, and never back."""
        now, width = time.monotonic(), 24  # [characters]
        if self._phase is None:
            return ProgressBar(total=None, width=width, pulse=True, animation_time=now)
        elapsed = now - self._start_time
        self._share = max(self._share, elapsed / max(elapsed + self._time_left(now), 1e-9))
        return ProgressBar(total=1.0, completed=self._share, width=width)


class _Rendered(ProgressColumn):
    """A column that a function renders whenever the line is drawn."""

    def __init__(self, render_column: Callable[[], ProgressBar | Text]) -> None:
        super().__init__()
        self._render_column = render_column

    def render(self, task: Task) -> ProgressBar | Text:
        """Return the content of the column."""
        return self._render_column()

"""Progress on a terminal: one line with a bar."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.progress_bar import ProgressBar
from rich.table import Column
from rich.text import Text

if TYPE_CHECKING:
    from topo_search.report.progress import Words
    from topo_search.study.ledger import Row
    from topo_search.study.progress import Phase, Plan
    from topo_search.study.time_left import TimeLeft


class Bar:
    """One line: stage, share of the run that is over, steps, incumbent with its gap, time elapsed and left.

    The bar appears before the solver's libraries load, so it imports its texts only with the first plan or stage.
    """

    def __init__(self, console: Console, words: Words | None = None) -> None:
        self._words = words
        self._time_left: TimeLeft | None = None
        self._start_time = time.monotonic()
        self._share = 0.0
        self._progress = Progress(
            TextColumn("{task.description}"),
            _Rendered(self._bar),
            TextColumn("{task.fields[steps]}"),
            TextColumn("{task.fields[incumbent]}", table_column=Column(ratio=1, no_wrap=True)),
            TimeElapsedColumn(),
            _Rendered(self._time_text),
            console=console,
            transient=True,
            expand=True,
        )
        self._task = self._progress.add_task("loading", total=None, steps="", incumbent="")
        self._phase: Phase | None = None
        self._steps = 0

    @classmethod
    @contextmanager
    def show(cls, console: Console, words: Words | None = None) -> Iterator[Self]:
        """Show the line on a terminal while the block runs."""
        bar = cls(console, words)
        with bar._progress:
            yield bar

    def plan(self, plan: Plan) -> None:
        """Print the plan of the run."""
        from topo_search.report.progress import describe_plan

        self._estimate_time().plan(plan, time.monotonic())
        self.note(describe_plan(plan))

    def phase(self, phase: Phase) -> None:
        """Name the stage, and count its steps."""
        from topo_search.report.progress import stage

        self._estimate_time().begin(phase, time.monotonic())
        self._phase, self._steps = phase, 0
        steps = f"0/{phase.steps}" if phase.steps > 1 or not phase.is_serial else ""
        self._progress.update(self._task, description=stage(phase), steps=steps)

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """Count a step, and show the best design so far."""
        from topo_search.report.progress import describe

        if self._phase is None:
            return
        self._estimate_time().step(time.monotonic(), known=known)
        self._steps += 1
        steps = f"{self._steps}/{self._phase.steps}"
        self._progress.update(self._task, steps=steps, incumbent=(self._words or describe)(incumbent))

    def note(self, text: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(text, markup=False, highlight=False)

    def _estimate_time(self) -> TimeLeft:
        """Return the estimator of the time left, made with the first plan or stage."""
        if self._time_left is None:
            from topo_search.study.time_left import TimeLeft

            self._time_left = TimeLeft()
        return self._time_left

    def _bar(self) -> ProgressBar:
        """Return a bar with the share of the time that is over; it moves during long steps, and never back."""
        now, width = time.monotonic(), 24  # [characters]
        if self._time_left is None or self._phase is None:
            return ProgressBar(total=None, width=width, pulse=True, animation_time=now)
        elapsed = now - self._start_time
        self._share = max(self._share, elapsed / max(elapsed + self._time_left(now), 1e-9))
        return ProgressBar(total=1.0, completed=self._share, width=width)

    def _time_text(self) -> Text:
        """Return the time left."""
        if self._time_left is None or self._phase is None:
            return Text("")
        from topo_search.report.progress import period

        return Text(f"about {period(self._time_left(time.monotonic()))} left")


class _Rendered(ProgressColumn):
    """A column that a function renders whenever the line is drawn."""

    def __init__(self, render_column: Callable[[], ProgressBar | Text]) -> None:
        super().__init__()
        self._render_column = render_column

    def render(self, task: Task) -> ProgressBar | Text:
        """Return the content of the column."""
        return self._render_column()

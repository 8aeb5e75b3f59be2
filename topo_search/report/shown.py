"""Which form the progress of a command, a script or a notebook takes; nothing slow is imported before it shows."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from topo_search.study.progress import Observer


@contextmanager
def visible_progress(
    observer: Observer | None = None, *, incumbent: bool = True, tell: Callable[[str], None] | None = None
) -> Iterator[Observer]:
    """Yield an observer: the given one, or one that shows progress while the block runs, if anybody sees it.

    That is a bar in a terminal, and a line in a notebook's cell that vanishes at the end.

    Args:
        observer: the observer; None: choose one.
        incumbent: False if there is no best design to show.
        tell: prints a line now and then where there is no terminal; None: a script, which prints nothing.
    """
    if observer is not None:
        yield observer
        return
    from rich.console import Console

    from topo_search.report.progress import Lines, describe

    console, words = Console(stderr=True), describe if incumbent else lambda _: ""
    if sys.stderr.isatty():
        from topo_search.report.bar import Bar

        with Bar.show(console, words) as bar:
            yield bar
    elif tell is not None:
        yield Lines(tell, words)
    elif console.is_jupyter:
        from IPython.display import display

        cell = display({"text/plain": ""}, raw=True, display_id=True)
        yield Lines(lambda line: cell.update({"text/plain": line}, raw=True), words, every=0.5)
        cell.update({"text/plain": ""}, raw=True)
    else:
        from topo_search.study.progress import SilentObserver

        yield SilentObserver()

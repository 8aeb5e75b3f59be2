"""Progress of a command on stderr: a bar on a terminal, otherwise a plain line now and then."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from topo_search.cli.errors import note

if TYPE_CHECKING:
    from topo_search.study.progress import Observer


@contextmanager
def shown_progress(*, incumbent: bool = True) -> Iterator[Observer]:
    """Show the progress of a command on stderr while the block runs.

    Args:
        incumbent: False if the command has no best design to show.
    """
    words = None if incumbent else lambda _: ""
    if sys.stderr.isatty():
        from rich.console import Console

        from topo_search.report.bar import Bar

        with Bar.show(Console(stderr=True), words) as bar:
            yield bar
    else:
        from topo_search.report.progress import Lines, describe

        yield Lines(note, words or describe)

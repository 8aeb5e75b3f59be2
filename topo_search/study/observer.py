"""Who is told how a run goes on."""

from __future__ import annotations

from typing import Protocol

from topo_search.study.row import Row


class Observer(Protocol):
    """Shows the progress of a run."""

    def size(self, n: int, candidates: int, starts: int) -> None:
        """All candidates of one size are taken up, to solve what is left of this many starts of each."""

    def settled(self, incumbent: Row | None) -> None:
        """One more of these candidates is solved; `incumbent` is the best so far."""

    def note(self, text: str) -> None:
        """Something that the user should see happened."""


class Silent:
    """Shows nothing."""

    def size(self, n: int, candidates: int, starts: int) -> None:
        """Ignore the start of a size."""

    def settled(self, incumbent: Row | None) -> None:
        """Ignore progress."""

    def note(self, text: str) -> None:
        """Ignore a note."""

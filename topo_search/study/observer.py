"""Who is told how a run goes on."""

from __future__ import annotations

from typing import Protocol

from topo_search.study.phases import Phase, Plan
from topo_search.study.row import Row


class Observer(Protocol):
    """Shows the progress of a run."""

    def plan(self, plan: Plan) -> None:
        """All of this is going to be done."""

    def phase(self, phase: Phase) -> None:
        """A part of the run begins."""

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """One more step of it is done; `incumbent` is the best design so far.

        Args:
            incumbent: None while there is none.
            known: whether the result was there before.
        """

    def note(self, text: str) -> None:
        """Something that the user should see happened."""


class Silent:
    """Shows nothing."""

    def plan(self, plan: Plan) -> None:
        """Ignore the plan."""

    def phase(self, phase: Phase) -> None:
        """Ignore the start of a part."""

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """Ignore progress."""

    def note(self, text: str) -> None:
        """Ignore a note."""

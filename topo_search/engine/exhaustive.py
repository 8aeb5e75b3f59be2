"""Exhaustive search: every candidate of one size is solved, whatever becomes of the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from topo_search.engine.rounds import rounds
from topo_search.engine.space import Space
from topo_search.engine.strategy import Proposal, Strategy


@dataclass(frozen=True)
class Everything:
    """A round of all candidates, drawn as workers become free, so that there may be millions."""

    space: Space
    starts: int

    def __iter__(self) -> Iterator[Proposal]:
        """Yield every candidate."""
        return (Proposal(candidate, self.starts) for candidate in self.space.candidates())

    def __len__(self) -> int:
        """Return their number."""
        return self.space.count()


def exhaustive(space: Space, *, starts: int, timed: bool) -> Strategy:
    """Propose every candidate.

    Args:
        space: the candidates.
        starts: number of starts of each candidate.
        timed: whether there is a time limit: then all are solved from one start first.
    """
    for part in rounds(starts, starts, timed=timed):
        yield Everything(space, part.stop)

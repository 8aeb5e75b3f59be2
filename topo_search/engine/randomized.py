"""Search for the tree of the largest value, without the value of every tree.

Chan's randomised optimisation (Geometric applications of a randomized optimization technique, 1999): in random
order, each tree is asked only for a design that exceeds the best value so far. Of N trees about ln N have one.
"""

from random import Random
from typing import Literal

from topo_search.engine.strategy import WAIT, Candidates, Proposal, Stage, Strategy

FEWEST_OPEN = 4
"""Number of proposals before the result of the first must be known; later an eighth of all so far."""


class RandomizedSearch(Strategy):
    """Asks every candidate, in random order, for more than the best value so far."""

    def __init__(self, space: Candidates, *, starts: int, seed: int) -> None:
        """Set up the search.

        Args:
            space: the candidates.
            starts: number of starts of each candidate.
            seed: seeds the order.
        """
        super().__init__()
        self._candidates = list(space.candidates())
        Random(seed).shuffle(self._candidates)
        self._starts, self._proposed = starts, 0
        self.stage = Stage(len(self._candidates), starts)

    def ask(self) -> Proposal | Literal["wait"] | None:
        """Propose the next candidate; the results that it has to exceed depend on its number alone."""
        if self._proposed == len(self._candidates):
            return WAIT if len(self._results) < self._proposed else None
        known = self._proposed - max(FEWEST_OPEN, self._proposed // 8) + 1
        if known > len(self._results):
            return WAIT
        values = (result.value or 0.0 for result in self._results[: max(known, 0)])
        candidate = self._candidates[self._proposed]
        self._proposed += 1
        return Proposal(candidate, self._starts, reach=max(values, default=0.0))

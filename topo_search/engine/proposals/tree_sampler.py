"""Optuna samplers over trees: each proposes a whole tree, one that was proposed before only for more starts.

A sampler learns of the trials through its arguments; the study keeps them for Optuna's own samplers and for the
journal. A trial without a design has a constraint above zero there, so that Optuna ranks it behind all others.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Set
from itertools import islice
from random import Random
from typing import Any

from optuna import Study
from optuna.distributions import BaseDistribution, CategoricalDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial

from topo_search.engine.proposals.trials import FEW, Idea, Trials, encode, ranges
from topo_search.engine.space import Space
from topo_search.engine.strategy import Scored
from topo_search.model import Topology

KEY = "key"
"""User attribute of a trial: the key of its candidate."""
NEAR = "near"
"""User attribute of a trial: the keys of the candidates whose designs are carried over to it."""
STARTS = "starts"
"""User attribute of a trial that is over: the starts of its candidate so far."""
STATUS = "status"
"""User attribute of a trial that is over: what became of its candidate."""
DRAWS = 64
"""Number of known trees drawn in a row after which one is drawn uniformly from all that are left."""

FRESH = 8
"""Uniform draws that a search, or a population after a restart, begins with."""


class TreeSampler(BaseSampler):
    """Draws the numbers of a tree's encoding together, in the form that its candidate's key has."""

    few = FEW
    """Starts of a new candidate."""
    promotes = True
    """True if candidates that do well are given more starts at once."""

    def __init__(self, space: Space, seed: int) -> None:
        self.space = space
        self.random = Random(seed)
        self.connectors = space.task.search.connectors
        self.trials = Trials()
        self.drawn: dict[int, Idea] = {}
        """Ideas drawn for trials, by trial number; the only tree of one module needs no draw."""
        self.values = ranges(space.n, self.connectors)
        """Number of values that each number that makes a tree can have."""
        self.distributions: dict[str, BaseDistribution] = {
            name: CategoricalDistribution(range(values)) for name, values in self.values.items()
        }
        """The numbers that make a tree, as Optuna's `ask` takes them."""

    @abstractmethod
    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield candidates for a trial until there is no idea left; known ones are passed over, if not meant again.

        Args:
            study: what Optuna's own samplers take.
            trial: the one to propose for.
        """

    def note_idea(self, number: int, idea: Idea) -> None:
        """Take note of what is proposed in a trial."""
        self.trials.ask(number, idea)

    def note_score(self, number: int, score: Scored) -> None:
        """Take note of what a trial of this sampler led to."""
        self.trials.tell(number, score)

    def uniform(self) -> Idea:
        """Return a candidate drawn uniformly from all."""
        (topology,) = self.space.sample(1, self.random.getrandbits(64))
        return Idea(topology.key)

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """Return the numbers that make a tree."""
        return self.distributions

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return the numbers of a tree that is drawn."""
        known = self.trials.proposed
        for idea in islice(self.ideas(study, trial), DRAWS):
            if idea.again or idea.key not in known:
                break
        else:
            idea = self._draw_unknown(known)
        self.drawn[trial.number] = idea
        return dict(encode(Topology.from_key(idea.key), self.connectors))

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Refuse to draw a number of its own."""
        raise ValueError(f"only {', '.join(self.distributions)} can be drawn, but got {param_name!r}")

    def _draw_unknown(self, known: Set[str]) -> Idea:
        """Return a candidate drawn uniformly from those that are not known; they are listed if there are few."""
        for _ in range(DRAWS):
            idea = self.uniform()
            if idea.key not in known:
                return idea
        left = [other.key for other in self.space.candidates() if other.key not in known]
        return Idea(self.random.choice(left))

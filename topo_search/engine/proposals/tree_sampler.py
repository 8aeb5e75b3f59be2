"""Optuna samplers over trees: each proposes a whole tree, one that was proposed before only for more starts.

A trial's candidate is in its user attribute `key`, so that what is known is read from the study. A trial that found
no design has a constraint above zero, by which Optuna orders such trials behind all that have one.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence, Set
from itertools import islice
from random import Random
from typing import Any, NamedTuple

from optuna import Study
from optuna.distributions import BaseDistribution, CategoricalDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial

from topo_search.engine.proposals.encoding import encode, ranges
from topo_search.engine.proposals.promotion import FEW
from topo_search.engine.space import Space
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
"""How many trees in a row may be known before one is drawn uniformly from all that are left."""

FRESH = 8
"""Uniform draws that a search, or a population after a restart, begins with."""


class Idea(NamedTuple):
    """What may be proposed."""

    key: str
    """Of the candidate."""
    warm_starts: tuple[str, ...] = ()
    """Keys of the candidates whose designs are carried over to it."""
    again: bool = False
    """Whether it was proposed before and is to have more starts."""


class TreeSampler(BaseSampler):
    """Draws the numbers of a tree's encoding together, in the form that its candidate's key has."""

    few = FEW
    """Starts of a new candidate."""
    promotes = True
    """Whether candidates that do well are given more starts at once."""

    def __init__(self, space: Space, seed: int) -> None:
        self.space = space
        self.random = Random(seed)
        self.connectors = space.task.search.connectors
        self.warm_starts: dict[int, tuple[str, ...]] = {}
        """Keys of the candidates whose designs a trial's tree starts from, by the trial's number."""
        self.distributions: dict[str, BaseDistribution] = {
            name: CategoricalDistribution(range(values))
            for name, values in ranges(space.n, self.connectors).items()
        }
        """The numbers that make a tree, as Optuna's `ask` takes them."""

    @abstractmethod
    def ideas(self, study: Study, trial: FrozenTrial, earlier: Sequence[FrozenTrial]) -> Iterator[Idea]:
        """Yield candidates for a trial until there is no idea left; known ones are passed over, if not meant again.

        Args:
            study: what Optuna's own samplers take.
            trial: the one to propose for.
            earlier: the trials that have a candidate.
        """

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
        """Return the numbers of a tree, and note whose designs are carried over to it."""
        earlier = [other for other in study.get_trials(deepcopy=False) if KEY in other.user_attrs]
        known = {other.user_attrs[KEY] for other in earlier}
        for idea in islice(self.ideas(study, trial, earlier), DRAWS):
            if idea.again or idea.key not in known:
                break
        else:
            idea = self._draw_unknown(known)
        self.warm_starts[trial.number] = idea.warm_starts
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


class Merit(NamedTuple):
    """Orders trials that are over; less is better, and the earlier one wins a tie."""

    violation: float
    """By how much a design was missed; 0 with one."""
    objective: float
    """Infinite without a design."""
    number: int
    """Of the trial."""


def merit(trial: FrozenTrial) -> Merit:
    """Return what a trial that is over has led to."""
    return Merit(sum(trial.constraints.values()), trial.value or 0.0, trial.number)


def has_design(trial: FrozenTrial) -> bool:
    """Whether a trial that is over led to a design."""
    return trial.value is not None and math.isfinite(trial.value)

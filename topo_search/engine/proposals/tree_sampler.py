"""Optuna samplers over trees: each proposes a whole tree, and never one that was proposed before.

A trial's candidate is in its user attribute `key`, so that what is known is read from the study. A trial that found
no design has a constraint above zero, by which Optuna orders such trials behind all that have one.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Set
from itertools import islice
from random import Random
from typing import Any

from optuna import Study
from optuna.distributions import BaseDistribution, CategoricalDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial

from topo_search.engine.proposals.encoding import encoded, ranges
from topo_search.engine.space import Space
from topo_search.model import Topology
from topo_search.topologies import Candidate

KEY = "key"
"""User attribute of a trial: the key of its candidate."""
DRAWS = 64
"""How many trees in a row may be known before one is drawn uniformly from all that are left."""

FRESH = 8
"""Uniform draws that a search, or a population after a restart, begins with."""

Child = tuple[Topology, tuple[str, ...]]
"""A tree that may be proposed, and the keys of the candidates whose designs it may start from."""


class TreeSampler(BaseSampler):
    """Draws the numbers of a tree's encoding together, in the form that its candidate's key has."""

    def __init__(self, space: Space, seed: int) -> None:
        self.space = space
        self.random = Random(seed)
        self.connectors = space.task.search.connectors
        self.donors: dict[int, tuple[str, ...]] = {}
        """Keys of the candidates whose designs a trial's tree starts from, by the trial's number."""
        self.distributions: dict[str, BaseDistribution] = {
            name: CategoricalDistribution(range(values))
            for name, values in ranges(space.n, self.connectors).items()
        }
        """The numbers that make a tree, as Optuna's `ask` takes them."""

    @abstractmethod
    def drawn(self, study: Study, trial: FrozenTrial, proposed: Set[str]) -> Iterator[Child]:
        """Yield trees for a trial until there is no idea left; those proposed before are passed over."""

    def uniform(self) -> Topology:
        """Return a tree drawn uniformly from all candidates."""
        (topology,) = self.space.sample(1, self.random.getrandbits(64))
        return topology

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """Return the numbers that make a tree."""
        return self.distributions

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return the numbers of a tree that was not proposed before."""
        known = {other.user_attrs[KEY] for other in study.get_trials(deepcopy=False) if KEY in other.user_attrs}
        for topology, donors in islice(self.drawn(study, trial, known), DRAWS):
            candidate = self.space.candidate_of(topology)
            if candidate.key not in known:
                self.donors[trial.number] = donors
                return dict(encoded(candidate.topology, self.connectors))
        return dict(encoded(self._left(known).topology, self.connectors))

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Refuse to draw a number of its own."""
        raise ValueError(f"only {', '.join(self.distributions)} can be drawn, but got {param_name!r}")

    def _left(self, known: Set[str]) -> Candidate:
        """Return a candidate drawn uniformly from those that are not known; they are listed if there are few."""
        for _ in range(DRAWS):
            candidate = self.space.candidate_of(self.uniform())
            if candidate.key not in known:
                return candidate
        return self.random.choice([other for other in self.space.candidates() if other.key not in known])


def standing(trial: FrozenTrial) -> tuple[float, float, int]:
    """Order trials by objective, behind them those without a design by violation; the earlier one wins a tie."""
    return sum(trial.constraints.values()), trial.value or 0.0, trial.number


def has_design(trial: FrozenTrial) -> bool:
    """Whether a trial that is over led to a design."""
    return trial.value is not None and math.isfinite(trial.value)

"""The ways to propose trees: uniformly, by moves from good ones, or by Optuna's own samplers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray
from optuna import Study
from optuna.samplers import BaseSampler, NSGAIISampler, TPESampler
from optuna.trial import FrozenTrial, TrialState

from topo_search.engine.proposals.descriptors import descriptors
from topo_search.engine.proposals.encoding import decoded
from topo_search.engine.proposals.forecast import Forecast
from topo_search.engine.proposals.tree_sampler import KEY, Child, TreeSampler
from topo_search.engine.space import Space
from topo_search.model import Topology
from topo_search.topologies.tree_moves import neighbour

FRESH = 8
"""Uniform draws that a search, or a population after a restart, begins with."""
PARENTS = 8
"""The best of a population have children; the others are replaced."""
CHILDREN = 32
"""Trees made by moves of which, with the strangers, the most promising is proposed."""
STRANGERS = 8
"""Trees drawn uniformly beside them: the best tree need not look like others that are good."""
STALE = 160
"""A population is given up when so many trials after its best are no better."""

SEEDS = 2**32
"""How many seeds Optuna's samplers know."""


class Uniform(TreeSampler):
    """Draws uniformly from the candidates."""

    def drawn(self, study: Study, trial: FrozenTrial) -> Iterator[Child]:
        """Yield trees drawn uniformly."""
        while True:
            yield self.uniform(), None


class Moves(TreeSampler):
    """Makes trees from the best of a population by single moves, and begins anew when that leads nowhere.

    Of several such trees and some drawn uniformly it proposes the one that promises most by what was solved so far.
    """

    def __init__(self, space: Space, seed: int) -> None:
        super().__init__(space, seed)
        self._first = 0
        """The first trial of the present population."""
        self._described: dict[str, NDArray[np.float64]] = {}
        """Descriptors of candidates, by key."""
        self._latest: tuple[int, Forecast] | None = None
        """The last forecast, after the number of solved trials that it was made from."""

    def drawn(self, study: Study, trial: FrozenTrial) -> Iterator[Child]:
        """Yield trees drawn uniformly for a new population, then children of its best, the most promising first."""
        solved = sorted(study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)), key=standing)
        best = [other for other in solved if other.number >= self._first][:PARENTS]
        if best and trial.number - best[0].number > STALE:
            self._first = trial.number
        while trial.number < self._first + FRESH or not best:
            yield self.uniform(), None
        forecast = self._forecast(solved)
        while True:
            chosen = [best[min(self.random.choices(range(len(best)), k=2))] for _ in range(CHILDREN)]
            parents: list[str] = [parent.user_attrs[KEY] for parent in chosen]
            trees: list[Child] = [
                *((neighbour(Topology.from_key(key), self.random, self.connectors), key) for key in parents),
                *((self.uniform(), None) for _ in range(STRANGERS)),
            ]
            hopes = forecast.hopes(np.array([descriptors(tree) for tree, _ in trees]))
            for place in np.argsort(hopes, kind="stable"):
                yield trees[place]

    def _forecast(self, solved: Sequence[FrozenTrial]) -> Forecast:
        """Return what is to be expected of other trees, from trials in the order of their standing.

        All candidates of a round are proposed from the same trials, so that one forecast serves them.
        """
        if self._latest is None or self._latest[0] != len(solved):
            for trial in solved:
                key = trial.user_attrs[KEY]
                if key not in self._described:
                    self._described[key] = descriptors(Topology.from_key(key))
            alike = groupby(solved, key=lambda trial: standing(trial)[:2])
            places = [place for place, (_, trials) in enumerate(alike) for _ in trials]
            described = np.array([self._described[trial.user_attrs[KEY]] for trial in solved])
            self._latest = len(solved), Forecast(described, places)
        return self._latest[1]


class Optunas(TreeSampler):
    """Has the numbers of a tree proposed by one of Optuna's samplers, after some trees drawn uniformly."""

    def __init__(self, space: Space, seed: int, sampler: BaseSampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler

    def drawn(self, study: Study, trial: FrozenTrial) -> Iterator[Child]:
        """Yield the trees that the sampler proposes."""
        while trial.number < FRESH:
            yield self.uniform(), None
        while True:
            numbers = self._sampler.sample_relative(study, trial, self.distributions)
            for name, distribution in self.distributions.items():
                if name not in numbers:
                    numbers[name] = self._sampler.sample_independent(study, trial, name, distribution)
            yield decoded(numbers, self.space.n), None


def standing(trial: FrozenTrial) -> tuple[float, float, int]:
    """Order trials by objective, behind them those without a design by violation; the earlier one wins a tie."""
    return sum(trial.constraints.values()), trial.value or 0.0, trial.number


def sampler_of(name: str, space: Space, seed: int) -> TreeSampler:
    """Return the sampler of a name; ValueError lists the names."""
    if name == "moves":
        return Moves(space, seed)
    if name == "random":
        return Uniform(space, seed)
    of_optuna = seed % SEEDS
    if name == "tpe":
        return Optunas(space, seed, TPESampler(n_startup_trials=FRESH, seed=of_optuna))
    if name == "nsga2":
        return Optunas(space, seed, NSGAIISampler(population_size=FRESH, seed=of_optuna))
    raise ValueError(f"sampler must be one of moves, tpe, nsga2, random, but got {name!r}")

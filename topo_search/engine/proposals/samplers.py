"""The ways to propose trees: uniformly, by moves from good ones, or by Optuna's own samplers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from optuna import Study
from optuna.samplers import BaseSampler, NSGAIISampler, TPESampler
from optuna.trial import FrozenTrial

from topo_search.engine.proposals.encoding import decoded
from topo_search.engine.proposals.moves import Moves
from topo_search.engine.proposals.tree_sampler import FRESH, Idea, TreeSampler
from topo_search.engine.space import Space

SEEDS = 2**32
"""How many seeds Optuna's samplers know."""


class Uniform(TreeSampler):
    """Draws uniformly from the candidates."""

    def ideas(self, study: Study, trial: FrozenTrial, earlier: Sequence[FrozenTrial]) -> Iterator[Idea]:
        """Yield candidates drawn uniformly."""
        while True:
            yield self.uniform()


class Optunas(TreeSampler):
    """Has the numbers of a tree proposed by one of Optuna's samplers, after some trees drawn uniformly."""

    def __init__(self, space: Space, seed: int, sampler: BaseSampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler

    def ideas(self, study: Study, trial: FrozenTrial, earlier: Sequence[FrozenTrial]) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        while trial.number < FRESH:
            yield self.uniform()
        while True:
            numbers = self._sampler.sample_relative(study, trial, self.distributions)
            for name, distribution in self.distributions.items():
                if name not in numbers:
                    numbers[name] = self._sampler.sample_independent(study, trial, name, distribution)
            yield Idea(self.space.candidate_of(decoded(numbers, self.space.n)).key)


def sampler_of(name: str, space: Space, *, starts: int, seed: int) -> TreeSampler:
    """Return the sampler of a name; ValueError lists the names."""
    if name == "moves":
        return Moves(space, starts=starts, seed=seed)
    if name == "random":
        return Uniform(space, seed)
    of_optuna = seed % SEEDS
    if name == "tpe":
        return Optunas(space, seed, TPESampler(n_startup_trials=FRESH, seed=of_optuna))
    if name == "nsga2":
        return Optunas(space, seed, NSGAIISampler(population_size=FRESH, seed=of_optuna))
    raise ValueError(f"sampler must be one of moves, tpe, nsga2, random, but got {name!r}")

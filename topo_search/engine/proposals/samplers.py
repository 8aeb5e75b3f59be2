"""The ways to propose trees: uniformly, by moves from good ones, or by Optuna's own samplers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from optuna import Study
from optuna.samplers import BaseSampler, NSGAIISampler, TPESampler
from optuna.trial import FrozenTrial

from topo_search.engine.proposals.encoding import decode
from topo_search.engine.proposals.moves import Moves
from topo_search.engine.proposals.tree_sampler import FRESH, TreeSampler
from topo_search.engine.proposals.trials import Idea, violation
from topo_search.engine.space import Space
from topo_search.engine.strategy import Scored
from topo_search.model import BadInput, Fault, Topology
from topo_search.protocols import SamplerFactory, TopologySampler

SEEDS = 2**32
"""How many seeds Optuna's samplers know."""


class Uniform(TreeSampler):
    """Draws uniformly from the candidates."""

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield candidates drawn uniformly."""
        while True:
            yield self.uniform()


class Optunas(TreeSampler):
    """Has the numbers of a tree proposed by one of Optuna's samplers, after some trees drawn uniformly."""

    def __init__(self, space: Space, seed: int, sampler: BaseSampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        while trial.number < FRESH:
            yield self.uniform()
        while True:
            numbers = self._sampler.sample_relative(study, trial, self.distributions)
            for name, distribution in self.distributions.items():
                if name not in numbers:
                    numbers[name] = self._sampler.sample_independent(study, trial, name, distribution)
            yield Idea(self.space.candidate_of(decode(numbers, self.space.n)).key)


class Owned(TreeSampler):
    """Has trees proposed by a user's own sampler; what it names that is no candidate is told to the user."""

    def __init__(self, space: Space, seed: int, sampler: TopologySampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler
        self._tried: dict[int, Scored] = {}
        """What became of the trials that are over, by number."""

    def note_score(self, number: int, score: Scored) -> None:
        """Take note of what a trial led to: how far from feasible it was, where that says anything."""
        super().note_score(number, score)
        missed = violation(score) if score.status == "infeasible" else None
        self._tried[number] = replace(score, violation=missed)

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        tried = [self._tried[number] for number in sorted(self._tried)]
        while True:
            proposed = self._sampler.propose(self.space, tried, self.random)
            yield Idea(self._candidate(proposed))

    def _candidate(self, proposed: Topology | str) -> str:
        """Return the key of the candidate that stands for a proposal."""
        try:
            topology = Topology.from_key(proposed) if isinstance(proposed, str) else proposed
            if not isinstance(topology, Topology):
                raise ValueError(f"must be a Topology or a key, but got {type(topology).__name__}")
            if topology.n != self.space.n:
                raise ValueError(f"must have {self.space.n} modules, but {topology.key} has {topology.n}")
            return self.space.candidate_of(topology).key
        except ValueError as error:
            raise BadInput("sampler", [Fault(f"{type(self._sampler).__name__}.propose", str(error))]) from None


def sampler_of(
    sampler: str | SamplerFactory, space: Space, *, starts: int, seed: int, round_size: int
) -> TreeSampler:
    """Return the sampler of a name, or that a user's factory makes.

    Raises:
        ValueError: an unknown name; lists the names.
        BadInput: the factory makes no sampler.
    """
    if not isinstance(sampler, str):
        made = sampler(seed % SEEDS)
        if isinstance(made, BaseSampler):
            return Optunas(space, seed, made)
        if isinstance(made, TopologySampler):
            return Owned(space, seed, made)
        rule = f"must make an Optuna sampler, or an object with `propose`, but made {type(made).__name__}"
        raise BadInput("sampler", [Fault("", rule)])
    return _by_name(sampler, space, starts=starts, seed=seed, round_size=round_size)


def _by_name(name: str, space: Space, *, starts: int, seed: int, round_size: int) -> TreeSampler:
    if name == "moves":
        return Moves(space, starts=starts, seed=seed, round_size=round_size)
    if name == "random":
        return Uniform(space, seed)
    of_optuna = seed % SEEDS
    if name == "tpe":
        return Optunas(space, seed, TPESampler(n_startup_trials=FRESH, seed=of_optuna))
    if name == "nsga2":
        return Optunas(space, seed, NSGAIISampler(population_size=FRESH, seed=of_optuna))
    raise ValueError(f"sampler must be one of moves, tpe, nsga2, random, but got {name!r}")

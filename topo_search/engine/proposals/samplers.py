"""The ways to propose trees: uniformly, by moves from good ones, or by Optuna's own samplers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from numbers import Integral
from typing import Any, cast

from optuna import Study
from optuna.samplers import BaseSampler, NSGAIISampler, TPESampler
from optuna.trial import FrozenTrial, TrialState

from topo_search.engine.proposals.moves import Moves
from topo_search.engine.proposals.trials import FRESH, Idea, TreeSampler, decode, violation
from topo_search.engine.strategy import Scored, Space
from topo_search.model import BadInput, Fault, Topology
from topo_search.protocols import SamplerFactory, TopologySampler
from topo_search.supervisor import is_out_of_memory

SEEDS = 2**32
"""Number of seeds that Optuna's samplers know."""
FIXED = "fixed_params"
"""Optuna's key for a trial whose numbers are given: a tree that is solved again from more starts."""


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
            yield self.idea_of(numbers)

    def idea_of(self, numbers: dict[str, int]) -> Idea:
        """Return the candidate whose tree some numbers make."""
        return Idea(self.space.candidate_of(decode(numbers, self.space.n)).key)


class OwnOptunas(Optunas):
    """Has them proposed by a user's sampler from the first on, in the order in which Optuna itself calls one."""

    def before_trial(self, study: Study, trial: FrozenTrial) -> None:
        """Let the sampler prepare, if the trial is its own."""
        if FIXED in trial.system_attrs:
            return
        with _naming(self._sampler, "before_trial"):
            self._sampler.before_trial(study, trial)

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        prepared = study.get_trials(deepcopy=False)[trial.number]
        while True:
            yield self.idea_of(self._numbers(study, prepared))

    def _numbers(self, study: Study, trial: FrozenTrial) -> dict[str, int]:
        """Return what is proposed for a trial, as `before_trial` left it."""
        with _naming(self._sampler, "sample_relative"):
            known = self._sampler.infer_relative_search_space(study, trial)
            together = dict(self._sampler.sample_relative(study, trial, known))
        numbers = dict[str, int]()
        for name, distribution in self.distributions.items():
            so_far = copy(trial)
            so_far.params = dict(numbers)
            so_far.distributions = {given: self.distributions[given] for given in numbers}
            if name in together:
                value = together[name]
            else:
                with _naming(self._sampler, "sample_independent"):
                    value = self._sampler.sample_independent(study, so_far, name, distribution)
            if not isinstance(value, Integral) or value not in range(self.values[name]):
                rule = f"{name} must be one of 0, ..., {self.values[name] - 1}, but got {value!r}"
                raise BadInput("sampler", [Fault(type(self._sampler).__name__, rule)])
            numbers[name] = int(value)
        return numbers

    def after_trial(
        self, study: Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        """Tell the sampler what became of a trial, if it is its own."""
        if FIXED in trial.system_attrs:
            return
        with _naming(self._sampler, "after_trial"):
            self._sampler.after_trial(cast("Study", _Endless(study)), trial, state, values)


class _Endless:
    """A study that a sampler does not stop: when its ideas are used up, trees are drawn."""

    def __init__(self, study: Study) -> None:
        self._study = study

    def __getattr__(self, name: str) -> Any:
        return getattr(self._study, name)

    def stop(self) -> None:
        """Go on."""


class Owned(TreeSampler):
    """Has trees proposed by a user's own sampler; what it names that is no candidate is told to the user."""

    def __init__(self, space: Space, seed: int, sampler: TopologySampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler
        self._tried: dict[int, Scored] = {}
        """Results of the trials that are over, by number."""

    def note_score(self, number: int, score: Scored) -> None:
        """Take note of what a trial led to: how far from feasible it was, where that says anything."""
        super().note_score(number, score)
        missed = violation(score) if score.status == "infeasible" else None
        self._tried[number] = replace(score, violation=missed)

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        tried = [self._tried[number] for number in sorted(self._tried)]
        while True:
            with _naming(self._sampler, "propose"):
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
        made = make_own(sampler, seed)
        return OwnOptunas(space, seed, made) if isinstance(made, BaseSampler) else Owned(space, seed, made)
    if sampler == "moves":
        return Moves(space, starts=starts, seed=seed, round_size=round_size)
    if sampler == "random":
        return Uniform(space, seed)
    if sampler == "tpe":
        return Optunas(space, seed, TPESampler(n_startup_trials=FRESH, seed=seed % SEEDS))
    if sampler == "nsga2":
        return Optunas(space, seed, NSGAIISampler(population_size=FRESH, seed=seed % SEEDS))
    raise ValueError(f"sampler must be one of moves, tpe, nsga2, random, but got {sampler!r}")


def make_own(factory: SamplerFactory, seed: int) -> BaseSampler | TopologySampler:
    """Return what a user's factory makes for a seed; BadInput if it is no sampler."""
    with _naming(factory, "", "cannot make a sampler for a seed"):
        made = factory(seed % SEEDS)
    if isinstance(made, BaseSampler):
        return made
    if isinstance(made, TopologySampler) and not isinstance(made, type) and callable(made.propose):
        return made
    got = f"the class {made.__name__} itself" if isinstance(made, type) else type(made).__name__
    rule = f"must make an Optuna sampler, or an object with `propose`, but made {got}"
    raise BadInput("sampler", [Fault("", rule)])


@contextmanager
def _naming(own: object, method: str, rule: str = "raised an error") -> Iterator[None]:
    """Name a user's sampler and its method in what it raises."""
    try:
        yield
    except Exception as error:
        if is_out_of_memory(error):
            raise
        kind = getattr(own, "__qualname__", type(own).__name__)
        text = " ".join(f"{rule}: {type(error).__name__}: {error}".split())
        raise BadInput("sampler", [Fault(f"{kind}.{method}".rstrip("."), text)]) from error

"""A search that an Optuna study leads: candidates from few starts, and more starts for those that promise more.

Trees are proposed uniformly, by moves from good ones, or by Optuna's own samplers.

A candidate is proposed before the last few results are known, so that workers need not wait for each other: what
is learnt for it depends on its place among the proposals alone.

Either those that do well are given more starts at once, or the sampler proposes candidates again. That is a trial
of its own, told what all starts of the candidate led to: the value of a trial that is over cannot change.

When enough were proposed the best of all are given what is left of their starts. If every candidate was proposed
all are that may have a design, the best first, as in an exhaustive search; but designs that were carried over stay
in the places of starts.

The study is in memory and made again with the strategy; its journal is a copy for optuna-dashboard, with what the
proposals were made from.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from typing import Any, cast

import optuna
from optuna import Study
from optuna.samplers import BaseSampler, NSGAIISampler, TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState

from topo_search.engine.proposals.moves import Moves
from topo_search.engine.proposals.trials import (
    HALVING,
    IMPOSSIBLE,
    Idea,
    Rank,
    TreeSampler,
    decode,
    encode,
    goes_on,
    rank,
    steps,
    value,
    violation,
)
from topo_search.engine.strategy import (
    Candidates,
    Proposal,
    SamplerFactory,
    Stage,
    Strategy,
    TopologySampler,
    Tried,
)
from topo_search.engine.workers import rounds
from topo_search.model import BadInput, Fault, Topology
from topo_search.supervisor import is_out_of_memory

LEARNT, SHARE_LEARNT = 8, 16
"""Fewest results that the sampler learns at once, and the divisor of a large round that gives their number."""


class OptunaSearch(Strategy):
    """Solves trees that an Optuna sampler draws until there are enough, or none is left."""

    def __init__(
        self,
        space: Candidates,
        *,
        sampler: str | SamplerFactory,
        trials: int,
        round_size: int,
        starts: int,
        seed: int,
        journal: Path | None = None,
        timed: bool = False,
    ) -> None:
        """Begin a search.

        Args:
            space: the candidates.
            sampler: moves, tpe, nsga2 or random; or what makes one for a seed.
            trials: how many different candidates to propose.
            round_size: most proposals whose results are not known: the larger, the more jobs at a time, and the
                later each is learnt from.
            starts: starts of the best, or in the end of all if all are proposed; the others are given fewer.
            seed: draws the proposals.
            journal: a file that is written anew, for optuna-dashboard.
            timed: whether there is a time limit: then what is left of the starts is given in parts.

        Raises:
            ValueError: an unknown sampler.
            BadInput: what is made is no sampler; so of `ask`, where one proposes what is no candidate.
        """
        super().__init__()
        self._space, self._trials, self._round_size, self._starts = space, trials, round_size, starts
        self._proposer = sampler_of(sampler, space, starts=starts, seed=seed, round_size=round_size)
        self._study = _new_study(sampler=self._proposer)
        self._journal = None if journal is None else _new_journal(journal)
        self._stops = [part.stop for part in rounds(starts, starts, timed=timed)]
        self._ranks: dict[str, Rank] = {}
        self._had: dict[str, int] = {}
        """Starts of each candidate so far."""

    def proposals(self) -> Iterator[Proposal | None]:
        """Yield what the sampler draws, then the best again."""
        yield from self._draws()
        best = sorted((reached, key) for key, reached in self._ranks.items() if reached[0] < IMPOSSIBLE)
        most = HALVING.certain if self._trials < self._space.count() else None
        for stop in self._stops:
            short = [key for _, key in best[:most] if self._had[key] < stop]
            if not short:
                continue
            self.stage = Stage(len(short), stop, again=True)
            for key in short:
                yield Proposal(self._space.candidate_of(Topology.from_key(key)), stop)
            scores = yield from self.results(len(short))
            self._had |= {score.key: score.starts for score in scores}
            if self._journal is not None:
                again = ((_trial_again(self._study, self._proposer, score.key), score) for score in scores)
                self._journal.add_trials([_tell(self._study, trial, score) for trial, score in again])

    def _draws(self) -> Iterator[Proposal | None]:
        """Yield what the sampler draws, and more starts of what does well, if it promotes that."""
        proposer, ranks, had, starts = self._proposer, self._ranks, self._had, self._starts
        ladder = [*steps(starts, proposer.few)]
        left = min(self._trials, self._space.count())
        learnt = min(self._round_size, max(LEARNT, self._round_size // SHARE_LEARNT))
        self.stage = Stage(left, starts)
        unknown, again = deque[Drawn](), deque[Drawn]()  # those whose results are not known, and that go on
        while left or again or unknown:
            while (left or again) and len(unknown) < self._round_size:
                trial, idea = again.popleft() if again else _draw(self._study, proposer)
                left -= idea.key not in ranks
                unknown.append((trial, idea))
                next_starts = ladder[bisect_right(ladder, had.get(idea.key, 0))]
                candidate = self._space.candidate_of(Topology.from_key(idea.key))
                yield Proposal(candidate, next_starts, idea.warm_starts)
            scores = yield from self.results(min(learnt, len(unknown)))
            ranks |= {score.key: rank(score) for score in scores}
            had |= {score.key: score.starts for score in scores}
            ranking = sorted(ranks.values()) if proposer.promotes else []
            ended = []
            for score in scores:
                trial, _ = unknown.popleft()
                promoted = proposer.promotes and score.starts < starts
                if promoted and goes_on(score, ranking, bisect_right(ladder, score.starts)):
                    again.append((trial, Idea(score.key)))
                else:
                    proposer.note_score(trial.number, score)
                    ended.append(_tell(self._study, trial, score))
            if self._journal is not None:
                self._journal.add_trials(ended)


Drawn = tuple[optuna.Trial, Idea]


def _draw(study: optuna.Study, proposer: TreeSampler) -> Drawn:
    """Return the next trial with its candidate."""
    trial = study.ask(proposer.distributions)
    if not proposer.distributions:  # the only tree of one module has no numbers to draw
        proposer.note_idea(trial.number, proposer.uniform())
    idea = proposer.running[trial.number]
    trial.set_user_attr("key", idea.key)
    trial.set_user_attr("near", idea.warm_starts)
    return trial, idea


def _trial_again(study: optuna.Study, proposer: TreeSampler, key: str) -> optuna.Trial:
    """Return a trial of a candidate that is not the sampler's."""
    numbers = encode(Topology.from_key(key), proposer.connectors)
    study.enqueue_trial(dict(numbers), {"key": key, "near": ()})
    return study.ask(proposer.distributions)


def _tell(study: optuna.Study, trial: optuna.Trial, score: Tried) -> FrozenTrial:
    """Tell the study the outcome of a candidate; without a design it misses a constraint, at an infinite value."""
    trial.set_user_attr("status", score.status)
    trial.set_user_attr("starts", score.starts)
    if score.status == "failed":
        return study.tell(trial, state=TrialState.FAIL)
    trial.set_constraint("violation", violation(score))
    return study.tell(trial, value(score))


def _new_journal(path: Path) -> optuna.Study:
    """Return an empty study in a file; what is there, and the lock of a process that was killed, is removed."""
    path.unlink(missing_ok=True)
    path.with_name(f"{path.name}.lock").unlink(missing_ok=True)
    return _new_study(storage=JournalStorage(JournalFileBackend(str(path))), study_name=path.resolve().parent.name)


def _new_study(**options: Any) -> optuna.Study:
    """Return a study that is made without a message."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        return optuna.create_study(**options)
    finally:
        optuna.logging.set_verbosity(before)


SEEDS = 2**32
"""Number of seeds that Optuna's samplers know."""


class Uniform(TreeSampler):
    """Draws uniformly from the candidates."""

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield candidates drawn uniformly."""
        while True:
            yield self.uniform()


class Optunas(TreeSampler):
    """Has the numbers of a tree proposed by one of Optuna's samplers, after some trees drawn uniformly."""

    def __init__(self, space: Candidates, seed: int, sampler: BaseSampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        while trial.number < HALVING.fresh:
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
        if _is_again(trial):
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
        """Report the result of one of its own trials to the sampler."""
        if _is_again(trial):
            return
        with _naming(self._sampler, "after_trial"):
            self._sampler.after_trial(cast("Study", _Endless(study)), trial, state, values)


def _is_again(trial: FrozenTrial) -> bool:
    return (
        "fixed_params" in trial.system_attrs
    )  # a tree that is solved again from more starts: its numbers are given


class _Endless:
    """A study that a sampler does not stop: when its ideas are used up, trees are drawn."""

    def __init__(self, study: Study) -> None:
        self._study = study

    def __getattr__(self, name: str) -> Any:
        return getattr(self._study, name)

    def stop(self) -> None:
        """Go on."""


class Owned(TreeSampler):
    """Lets a user's own sampler propose trees; reports what it names that is no candidate."""

    def __init__(self, space: Candidates, seed: int, sampler: TopologySampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler
        self._tried: dict[int, Tried] = {}
        """Results of the trials that are over, by number."""

    def note_score(self, number: int, score: Tried) -> None:
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
    sampler: str | SamplerFactory, space: Candidates, *, starts: int, seed: int, round_size: int
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
        return Optunas(space, seed, TPESampler(n_startup_trials=HALVING.fresh, seed=seed % SEEDS))
    if sampler == "nsga2":
        return Optunas(space, seed, NSGAIISampler(population_size=HALVING.fresh, seed=seed % SEEDS))
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
    raise BadInput("sampler", rule)


@contextmanager
def _naming(sampler: object, method: str, rule: str = "raised an error") -> Iterator[None]:
    """Name a user's sampler and its method in what it raises."""
    try:
        yield
    except Exception as error:
        if is_out_of_memory(error):
            raise
        kind = getattr(sampler, "__qualname__", type(sampler).__name__)
        text = " ".join(f"{rule}: {type(error).__name__}: {error}".split())
        raise BadInput("sampler", [Fault(f"{kind}.{method}".rstrip("."), text)]) from error

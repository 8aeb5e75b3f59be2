"""A search guided by an Optuna study: candidates get few starts, the promising ones more.

Trees are proposed uniformly, by moves from good trees, or by Optuna's or the user's samplers.

A candidate is proposed before the latest results are known, so that workers need not wait for each other. Which
results are known to a proposal depends only on its number.

Either good candidates get more starts immediately, or the sampler proposes candidates repeatedly. Each repeat is a
trial of its own with the result of all starts of the candidate, since the value of a finished trial cannot change.

After the last proposal the best candidates get their remaining starts. If every candidate was proposed, all that
may have a design do, the best first, as in an exhaustive search, except that designs carried over have replaced
starts.

The study is in memory and recreated with the strategy; its journal is a copy for optuna-dashboard, including the
warm starts of each proposal.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from typing import Any, Literal, cast

import optuna
from optuna import Study
from optuna.samplers import BaseSampler, NSGAIISampler, TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState

from topo_search.engine.own_sampler import TopologySampler
from topo_search.engine.proposals.moves import Moves
from topo_search.engine.proposals.trials import (
    HALVING,
    IMPOSSIBLE,
    Idea,
    Rank,
    TreeSampler,
    decode,
    encode,
    is_promoted,
    rank,
    steps,
    value,
    violation,
)
from topo_search.engine.strategy import WAIT, Candidates, Proposal, SamplerFactory, Stage, Strategy, Tried
from topo_search.engine.workers import start_ranges
from topo_search.model import BadInput, Fault, Topology
from topo_search.topologies.own_topologies import own_topology

MIN_RESULTS, RESULT_DIVISOR = 8, 16
"""The sampler receives results in batches: at least MIN_RESULTS, and one in RESULT_DIVISOR of a large round."""


class OptunaSearch(Strategy):
    """Solves trees that a sampler draws until there are enough, or all are proposed."""

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
        """Set up the search.

        Args:
            space: the candidates.
            sampler: moves, tpe, nsga2 or random; or a factory that makes a sampler for a seed.
            trials: number of different candidates to propose.
            round_size: largest number of open proposals: a larger one allows more jobs at a time, but the sampler
                receives results later.
            starts: number of starts of the best candidates, or of all if all are proposed; the others get fewer.
            seed: seeds the proposals.
            journal: file for optuna-dashboard, which is recreated.
            timed: whether there is a time limit; then the remaining starts are solved in parts.

        Raises:
            BadInput: the factory makes no sampler; also later, if its sampler proposes no valid candidate.
        """
        super().__init__()
        self._space, self._trials, self._round_size, self._starts = space, trials, round_size, starts
        self._proposer = sampler_of(sampler, space, starts=starts, seed=seed, round_size=round_size)
        self._study = _new_study(sampler=self._proposer)
        self._journal = None if journal is None else _new_journal(journal)
        self._stops = deque(part.stop for part in start_ranges(starts, starts, timed=timed))
        self._ladder = [*steps(starts, self._proposer.first_starts)]
        self._remaining = min(trials, space.count())
        self._batch = min(round_size, max(MIN_RESULTS, round_size // RESULT_DIVISOR))
        self._open, self._promoted = deque[Drawn](), deque[Drawn]()
        self._repeats, self._repeated = deque[Proposal](), 0
        """Proposals of the current part of the remaining starts, and the number of those that were made."""
        self._ranks: dict[str, Rank] = {}
        self._solved_starts: dict[str, int] = {}
        """Starts of each candidate so far, by key."""
        self.stage = Stage(self._remaining, starts)

    def ask(self) -> Proposal | Literal["wait"] | None:
        """Propose what the sampler draws, then the remaining starts of the best candidates."""
        return self._ask_draw() or self._ask_repeat()

    def _ask_draw(self) -> Proposal | Literal["wait"] | None:
        """Propose what the sampler draws, and more starts of good candidates if it promotes them."""
        while len(self._open) == self._round_size or not (self._remaining or self._promoted):
            number = min(self._batch, len(self._open))
            if not number:
                return None
            if len(self._results) < number:
                return WAIT
            self._learn(self._results[:number])
            del self._results[:number]
        trial, idea = self._promoted.popleft() if self._promoted else _draw(self._study, self._proposer)
        self._remaining -= idea.key not in self._ranks
        self._open.append((trial, idea))
        starts = self._ladder[bisect_right(self._ladder, self._solved_starts.get(idea.key, 0))]
        return Proposal(self._space.candidate_of(Topology.from_key(idea.key)), starts, idea.warm_starts)

    def _learn(self, scores: Sequence[Tried]) -> None:
        """Report results to the sampler, except for candidates that get more starts first."""
        proposer, finished = self._proposer, list[FrozenTrial]()
        self._ranks |= {score.key: rank(score) for score in scores}
        self._solved_starts |= {score.key: score.starts for score in scores}
        ranking = sorted(self._ranks.values()) if proposer.promotes else []
        for score in scores:
            trial, _ = self._open.popleft()
            may_promote = proposer.promotes and score.starts < self._starts
            if may_promote and is_promoted(score, ranking, bisect_right(self._ladder, score.starts)):
                self._promoted.append((trial, Idea(score.key)))
            else:
                proposer.note_score(trial.number, score)
                finished.append(_tell(self._study, trial, score))
        if self._journal is not None:
            self._journal.add_trials(finished)

    def _ask_repeat(self) -> Proposal | Literal["wait"] | None:
        """Propose the remaining starts of the best candidates, part by part."""
        while not self._repeats:
            if len(self._results) < self._repeated:
                return WAIT
            scores, self._results, self._repeated = self._results, [], 0
            self._solved_starts |= {score.key: score.starts for score in scores}
            if self._journal is not None:
                trials = ((_enqueue_trial(self._study, self._proposer, score.key), score) for score in scores)
                self._journal.add_trials([_tell(self._study, trial, score) for trial, score in trials])
            if not self._stops:
                return None
            stop = self._stops.popleft()
            best = sorted(
                (score_rank, key) for key, score_rank in self._ranks.items() if score_rank[0] < IMPOSSIBLE
            )
            number = HALVING.finalists if self._trials < self._space.count() else None
            trees = (Topology.from_key(key) for _, key in best[:number] if self._solved_starts[key] < stop)
            self._repeats.extend(Proposal(self._space.candidate_of(tree), stop) for tree in trees)
            if self._repeats:
                self.stage = Stage(len(self._repeats), stop, is_repeat=True)
        self._repeated += 1
        return self._repeats.popleft()


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


def _enqueue_trial(study: optuna.Study, proposer: TreeSampler, key: str) -> optuna.Trial:
    """Return a trial of a given candidate, which the sampler does not draw."""
    numbers = encode(Topology.from_key(key), proposer.connectors)
    study.enqueue_trial(dict(numbers), {"key": key, "near": ()})
    return study.ask(proposer.distributions)


def _tell(study: optuna.Study, trial: optuna.Trial, score: Tried) -> FrozenTrial:
    """Report a result to the study; without a design it has an infinite value and violates a constraint."""
    trial.set_user_attr("status", score.status)
    trial.set_user_attr("starts", score.starts)
    if score.status == "failed":
        return study.tell(trial, state=TrialState.FAIL)
    trial.set_constraint("violation", violation(score))
    return study.tell(trial, value(score))


def _new_journal(path: Path) -> optuna.Study:
    path.unlink(missing_ok=True)
    path.with_name(f"{path.name}.lock").unlink(missing_ok=True)
    return _new_study(storage=JournalStorage(JournalFileBackend(str(path))), study_name=path.resolve().parent.name)


def _new_study(**options: Any) -> optuna.Study:
    """Create a study without log messages."""
    verbosity = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        return optuna.create_study(**options)
    finally:
        optuna.logging.set_verbosity(verbosity)


class Uniform(TreeSampler):
    """Draws uniformly from the candidates."""

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield candidates drawn uniformly."""
        while True:
            yield self.uniform()


class OptunaTrees(TreeSampler):
    """Draws some trees uniformly, then lets one of Optuna's samplers propose the numbers of a tree."""

    def __init__(self, space: Candidates, seed: int, sampler: BaseSampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        while trial.number < HALVING.uniform_draws:
            yield self.uniform()
        while True:
            numbers = self._sampler.sample_relative(study, trial, self.distributions)
            for name, distribution in self.distributions.items():
                if name not in numbers:
                    numbers[name] = self._sampler.sample_independent(study, trial, name, distribution)
            yield self.idea_of(numbers)

    def idea_of(self, numbers: dict[str, int]) -> Idea:
        """Return the candidate whose tree the numbers encode."""
        return Idea(self.space.candidate_of(decode(numbers, self.space.n, self.space.counts)).key)


class UserOptunaTrees(OptunaTrees):
    """Lets a user's Optuna sampler propose all trees, calling its methods in the same order as Optuna does."""

    def before_trial(self, study: Study, trial: FrozenTrial) -> None:
        """Let the sampler prepare, unless the trial was enqueued."""
        if _is_enqueued(trial):
            return
        self._sampler.before_trial(study, trial)

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        prepared = study.get_trials(deepcopy=False)[trial.number]
        while True:
            yield self.idea_of(self._numbers(study, prepared))

    def _numbers(self, study: Study, trial: FrozenTrial) -> dict[str, int]:
        """Return the sampler's proposal for a trial, as `before_trial` left it."""
        space = self._sampler.infer_relative_search_space(study, trial)
        relative = self._sampler.sample_relative(study, trial, space)
        numbers = dict[str, int]()
        for name, distribution in self.distributions.items():
            partial_trial = copy(trial)
            partial_trial.params = dict(numbers)
            partial_trial.distributions = {drawn: self.distributions[drawn] for drawn in numbers}
            if name in relative:
                value = relative[name]
            else:
                value = self._sampler.sample_independent(study, partial_trial, name, distribution)
            if not isinstance(value, Integral) or value not in range(self.values[name]):
                rule = f"{name} must be one of 0, ..., {self.values[name] - 1}, but got {value!r}"
                raise BadInput("sampler", [Fault(type(self._sampler).__name__, rule)])
            numbers[name] = int(value)
        return numbers

    def after_trial(
        self, study: Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        """Report a result to the sampler, unless the trial was enqueued."""
        if _is_enqueued(trial):
            return
        self._sampler.after_trial(cast("Study", _UnstoppableStudy(study)), trial, state, values)


def _is_enqueued(trial: FrozenTrial) -> bool:
    return "fixed_params" in trial.system_attrs


class _UnstoppableStudy:
    """A study that a sampler cannot stop: when it has nothing left to propose, trees are drawn."""

    def __init__(self, study: Study) -> None:
        self._study = study

    def __getattr__(self, name: str) -> Any:
        return getattr(self._study, name)

    def stop(self) -> None:
        """Do nothing."""


class UserTrees(TreeSampler):
    """Lets a user's `TopologySampler` propose trees; BadInput if a proposal is no candidate."""

    def __init__(self, space: Candidates, seed: int, sampler: TopologySampler) -> None:
        super().__init__(space, seed)
        self._sampler = sampler
        self._tried: dict[int, Tried] = {}
        """Results of the finished trials, by number."""

    def note_score(self, number: int, score: Tried) -> None:
        """Record the result of a trial, with a violation only if the candidate is infeasible."""
        super().note_score(number, score)
        self._tried[number] = replace(score, violation=violation(score) if score.status == "infeasible" else None)

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield what the sampler proposes."""
        tried = [self._tried[number] for number in sorted(self._tried)]
        while True:
            yield Idea(self._candidate_key(self._sampler.propose(self.space, tried, self.random)))

    def _candidate_key(self, proposed: Topology | str) -> str:
        """Return the key of a proposed tree's candidate."""
        try:
            topology = own_topology(proposed, self.space.task)
            if topology.n != self.space.n:
                raise ValueError(f"must have {self.space.n} modules, but {topology.key} has {topology.n}")
            return self.space.candidate_of(topology).key
        except ValueError as error:
            raise BadInput("sampler", [Fault(f"{type(self._sampler).__name__}.propose", str(error))]) from None


def sampler_of(
    sampler: str | SamplerFactory, space: Candidates, *, starts: int, seed: int, round_size: int
) -> TreeSampler:
    """Return the sampler with a name, or the one that a user's factory makes; BadInput if it makes none."""
    if not isinstance(sampler, str):
        made = make_user_sampler(sampler, seed)
        return UserOptunaTrees(space, seed, made) if isinstance(made, BaseSampler) else UserTrees(space, seed, made)
    if sampler == "moves":
        return Moves(space, starts=starts, seed=seed, round_size=round_size)
    if sampler == "random":
        return Uniform(space, seed)
    if sampler == "tpe":
        return OptunaTrees(space, seed, TPESampler(n_startup_trials=HALVING.uniform_draws, seed=_seed_of(seed)))
    return OptunaTrees(space, seed, NSGAIISampler(population_size=HALVING.uniform_draws, seed=_seed_of(seed)))


def make_user_sampler(factory: SamplerFactory, seed: int) -> BaseSampler | TopologySampler:
    """Return the sampler that a user's factory makes for a seed; BadInput if it is no sampler."""
    made = factory(_seed_of(seed))
    if isinstance(made, BaseSampler | TopologySampler) and not isinstance(made, type):
        return made
    got = f"the class {made.__name__} itself" if isinstance(made, type) else type(made).__name__
    rule = f"must make an Optuna sampler, or an object with `propose`, but made {got}"
    raise BadInput("sampler", rule)


def _seed_of(seed: int) -> int:
    return seed % 2**32  # the seeds that Optuna's samplers accept

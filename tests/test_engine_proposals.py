"""Every sampler keeps the contract of a strategy; moves find good trees sooner than uniform draws."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import optuna
import pytest
from optuna.samplers import BaseSampler, GridSampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from own_code import make_brute_force, make_grid, make_groups, make_qmc, make_random
from suites import few
from toy_problem import follow

from topo_search.engine.proposals import MIN_RESULTS, OptunaSearch, moves
from topo_search.engine.proposals.trials import HALVING
from topo_search.engine.strategy import Candidates, Proposal, SamplerFactory, Strategy, Tried
from topo_search.model import Topology
from topo_search.model.task_file import read_task

SAMPLERS = ("moves", "tpe", "nsga2", "random")
FIRST = {"moves": 1} | dict.fromkeys(SAMPLERS[1:], HALVING.first_starts)
"""Starts of a new tree."""
STARTS = 10

ROUND = 8

Objective = Callable[[str, int], Tried]
Search = Callable[[], Strategy]


def study_of(space: Candidates, *, round_size: int = ROUND, **options: Any) -> Search:
    return partial(OptunaSearch, space, round_size=round_size, **options)


def space(n: int, connectors: str = "aligned") -> Candidates:
    changes = (f"modules={n}", f"search.connectors={connectors}")
    return Candidates(read_task("push", changes).resolve(n), "task")


def spread(key: str) -> float:
    """Mean square distance of the modules from their centre, flat on a grid: what a tree alone fixes."""
    tree = Topology.from_key(key)
    at, turned = [np.zeros(2)], [0]
    ports = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    for (h, _, a, _), kappa in zip(tree.edges(), tree.kappas[1:], strict=True):
        at.append(at[h] + ports[(a + turned[h]) % 4])
        turned.append((turned[h] + kappa) % 4)
    return float(np.var(at, axis=0).sum())


def scored(key: str, starts: int) -> Tried:
    """Long trees are best; the very longest fail, the shortest are infeasible, and more starts help a little."""
    value = spread(key)
    if value > 0.95 * (Topology.from_key(key).n ** 2 - 1) / 12:
        return Tried(key, starts, "failed", None, None)
    if value < 0.8:
        return Tried(key, starts, "impossible", None, 0.0)
    if value < 1.0:
        return Tried(key, starts, "infeasible", None, 1.0 - value)
    return Tried(key, starts, "feasible", 10.0 / value + 0.1 / starts, None)


@dataclass
class Replayed:
    """A solver that answers by a formula, and what a search proposed to it."""

    objective: Objective
    searched: list[Proposal] = field(default_factory=list)
    known: list[int] = field(default_factory=list)
    """How many of them had been collected when each was proposed."""
    stages: list[list[Proposal]] = field(default_factory=list)
    """Proposals that come again in the end, from more starts."""
    collected: int = 0

    @property
    def proposals(self) -> list[Proposal]:
        return [*self.searched, *(proposal for stage in self.stages for proposal in stage)]

    @property
    def new(self) -> list[str]:
        """The candidates in the order in which they were first proposed."""
        return list(dict.fromkeys(p.candidate.key for p in self.proposals))

    def begin_stage(self, candidates: int, starts: int, again: bool) -> None:
        if again:
            self.stages.append([])

    def submit(self, proposal: Proposal) -> None:
        if self.stages:
            self.stages[-1].append(proposal)
        else:
            self.searched.append(proposal)
            self.known.append(self.collected)

    def results(self, number: int) -> list[Tried]:
        due = self.proposals[self.collected : self.collected + number]
        assert len(due) == number
        self.collected += number
        return [self.objective(p.candidate.key, p.starts) for p in due]


def replay(search: Search, objective: Objective = scored) -> Replayed:
    """Run a search to its end."""
    replayed = Replayed(objective)
    follow(search(), replayed)
    assert replayed.collected == len(replayed.proposals)
    return replayed


def near_ahead(replayed: Replayed) -> list[list[Proposal]]:
    """Return for each proposal those before it whose results were not told."""
    return [replayed.searched[known:place] for place, known in enumerate(replayed.known)]


@pytest.mark.parametrize("connectors", few(["any", "aligned"], 1))
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_no_start_is_proposed_twice_and_the_same_again(sampler: str, connectors: str) -> None:
    def proposed() -> Replayed:
        return replay(study_of(space(6, connectors), sampler=sampler, trials=52, starts=STARTS, seed=3))

    replayed = proposed()
    keys = [p.candidate.key for p in replayed.searched if p.starts == FIRST[sampler]]
    assert len(keys) == len(set(keys)) == 52
    met = [(p.candidate.key, p.starts) for p in replayed.proposals]
    assert len(met) == len(set(met))
    listed = {candidate.key: candidate for candidate in space(6, connectors).candidates()}
    assert all(listed[p.candidate.key] == p.candidate for p in replayed.proposals)
    assert proposed() == replayed
    other = study_of(space(6, connectors), sampler=sampler, trials=52, starts=STARTS, seed=4)
    assert replay(other).new != keys


@pytest.mark.parametrize("round_size", few([1, 20, 3, ROUND], 2))
@pytest.mark.parametrize("sampler", few(SAMPLERS, 2))
def test_no_more_than_a_round_is_unknown_and_few_results_are_learnt_at_a_time(
    sampler: str, round_size: int
) -> None:
    replayed = replay(study_of(space(6), round_size=round_size, sampler=sampler, trials=50, starts=STARTS, seed=0))
    ahead = [len(unknown) + 1 for unknown in near_ahead(replayed)]
    assert max(ahead) == round_size
    last = max(place for place, p in enumerate(replayed.searched) if p.starts == FIRST[sampler])
    full = slice(round_size, last)  # after it what is told is fewer and fewer
    learnt = {later - earlier for earlier, later in pairwise(replayed.known[full])}
    assert learnt == {0, MIN_RESULTS} or round_size < MIN_RESULTS
    assert min(ahead[full]) > round_size - MIN_RESULTS
    assert len(replayed.new) == 50


@pytest.mark.parametrize("sampler", few(SAMPLERS, 2))
def test_a_tree_is_not_proposed_again_before_its_result_is_told(sampler: str) -> None:
    replayed = replay(study_of(space(7), round_size=40, sampler=sampler, trials=200, starts=STARTS, seed=1))
    again = 0
    for proposal, unknown in zip(replayed.searched, near_ahead(replayed), strict=True):
        assert proposal.candidate.key not in {one.candidate.key for one in unknown}
        again += proposal.starts > FIRST[sampler]
    assert again > 10


@pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")
@pytest.mark.parametrize("make", [make_grid, make_brute_force, make_groups, make_qmc, make_random])
def test_a_sampler_of_optunas_is_called_as_optuna_calls_it(make: SamplerFactory) -> None:
    """From the first proposal on; what comes after its grid is used up is drawn."""
    called: list[str] = []

    def watch(name: str, plain: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            called.append(name)
            return plain(*args)

        return call

    def watched(seed: int) -> BaseSampler:
        sampler = make(seed)
        for name in ("before_trial", "infer_relative_search_space", "after_trial"):
            setattr(sampler, name, watch(name, getattr(sampler, name)))
        return sampler

    every = Candidates(read_task("push", ("modules=3",)).resolve(3), "none", rooted=True)
    replayed = replay(study_of(every, sampler=watched, trials=1000, starts=1, seed=0, round_size=4))
    assert sorted(replayed.new) == sorted(candidate.key for candidate in every.candidates())
    assert called[:2] == ["before_trial", "infer_relative_search_space"]
    assert called.count("before_trial") == called.count("after_trial") == len(replayed.searched)


def test_a_sampler_of_a_user_does_not_hear_of_trees_that_are_solved_again(tmp_path: Path) -> None:
    """Optuna's grid sampler looks for its own number in every trial that it hears of."""
    every = Candidates(read_task("push", ("modules=3",)).resolve(3), "none", rooted=True)
    grid = {"port 1": range(4), "port 2": range(3)}
    journal = tmp_path / "study.journal"
    strategy = study_of(
        every, sampler=lambda seed: GridSampler(grid, seed=seed), trials=11, starts=8, seed=0, journal=journal
    )
    replayed = replay(strategy, lambda key, starts: Tried(key, starts, "feasible", spread(key), 0.0))
    assert len(replayed.new) == 11
    assert replayed.stages


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_small_space_is_exhausted_and_the_study_ends(sampler: str) -> None:
    replayed = replay(study_of(space(5), sampler=sampler, trials=1000, starts=STARTS, seed=0))
    reached = {p.candidate.key: p.starts for p in replayed.searched}
    assert sorted(reached) == [candidate.key for candidate in space(5).candidates()]
    assert sum(starts > HALVING.first_starts for starts in reached.values()) < len(reached) / 2
    (stage,) = replayed.stages
    last = [scored(p.candidate.key, reached[p.candidate.key]) for p in stage]
    assert [s.objective or math.inf for s in last] == sorted(s.objective or math.inf for s in last)
    reached |= {p.candidate.key: p.starts for p in stage}
    may = [key for key, starts in reached.items() if scored(key, starts).status in ("feasible", "infeasible")]
    assert {reached[key] for key in may} == {STARTS}


def test_under_a_time_limit_all_get_the_starts_that_are_left_in_parts() -> None:
    for timed, stops in ((False, [STARTS]), (True, [2, 4, 8, STARTS])):
        strategy = study_of(space(6), sampler="moves", trials=1000, starts=STARTS, seed=0, timed=timed)
        replayed = replay(strategy)
        assert [{p.starts for p in part} for part in replayed.stages] == [{stop} for stop in stops]
        met = [(p.candidate.key, p.starts) for p in replayed.proposals]
        assert len(met) == len(set(met))


@pytest.mark.parametrize(("n", "seed"), [(1, 0), (2, 2**32), (4, 2**70 + 1)])
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_smallest_spaces_and_the_largest_seeds(sampler: str, n: int, seed: int) -> None:
    replayed = replay(study_of(space(n), sampler=sampler, trials=9, starts=1, seed=seed))
    listed = [candidate.key for candidate in space(n).candidates()]
    assert len(replayed.new) == min(9, len(listed))
    assert set(replayed.new) <= set(listed)


@pytest.mark.parametrize("sampler", few(SAMPLERS, 2))
def test_more_trials_go_on_with_the_same_ones(sampler: str) -> None:
    few, more, many = (
        replay(study_of(space(7), sampler=sampler, trials=trials, starts=4, seed=1)).new for trials in (37, 40, 64)
    )
    assert (len(few), many[:37]) == (37, few)
    assert many[:40] == more


@pytest.mark.parametrize("sampler", few(SAMPLERS, 2))
def test_the_best_have_all_starts_and_few_others_do(sampler: str) -> None:
    replayed = replay(study_of(space(7), sampler=sampler, trials=160, starts=24, seed=2))
    reached = {p.candidate.key: p.starts for p in replayed.proposals}
    scores = [scored(key, starts) for key, starts in reached.items()]
    feasible = sorted((s for s in scores if s.objective), key=lambda s: s.objective or 0.0)
    assert [s.starts for s in feasible[: HALVING.finalists]] == [24] * HALVING.finalists
    number = Counter(reached.values())
    assert number.keys() <= {FIRST[sampler], 2, 4, 8, 16, 24}
    assert sum(trees for starts, trees in number.items() if starts <= HALVING.first_starts) > 80
    assert HALVING.finalists <= number[24] < 40
    assert all(s.starts == FIRST[sampler] for s in scores if s.status in ("failed", "impossible"))


@pytest.mark.parametrize("round_size", few([5, 20, 1, ROUND], 1))
def test_what_is_carried_over_are_designs_that_nothing_in_flight_changes_in_place_of_new_starts(
    monkeypatch: pytest.MonkeyPatch, round_size: int
) -> None:
    monkeypatch.setattr(
        moves, "BREEDING", moves.Breeding(max_repeats=1)
    )  # the more there are, the more often one's source is another one

    def missing(key: str, starts: int) -> Tried:
        """More starts help much or not at all, so that some trees are tried again."""
        miss = min(Random(f"{key} {start}").random() for start in range(starts))
        return Tried(key, starts, "feasible", 10.0 / spread(key) * (1.0 + 0.6 * miss), None)

    new_ones = repeats = 0
    for n, seed, objective in ((7, 2, scored), (6, 0, missing), (6, 4, missing)):
        strategy = study_of(space(n), round_size=round_size, sampler="moves", trials=100, starts=STARTS, seed=seed)
        replayed = replay(strategy, objective)
        had, lent = Counter[str](), defaultdict[str, set[str]](set)
        for place, (proposal, unknown) in enumerate(zip(replayed.searched, near_ahead(replayed), strict=True)):
            key, near = proposal.candidate.key, proposal.warm_starts
            told = {one.candidate.key for one in replayed.searched[: place - len(unknown)]}
            assert told.issuperset(near)
            for one in unknown:
                assert one.candidate.key not in {key, *near}
                assert key not in one.warm_starts
            assert all(objective(source, had[source]).objective is not None for source in near)
            assert len(set(near)) == len(near) <= proposal.starts - had[key]
            assert lent[key].isdisjoint(near)
            lent[key].update(near)
            new_ones += near != () and had[key] == 0
            repeats += near != () and had[key] > 0
            had[key] = proposal.starts
    assert new_ones > 100
    assert repeats > 5


def twin_of(key: str) -> str:
    return space(8).twin_of(Topology.from_key(key)).key


def test_a_tree_whose_starts_miss_is_found_by_its_twin() -> None:
    """All but the trees with the very best objective do what they can; those two seem bad where one comes first."""
    promised = {
        candidate.key: scored(candidate.key, 4).objective or math.inf for candidate in space(8).candidates()
    }
    first, second = sorted(promised, key=lambda key: (promised[key], key))[:2]
    assert (twin_of(first), promised[first]) == (second, pytest.approx(promised[second]))

    def found(seed: int) -> bool:
        met: list[str] = []

        def objective(key: str, starts: int) -> Tried:
            if key in (first, second):
                met.append(key)
                if key == met[0]:
                    return Tried(key, starts, "feasible", 10.0, None)
            return scored(key, starts)

        replayed = replay(study_of(space(8), sampler="moves", trials=64, starts=4, seed=seed), objective)
        return {first, second} <= set(replayed.new)

    assert sum(map(found, range(3))) >= 2


@pytest.mark.parametrize(("at_first", "trials"), few([("infeasible", 96), ("feasible", 200)], 1))
def test_a_tree_whose_starts_miss_is_tried_again(at_first: str, trials: int) -> None:
    """The two trees with the very best objective seem bad from their first starts."""
    trees = sorted(space(8).candidates(), key=lambda one: scored(one.key, 4).objective or math.inf)
    hidden = {tree.key for tree in trees[:2]}

    def objective(key: str, starts: int) -> Tried:
        if key in hidden and starts <= HALVING.first_starts:
            bad = (None, 1.0) if at_first == "infeasible" else (10.0, None)
            return Tried(key, starts, at_first, *bad)
        return scored(key, starts)

    def found(sampler: str, seed: int) -> bool:
        replayed = replay(study_of(space(8), sampler=sampler, trials=trials, starts=10, seed=seed), objective)
        return any(p.candidate.key in hidden and p.starts > HALVING.first_starts for p in replayed.proposals)

    assert sum(found("moves", seed) for seed in range(3)) >= 2
    assert not any(found("random", seed) for seed in range(3))


@pytest.mark.parametrize(("round_size", "given_up"), [(ROUND, 24), (20, 44)])
@pytest.mark.parametrize(("stale", "anew"), [(8, True), (160, False)])
def test_a_population_that_finds_nothing_better_is_given_up(
    monkeypatch: pytest.MonkeyPatch, stale: int, anew: bool, round_size: int, given_up: int
) -> None:
    """The first tree is the best, and its twin follows as soon as that is known.

    When nine made since are over, as eight are learnt at a time, eight are drawn uniformly; no more of them even
    where none of these is known yet.
    """
    draw_move, sample_relative = moves.draw_move, moves.Moves.sample_relative
    moved, met = list[bool](), list[str]()

    def counted(*options: Any) -> Any:
        moved[-1] = True
        return draw_move(*options)

    def watched(*options: Any) -> dict[str, Any]:
        moved.append(False)
        return sample_relative(*options)

    def objective(key: str, starts: int) -> Tried:
        met.append(key)
        return Tried(key, starts, "feasible", 1.0 if key == met[0] else 2.0, None)

    monkeypatch.setattr(moves, "BREEDING", moves.Breeding(patience=stale))
    monkeypatch.setattr(moves, "draw_move", counted)
    monkeypatch.setattr(moves.Moves, "sample_relative", watched)
    trials = given_up + 24
    replay(study_of(space(8), round_size=round_size, sampler="moves", trials=trials, starts=1, seed=0), objective)
    since = given_up - round_size - 1
    assert moved[: given_up + 16] == [False] * (round_size + 1) + [True] * since + [not anew] * 8 + [True] * 8


def test_moves_find_better_trees_than_uniform_draws() -> None:
    def best(sampler: str, seed: int) -> float:
        keys = replay(study_of(space(10), sampler=sampler, trials=96, starts=4, seed=seed)).new
        return min(scored(key, 4).objective or math.inf for key in keys)

    assert max(best("moves", seed) for seed in range(3)) < min(best("random", seed) for seed in range(3))


def test_the_journal_holds_every_trial_and_is_written_anew(tmp_path: Path) -> None:
    journal = tmp_path / "study.journal"
    journal.write_text("torn by a kill")
    (tmp_path / "study.journal.lock").symlink_to(journal)
    replayed = replay(study_of(space(6), sampler="moves", trials=3 * ROUND, starts=4, seed=0, journal=journal))
    storage = JournalStorage(JournalFileBackend(str(journal)))
    study = optuna.load_study(study_name=None, storage=storage)
    assert list(dict.fromkeys(trial.user_attrs["key"] for trial in study.trials)) == replayed.new
    for trial in study.trials:
        score = scored(trial.user_attrs["key"], trial.user_attrs["starts"])
        assert trial.user_attrs["status"] == score.status
        assert trial.value == (None if score.status == "failed" else score.objective or float("inf"))
    told = [scored(p.candidate.key, p.starts) for p in replayed.proposals]
    assert study.best_value == min(score.objective or math.inf for score in told)

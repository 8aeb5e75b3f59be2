"""Proposals by moves from the best trees so far, of which a surrogate chooses the most promising."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence, Set
from functools import lru_cache
from itertools import groupby, islice
from typing import NamedTuple

import numpy as np
from optuna import Study
from optuna.trial import FrozenTrial, TrialState

from topo_search.engine.proposals.descriptors import descriptors
from topo_search.engine.proposals.promotion import steps
from topo_search.engine.proposals.surrogate import Surrogate
from topo_search.engine.proposals.tree_sampler import (
    FRESH,
    KEY,
    NEAR,
    STARTS,
    STATUS,
    Idea,
    TreeSampler,
    has_design,
    merit,
)
from topo_search.engine.space import Space
from topo_search.model import Topology
from topo_search.model.arrays import Array
from topo_search.topologies.tree_moves import draw_move, graft

PARENTS = 8
"""The best of a population have children; the others are replaced."""
CHILDREN = 32
"""Trees made by moves of which, with the random candidates, the most promising is proposed."""
RANDOM_CANDIDATES = 16
"""Trees drawn uniformly beside them: the best tree need not look like others that are good."""
STALE = 160
"""A population is given up when so many trials after its best, of new trees or old ones, are no better."""
RELUCTANCE = {"feasible": 1.0, "infeasible": 0.0}
"""By how much more than a new tree another chance must promise, in standard deviations of what is known.

It is one more for every time that the tree had more starts. One start without a design says little.
"""
REPEATS = 2
"""Most trees of a round that are tried again."""
RELATIVES = 32
"""Moves from a tree by which solved ones are looked for to start from; of large trees they find few."""
KEPT = 1 << 14
"""Moves whose candidates are kept: the same ones are drawn again and again."""
BATCHES = 2
"""How often trees are drawn before it is said that all are known."""


class _Chance(NamedTuple):
    """What may be proposed, and how much it promises."""

    bound: float
    key: str
    again: bool


class _Known(NamedTuple):
    """What is learnt from the trials that are over."""

    solved: list[FrozenTrial]
    """The best trial of each candidate, in the order of their merit."""
    surrogate: Surrogate
    designs: dict[str, int]
    """Keys of the candidates with a design, the best first, and their places."""
    again: list[_Chance]
    """Solved trees from more starts."""
    twins: list[_Chance]
    """Twins of solved trees."""


class Moves(TreeSampler):
    """Makes trees from the best of a population by single moves, and begins anew when that leads nowhere.

    Of several such trees and some drawn uniformly it proposes the one that promises most by what was solved so far,
    from one start. That may miss what a tree can do, so solved trees compete with new ones for more starts: they
    promise what the others tell of them, and less for every time that they had more. Twins, two trees that differ
    in the sense of all rotors alone, are about as good as each other: one of them is proposed, and the other one is
    another chance of it, or follows at once if the first is the best of all. Where no new tree is in sight nothing
    is tried again before all are tried. Each time a tree is tried a design takes the place of the next start, if
    there is one that it did not start from before: a child's from its parent, or else one of a solved tree a move
    away; the best's twin has the best's.
    """

    few = 1
    promotes = False

    def __init__(self, space: Space, *, starts: int, seed: int) -> None:
        """Begin a search that gives a tree no more than so many starts."""
        super().__init__(space, seed)
        self._steps = [*steps(starts, self.few)]
        self._first = 0
        """The first trial of the present population."""
        self._described: dict[str, Array] = {}
        """Descriptors of candidates, by key."""
        self._led_to = lru_cache(KEPT)(lambda tree, move: space.key_of(graft(tree, *move)))
        """Returns the key of the candidate that a move leads to."""
        self._twins: dict[str, str] = {}
        """Key of the candidate that differs in the sense of all rotors alone, by key."""
        self._latest: tuple[int, _Known] | None = None
        """What was learnt last, after the number of trials that it was learnt from."""

    def ideas(self, study: Study, trial: FrozenTrial, earlier: Sequence[FrozenTrial]) -> Iterator[Idea]:
        """Yield candidates drawn uniformly for a new population, then what promises most, if anything does."""
        over = [other for other in earlier if other.state == TrialState.COMPLETE]
        while not over:
            yield self.uniform()
        known = self._learn(over)
        best = [other for other in known.solved if other.number >= self._first][:PARENTS]
        if best and trial.number - best[0].number > STALE:
            self._first = trial.number
        while trial.number < self._first + FRESH or not best:
            yield self.uniform()
        # A round begins with the best's twin, so the best is not tried again beside it.
        for key in islice(known.designs, 1):
            yield Idea(self._twin(key), (key,))
        proposed = {other.user_attrs[KEY] for other in earlier}
        failed = {other.user_attrs[KEY] for other in earlier if other.state == TrialState.FAIL}
        settled = proposed | set(map(self._twin, proposed - failed))
        # What one job of a round carries over must not be what another one extends: which ends first is chance.
        round_so_far = [other for other in earlier if other.state == TrialState.RUNNING]
        running = {other.user_attrs[KEY] for other in round_so_far}
        lent = running.union(*(other.user_attrs[NEAR] for other in round_so_far))
        repeats = {other.user_attrs[KEY] for other in over} & running
        again = [one for one in known.again if one.key not in lent | failed] if len(repeats) < REPEATS else []
        twins = [one for one in known.twins if one.key not in proposed]
        for _ in range(BATCHES):
            parents: dict[str, str | None] = {}
            for key, parent in self._draw(best):
                if key not in settled:
                    parents.setdefault(key, parent)
            bounds = (
                known.surrogate.lower_confidence_bounds(self._descriptors([*parents])) if parents else np.empty(0)
            )
            new = [_Chance(bound, key, again=False) for bound, key in zip(bounds.tolist(), parents, strict=True)]
            for _, key, repeat in sorted([*new, *twins, *(again if new else [])]):
                had = (other.user_attrs[NEAR] for other in earlier if other.user_attrs[KEY] == key)
                yield Idea(key, self._warm_start(known.designs, key, parents.get(key), running.union(*had)), repeat)

    def _draw(self, best: Sequence[FrozenTrial]) -> Iterator[tuple[str, str | None]]:
        """Yield keys: children of the best trees, each with its parent, and random candidates."""
        keys: list[str] = [trial.user_attrs[KEY] for trial in best]
        trees = [Topology.from_key(key) for key in keys]
        for _ in range(CHILDREN):
            place = min(self.random.choices(range(len(best)), k=2))
            yield self._move(trees[place]), keys[place]
        for _ in range(RANDOM_CANDIDATES):
            yield self.uniform().key, None

    def _move(self, tree: Topology) -> str:
        """Return the key of a candidate that one move leads to."""
        return self._led_to(tree, draw_move(tree, self.random, self.connectors))

    def _learn(self, over: Sequence[FrozenTrial]) -> _Known:
        """Return what trials, at least one, in the order of their numbers tell; one answer serves a round."""
        if self._latest is None or self._latest[0] != len(over):
            solved = _best_of_each(over)
            keys = [trial.user_attrs[KEY] for trial in solved]
            # By how much trees without a design miss one says little of how good they can be, and would spread the
            # ranking where no good tree is: they stand alike, as long as one tree has a design.
            by_objective = has_design(solved[0])
            alike = groupby(map(merit, solved), key=lambda one: one.objective if by_objective else one.violation)
            places = [place for place, (_, merits) in enumerate(alike) for _ in merits]
            surrogate = Surrogate(self._descriptors(keys), places)
            designs = {
                key: place for place, (key, trial) in enumerate(zip(keys, solved, strict=True)) if has_design(trial)
            }
            again, twins = self._chances(over, solved[surrogate.kept], surrogate.leave_one_out_bounds().tolist())
            self._latest = len(over), _Known(solved, surrogate, designs, again, twins)
        return self._latest[1]

    def _chances(
        self, over: Sequence[FrozenTrial], solved: Sequence[FrozenTrial], bounds: Sequence[float]
    ) -> tuple[list[_Chance], list[_Chance]]:
        """Return other chances of solved trees: themselves where starts are left, and their twins."""
        starts = {trial.user_attrs[KEY]: trial.user_attrs[STARTS] for trial in over}
        again, twins = list[_Chance](), list[_Chance]()
        for trial, bound in zip(solved, bounds, strict=True):
            key, status = trial.user_attrs[KEY], trial.user_attrs[STATUS]
            if status in RELUCTANCE:
                more = bisect_left(self._steps, starts[key])
                promise = bound + RELUCTANCE[status] + more
                twins.append(_Chance(promise, self._twin(key), again=False))
                if more + 1 < len(self._steps):
                    again.append(_Chance(promise, key, again=True))
        return again, twins

    def _warm_start(
        self, designs: Mapping[str, int], key: str, parent: str | None, without: Set[str]
    ) -> tuple[str, ...]:
        """Return whose design a tree starts from: a child its parent's, others the best a move away, if any is."""
        if parent is not None and parent in designs and parent not in without:
            return (parent,)
        tree = Topology.from_key(key)
        relatives = {self._move(tree) for _ in range(RELATIVES)} & designs.keys() - without - {key}
        return tuple(sorted(relatives, key=designs.__getitem__)[:1])

    def _twin(self, key: str) -> str:
        """Return the key of a candidate's twin."""
        if key not in self._twins:
            self._twins[key] = self.space.twin_of(Topology.from_key(key)).key
        return self._twins[key]

    def _descriptors(self, keys: Sequence[str]) -> Array:
        """Return the descriptors of candidates, a row each."""
        new = [key for key in keys if key not in self._described]
        if new:
            self._described |= zip(new, descriptors([*map(Topology.from_key, new)]), strict=True)
        return np.array([self._described[key] for key in keys])


def _best_of_each(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    """Return the trial of each candidate with the best merit, in the order of their merit."""
    best: dict[str, FrozenTrial] = {}
    for trial in sorted(trials, key=merit):
        best.setdefault(trial.user_attrs[KEY], trial)
    return [*best.values()]

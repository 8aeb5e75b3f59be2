"""Proposals by moves from the best trees so far, of which a forecast chooses the most promising."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from itertools import groupby, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from optuna import Study
from optuna.trial import FrozenTrial, TrialState

from topo_search.engine.proposals.descriptors import descriptors
from topo_search.engine.proposals.forecast import Forecast
from topo_search.engine.proposals.tree_sampler import FRESH, KEY, Child, TreeSampler, has_design, standing
from topo_search.engine.space import Space
from topo_search.model import Topology
from topo_search.topologies.tree_moves import neighbour

Array = NDArray[np.float64]

PARENTS = 8
"""The best of a population have children; the others are replaced."""
CHILDREN = 32
"""Trees made by moves of which, with the strangers, the most promising is proposed."""
STRANGERS = 16
"""Trees drawn uniformly beside them: the best tree need not look like others that are good."""
STALE = 160
"""A population is given up when so many trials after its best are no better."""
RELUCTANCE = 1.0
"""By how much more than a new tree a twin must promise, in standard deviations of what is known."""
DONORS = 2
"""Designs that a tree starts from: its parent's, then the best of those of other solved trees a move away."""
RELATIVES = 32
"""Moves from a tree by which such trees are looked for; of large ones they find few."""
BATCHES = 2
"""How often trees are drawn before it is said that all are known."""


class _Known(NamedTuple):
    """What is learnt from the trials that are over."""

    forecast: Forecast
    designs: dict[str, int]
    """Keys of the candidates with a design, the best first, and their places."""
    twins: list[tuple[float, str]]
    """What twins of solved trees promise, and their keys."""


class Moves(TreeSampler):
    """Makes trees from the best of a population by single moves, and begins anew when that leads nowhere.

    Of several such trees and some drawn uniformly it proposes the one that promises most by what was solved so far.
    Twins, two trees that differ in the sense of all rotors alone, are about as good as each other, so it proposes
    one of them. The other one follows if the first is the best of all, or if that fell so far short of what was
    promised that its few starts may have missed what it can do. In place of its first starts a tree is given
    designs of its parent and of solved trees a move away, as far as there are any; the best's twin has the best's.
    """

    def __init__(self, space: Space, seed: int) -> None:
        super().__init__(space, seed)
        self._first = 0
        """The first trial of the present population."""
        self._described: dict[str, Array] = {}
        """Descriptors of candidates, by key."""
        self._twins: dict[str, str] = {}
        """Key of the candidate that differs in the sense of all rotors alone, by key."""
        self._latest: tuple[int, _Known] | None = None
        """What was learnt last, after the number of trials that it was learnt from."""

    def drawn(self, study: Study, trial: FrozenTrial, proposed: Set[str]) -> Iterator[Child]:
        """Yield trees drawn uniformly for a new population, then what promises most, if anything does."""
        solved = sorted(study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)), key=standing)
        best = [other for other in solved if other.number >= self._first][:PARENTS]
        if best and trial.number - best[0].number > STALE:
            self._first = trial.number
        while trial.number < self._first + FRESH or not best:
            yield self.uniform(), ()
        known = self._learnt(solved)
        for key in islice(known.designs, 1):
            yield Topology.from_key(self._twin(key)), (key,)
        failed = {other.user_attrs[KEY] for other in study.get_trials(deepcopy=False, states=(TrialState.FAIL,))}
        settled = proposed | set(map(self._twin, proposed - failed))
        twins = [(hope, key) for hope, key in known.twins if key not in proposed]
        for _ in range(BATCHES):
            parents: dict[str, str | None] = {}
            for key, parent in self._drawn(best):
                if key not in settled:
                    parents.setdefault(key, parent)
            hopes = known.forecast.hopes(self._descriptors([*parents])) if parents else np.empty(0)
            for _, key in sorted([*zip(hopes.tolist(), parents, strict=True), *twins]):
                yield Topology.from_key(key), self._donors(known, key, parents.get(key))

    def _drawn(self, best: Sequence[FrozenTrial]) -> Iterator[tuple[str, str | None]]:
        """Yield keys: children of the best, more of the better ones, each with its parent, and strangers."""
        keys: list[str] = [trial.user_attrs[KEY] for trial in best]
        trees = [Topology.from_key(key) for key in keys]
        for _ in range(CHILDREN):
            place = min(self.random.choices(range(len(best)), k=2))
            yield self._moved(trees[place]), keys[place]
        for _ in range(STRANGERS):
            yield self.uniform().key, None

    def _moved(self, tree: Topology) -> str:
        """Return the key of a candidate that one move leads to."""
        return self.space.candidate_of(neighbour(tree, self.random, self.connectors)).key

    def _learnt(self, solved: Sequence[FrozenTrial]) -> _Known:
        """Return what trials in the order of their standing tell; one answer serves a round."""
        if self._latest is None or self._latest[0] != len(solved):
            keys = [trial.user_attrs[KEY] for trial in solved]
            described = self._descriptors(keys)
            equal = groupby(solved, key=lambda trial: standing(trial)[:2])
            places = [place for place, (_, trials) in enumerate(equal) for _ in trials]
            forecast = Forecast(described, places)
            designs = {
                key: place for place, (key, trial) in enumerate(zip(keys, solved, strict=True)) if has_design(trial)
            }
            second = [
                (float(hope) + RELUCTANCE, self._twin(trial.user_attrs[KEY]))
                for hope, trial in zip(forecast.missed(), solved[forecast.kept], strict=True)
                if hope < np.inf and trial.user_attrs["status"] != "impossible"
            ]
            self._latest = len(solved), _Known(forecast, designs, second)
        return self._latest[1]

    def _donors(self, known: _Known, key: str, parent: str | None) -> tuple[str, ...]:
        """Return whose designs a tree starts from: its parent's first, if it has one."""
        tree = Topology.from_key(key)
        relatives = {self._moved(tree) for _ in range(RELATIVES)} - {key, parent}
        ranked = sorted(relatives & known.designs.keys(), key=known.designs.__getitem__)
        return tuple(donor for donor in (parent, *ranked) if donor in known.designs)[:DONORS]

    def _twin(self, key: str) -> str:
        """Return the key of a candidate's twin."""
        if key not in self._twins:
            candidate = self.space.candidate_of(Topology.from_key(key))
            self._twins[key] = self.space.twin_of(candidate).key
        return self._twins[key]

    def _descriptors(self, keys: Sequence[str]) -> Array:
        """Return the descriptors of candidates, a row each."""
        for key in keys:
            if key not in self._described:
                self._described[key] = descriptors(Topology.from_key(key))
        return np.array([self._described[key] for key in keys])

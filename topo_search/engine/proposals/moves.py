"""Proposals by moves from the best trees so far; a surrogate selects the most promising ones.

A move changes a tree: a part is cut off and grafted elsewhere, a connector's parity is flipped, or two modules of
different types exchange their types. A module that is cut off keeps its type.

| symbol | meaning | range |
|---|---|---|
| i | module that is cut off, with everything beyond it: the part | 1..n-1 |
| (h, a) | port a of module h to which the part is grafted; h is not in the part | |
| kappa[i] | quarter turns of module i about its z axis relative to the aligned joint | 0..3 |
| shift | quarter turns by which all ports of the part advance: a' - a - (change of kappa[i]) | 0..3 |

Advancing all ports of the part by the same number preserves its inner joints: spins change only in the part as a
whole, and only with the parity of kappa[i]. A part of one module is a leaf; moves of leaves alone lead from any
aligned tree to any other of the same size.

The surrogate predicts the rank of an unsolved tree among the solved ones by Gaussian process regression on its
descriptors, which describe the tree lying flat.

| symbol | meaning | shape, unit |
|---|---|---|
| c | centres of the modules with all hinge angles zero, from their mean | (k, n, 2), 2 l_c |
| N = n c | the same as integers, so that congruent trees have bitwise equal descriptors | (k, n, 2) |
| M = c^T c / n | second moments xx, xy, yy; its eigenvalues are the squares of half axes | (k, 2, 2) |
| z | number of joints of each module | (k, n) |
| s | spin of each module relative to the root's, +1 or -1 | (k, n) |
| e, f | directed joints, each joint in both directions; f follows e if it starts where e ends | m = 2 (n - 1) |
| A_p | whether f follows e with its hinge axis parallel (p = 0) or perpendicular (p = 1) to that of e | (k, m, m) |

The pattern of a path of joints says which hinge axes are perpendicular to the previous one. It determines the
relative orientations that the modules can have. Mirroring a part at its joint preserves all patterns, and trees
that differ only by that are often about equally good.

The descriptors are invariant under rotations, reflections and the choice of the root.

The regression:

| symbol | meaning | shape |
|---|---|---|
| X | descriptors of the m solved trees, columns of mean 0 and deviation 1 | (m, d) |
| y | ranks of the solved trees, as normal scores of mean 0 and deviation 1 | (m,) |
| k(x, x') | prior covariance: exp(-|x - x'|^2 / 4 d) + linear (1 + x.x' / d) | |
| K | k(X, X) + noise I | (m, m) |

The prediction for a tree x has the mean k(x, X) K^-1 y and the variance k(x, x) - k(x, X) K^-1 k(X, x) [1]. The
first term of k models similar trees, the second one trends; the mean of |x - x'|^2 over all pairs is 2 d. Ranks,
unlike objectives, need no unit, and no value for a tree without a design; tied trees share their mean rank. The
prediction for solved tree i from all others has the mean y_i - (K^-1 y)_i / (K^-1)_ii and, including the noise, the
variance 1 / (K^-1)_ii [2].

[1] C. E. Rasmussen, C. K. I. Williams, "Gaussian processes for machine learning", MIT Press (2006), eq. 2.23-2.24.
[2] The same, eq. 5.12.
"""

import math
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from heapq import merge
from itertools import groupby, islice, product
from random import Random
from typing import NamedTuple

import numpy as np
from optuna import Study
from optuna.trial import FrozenTrial
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist
from scipy.special import ndtri

from topo_search.engine.proposals.trials import HALVING, Idea, Merit, TreeSampler, steps
from topo_search.engine.strategy import Candidates, Tried
from topo_search.model import PORT_DIRECTIONS, Array, Indices, Topology
from topo_search.topologies.rooted import Connectors

PATTERNS = tuple(
    pattern
    for length in range(1, 4)  # paths of two to four joints
    for pattern in product((0, 1), repeat=length)
    if pattern <= pattern[::-1]  # a path and its reverse count once
)


@dataclass(frozen=True)
class Regression:
    """Settings of the regression, for normal scores."""

    linear: float = 0.1
    """Variance of the trends."""
    noise: float = 0.6
    """Variance of the result of one start."""
    optimism: float = 2.0
    """Standard deviations between the mean and the lower confidence bound."""
    max_trees: int = 500
    """Number of solved trees above which only every second, third, ... of their ranking is used."""


REGRESSION = Regression()


class Flat(NamedTuple):
    """Trees of one size, lying flat on a grid."""

    parent: Indices
    """Parents of all modules except the root, shape (k, n - 1)."""
    cells: Indices
    """Cells of the modules, from the root, shape (k, n, 2)."""
    quarters: Indices
    """Quarter turns of the modules relative to the root, shape (k, n)."""
    axis: Indices
    """Directions of the hinge axes, up to a half turn: 0 or 1, shape (k, n - 1)."""


def descriptors(topologies: Sequence[Topology]) -> Array:
    """Return the descriptors of k >= 1 trees of one size, shape (k, 12 + number of PATTERNS), and 3 for each type.

    They are: both eigenvalues of M; the number of modules in an occupied cell; the number of pairs in adjacent
    cells that are not bolted together; the numbers of modules with one, two and more joints; the absolute sum of
    the spins; the path lengths between all pairs of modules, summed and divided by n; the number of modules without
    a counterpart under a half turn about the mean of the centres, and under the best mirror along rows, columns or
    diagonals; the skewness |sum c |c|^2| / n; the number of paths with each pattern; and of the modules of each
    type the mean of |c|^2, the length of the mean of c, and the mean number of joints.
    """
    flat = _lay_flat(topologies)
    cells = flat.cells
    k, n, _ = cells.shape
    z = np.ones((k, n), dtype=int)
    z[:, 0] = 0
    np.add.at(z, (np.arange(k)[:, None], flat.parent), 1)
    s = 1 - 2 * (flat.quarters % 2)
    N = n * cells - cells.sum(axis=1, keepdims=True)
    (xx, xy), (_, yy) = np.einsum("kia,kib->abk", N, N) / n**3
    middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    distances = np.abs(cells[:, :, None] - cells[:, None]).sum(axis=3)
    stacked = np.tril(distances == 0, -1).any(axis=2).sum(axis=1)
    adjacent = np.tril(distances == 1).sum(axis=(1, 2)) - (n - 1)
    skewness = np.einsum("kia,kib,kib->ka", N, N, N) / n**4
    columns = [
        *(middle - half, middle + half),
        *(stacked, adjacent, (z == 1).sum(axis=1), (z == 2).sum(axis=1), (z > 2).sum(axis=1)),
        np.abs(s.sum(axis=1)),
        _path_lengths(flat.parent) / n,
        *_asymmetry(N),
        np.hypot(*skewness.T),
        *_count_patterns(flat),
        *_describe_types(np.array([topology.types for topology in topologies], dtype=int), N, z),
    ]
    return np.stack(columns, axis=1).astype(float)


def _lay_flat(topologies: Sequence[Topology]) -> Flat:
    """Return the trees with all hinge angles zero."""
    joints = np.array([topology.joints for topology in topologies])
    k, n, _ = joints.shape
    parent, a, b = joints[:, 1:].transpose(2, 0, 1)
    trees, directions = np.arange(k), PORT_DIRECTIONS[:, :2].astype(int)
    cells, quarters = np.zeros((k, n, 2), dtype=int), np.zeros((k, n), dtype=int)
    axis = np.zeros((k, n - 1), dtype=int)
    for joint, h in enumerate(parent.T):
        direction = (a[:, joint] + quarters[trees, h]) % 4
        cells[:, joint + 1] = cells[trees, h] + directions[direction]
        quarters[:, joint + 1] = quarters[trees, h] + (a[:, joint] + 2 - b[:, joint]) % 4
        axis[:, joint] = direction % 2
    return Flat(parent, cells, quarters, axis)


def _path_lengths(parent: Indices) -> Indices:
    """Return the Wiener indices: each joint is on the paths between the modules on its two sides."""
    k, joints = parent.shape
    subtree_sizes = np.ones((k, joints + 1), dtype=int)
    for i in range(joints, 0, -1):
        subtree_sizes[np.arange(k), parent[:, i - 1]] += subtree_sizes[:, i]
    sizes = subtree_sizes[:, 1:]
    return np.asarray((sizes * (joints + 1 - sizes)).sum(axis=1))


def _count_patterns(flat: Flat) -> list[Array]:
    """Return the number of paths with each of the PATTERNS: 1^T A_p A_q ... 1, which counts a palindrome twice."""
    child = np.broadcast_to(np.arange(1, flat.parent.shape[1] + 1), flat.parent.shape)
    start, end = np.hstack([flat.parent, child]), np.hstack([child, flat.parent])
    axis = np.hstack([flat.axis, flat.axis])
    follows = (end[:, :, None] == start[:, None]) & (start[:, :, None] != end[:, None])
    perpendicular = axis[:, :, None] != axis[:, None]
    A = ((follows & ~perpendicular).astype(float), (follows & perpendicular).astype(float))
    counts = []
    for pattern in PATTERNS:
        paths = np.ones((*axis.shape, 1))
        for p in reversed(pattern):
            paths = A[p] @ paths
        counts.append(paths.sum(axis=(1, 2)) / (2 if pattern == pattern[::-1] else 1))
    return counts


def _asymmetry(points: Indices) -> tuple[Indices, Indices]:
    """Return the number of points (k, n, 2) without a counterpart under a half turn, and under the best mirror."""
    x, y = points[..., 0], points[..., 1]
    images = ((-x, -y), (x, -y), (-x, y), (y, x), (-y, -x))
    turn, *mirrors = (
        (~((u[:, :, None] == x[:, None]) & (v[:, :, None] == y[:, None])).any(axis=2)).sum(axis=1)
        for u, v in images
    )
    return turn, np.min(mirrors, axis=0)


def _describe_types(types: Indices, N: Indices, z: Indices) -> Iterator[Array]:
    """Yield where the modules of each type are; types: shape (k, n), or (k, 0) without types."""
    n = N.shape[1]
    for kind in range(types.max(initial=-1) + 1):
        own = (types == kind).astype(int)
        number = own.sum(axis=1)
        yield (own * (N * N).sum(axis=2)).sum(axis=1) / (number * n**2)
        yield np.hypot(*np.einsum("ki,kia->ak", own, N)) / (number * n)
        yield (own * z).sum(axis=1) / number


class Surrogate:
    """The regression on the solved trees."""

    def __init__(self, described: Array, ranks: Sequence[int]) -> None:
        """Fit the regression.

        Args:
            described: descriptors of the solved trees in ascending order of rank, shape (m, d).
            ranks: their ranks from 0 on, equal for tied trees.
        """
        self.subset = slice(None, None, math.ceil(len(described) / REGRESSION.max_trees))
        """Slice of the solved trees that are used."""
        described, ranks = described[self.subset], ranks[self.subset]
        self._mean, self._scale = described.mean(axis=0), _deviation(described)
        self._X = self._standardize(described)
        counts = np.bincount(ranks)
        y = ndtri((np.cumsum(counts) - 0.5 * counts)[ranks] / len(ranks))
        self._y = (y - y.mean()) / _deviation(y)
        self._K = cho_factor(_covariance(self._X, self._X) + REGRESSION.noise * np.eye(len(self._X)))
        self._weights = cho_solve(self._K, self._y)

    def lower_confidence_bounds(self, described: Array) -> Array:
        """Return the lower confidence bounds of the scores of trees, shape (k,).

        Args:
            described: descriptors of the trees, shape (k, d).
        """
        X = self._standardize(described)
        covariance = _covariance(X, self._X)
        prior = 1.0 + REGRESSION.linear * (1.0 + np.mean(X * X, axis=1))
        variance = prior - np.sum(covariance * cho_solve(self._K, covariance.T).T, axis=1)
        return np.asarray(covariance @ self._weights - REGRESSION.optimism * np.sqrt(np.maximum(variance, 0.0)))

    def leave_one_out_bounds(self) -> Array:
        """Return the bounds of the solved trees in `subset`, each predicted from all others."""
        diagonal = np.diag(cho_solve(self._K, np.eye(len(self._y))))
        expected = self._y - self._weights / diagonal
        variance = np.maximum(1.0 / diagonal - REGRESSION.noise, 0.0)
        return np.asarray(expected - REGRESSION.optimism * np.sqrt(variance))

    def _standardize(self, described: Array) -> Array:
        return np.asarray((described - self._mean) / self._scale)


def _covariance(X: Array, Y: Array) -> Array:
    """Return k for all pairs of rows, shape (rows of X, rows of Y)."""
    d = X.shape[1]
    distances = cdist(X, Y, "sqeuclidean")
    return np.asarray(np.exp(-distances / (4 * d)) + REGRESSION.linear * (1.0 + X @ Y.T / d))


def _deviation(values: Array) -> Array:
    deviation = values.std(axis=0)
    return np.where(deviation > 0, deviation, 1.0)


@dataclass(frozen=True)
class Breeding:
    """Settings of the search by moves."""

    parents: int = 8
    """Number of best trees of a population that have children."""
    children: int = 32
    """Number of trees drawn by moves, of which, with the random trees, the most promising one is proposed."""
    random_trees: int = 16
    """Number of trees drawn uniformly: the best tree need not resemble other good ones."""
    patience: int = 160
    """Number of trials without an improvement after which a population is replaced."""
    max_repeats: float = 1 / 4
    """Largest share of the open proposals that repeat a candidate."""
    warm_start_moves: int = 32
    """Number of random moves from a tree in search of a solved one to start from; few succeed for large trees."""
    cached_moves: int = 1 << 14
    """Number of moves whose candidates are cached, since the same moves are drawn many times."""
    many_open: int = 64
    """Number of open proposals from which workers wait for proposals."""
    many_starts: int = 4
    """Number of first starts of a tree in that case.

    With twelve modules and ten wrenches a proposal takes 4 ms, a tree 0.2 s from one start and 0.5 s from four,
    including the deep retry of trees without a design (`tests/benchmarks/rounds.py`).
    """
    redrawn: float = 1 / 8
    """Share of the trees that is drawn again for each further proposal from the same results.

    The earlier draws remain valid. Drawing all again takes more than twice as long.
    """
    attempts: int = 2
    """Number of attempts to draw a new tree."""


BREEDING = Breeding()


class _Option(NamedTuple):
    """Possible proposal with its lower confidence bound."""

    bound: float
    key: str
    is_repeat: bool


class _Knowledge(NamedTuple):
    """Results of the completed trials, sorted for new proposals."""

    solved: tuple[Merit, ...]
    """The best trial of each candidate, in ascending order."""
    surrogate: Surrogate
    designs: dict[str, int]
    """Keys of the candidates with a design, best first, with their ranks."""
    repeats: list[_Option]
    """Solved trees with remaining starts, most promising first."""
    twins: list[_Option]
    """Twins of solved trees, most promising first."""


class Moves(TreeSampler):
    """Proposes moves from the best trees of a population, and restarts when they no longer improve.

    Of several such trees and some drawn uniformly it proposes the one with the best confidence bound, from one
    start, or from a few if many proposals may be open. One start may not show what a tree can do, so solved trees
    compete with new ones for more starts: with the bound predicted from all other trees, and a penalty for each
    earlier repeat. Twins, two trees that differ only in the sense of all rotors, are about equally good: one of
    them is proposed, and the other serves as a repeat of it, or follows at once if the first is the best of all. If
    there is no new tree among the draws, trees are repeated only after all were proposed. Whenever a tree is
    proposed, a design replaces the next start, unless it did so before: for a child that of its parent, otherwise
    that of a solved tree one move away; for the twin of the best tree, that of the best.
    """

    promotes = False

    def __init__(self, space: Candidates, *, starts: int, seed: int, round_size: int) -> None:
        """Set up the sampler.

        Args:
            space: the candidates.
            starts: largest number of starts of a tree.
            seed: seeds the proposals.
            round_size: largest number of open proposals.
        """
        super().__init__(space, seed)
        self.first_starts = BREEDING.many_starts if round_size >= BREEDING.many_open else 1
        self._steps = [*steps(starts, self.first_starts)]
        self._max_repeats = max(1, int(BREEDING.max_repeats * round_size))
        """Largest number of open proposals that repeat a candidate."""
        self._first = 0
        """Number of the first trial of the current population."""
        self._best = (-1, 0)
        """Number of the population's best trial, and of the first trial that was drawn after its result."""
        self._parents: list[Merit] = []
        """The best trials of the latest population with results."""
        self._strays: set[int] = set()
        """Trials drawn from the previous population while the current one had no results."""
        self._described: dict[str, Array] = {}
        """Descriptors of candidates, by key."""
        self._moved_key = lru_cache(BREEDING.cached_moves)(lambda tree, move: space.key_of(make_move(tree, move)))
        """Returns the key of the candidate to which a move leads."""
        self._twin = cache(lambda key: space.twin_of(Topology.from_key(key)).key)
        """Returns the key of the twin: the candidate that differs only in the sense of all rotors."""
        self._settled: set[str] = set()
        """Keys of candidates that are not new: they or their twins were proposed and did not fail."""
        self._latest: tuple[int, _Knowledge] | None = None
        """The latest knowledge, with the number of completed trials on which it is based."""
        self._pool: dict[str, tuple[_Option, str | None]] = {}
        """Trees drawn from the current parents with the latest knowledge, each with its parent, if it has one."""

    def note_idea(self, number: int, idea: Idea) -> None:
        """Record the proposal of a trial, for its twin as well."""
        super().note_idea(number, idea)
        self._settled |= {idea.key, self._twin(idea.key)}

    def note_score(self, number: int, score: Tried) -> None:
        """Record the result of a trial; a failed one makes its twin new again."""
        super().note_score(number, score)
        if score.status == "failed":
            self._settled -= {self._twin(score.key)} - self.proposed

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield uniform draws for a new population, then the most promising candidates."""
        while not self.completed:
            yield self.uniform()
        known = self._learn()
        self._select_parents(trial.number, known, trial.number - len(self.running))
        while trial.number < self._first + HALVING.uniform_draws:
            yield self.uniform()
        # A design that one job carries over must not be improved by another job meanwhile: the order is not fixed.
        running = {idea.key for idea in self.running.values()}
        locked = running.union(*(idea.warm_starts for idea in self.running.values())) | self.failed
        for key in islice(known.designs, 1):
            if key not in running:
                yield Idea(self._twin(key), (key,))
        open_repeats = running & self.starts.keys()
        for _ in range(BREEDING.attempts):
            self._draw(known.surrogate, 1 if self._pool.keys() <= self._settled else BREEDING.redrawn)
            new = [option for key, (option, _) in self._pool.items() if key not in self._settled]
            may_repeat = new and len(open_repeats) < self._max_repeats
            repeats = (option for option in known.repeats if may_repeat and option.key not in locked)
            twins = (option for option in known.twins if option.key not in self.proposed)
            for _, key, is_repeat in merge(sorted(new), twins, repeats):
                _, parent = self._pool.get(key, (None, None))
                excluded = running | self.warm_started.get(key, set())
                yield Idea(key, self._warm_start(known.designs, key, parent, excluded), is_repeat)

    def _select_parents(self, number: int, known: _Knowledge, finished: int) -> None:
        """Select the parents for a trial; start a new population if the current one no longer improves.

        Args:
            number: number of the trial.
            known: results so far.
            finished: number of the first trial that has not finished.
        """
        population = (
            merit for merit in known.solved if merit.number >= self._first and merit.number not in self._strays
        )
        parents = [*islice(population, BREEDING.parents)]
        if not parents:
            if number >= self._first + HALVING.uniform_draws:
                self._strays.add(number)
            return
        self._parents = parents
        if parents[0].number != self._best[0]:
            self._best = parents[0].number, number
        if finished - self._best[1] > BREEDING.patience:
            self._first, self._strays, self._pool = number, set(), {}

    def _draw(self, surrogate: Surrogate, share: float) -> None:
        """Add a share of the full number of draws to the pool: children of the parents, and uniform draws."""
        keys = [parent.key for parent in self._parents]
        trees = [Topology.from_key(key) for key in keys]
        drawn: dict[str, str | None] = {}
        for _ in range(int(BREEDING.children * share)):
            index = min(self.random.choices(range(len(keys)), k=2))
            drawn.setdefault(self._move(trees[index]), keys[index])
        for _ in range(int(BREEDING.random_trees * share)):
            drawn.setdefault(self.uniform().key, None)
        new = [key for key in drawn if key not in self._pool]
        bounds = surrogate.lower_confidence_bounds(self._descriptors(new)).tolist() if new else []
        for key, bound in zip(new, bounds, strict=True):
            self._pool[key] = _Option(bound, key, is_repeat=False), drawn[key]

    def _move(self, tree: Topology) -> str:
        return self._moved_key(tree, draw_move(tree, self.random, self.connectors))

    def _learn(self) -> _Knowledge:
        """Return the knowledge from the completed trials, at least one; it is cached until there are more."""
        if self._latest is None or self._latest[0] != self.completed:
            solved = (*self.ranking,)
            # The violations of trees without a design say little about their quality, and would spread the ranking
            # where there are no good trees: they are tied, unless no tree has a design.
            by_objective = math.isfinite(solved[0].objective)
            ties = groupby(solved, key=lambda merit: merit.objective if by_objective else merit.violation)
            ranks = [rank for rank, (_, merits) in enumerate(ties) for _ in merits]
            surrogate = Surrogate(self._descriptors([merit.key for merit in solved]), ranks)
            designs = {merit.key: rank for rank, merit in enumerate(solved) if math.isfinite(merit.objective)}
            repeats, twins = self._repeat_options(
                solved[surrogate.subset], surrogate.leave_one_out_bounds().tolist()
            )
            self._latest = self.completed, _Knowledge(solved, surrogate, designs, repeats, twins)
            self._pool = {}
        return self._latest[1]

    def _repeat_options(
        self, solved: Sequence[Merit], bounds: Sequence[float]
    ) -> tuple[list[_Option], list[_Option]]:
        """Return the solved trees with remaining starts, and the twins of solved trees."""
        # Penalty against new trees, in standard deviations of the results, besides 1 for each earlier repeat. One
        # start without a design says little, so an infeasible tree has none.
        penalties = {"feasible": 1.0, "infeasible": 0.0}
        repeats, twins = list[_Option](), list[_Option]()
        for merit, bound in zip(solved, bounds, strict=True):
            if merit.status in penalties:
                step = bisect_left(self._steps, self.starts[merit.key])
                penalized = bound + penalties[merit.status] + step
                twins.append(_Option(penalized, self._twin(merit.key), is_repeat=False))
                if step + 1 < len(self._steps):
                    repeats.append(_Option(penalized, merit.key, is_repeat=True))
        return sorted(repeats), sorted(twins)

    def _warm_start(
        self, designs: Mapping[str, int], key: str, parent: str | None, excluded: Set[str]
    ) -> tuple[str, ...]:
        """Return the key of a design to carry over to a tree: its parent's, or the best one a move away, if any."""
        if parent is not None and parent in designs and parent not in excluded:
            return (parent,)
        tree = Topology.from_key(key)
        neighbours = {self._move(tree) for _ in range(BREEDING.warm_start_moves)} & designs.keys() - excluded - {
            key
        }
        return tuple(sorted(neighbours, key=designs.__getitem__)[:1])

    def _descriptors(self, keys: Sequence[str]) -> Array:
        """Return the descriptors of candidates, one row each."""
        new = [key for key in keys if key not in self._described]
        if new:
            self._described |= zip(new, descriptors([*map(Topology.from_key, new)]), strict=True)
        return np.array([self._described[key] for key in keys])


Move = tuple[int, tuple[int, int], int] | tuple[int, int]
"""i, (h, a) and the increase of kappa[i] in quarter turns: the arguments of `graft`; or those of `exchange`."""


def make_move(topology: Topology, move: Move) -> Topology:
    """Return the tree after a move."""
    return exchange(topology, *move) if len(move) == 2 else graft(topology, *move)


def exchange(topology: Topology, i: int, j: int) -> Topology:
    """Return the tree in which modules i and j have each other's types."""
    types = list(topology.types)
    types[i], types[j] = types[j], types[i]
    return replace(topology, types=tuple(types))


def graft(topology: Topology, i: int, at: tuple[int, int], turns: int = 0) -> Topology:
    """Return the tree after a move: the part at module i is joined to another port, or to its own.

    Args:
        topology: the tree before the move.
        i: the module that is cut off, with everything beyond it.
        at: (h, a), a port of a module outside the part: a free one, or the current one of module i.
        turns: increase of kappa[i] in quarter turns; an odd number flips the part's spins.
    """
    part = part_of(topology, i)
    shift = (at[1] - topology.joints[i][1] - turns) % 4
    order = [h for h in range(topology.n) if h not in part] + sorted(part)
    index = {old: new for new, old in enumerate(order)}
    joints = [topology.joints[0]]
    for old in order[1:]:
        h, a, b = topology.joints[old]
        if old == i:
            joints.append((index[at[0]], at[1], (b + shift) % 4))
        elif old in part:
            joints.append((index[h], (a + shift) % 4, (b + shift) % 4))
        else:
            joints.append((index[h], a, b))
    return Topology(tuple(joints), types=tuple(topology.types[old] for old in order if topology.types))


def part_of(topology: Topology, i: int) -> frozenset[int]:
    """Return module i and all modules beyond it, as seen from the root."""
    part = {i}
    for child, parent in enumerate(topology.parents[i + 1 :], start=i + 1):
        if parent in part:
            part.add(child)
    return frozenset(part)


def draw_move(topology: Topology, random: Random, connectors: Connectors) -> Move:
    """Return a random move: of a leaf or any other part, a flip of parity, or, half the time, an exchange of types.

    Args:
        topology: a tree of at least two modules.
        random: random generator.
        connectors: with `any`, half of the moves flip the parity of a joint, with or without moving its part.
    """
    types = topology.types
    if len(set(types)) > 1 and random.randrange(2):
        i = random.randrange(topology.n)
        return i, random.choice([j for j in range(topology.n) if types[j] != types[i]])
    parents = set(topology.parents)
    leaves = [i for i in range(1, topology.n) if i not in parents]
    i = random.choice(leaves) if random.random() < 0.5 else random.randrange(1, topology.n)
    turns = random.randrange(2) if connectors == "any" else 0
    if turns and random.randrange(2):
        return i, topology.joints[i][:2], turns
    part = part_of(topology, i)
    ports = [port for port in topology.free_connectors if port[0] not in part]
    return i, random.choice(ports), turns

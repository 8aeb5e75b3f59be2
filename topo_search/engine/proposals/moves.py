"""Proposals by moves from the best trees so far, of which a surrogate chooses the most promising.

A move leads from one tree to another: a part is cut off and grafted elsewhere, or a connector's parity is flipped.

| symbol | meaning | range |
|---|---|---|
| i | module that is cut off, with everything beyond it: the part | 1..n-1 |
| (h, a) | port a of module h that the part is grafted at; h is not in the part | |
| kappa[i] | quarter turns of module i about its z axis relative to the aligned joint | 0..3 |
| shift | quarter turns by which all ports of the part move on: a' - a - (change of kappa[i]) | 0..3 |

Moving all ports of the part by the same number leaves its own joints as they are: spins change only in the part as
a whole, and only with the parity of kappa[i]. A part of one module is a leaf; moves of leaves alone lead from any
aligned tree to any other of the same size.

The surrogate guesses how an unsolved tree will stand among those that are solved, by Gaussian process regression
on its descriptors. The descriptors are what a tree looks like when it lies flat.

| symbol | meaning | shape, unit |
|---|---|---|
| c | centres of the modules with all hinge angles zero, from their mean | (k, n, 2), 2 l_c |
| N = n c | the same as whole numbers: what is alike is described alike to the last bit | (k, n, 2) |
| M = c^T c / n | second moments xx, xy, yy; its eigenvalues are the squares of half axes | (k, 2, 2) |
| z | number of joints of each module | (k, n) |
| s | spin of each module relative to the root's, +1 or -1 | (k, n) |
| e, f | joints, each in both directions along it; f follows e where e leads to | m = 2 (n - 1) |
| A_p | whether f follows e with its hinge axis parallel to (p = 0) or across that of e (p = 1) | (k, m, m) |

A path of joints has a pattern: which of its hinge axes are across the one before. It decides what orientations the
modules can have relative to each other. A part that is mirrored at its joint keeps all patterns, and trees that
differ in that alone are often about as good.

All of the numbers are the same for trees that a turn, a mirror or another choice of the root takes into each other.

The regression:

| symbol | meaning | shape |
|---|---|---|
| X | descriptors of the m solved trees, columns of mean 0 and deviation 1 | (m, d) |
| y | places of the solved trees in their ranking, as normal scores of mean 0 and deviation 1 | (m,) |
| k(x, x') | covariance before anything is solved: exp(-|x - x'|^2 / 4 d) + linear (1 + x.x' / d) | |
| K | k(X, X) + noise I | (m, m) |

A tree x is expected at k(x, X) K^-1 y with variance k(x, x) - k(x, X) K^-1 k(X, x) [1]. The first part of k speaks
of trees that look alike, the second of trends; the mean of |x - x'|^2 over all pairs is 2 d. Places instead of
objectives need no unit, and no value for a tree without a design; trees that stand alike share the middle of their
places. What the others tell of solved tree i has the mean y_i - (K^-1 y)_i / (K^-1)_ii, and together with
noise the variance 1 / (K^-1)_ii [2].

[1] C. E. Rasmussen, C. K. I. Williams, "Gaussian processes for machine learning", MIT Press (2006), eq. 2.23-2.24.
[2] The same, eq. 5.12.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache, lru_cache
from heapq import merge
from itertools import groupby, islice, product
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from optuna import Study
from optuna.trial import FrozenTrial
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist
from scipy.special import ndtri

from topo_search.engine.proposals.trials import HALVING, Idea, Merit, TreeSampler, steps
from topo_search.engine.strategy import Candidates, Tried
from topo_search.model import Topology
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.topologies.rooted import Connectors

Indices = NDArray[np.int_]

PATTERNS = tuple(
    pattern
    for length in range(1, 4)  # paths of two to four joints
    for pattern in product((0, 1), repeat=length)
    if pattern <= pattern[::-1]  # the same path the other way
)


@dataclass(frozen=True)
class Regression:
    """Settings of the regression; variances are those of normal scores."""

    linear: float = 0.1
    """Variance of the trends."""
    noise: float = 0.6
    """Variance of what one start says."""
    optimism: float = 2.0
    """Standard deviations by which a tree may do better than expected."""
    trees: int = 500
    """Number of trees above which only every second, third, ... of their ranking is looked at."""


REGRESSION = Regression()


class Flat(NamedTuple):
    """Trees of one size, flat on a grid."""

    parent: Indices
    """Parents of all modules but the root, shape (k, n - 1)."""
    cells: Indices
    """Cells of the modules, from the root, shape (k, n, 2)."""
    quarters: Indices
    """Quarter turns of the modules relative to the root, shape (k, n)."""
    axis: Indices
    """Directions of the hinge axes, up to a half turn: 0 or 1, shape (k, n - 1)."""


def descriptors(topologies: Sequence[Topology]) -> Array:
    """Return the numbers that describe each of k >= 1 trees of one size, shape (k, 12 + number of PATTERNS).

    They are both eigenvalues of M; the numbers of modules in a cell that another one has, of pairs in cells side by
    side that are not bolted together, of modules with one, two and more joints; the sum of the spins, unsigned; the
    joints between two modules, summed over all pairs, a module; how many modules have no counterpart under a half
    turn about the mean of the centres, and in the best of the mirrors along rows, columns and diagonals; and
    |sum c |c|^2| / n, by which one side reaches farther from that mean; and how many paths have each pattern.
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
    steps = np.abs(cells[:, :, None] - cells[:, None]).sum(axis=3)
    stacked = np.tril(steps == 0, -1).any(axis=2).sum(axis=1)
    beside = np.tril(steps == 1).sum(axis=(1, 2)) - (n - 1)
    far = np.einsum("kia,kib,kib->ka", N, N, N) / n**4
    columns = [
        *(middle - half, middle + half),
        *(stacked, beside, (z == 1).sum(axis=1), (z == 2).sum(axis=1), (z > 2).sum(axis=1)),
        np.abs(s.sum(axis=1)),
        _path_lengths(flat.parent) / n,
        *_asymmetry(N),
        np.hypot(*far.T),
        *_paths(flat),
    ]
    return np.stack(columns, axis=1).astype(float)


def _lay_flat(topologies: Sequence[Topology]) -> Flat:
    """Return trees with all hinge angles zero."""
    joints = np.array([topology.joints for topology in topologies])
    k, n, _ = joints.shape
    parent, a, b = joints[:, 1:].transpose(2, 0, 1)
    each, directions = np.arange(k), PORT_DIRECTIONS[:, :2].astype(int)
    cells, quarters = np.zeros((k, n, 2), dtype=int), np.zeros((k, n), dtype=int)
    axis = np.zeros((k, n - 1), dtype=int)
    for joint, h in enumerate(parent.T):
        towards = (a[:, joint] + quarters[each, h]) % 4
        cells[:, joint + 1] = cells[each, h] + directions[towards]
        quarters[:, joint + 1] = quarters[each, h] + (a[:, joint] + 2 - b[:, joint]) % 4
        axis[:, joint] = towards % 2
    return Flat(parent, cells, quarters, axis)


def _path_lengths(parent: Indices) -> Indices:
    """Return the Wiener indices: every joint lies on the paths between the modules on its two sides."""
    k, joints = parent.shape
    beyond = np.ones((k, joints + 1), dtype=int)
    for i in range(joints, 0, -1):
        beyond[np.arange(k), parent[:, i - 1]] += beyond[:, i]
    sizes = beyond[:, 1:]
    return np.asarray((sizes * (joints + 1 - sizes)).sum(axis=1))


def _paths(flat: Flat) -> list[Array]:
    """Return how many paths have each of the PATTERNS: 1^T A_p A_q ... 1, which counts a palindrome twice."""
    child = np.broadcast_to(np.arange(1, flat.parent.shape[1] + 1), flat.parent.shape)
    start, end = np.hstack([flat.parent, child]), np.hstack([child, flat.parent])
    axis = np.hstack([flat.axis, flat.axis])
    follows = (end[:, :, None] == start[:, None]) & (start[:, :, None] != end[:, None])
    across = axis[:, :, None] != axis[:, None]
    A = ((follows & ~across).astype(float), (follows & across).astype(float))
    counted = []
    for pattern in PATTERNS:
        paths = np.ones((*axis.shape, 1))
        for p in reversed(pattern):
            paths = A[p] @ paths
        counted.append(paths.sum(axis=(1, 2)) / (2 if pattern == pattern[::-1] else 1))
    return counted


def _asymmetry(places: Indices) -> tuple[Indices, Indices]:
    """Return how many places, shape (k, n, 2), have no counterpart under a half turn, and in a mirror, at least."""
    x, y = places[..., 0], places[..., 1]
    images = ((-x, -y), (x, -y), (-x, y), (y, x), (-y, -x))
    turn, *mirrors = (
        (~((u[:, :, None] == x[:, None]) & (v[:, :, None] == y[:, None])).any(axis=2)).sum(axis=1)
        for u, v in images
    )
    return turn, np.min(mirrors, axis=0)


class Surrogate:
    """The regression on trees that are solved."""

    def __init__(self, described: Array, places: Sequence[int]) -> None:
        """Fit.

        Args:
            described: descriptors of the solved trees in the order of their ranking, shape (m, d).
            places: their places in the ranking, equal ones for trees that stand alike.
        """
        self.kept = slice(None, None, math.ceil(len(described) / REGRESSION.trees))
        """Slice of the solved trees that are used."""
        described, places = described[self.kept], places[self.kept]
        self._mean, self._scale = described.mean(axis=0), _deviation(described)
        self._X = self._columns(described)
        alike = np.bincount(places)
        y = ndtri((np.cumsum(alike) - 0.5 * alike)[places] / len(places))
        self._y = (y - y.mean()) / _deviation(y)
        self._K = cho_factor(_covariance(self._X, self._X) + REGRESSION.noise * np.eye(len(self._X)))
        self._weights = cho_solve(self._K, self._y)

    def lower_confidence_bounds(self, described: Array) -> Array:
        """Return where trees may stand if they do better than expected, shape (k,).

        Args:
            described: descriptors of the trees, shape (k, d).
        """
        X = self._columns(described)
        known = _covariance(X, self._X)
        before = 1.0 + REGRESSION.linear * (1.0 + np.mean(X * X, axis=1))
        variance = before - np.sum(known * cho_solve(self._K, known.T).T, axis=1)
        return np.asarray(known @ self._weights - REGRESSION.optimism * np.sqrt(np.maximum(variance, 0.0)))

    def leave_one_out_bounds(self) -> Array:
        """Return the bounds of the solved trees that are `kept`, each predicted from all the others."""
        diagonal = np.diag(cho_solve(self._K, np.eye(len(self._y))))
        expected = self._y - self._weights / diagonal
        variance = np.maximum(1.0 / diagonal - REGRESSION.noise, 0.0)
        return np.asarray(expected - REGRESSION.optimism * np.sqrt(variance))

    def _columns(self, described: Array) -> Array:
        return np.asarray((described - self._mean) / self._scale)


def _covariance(X: Array, Y: Array) -> Array:
    """Return k of all pairs of rows, shape (rows of X, rows of Y)."""
    d = X.shape[1]
    apart = cdist(X, Y, "sqeuclidean")
    return np.asarray(np.exp(-apart / (4 * d)) + REGRESSION.linear * (1.0 + X @ Y.T / d))


def _deviation(values: Array) -> Array:
    deviation = values.std(axis=0)
    return np.where(deviation > 0, deviation, 1.0)


@dataclass(frozen=True)
class Breeding:
    """Settings of the search by moves."""

    parents: int = 8
    """The best of a population have children; the others are replaced."""
    children: int = 32
    """Trees made by moves of which, with the random candidates, the most promising is proposed."""
    random_candidates: int = 16
    """Trees drawn uniformly beside them: the best tree need not look like others that are good."""
    stale: int = 160
    """Trials in sight of a population's best, of new trees or not, after which it is given up if none is better."""
    repeats: float = 1 / 4
    """Largest share of the open proposals that repeat a candidate."""
    relatives: int = 32
    """Moves from a tree by which solved ones are looked for to start from; of large trees they find few."""
    kept: int = 1 << 14
    """Moves whose candidates are kept: the same ones are drawn again and again."""
    many: int = 64
    """Proposals unsolved at a time from which workers wait for proposals."""
    at_once: int = 4
    """First starts that a tree then has.

    With twelve modules and ten wrenches a proposal takes 4 ms, a tree 0.2 s from one start and 0.5 s from four, the
    deep retry of trees without a design included (`tests/benchmarks/rounds.py`).
    """
    more: float = 1 / 8
    """Share of these draws that is made again for each further proposal that learns from the same results.

    What was drawn for those before still stands. To draw all anew takes more than twice as long.
    """
    batches: int = 2
    """Attempts to draw an unseen tree before giving up."""


BREEDING = Breeding()


class _Chance(NamedTuple):
    """Possible proposal, and how much it promises."""

    bound: float
    key: str
    again: bool


class _Known(NamedTuple):
    """Knowledge from the trials that are over."""

    solved: tuple[Merit, ...]
    """The best trial of each candidate, in the order of their merit."""
    surrogate: Surrogate
    designs: dict[str, int]
    """Keys of the candidates with a design, the best first, and their places."""
    again: list[_Chance]
    """Solved trees from more starts, the most promising first."""
    twins: list[_Chance]
    """Twins of solved trees, the most promising first."""


class Moves(TreeSampler):
    """Makes trees from the best of a population by single moves, and begins anew when that leads nowhere.

    Of several such trees and some drawn uniformly it proposes the one that promises most by what was solved so far,
    from one start, or a few where many proposals may be unsolved. That may miss what a tree can do, so solved trees
    compete with new ones for more starts: they promise what the others tell of them, and less for every time that
    they had more. Twins, two trees that differ in the sense of all rotors alone, are about as good as each other:
    one of them is proposed, and the other one is another chance of it, or follows at once if the first is the best
    of all. Where no new tree is in sight nothing is tried again before all are tried. Each time a tree is tried a
    design takes the place of the next start, if there is one that it did not start from before: a child's from its
    parent, or else one of a solved tree a move away; the best's twin has the best's.
    """

    promotes = False

    def __init__(self, space: Candidates, *, starts: int, seed: int, round_size: int) -> None:
        """Begin a search.

        Args:
            space: the candidates.
            starts: most of a tree.
            seed: draws the proposals.
            round_size: most proposals whose results are not known.
        """
        super().__init__(space, seed)
        self.few = BREEDING.at_once if round_size >= BREEDING.many else 1
        self._steps = [*steps(starts, self.few)]
        self._repeats = max(1, int(BREEDING.repeats * round_size))
        """Largest number of open proposals that repeat a candidate."""
        self._first = 0
        """The first trial of the present population."""
        self._best = (-1, 0)
        """The best trial of the present population, and the first one that was made with it in sight."""
        self._parents: list[Merit] = []
        """The best of the latest population of which any is known."""
        self._strays: set[int] = set()
        """Trials made from the population before, as long as nothing was known of the present one."""
        self._described: dict[str, Array] = {}
        """Descriptors of candidates, by key."""
        self._led_to = lru_cache(BREEDING.kept)(lambda tree, move: space.key_of(graft(tree, *move)))
        """Returns the key of the candidate that a move leads to."""
        self._twin = cache(lambda key: space.twin_of(Topology.from_key(key)).key)
        """Returns the key of the candidate that differs in the sense of all rotors alone, by key."""
        self._settled: set[str] = set()
        """Keys of candidates that are not new: they or their twins were proposed, and did not fail."""
        self._latest: tuple[int, _Known] | None = None
        """Number of trials that the latest knowledge was learnt from, and that knowledge."""
        self._pool: dict[str, tuple[_Chance, str | None]] = {}
        """Trees drawn from the present parents since anything was learnt, each with its parent, if it has one."""

    def note_idea(self, number: int, idea: Idea) -> None:
        """Take note of what is proposed, and of its twin."""
        super().note_idea(number, idea)
        self._settled |= {idea.key, self._twin(idea.key)}

    def note_score(self, number: int, score: Tried) -> None:
        """Take note of what a trial led to: one that failed says nothing of the candidate's twin."""
        super().note_score(number, score)
        if score.status == "failed":
            self._settled -= {self._twin(score.key)} - self.proposed

    def ideas(self, study: Study, trial: FrozenTrial) -> Iterator[Idea]:
        """Yield candidates drawn uniformly for a new population, then what promises most, if anything does."""
        while not self.completed:
            yield self.uniform()
        known = self._learn()
        self._breed(trial.number, known, trial.number - len(self.running))
        while trial.number < self._first + HALVING.fresh:
            yield self.uniform()
        # What one job carries over must not be what another one extends meanwhile: which ends first is chance.
        running = {idea.key for idea in self.running.values()}
        carried_over = running.union(*(idea.warm_starts for idea in self.running.values()))
        for key in islice(known.designs, 1):
            if key not in running:
                yield Idea(self._twin(key), (key,))
        repeats = running & self.starts.keys()
        kept = carried_over | self.failed
        for _ in range(BREEDING.batches):
            self._draw(known.surrogate, 1 if self._pool.keys() <= self._settled else BREEDING.more)
            new = [chance for key, (chance, _) in self._pool.items() if key not in self._settled]
            again = (one for one in known.again if new and len(repeats) < self._repeats and one.key not in kept)
            twins = (one for one in known.twins if one.key not in self.proposed)
            for _, key, repeat in merge(sorted(new), twins, again):
                _, parent = self._pool.get(key, (None, None))
                without = running | self.lent.get(key, set())
                yield Idea(key, self._warm_start(known.designs, key, parent, without), repeat)

    def _breed(self, number: int, known: _Known, over: int) -> None:
        """Choose the parents for a trial, when all before trial `over` are over; begin a population in time."""
        of_own = (one for one in known.solved if one.number >= self._first and one.number not in self._strays)
        parents = [*islice(of_own, BREEDING.parents)]
        if not parents:
            if number >= self._first + HALVING.fresh:
                self._strays.add(number)
            return
        self._parents = parents
        if parents[0].number != self._best[0]:
            self._best = parents[0].number, number
        if over - self._best[1] > BREEDING.stale:
            self._first, self._strays, self._pool = number, set(), {}

    def _draw(self, surrogate: Surrogate, share: float) -> None:
        """Add trees to the pool, a share of all: children of the parents, and some drawn uniformly."""
        keys = [parent.key for parent in self._parents]
        trees = [Topology.from_key(key) for key in keys]
        drawn: dict[str, str | None] = {}
        for _ in range(int(BREEDING.children * share)):
            index = min(self.random.choices(range(len(keys)), k=2))
            drawn.setdefault(self._move(trees[index]), keys[index])
        for _ in range(int(BREEDING.random_candidates * share)):
            drawn.setdefault(self.uniform().key, None)
        new = [key for key in drawn if key not in self._pool]
        bounds = surrogate.lower_confidence_bounds(self._descriptors(new)).tolist() if new else []
        for key, bound in zip(new, bounds, strict=True):
            self._pool[key] = _Chance(bound, key, again=False), drawn[key]

    def _move(self, tree: Topology) -> str:
        return self._led_to(tree, draw_move(tree, self.random, self.connectors))

    def _learn(self) -> _Known:
        """Return what the trials that are over, at least one, tell; it is kept till there are more."""
        if self._latest is None or self._latest[0] != self.completed:
            solved = (*self.ranking,)
            # By how much trees without a design miss one says little of how good they can be, and would spread the
            # ranking where no good tree is: they stand alike, as long as one tree has a design.
            by_objective = solved[0].has_design
            alike = groupby(solved, key=lambda one: one.objective if by_objective else one.violation)
            places = [position for position, (_, merits) in enumerate(alike) for _ in merits]
            surrogate = Surrogate(self._descriptors([one.key for one in solved]), places)
            designs = {one.key: position for position, one in enumerate(solved) if one.has_design}
            again, twins = self._chances(solved[surrogate.kept], surrogate.leave_one_out_bounds().tolist())
            self._latest = self.completed, _Known(solved, surrogate, designs, again, twins)
            self._pool = {}
        return self._latest[1]

    def _chances(self, solved: Sequence[Merit], bounds: Sequence[float]) -> tuple[list[_Chance], list[_Chance]]:
        """Return other chances of solved trees: themselves where starts are left, and their twins."""
        # Lead over a new tree that another chance must promise, in standard deviations of the known results: one
        # more for every time that the tree had more starts. One start without a design says little.
        reluctance = {"feasible": 1.0, "infeasible": 0.0}
        again, twins = list[_Chance](), list[_Chance]()
        for one, bound in zip(solved, bounds, strict=True):
            if one.status in reluctance:
                more = bisect_left(self._steps, self.starts[one.key])
                promise = bound + reluctance[one.status] + more
                twins.append(_Chance(promise, self._twin(one.key), again=False))
                if more + 1 < len(self._steps):
                    again.append(_Chance(promise, one.key, again=True))
        return sorted(again), sorted(twins)

    def _warm_start(
        self, designs: Mapping[str, int], key: str, parent: str | None, without: Set[str]
    ) -> tuple[str, ...]:
        """Return whose design a tree starts from: a child its parent's, others the best a move away, if any is."""
        if parent is not None and parent in designs and parent not in without:
            return (parent,)
        tree = Topology.from_key(key)
        relatives = {self._move(tree) for _ in range(BREEDING.relatives)} & designs.keys() - without - {key}
        return tuple(sorted(relatives, key=designs.__getitem__)[:1])

    def _descriptors(self, keys: Sequence[str]) -> Array:
        """Return the descriptors of candidates, a row each."""
        new = [key for key in keys if key not in self._described]
        if new:
            self._described |= zip(new, descriptors([*map(Topology.from_key, new)]), strict=True)
        return np.array([self._described[key] for key in keys])


Move = tuple[int, tuple[int, int], int]
"""i, (h, a) and the quarter turns that kappa[i] grows by: what `graft` takes beside a tree."""


def graft(topology: Topology, i: int, at: tuple[int, int], turns: int = 0) -> Topology:
    """Return a tree in which the part at module i is joined to another port, or to its own again.

    Args:
        topology: the tree before the move.
        i: the module that is cut off, with everything beyond it.
        at: (h, a), the port of a module outside of the part; free, or that of module i so far.
        turns: quarter turns that kappa[i] grows by; an odd number flips the part's spins.

    Raises:
        ValueError: the port belongs to the part or is taken, or i is the root.
    """
    if not 0 < i < topology.n:
        raise ValueError(f"`0 < i < {topology.n}` must hold, but got i = {i}")
    part = part_of(topology, i)
    if at[0] in part:
        raise ValueError(f"module {at[0]} goes with module {i}, but got at = {at}")
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
    return Topology(tuple(joints))


def part_of(topology: Topology, i: int) -> frozenset[int]:
    """Return module i and everything beyond it, as seen from the root."""
    part = {i}
    for child, parent in enumerate(topology.parents[i + 1 :], start=i + 1):
        if parent in part:
            part.add(child)
    return frozenset(part)


def draw_move(topology: Topology, random: Random, connectors: Connectors) -> Move:
    """Return a move: of a leaf or any other part, or (any port) a parity that is flipped.

    Args:
        topology: a tree of two modules at least.
        random: draws the move.
        connectors: with `any`, half of the moves flip the parity of a joint, in place or with a move of its part.

    Raises:
        ValueError: there is one module alone, and nothing can be moved.
    """
    if topology.n < 2:
        raise ValueError("`n >= 2` must hold for a move, but got n = 1")
    parents = set(topology.parents)
    leaves = [i for i in range(1, topology.n) if i not in parents]
    i = random.choice(leaves) if random.random() < 0.5 else random.randrange(1, topology.n)
    turns = random.randrange(2) if connectors == "any" else 0
    if turns and random.randrange(2):
        return i, topology.joints[i][:2], turns
    part = part_of(topology, i)
    ports = [port for port in topology.free_connectors if port[0] not in part]
    return i, random.choice(ports), turns

r"""Lower and upper bounds on the largest ball around a point of a polytope given by linear constraints.

    P = {C v - g : M v = m, low <= v <= high}, in two or three dimensions D

| symbol | meaning | shape |
|---|---|---|
| C, g | map from the variables to the polytope's space, and the centre of the ball | (D, N), (D,) |
| h(d) | support function of P, the largest d . x: one linear program | |
| r | radius of the largest ball around zero in P, the minimum of h(d) over unit vectors d | |

The points that attain h are in P, and so is their hull, so r is at least the distance of the hull's nearest facet.
It is at most any h(d). The next directions are the normals of the hull's nearest facets, until none of them moves,
so only facets near the minimum are ever computed.

The largest cap of a sphere in P is computed the same way. The sphere has its centre at -g, where the wrench is
zero, and passes through zero, the centre of the cap:

| symbol | meaning |
|---|---|
| t | half-angle of the cap |
| theta | angle between g and the normal d of a half-space d . x <= h |
| s | (h + d . g) / |g|, distance of the half-space's plane from the sphere's centre, in radii |

A half-space with s >= 1 contains the whole sphere. Any other contains a cap up to t = theta - arccos(s); a larger
cap has an arc outside, even if its rim does not. The minimum of t over all d is that of P.

A pseudo-inverse allocator has the inputs A^+ w, and fails if one of them exceeds its limits:

| symbol | meaning | shape |
|---|---|---|
| A, A^+ | wrench map and its pseudo-inverse | (6, N), (N, 6) |
| b | nominal wrench, hover with its load | (6,) |
| E | added wrenches of unit forces or torques | (6, D) |
| v | A^+ b | (N,) |
| s_i | slack of input i, the smaller of high_i - v_i and v_i - low_i | |

With an addition d, input i is v_i + (A^+ E)_i d, so the largest ball has the radius min_i s_i / |(A^+ E)_i|,
without a program. Wrenches that A A^+ does not reproduce cannot be exerted. PX4 allocates like this before it
desaturates.

With a dead rotor, the ball of torques that can be added shows whether attitude remains controllable. Both bounds of
a dead rotor are zero, even if the smallest input of a running rotor is not.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from topo_search.model import Array, Flags, Indices
from topo_search.model.proven import TOLERANCE
from verify.flight.programs import Bounds, find_solutions, greatest, times

ACCURACY = 1e-7
"""Gap between the bounds on r, in weights, or on t [rad] at which refinement ends."""
ROUNDS = 60
"""Largest number of refinements of the normals."""


@dataclass(frozen=True, eq=False)
class BallBound:
    """Proven bounds on the radius of a largest ball, or the half-angle [rad] of a largest cap."""

    lower: float
    """Lower bound: a ball or cap of this size is in the polytope."""
    upper: float
    """Upper bound, from the direction `weakest`."""
    weakest: Array
    """Unit vector, shape (D,)."""


class Polytopes(NamedTuple):
    """B polytopes that differ only in the centre and the right-hand side."""

    C: Array
    M: Array
    """Shape (k, N)."""
    g: Array
    """Shape (B, D)."""
    m: Array
    """Shape (B, k)."""
    caps: bool = False
    """True if the largest caps are computed, not the largest balls."""


def largest_balls(groups: Sequence[Polytopes], box: Bounds, level: float | None = None) -> list[list[BallBound]]:
    """Return the largest ball around zero, or the largest cap, in each polytope of every group.

    Args:
        groups: the polytopes; those with as many dimensions and equations are refined at once.
        box: bounds on the variables, common or one row per polytope.
        level: bounds are refined only until both are on one side of it; None: until they agree.
    """
    shapes, balls = [(len(group.C), len(group.M)) for group in groups], dict[int, list[BallBound]]()
    for shape in set(shapes):
        alike = [k for k in range(len(groups)) if shapes[k] == shape]
        balls |= zip(alike, _refine([groups[k] for k in alike], box, level), strict=True)
    return [balls[k] for k in range(len(groups))]


def _refine(groups: list[Polytopes], box: Bounds, level: float | None) -> list[list[BallBound]]:
    """Refine all polytopes at once, one batch of linear programs per round."""
    C, M = [group.C for group in groups], [group.M for group in groups]
    g, m = (np.concatenate(rows) for rows in zip(*((group.g, group.m) for group in groups), strict=True))
    centres = [(centre if group.caps else None) for group in groups for centre in group.g]
    number, bounds = np.repeat(np.arange(len(C)), [len(group.g) for group in groups]), box.rows(len(g))
    search = [_Polytope(len(C[0]), centre, level) for centre in centres]
    unfinished = list(range(len(g)))
    for _ in range(ROUNDS):
        queries = {row: d for row in unfinished if len(d := search[row].next_directions())}
        unfinished = list(queries)
        if not unfinished:
            break
        rows, d = np.repeat(unfinished, [len(d) for d in queries.values()]), np.concatenate(list(queries.values()))
        bases = None
        if len(search[rows[0]].directions):
            bases = np.concatenate([search[row].warm_starts(d) for row, d in queries.items()])
        splits = np.searchsorted(number[rows], np.arange(len(C) + 1)).tolist()
        optima = greatest(
            times(d, C, splits), M, m[rows], Bounds(bounds.low[rows], bounds.high[rows]), bases, splits
        )
        x, feasible = times(optima.v, [matrix.T for matrix in C], splits) - g[rows], np.isfinite(optima.attained)
        upper = optima.upper - np.sum(d * g[rows], axis=1)
        for row in unfinished:
            belongs = slice(*np.searchsorted(rows, [row, row + 1]))
            search[row].add(d[belongs], x[belongs][feasible[belongs]], upper[belongs], optima.bases[belongs])
    return [[search[row].ball() for row in np.flatnonzero(number == k)] for k in range(len(C))]


def half_angles(normals: Array, offsets: Array, g: Array) -> Array:
    """Return the half-angles of the largest caps in half-spaces, pi for the whole sphere, shape (F,) [rad].

    Args:
        normals: d, unit vectors, shape (F, D).
        offsets: h, shape (F,).
        g: vector from the sphere's centre to that of the cap, shape (D,).
    """
    radius = np.linalg.norm(g)
    along = normals @ g / radius
    s = along + offsets / radius
    angles = np.arccos(np.clip(along, -1.0, 1.0)) - np.arccos(np.clip(s, -1.0, 1.0))
    return np.where(s >= 1, np.pi, angles)


@dataclass(eq=False)
class _Polytope:
    """Known points and supporting half-spaces of one polytope."""

    D: int
    g: Array | None = None
    """Vector from the sphere's centre to that of the cap; None for a ball."""
    level: float | None = None
    points: Array = field(init=False)
    directions: Array = field(init=False)
    bases: Indices | None = None
    """Final bases of the programs, one row per direction."""
    upper: float = math.inf
    weakest: Array = field(init=False)
    hulls: list[tuple[float, Array, Array]] = field(default_factory=list)
    """Size of the largest ball, or cap, within the facets of each hull of the points, their normals and corners."""

    def __post_init__(self) -> None:
        self.points, self.directions = np.empty((0, self.D)), np.empty((0, self.D))
        self.weakest = np.zeros(self.D)

    def size(self, normals: Array, offsets: Array) -> Array:
        """Return the size of the largest ball, or cap, in each half-space, shape (F,)."""
        return offsets if self.g is None else half_angles(normals, offsets, self.g)

    def add(self, d: Array, points: Array, upper: Array, bases: Indices) -> None:
        """Add the results for directions d: points in the polytope, upper bounds on h(d), and final bases."""
        self.directions = np.concatenate([self.directions, d])
        self.bases = bases if self.bases is None else np.concatenate([self.bases, bases])
        points = np.concatenate([self.points, points])
        rounded = np.round(points, 10)
        order = np.lexsort(rounded.T[::-1])
        repeated = np.flatnonzero(np.all(rounded[order[1:]] == rounded[order[:-1]], axis=1)) + 1
        self.points = points[np.delete(order, repeated)]
        sizes = self.size(d, upper)
        if len(d) and sizes.min() < self.upper:
            best = int(np.argmin(sizes))
            self.upper, self.weakest = float(sizes[best]), d[best]

    def warm_starts(self, d: Array) -> Indices:
        """Return the final bases of the programs of the nearest previous directions."""
        assert self.bases is not None
        return np.asarray(self.bases[np.argmax(d @ self.directions.T, axis=1)])

    def next_directions(self) -> Array:
        """Return the next directions, shape (q, D); empty when finished."""
        if not len(self.directions):
            grid = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=self.D) if any(d)])
            grid = grid[np.abs(grid).sum(axis=1) != 2] if self.D == 3 else grid
            return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True))
        if self.upper <= (ACCURACY if self.level is None else self.level) or not len(self.points):
            return np.empty((0, self.D))
        vectors = np.concatenate([self.points - self.points[0], np.zeros((self.D, self.D))])
        if np.linalg.svdvals(vectors)[-1] <= ACCURACY / 10:
            axis = np.linalg.svd(vectors)[2][-1]  # the points are flat along it
            return self._new_directions(np.stack([axis, -axis]))
        try:
            hull = ConvexHull(self.points)
        except QhullError:
            return np.empty((0, self.D))
        normals = hull.equations[:, : self.D]
        corners = self.points[hull.simplices]
        offsets = np.einsum("fd,fkd->fk", normals, corners).min(axis=1)
        sizes = self.size(normals, offsets)
        self.hulls.append((float(sizes.min()), normals, corners))
        enough = self.upper - ACCURACY
        nearest = np.flatnonzero(sizes < (enough if self.level is None else min(enough, self.level)))
        return self._new_directions(normals[nearest[np.argsort(sizes[nearest], kind="stable")]])

    def _new_directions(self, normals: Array) -> Array:
        """Return up to 12 of the normals, without repetitions."""
        alike = 1 - 1e-13  # closer normals are equal up to rounding
        normals = normals[np.all(normals @ self.directions.T <= alike, axis=1)]
        similar, selected = normals @ normals.T > alike, list[int]()
        for k, row in enumerate(similar):
            if not row[selected].any():
                selected.append(k)
        return normals[selected[:12]]

    def ball(self) -> BallBound:
        """Return the proven bounds."""
        sizes = (size for size, *facets in sorted(self.hulls, key=lambda hull: -hull[0]) if _surrounds(*facets))
        return BallBound(min(max(next(sizes, 0.0), 0.0), max(self.upper, 0.0)), self.upper, self.weakest)


def _surrounds(normals: Array, corners: Array) -> bool:
    """True if facets, shape (F, D, D), cover all directions from zero, which is inside each of their planes."""
    if np.einsum("fd,fkd->fk", normals, corners).min() <= 0:
        return False
    if corners.shape[1] == 2:
        a, b = corners[:, 0], corners[:, 1]
        angles = np.arctan2(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b, axis=1))
        return bool(abs(angles.sum() - 2 * math.pi) < 1e-6)  # tolerance [rad]; in 3D [sr]
    # Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30 (1983)
    a, b, c = (corners[:, k] for k in range(3))
    A, B, C = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.abs(np.einsum("fd,fd->f", a, np.cross(b, c)))
    inner = A * B * C + np.sum(a * b, axis=1) * C + np.sum(b * c, axis=1) * A + np.sum(c * a, axis=1) * B
    return bool(abs(2 * np.arctan2(volume, inner).sum() - 4 * math.pi) < 1e-6)


FORCES, TORQUES = np.eye(6)[:, :3], np.eye(6)[:, 3:]
"""Wrenches about the COM of unit forces and torques there."""


class PseudoInverse:
    """Reserves of an allocator that multiplies by the pseudo-inverse.

    Args:
        A: wrench map, shape (6, N) [m_t g, l_arm m_t g].
        box: bounds on the inputs, shape (N,) each.
    """

    def __init__(self, A: Array, box: Bounds) -> None:
        # relative to the largest, smaller singular values count as zero
        self._A, self._box, self._inverse = A, box, np.linalg.pinv(A, rcond=1e-9)

    def ball(self, b: Array, E: Array) -> float:
        """Return the radius of the largest ball of additions to b; 0 if there is none."""
        v, rows = self._inverse @ b, self._inverse @ E
        error = self._A @ np.column_stack([v, rows]) - np.column_stack([b, E])
        slack = np.minimum(self._box.high - v, v - self._box.low)
        if np.abs(error).max() > TOLERANCE or slack.min() < 0:
            return 0.0
        gains = np.linalg.norm(rows, axis=1)
        affected = gains > 0
        return float((slack[affected] / gains[affected]).min(initial=math.inf))

    def cap(self, b: Array) -> float:
        """Return the half-angle of the largest cap of torque-free forces around b's, with the same norm [rad].

        Each limit of an input is a half-space of forces.
        """
        if self.ball(b, FORCES) == 0:
            return 0.0
        v, rows = self._inverse @ b, self._inverse @ FORCES
        gains = np.linalg.norm(rows, axis=1)
        affected = gains > 0
        normals = rows[affected] / gains[affected, None]
        up, down = (slack[affected] / gains[affected] for slack in (self._box.high - v, v - self._box.low))
        return min(float(half_angles(n, h, b[:3]).min()) for n, h in ((normals, up), (-normals, down)))


class RotorFailures(NamedTuple):
    """A wrench with each single rotor dead, shape (N,) each."""

    possible: Flags
    """True if the wrench is proven possible."""
    impossible: Flags
    """True if it is proven impossible."""
    lower: Array
    """Lower bound on the radius of the ball of added torques [l_arm m_t g]; 0 if unproven."""
    upper: Array
    """Upper bound."""


def rotor_failures(A: Array, b: Array, box: Bounds, level: float | None = None) -> RotorFailures:
    """Return whether a wrench is possible after the failure of each single rotor, and the remaining torque reserve.

    Args:
        A: wrench map, shape (6, N).
        b: the wrench, shape (6,).
        box: bounds on the inputs of running rotors, shape (N,) each.
        level: as in `largest_balls`.
    """
    N = A.shape[1]
    is_alive = 1.0 - np.eye(N)
    low, high = box.low * is_alive, box.high * is_alive
    solvable = find_solutions(A, np.tile(b, (N, 1)), Bounds(low, high))
    lower, upper = np.zeros(N), np.where(solvable.no, 0.0, np.inf)
    possible = np.flatnonzero(solvable.yes)
    for dead in np.array_split(possible, math.ceil(len(possible) / 20) or 1):  # 20 polytopes per batch
        produced = solvable.v[dead] @ A.T  # within the audit's tolerance of b, and attained exactly
        torques = Polytopes(A[3:], A[:3], produced[:, 3:], produced[:, :3])
        (balls,) = largest_balls([torques], Bounds(low[dead], high[dead]), level)
        lower[dead], upper[dead] = [ball.lower for ball in balls], [max(ball.upper, 0.0) for ball in balls]
    return RotorFailures(solvable.yes, solvable.no, lower, upper)

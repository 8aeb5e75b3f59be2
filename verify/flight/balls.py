r"""The largest ball around a point of a polytope that linear programs describe, from inside and from outside.

    P = {C v - g : M v = m, low <= v <= high}, in two or three dimensions D

| symbol | meaning | shape |
|---|---|---|
| C, g | what is asked about, and the centre of the ball | (D, N), (D,) |
| h(d) | greatest d . x of P: one linear program | |
| r | radius of the largest ball around zero in P: the least h(d) of all unit d | |

Points where h is attained are in P, and so is their hull: no r is less than the distance of its nearest facet. No r
is more than any h(d). The normals of the hull's nearest facets are asked next, until none of them moves, so that
only facets near the answer are ever found.

The largest cap of a sphere in P is found alike. The sphere is about -g, where nothing is exerted, and ends at zero,
which is the middle of the cap:

| symbol | meaning |
|---|---|
| t | half-angle of the cap |
| theta | angle between g and the normal d of a half-space d . x <= h |
| s | (h + d . g) / |g|: the half-space ends s radii from the sphere's centre |

A half-space with s >= 1 holds the whole sphere; any other a cap up to t = theta - arccos(s), beyond which an arc
lies outside, even if its far end does not. The least t of all d is that of P.

An allocator that only multiplies has inputs A^+ w, and nothing where one is beyond its limits:

| symbol | meaning | shape |
|---|---|---|
| A, A^+ | wrench map and its pseudo-inverse | (6, N), (N, 6) |
| b | wrench that is held, hover with its load | (6,) |
| E | wrenches of unit forces or torques that are added | (6, D) |
| v | A^+ b | (N,) |
| s_i | what is left of input i: the least of high_i - v_i and v_i - low_i | |

Input i is v_i + (A^+ E)_i d for an added d, so that the largest ball has the radius min_i s_i / |(A^+ E)_i|: no
program is needed. Wrenches that A A^+ does not return are not exerted at all. PX4 allocates so before it
desaturates.

With a rotor dead, the torques that can be added show that attitude remains controllable. A dead rotor's bounds are
both zero, whatever the least input.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from topo_search.model.proven import TOLERANCE
from verify.bodies import Array
from verify.flight.programs import Box, find_solutions, greatest
from verify.meshes import Indices

ACCURACY = 1e-7
"""Distance between both bounds of r, in weights, or of t that is good enough."""
ROUNDS = 60
"""Largest number of refinements of the normals."""


@dataclass(frozen=True, eq=False)
class Ball:
    """The largest ball, or cap, as far as it is proven."""

    lower: float
    """All of a ball of this radius, or of a cap of this half-angle [rad], is in the polytope."""
    upper: float
    """The polytope ends at this distance, or angle, towards `weakest`."""
    weakest: Array
    """Unit vector, shape (D,)."""


def largest_balls(C: Array, M: Array, g: Array, m: Array, box: Box) -> list[Ball]:
    """Return the largest ball around zero of each polytope.

    Args:
        C: shape (D, N).
        M: shape (k, N).
        g: of each polytope, shape (B, D).
        m: shape (B, k).
        box: bounds of the variables, the same for all, or a row a polytope.
    """
    return _refine([_Polytope(len(C)) for _ in g], C, M, g, m, box)


def largest_caps(C: Array, M: Array, g: Array, m: Array, box: Box) -> list[Ball]:
    """Return the largest cap in each polytope; the arguments are those of `largest_balls`."""
    return _refine([_Polytope(len(C), one) for one in g], C, M, g, m, box)


def half_angles(normals: Array, offsets: Array, g: Array) -> Array:
    """Return the half-angles of the largest caps in some half-spaces, pi for the whole sphere, shape (F,) [rad].

    Args:
        normals: d, unit vectors, shape (F, D).
        offsets: h, shape (F,).
        g: from the sphere's centre to the middle of the cap, shape (D,).
    """
    radius = np.linalg.norm(g)
    along = normals @ g / radius
    s = along + offsets / radius
    angles = np.arccos(np.clip(along, -1.0, 1.0)) - np.arccos(np.clip(s, -1.0, 1.0))
    return np.where(s >= 1, np.pi, angles)


def _refine(polytopes: list[_Polytope], C: Array, M: Array, g: Array, m: Array, box: Box) -> list[Ball]:
    """Return what is found in each polytope by asking in one direction after another."""
    bounds = box.rows(len(g))
    for _ in range(ROUNDS):
        questions = [(row, polytope.questions()) for row, polytope in enumerate(polytopes)]
        if not any(len(d) for _, d in questions):
            break
        rows = np.concatenate([np.full(len(d), row) for row, d in questions])
        d = np.concatenate([d for _, d in questions])
        bases = None
        if len(polytopes[rows[0]].directions):
            bases = np.concatenate([polytopes[row].near(d) for row, d in questions])
        optima = greatest(d @ C, M, m[rows], Box(bounds.low[rows], bounds.high[rows]), bases)
        x, beside = optima.v @ C.T - g[rows], np.sum(d * g[rows], axis=1)
        for row, polytope in enumerate(polytopes):
            mine = rows == row
            known = np.isfinite(optima.attained) & mine
            polytope.learn(d[mine], x[known], optima.upper[mine] - beside[mine], optima.bases[mine])
    return [polytope.ball() for polytope in polytopes]


@dataclass(eq=False)
class _Polytope:
    """Knowledge of one polytope."""

    D: int
    g: Array | None = None
    """The middle of a cap from its sphere's centre; None: a ball is looked for."""
    points: Array = field(init=False)
    directions: Array = field(init=False)
    bases: Indices | None = None
    upper: float = math.inf
    weakest: Array = field(init=False)
    lower: float = 0.0

    def __post_init__(self) -> None:
        self.points, self.directions = np.empty((0, self.D)), np.empty((0, self.D))
        self.weakest = np.zeros(self.D)

    def size(self, normals: Array, offsets: Array) -> Array:
        """Return the largest ball, or cap, in each half-space, shape (F,)."""
        return offsets if self.g is None else half_angles(normals, offsets, self.g)

    def learn(self, d: Array, points: Array, upper: Array, bases: Indices) -> None:
        """Take what was found in directions d: points that are in the polytope, and how far it goes at most."""
        self.directions = np.concatenate([self.directions, d])
        self.bases = bases if self.bases is None else np.concatenate([self.bases, bases])
        points = np.concatenate([self.points, points])
        self.points = points[np.unique(np.round(points, 10), axis=0, return_index=True)[1]]
        sizes = self.size(d, upper)
        if len(d) and sizes.min() < self.upper:
            best = int(np.argmin(sizes))
            self.upper, self.weakest = float(sizes[best]), d[best]

    def near(self, d: Array) -> Indices:
        """Return where the programs of the nearest directions that were asked ended."""
        if self.bases is None:
            raise ValueError("nothing was asked before")
        return np.asarray(self.bases[np.argmax(d @ self.directions.T, axis=1)])

    def questions(self) -> Array:
        """Return the directions to ask in next, shape (q, D); none at the end."""
        if not len(self.directions):
            around = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=self.D) if any(d)])
            around = around[np.abs(around).sum(axis=1) != 2] if self.D == 3 else around
            return np.asarray(around / np.linalg.norm(around, axis=1, keepdims=True))
        if self.upper <= ACCURACY or not len(self.points):
            return np.empty((0, self.D))
        _, sizes, axes = np.linalg.svd(np.concatenate([self.points - self.points[0], np.zeros((self.D, self.D))]))
        if sizes[-1] <= ACCURACY / 10:  # no points lie across the last axis
            return self._new_directions(np.stack([axes[-1], -axes[-1]]))
        try:
            hull = ConvexHull(self.points)
        except QhullError:
            return np.empty((0, self.D))
        normals = hull.equations[:, : self.D]
        corners = self.points[hull.simplices]
        offsets = np.einsum("fd,fkd->fk", normals, corners).min(axis=1)
        sizes = self.size(normals, offsets)
        self.lower = max(self.lower, float(sizes.min()) if _surrounds(normals, corners) else 0.0)
        near = np.flatnonzero(sizes < self.upper - ACCURACY)
        return self._new_directions(normals[near[np.argsort(sizes[near], kind="stable")]])

    def _new_directions(self, normals: Array) -> Array:
        kept: list[Array] = []
        for n in normals:
            known = np.concatenate([self.directions, *[one[None] for one in kept]])
            if not np.any(known @ n > 1 - 1e-13):  # nearer normals are one
                kept.append(n)
            if len(kept) == 12:  # so many are asked at a time
                break
        return np.array(kept).reshape(-1, self.D)

    def ball(self) -> Ball:
        """Return what is proven."""
        return Ball(min(self.lower, max(self.upper, 0.0)), self.upper, self.weakest)


def _surrounds(normals: Array, corners: Array) -> bool:
    """True if facets, shape (F, D, D), cover all directions from zero, each seen from inside."""
    if np.einsum("fd,fkd->fk", normals, corners).min() <= 0:
        return False
    if corners.shape[1] == 2:
        a, b = corners[:, 0], corners[:, 1]
        angles = np.arctan2(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b, axis=1))
        return bool(abs(angles.sum() - 2 * math.pi) < 1e-6)  # the largest gap [rad], below [sr]
    # Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30 (1983)
    a, b, c = (corners[:, k] for k in range(3))
    A, B, C = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.abs(np.einsum("fd,fd->f", a, np.cross(b, c)))
    inner = A * B * C + np.sum(a * b, axis=1) * C + np.sum(b * c, axis=1) * A + np.sum(c * a, axis=1) * B
    return bool(abs(2 * np.arctan2(volume, inner).sum() - 4 * math.pi) < 1e-6)


FORCES, TORQUES = np.eye(6)[:, :3], np.eye(6)[:, 3:]
"""Wrenches about the COM of forces and torques there."""


class PseudoInverse:
    """The allocator.

    Args:
        A: wrench map, shape (6, N) [m_t g, l_arm m_t g].
        box: bounds of the inputs, shape (N,) each.
    """

    def __init__(self, A: Array, box: Box) -> None:
        # singular values below this share of the largest are zero
        self._A, self._box, self._inverse = A, box, np.linalg.pinv(A, rcond=1e-9)

    def ball(self, b: Array, E: Array) -> float:
        """Return the radius of the largest ball of additions to b; 0 if there is none."""
        v, rows = self._inverse @ b, self._inverse @ E
        missed = self._A @ np.column_stack([v, rows]) - np.column_stack([b, E])
        left = np.minimum(self._box.high - v, v - self._box.low)
        if np.abs(missed).max() > TOLERANCE or left.min() < 0:
            return 0.0
        sizes = np.linalg.norm(rows, axis=1)
        moved = sizes > 0
        return float((left[moved] / sizes[moved]).min(initial=math.inf))

    def cap(self, b: Array) -> float:
        """Return the half-angle of the largest cap of forces as large as that of b around it, without torque [rad].

        Each limit of an input is a half-space of forces.
        """
        if self.ball(b, FORCES) == 0:
            return 0.0
        v, rows = self._inverse @ b, self._inverse @ FORCES
        sizes = np.linalg.norm(rows, axis=1)
        moved = sizes > 0
        normals = rows[moved] / sizes[moved, None]
        up, down = (side[moved] / sizes[moved] for side in (self._box.high - v, v - self._box.low))
        return min(float(half_angles(n, h, b[:3]).min()) for n, h in ((normals, up), (-normals, down)))


def remainder(A: Array, b: Array, box: Box) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array, Array]:
    """Return what is left of a wrench with each of the rotors dead, one at a time.

    Whether it is proven to be possible, and impossible; the radius of the largest ball of torques that can be
    added, at least (0 without a proof) and at most [l_arm m_t g]; shape (N,) each.

    Args:
        A: wrench map, shape (6, N).
        b: the wrench, shape (6,).
        box: bounds of the inputs of rotors that run, shape (N,) each.
    """
    N = A.shape[1]
    alive = 1.0 - np.eye(N)
    low, high = box.low * alive, box.high * alive
    reached = find_solutions(A, np.tile(b, (N, 1)), Box(low, high))
    lower, upper = np.zeros(N), np.where(reached.no, 0.0, np.inf)
    able = np.flatnonzero(reached.yes)
    for dead in np.array_split(able, math.ceil(len(able) / 20) or 1):  # polytopes that are looked at at once
        made = reached.v[dead] @ A.T  # within the audit's tolerance of b, and produced exactly
        balls = largest_balls(A[3:], A[:3], made[:, 3:], made[:, :3], Box(low[dead], high[dead]))
        lower[dead], upper[dead] = [ball.lower for ball in balls], [max(ball.upper, 0.0) for ball in balls]
    return reached.yes, reached.no, lower, upper

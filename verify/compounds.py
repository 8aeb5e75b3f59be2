r"""Clearance of two rigid bodies that are unions of convex parts.

| symbol | meaning | shape |
|---|---|---|
| A_i, B_j | parts of two bodies | |
| h(u) | support, the largest u.x over a part | |
| g_ij(n) | gap of parts across a unit vector n from A to B: -h_Ai(n) - h_Bj(-n), at most their clearance | |
| d_ij, d | clearance of two parts, max over n of g_ij(n); of the bodies, the least d_ij | |
| s* | growth distance: the factor at which two overlapping parts, scaled about their centres, only touch | |

For parts that are apart the maximum is their distance, and GJK finds n. One plane often proves the rest: a pair of
parts whose gap across the n of another pair is no less than the distance of that pair needs no search of its own.

For parts that overlap, the normal n at which their scaled copies touch gives their depth:
-g_ij(n) is how far one has to move along n to be free. The gap of the copies across a given n is linear in s, so
Newton's iteration from s = 0 (Dinkelbach's) climbs to s* from below in a few steps [1]. From there n climbs to a
maximum of g_ij, the shortest way out.

[1] C. J. Ong, E. G. Gilbert, "Growth distances: new measures for object separation and penetration", IEEE Trans.
Robotics and Automation 12 (1996) 888-903.

Verdicts are proven:

| symbol | meaning |
|---|---|
| A_i, B_j | convex parts of two bodies |
| d | clearance: the distance of the nearest two parts, or minus how far the two deepest are in each other |
| n_ij | unit vector from A to B across which the parts are apart |
| lower | the least gap of any two parts across their n_ij, so d >= lower |
| upper | distance of a point proven in A to one proven in B, or minus the depth of one proven in both: d <= upper |

`clear` when NumPy finds a plane between any two parts that must not touch and FCL finds boxes around the bodies, or
else polytopes around all the parts, apart; `violated` when NumPy finds the point and FCL finds polytopes inside the
two parts overlapping. As with cone-spheres, neither the search for n nor FCL can make a verdict by itself.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from topo_search.model import Status
from verify.bodies import Array
from verify.certificate import BOUND_ROUNDING, FLOOR, Certificate, judge
from verify.convex import Convex, Polyhedron
from verify.gjk import ITERATION, Cores, Flags, cores, nearest
from verify.meshes import LARGEST_COORDINATE, Indices, Shape


class ProximitySettings(NamedTuple):
    """Steps of the search for nearest points."""

    chunk: int = 2_000_000
    """Coordinates of vertices that are held at a time."""
    newton_steps: int = 12
    """Largest number of steps towards a growth distance; a few are enough."""
    ascent_steps: int = 6
    """Largest number of steps from the normal at that factor towards the shortest way out."""
    least_gain: float = 1e-9
    """Least gain of a step towards the shortest way out [l_arm]."""
    aside: tuple[float, ...] = (1e-4, 1e-2, 1.0)
    """Distances that nearly touching parts are moved apart to see which way they face, in sums of their radii."""
    touching: float = 1e-4
    """Copies scaled by s touch when this part of 1 - s apart: less than they were drawn in from the parts."""


SETTINGS = ProximitySettings()


@dataclass(frozen=True, eq=False)
class Compound:
    """A rigid body: the union of convex parts."""

    parts: tuple[Convex, ...]
    bounds: Convex
    """A solid around all of them."""
    frame: int = 0
    """The first so many parts may touch those of a body that is bolted to this one, where the connector is."""
    beyond: int = 0
    """The last so many are pieces of these, too far from the connector: they may not touch them."""
    copied: tuple[Compound, Array, Array] | None = field(default=None, repr=False)
    """The body that this one is, turned by R, then moved by p; None if it stands for itself."""

    def place(self, R: Array, p: Array) -> Compound:
        """Return the body turned by R, shape (3, 3), then moved by p, shape (3,)."""
        parts, copied = tuple(part.place(R, p) for part in self.parts), (self, R, p)
        return Compound(parts, self.bounds.place(R, p), self.frame, self.beyond, copied)

    @functools.cached_property
    def reach(self) -> float:
        """The body lies in the ball of this radius around the origin."""
        return max(part.reach for part in self.parts)

    @functools.cached_property
    def in_range(self) -> bool:
        """True if coordinates of the body keep the digits that a proof needs, and it is thick enough for one."""
        near = bool(np.all(np.abs(self.bounds.centre) + self.bounds.radius < LARGEST_COORDINATE / 16))
        return near and all(part.thick for part in self.parts)


class Proximity(NamedTuple):
    """Clearance of two bodies, with its witness."""

    d: float
    """Clearance, negative if they overlap."""
    lower: float
    """Proven lower bound of d: the least gap across any of the planes."""
    a: int
    """The part of A that is nearest to, or deepest in, B."""
    b: int
    """The part of B."""
    x_A: Array
    """Nearest point of A, or a point in both, shape (3,)."""
    x_B: Array
    """The one in B; or the same point."""
    normals: Array
    """Separating n of parts i and j, or the best one, shape (parts of A, parts of B, 3)."""
    relevant: Flags
    """True if two parts must not touch each other, shape (parts of A, parts of B)."""

    @property
    def n(self) -> Array:
        """The witness normal, from A to B."""
        return np.asarray(self.normals[self.a, self.b])


def proximities(
    pairs: Sequence[tuple[Compound, Compound]], bolted: Sequence[bool], *, measured: bool = True
) -> list[Proximity]:
    """Return how near the bodies of every pair are.

    Args:
        pairs: the bodies.
        bolted: whether their frames may touch where they are bolted together.
        measured: whether it matters how far they are apart, or in each other; else only whether d <= FLOOR.
    """
    if not pairs:
        return []
    bodies = list({id(body): body for pair in pairs for body in pair}.values())
    batch = _Batch(bodies, measured)
    at = {id(body): k for k, body in enumerate(bodies)}
    index = np.array([(at[id(A)], at[id(B)]) for A, B in pairs])
    step = max(1, SETTINGS.chunk // batch.coordinates)
    result: list[Proximity] = []
    for start in range(0, len(pairs), step):
        part = slice(start, start + step)
        result += batch.proximities(index[part], np.array(bolted[part], dtype=bool))
    return result


class _Batch:
    """Some bodies, all parts in arrays."""

    def __init__(self, bodies: list[Compound], measured: bool) -> None:
        self.bodies, self.measured = bodies, measured
        flat = [part for body in bodies for part in body.parts]
        most = max(len(body.parts) for body in bodies)
        self.cores = cores(flat)
        self.ball = np.array([part.ball for part in flat])
        self.first = np.cumsum([0] + [len(body.parts) for body in bodies[:-1]])
        self.count = np.array([len(body.parts) for body in bodies])
        self.frame = np.array([body.frame for body in bodies])
        self.beyond = np.array([body.beyond for body in bodies])
        self.centre = np.array([body.bounds.centre for body in bodies])
        self.middle = np.array([part.centre for part in flat])
        self.radius = np.array([part.radius for part in flat])
        # Bodies with fewer parts than others repeat their first one.
        k = np.arange(most)
        self.part = self.first[:, None] + np.where(k < self.count[:, None], k, 0)
        self.coordinates = 3 * most * self.cores.vertices.shape[1]

    def reach(self, part: Indices, n: Array) -> Array:
        """Return h(n) of parts (N, m) along unit vectors (N, 3), shape (N, m)."""
        along = np.einsum("nmkx,nx->nmk", self.cores.vertices[part], n).max(axis=2)
        axis = self.cores.axis[part]
        across = np.linalg.norm(n[:, None] - np.einsum("nmx,nx->nm", axis, n)[..., None] * axis, axis=2)
        return np.asarray(along + self.cores.disc[part] * across + self.ball[part])

    def gaps(self, A: Indices, B: Indices, n: Array) -> Array:
        """Return g_ij(n) of the parts of pairs, shape (N, m, m)."""
        return -self.reach(A, n)[:, :, None] - self.reach(B, -n)[:, None, :]

    def relevant_pairs(self, index: Indices, bolted: Flags, k: Indices) -> Flags:
        """Return which parts must not touch each other, shape (N, m, m).

        Pieces beyond the connector's neighbourhood are asked about frames alone: of what else may not touch them
        the whole part, which they are pieces of, is asked.
        """
        whole = k < (self.count - self.beyond)[index][..., None]
        beyond = ~whole & (k < self.count[index][..., None])
        frame = k < self.frame[index][..., None]

        def pairs(a: Flags, b: Flags) -> Flags:
            return a[:, 0, :, None] & b[:, 1, None, :]

        together = bolted[:, None, None] & pairs(frame, frame)
        return pairs(whole, whole) & ~together | pairs(beyond, frame) | pairs(frame, beyond)

    def proximities(self, index: Indices, bolted: Flags) -> list[Proximity]:
        """Return how near the bodies `index`, shape (N, 2), are."""
        rows = np.arange(len(index))
        A, B = self.part[index[:, 0]], self.part[index[:, 1]]
        k = np.arange(self.part.shape[1])
        relevant = self.relevant_pairs(index, bolted, k)
        along = _unit(self.centre[index[:, 1]] - self.centre[index[:, 0]])
        guess = np.where(relevant, self.gaps(A, B, along), np.inf).reshape(len(index), -1).argmin(axis=1)
        a, b = np.divmod(guess, k.size)
        best = self.distances(A[rows, a], B[rows, b], along)
        best_d, _, best_n, *_ = best
        # What that plane says of all parts, then what one across their own centre line says; last, a search.
        g = np.where(relevant, self.gaps(A, B, best_n), np.inf)
        n = np.broadcast_to(best_n[:, None, None], (*g.shape, 3)).copy()
        d, x_A, x_B = np.full_like(g, np.inf), np.zeros_like(n), np.zeros_like(n)
        results = d, g, n, x_A, x_B
        for result, value in zip(results, best, strict=True):
            result[rows, a, b] = value
        below = (best_d if self.measured else np.minimum(best_d, 2 * FLOOR))[:, None, None]
        open_ = (g < below) & (d == np.inf)
        p, i, j = np.nonzero(open_)
        own_n = _unit(self.middle[B[p, j]] - self.middle[A[p, i]])
        own_g = self.gap(A[p, i], B[p, j], own_n)
        better = own_g > g[p, i, j]
        p, i, j = p[better], i[better], j[better]
        g[p, i, j], n[p, i, j] = own_g[better], own_n[better]
        p, i, j = np.nonzero(open_ & (g < below))
        for result, value in zip(results, self.distances(A[p, i], B[p, j], n[p, i, j]), strict=True):
            result[p, i, j] = value
        a, b = np.divmod(d.reshape(len(index), -1).argmin(axis=1), k.size)
        least, lower = d[rows, a, b].tolist(), g.min(axis=(1, 2)).tolist()
        m = self.count[index]
        return [
            Proximity(
                *(least[row], lower[row], int(a[row]), int(b[row])),
                *(x_A[row, a[row], b[row]], x_B[row, a[row], b[row]]),
                n[row, : m[row, 0], : m[row, 1]],
                relevant[row, : m[row, 0], : m[row, 1]],
            )
            for row in rows
        ]

    def gap(self, A: Indices, B: Indices, n: Array) -> Array:
        """Return g(n) of N pairs of parts, shape (N,)."""
        return self.gaps(A[:, None], B[:, None], n)[:, 0, 0]

    def distances(self, A: Indices, B: Indices, n: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return d_ij, g_ij(n), n and points as in `Proximity` of N pairs of parts.

        The given n stands in where nearest points have no direction.
        """
        r_A, r_B = self.ball[A], self.ball[B]
        enough = np.inf if self.measured else r_A + r_B + 2 * FLOOR
        result = nearest(self.cores.take(A), self.cores.take(B), n, enough)
        size = np.linalg.norm(result.v, axis=1)
        # Cores as near as the search is exact may as well overlap: what v says of them is rounding.
        lost = result.overlap | (size <= ITERATION.accuracy)
        n = np.where(lost[:, None], n, -result.v / np.where(size > 0, size, 1.0)[:, None])
        d = size - r_A - r_B
        x_A, x_B = result.x_A + r_A[:, None] * n, result.x_B - r_B[:, None] * n
        deep = np.flatnonzero(lost)
        if len(deep) and self.measured:
            flat = [part for body in self.bodies for part in body.parts]
            n[deep], x_A[deep] = touch([(flat[A[k]], flat[B[k]]) for k in deep])
            n[deep], x_B[deep] = self.steepest_directions(A[deep], B[deep], n[deep]), x_A[deep]
        g = self.gap(A, B, n)
        open_ = np.flatnonzero(~lost & (g < d - SETTINGS.least_gain) & self.measured)
        n[open_], g[open_] = self.sharper_directions(A[open_], B[open_], n[open_], g[open_])
        d[deep] = g[deep]
        return d, g, n, x_A, x_B

    def sharper_directions(self, A: Indices, B: Indices, n: Array, g: Array) -> tuple[Array, Array]:
        """Return directions across which N pairs of parts are farther apart than along n, if any, and how far.

        Nearest points that all but coincide tell n with few digits: too few for sides that face each other. They
        tell more when B is moved away along n.
        """
        n, g = n.copy(), g.copy()
        size = (self.radius[A] + self.radius[B])[:, None]
        for away in SETTINGS.aside if len(n) else ():
            moved = self.cores.take(B)
            moved = moved._replace(vertices=moved.vertices + (away * size * n)[:, None])
            turned = _unit(-nearest(self.cores.take(A), moved, n).v)
            gap = self.gap(A, B, turned)
            better = gap > g
            n[better], g[better] = turned[better], gap[better]
        return n, g

    def steepest_directions(self, A: Indices, B: Indices, n: Array) -> Array:
        """Return directions in which N pairs of overlapping parts are less far in each other than along n, if any.

        Moved apart along n by twice -g(n), the parts are |v| >= -g(n) apart across n', so g(n') = |v| + 2 g(n) n.n'
        is at least g(n), and more unless n' = n.
        """
        n, left = n.copy(), np.arange(len(n))
        for _ in range(SETTINGS.ascent_steps):
            g = self.gap(A[left], B[left], n[left])
            moved = self.cores.take(B[left])
            moved = moved._replace(vertices=moved.vertices - 2 * (g[:, None] * n[left])[:, None])
            v = nearest(self.cores.take(A[left]), moved, n[left]).v
            turned = _unit(-v)
            better = self.gap(A[left], B[left], turned) > g + SETTINGS.least_gain
            left = left[better]
            if not len(left):
                break
            n[left] = turned[better]
        return n


def touch(pairs: Sequence[tuple[Convex, Convex]]) -> tuple[Array, Array]:
    """Return the normals, from A to B, at which scaled copies of overlapping solids touch, and where.

    Args:
        pairs: the solids.

    Returns:
        n, shape (N, 3), and a point in both solids each, shape (N, 3).
    """
    A, B = (cores([pair[side] for pair in pairs]) for side in (0, 1))
    c_A, c_B = (np.array([pair[side].centre for pair in pairs]) for side in (0, 1))
    r_A, r_B = (np.array([pair[side].ball for pair in pairs]) for side in (0, 1))
    n, x, s = _unit(c_B - c_A), (c_A + c_B) / 2, np.zeros(len(pairs))
    left = np.arange(len(pairs))
    for _ in range(SETTINGS.newton_steps):
        # The factor at which the gap across n vanishes; never beyond s*, since the copies are apart below it.
        width = np.sum((A.take(left).support(n[left]) - c_A[left]) * n[left], axis=1) + r_A[left]
        width += np.sum((c_B[left] - B.take(left).support(-n[left])) * n[left], axis=1) + r_B[left]
        s[left] = np.maximum(s[left], np.sum((c_B - c_A)[left] * n[left], axis=1) / width)
        result = nearest(_scale(A, c_A, s, left), _scale(B, c_B, s, left), n[left])
        size = np.linalg.norm(result.v, axis=1)
        x[left] = (result.x_A + result.x_B + (s * (r_A - r_B))[left, None] * n[left]) / 2
        apart = ~result.overlap & (size - (s * (r_A + r_B))[left] > SETTINGS.touching * (1 - s[left]))
        left = left[apart]
        if not len(left):
            break
        n[left] = -result.v[apart] / size[apart][:, None]
    return n, x


def _scale(solids: Cores, centre: Array, s: Array, some: Indices) -> Cores:
    """Return some of the solids, scaled by s about their centres."""
    c, by = centre[some, None], s[some]
    return Cores(c + by[:, None, None] * (solids.vertices[some] - c), solids.axis[some], by * solids.disc[some])


def _unit(v: Array) -> Array:
    """Return unit vectors; the z axis for those without a direction."""
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return np.where(length > 0, v / np.where(length > 0, length, 1.0), np.array([0.0, 0.0, 1.0]))


def certify_compounds(pairs: Sequence[tuple[Compound, Compound]], bolted: Sequence[bool]) -> list[Certificate]:
    """Return the certificates of pairs of rigid bodies.

    Args:
        pairs: the bodies, in l_arm.
        bolted: whether the frames of a pair may touch where they are bolted together.
    """
    near = [A.in_range and B.in_range for A, B in pairs]
    indices = [k for k, in_range in enumerate(near) if in_range]
    results = iter(
        proximities([pairs[k] for k in indices], [bolted[k] for k in indices]),
    )
    lost = Certificate(Status.UNDECIDED, None, None, 0.0, 0)
    return [
        _certify(*pair, next(results)) if in_range else lost for pair, in_range in zip(pairs, near, strict=True)
    ]


def _certify(A: Compound, B: Compound, proximity: Proximity) -> Certificate:
    part_A, part_B = A.parts[proximity.a], B.parts[proximity.b]
    if proximity.d > 0:
        upper, closest = math.dist(proximity.x_A, proximity.x_B), np.stack([proximity.x_A, proximity.x_B])
        proven = min(part_A.depth(proximity.x_A), part_B.depth(proximity.x_B)) > -BOUND_ROUNDING
        agrees = functools.partial(_see_apart, A, B, proximity)
    else:
        x = _common_point(part_A, part_B, (proximity.x_A + proximity.x_B) / 2)
        depths = part_A.depth(x), part_B.depth(x)
        upper, closest = -sum(depths), np.stack([x, x])
        proven = min(depths) > BOUND_ROUNDING
        agrees = functools.partial(_overlap, part_A, part_B, x)
    bound = proximity.lower if proximity.d > 0 else proximity.d
    return judge(proximity.d, upper if proven else None, closest, lambda level: (bound, agrees(level)), levels=2)


def _see_apart(A: Compound, B: Compound, proximity: Proximity, level: int) -> bool:
    """Return whether FCL sees the bodies apart: boxes around them; at level 1 all parts that must not touch.

    Meshes turned towards n are made only where the parts' common ones do not do. Those have their origin between
    the parts: FCL needs the digits there, above all for sides that face each other.
    """
    if level == 0:
        return bool(proximity.relevant.all()) and not A.bounds.shape.overlaps(B.bounds.shape)
    for i, j in np.argwhere(proximity.relevant).tolist():
        part_A, part_B, n = A.parts[i], B.parts[j], proximity.normals[i, j]
        if part_A.shape.overlaps(part_B.shape):
            nearest_two = (i, j) == (proximity.a, proximity.b)
            x = (proximity.x_A + proximity.x_B) / 2 if nearest_two else (part_A.centre + part_B.centre) / 2
            near_A, near_B = (part.place(np.eye(3), -x) for part in (part_A, part_B))
            if Shape(near_A.outer(n)).overlaps(Shape(near_B.outer(-n))):
                return False
    return True


def _overlap(part_A: Convex, part_B: Convex, x: Array, level: int) -> bool:
    """Return whether FCL sees meshes inside the deepest parts overlap around x; level 0 does not ask."""
    if level == 0:
        return False
    inner_A, inner_B = (Shape(part.place(np.eye(3), -x).inner(np.zeros(3))) for part in (part_A, part_B))
    return inner_A.overlaps(inner_B)


def _common_point(part_A: Convex, part_B: Convex, x: Array) -> Array:
    """Return x, or a point deeper in two parts where x is on the surface of one.

    Of the polytopes inside them, turned towards x, it is the centre of the largest ball in both: a linear program.
    """
    if min(part_A.depth(x), part_B.depth(x)) > BOUND_ROUNDING:
        return x
    inner = [part.place(np.eye(3), -x).inner(np.zeros(3)) for part in (part_A, part_B)]
    planes = [Polyhedron("inside", mesh.vertices, mesh.triangles).faces for mesh in inner]
    normals, offsets = (np.concatenate(columns) for columns in zip(*planes, strict=True))
    unit = max(float(np.abs(offsets).min()), 1e-9)  # [l_arm]
    rows = np.column_stack([normals, np.ones(len(normals))])
    from scipy.optimize import linprog  # slow to load, and few audits need it

    solution = linprog([0, 0, 0, -1], A_ub=rows, b_ub=offsets / unit, bounds=[(None, None)] * 4)
    return x + unit * solution.x[:3] if solution.success else x

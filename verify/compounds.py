r"""Clearance of rigid bodies that are unions of convex parts.

| symbol | meaning | shape |
|---|---|---|
| A_i, B_j | parts of two bodies | |
| h(u) | support function, the largest u.x over a part | |
| g_ij(n) | gap between parts along a unit vector n from A to B: -h_Ai(n) - h_Bj(-n), at most their clearance | |
| d_ij, d | clearance of two parts, max over n of g_ij(n); of the bodies, min over i, j of d_ij | |
| s* | growth distance: the factor at which two overlapping parts, scaled about their centres, just touch | |

For disjoint parts the maximum is their distance, and GJK finds n. One direction often settles many pairs: if the
gap of a pair along the n of the nearest pair is no less than that pair's distance, the pair needs no search.

For overlapping parts, the normal n at which their scaled copies touch gives their penetration depth: one part has
to move by -g_ij(n) along n to be free. The gap of the copies along a given n is linear in s, so Newton's
(Dinkelbach's) iteration from s = 0 reaches s* from below in a few steps [1]. The shortest way out of a polyhedron
or capsule is along the normal of a facet of A_i - B_j: of a face of either, or across an edge of each. All are
tried. With a cylinder, or too many edges, n ascends from the best of them to a local maximum of g_ij, and -g_ij is
only an upper bound on the depth.

[1] C. J. Ong, E. G. Gilbert, "Growth distances: new measures for object separation and penetration", IEEE Trans.
Robotics and Automation 12 (1996) 888-903.

Verdicts are proven:

| symbol | meaning |
|---|---|
| d | distance of the nearest two parts, or minus the penetration depth of the deepest two |
| n_ij | unit vector from A_i to B_j normal to a separating plane |
| lower | smallest g_ij(n_ij); d >= lower |
| upper | distance of a point proven in A to one proven in B, or minus the depth of one proven in both; d <= upper |

`clear` if NumPy finds a separating plane for every two parts that must not touch, and FCL finds boxes around the
bodies, or else polytopes around all the parts, apart. `violated` if NumPy finds the common point and FCL finds
polytopes inside the two parts overlapping. As with cone-spheres, neither the search for n nor FCL decides alone.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Flags, Indices, Status
from verify.bodies import norms
from verify.certificate import BOUND_ROUNDING, FLOOR, Certificate, judge
from verify.convex import Convex, Polyhedron
from verify.gjk import ITERATION, Cores, cores, nearest
from verify.meshes import LARGEST_COORDINATE, FclPolytope


class ProximitySettings(NamedTuple):
    """Settings of the search for nearest points."""

    chunk: int = 2_000_000
    """Number of vertex coordinates held in memory at a time."""
    newton_steps: int = 12
    """Largest number of steps towards a growth distance; a few are usually enough."""
    ascent_steps: int = 6
    """Largest number of steps from the normal at the growth distance towards the shortest way out."""
    most_normals: int = 20_000
    """Largest number of pairs of edges whose common normals are tried for a shortest way out."""
    least_gain: float = 1e-9
    """Smallest improvement of a gap that counts [l_arm]."""
    separations: tuple[float, ...] = (1e-4, 1e-2, 1.0)
    """Distances by which nearly touching parts are separated to find their normal, over the sum of radii."""
    touching: float = 1e-4
    """Copies scaled by s count as touching at a distance of this times 1 - s: within the original parts."""


SETTINGS = ProximitySettings()


@dataclass(frozen=True, eq=False)
class Compound:
    """A rigid body: the union of convex parts."""

    parts: tuple[Convex, ...]
    bounds: Convex
    """A solid around all parts."""
    frame: int = 0
    """Number of frame parts, which come first; they may touch those of a bolted neighbour near the connector."""
    outer_pieces: int = 0
    """Number of pieces of frame parts away from the connector, which come last; they may not touch its frame."""
    source: tuple[Compound, Array, Array] | None = field(default=None, repr=False)
    """Original body of which this is a copy, with its rotation R and translation p; None if it is no copy."""

    def place(self, R: Array, p: Array) -> Compound:
        """Return a copy rotated by R, shape (3, 3), then translated by p, shape (3,)."""
        parts, source = tuple(part.place(R, p) for part in self.parts), (self, R, p)
        return Compound(parts, self.bounds.place(R, p), self.frame, self.outer_pieces, source)

    def place_like(self, copy: Compound) -> Compound:
        """Return a copy at the pose of another body's copy, sharing the parts that the bodies have in common."""
        assert copy.source is not None
        whole, R, p = copy.source
        placed = dict(zip(whole.parts, copy.parts, strict=True))
        parts = tuple(placed.get(part) or part.place(R, p) for part in self.parts)
        return Compound(parts, copy.bounds, self.frame, self.outer_pieces)

    @property
    def rotors(self) -> int:
        """Number of rotors, the parts after the frame."""
        return len(self.parts) - self.frame

    @functools.cached_property
    def reach(self) -> float:
        """Radius of a bounding ball around the origin."""
        return max(part.reach for part in self.parts)

    @functools.cached_property
    def in_range(self) -> bool:
        """True if coordinates are precise enough for a proof and no part is too thin for one."""
        is_near_origin = bool(np.all(np.abs(self.bounds.centre) + self.bounds.radius < LARGEST_COORDINATE / 16))
        return is_near_origin and all(part.thick for part in self.parts)


class Proximity(NamedTuple):
    """Clearance of two bodies, with its witness."""

    d: float
    """Clearance, negative for an overlap."""
    lower: float
    """Proven lower bound on d: the smallest gap along the normals."""
    a: int
    """Index of the part of A that is nearest to, or deepest in, B."""
    b: int
    """Index of that part of B."""
    x_A: Array
    """Nearest point of A, or a common point, shape (3,)."""
    x_B: Array
    """Nearest point of B, or the same common point."""
    normals: Array
    """Separating normals of all pairs of parts, or the best ones found, shape (parts of A, parts of B, 3)."""
    relevant: Flags
    """True if the two parts must not touch, shape (parts of A, parts of B)."""


def proximities(
    pairs: Sequence[tuple[Compound, Compound]], bolted: Sequence[bool], *, measured: bool = True
) -> list[Proximity]:
    """Return the clearance of every pair of bodies.

    Args:
        pairs: the bodies.
        bolted: whether the frames of a pair may touch near the connector.
        measured: whether the exact clearance is needed, not only whether d <= FLOOR.
    """
    if not pairs:
        return []
    bodies = list({id(body): body for pair in pairs for body in pair}.values())
    batch = _Batch(bodies, measured)
    number = {id(body): k for k, body in enumerate(bodies)}
    index = np.array([(number[id(A)], number[id(B)]) for A, B in pairs])
    step = max(1, SETTINGS.chunk // batch.coordinates)
    result: list[Proximity] = []
    for start in range(0, len(pairs), step):
        rows = slice(start, start + step)
        result += batch.proximities(index[rows], np.array(bolted[rows], dtype=bool))
    return result


class _Batch:
    """The parts of several bodies as arrays."""

    def __init__(self, bodies: list[Compound], measured: bool) -> None:
        self.measured = measured
        number = {part: k for k, part in enumerate(dict.fromkeys(part for body in bodies for part in body.parts))}
        self.parts, max_parts = list(number), max(len(body.parts) for body in bodies)
        self.cores = cores(self.parts)
        self.ball = np.array([part.ball for part in self.parts])
        self.count = np.array([len(body.parts) for body in bodies])
        self.frame = np.array([body.frame for body in bodies])
        self.outer_pieces = np.array([body.outer_pieces for body in bodies])
        self.centre = np.array([body.bounds.centre for body in bodies])
        self.middle = np.array([part.centre for part in self.parts])
        # Bodies with fewer parts repeat their first one.
        repeated = ((*body.parts, *body.parts[:1] * (max_parts - len(body.parts))) for body in bodies)
        self.part = np.array([[number[part] for part in parts] for parts in repeated])
        self.coordinates = 3 * max_parts * self.cores.vertices.shape[1]

    def reach(self, part: Indices, n: Array) -> Array:
        """Return h(n) of parts (N, m) for unit vectors (N, 3), shape (N, m)."""
        along = np.einsum("nmkx,nx->nmk", self.cores.vertices[part], n).max(axis=2)
        axis = self.cores.axis[part]
        across = np.linalg.norm(n[:, None] - np.einsum("nmx,nx->nm", axis, n)[..., None] * axis, axis=2)
        return np.asarray(along + self.cores.disc[part] * across + self.ball[part])

    def gaps(self, A: Indices, B: Indices, n: Array) -> Array:
        """Return g_ij(n) of the parts of pairs, shape (N, m, m)."""
        return -self.reach(A, n)[:, :, None] - self.reach(B, -n)[:, None, :]

    def relevant_parts(self, index: Indices, bolted: Flags, k: Indices) -> Flags:
        """Return which pairs of parts must not touch, shape (N, m, m).

        Outer pieces are compared only with frame parts; the whole parts that they belong to cover the other pairs.
        """
        whole = k < (self.count - self.outer_pieces)[index][..., None]
        outer_piece = ~whole & (k < self.count[index][..., None])
        frame = k < self.frame[index][..., None]

        def pairs(a: Flags, b: Flags) -> Flags:
            return a[:, 0, :, None] & b[:, 1, None, :]

        allowed = bolted[:, None, None] & pairs(frame, frame)
        return pairs(whole, whole) & ~allowed | pairs(outer_piece, frame) | pairs(frame, outer_piece)

    def proximities(self, index: Indices, bolted: Flags) -> list[Proximity]:
        """Return the clearances of the pairs of bodies `index`, shape (N, 2)."""
        rows = np.arange(len(index))
        A, B = self.part[index[:, 0]], self.part[index[:, 1]]
        k = np.arange(self.part.shape[1])
        relevant = self.relevant_parts(index, bolted, k)
        along = _unit(self.centre[index[:, 1]] - self.centre[index[:, 0]])
        guess = np.where(relevant, self.gaps(A, B, along), np.inf).reshape(len(index), -1).argmin(axis=1)
        a, b = np.divmod(guess, k.size)
        best = self.distances(A[rows, a], B[rows, b], along)
        best_d, _, best_n, *_ = best
        # All pairs of parts: the gap along that normal, then along their own centre line; last, a search.
        g = np.where(relevant, self.gaps(A, B, best_n), np.inf)
        n = np.broadcast_to(best_n[:, None, None], (*g.shape, 3)).copy()
        d, x_A, x_B = np.full_like(g, np.inf), np.zeros_like(n), np.zeros_like(n)
        results = d, g, n, x_A, x_B
        for result, value in zip(results, best, strict=True):
            result[rows, a, b] = value
        target = (best_d if self.measured else np.minimum(best_d, 2 * FLOOR))[:, None, None]
        unsettled = (g < target) & (d == np.inf)
        p, i, j = np.nonzero(unsettled)
        centre_n = _unit(self.middle[B[p, j]] - self.middle[A[p, i]])
        centre_g = self.gap(A[p, i], B[p, j], centre_n)
        better = centre_g > g[p, i, j]
        p, i, j = p[better], i[better], j[better]
        g[p, i, j], n[p, i, j] = centre_g[better], centre_n[better]
        p, i, j = np.nonzero(unsettled & (g < target))
        for result, value in zip(results, self.distances(A[p, i], B[p, j], n[p, i, j]), strict=True):
            result[p, i, j] = value
        a, b = np.divmod(d.reshape(len(index), -1).argmin(axis=1), k.size)
        clearance, lower = d[rows, a, b].tolist(), g.min(axis=(1, 2)).tolist()
        m = self.count[index]
        return [
            Proximity(
                *(clearance[row], lower[row], int(a[row]), int(b[row])),
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
        """Return d_ij, g_ij(n), n, x_A and x_B, as in `Proximity`, of N pairs of parts.

        The given n is the initial guess, and the result where the nearest points define no direction.
        """
        r_A, r_B = self.ball[A], self.ball[B]
        enough = np.inf if self.measured else r_A + r_B + 2 * FLOOR
        result = nearest(self.cores.take(A), self.cores.take(B), n, enough)
        size = norms(result.v)
        # Cores within the accuracy of the search may as well overlap; their v is rounding.
        overlaps = result.overlap | (size <= ITERATION.accuracy)
        n = np.where(overlaps[:, None], n, -result.v / np.where(size > 0, size, 1.0)[:, None])
        d = size - r_A - r_B
        x_A, x_B = result.x_A + r_A[:, None] * n, result.x_B - r_B[:, None] * n
        overlap = np.flatnonzero(overlaps)
        if len(overlap) and self.measured:
            n[overlap], x_A[overlap] = touch([(self.parts[A[k]], self.parts[B[k]]) for k in overlap])
            n[overlap], x_B[overlap] = self.escape_normals(A[overlap], B[overlap], n[overlap]), x_A[overlap]
        g = self.gap(A, B, n)
        loose = np.flatnonzero(~overlaps & (g < d - SETTINGS.least_gain) & self.measured)
        n[loose], g[loose] = self.refine_normals(A[loose], B[loose], n[loose], g[loose])
        d[overlap] = g[overlap]
        return d, g, n, x_A, x_B

    def refine_normals(self, A: Indices, B: Indices, n: Array, g: Array) -> tuple[Array, Array]:
        """Return normals with larger gaps than n, if any, and the gaps, of N pairs of parts.

        Nearest points that almost coincide give n only a few digits, too few for faces that are parallel. Moving B
        away along n restores them.
        """
        n, g = n.copy(), g.copy()
        size = np.array([[self.parts[a].radius + self.parts[b].radius] for a, b in zip(A, B, strict=True)])
        for separation in SETTINGS.separations if len(n) else ():
            moved = self.cores.take(B)
            moved = moved._replace(vertices=moved.vertices + (separation * size * n)[:, None])
            candidate = _unit(-nearest(self.cores.take(A), moved, n).v)
            gap = self.gap(A, B, candidate)
            better = gap > g
            n[better], g[better] = candidate[better], gap[better]
        return n, g

    def escape_normals(self, A: Indices, B: Indices, n: Array) -> Array:
        """Return normals along which N pairs of overlapping parts penetrate less than along n, if any.

        The best of `facet_normals` is exact for polyhedra and capsules. From there n ascends: moved apart along n
        by 2 |g(n)|, the parts have a distance |v| >= |g(n)| along n', so g(n') = |v| + 2 g(n) n.n' is at least
        g(n), and greater unless n' = n.
        """
        n, active = n.copy(), np.arange(len(n))
        for k, (a, b) in enumerate(zip(A, B, strict=True)):
            candidates = np.concatenate([n[k : k + 1], facet_normals(self.parts[a], self.parts[b])])
            g = -self.parts[a].supports(candidates) - self.parts[b].supports(-candidates)
            n[k] = candidates[np.argmax(g)]
        for _ in range(SETTINGS.ascent_steps):
            g = self.gap(A[active], B[active], n[active])
            moved = self.cores.take(B[active])
            moved = moved._replace(vertices=moved.vertices - 2 * (g[:, None] * n[active])[:, None])
            v = nearest(self.cores.take(A[active]), moved, n[active]).v
            candidate = _unit(-v)
            better = self.gap(A[active], B[active], candidate) > g + SETTINGS.least_gain
            active = active[better]
            if not len(active):
                break
            n[active] = candidate[better]
        return n


def facet_normals(A: Convex, B: Convex) -> Array:
    """Return unit normals, with those of all facets of A - B if both are polyhedra or capsules, shape (k, 3).

    A facet is one of A or B, or spanned by an edge of each. More than `most_normals` of the latter are left out.
    """
    edges_A, edges_B = A.edge_directions, B.edge_directions
    normals = [A.facet_normals, B.facet_normals]
    if len(edges_A) * len(edges_B) <= SETTINGS.most_normals:
        crosses = np.cross(edges_A[:, None], edges_B[None]).reshape(-1, 3)
        length = norms(crosses)
        normals.append(crosses[length > 1e-9] / length[length > 1e-9, None])
    both = np.concatenate(normals)
    return np.concatenate([both, -both])


def touch(pairs: Sequence[tuple[Convex, Convex]]) -> tuple[Array, Array]:
    """Return the normals, from A to B, at which scaled copies of overlapping solids touch, and common points."""
    A, B = (cores([pair[side] for pair in pairs]) for side in (0, 1))
    c_A, c_B = (np.array([pair[side].centre for pair in pairs]) for side in (0, 1))
    r_A, r_B = (np.array([pair[side].ball for pair in pairs]) for side in (0, 1))
    n, x, s = _unit(c_B - c_A), (c_A + c_B) / 2, np.zeros(len(pairs))
    active = np.arange(len(pairs))
    for _ in range(SETTINGS.newton_steps):
        # The factor at which the gap along n vanishes; it never exceeds s*, below which the copies are disjoint.
        width = np.sum((A.take(active).support(n[active]) - c_A[active]) * n[active], axis=1) + r_A[active]
        width += np.sum((c_B[active] - B.take(active).support(-n[active])) * n[active], axis=1) + r_B[active]
        s[active] = np.maximum(s[active], np.sum((c_B - c_A)[active] * n[active], axis=1) / width)
        result = nearest(_scale(A, c_A, s, active), _scale(B, c_B, s, active), n[active])
        size = norms(result.v)
        x[active] = (result.x_A + result.x_B + (s * (r_A - r_B))[active, None] * n[active]) / 2
        disjoint = ~result.overlap & (size - (s * (r_A + r_B))[active] > SETTINGS.touching * (1 - s[active]))
        active = active[disjoint]
        if not len(active):
            break
        n[active] = -result.v[disjoint] / size[disjoint][:, None]
    return n, x


def _scale(solids: Cores, centre: Array, s: Array, rows: Indices) -> Cores:
    """Return the rows of a batch, scaled by s about their centres."""
    c, factor = centre[rows, None], s[rows]
    vertices = c + factor[:, None, None] * (solids.vertices[rows] - c)
    return Cores(vertices, solids.axis[rows], factor * solids.disc[rows])


def _unit(v: Array) -> Array:
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return np.where(length > 0, v / np.where(length > 0, length, 1.0), np.array([0.0, 0.0, 1.0]))


def certify_compounds(pairs: Sequence[tuple[Compound, Compound]], bolted: Sequence[bool]) -> list[Certificate]:
    """Certify that pairs of rigid bodies keep apart.

    Args:
        pairs: the bodies, in l_arm.
        bolted: whether the frames of a pair may touch near the connector.
    """
    in_range = [A.in_range and B.in_range for A, B in pairs]
    indices = [k for k, ok in enumerate(in_range) if ok]
    results = iter(proximities([pairs[k] for k in indices], [bolted[k] for k in indices]))
    undecided = Certificate(Status.UNDECIDED, None, None, 0.0, 0)
    return [_certify(*pair, next(results)) if ok else undecided for pair, ok in zip(pairs, in_range, strict=True)]


def _certify(A: Compound, B: Compound, proximity: Proximity) -> Certificate:
    part_A, part_B = A.parts[proximity.a], B.parts[proximity.b]
    if proximity.d > 0:
        upper, closest = math.dist(proximity.x_A, proximity.x_B), np.stack([proximity.x_A, proximity.x_B])
        proven = min(part_A.depth(proximity.x_A), part_B.depth(proximity.x_B)) > -BOUND_ROUNDING
        fcl_agrees = functools.partial(_fcl_apart, A, B, proximity)
    else:
        x = _common_point(part_A, part_B, (proximity.x_A + proximity.x_B) / 2)
        depths = part_A.depth(x), part_B.depth(x)
        upper, closest = -sum(depths), np.stack([x, x])
        proven = min(depths) > BOUND_ROUNDING
        fcl_agrees = functools.partial(_fcl_overlap, part_A, part_B, x)
    bound = proximity.lower if proximity.d > 0 else proximity.d
    upper_bound = upper if proven else None
    return judge(proximity.d, upper_bound, closest, lambda level: (bound, fcl_agrees(level)), levels=2)


def _fcl_apart(A: Compound, B: Compound, proximity: Proximity, level: int) -> bool:
    """Return whether FCL finds boxes around the bodies apart; at level 1, all parts that must not touch.

    Meshes turned towards n are built only if the parts' common meshes overlap. Their origin is between the parts,
    where FCL needs the precision, especially for parallel faces.
    """
    if level == 0:
        return bool(proximity.relevant.all()) and not A.bounds.shape.overlaps(B.bounds.shape)
    for i, j in np.argwhere(proximity.relevant).tolist():
        part_A, part_B, n = A.parts[i], B.parts[j], proximity.normals[i, j]
        if part_A.shape.overlaps(part_B.shape):
            is_nearest = (i, j) == (proximity.a, proximity.b)
            x = (proximity.x_A + proximity.x_B) / 2 if is_nearest else (part_A.centre + part_B.centre) / 2
            shifted_A, shifted_B = (part.place(np.eye(3), -x) for part in (part_A, part_B))
            if FclPolytope(shifted_A.outer(n)).overlaps(FclPolytope(shifted_B.outer(-n))):
                return False
    return True


def _fcl_overlap(part_A: Convex, part_B: Convex, x: Array, level: int) -> bool:
    """Return whether FCL finds meshes inside the deepest parts overlapping around x; False at level 0."""
    if level == 0:
        return False
    inner_A, inner_B = (FclPolytope(part.place(np.eye(3), -x).inner(np.zeros(3))) for part in (part_A, part_B))
    return inner_A.overlaps(inner_B)


def _common_point(part_A: Convex, part_B: Convex, x: Array) -> Array:
    """Return x, or a point deeper in both parts if x is on the surface of one.

    A linear program finds the centre of the largest ball in both inner polytopes, which are turned towards x.
    """
    if min(part_A.depth(x), part_B.depth(x)) > BOUND_ROUNDING:
        return x
    inner = [part.place(np.eye(3), -x).inner(np.zeros(3)) for part in (part_A, part_B)]
    planes = [Polyhedron("inside", mesh.vertices, mesh.triangles).faces for mesh in inner]
    normals, offsets = (np.concatenate(columns) for columns in zip(*planes, strict=True))
    scale = max(float(np.abs(offsets).min()), 1e-9)  # [l_arm]
    rows = np.column_stack([normals, np.ones(len(normals))])
    from scipy.optimize import linprog  # slow to load, and few audits need it

    solution = linprog([0, 0, 0, -1], A_ub=rows, b_ub=offsets / scale, bounds=[(None, None)] * 4)
    return x + scale * solution.x[:3] if solution.success else x

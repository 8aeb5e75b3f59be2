r"""Proven verdicts on rotors, hubs and arms beside the airflow of other modules.

All is seen from the module whose parts they are, where every module's parts stand alike: then one part and many
envelopes are one question. Lengths are in l_arm.

| symbol | meaning | shape |
|---|---|---|
| A | a convex part in its module's frame | |
| K | envelope of the other module: balls B(P(eta), r(eta)), eta in [0, 1] | |
| x(eta) | the point of A nearest to P(eta) | (3,) |
| d | clearance, the least \|P - x\| - r | scalar |
| n | unit vector from K to A where they are nearest | (3,) |
| lower | gap of a plane across n: least n.y over A, minus K's support, so d >= lower | scalar |
| upper | distance of x, proven in A, from a point proven in K; or minus the depth of x in K | scalar |

\|P - x\| - r is convex in eta, and its slope is the change of P along -n, less that of r: bisection finds where it
vanishes. Hub and arms count as one. Parts whose ball is farther away than the middle of another one are bounded by
that ball. `clear` when NumPy finds the planes and FCL finds a box around the module, or else polytopes around its
parts, apart from one around K; `violated` when NumPy finds the point and FCL polytopes inside both overlapping. So
neither bisection nor FCL can make a verdict by itself.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from topo_search.model import Status
from verify.bodies import Array, Rows, nearest_on_axis
from verify.certificate import BOUND_ROUNDING, TURNED_LEVELS, Certificate, ClearanceRow, Solid, facing_mesh, judge
from verify.compounds import Compound
from verify.convex import Box, Convex, Cylinder, Polyhedron
from verify.gjk import Cores, cores, nearest
from verify.meshes import ConvexMesh, Indices, Shape

ROTORS = 4


BesideAirflow = ClearanceRow[Compound, Solid]
"""Parts of one module that must keep out of the airflow of another: its rotor `segment`, else hub and arms."""


def parts_of(row: BesideAirflow) -> tuple[Convex, ...]:
    """Return these parts."""
    frame = row.body.frame
    return row.body.parts[:frame] if row.segment is None else (row.body.parts[frame + row.segment],)


class _Found(NamedTuple):
    """Clearances of module parts from envelopes, in the frames of the modules; N rows."""

    d: Array
    lower: Array
    upper: Array
    """NaN where it is not proven."""
    x: Array
    """Shape (N, 3)."""
    n: Array
    """Shape (N, 3)."""
    part: Indices
    """The part that is nearest."""

    @property
    def closest(self) -> Array:
        """Closest points, shape (N, 2, 3): of a gap, of part and envelope; of an overlap, one in both, twice."""
        return np.stack([self.x, self.x - np.maximum(self.d, 0.0)[..., None] * self.n], axis=-2)


def beside_airflow(
    modules: Sequence[Compound], envelopes: Sequence[Solid], *, counts: bool
) -> Iterator[BesideAirflow]:
    """Yield every rotor, then hub and arms, of every module against the airflow of every other one."""
    return (
        BesideAirflow("rotor-airflow", a, b, module, envelope, segment, counts)
        for a, module in enumerate(modules)
        for b, envelope in enumerate(envelopes)
        if a != b
        for segment in (*range(ROTORS), None)
    )


def certify_beside(requirements: Sequence[BesideAirflow]) -> list[Certificate]:
    """Return the certificates of what `beside_airflow` yields, for copies of one module."""
    if not requirements:
        return []
    pairs = requirements[:: ROTORS + 1]
    R, p = (np.array(column) for column in zip(*(_place(pair.body) for pair in pairs), strict=True))
    distances = _find(pairs, R, p)
    proven = [
        (row.lower > BOUND_ROUNDING)
        & (row.d > 0)
        & (row.lower - BOUND_ROUNDING <= row.d)
        & (row.d <= row.upper + BOUND_ROUNDING)
        for row in distances
    ]
    certificates = []
    closest = [np.einsum("nij,nkj->nki", R, row.closest) + p[:, None] for row in distances]
    columns = [
        (row.d.tolist(), row.lower.tolist(), row.upper.tolist(), ok.tolist())
        for row, ok in zip(distances, proven, strict=True)
    ]
    for k, pair in enumerate(pairs):
        in_range = pair.body.in_range and pair.against.in_range
        outer = pair.against.outer if in_range else None
        apart = outer is not None and not pair.body.bounds.shape.overlaps(outer[1])
        for side, (d, lower, upper, ok) in enumerate(columns):
            if not in_range:
                certificates.append(Certificate(Status.UNDECIDED, None, None, d[k], 0))
            elif apart and ok[k]:
                certificates.append(Certificate(Status.CLEAR, lower[k], upper[k], d[k], 0, closest[side][k]))
            else:
                at = _Found(*(column[k] for column in distances[side]))
                proof = functools.partial(_proof, requirements[k * (ROTORS + 1) + side], at)
                proven_upper = None if np.isnan(at.upper) else float(at.upper)
                # a box, the parts' common meshes, then meshes turned towards the witness
                levels = 2 + len(TURNED_LEVELS)
                certificates.append(judge(float(at.d), proven_upper, closest[side][k], proof, levels))
    return certificates


def _place(body: Compound) -> tuple[Array, Array]:
    assert body.copied is not None
    return body.copied[1:]


def _proof(pair: BesideAirflow, at: _Found, level: int) -> tuple[float, bool]:
    """Return the gap across the plane, and whether FCL agrees with its sign at this level."""
    R, p = _place(pair.body)
    n, x = R @ at.n, R @ at.x + p
    if at.d > 0:
        return float(at.lower), _fcl_apart(pair, n, x, level)
    return float(at.lower), level >= 2 and _fcl_overlap(pair, at, n, x, level)


def _fcl_apart(pair: BesideAirflow, n: Array, x: Array, level: int) -> bool:
    outer = pair.against.outer
    if level == 0:
        return outer is not None and not pair.body.bounds.shape.overlaps(outer[1])
    near = [part for part in parts_of(pair) if outer is None or part.shape.overlaps(outer[1])]
    if level == 1 or not near:
        return not near
    mesh = facing_mesh(pair.against.body, x, n, TURNED_LEVELS[level - 2], inside=False)
    if mesh is None:
        return False
    shape = Shape(mesh)
    return not any(shape.overlaps(Shape(_move(part.outer(-n), -x))) for part in near)


def _fcl_overlap(pair: BesideAirflow, at: _Found, n: Array, x: Array, level: int) -> bool:
    mesh, part = (
        facing_mesh(pair.against.body, x, n, TURNED_LEVELS[level - 2], inside=True),
        pair.body.parts[int(at.part)],
    )
    return mesh is not None and Shape(mesh).overlaps(Shape(_move(part.inner(x), -x)))


def _move(mesh: ConvexMesh, shift: Array) -> ConvexMesh:
    return ConvexMesh(mesh.vertices + shift, mesh.triangles)


def _find(pairs: Sequence[BesideAirflow], R: Array, p: Array) -> list[_Found]:
    """Return how near rotors 0 to 3 and the frame are, for pairs whose modules are at R (N, 3, 3) and p (N, 3)."""
    assert pairs[0].body.copied is not None
    module = pairs[0].body.copied[0]
    K = Rows.of([pair.against.body for pair in pairs])
    to_frame = R.transpose(0, 2, 1)
    o = np.einsum("nij,nj->ni", to_frame, K.o - p)
    K = Rows(o, np.einsum("nij,nj->ni", to_frame, K.d), K.r, K.dr)
    module_parts, frame = module.parts, module.frame
    rotors = [_nearest(part, K, np.full(len(R), frame + k)) for k, part in enumerate(module_parts[frame:])]
    return [*rotors, _of_frame(module_parts[:frame], K)]


def _of_frame(frame: Sequence[Convex], K: Rows) -> _Found:
    """Return how near the nearest of some parts is."""
    N = len(K.r)
    bounds = [_ball_bounds(part, K) for part in frame]
    farthest = np.min([upper for _, upper in bounds], axis=0)
    least = np.full(N, np.inf)
    best = _Found(least.copy(), least, least.copy(), np.zeros((N, 3)), np.zeros((N, 3)), np.zeros(N, dtype=np.intp))
    for k, (part, (lower, _)) in enumerate(zip(frame, bounds, strict=True)):
        far = lower > farthest
        least[far] = np.minimum(least[far], lower[far])
        rows = np.flatnonzero(~far)
        candidate = _nearest(part, K.take(rows), np.full(len(rows), k))
        least[rows] = np.minimum(least[rows], candidate.lower)
        nearer = ~(candidate.d >= best.d[rows])  # also what is not a number
        for name in ("d", "upper", "x", "n", "part"):
            getattr(best, name)[rows[nearer]] = getattr(candidate, name)[nearer]
    return best


def _ball_bounds(part: Convex, K: Rows) -> tuple[Array, Array]:
    """Return bounds of the clearance: by a plane before a ball around the part, and by the part's middle."""
    w = K.o - part.centre
    eta = nearest_on_axis(w, K.d, K.dr)
    v = w + eta[:, None] * K.d
    apart = np.linalg.norm(v, axis=1)
    n = -v / np.where(apart > 0, apart, 1.0)[:, None]
    return n @ part.centre - part.radius - K.extents(n, 1).max(axis=1), apart - K.radius(eta)


def _nearest(part: Convex, K: Rows, number: Indices) -> _Found:
    """Return how near a part is to every envelope."""
    eta = _where_least(part, K)
    P = K.centre(eta)
    x = _nearest_points(part, P)
    v = x - P
    apart = np.linalg.norm(v, axis=1)
    n = np.where(apart[:, None] > 0, v / np.where(apart > 0, apart, 1.0)[:, None], np.array([0.0, 0.0, 1.0]))
    d = apart - K.radius(eta)
    lower = np.minimum(
        d, -_support(part, -n) - K.extents(n, 1).max(axis=1)
    )  # equal up to rounding where n is right
    x_K = P + K.radius(eta)[:, None] * n
    within = _depth(part, x) > -BOUND_ROUNDING
    deep = K.depth(x)
    gap = np.where(within & (K.depth(x_K) > -BOUND_ROUNDING), np.linalg.norm(x - x_K, axis=1), np.nan)
    upper = np.where(d > 0, gap, np.where(within & (deep > 2 * BOUND_ROUNDING), -deep, np.nan))
    return _Found(d, lower, upper, x, n, number)


def _where_least(part: Convex, K: Rows) -> Array:
    """Return eta where the clearance is attained."""

    def rises(eta: Array, rows: Indices) -> Array:
        P = K.o[rows] + eta[:, None] * K.d[rows]
        v = P - _nearest_points(part, P)
        apart = np.linalg.norm(v, axis=1)
        return np.asarray(np.sum(v * K.d[rows], axis=1) > K.dr[rows] * apart)

    everyone = np.arange(len(K.r))
    eta = np.where(rises(np.zeros(len(everyone)), everyone), 0.0, 1.0)
    rows = np.flatnonzero((eta == 1.0) & rises(np.ones(len(everyone)), everyone))
    low, high = np.zeros(len(rows)), np.ones(len(rows))
    for _ in range(52 if len(rows) else 0):  # bisections of the axis, down to rounding
        middle = (low + high) / 2
        up = rises(middle, rows)
        low, high = np.where(up, low, middle), np.where(up, middle, high)
    eta[rows] = (low + high) / 2
    return eta


def _nearest_points(part: Convex, points: Array) -> Array:
    """Return the points of a part nearest to some points, shape (N, 3).

    Those inside stand for themselves to the last digit: rounding would be taken for a way out.
    """
    if isinstance(part, Cylinder):
        q = points - part.centre
        along = q @ part.axis
        across = q - along[:, None] * part.axis
        rho = np.linalg.norm(across, axis=1)
        shrunk = np.minimum(1.0, part.disc / np.where(rho > 0, rho, part.disc))
        height = np.clip(along, -part.half, part.half)
        inside = (rho <= part.disc) & (height == along)
        x = part.centre + shrunk[:, None] * across + height[:, None] * part.axis
        return np.where(inside[:, None], points, x)
    if isinstance(part, Box):
        size = np.linalg.norm(part.half, axis=1)
        axes = part.half / size[:, None]
        q = (points - part.centre) @ axes.T
        inside = np.all(np.abs(q) <= size, axis=1)
        return np.where(inside[:, None], points, part.centre + np.clip(q, -size, size) @ axes)
    many = Cores(*(np.repeat(column, len(points), axis=0) for column in cores([part])))
    alone = Cores(points[:, None], np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros(len(points)))
    result = nearest(many, alone, points - part.centre)
    return np.where(result.overlap[:, None], points, result.x_A)


def _support(part: Convex, u: Array) -> Array:
    """Return the support of a part along unit vectors, shape (N, 3) to (N,)."""
    across = np.linalg.norm(u - (u @ part.axis)[:, None] * part.axis, axis=1)
    return np.asarray((u @ part.vertices.T).max(axis=1) + part.disc * across + part.ball)


def _depth(part: Convex, x: Array) -> Array:
    """Return how deep points are in a part, shape (N, 3) to (N,); negative outside."""
    if isinstance(part, Cylinder):
        q = x - part.centre
        along = q @ part.axis
        rho = np.linalg.norm(q - along[:, None] * part.axis, axis=1)
        return np.asarray(np.minimum(part.disc - rho, part.half - np.abs(along)))
    assert isinstance(part, Polyhedron)
    normals, offsets = part.faces
    if not len(offsets):  # slivers alone: nothing is proven to lie inside
        return np.full(len(x), -np.inf)
    return np.asarray((offsets - x @ normals.T).min(axis=1))

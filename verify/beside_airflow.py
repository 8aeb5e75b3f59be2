r"""Proven verdicts on rotors, hubs and arms beside the airflow of other modules.

Computations are in the frame of the module that owns the parts, where all modules of a type look alike, so each
part is compared with all envelopes in one batch. Lengths are in l_arm.

| symbol | meaning | shape |
|---|---|---|
| A | a convex part in its module's frame | |
| K | envelope of the other module: balls B(P(eta), r(eta)), eta in [0, 1] | |
| x(eta) | the point of A nearest to P(eta) | (3,) |
| d | clearance, min over eta of \|P - x\| - r | scalar |
| n | unit vector from K to A at their nearest points | (3,) |
| lower | gap between planes normal to n: min of n.y over A, minus K's support; d >= lower | scalar |
| upper | distance of x, proven in A, from a point proven in K; or minus the depth of x in K; d <= upper | scalar |

\|P - x\| - r is convex in eta; bisection finds the zero of its slope, the change of P along -n minus that of r. Hub
and arms count as one body. If the bounding ball of a part is farther away than the centre of another part, that
ball bounds its clearance. `clear` if NumPy finds the planes and FCL finds a box around the module, or else
polytopes around its parts, apart from one around K. `violated` if NumPy finds the common point and FCL finds
polytopes inside both overlapping. So neither bisection nor FCL decides a verdict alone.
"""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Indices, Mount, Status
from verify import certificate
from verify.bodies import ConeSpheres, nearest_on_axis, norms
from verify.compounds import Compound
from verify.convex import Box, Convex, Cylinder, Polyhedron
from verify.gjk import Cores, cores, nearest
from verify.meshes import ConvexMesh, FclPolytope
from verify.requirements import PlacedAir, Scene

BesideAirflow = certificate.ClearanceCheck[Compound, certificate.RoundBody]
"""Check of one module's rotor `segment`, or hub and arms if None, against the airflow of another module."""


def parts_of(check: BesideAirflow) -> tuple[Convex, ...]:
    """Return the parts that a check is about."""
    frame = check.body.frame
    return check.body.parts[:frame] if check.segment is None else (check.body.parts[frame + check.segment],)


class _Clearances(NamedTuple):
    """Clearances of module parts from N envelopes, in the modules' frames."""

    d: Array
    lower: Array
    upper: Array
    """NaN where unproven."""
    x: Array
    """Shape (N, 3)."""
    n: Array
    """Shape (N, 3)."""
    part: Indices
    """Index of the nearest part."""

    @property
    def closest(self) -> Array:
        """Nearest points of part and envelope, or one common point twice, shape (N, 2, 3)."""
        return np.stack([self.x, self.x - np.maximum(self.d, 0.0)[..., None] * self.n], axis=-2)


def beside_airflow(
    modules: Sequence[Compound], envelopes: Sequence[PlacedAir], *, counts: bool
) -> Iterator[BesideAirflow]:
    """Yield every rotor, then hub and arms, of every module against the airflow of every other module."""
    return (
        BesideAirflow("rotor-airflow", a, b, module, air, segment, counts, certifier=certify_beside, rotor=rotor)
        for a, module in enumerate(modules)
        for b, rotor, air in envelopes
        if a != b
        for segment in (*range(module.rotors), None)
    )


def rotors_beside_airflow(scene: Scene, _: Mount | None) -> Iterator[BesideAirflow]:
    """Yield the checks of a design."""
    return beside_airflow(scene.modules, scene.envelopes, counts=scene.design.task.parts_off_airflow)


def certify_beside(checks: Sequence[BesideAirflow]) -> list[certificate.Certificate]:
    """Certify the checks that `beside_airflow` yields."""
    batches, certificates = dict[int, list[int]](), dict[int, certificate.Certificate]()
    for k, check in enumerate(checks):
        assert check.body.source is not None
        batches.setdefault(id(check.body.source[0]), []).append(k)
    for batch in batches.values():
        certificates |= zip(batch, _certify_copies([checks[k] for k in batch]), strict=True)
    return [certificates[k] for k in range(len(checks))]


def _certify_copies(checks: Sequence[BesideAirflow]) -> list[certificate.Certificate]:
    """Certify the checks of copies of one module."""
    count = checks[0].body.rotors + 1  # checks of each pair of modules
    pairs = checks[::count]
    R, p = (np.array(column) for column in zip(*(_pose(pair.body) for pair in pairs), strict=True))
    clearances = _clearances(pairs, R, p)
    proven = [
        (part.lower > certificate.BOUND_ROUNDING)
        & (part.d > 0)
        & (part.lower - certificate.BOUND_ROUNDING <= part.d)
        & (part.d <= part.upper + certificate.BOUND_ROUNDING)
        for part in clearances
    ]
    certificates = []
    closest = [np.einsum("nij,nkj->nki", R, part.closest) + p[:, None] for part in clearances]
    for k, pair in enumerate(pairs):
        in_range = pair.body.in_range and pair.against.in_range
        outer = pair.against.outer if in_range else None
        boxes_apart = outer is not None and not pair.body.bounds.shape.overlaps(outer[1])
        for side, part in enumerate(clearances):
            d, lower, upper = (float(column[k]) for column in part[:3])
            if not in_range:
                certificates.append(certificate.Certificate(Status.UNDECIDED, None, None, d, 0))
            elif boxes_apart and proven[side][k]:
                certificates.append(certificate.Certificate(Status.CLEAR, lower, upper, d, 0, closest[side][k]))
            else:
                witness = _Clearances(*(column[k] for column in part))
                proof = functools.partial(_proof, checks[k * count + side], witness)
                # a box, the parts' common meshes, then meshes turned towards the witness
                levels, proven_upper = 2 + len(certificate.TURNED_LEVELS), None if np.isnan(upper) else upper
                certificates.append(certificate.judge(d, proven_upper, closest[side][k], proof, levels))
    return certificates


def _pose(body: Compound) -> tuple[Array, Array]:
    assert body.source is not None
    return body.source[1:]


def _proof(check: BesideAirflow, witness: _Clearances, level: int) -> tuple[float, bool]:
    """Return the gap along the witness normal, and whether FCL agrees with its sign at this level."""
    R, p = _pose(check.body)
    n, x = R @ witness.n, R @ witness.x + p
    if witness.d > 0:
        return float(witness.lower), _fcl_apart(check, n, x, level)
    part = check.body.parts[int(witness.part)]
    return float(witness.lower), level >= 2 and _fcl_overlap(check, part, n, x, level)


def _fcl_apart(check: BesideAirflow, n: Array, x: Array, level: int) -> bool:
    outer = check.against.outer
    if level == 0:
        return outer is not None and not check.body.bounds.shape.overlaps(outer[1])
    overlapping = [part for part in parts_of(check) if outer is None or part.shape.overlaps(outer[1])]
    if level == 1 or not overlapping:
        return not overlapping
    mesh = certificate.facing_mesh(check.against.body, x, n, certificate.TURNED_LEVELS[level - 2], inside=False)
    if mesh is None:
        return False
    shape = FclPolytope(mesh)
    return not any(shape.overlaps(FclPolytope(_translate(part.outer(-n), -x))) for part in overlapping)


def _fcl_overlap(check: BesideAirflow, part: Convex, n: Array, x: Array, level: int) -> bool:
    mesh = certificate.facing_mesh(check.against.body, x, n, certificate.TURNED_LEVELS[level - 2], inside=True)
    return mesh is not None and FclPolytope(mesh).overlaps(FclPolytope(_translate(part.inner(x), -x)))


def _translate(mesh: ConvexMesh, shift: Array) -> ConvexMesh:
    return ConvexMesh(mesh.vertices + shift, mesh.triangles)


def clearance(check: BesideAirflow) -> float:
    """Return the exact clearance of one check."""
    R, p = _pose(check.body)
    by_side = _clearances([check], R[None], p[None])
    return float(by_side[check.body.rotors if check.segment is None else check.segment].d[0])


def normals(check: BesideAirflow, pieces: Sequence[certificate.RoundBody]) -> list[Array]:
    """Return the unit vectors from each part of a check to N pieces of airflow, at their nearest points, (N, 3)."""
    assert check.body.source is not None
    N, (module, R, p) = len(pieces), check.body.source
    K = _in_frames([replace(check, against=piece) for piece in pieces], np.tile(R, (N, 1, 1)), np.tile(p, (N, 1)))
    parts = parts_of(replace(check, body=module))
    return [-_part_clearances(part, K, np.zeros(N, dtype=np.intp)).n @ R.T for part in parts]


def _in_frames(pairs: Sequence[BesideAirflow], R: Array, p: Array) -> ConeSpheres:
    """Return the airflow of pairs in the frames of the modules at poses R (N, 3, 3) and p (N, 3)."""
    K = ConeSpheres.of([pair.against.body for pair in pairs])
    to_frame = R.transpose(0, 2, 1)
    o = np.einsum("nij,nj->ni", to_frame, K.o - p)
    return ConeSpheres(o, np.einsum("nij,nj->ni", to_frame, K.d), K.r, K.dr)


def _clearances(pairs: Sequence[BesideAirflow], R: Array, p: Array) -> list[_Clearances]:
    """Return the clearances of all rotors and the frame, for modules at poses R (N, 3, 3) and p (N, 3)."""
    assert pairs[0].body.source is not None
    module, K = pairs[0].body.source[0], _in_frames(pairs, R, p)
    module_parts, frame = module.parts, module.frame
    rotors = [_part_clearances(part, K, np.full(len(R), frame + k)) for k, part in enumerate(module_parts[frame:])]
    return [*rotors, _frame_clearances(module_parts[:frame], K)]


def _frame_clearances(frame: Sequence[Convex], K: ConeSpheres) -> _Clearances:
    """Return the clearances of the frame's nearest part."""
    N = len(K.r)
    bounds = [_ball_bounds(part, K) for part in frame]
    upper = np.min([part_upper for _, part_upper in bounds], axis=0)
    lower, x = np.full(N, np.inf), np.zeros((N, 3))
    best = _Clearances(lower.copy(), lower, lower.copy(), x, x.copy(), np.zeros(N, dtype=np.intp))
    for k, (part, (part_lower, _)) in enumerate(zip(frame, bounds, strict=True)):
        far = part_lower > upper
        lower[far] = np.minimum(lower[far], part_lower[far])
        rows = np.flatnonzero(~far)
        candidate = _part_clearances(part, K.take(rows), np.full(len(rows), k))
        lower[rows] = np.minimum(lower[rows], candidate.lower)
        nearer = ~(candidate.d >= best.d[rows])  # includes NaN
        for name in ("d", "upper", "x", "n", "part"):
            getattr(best, name)[rows[nearer]] = getattr(candidate, name)[nearer]
    return best


def _ball_bounds(part: Convex, K: ConeSpheres) -> tuple[Array, Array]:
    """Return bounds on the clearance: below by the part's bounding ball, above by the part's centre."""
    w = K.o - part.centre
    eta = nearest_on_axis(w, K.d, K.dr)
    v = w + eta[:, None] * K.d
    distance = norms(v)
    n = -v / np.where(distance > 0, distance, 1.0)[:, None]
    return n @ part.centre - part.radius - K.extents(n).max(axis=1), distance - K.radius(eta)


def _part_clearances(part: Convex, K: ConeSpheres, number: Indices) -> _Clearances:
    """Return the clearances of a part, of the given number, from every envelope."""
    eta = _nearest_eta(part, K)
    P = K.centre(eta)
    x = _nearest_points(part, P)
    v = x - P
    distance = norms(v)
    unit_v = v / np.where(distance > 0, distance, 1.0)[:, None]
    n = np.where(distance[:, None] > 0, unit_v, np.array([0.0, 0.0, 1.0]))
    d = distance - K.radius(eta)
    plane_gap = -part.supports(-n) - K.extents(n).max(axis=1)
    lower = np.minimum(d, plane_gap)  # equal up to rounding if n is exact
    x_K = P + K.radius(eta)[:, None] * n
    x_inside = _depth(part, x) > -certificate.BOUND_ROUNDING
    depth_K = K.depth(x)
    gap = np.where(x_inside & (K.depth(x_K) > -certificate.BOUND_ROUNDING), norms(x - x_K), np.nan)
    upper = np.where(d > 0, gap, np.where(x_inside & (depth_K > 2 * certificate.BOUND_ROUNDING), -depth_K, np.nan))
    return _Clearances(d, lower, upper, x, n, number)


def _nearest_eta(part: Convex, K: ConeSpheres) -> Array:
    """Return the eta at which each clearance is attained."""

    def increases(eta: Array, rows: Indices) -> Array:
        P = K.o[rows] + eta[:, None] * K.d[rows]
        v = P - _nearest_points(part, P)
        distance = norms(v)
        return np.asarray(np.sum(v * K.d[rows], axis=1) > K.dr[rows] * distance)

    all_rows = np.arange(len(K.r))
    eta = np.where(increases(np.zeros(len(all_rows)), all_rows), 0.0, 1.0)
    rows = np.flatnonzero((eta == 1.0) & increases(np.ones(len(all_rows)), all_rows))
    low, high = np.zeros(len(rows)), np.ones(len(rows))
    for _ in range(52 if len(rows) else 0):  # bisections of the axis, down to rounding
        middle = (low + high) / 2
        rising = increases(middle, rows)
        low, high = np.where(rising, low, middle), np.where(rising, middle, high)
    eta[rows] = (low + high) / 2
    return eta


def _nearest_points(part: Convex, points: Array) -> Array:
    """Return the points of a part nearest to given points, shape (N, 3).

    Points inside are returned unchanged to the last bit, so that rounding does not look like a distance.
    """
    if isinstance(part, Cylinder):
        q = points - part.centre
        along = q @ part.axis
        across = q - along[:, None] * part.axis
        rho = norms(across)
        shrunk = np.minimum(1.0, part.disc / np.where(rho > 0, rho, part.disc))
        height = np.clip(along, -part.half, part.half)
        inside = (rho <= part.disc) & (height == along)
        x = part.centre + shrunk[:, None] * across + height[:, None] * part.axis
        return np.where(inside[:, None], points, x)
    if isinstance(part, Box):
        size = norms(part.half)
        axes = part.half / size[:, None]
        q = (points - part.centre) @ axes.T
        inside = np.all(np.abs(q) <= size, axis=1)
        return np.where(inside[:, None], points, part.centre + np.clip(q, -size, size) @ axes)
    parts = Cores(*(np.repeat(column, len(points), axis=0) for column in cores([part])))
    point_cores = Cores(points[:, None], np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros(len(points)))
    result = nearest(parts, point_cores, points - part.centre)
    return np.where(result.overlap[:, None], points, result.x_A)


def _depth(part: Convex, x: Array) -> Array:
    """Return the depth of points in a part, shape (N, 3) to (N,); negative outside."""
    if isinstance(part, Cylinder):
        q = x - part.centre
        along = q @ part.axis
        rho = norms(q - along[:, None] * part.axis)
        return np.asarray(np.minimum(part.disc - rho, part.half - np.abs(along)))
    assert isinstance(part, Polyhedron)
    normals, offsets = part.faces
    if not len(offsets):  # all faces are slivers, so no point is proven to lie inside
        return np.full(len(x), -np.inf)
    return np.asarray((offsets - x @ normals.T).min(axis=1))

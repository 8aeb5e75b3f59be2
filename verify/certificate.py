"""Proven verdicts on pairs of bodies.

| symbol | meaning |
|---|---|
| A, B | two cone-spheres, lengths in l_arm |
| d | exact signed clearance, from the closed form |
| n | unit vector from A to B at their nearest points: the witness normal |
| lower | gap between the planes normal to n: min of n.x over B's outer mesh, minus max over A's; d >= lower |
| upper | distance of a point proven in A to one proven in B, or minus the depth of one proven in both; d <= upper |

A pair is `clear` if NumPy finds the separating plane (lower > 0) and FCL finds the outer meshes apart; it is
`violated` if NumPy finds the common point and FCL finds the inner meshes overlapping. Neither the closed form nor
FCL decides a verdict alone: if either is wrong, the proof fails. A failed proof is repeated on meshes turned
towards the witness, which are exact there, and on finer ones. A clearance that stays unproven is `undecided` up to
FLOOR, or if coordinates are out of range, and `inconsistent` beyond: then the closed form, the meshes and FCL
disagree, which is a bug of this tool.

B may also be a convex region, which is its own exact mesh; d is then that of `verify.hulls`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from topo_search.model import Array, Status
from topo_search.model.clearance import Kind
from verify.bodies import ConeSphere, ConeSpheres, clearances
from verify.hulls import HullBody, approach
from verify.meshes import LARGEST_COORDINATE, ConvexMesh, FclPolytope, encloses, inner_mesh, lies_within, outer_mesh

FLOOR = 1e-7
"""Smaller clearances may stay undecided [l_arm]: FCL's tolerance at its scale."""
BOUND_ROUNDING = 1e-10
"""Largest rounding error of a bound within LARGEST_COORDINATE of the origin; a proof must exceed it [l_arm]."""
COMMON_LEVEL = 2
"""Icosphere level of the mesh of a body that all its pairs share."""
TURNED_LEVELS = (2, 3, 4)
"""Icosphere levels of the meshes built for a single pair and turned towards its witness."""


@dataclass(frozen=True)
class Certificate:
    """Proven facts about one clearance, in l_arm."""

    status: Status
    lower: float | None
    """Proven lower bound; None when violated or nothing is proven."""
    upper: float | None
    """Proven upper bound; for a violation, minus the proven depth."""
    analytic: float
    """Closed-form value."""
    level: int
    """Index of the mesh on which it was proven; 0 is the first, coarsest one."""
    closest: Array | None = None
    """Nearest points of both sides; for an overlap, one common point twice; shape (2, 3)."""
    evidence: tuple[str, ...] = ()
    """Results of closed form, meshes and FCL with all digits if they disagree, for debugging."""


MeshPair = tuple[ConvexMesh, FclPolytope]
LevelProof = Callable[[int], tuple[float, bool] | None]
"""Maps a mesh level to a lower bound and whether FCL agrees with its sign; None if a mesh fails its check."""

Side = TypeVar("Side")
Other = TypeVar("Other")


@dataclass(frozen=True, eq=False)
class ClearanceCheck(Generic[Side, Other]):
    """A body that must keep clear of another, or stay inside it."""

    kind: Kind
    a: int
    """Module number; for brackets, the child module of the joint."""
    b: int
    """Number of the other module or of the exposure requirement; -1 for the end-effector or its rod."""
    body: Side
    against: Other
    segment: int | None = None
    counts: bool = True
    """True if the check affects the verdict; it is measured either way."""
    bolted: bool = False
    """True if the two frames may touch near the connector."""
    certifier: Callable[[Sequence[Any]], list[Certificate]] | None = None
    """Certifier of a batch of such checks; None: that for the types of their sides."""
    contact: int | None = None
    """Number of the load case whose object the other side is."""
    rotor: int | None = None
    """Number of the rotor whose airflow it is, where each has an envelope of its own."""

    @property
    def key(self) -> tuple[Kind, int, int, int | None, int | None]:
        """Key of the check within a design."""
        return self.kind, self.a, self.b, self.segment, self.rotor


class RoundBody:
    """A cone-sphere with its common inner and outer mesh, built on demand, once for all copies."""

    def __init__(self, body: ConeSphere) -> None:
        self.body = body
        self._source: tuple[RoundBody, Array, Array] | None = None
        self._meshes: dict[bool, MeshPair] = {}

    def place(self, R: Array, p: Array) -> RoundBody:
        """Return a copy rotated by R, shape (3, 3), then translated by p, shape (3,)."""
        copy = RoundBody(replace(self.body, o=R @ self.body.o + p, d=R @ self.body.d))
        copy._source = self, R, p
        return copy

    @functools.cached_property
    def outer(self) -> MeshPair | None:
        """The common outer mesh; None if it fails its own check."""
        common = self._common_mesh(inside=False)
        return common if encloses(common[0], self.body) else None

    @functools.cached_property
    def inner(self) -> MeshPair | None:
        """The common inner mesh; None if it fails its own check."""
        common = self._common_mesh(inside=True)
        return common if lies_within(common[0], self.body) else None

    def _common_mesh(self, *, inside: bool) -> MeshPair:
        if inside not in self._meshes:
            if self._source is None:
                mesh = (inner_mesh if inside else outer_mesh)(self.body, COMMON_LEVEL)
                self._meshes[inside] = mesh, FclPolytope(mesh)
            else:
                solid, R, p = self._source
                mesh, shape = solid._common_mesh(inside=inside)
                self._meshes[inside] = ConvexMesh(mesh.vertices @ R.T + p, mesh.triangles), shape.place(R, p)
        return self._meshes[inside]

    def proof_mesh(self, x: Array, n: Array, level: int, *, inside: bool) -> MeshPair | None:
        """Return the common mesh at level 0, else one turned towards n around x; None if it fails its own check."""
        if level == 0:
            return self.inner if inside else self.outer
        mesh = facing_mesh(self.body, x, n, TURNED_LEVELS[level - 1], inside=inside)
        return None if mesh is None else (mesh, FclPolytope(mesh))

    @functools.cached_property
    def in_range(self) -> bool:
        """True if the body is close enough to the origin for coordinates precise enough for a proof."""
        return bool(np.all(np.abs(self.body.o) + 2 * self.body.extent < LARGEST_COORDINATE / 16))


def facing_mesh(body: ConeSphere, x: Array, n: Array, level: int, *, inside: bool) -> ConvexMesh | None:
    """Return a mesh around or inside a body, turned towards n, with its origin at x; None if it fails its check."""
    shifted = body.move(-x)  # FCL is most precise near the origin
    mesh = (inner_mesh if inside else outer_mesh)(shifted, level, n)
    return mesh if (lies_within if inside else encloses)(mesh, shifted) else None


class Witness(NamedTuple):
    """Closed-form nearest points or deepest overlap of two bodies."""

    d: float
    """Closed-form clearance."""
    n: Array
    """Unit vector from A to B, shape (3,)."""
    x: Array
    """Midpoint of the nearest points; for an overlap, a point deep in both, shape (3,)."""
    upper: float | None
    """Upper bound proven by `closest`; None if these points fail their membership test."""
    closest: Array
    """Nearest points, or one common point twice, shape (2, 3)."""


def certify_pairs(pairs: Sequence[tuple[RoundBody, RoundBody | HullBody]]) -> list[Certificate]:
    """Certify that cone-spheres keep clear of other cone-spheres or convex regions."""
    certificates = []
    for (A, B), witness in zip(pairs, witnesses(pairs), strict=True):
        if not (A.in_range and B.in_range):
            certificates.append(Certificate(Status.UNDECIDED, None, None, witness.d, 0))
            continue
        first = int(isinstance(B, HullBody))  # a region's mesh is exact, so A's mesh is turned from the start
        proof = functools.partial(_prove, A, B, witness, first)
        levels = 1 + len(TURNED_LEVELS) - first
        certificates.append(judge(witness.d, witness.upper, witness.closest, proof, levels))
    return certificates


def _prove(
    A: RoundBody, B: RoundBody | HullBody, witness: Witness, first: int, level: int
) -> tuple[float, bool] | None:
    """Bound d along n, by outer meshes if clear, else by supports; return it and whether FCL confirms its sign."""
    x, normal = witness.x, witness.n
    clear = witness.d > 0
    mesh_A, mesh_B = (
        side.proof_mesh(x, n, first + level, inside=not clear) for side, n in ((A, normal), (B, -normal))
    )
    if mesh_A is None or mesh_B is None:
        return None
    overlap = mesh_A[1].overlaps(mesh_B[1])
    if clear:
        return float((mesh_B[0].vertices @ normal).min() - (mesh_A[0].vertices @ normal).max()), not overlap
    support_B = (
        (mesh_B[0].vertices @ -normal).max() if isinstance(B, HullBody) else B.body.move(-x).support(-normal)
    )
    return -float(A.body.move(-x).support(normal) + support_B), overlap


def witnesses(pairs: Sequence[tuple[RoundBody, RoundBody | HullBody]]) -> Iterator[Witness]:
    """Yield the witness of every pair; cone-spheres are computed in one batch."""
    round_witnesses = _round_witnesses([(A, B) for A, B in pairs if isinstance(B, RoundBody)])
    return (_region_witness(A.body, B) if isinstance(B, HullBody) else next(round_witnesses) for A, B in pairs)


def _round_witnesses(pairs: Sequence[tuple[RoundBody, RoundBody]]) -> Iterator[Witness]:
    d, eta, gamma = clearances([(A.body, B.body) for A, B in pairs])
    A, B = (ConeSpheres.of([pair[side].body for pair in pairs]) for side in (0, 1))
    P_A, r_A, P_B, r_B = A.centre(eta), A.radius(eta), B.centre(gamma), B.radius(gamma)
    distance = np.linalg.norm(P_B - P_A, axis=-1)
    n = (P_B - P_A) / np.where(distance > 0, distance, 1.0)[:, None]
    n[~(distance > 0)] = [0.0, 0.0, 1.0]
    # For a gap, the nearest point of each body.
    x_A, x_B = P_A + r_A[:, None] * n, P_B - r_B[:, None] * n
    nearest_inside = np.minimum(A.depth(x_A), B.depth(x_B)) > -BOUND_ROUNDING
    # For an overlap, a point equally deep in both, or the smaller ball's centre if the other contains that ball.
    common = P_A + np.clip((distance + r_A - r_B) / 2, 0.0, distance)[:, None] * n
    depth_A, depth_B = A.depth(common), B.depth(common)
    common_inside = np.minimum(depth_A, depth_B) > BOUND_ROUNDING
    gap = d > 0
    closest = np.where(gap[:, None, None], np.stack([x_A, x_B], axis=1), common[:, None])
    x = closest.mean(axis=1)
    upper = np.where(gap, np.linalg.norm(x_B - x_A, axis=-1), -(depth_A + depth_B))
    proven = np.where(gap, nearest_inside, common_inside)
    for k, value in enumerate(d.tolist()):
        yield Witness(value, n[k], x[k], float(upper[k]) if proven[k] else None, closest[k])


def _region_witness(body: ConeSphere, region: HullBody) -> Witness:
    closest = approach(body, region)
    P, r = body.centre(closest.eta), body.radius(closest.eta)
    x = P if region.depth(P) > BOUND_ROUNDING else region.nearest_of_surface(P)
    distance, to_centre = float(np.linalg.norm(x - P)), region.centre - P
    centre_distance = float(np.linalg.norm(to_centre))
    inwards = to_centre / centre_distance if centre_distance > 0 else np.array([0.0, 0.0, 1.0])
    n = (x - P) / distance if distance > 0 else inwards
    if closest.d > 0:
        x_K = P + r * n
        upper = float(np.linalg.norm(x - x_K)) if body.depth(x_K) > -BOUND_ROUNDING else None
        return Witness(closest.d, n, (x_K + x) / 2, upper, np.stack([x_K, x]))
    depth = float(body.depth(x))
    return Witness(closest.d, n, x, -depth if depth > BOUND_ROUNDING else None, np.stack([x, x]))


def judge(d: float, upper: float | None, closest: Array, proof: LevelProof, levels: int) -> Certificate:
    """Refine until a proof of the closed form's verdict succeeds, then check its value against the bounds.

    Args:
        d: closed-form value.
        upper: proven upper bound, or None.
        closest: points that prove `upper`.
        proof: tried level by level.
        levels: number of levels to try.
    """
    status, lower, level = Status.UNDECIDED if abs(d) <= FLOOR else Status.INCONSISTENT, None, levels - 1
    results: list[tuple[float, bool] | None] = []
    while upper is not None and len(results) < levels:
        results.append(result := proof(len(results)))
        if result is not None and result[1] and (result[0] > BOUND_ROUNDING or not d > 0):
            bound, level = result[0], len(results) - 1
            status = Status.CLEAR if bound > 0 else Status.VIOLATED
            lower = bound if status == Status.CLEAR else None
            if not bound - BOUND_ROUNDING <= d <= upper + BOUND_ROUNDING:
                status = Status.INCONSISTENT
            break
    evidence: tuple[str, ...] = ()
    if status == Status.INCONSISTENT:
        evidence = (
            f"closed form: clearance {d!r} at {closest.tolist()}, proven upper bound {upper!r}",
            *(
                f"level {k}: a mesh fails its own check"
                if result is None
                else f"level {k}: lower bound {result[0]!r}, {'' if result[1] else 'not '}confirmed by FCL"
                for k, result in enumerate(results)
            ),
        )
    return Certificate(status, lower, upper, d, level, closest, evidence)

"""Proven verdicts on pairs of bodies.

| symbol | meaning |
|---|---|
| A, B | two cone-spheres, lengths in l_arm |
| d | exact signed clearance, from the closed form |
| n | unit vector from A to B where they are nearest: the witness normal |
| lower | gap of a plane across n: min of n.x over B's outer mesh, minus max over A's, so d >= lower |
| upper | distance of a point proven in A to one proven in B, or minus the depth of one proven in both: d <= upper |

A pair is `clear` when numpy finds the plane (lower > 0) and FCL finds the outer meshes apart; `violated` when
numpy finds the point and FCL finds the inner meshes overlapping. Neither the closed form nor FCL can make a verdict
by itself: if they are wrong, the proof fails. A failed proof is tried again on meshes turned towards the witness,
which lose nothing there, and on finer ones. What stays unproven is `undecided` within the floor of rounding and
`inconsistent` beyond it: then closed form, meshes and FCL disagree, which is a fault of this tool.

B may also be a convex region, which is a mesh itself and loses nothing; d is then that of `verify.hulls`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from topo_search.model import Status
from topo_search.model.audit import Kind
from verify.bodies import Array, ConeSphere, Rows, clearances
from verify.hulls import Hull, approach
from verify.meshes import LARGEST_COORDINATE, ConvexMesh, Shape, encloses, inner_mesh, lies_within, outer_mesh

FLOOR = 1e-7
"""Clearances of a smaller size may stay undecided [l_arm]: FCL's tolerance at its scale."""
BOUND_ROUNDING = 1e-10
"""Largest rounding error of a bound within LARGEST_COORDINATE of the origin; a proof must exceed it [l_arm]."""
COMMON_LEVEL = 2
"""Icosphere level of the mesh that a body shows to all others."""
TURNED_LEVELS = (2, 3, 4)
"""Icosphere levels of the meshes made for one pair, turned towards its witness."""


@dataclass(frozen=True)
class Certificate:
    """Proven facts about one clearance, in l_arm."""

    status: Status
    lower: float | None
    """Proven lower bound; None when violated or nothing is proven."""
    upper: float | None
    """Proven upper bound; for a violation minus the proven depth."""
    analytic: float
    """The closed form's value."""
    level: int
    """Number of refinements of the meshes: 0 is the common mesh."""
    closest: Array | None = None
    """Closest points: of a gap, the nearest of either side; of an overlap, a point in both, twice; shape (2, 3)."""
    evidence: tuple[str, ...] = ()
    """What closed form, meshes and FCL say where they disagree, with all digits, to find the fault by."""


Mesh = tuple[ConvexMesh, Shape]
Proof = Callable[[int], tuple[float, bool] | None]
"""From a level of meshes to a lower bound and whether FCL agrees with its sign; None: a mesh fails its check."""

Body = TypeVar("Body")
Other = TypeVar("Other")


@dataclass(frozen=True, eq=False)
class ClearanceRow(Generic[Body, Other]):
    """One thing that must keep clear of, or stay inside, another."""

    kind: Kind
    a: int
    """A module."""
    b: int
    """The other module, or the number of the exposure requirement; -1 for the end-effector or its rod."""
    body: Body
    against: Other
    segment: int | None = None
    counts: bool = True
    """True if it affects the verdict; it is measured either way."""
    bolted: bool = False
    """True if the frames of both may touch near the connector."""


class Solid:
    """A body with the two meshes that it shows to all others, made once for all its copies and on demand."""

    def __init__(self, body: ConeSphere) -> None:
        self.body = body
        self._copied: tuple[Solid, Array, Array] | None = None
        self._made: dict[bool, Mesh] = {}

    def place(self, R: Array, p: Array) -> Solid:
        """Return a copy turned by R, shape (3, 3), then moved by p, shape (3,)."""
        elsewhere = Solid(replace(self.body, o=R @ self.body.o + p, d=R @ self.body.d))
        elsewhere._copied = self, R, p
        return elsewhere

    @functools.cached_property
    def outer(self) -> Mesh | None:
        """The common outer mesh; None if it fails its own check."""
        common = self._common_mesh(inside=False)
        return common if encloses(common[0], self.body) else None

    @functools.cached_property
    def inner(self) -> Mesh | None:
        """The common inner mesh; None if it fails its own check."""
        common = self._common_mesh(inside=True)
        return common if lies_within(common[0], self.body) else None

    def _common_mesh(self, *, inside: bool) -> Mesh:
        if inside not in self._made:
            if self._copied is None:
                mesh = (inner_mesh if inside else outer_mesh)(self.body, COMMON_LEVEL)
                self._made[inside] = mesh, Shape(mesh)
            else:
                solid, R, p = self._copied
                mesh, shape = solid._common_mesh(inside=inside)
                self._made[inside] = ConvexMesh(mesh.vertices @ R.T + p, mesh.triangles), shape.place(R, p)
        return self._made[inside]

    def proof_mesh(self, x: Array, n: Array, level: int, *, inside: bool) -> Mesh | None:
        """Return the common mesh at level 0, a turned one at any other; None if it fails its own check."""
        if level == 0:
            return self.inner if inside else self.outer
        mesh = facing_mesh(self.body, x, n, TURNED_LEVELS[level - 1], inside=inside)
        return None if mesh is None else (mesh, Shape(mesh))

    @functools.cached_property
    def in_range(self) -> bool:
        """True if the body is near enough to the origin that coordinates keep the digits a proof needs."""
        return bool(np.all(np.abs(self.body.o) + 2 * self.body.extent < LARGEST_COORDINATE / 16))


def facing_mesh(body: ConeSphere, x: Array, n: Array, level: int, *, inside: bool) -> ConvexMesh | None:
    """Return a mesh around or inside a body, turned towards n, with its origin at x; None if it fails its check."""
    near = body.move(-x)  # the digits are needed around x
    mesh = (inner_mesh if inside else outer_mesh)(near, level, n)
    return mesh if (lies_within if inside else encloses)(mesh, near) else None


class Witness(NamedTuple):
    """Nearest points or deepest overlap of two bodies, by the closed form."""

    d: float
    """The closed form's value."""
    n: Array
    """Unit vector from A to B, shape (3,)."""
    x: Array
    """Half-way between the nearest points; for an overlap the point that is deep in both, shape (3,)."""
    upper: float | None
    """Upper bound that the nearest or the common points prove; None if they do not lie where they should."""
    closest: Array
    """These points, shape (2, 3)."""


def certify_pairs(pairs: Sequence[tuple[Solid, Solid | Hull]]) -> list[Certificate]:
    """Return the certificates of cone-spheres that must keep out of others, or of convex regions."""
    certificates = []
    for (A, B), at in zip(pairs, witnesses(pairs), strict=True):
        if not (A.in_range and B.in_range):
            certificates.append(Certificate(Status.UNDECIDED, None, None, at.d, 0))
            continue
        first = int(isinstance(B, Hull))  # the region loses nothing, so that the other mesh is turned at once
        proof = functools.partial(_prove, A, B, at, first)
        certificates.append(judge(at.d, at.upper, at.closest, proof, levels=1 + len(TURNED_LEVELS) - first))
    return certificates


def _prove(A: Solid, B: Solid | Hull, at: Witness, first: int, level: int) -> tuple[float, bool] | None:
    """Return the gap across n, between outer meshes or negative between supports, and whether FCL agrees."""
    apart = at.d > 0
    mesh_A, mesh_B = (
        side.proof_mesh(at.x, n, first + level, inside=not apart) for side, n in ((A, at.n), (B, -at.n))
    )
    if mesh_A is None or mesh_B is None:
        return None
    overlap = mesh_A[1].overlaps(mesh_B[1])
    if apart:
        return float((mesh_B[0].vertices @ at.n).min() - (mesh_A[0].vertices @ at.n).max()), not overlap
    support_B = (mesh_B[0].vertices @ -at.n).max() if isinstance(B, Hull) else B.body.move(-at.x).support(-at.n)
    return -float(A.body.move(-at.x).support(at.n) + support_B), overlap


def witnesses(pairs: Sequence[tuple[Solid, Solid | Hull]]) -> Iterator[Witness]:
    """Yield the witness of every pair; those of cone-spheres are found at once."""
    of_solids = _witnesses([(A, B) for A, B in pairs if isinstance(B, Solid)])
    return (_beside_region(A.body, B) if isinstance(B, Hull) else next(of_solids) for A, B in pairs)


def _witnesses(pairs: Sequence[tuple[Solid, Solid]]) -> Iterator[Witness]:
    d, eta, gamma = clearances([(A.body, B.body) for A, B in pairs])
    A, B = (Rows.of([pair[side].body for pair in pairs]) for side in (0, 1))
    P_A, r_A, P_B, r_B = A.centre(eta), A.radius(eta), B.centre(gamma), B.radius(gamma)
    apart = np.linalg.norm(P_B - P_A, axis=-1)
    n = (P_B - P_A) / np.where(apart > 0, apart, 1.0)[:, None]
    n[~(apart > 0)] = [0.0, 0.0, 1.0]
    # A gap: the nearest point of each body.
    x_A, x_B = P_A + r_A[:, None] * n, P_B - r_B[:, None] * n
    reached = np.minimum(A.depth(x_A), B.depth(x_B)) > -BOUND_ROUNDING
    # An overlap: as deep in one as in the other; the centre of the smaller ball if the other holds all of it.
    common = P_A + np.clip((apart + r_A - r_B) / 2, 0.0, apart)[:, None] * n
    depth_A, depth_B = A.depth(common), B.depth(common)
    shared = np.minimum(depth_A, depth_B) > BOUND_ROUNDING
    gap = d > 0
    closest = np.where(gap[:, None, None], np.stack([x_A, x_B], axis=1), common[:, None])
    x = closest.mean(axis=1)
    upper = np.where(gap, np.linalg.norm(x_B - x_A, axis=-1), -(depth_A + depth_B))
    proven = np.where(gap, reached, shared)
    for k, value in enumerate(d.tolist()):
        yield Witness(value, n[k], x[k], float(upper[k]) if proven[k] else None, closest[k])


def _beside_region(body: ConeSphere, region: Hull) -> Witness:
    closest = approach(body, region)
    P, r = body.centre(closest.eta), body.radius(closest.eta)
    x = P if region.depth(P) > BOUND_ROUNDING else region.nearest_of_surface(P)
    apart, into = float(np.linalg.norm(x - P)), region.centre - P
    deep = float(np.linalg.norm(into))
    inwards = into / deep if deep > 0 else np.array([0.0, 0.0, 1.0])
    n = (x - P) / apart if apart > 0 else inwards
    if closest.d > 0:
        x_K = P + r * n
        reached = body.depth(x_K) > -BOUND_ROUNDING
        upper = float(np.linalg.norm(x - x_K)) if reached else None
        return Witness(closest.d, n, (x_K + x) / 2, upper, np.stack([x_K, x]))
    depth = float(body.depth(x))
    return Witness(closest.d, n, x, -depth if depth > BOUND_ROUNDING else None, np.stack([x, x]))


def judge(d: float, upper: float | None, closest: Array, proof: Proof, levels: int) -> Certificate:
    """Refine until a proof of what the closed form says succeeds, then hold its value against the bounds.

    Args:
        d: the closed form's value.
        upper: a proven upper bound, or None.
        closest: the points that prove it.
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
            f"closed form: clearance {d!r} at {closest.tolist()}, upper bound proven there {upper!r}",
            *(
                f"level {k}: a mesh fails its own check"
                if result is None
                else f"level {k}: lower bound {result[0]!r}, {'' if result[1] else 'not '}confirmed by FCL"
                for k, result in enumerate(results)
            ),
        )
    return Certificate(status, lower, upper, d, level, closest, evidence)

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
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from topo_search.model import Status
from verify.bodies import Array, ConeSphere
from verify.clearance import clearances
from verify.fcl_queries import FARTHEST, Shape
from verify.meshes import Polytope, encloses, inner_mesh, lies_within, outer_mesh

FLOOR = 1e-7
"""Clearances of a smaller size may stay undecided [l_arm]: FCL's tolerance at its scale."""
ROUNDING = 1e-10
"""What rounding may do to a computed bound [l_arm], within FARTHEST of the origin; a proof must exceed it."""
COMMON_LEVEL = 2
"""Icosphere level of the mesh that a body shows to all others."""
TURNED_LEVELS = (2, 3, 4)
"""Icosphere levels of the meshes made for one pair, turned towards its witness."""


@dataclass(frozen=True)
class Certificate:
    """What is proven about one clearance, in l_arm."""

    status: Status
    lower: float | None
    """Proven lower bound; None when violated or nothing is proven."""
    upper: float | None
    """Proven upper bound; for a violation minus the proven depth."""
    analytic: float
    """The closed form's value."""
    level: int
    """How often the meshes were refined: 0 is the common mesh."""


class Solid:
    """A body with the two meshes that it shows to all others, made once and on demand."""

    def __init__(self, body: ConeSphere) -> None:
        self.body = body

    @functools.cached_property
    def outer(self) -> tuple[Polytope, Shape] | None:
        """The common outer mesh; None if it fails its own check."""
        mesh = outer_mesh(self.body, COMMON_LEVEL)
        return (mesh, Shape(mesh)) if encloses(mesh, self.body) else None

    @functools.cached_property
    def inner(self) -> Shape | None:
        """The common inner mesh; None if it fails its own check."""
        mesh = inner_mesh(self.body, COMMON_LEVEL)
        return Shape(mesh) if lies_within(mesh, self.body) else None

    @functools.cached_property
    def in_range(self) -> bool:
        """Whether the body is where coordinates keep the digits that a proof needs."""
        return bool(np.all(np.abs(self.body.o) + 2 * self.body.extent < FARTHEST / 16))


def certify_pairs(pairs: Sequence[tuple[Solid, Solid]]) -> list[Certificate]:
    """Return the certificates of pairs of cone-spheres."""
    d, eta, gamma = (column.tolist() for column in clearances([(A.body, B.body) for A, B in pairs]))
    return [_certify(*pair, *at) for pair, *at in zip(pairs, d, eta, gamma, strict=True)]


def _certify(A: Solid, B: Solid, d: float, eta: float, gamma: float) -> Certificate:
    if not (A.in_range and B.in_range):
        return Certificate(Status.UNDECIDED, None, None, d, 0)
    P_A, r_A = A.body.centre(eta), A.body.radius(eta)
    P_B, r_B = B.body.centre(gamma), B.body.radius(gamma)
    apart = float(np.linalg.norm(P_B - P_A))
    n = (P_B - P_A) / apart if apart > 0 else np.array([0.0, 0.0, 1.0])
    if d > 0:
        x_A, x_B = P_A + r_A * n, P_B - r_B * n
        proven = bool(min(A.body.depth(x_A), B.body.depth(x_B)) > -ROUNDING)
        upper = float(np.linalg.norm(x_B - x_A))
        proof = functools.partial(_separating_gap, A, B, n, (x_A + x_B) / 2)
    else:
        # As deep in one as in the other; the centre of the smaller ball if the other holds all of it.
        x = P_A + min(max((apart + r_A - r_B) / 2, 0.0), apart) * n
        depths = float(A.body.depth(x)), float(B.body.depth(x))
        proven, upper = min(depths) > ROUNDING, -sum(depths)
        proof = functools.partial(_common_point, A, B, n, x)
    return judge(d, upper if proven else None, proof, levels=1 + len(TURNED_LEVELS))


def judge(d: float, upper: float | None, proof: Callable[[int], float | None], levels: int) -> Certificate:
    """Refine until a proof of what the closed form says succeeds, then hold its value against the bounds.

    Args:
        d: the closed form's value.
        upper: a proven upper bound, or None.
        proof: from the level to a proven lower bound, positive if clear; None if the proof fails.
        levels: number of levels to try.
    """
    for level in range(levels if upper is not None else 0):
        lower = proof(level)
        if lower is not None and upper is not None:
            proven = Status.CLEAR if lower > 0 else Status.VIOLATED
            agrees = lower - ROUNDING <= d <= upper + ROUNDING
            status = proven if agrees else Status.INCONSISTENT
            return Certificate(status, lower if proven == Status.CLEAR else None, upper, d, level)
    unproven = Status.UNDECIDED if abs(d) <= FLOOR else Status.INCONSISTENT
    return Certificate(unproven, None, upper, d, levels - 1)


def _separating_gap(A: Solid, B: Solid, n: Array, x: Array, level: int) -> float | None:
    """Return the gap between the outer meshes of a level across a plane normal to n, if FCL sees them apart too."""
    if level == 0:
        if A.outer is None or B.outer is None:
            return None
        (mesh_A, shape_A), (mesh_B, shape_B) = A.outer, B.outer
    else:
        body_A, body_B = A.body.moved(-x), B.body.moved(-x)  # the digits are needed around x
        mesh_A = outer_mesh(body_A, TURNED_LEVELS[level - 1], n)
        mesh_B = outer_mesh(body_B, TURNED_LEVELS[level - 1], -n)
        if not (encloses(mesh_A, body_A) and encloses(mesh_B, body_B)):
            return None
        shape_A, shape_B = Shape(mesh_A), Shape(mesh_B)
    gap = float((mesh_B.vertices @ n).min() - (mesh_A.vertices @ n).max())
    return gap if gap > ROUNDING and not shape_A.overlaps(shape_B) else None


def _common_point(A: Solid, B: Solid, n: Array, x: Array, level: int) -> float | None:
    """Return the supports' (negative) gap along n, if FCL sees the inner meshes of a level overlap."""
    body_A, body_B = A.body.moved(-x), B.body.moved(-x)
    if level == 0:
        shape_A, shape_B = A.inner, B.inner
    else:
        mesh_A = inner_mesh(body_A, TURNED_LEVELS[level - 1], n)
        mesh_B = inner_mesh(body_B, TURNED_LEVELS[level - 1], -n)
        shape_A = Shape(mesh_A) if lies_within(mesh_A, body_A) else None
        shape_B = Shape(mesh_B) if lies_within(mesh_B, body_B) else None
    if shape_A is None or shape_B is None or not shape_A.overlaps(shape_B):
        return None
    return -float(body_A.support(n) + body_B.support(-n))

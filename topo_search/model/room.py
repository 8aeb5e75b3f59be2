r"""Space that the rigid parts of a module need: alone, bolted to a neighbour, and next to the airflow of others.

Modules that are not bolted together cannot touch if the balls of radius rho around their centres do not.

Two bolted modules share a hinge axis. Seen along it, each lies in a wedge about the line from the axis to its
centre, and the angle between these lines is pi - |alpha|. Hubs and arms may touch there, but rotors must not touch
anything. A rotor is at least d away from the axis, so only parts at least as far away count: a rotor and a part
cannot meet if

.. math:: |\alpha| < \pi - \beta_r - \beta, \qquad \beta = \max \operatorname{atan2}(|z|, l_c - x)

For two rotors the bound is sharp: they are mirror images in the plane that bisects the angle between the lines. For
a rotor and a frame it is conservative, because this view drops one dimension.

| symbol | meaning | unit |
|---|---|---|
| x, z | coordinates of a point in the module's frame, x towards the port | m |
| d | smallest distance of the rotors from the hinge axis, at any port | m |
| beta_r | largest elevation of rotors above the line to the centre, seen from the axis | rad |
| beta | the same for all parts beyond d | rad |

`largest_hinge_angle` bounds the fold of a hinge (`topo_search.model.folds`) in closed form. If that leaves no
angle, rotors may reach beyond the hinge axis, between the arms of the neighbour: then `clear_folds` searches for
clear angles and certifies intervals of them. There can be several intervals, and none of them may contain 0.

For every unit vector u, the distance of two convex parts A and B is at least min_B u . x - max_A u . x. If this is
s at the fold phi, it is at least s - rho h within phi +- h, where rho is the largest distance of points of A, or of
B, from the hinge axis: keep the other part fixed.

| symbol | meaning | shape | unit |
|---|---|---|---|
| phi, h | fold angles at the centres of intervals; half-width of the intervals | (m,), | rad |
| u | directions in the frame of the hinge: x from module to module, y along its axis, z up | (m, 3) | |
| rho | largest distance of a part's points from the hinge axis | | m |

An envelope has the radius r_air at its module's centre, by default the arm length, so that the outer rims of the
rotors are outside of the paper's envelope. So envelopes that are clear of each other do not keep rotors out of
them.

For modules that are not bolted together, the search keeps balls around rotors out of the airflow of others; parts
outside these balls and outside the module's own envelope get balls as well (`part_cover`).

The relative pose of two modules that share a hinge depends only on its fold: the child's airflow leans away from
its parent's, or towards it. Either module sees the other in the same pose, up to quarter turns about its own axis
(`airflow_folds`).

| symbol | meaning | unit |
|---|---|---|
| phi | fold: hinge angle, positive if the two airflows lean apart | rad |
| e, z | direction of a port, and thrust axis, in the module's frame | |
| l_c, l_c' | distances of the hinge from the centres of the module and its neighbour | m |
| P(eta) = o + eta l_air d | axis of the neighbour's envelope, eta in [0, 1] | m |
| r(eta) = r_air + eta dr_air | radius of the envelope | m |

.. math::

    o = l_c e + l_c' (\cos\phi \, e + \sin\phi \, z), \qquad d = \sin\phi \, e - \cos\phi \, z

The clearance of a part, the minimum of dist(P, part) - r over eta, is that of a convex function. Its derivative
with respect to phi is at most the largest distance of a part from the hinge axis, because that is how parts move
relative to the envelope.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, islice, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from topo_search.model.airflow import AirflowEnvelope
from topo_search.model.arrays import PORT_DIRECTIONS, Array, read_only
from topo_search.model.folds import LENGTH_ROUNDING, Folds, folds_text, join
from topo_search.model.module import Module
from topo_search.model.rotors import UP
from topo_search.model.value import Broken, show

if TYPE_CHECKING:
    from topo_search.model.task import Task

LARGE = 4.0
"""Largest usual length at the end-effector, such as its rod or stand-off [packed widths]."""
FINEST = 0.25
"""Largest radius of balls around parts other than rotors, unless that takes more than `MOST_BOXES` [l_arm]."""
MOST_BOXES = 24
"""Largest number of balls around parts other than rotors, unless the frame has more pieces."""
CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
"""Corners of a box with edges of 1."""


def packed_width(l_c: float, n: int) -> float:
    """Return the width of n modules packed in a square, a scale for lengths at the target [m]."""
    return 2 * l_c * math.sqrt(n)


def body_radius(module: Module) -> float:
    """Return rho, the radius of the ball around the module's centre that contains all rigid parts [m]."""
    body, rotors = module.body, module.rotor_table
    heights = module.arm_length * np.sum(rotors.positions * rotors.axes, axis=1)
    lengths = module.arm_length * rotors.distances
    across = np.sqrt(np.maximum(0.0, lengths**2 - heights**2)) + module.rotor_radii
    rims = map(math.hypot, across, np.abs(heights) + body.rotor_height / 2)
    return max([*rims, float(np.linalg.norm(_frame_edges(module), axis=-1).max())])


def frame_reach(module: Module) -> float:
    """Return the largest reach of hub and arms, or a custom frame, towards any of the four ports [m]."""
    return float(np.abs(_frame_edges(module)[..., :2]).max())


def bracket_obstacle(module: Module) -> str | None:
    """Return what of its own module a bracket's flange reaches: its centre, airflow or rotors; None if it is clear.

    A flange is fixed to its module whatever the hinge angle. With flat hinges the rest of the bracket is farther
    out, so one that is clear fits at least there.
    """
    sizes = module.bracket_sizes
    x, r = module.connector_distance - sizes.set_back, sizes.half_width
    if x <= 0 or not module.rotor_table.count:
        return "the centre" if x <= 0 else None
    air = module.envelope
    is_single = not module.rotor_table.has_own_jets
    growth = air.growth / air.length  # of the radius along the axis
    slope = math.sqrt(max(0.0, 1 - growth**2))
    depth = min(air.length, r + x * growth / slope) if slope else air.length  # where the side is nearest the flange
    if is_single and math.hypot(x, max(0.0, depth - r)) < air.start_radius + growth * depth:
        return "the airflow"
    l_arm, rotors = module.arm_length, module.rotor_table
    beyond = np.maximum(x - l_arm * rotors.along_ports, 0.0)
    beside = np.maximum(l_arm * rotors.across_ports - r, 0.0)
    return "the rotors" if bool((np.hypot(beyond, beside) < module.rotor_radii[:, None]).any()) else None


def rotor_reach(module: Module) -> float:
    """Return how far rotors reach from the module's centre towards any port, less `body.rotor_radius` [m]."""
    body, rotors, R = module.body, module.rotor_table, module.rotor_radii[:, None]
    steep = np.abs(rotors.axes @ PORT_DIRECTIONS.T)
    disc = R * np.sqrt(1 - np.minimum(steep, 1.0) ** 2) - body.rotor_radius + body.rotor_height / 2 * steep
    return float((module.arm_length * rotors.along_ports + disc).max(initial=-math.inf))


def _rotor_top(module: Module) -> float:
    """Return the largest distance of a point of a rotor from the module's plane [m]."""
    body, rotors = module.body, module.rotor_table
    upright = np.minimum(np.abs(rotors.axes[:, 2]), 1.0)
    disc = module.rotor_radii * np.sqrt(1 - upright**2) + body.rotor_height / 2 * upright
    return float((np.abs(module.arm_length * rotors.positions[:, 2]) + disc).max(initial=0.0))


def largest_hinge_angle(module: Module, other: Module, margin: float = 0.0) -> float:
    """Return the hinge angle up to which no rotor of a module can meet the other module [rad].

    It is the same for all ports, so that equivalent trees have the same designs. At most pi/2; negative if this
    bound leaves no clear angle, although `clear_folds` may find some.

    Args:
        module: module whose rotors must be clear.
        other: module on the other side of the hinge.
        margin: required clearance of the rotors from other parts [m].
    """
    d, rotor = _nearest_rotor(module, margin)
    return min(math.pi / 2, math.pi - rotor - max(_nearest_rotor(other, margin)[1], _elevation(other, max(d, 0.0))))


def _nearest_rotor(module: Module, margin: float) -> tuple[float, float]:
    """Return d [m] and beta_r [rad] of a module; infinity and 0 without rotors."""
    d = module.connector_distance - rotor_reach(module) - module.body.rotor_radius - margin
    return d, math.atan2(_rotor_top(module) + margin, d)


def _elevation(module: Module, d: float) -> float:
    """Return the largest elevation of the frame beyond the distance d from a hinge axis, at any port [rad].

    Along an edge the elevation is monotonic up to z = 0, so it is largest at an end of the part beyond d.
    """
    edges, largest = _frame_edges(module), 0.0
    for outwards in PORT_DIRECTIONS[:, :2]:
        seen = np.stack([module.connector_distance - edges[..., :2] @ outwards, edges[..., 2]], axis=-1)
        if seen[..., 0].min() <= -d:
            return math.pi  # reaches as far beyond the axis as the neighbour's rotors
        start, along = seen[:, 0], seen[:, 1] - seen[:, 0]
        a, b = np.sum(along * along, axis=1), np.sum(start * along, axis=1)
        root = np.sqrt(np.maximum(0.0, b * b - a * (np.sum(start * start, axis=1) - d * d)))
        safe = np.where(a > 0.0, a, 1.0)  # an edge along the axis is a point
        t = np.clip([(-b - root) / safe, (-b + root) / safe, np.zeros_like(a), np.ones_like(a)], 0.0, 1.0)
        points = start + t[..., None] * along
        beyond = points[np.linalg.norm(points, axis=-1) >= d * (1 - LENGTH_ROUNDING)]
        largest = max(largest, float(np.arctan2(np.abs(beyond[:, 1]), beyond[:, 0]).max(initial=0.0)))
    return largest


def frame_pieces(module: Module) -> list[Array]:
    """Return the corners of hub and arms, or of the convex pieces of a custom frame, shape (k, 3) each [m]."""
    if module.body.frame is not None:
        return [np.array(piece.vertices) for piece in module.body.frame]
    return [box.corners for box in _pieces(module)]


def _frame_edges(module: Module) -> Array:
    """Return the end points of all edges of hub and arms, or of a custom frame, shape (m, 2, 3) [m].

    Boxes include their diagonals, which lie inside.
    """
    if module.body.frame is not None:
        sides = [np.array(piece.vertices)[np.array(piece.triangles)] for piece in module.body.frame]
        corners = np.concatenate(sides)
        return np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    pairs = list(combinations(range(len(CUBE)), 2))
    return np.concatenate([box[pairs] for box in frame_pieces(module)])


@lru_cache(maxsize=32)
def clear_folds(module: Module, other: Module, margin: float = 0.0) -> Folds:
    """Return the fold angles within +-pi/2 at which a module's rotors are clear of another, at any ports [rad].

    Every returned angle is proven clear; some that are barely clear may be missing. May be empty.

    Args:
        module: module whose rotors must be clear.
        other: module on the other side of the hinge.
        margin: required clearance of the rotors from other parts [m].
    """
    turn = largest_hinge_angle(module, other, margin) if module.rotor_table.count else math.pi / 2
    return ((-turn, turn),) if turn > 0 else _search_clear_folds(module, other, margin)


@dataclass(frozen=True)
class _Part:
    """Convex part in the frame of a flat hinge: hull of corners, or of discs around them."""

    corners: Array
    """Shape (k, 3) [m]."""
    radius: float = 0.0
    """Radius of the discs, across the line between two corners [m]."""

    @functools.cached_property
    def axis(self) -> Array:
        """Axis of the discs, shape (3,)."""
        along = self.corners[-1] - self.corners[0]
        return np.asarray(along / np.linalg.norm(along))

    @property
    def rho(self) -> float:
        """Largest distance of the part's points from the hinge axis [m]."""
        x, z = np.abs(self.corners[:, 0]), np.abs(self.corners[:, 2])
        if self.radius:
            ax, _, az = np.minimum(np.abs(self.axis), 1.0)
            x, z = x + self.radius * math.sqrt(1 - ax * ax), z + self.radius * math.sqrt(1 - az * az)
        return float(np.hypot(x, z).max())

    @property
    def ball(self) -> tuple[Array, float]:
        """Centre (3,) and radius of a ball around the part [m]."""
        centre = self.corners.mean(axis=0)
        return centre, float(np.linalg.norm(self.corners - centre, axis=1).max()) + self.radius

    def support(self, u: Array, turn: Array) -> Array:
        """Return the support function max u . x for u (m, k, 3), with the part turned about y by angles (m,)."""
        u = _turn(u, -turn[:, None])
        farthest = (u @ self.corners.T).max(axis=-1)
        if self.radius:
            x, y, z = np.moveaxis(u - (u @ self.axis)[..., None] * self.axis, -1, 0)
            farthest = farthest + self.radius * np.hypot(np.hypot(x, y), z)
        return np.asarray(farthest)


def _search_clear_folds(module: Module, other: Module, margin: float) -> Folds:
    """Return certified intervals of clear folds."""
    pairs = _pairs(module, other)
    # hub, arms and rotors are mirrored by z = 0
    symmetric = all(one.body.frame is None and one.rotors is None for one in (module, other))

    def slack(phi: Array, h: float) -> tuple[Array, float]:
        """Return the least clearance of all pairs over the largest possible loss in the interval."""
        least = np.full(len(phi), math.inf)
        for A, B in pairs:
            loss = min(A.rho, B.rho) * h + LENGTH_ROUNDING * (A.rho + B.rho)
            open_ = least > -1.0
            least[open_] = np.minimum(least[open_], (_distance(A, B, phi[open_], margin + loss) - margin) / loss)
        return least, 1.0

    clear = _clear_intervals(slack, halvings=8, upper_half=symmetric)  # to 0.8 mrad
    return join(clear + [(-high, -low) for low, high in clear] if symmetric else clear)


def _clear_intervals(
    slack: Callable[[Array, float], tuple[Array, float]], *, halvings: int, upper_half: bool = False
) -> list[tuple[float, float]]:
    """Return intervals of fold angles that are clear throughout; undecided intervals are halved.

    Args:
        slack: returns, for the centres of intervals and their half-width, the slack there and its largest change
            within the interval.
        halvings: number of halvings.
        upper_half: True to search positive angles only.
    """
    count = 16  # intervals of +-pi/2 to begin with
    h = math.pi / 2 / count
    phi = np.linspace(-math.pi / 2 + h, math.pi / 2 - h, count)
    phi = phi[phi > 0] if upper_half else phi
    clear: list[tuple[float, float]] = []
    for _ in range(halvings + 1):
        values, change = slack(phi, h)
        clear += [(middle - h, middle + h) for middle in phi[values >= change].tolist()]
        open_ = phi[np.abs(values) < change]
        if not len(open_):
            break
        h /= 2
        phi = np.concatenate([open_ - h, open_ + h])
    return clear


def _pairs(module: Module, other: Module) -> list[tuple[_Part, _Part]]:
    """Return all pairs of a rotor of a module and a part of the other, for each of their ports at the hinge.

    Seen from the other module the fold is the same.
    """
    half_turn = np.diag([-1.0, -1.0, 1.0])
    to_hinge, beyond = (np.array([one.connector_distance, 0.0, 0.0]) for one in (module, other))
    parts = [_Part(ends @ half_turn + beyond, R) for ends, R in _discs(other)]
    parts += [_Part(corners @ half_turn + beyond) for corners in _from_ports(other, frame_pieces(other))]
    return [(_Part(ends - to_hinge, R), part) for ends, R in _discs(module) for part in parts]


def _discs(module: Module) -> list[tuple[Array, float]]:
    """Return centres of the faces (2, 3) and radius of each rotor disc [m], with each port in turn along x."""
    sizes = dict.fromkeys(module.rotor_radii.tolist())
    return [(ends, R) for R in sizes for ends in _from_ports(module, _rotor_ends(module, R))]


def _rotor_ends(module: Module, radius: float) -> list[Array]:
    """Return the centres of the faces of each rotor disc of a radius, shape (2, 3) [m]."""
    rotors, half_height = module.rotor_table, module.body.rotor_height / 2
    centres = module.arm_length * rotors.positions
    ends = np.stack([centres - half_height * rotors.axes, centres + half_height * rotors.axes], axis=1)
    return list(ends[module.rotor_radii == radius])


def _from_ports(module: Module, parts: list[Array]) -> list[Array]:
    """Return the corners of parts with each port in turn along x, without duplicates."""
    seen: dict[bytes, Array] = {}
    for (x, y, _), corners in product(PORT_DIRECTIONS, parts):
        turned = corners @ np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
        seen[np.unique(np.round(turned / module.connector_distance, 9) + 0.0, axis=0).tobytes()] = turned
    return list(seen.values())


def _distance(A: _Part, B: _Part, phi: Array, enough: float) -> Array:
    """Return lower bounds for the distance of two parts at fold angles (m,), proven up to `enough` [m]."""
    (a, r_a), (b, r_b) = A.ball, B.ball
    middle_a, middle_b = (_turn(np.broadcast_to(c, (len(phi), 3)), t) for c, t in ((a, phi / 2), (b, -phi / 2)))
    apart: Array = np.linalg.norm(middle_b - middle_a, axis=1) - r_a - r_b
    undecided = apart < enough
    if not undecided.any():
        return apart
    turn = phi[undecided] / 2

    def gap(u: Array) -> Array:
        return -A.support(u, turn) - B.support(-u, -turn)

    z = np.broadcast_to([0.0, 0.0, 1.0], (len(turn), 3))
    faces = np.stack([_turn(z, turn), -_turn(z, turn), _turn(z, -turn), -_turn(z, -turn)], axis=1)
    u = np.concatenate([faces, np.broadcast_to(DIRECTIONS, (len(turn), *DIRECTIONS.shape))], axis=1)
    bounds = np.full(len(turn), -math.inf)
    for step in range(41):  # 40 steps of a direct search over u with shrinking step size
        gaps = gap(u)
        best = gaps.argmax(axis=1)
        bounds = np.take_along_axis(gaps, best[:, None], axis=1)[:, 0]
        if np.all(bounds >= enough):
            break
        u = _ring(np.take_along_axis(u, best[:, None, None], axis=1)[:, 0], 0.5 * 0.7**step, float(step))
    apart[undecided] = np.maximum(apart[undecided], bounds)
    return apart


def _ring(axes: Array, angle: float, first: float) -> Array:
    """Return unit axes (m, 3) and six directions at an angle around each, shape (m, 7, 3)."""
    across = np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    beside = np.cross(axes, across)
    ring = [math.cos(t) * across + math.sin(t) * beside for t in first + np.arange(6) * math.pi / 3]
    around = math.cos(angle) * axes[:, None] + math.sin(angle) * np.stack(ring, axis=1)
    return np.concatenate([axes[:, None], around], axis=1)


def _turn(vectors: Array, angle: Array) -> Array:
    x, y, z = np.moveaxis(vectors, -1, 0)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x + s * z, y + 0.0 * c, c * z - s * x], axis=-1)


def _evenly(m: int) -> Array:
    """Return m directions, evenly distributed along a spiral, shape (m, 3)."""
    z, turn = 1.0 - (2.0 * np.arange(m) + 1.0) / m, np.arange(m) * math.pi * (3.0 - math.sqrt(5.0))
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)


DIRECTIONS = np.concatenate([_evenly(200), np.eye(3), -np.eye(3)])
"""Initial directions for the search for a separating direction."""


class Balls(NamedTuple):
    """Balls in a module's frame."""

    centres: Array
    """Shape (m, 3) [m]."""
    radii: Array
    """Shape (m,) [m]."""


class _Box(NamedTuple):
    """Box around a convex piece, and half-spaces that contain the piece: normals @ x <= offsets."""

    centre: Array
    axes: Array
    """Unit vectors of its edges as rows, shape (3, 3)."""
    half: Array
    """Half-lengths of its edges, shape (3,)."""
    normals: Array
    offsets: Array

    @property
    def corners(self) -> Array:
        """Corners of the box, shape (8, 3)."""
        return self.centre + (2 * CUBE * self.half) @ self.axes


@functools.cache
def part_cover(module: Module) -> Balls:
    """Return balls that, together with the module's own envelope, contain all rigid parts; rotors come first."""
    balls, pieces, finest = _rotor_balls(module), _pieces(module), FINEST * module.arm_length
    most = max(MOST_BOXES, len(pieces))
    air = module.envelope if module.rotor_table.count else None
    while len(cells := list(islice(_uncovered_boxes(pieces, balls, finest, air), most + 1))) > most:
        finest *= math.sqrt(2)
    return _join_balls(balls, cells)


@functools.cache
def whole_cover(module: Module) -> Balls:
    """Return balls that contain all rigid parts; rotors come first.

    Hub and arms, or the pieces of a custom frame, are covered one after the other, the largest first, except what
    earlier balls contain.
    """
    pieces = sorted(_pieces(module), key=lambda piece: -float(np.linalg.norm(piece.half)))
    coarse = FINEST * module.arm_length
    fine = coarse / 4
    while True:
        coarse, balls = 4 * coarse, _rotor_balls(module)
        for piece in pieces:
            boxes = islice(_uncovered_boxes([piece], balls, coarse), MOST_BOXES + 1)
            balls = _join_balls(balls, [box for box in boxes if any(_uncovered_boxes([box], balls, fine))])
        if len(balls.radii) <= module.rotor_table.count + max(MOST_BOXES, len(pieces)):
            return balls


def _rotor_balls(module: Module) -> Balls:
    rotors = module.arm_length * module.rotor_table.positions
    return Balls(rotors, np.hypot(module.rotor_radii, module.body.rotor_height / 2))


def _join_balls(balls: Balls, boxes: list[_Box]) -> Balls:
    centres = np.concatenate([balls.centres, *(box.centre[None] for box in boxes)])
    radii = np.concatenate([balls.radii, [float(np.linalg.norm(box.half)) for box in boxes]])
    return Balls(read_only(centres), read_only(radii))


def _uncovered_boxes(
    pieces: list[_Box], balls: Balls, finest: float, air: AirflowEnvelope | None = None
) -> Iterator[_Box]:
    """Yield boxes that cover the parts of pieces outside an envelope and all balls.

    Args:
        pieces: pieces to cover.
        balls: balls whose content needs no cover.
        finest: half diagonal of the largest box that is not halved [m].
        air: envelope whose content needs no cover, if any.
    """
    stack = list(pieces)
    while stack:
        box = stack.pop()
        corners = box.corners
        if np.any((corners @ box.normals.T).min(axis=0) > box.offsets):
            continue  # beyond a face of the piece
        if air is not None:
            depth = -np.clip(corners[:, 2], -air.length, 0.0) / air.length  # any point of the axis is valid
            distance = np.linalg.norm(corners + (depth * air.length)[:, None] * UP, axis=1)
            if np.all(distance <= air.start_radius + depth * air.growth):
                continue  # an envelope is convex, and so is a ball
        if np.any(np.all(np.linalg.norm(corners - balls.centres[:, None], axis=2) <= balls.radii[:, None], axis=1)):
            continue
        if np.linalg.norm(box.half) <= finest:
            yield box
            continue
        k = int(np.argmax(box.half))
        half = box.half * np.where(np.arange(3) == k, 0.5, 1.0)
        stack += [box._replace(centre=box.centre + side * half[k] * box.axes[k], half=half) for side in (-1, 1)]


def _pieces(module: Module) -> list[_Box]:
    """Return hub and arms, or boxes around the pieces of a custom frame."""
    body, l_arm, width = module.body, module.arm_length, module.body.arm_width
    if body.frame is not None:
        result = []
        for piece in body.frame:
            vertices = np.array(piece.vertices)
            corners = vertices[np.array(piece.triangles)]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            size = np.linalg.norm(normals, axis=1)
            large = size > 1e-9 * np.ptp(vertices, axis=0).max() ** 2  # the normals of slivers are lost to rounding
            normals = normals[large] / size[large, None]
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            # from the farthest corner, so that the half-spaces contain the piece exactly
            offsets = (normals @ vertices.T).max(axis=1)
            result.append(_Box((low + high) / 2, np.eye(3), (high - low) / 2, normals, offsets))
        return result
    boxes = [(np.zeros(3), np.eye(3), np.array(body.hub) / 2)]
    rotors = module.rotor_table
    for axes, length in rotors.arms(l_arm):
        boxes.append((length / 2 * axes[0], axes, np.array([length, width, width]) / 2))
    return [_Box(centre, axes, half, axes[:1], (half + axes @ centre)[:1]) for centre, axes, half in boxes]


@functools.cache
def airflow_folds(module: Module, other: Module, margin: float = 0.0) -> Folds:
    """Return the fold angles within +-pi/2 at which a module is clear of the airflow of one bolted to it [rad].

    They are the same for all ports. Every returned angle is clear; some that are barely clear may be missing, and
    more for a custom frame, whose distance is that from its face planes and its box. May be empty.

    Args:
        module: module whose parts must be clear.
        other: module on the other side of the hinge, whose airflow it is.
        margin: required clearance of parts from the airflow [m].
    """
    if not other.rotor_table.count:
        return ((-math.pi / 2, math.pi / 2),)
    rate = module.connector_distance + body_radius(module)

    def slack(phi: Array, h: float) -> tuple[Array, float]:
        return _airflow_clearance(module, other, phi) - margin, rate * h

    return join(_clear_intervals(slack, halvings=11))  # to 0.1 mrad


def _airflow_clearance(module: Module, other: Module, phi: Array) -> Array:
    """Return the least clearance of all parts from the neighbour's airflow over all ports, shape (t,) [m]."""
    air, body, pieces = other.envelope, module.body, _pieces(module)
    rotors, axes = module.arm_length * module.rotor_table.positions, module.rotor_table.axes
    # by default opposite ports look the same, and with a square hub all four
    own = body.frame is not None or module.rotors is not None
    ports = PORT_DIRECTIONS if own else PORT_DIRECTIONS[: 2 - (body.hub[0] == body.hub[1])]
    sine, cosine = np.sin(phi)[:, None, None], np.cos(phi)[:, None, None]
    to_hinge, beyond = module.connector_distance, other.connector_distance
    o = to_hinge * ports + beyond * (cosine * ports + sine * UP)  # (t, ports, 3)
    d = air.length * (sine * ports - cosine * UP)

    def clearances(eta: Array) -> Array:
        """Return the clearances of rotors, then pieces, at eta of shape (t, ports, m)."""
        P = o[:, :, None] + eta[..., None] * d[:, :, None]  # (t, ports, m, 3)
        from_rotors = P[:, :, : len(rotors)] - rotors
        height = np.sum(from_rotors * axes, axis=-1)
        beside = np.linalg.norm(from_rotors - height[..., None] * axes, axis=-1) - module.rotor_radii
        above = np.abs(height) - body.rotor_height / 2
        apart = [np.hypot(np.maximum(0.0, beside), np.maximum(0.0, above))]
        apart += [_from_piece(P[:, :, k], piece)[..., None] for k, piece in enumerate(pieces, start=len(rotors))]
        return np.concatenate(apart, axis=-1) - air.start_radius - eta * air.growth

    low = np.zeros((len(phi), len(ports), len(rotors) + len(pieces)))
    high = np.ones_like(low)
    golden = (math.sqrt(5) - 1) / 2
    first, second = high - golden, low + golden
    at_first, at_second = clearances(first), clearances(second)
    least = np.minimum(clearances(low), clearances(high))
    for _ in range(44):  # golden sections of the axis, to a billionth
        less = at_first < at_second
        low, high = np.where(less, low, first), np.where(less, second, high)
        new = np.where(less, high - golden * (high - low), low + golden * (high - low))
        at_new = clearances(new)
        first, second = np.where(less, new, second), np.where(less, first, new)
        at_first, at_second = np.where(less, at_new, at_second), np.where(less, at_first, at_new)
    least = np.minimum(least, np.minimum(at_first, at_second))
    return np.asarray(least.min(axis=(1, 2)))


def _from_piece(x: Array, piece: _Box) -> Array:
    """Return the distance of points, shape (..., 3), from a piece; a lower bound for a piece of a custom frame."""
    beyond = np.maximum(0.0, np.abs((x - piece.centre) @ piece.axes.T) - piece.half)
    from_planes = (x @ piece.normals.T - piece.offsets).max(axis=-1)
    return np.asarray(np.maximum(np.linalg.norm(beyond, axis=-1), from_planes))


def broken_hinges(task: "Task") -> Broken:
    """Yield the broken rule of a set of hinge angles without any clear fold."""
    angles = task.search.hinge_set_deg
    if angles is None or task.search.lattice is not None or not (folds := task.folds(task.search.margin)):
        return
    if not any(low <= math.radians(angle) <= high for angle in angles for low, high in folds):
        field = "hinge_step_deg" if task.search.hinge_angles_deg is None else "hinge_angles_deg"
        rule = f"must have an angle that keeps rotors clear of a neighbour, {folds_text(folds, ' deg')}"
        yield ("search", field), f"{rule}, but got {show(getattr(task.search, field))}"

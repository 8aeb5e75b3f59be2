r"""The room that the rigid parts of a module need: on its own, bolted to a neighbour, and beside others' airflow.

Modules that are not bolted together cannot touch as long as the balls of radius rho around their centres do not.

Of two modules that share a hinge, hubs and arms may meet there, but a rotor may touch nothing, and all parts keep
out of the other's airflow. The fold of a hinge is its angle with a sign of its own: positive where the upper sides
of the two modules lean towards each other and their airflows apart, whichever ports are bolted. `clear_folds` and
`airflow_folds` search for folds at which all pairs of parts are clear, and certify every interval. They can be
several intervals, none of which holds 0.

Two convex parts A and B are apart by min_B u . x - max_A u . x at least, whatever the unit vector u. If that is s
at the fold phi, then within phi +- h it is s - rho h at least, with rho the distance of the points of A, or of B,
from the hinge's axis at most: hold the other one still.

| symbol | meaning | shape | unit |
|---|---|---|---|
| phi, h | fold angles, the middles of intervals of one half width | (m,), | rad |
| u | directions in the frame of the hinge: x along the way from module to module, y its axis, z up | (m, k, 3) | |
| rho | distance of a part's points from the hinge's axis at most | | m |

An envelope starts with the radius r_air about its module's centre, by default one arm length, but a rotor at the
end of an arm reaches farther: the paper's envelope leaves the rotors' outer rims outside. So airflows that keep
clear of each other do not yet keep rotors out of them.

Of modules that are not bolted together the search keeps balls around rotors out of the airflow; what parts there
are outside those and outside the module's own envelope gets balls as well (`part_cover`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from topo_search.model.arrays import PORT_DIRECTIONS, ROTOR_DIRECTIONS, Array, read_only
from topo_search.model.module import AirflowEnvelope, Module
from topo_search.model.proven import excess_texts
from topo_search.model.shape import nearest_point

LENGTH_ROUNDING = 1e-9
"""Share of a length, or angle [rad], that is left to rounding."""
LARGE = 4.0
"""Lengths that keep modules off the end-effector, and its rod, are seldom meant to be longer, in packed widths."""
INWARDS = 0.2
"""Depth inside its connector's plane to which a frame may touch a bolted one [l_c]: 30 mm of the default module.

A frame that is as high as the default hub at its connector needs 20 mm when it is folded by 90 degrees.
"""
OUTWARDS = 0.05
"""The same outside that plane [l_c]: room for a fitting, 7.5 mm of the default module."""
FINEST = 0.25
"""Radius of the balls around parts, unless that makes many of them [l_arm],"""
MOST_BOXES = 24
"""which is more than this."""
UP = np.array([0.0, 0.0, 1.0])
CUBE = np.array(list(product((-0.5, 0.5), repeat=3)))
"""Corners of a box with edges of 1."""
DIRECTIONS = np.array([u for u in product(np.arange(-3.0, 4.0), repeat=3) if max(map(abs, u)) == 3])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
"""From the middle of a cube to a grid on its faces, (218, 3)."""


def packed_width(module: Module, n: int) -> float:
    """Return how wide n modules are, packed in a square: a scale for lengths at the target [m]."""
    return 2 * module.connector_distance * math.sqrt(n)


def body_radius(module: Module) -> float:
    """Return rho: all rigid parts lie in the ball of this radius around the module's centre [m]."""
    body = module.body
    rim = math.hypot(module.arm_length + body.rotor_radius, body.rotor_height / 2)
    return max(rim, float(np.linalg.norm(np.concatenate(frame_pieces(module)), axis=1).max()))


def frame_reach(module: Module) -> float:
    """Return how far hub and arms, or the module's own frame, reach towards any of the four ports [m]."""
    return float(np.abs(np.concatenate(frame_pieces(module))[:, :2]).max())


def frame_pieces(module: Module) -> list[Array]:
    """Return the corners of hub and arms, or of each convex piece of the module's own frame, shapes (k, 3) [m]."""
    if module.body.frame is not None:
        return [np.array(piece.vertices) for piece in module.body.frame]
    return [box.corners for box in _pieces(module)]


Folds = tuple[tuple[float, float], ...]
"""Closed intervals of fold angles, in ascending order [rad]."""

FOLD = (-1.0, 1.0, 1.0, -1.0)
"""Sign of the fold of a positive hinge angle at the parent's port +x, +y, -x, -y."""


@lru_cache(maxsize=32)
def clear_folds(module: Module, margin: float = 0.0) -> Folds:
    """Return fold angles within +-pi/2 at which rotors keep off all parts of a bolted module [rad].

    The same for all ports, so that trees which are alike have the same designs, and empty where there is none.

    Args:
        module: the module, at either side of the hinge.
        margin: what the rotors keep clear of other parts by at least [m].
    """
    here, parts = np.array([module.connector_distance, 0.0, 0.0]), _parts_across(module)
    rotors = [_Part(rotor.corners - 2 * here, disc=rotor.disc) for rotor in parts[: len(ROTOR_DIRECTIONS)]]
    even = module.body.frame is None  # hubs, arms and rotors are the same upside down
    return _search([(rotor, part) for rotor in rotors for part in parts], margin, even=even)


@lru_cache(maxsize=32)
def airflow_folds(module: Module, margin: float = 0.0) -> Folds:
    """Return fold angles within +-pi/2 at which all parts of a bolted module keep off the airflow [rad].

    The same for all ports, and empty where there is none.

    Args:
        module: the module, at either side of the hinge.
        margin: what parts keep clear of the airflow by at least [m].
    """
    air, l_c = module.envelope, module.connector_distance
    axis = np.array([[-l_c, 0.0, 0.0], [-l_c, 0.0, -air.length]])
    # all that is too near to the envelope's core, which is thinner by the first radius, is in the envelope
    core, margin = _Part(axis, balls=np.array([0.0, air.growth])), margin + air.start_radius
    return _search([(core, part) for part in _parts_across(module)], margin)


def nearest_fold(folds: Folds, phi: Array) -> Array:
    """Return the clear fold nearest to each angle; 0 where there is none at all."""
    if not folds:
        return np.zeros_like(phi)
    inside = np.array([np.clip(phi, low, high) for low, high in folds])
    choice = np.argmin(np.abs(inside - phi), axis=0)
    return np.asarray(np.take_along_axis(inside, choice[None], axis=0)[0])


def intersect(some: Folds, others: Folds) -> Folds:
    """Return the folds that two sets of intervals have in common."""
    both = ((max(a, c), min(b, d)) for a, b in some for c, d in others)
    return tuple(sorted((low, high) for low, high in both if low <= high))


def in_words(folds: Folds, unit: str) -> str:
    """Return how far hinges turn, in degrees with a unit as it is to be written; every angle between is clear."""
    mirrored = tuple((-high, -low) for low, high in reversed(folds)) == folds
    ways = [(max(low, 0.0), high) for low, high in folds if high > 0] if mirrored else folds
    limits = [excess_texts(math.degrees(high), math.degrees(low), 3) for low, high in ways]
    texts = [f"{low} to {high}{unit}" for high, low in limits]
    if mirrored and ways[0][0] == 0:
        texts[0] = f"at most {limits[0][0]}{unit}"
    text = " or ".join(texts)
    return text if mirrored else f"{text}, counted positive where airflows lean apart"


@dataclass(frozen=True)
class _Part:
    """A convex part in the frame of the hinge, with its module flat: the hull of its corners, each widened."""

    corners: Array
    """(k, 3) [m]"""
    disc: float = 0.0
    """Radius of the discs about all corners, across z [m]."""
    balls: Array = field(default_factory=lambda: np.zeros(1))
    """Radii of the balls about the corners, (k,) or (1,) [m]."""

    @property
    def rho(self) -> float:
        """Largest distance of the part's points from the hinge's axis [m]."""
        return float((np.hypot(np.abs(self.corners[:, 0]) + self.disc, self.corners[:, 2]) + self.balls).max())

    def farthest(self, u: Array, turn: Array) -> Array:
        """Return the points farthest along vectors u (m, k, 3), with the part turned about y by (m, 1)."""
        u = _turn(u / np.linalg.norm(u, axis=-1, keepdims=True), -turn)
        corner = np.argmax(u @ self.corners.T + self.balls, axis=-1)
        across = np.where([True, True, False], u, 0.0)
        across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-300)
        ball = np.broadcast_to(self.balls, len(self.corners))[corner][..., None]
        return _turn(self.corners[corner] + self.disc * across + ball * u, turn)


def _search(pairs: list[tuple[_Part, _Part]], margin: float, *, even: bool = False) -> Folds:
    """Return intervals of fold angles at which all pairs are clear, joined; what is open is halved.

    Every angle in them is clear by proof; some beside their ends, within the last interval, may be missing.

    Args:
        pairs: parts of the module at -x and of its neighbour at +x.
        margin: what the two parts of each pair are apart by at least [m].
        even: whether negative angles are like positive ones.
    """
    first, right = 16, math.pi / 2  # intervals to begin with
    h = right / first
    phi = np.linspace(0.0 if even else -right, right, first // 2 + 1 if even else first + 1)[1:] - h
    clear: list[tuple[float, float]] = []
    while len(phi) and h > 5e-5:  # down to 0.1 mrad
        least = np.full(len(phi), math.inf)
        for A, B in pairs:
            room = min(A.rho, B.rho) * h + LENGTH_ROUNDING * (A.rho + B.rho)
            left = least > -1.0
            least[left] = np.minimum(least[left], (_distance(A, B, phi[left], margin + room) - margin) / room)
        clear += [(middle - h, middle + h) for middle in phi[least >= 1.0].tolist()]
        phi, h = phi[np.abs(least) < 1.0], h / 2
        phi = np.concatenate([phi - h, phi + h])
    joined: list[tuple[float, float]] = []
    for low, high in sorted(clear + [(-high, -low) for low, high in clear] if even else clear):
        if joined and low - joined[-1][1] < LENGTH_ROUNDING:
            low, _ = joined.pop()
        joined.append((low, high))
    return tuple(
        (-right if right + low < LENGTH_ROUNDING else low, right if right - high < LENGTH_ROUNDING else high)
        for low, high in joined
    )


def _parts_across(module: Module) -> list[_Part]:
    """Return the rotors, then hub and arms, of the module at +x, with each of its ports at the hinge.

    A module's rotors are the same from every port, and what holds for one module's rotors or airflow and the
    other's parts holds for the other's and the one's.
    """
    body, here = module.body, np.array([module.connector_distance, 0.0, 0.0])
    up = body.rotor_height / 2 * UP
    rotors = [np.array([centre - up, centre + up]) + here for centre in module.arm_length * ROTOR_DIRECTIONS]
    frames: dict[bytes, Array] = {}  # arms are the same from every port
    for x, y, _ in PORT_DIRECTIONS.tolist():
        to_port = np.array([[-x, -y, 0.0], [y, -x, 0.0], [0.0, 0.0, 1.0]])
        for corners in frame_pieces(module):
            seen = corners @ to_port.T + here
            frames[np.unique(np.round(seen / here[0], 9) + 0.0, axis=0).tobytes()] = seen
    return [*(_Part(corners, disc=body.rotor_radius) for corners in rotors), *map(_Part, frames.values())]


def _distance(A: _Part, B: _Part, phi: Array, enough: float) -> Array:
    """Return how far two parts are apart at least at fold angles (m,) [m]; minus how deep, about, where they meet.

    No more than `enough` need be proven.
    """

    def farthest(u: Array, phi: Array, middle: Array | float = 0.0, share: float = 1.0) -> Array:
        """Return points of the set of all differences of the parts' points, shrunk about its middle, likewise."""
        return middle + share * (B.farthest(u, -phi / 2) - A.farthest(-u, phi / 2) - middle)

    u = _turn(DIRECTIONS, -phi[:, None] / 2)  # faces of B are among them
    outline = farthest(u, phi[:, None])
    apart = np.asarray(-(outline * u).sum(axis=-1).min(axis=1))
    for k in np.flatnonzero(apart < enough):
        middle = outline[k].mean(axis=0)
        for share in (1.0, 0.98, 0.7):  # parts that meet come apart as they shrink, along the way in which they do
            shrunk = partial(farthest, phi=phi[k], middle=middle, share=share)
            x = nearest_point(np.zeros(3), middle, shrunk, enough)
            if (length := np.linalg.norm(x)) > LENGTH_ROUNDING * B.rho:
                apart[k] = max(apart[k], x @ farthest(-x, phi[k]) / length)
                break
    return apart


def _turn(vectors: Array, angle: Array) -> Array:
    """Return vectors (..., 3) turned about the y axis."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x + s * z, y + 0.0 * c, c * z - s * x], axis=-1)


class Balls(NamedTuple):
    """Balls in a module's frame."""

    centres: Array
    """Shape (m, 3) [m]."""
    radii: Array
    """Shape (m,) [m]."""


class _Box(NamedTuple):
    """A box, and half-spaces that hold the convex piece that it is drawn around: normals @ x <= offsets."""

    centre: Array
    axes: Array
    """Rows: unit vectors of its edges, shape (3, 3)."""
    half: Array
    """Half its edges, shape (3,)."""
    normals: Array
    offsets: Array

    @property
    def corners(self) -> Array:
        """Shape (8, 3)."""
        return self.centre + (2 * CUBE * self.half) @ self.axes


@functools.cache
def part_cover(module: Module) -> Balls:
    """Return balls around all rigid parts that reach out of the module's own airflow; rotors come first.

    The union of the balls and of the module's own envelope holds all rigid parts.
    """
    balls, pieces, finest = _rotor_balls(module), _pieces(module), FINEST * module.arm_length
    most = max(MOST_BOXES, len(pieces))
    while len(cells := list(islice(_uncovered_boxes(pieces, balls, finest, module.envelope), most + 1))) > most:
        finest *= math.sqrt(2)
    return _join_balls(balls, cells)


@functools.cache
def whole_cover(module: Module) -> Balls:
    """Return balls around all rigid parts; rotors come first.

    Hub and arms, or the pieces of an own frame, get theirs one after the other, the largest first: what earlier
    balls hold needs none.
    """
    pieces = sorted(_pieces(module), key=lambda piece: -float(np.linalg.norm(piece.half)))
    coarse = FINEST * module.arm_length
    fine = coarse / 4
    while True:
        coarse, balls = 4 * coarse, _rotor_balls(module)
        for piece in pieces:
            boxes = islice(_uncovered_boxes([piece], balls, coarse), MOST_BOXES + 1)
            balls = _join_balls(balls, [box for box in boxes if any(_uncovered_boxes([box], balls, fine))])
        if len(balls.radii) <= len(ROTOR_DIRECTIONS) + max(MOST_BOXES, len(pieces)):
            return balls


def _rotor_balls(module: Module) -> Balls:
    rotors = module.arm_length * ROTOR_DIRECTIONS
    return Balls(rotors, np.full(len(rotors), math.hypot(module.body.rotor_radius, module.body.rotor_height / 2)))


def _join_balls(balls: Balls, boxes: list[_Box]) -> Balls:
    """Return the balls and one around each box."""
    centres = np.concatenate([balls.centres, *(box.centre[None] for box in boxes)])
    radii = np.concatenate([balls.radii, [float(np.linalg.norm(box.half)) for box in boxes]])
    return Balls(read_only(centres), read_only(radii))


def _uncovered_boxes(
    pieces: list[_Box], balls: Balls, finest: float, air: AirflowEnvelope | None = None
) -> Iterator[_Box]:
    """Yield boxes around all of some pieces that is neither in an envelope nor in any one of some balls.

    Args:
        pieces: the pieces.
        balls: the balls.
        finest: half diagonal of the largest box that is not halved [m].
        air: the envelope, if there is one.
    """
    left = list(pieces)
    while left:
        box = left.pop()
        corners = box.corners
        if np.any((corners @ box.normals.T).min(axis=0) > box.offsets):
            continue  # beyond a face of the piece
        if air is not None:
            depth = -np.clip(corners[:, 2], -air.length, 0.0) / air.length  # a place on the axis near enough
            in_air = np.linalg.norm(corners + (depth * air.length)[:, None] * UP, axis=1)
            if np.all(in_air <= air.start_radius + depth * air.growth):
                continue  # an envelope is convex, and so is a ball
        if np.any(np.all(np.linalg.norm(corners - balls.centres[:, None], axis=2) <= balls.radii[:, None], axis=1)):
            continue
        if np.linalg.norm(box.half) <= finest:
            yield box
            continue
        k = int(np.argmax(box.half))
        half = box.half * np.where(np.arange(3) == k, 0.5, 1.0)
        left += [box._replace(centre=box.centre + side * half[k] * box.axes[k], half=half) for side in (-1, 1)]


def _pieces(module: Module) -> list[_Box]:
    """Return hub and arms, or boxes around the pieces of the module's own frame."""
    body, l_arm, width = module.body, module.arm_length, module.body.arm_width
    if body.frame is not None:
        result = []
        for piece in body.frame:
            vertices = np.array(piece.vertices)
            corners = vertices[np.array(piece.triangles)]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            size = np.linalg.norm(normals, axis=1)
            large = size > 1e-9 * np.ptp(vertices, axis=0).max() ** 2  # of slivers the direction is lost
            normals = normals[large] / size[large, None]
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            # Faces as far out as the farthest corner: then half-spaces hold the piece to the last digit.
            offsets = (normals @ vertices.T).max(axis=1)
            result.append(_Box((low + high) / 2, np.eye(3), (high - low) / 2, normals, offsets))
        return result
    boxes = [(np.zeros(3), np.eye(3), np.array(body.hub) / 2)]
    for along in ROTOR_DIRECTIONS:
        axes = np.stack([along, np.cross(UP, along), UP])
        boxes.append((l_arm / 2 * along, axes, np.array([l_arm, width, width]) / 2))
    return [_Box(centre, axes, half, axes[:1], (half + axes @ centre)[:1]) for centre, axes, half in boxes]

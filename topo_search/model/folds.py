r"""The fold angles at which the rotors of two bolted modules keep clear of each other's parts.

The fold of a hinge is its angle with a sign of its own: positive where the upper sides of the two modules lean
towards each other and their airflows apart, whichever ports are bolted. `topo_search.model.room` bounds it in one
line. Where that leaves no angle, rotors may reach beyond the hinge's axis, in among the arms of the neighbour: then
the clear folds are found here, by a search whose every interval is certified. They can be several intervals, none
of which holds 0.

Two convex parts A and B are apart by min_B u . x - max_A u . x at least, whatever the unit vector u. If that is s
at the fold phi, then within phi +- h it is s - rho h at least, with rho the distance of the points of A, or of B,
from the hinge's axis at most: hold the other one still.

| symbol | meaning | shape | unit |
|---|---|---|---|
| phi, h | fold angles, the middles of intervals of one half width | (m,), | rad |
| u | directions in the frame of the hinge: x along the way from module to module, y its axis, z up | (m, 3) | |
| rho | distance of a part's points from the hinge's axis at most | | m |
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.module import Module
from topo_search.model.room import frame_pieces, largest_hinge_angle

Folds = tuple[tuple[float, float], ...]
"""Closed intervals of fold angles, in ascending order [rad]."""

FOLD = (-1.0, 1.0, 1.0, -1.0)
"""Sign of the fold of a positive hinge angle at the parent's port +x, +y, -x, -y."""
FIRST = 16
"""Intervals of +-pi/2 that a search begins with."""
HALVINGS = 8
"""Times that an interval is halved which is clear in the middle but not yet all over: to 0.8 mrad."""
AIMS = 40
"""Rounds in which a direction u is turned to where two parts are farther apart."""
RING = 0.5
"""Angle of the first turns [rad]; a little less in every further round."""
NARROWER = 0.7
"""By how much."""
ROUNDING = 1e-9
"""Share of a length, or angle [rad], that is left to rounding."""


def clear_folds(module: Module, margin: float = 0.0) -> Folds:
    """Return fold angles within +-pi/2 at which rotors of bolted modules are clear, the same for all ports [rad].

    Empty where there is none. Every angle is clear by proof; of those that a search finds, some that are hardly
    clear may be missing.

    Args:
        module: the module, at either side of the hinge.
        margin: what the rotors keep clear of other parts by at least [m].
    """
    turn = largest_hinge_angle(module, margin)
    return ((-turn, turn),) if turn > 0 else _search(module, margin)


def nearest_fold(folds: Folds, phi: Array) -> Array:
    """Return the clear fold nearest to each angle; 0 where there is none at all."""
    if not folds:
        return np.zeros_like(phi)
    inside = np.array([np.clip(phi, low, high) for low, high in folds])
    choice = np.argmin(np.abs(inside - phi), axis=0)
    result: Array = np.take_along_axis(inside, choice[None], axis=0)[0]
    return result


def intersect(some: Folds, others: Folds) -> Folds:
    """Return the folds that two sets of intervals have in common."""
    both = ((max(a, c), min(b, d)) for a, b in some for c, d in others)
    return tuple(sorted((low, high) for low, high in both if low <= high))


def in_words(folds: Folds, unit: str) -> str:
    """Return how far hinges turn, in degrees with a unit as it is to be written."""
    mirrored = tuple((-high, -low) for low, high in reversed(folds)) == folds
    ways = [(max(low, 0.0), high) for low, high in folds if high > 0] if mirrored else folds
    told = [f"{math.degrees(low):.3g} to {math.degrees(high):.3g}{unit}" for low, high in ways]
    if mirrored and ways[0][0] == 0:
        told[0] = f"at most {math.degrees(ways[0][1]):.3g}{unit}"
    text = " or ".join(told)
    return text if mirrored else f"{text}, counted positive where airflows lean apart"


@dataclass(frozen=True)
class _Part:
    """A convex part in the frame of the hinge, as it is with the module flat: corners, and a disc about each."""

    corners: Array
    """(k, 3) [m]"""
    radius: float = 0.0
    """Of the discs, across z [m]."""

    @property
    def rho(self) -> float:
        """How far from the hinge's axis points of the part are at most [m]."""
        return float(np.hypot(np.abs(self.corners[:, 0]) + self.radius, self.corners[:, 2]).max())

    @property
    def ball(self) -> tuple[Array, float]:
        """Centre (3,) and radius of a ball around the part [m]."""
        centre = self.corners.mean(axis=0)
        return centre, float(np.linalg.norm(self.corners - centre, axis=1).max()) + self.radius

    def support(self, u: Array, turn: Array) -> Array:
        """Return max u . x over the part for u (m, k, 3), with the part turned about y by angles (m,)."""
        u = _turn(u, -turn[:, None])
        result: Array = (u @ self.corners.T).max(axis=-1) + self.radius * np.hypot(u[..., 0], u[..., 1])
        return result


@lru_cache(maxsize=32)
def _search(module: Module, margin: float) -> Folds:
    """Return certified intervals of clear folds."""
    h = math.pi / 2 / FIRST
    phi, pairs = np.linspace(-math.pi / 2 + h, math.pi / 2 - h, FIRST), _pairs(module)
    even = module.body.frame is None  # hubs, arms and rotors are the same upside down
    phi = phi[phi > 0] if even else phi
    clear: list[tuple[float, float]] = []
    for _ in range(HALVINGS + 1):
        slack = np.full(len(phi), math.inf)  # what is left of all pairs' clearances where they are least, scaled
        for A, B in pairs:
            room = min(A.rho, B.rho) * h + ROUNDING * (A.rho + B.rho)
            left = slack > -1.0
            slack[left] = np.minimum(slack[left], (_distance(A, B, phi[left], margin + room) - margin) / room)
        clear += [(middle - h, middle + h) for middle in phi[slack >= 1.0].tolist()]
        open_ = phi[np.abs(slack) < 1.0]
        h /= 2
        phi = np.concatenate([open_ - h, open_ + h])
    return join(clear + [(-high, -low) for low, high in clear] if even else clear)


def join(intervals: list[tuple[float, float]]) -> Folds:
    """Return intervals with those that share an end put together."""
    found: list[tuple[float, float]] = []
    for low, high in sorted(intervals):
        if found and low - found[-1][1] < ROUNDING:
            low, _ = found.pop()
        found.append((low, high))
    right = math.pi / 2
    return tuple(
        (-right if right + low < ROUNDING else low, right if right - high < ROUNDING else high)
        for low, high in found
    )


def _pairs(module: Module) -> list[tuple[_Part, _Part]]:
    """Return rotors of one module and all parts of the other, with each of its ports at the hinge.

    A module's rotors are the same from every port, and what holds for one module's rotors and the other's frame
    holds for the other's rotors and the one's frame.
    """
    body, l_c, a = module.body, module.connector_distance, module.arm_length / math.sqrt(2)
    up = body.rotor_height / 2
    discs = [np.array([[x, y, -up], [x, y, up]]) for x in (-a, a) for y in (-a, a)]
    here, towards = np.array([l_c, 0.0, 0.0]), np.diag([-1.0, -1.0, 1.0])
    rotors = [_Part(disc - here, body.rotor_radius) for disc in discs]
    across = [_Part(disc + here, body.rotor_radius) for disc in discs]
    frames: dict[bytes, Array] = {}  # arms are the same from every port
    for x, y in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
        to_port = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])
        for corners in frame_pieces(module):
            seen = corners @ (towards @ to_port).T + here
            frames[np.unique(np.round(seen / l_c, 9) + 0.0, axis=0).tobytes()] = seen
    across += [_Part(seen) for seen in frames.values()]
    return [(rotor, part) for rotor in rotors for part in across]


def _distance(A: _Part, B: _Part, phi: Array, enough: float) -> Array:
    """Return how far two parts are apart at least at fold angles (m,); no more than `enough` need be proven [m]."""
    (a, r_a), (b, r_b) = A.ball, B.ball
    middle_a, middle_b = (_turn(np.broadcast_to(c, (len(phi), 3)), t) for c, t in ((a, phi / 2), (b, -phi / 2)))
    apart: Array = np.linalg.norm(middle_b - middle_a, axis=1) - r_a - r_b
    near = apart < enough
    if not near.any():
        return apart
    turn = phi[near] / 2

    def gap(u: Array) -> Array:
        return -A.support(u, turn) - B.support(-u, -turn)

    z = np.broadcast_to([0.0, 0.0, 1.0], (len(turn), 3))
    faces = np.stack([_turn(z, turn), -_turn(z, turn), _turn(z, -turn), -_turn(z, -turn)], axis=1)
    u = np.concatenate([faces, np.broadcast_to(DIRECTIONS, (len(turn), *DIRECTIONS.shape))], axis=1)
    most = np.full(len(turn), -math.inf)
    for aim in range(AIMS + 1):
        gaps = gap(u)
        best = gaps.argmax(axis=1)
        most = np.take_along_axis(gaps, best[:, None], axis=1)[:, 0]
        if np.all(most >= enough):
            break
        u = _ring(np.take_along_axis(u, best[:, None, None], axis=1)[:, 0], RING * NARROWER**aim, float(aim))
    apart[near] = np.maximum(apart[near], most)
    return apart


def _ring(axes: Array, angle: float, first: float) -> Array:
    """Return unit axes (m, 3) and six directions around each, the first of them anywhere, shape (m, 7, 3)."""
    across = np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    beside = np.cross(axes, across)
    ring = [math.cos(t) * across + math.sin(t) * beside for t in first + np.arange(6) * math.pi / 3]
    around = math.cos(angle) * axes[:, None] + math.sin(angle) * np.stack(ring, axis=1)
    return np.concatenate([axes[:, None], around], axis=1)


def _turn(vectors: Array, angle: Array) -> Array:
    """Return vectors (..., 3) turned about the y axis."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x + s * z, y + 0.0 * c, c * z - s * x], axis=-1)


def _evenly(m: int) -> Array:
    """Return m directions, evenly spread along a spiral, shape (m, 3)."""
    z, turn = 1.0 - (2.0 * np.arange(m) + 1.0) / m, np.arange(m) * math.pi * (3.0 - math.sqrt(5.0))
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)


DIRECTIONS = np.concatenate([_evenly(200), np.eye(3), -np.eye(3)])
"""Where the search for the best direction begins."""

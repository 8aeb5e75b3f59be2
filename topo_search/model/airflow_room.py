r"""The room that a module's rigid parts need beside the airflow of other modules.

An envelope starts with the radius r_air about its module's centre, by default one arm length, but a rotor at the
end of an arm reaches farther: the paper's envelope leaves the rotors' outer rims outside. So airflows that keep
clear of each other do not yet keep rotors out of them.

Of modules that are not bolted together the search keeps balls around rotors out of the airflow; what parts there
are outside those and outside the module's own envelope gets balls as well (`part_cover`).

Where two modules that share a hinge are to each other depends on its angle alone. Which way it turns matters: the
child's airflow leans away from its parent's, or towards it. Seen from either module the other one is the same, up
to quarter turns about its own axis (`airflow_folds`).

| symbol | meaning | unit |
|---|---|---|
| phi | fold: a hinge angle, positive where the two airflows lean apart (`topo_search.model.folds`) | rad |
| e, z | a port's direction and the thrust axis, in the module's frame | |
| P(eta) = o + eta l_air d | axis of the neighbour's envelope, eta in [0, 1] | m |
| r(eta) = r_air + eta dr_air | its radius | m |

.. math::

    o = l_c e + l_c (\cos\phi \, e + \sin\phi \, z), \qquad d = \sin\phi \, e - \cos\phi \, z

The clearance of a part, the least dist(P, part) - r, is convex in eta. In phi it changes by no more than the
largest distance of a part from the hinge's axis for every radian: seen from the envelope, that is how parts move.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np

from topo_search.model.arrays import Array, read_only
from topo_search.model.folds import Folds, join
from topo_search.model.layout import PORT_DIRECTIONS, ROTOR_DIRECTIONS
from topo_search.model.module import Module
from topo_search.model.room import body_radius

UP = np.array([0.0, 0.0, 1.0])
CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
FINEST = 0.25
"""Radius of the balls that cover what rotors' balls and the own envelope leave [l_arm], unless that makes many."""
MOST_BALLS = 24
"""More balls than this are replaced by larger ones."""
SECTIONS = 44
"""Golden sections of the axis: to a billionth."""
GOLDEN = (math.sqrt(5) - 1) / 2
FIRST = 16
"""Intervals of +-pi/2 that a search begins with."""
HALVINGS = 11
"""Times that an interval is halved which is clear in the middle but not yet all over: to 0.1 mrad."""


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


@functools.cache
def part_cover(module: Module) -> Balls:
    """Return balls around all rigid parts that reach out of the module's own airflow; rotors come first.

    The union of the balls and of the module's own envelope holds all rigid parts.
    """
    radius, rotors = (
        math.hypot(module.body.rotor_radius, module.body.rotor_height / 2),
        module.arm_length * ROTOR_DIRECTIONS,
    )
    pieces, finest = _pieces(module), FINEST * module.arm_length
    most = max(MOST_BALLS, len(pieces))
    while len(cells := list(islice(_uncovered_boxes(module, pieces, rotors, radius, finest), most + 1))) > most:
        finest *= math.sqrt(2)
    centres = np.concatenate([rotors, *(cell.centre[None] for cell in cells)])
    radii = np.array([radius] * 4 + [float(np.linalg.norm(cell.half)) for cell in cells])
    return Balls(read_only(centres), read_only(radii))


def _uncovered_boxes(
    module: Module, pieces: list[_Box], rotors: Array, radius: float, finest: float
) -> Iterator[_Box]:
    """Yield boxes around all of some pieces that is neither in the own envelope nor in a rotor's ball."""
    air, left = module.envelope, list(pieces)
    while left:
        box = left.pop()
        corners = box.centre + (CORNERS * box.half) @ box.axes
        if np.any((corners @ box.normals.T).min(axis=0) > box.offsets):
            continue  # beyond a face of the piece
        depth = -np.clip(corners[:, 2], -air.length, 0.0) / air.length  # a place on the axis near enough
        in_air = np.linalg.norm(corners + (depth * air.length)[:, None] * UP, axis=1)
        if np.all(in_air <= air.start_radius + depth * air.growth):
            continue  # an envelope is convex, and so is a ball
        if np.any(np.all(np.linalg.norm(corners - rotors[:, None], axis=2) <= radius, axis=1)):
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
        found = []
        for piece in body.frame:
            vertices = np.array(piece.vertices)
            corners = vertices[np.array(piece.triangles)]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            size = np.linalg.norm(normals, axis=1)
            told = size > 1e-9 * np.ptp(vertices, axis=0).max() ** 2  # of slivers the direction is lost
            normals = normals[told] / size[told, None]
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            # Faces as far out as the farthest corner: then half-spaces hold the piece to the last digit.
            offsets = (normals @ vertices.T).max(axis=1)
            found.append(_Box((low + high) / 2, np.eye(3), (high - low) / 2, normals, offsets))
        return found
    boxes = [(np.zeros(3), np.eye(3), np.array(body.hub) / 2)]
    for along in ROTOR_DIRECTIONS:
        axes = np.stack([along, np.cross(UP, along), UP])
        boxes.append((l_arm / 2 * along, axes, np.array([l_arm, width, width]) / 2))
    return [_Box(centre, axes, half, axes[:1], (half + axes @ centre)[:1]) for centre, axes, half in boxes]


@functools.cache
def airflow_folds(module: Module, margin: float = 0.0) -> Folds:
    """Return fold angles within +-pi/2 at which parts of bolted modules keep off each other's airflow [rad].

    The same for all ports, and empty where there is none. Every angle is clear; of those that a search finds, some
    that are hardly clear may be missing. For a frame of the module's own they are on the safe side: its distance is
    taken from the planes of its faces and from the box around it.

    Args:
        module: the module, at either side of the hinge.
        margin: what parts keep clear of the airflow by at least [m].
    """
    rate = module.connector_distance + body_radius(module)
    h = math.pi / 2 / FIRST
    phi, found = np.linspace(-math.pi / 2 + h, math.pi / 2 - h, FIRST), np.empty((0, 2))
    for _ in range(HALVINGS + 1):
        spare = _spare(module, phi) - margin
        clear, open_ = phi[spare >= rate * h], phi[np.abs(spare) < rate * h]
        found = np.concatenate([found, np.stack([clear - h, clear + h], axis=1)])
        h /= 2
        phi = np.concatenate([open_ - h, open_ + h])
        if not len(phi):
            break
    return join([(low, high) for low, high in found.tolist()])


def _spare(module: Module, phi: Array) -> Array:
    """Return the least clearance of all parts from the neighbour's airflow at any port, shape (t,) [m]."""
    air, body, l_c, pieces = module.envelope, module.body, module.connector_distance, _pieces(module)
    # All but a frame of its own looks the same from opposite ports, and with a square hub from all four.
    ports = PORT_DIRECTIONS[: 4 if body.frame is not None else 2 - (body.hub[0] == body.hub[1])]
    sine, cosine = np.sin(phi)[:, None, None], np.cos(phi)[:, None, None]
    o = l_c * ports + l_c * (cosine * ports + sine * UP)  # (t, ports, 3)
    d = air.length * (sine * ports - cosine * UP)

    def clearances(eta: Array) -> Array:
        """Return those of rotors, then of pieces; eta of shape (t, ports, m)."""
        P = o[:, :, None] + eta[..., None] * d[:, :, None]  # (t, ports, m, 3)
        across = np.linalg.norm((P[:, :, :4] - module.arm_length * ROTOR_DIRECTIONS)[..., :2], axis=-1)
        beside = np.maximum(0.0, across - body.rotor_radius)
        apart = [np.hypot(beside, np.maximum(0.0, np.abs(P[:, :, :4, 2]) - body.rotor_height / 2))]
        apart += [_from_piece(P[:, :, k], piece)[..., None] for k, piece in enumerate(pieces, start=4)]
        return np.concatenate(apart, axis=-1) - air.start_radius - eta * air.growth

    low = np.zeros((len(phi), len(ports), len(ROTOR_DIRECTIONS) + len(pieces)))
    high = np.ones_like(low)
    first, second = high - GOLDEN, low + GOLDEN
    at_first, at_second = clearances(first), clearances(second)
    least = np.minimum(clearances(low), clearances(high))
    for _ in range(SECTIONS):
        less = at_first < at_second
        low, high = np.where(less, low, first), np.where(less, second, high)
        new = np.where(less, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        at_new = clearances(new)
        first, second = np.where(less, new, second), np.where(less, first, new)
        at_first, at_second = np.where(less, at_new, at_second), np.where(less, at_first, at_new)
    least = np.minimum(least, np.minimum(at_first, at_second))
    return np.asarray(least.min(axis=(1, 2)))


def _from_piece(x: Array, piece: _Box) -> Array:
    """Return the distance of points, shape (..., 3), from a piece: of a frame of one's own, at most that."""
    beyond = np.maximum(0.0, np.abs((x - piece.centre) @ piece.axes.T) - piece.half)
    return np.asarray(
        np.maximum(np.linalg.norm(beyond, axis=-1), (x @ piece.normals.T - piece.offsets).max(axis=-1))
    )

r"""The cone-sphere of least volume around given points, from a given centre along a given axis.

| symbol | meaning |
|---|---|
| z, r | depth of a point along the axis, its distance from the axis |
| a, l, g | first ball's radius, length of the axis, growth of the radius per length, 0 <= g <= 1 |

A ball of the family has the centre t and the radius a + g t, 0 <= t <= l. The first one that holds (z, r) has

.. math:: t = \frac{z^2 + r^2 - a^2}{z + a g + \sqrt{(z + a g)^2 - (1 - g^2)(z^2 + r^2 - a^2)}}

and l is the largest such t. It falls with a and g, while the volume grows with a, g and l. So in a box of a and g
no volume is less than that of its lower corner with the length at its upper corner: branch and bound needs no more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from verify.bodies import Array

ENOUGH = 1.002
"""Volume over its lower bound at which the search ends."""
SHORTEST = 1e-3
"""Least length of the axis [a]."""
QUARTERS = np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) / 2


class Least(NamedTuple):
    """A cone-sphere, and what none around the points is smaller than."""

    a: float
    g: float
    l: float
    least_volume: float


def volume(a: Array | float, g: Array | float, l: Array | float) -> Array:
    """Return volumes of cone-spheres: a frustum between the circles where cone and balls touch, and two caps."""
    b = a + g * l
    frustum = (1 - g**2) ** 2 * l * (a * a + a * b + b * b)
    caps = a**3 * (1 - g) ** 2 * (2 + g) + b**3 * (1 + g) ** 2 * (2 - g)
    return np.asarray(math.pi / 3 * (frustum + caps))


def least_cone_sphere(z: Array, r: Array) -> Least:
    """Return one of at most ENOUGH times the least volume around points, shapes (m,) and (m,)."""
    corners, size = np.zeros((1, 2)), np.array([float(np.hypot(z, r).max()) * (1 + SHORTEST), 1.0])
    best, best_volume = np.zeros(3), math.inf
    while True:
        lengths = _length(corners + size, z, r)
        corners, lengths = corners[np.isfinite(lengths)], lengths[np.isfinite(lengths)]
        a, g = (corners + size).T
        held = np.stack([a, g, np.maximum(lengths, SHORTEST * a)], axis=1)
        volumes, bounds = volume(a, g, held[:, 2]), volume(corners[:, 0], corners[:, 1], lengths)
        if volumes.min() < best_volume:
            best, best_volume = held[np.argmin(volumes)], float(volumes.min())
        if best_volume <= ENOUGH * bounds.min():
            return Least(float(best[0]), float(best[1]), float(best[2]), float(bounds.min()))
        corners = (corners[bounds < best_volume][:, None] + size * QUARTERS).reshape(-1, 2)
        size = size / 2


def _length(sizes: Array, z: Array, r: Array) -> Array:
    """Return the least l of cone-spheres with (a, g), (k, 2), around the points; infinite where none is, (k,)."""
    a, g = sizes[:, :1], sizes[:, 1:]
    beyond, deep = z**2 + r**2 - a**2, z + a * g
    root = deep**2 - (1 - g**2) * beyond
    reached = (root >= 0) & (deep > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        first = beyond / (deep + np.sqrt(np.maximum(root, 0.0)))
    return np.asarray(np.where(beyond <= 0, 0.0, np.where(reached, first, np.inf)).max(axis=1))
